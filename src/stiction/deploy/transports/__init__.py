"""How the supervisor reaches a robot: one small interface, `link.Link`, and one file a kind of robot."""
