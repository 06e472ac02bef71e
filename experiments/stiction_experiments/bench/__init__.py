"""What identification finds of virtual robots on their benches, held against the truth."""
