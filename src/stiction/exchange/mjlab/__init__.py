"""mjlab: identified joints in its robots, dry friction among its events and observations, logs of its robots.

It is called from users' own training scripts, in mjlab's environment: the base install of ours and mjlab are all that
is needed. The names that people import are those of `stiction.mjlab`.
"""
