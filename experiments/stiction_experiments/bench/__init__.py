"""Identified friction of virtual robots on their benches, compared with the ground truth."""
