"""Excitation: which motion shows a joint's friction best within its limits, for how long, and at which gains."""
