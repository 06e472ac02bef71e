"""Floor 0: the files that pass between the stages, as typed records with read and write. NumPy and the standard library."""
