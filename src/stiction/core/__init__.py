"""What every room stands on: errors, provenance, records, cache, parallel work, intervals, rotations."""
