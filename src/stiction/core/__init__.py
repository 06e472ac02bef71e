"""Foundations of every room: errors, provenance, records, cache, parallel work, intervals, rotations."""
