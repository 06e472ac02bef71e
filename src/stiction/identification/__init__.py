"""From a log to inertia and friction with intervals. NumPy and SciPy."""
