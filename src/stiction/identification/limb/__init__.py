"""Friction of a whole leg or arm from one log in which all its joints move, its base held, its links known nearly."""
