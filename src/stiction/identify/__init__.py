"""Floor 2: from a log to inertia and friction with intervals. NumPy and SciPy."""
