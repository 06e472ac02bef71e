"""Joint friction from the log of a walking robot: its legs in swing, and its whole body in stance."""
