"""Foot contacts over time, with and without the two gait rewards."""
