"""Transports from the supervisor to a robot: one small interface, `link.Link`, and one file a kind of robot."""
