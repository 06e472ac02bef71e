"""Files between the stages, as typed records. NumPy and the standard library."""
