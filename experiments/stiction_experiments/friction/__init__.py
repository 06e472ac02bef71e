"""which training method works under joint friction, and at how much of it."""
