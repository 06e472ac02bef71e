"""A policy bundle over engines, friction, grounds and commands: what it is worth, and its export from a run."""
