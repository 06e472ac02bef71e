"""The axes of a velocity command, once: how they are typed, what files call them, and their units."""

from __future__ import annotations

from typing import NamedTuple


class Axis(NamedTuple):
    """One entry of a velocity command, in the base's frame."""

    letters: str
    """As it is typed and stands in results: `vx=0.5`."""
    name: str
    """In contracts and configurations."""
    unit: str


VELOCITY = (Axis("vx", "forward", "m/s"), Axis("vy", "sideways", "m/s"), Axis("wz", "turn", "rad/s"))
"""In the order of every vector of a command."""

AXES = tuple(axis.letters for axis in VELOCITY)
"""Axes as they are typed: forward and sideways velocity [m/s], turn rate [rad/s]."""

COMMANDS = tuple(axis.name for axis in VELOCITY)
"""Axes by name."""
