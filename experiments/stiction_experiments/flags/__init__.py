"""Answers of identification after a wrong flag: known mistakes, made on purpose on records that it gets
right.
"""

RIGHT = "nothing"
"""Mistake of the cases in which all is right: what is refused there is a false alarm."""
