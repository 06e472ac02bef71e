"""Excitation: the motion, its duration and the gains that show a joint's friction best within its limits."""
