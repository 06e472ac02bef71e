"""Ways of training in the cells of a grid, and their names."""

from __future__ import annotations

from dataclasses import dataclass

FORWARD = "+forward"
"""Behind the names of policy and method: with friction fed forward in the joint controllers."""

FED = f"none{FORWARD}"
"""The conventional policy with friction fed forward."""


@dataclass(frozen=True)
class MethodCell:
    """Which way of training, in which cell of a grid."""

    method: str
    """Way of training with friction; in brackets what else tells one training from another."""
    engine: str
    """Engine, and what of a virtual robot is real in it."""
    friction_law: str
    """Law of the friction."""
    friction_level: float
    """Friction over the torque limit, or a coefficient [-]."""
    terrain: str
    """Ground."""
    command: str
    """Commanded velocity."""
