"""Held-out error of identification beside that of other estimators, on measured and synthetic records."""
