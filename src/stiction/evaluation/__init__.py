"""A policy bundle over engines, friction, grounds and commands: metrics, and its export from a run."""
