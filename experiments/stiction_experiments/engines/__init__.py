"""Conformance of every engine, and the walks of one policy in each."""
