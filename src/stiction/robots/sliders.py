"""Stability of the sliders that hold joints at a physics step, see `stiction.robots.physics`.

A stuck joint is an inertia I on a spring k, and a step of h first changes its speed, then its angle. With r = k h² / 4I
an angle's deviation from rest obeys x⁺ - (2 - 4r) x + x⁻ = 0, whose amplitude A is bounded for r < 1 alone; beyond, the
joint chatters within ±f and nothing sticks. Below, a load τ that comes at once swings the angle to

  τ/k (1 + 1/√(1 - r)),

where it should be 2 τ/k: the joint breaks away at 2/(1 + 1/√(1 - r)) of the load at which it should. I is the inertia
that the joint moves with the robot in the air and its other joints free, which is least: 1/(M⁻¹)_jj.
"""

from __future__ import annotations

import math

import numpy as np

from stiction.core.errors import MOST_NAMES, RobotError
from stiction.core.linear import invert
from stiction.robots.mjcf import build_model, standing_inertia
from stiction.robots.model import Robot
from stiction.robots.physics import LEAST_LS_ITERATIONS, PhysicsCfg, budget_objection

HOLDS = 0.8
"""Share of its load at which a joint may break away too early [-]."""

STIFFEST = 1.0 - (2.0 / HOLDS - 1.0) ** -2
"""r at which it breaks away at that share [-], 5/9."""


def moved_inertia(robot: Robot, armature: np.ndarray) -> np.ndarray:
    """Return the inertia that each joint moves, the robot in the air and its other joints free [kg m²], (joints,).

    In the standing pose; `armature`: inertia of the rotors [kg m²], shape (joints,). Raises `RobotError` for a joint
    that moves no inertia.
    """
    model = build_model(robot)
    joints = slice(-robot.num_joints, None)
    model.dof_armature[joints] = armature
    inverse, determined = invert(standing_inertia(model))
    if not determined[joints].all():
        name = robot.joint_names[int(np.argmin(determined[joints]))]
        raise RobotError(f"joint {name!r} moves no inertia; give the bodies behind it a mass, or its rotor an armature")
    return 1.0 / np.diag(inverse)[joints]


def stiffness_ratio(robot: Robot, physics: PhysicsCfg, timestep: float, armature: np.ndarray) -> np.ndarray:
    """Return r = k h² / 4I of each joint [-], shape (joints,); arguments as of `weak_friction`."""
    return physics.stiffness * timestep**2 / (4.0 * moved_inertia(robot, armature))


def weak_friction(robot: Robot, physics: PhysicsCfg, timestep: float, armature: np.ndarray) -> str | None:
    """Return a line about settings under which joints do not hold by their friction; None: they hold.

    Sliders may be too stiff for the physics step, and rows need a converged solver.

    timestep: physics step h [s]; armature: least inertia of each rotor that is drawn [kg m²], shape (joints,).
    """
    if not physics.plastic:
        return budget_objection(physics.solver_iterations, LEAST_LS_ITERATIONS)
    ratio = stiffness_ratio(robot, physics, timestep, armature)
    stiff = [number for number in np.argsort(-ratio, kind="stable").tolist() if ratio[number] > STIFFEST]
    if not stiff:
        return None
    worst = float(ratio[stiff[0]])
    share = 2.0 / (1.0 + 1.0 / math.sqrt(1.0 - worst)) if worst < 1.0 else 0.0
    does = f"breaks away at {share:.0%} of the load at which it should" if share else "chatters and never sticks"
    # Rounded down, so that what the line advises is enough.
    softer, shorter = physics.stiffness * STIFFEST / worst, timestep * math.sqrt(STIFFEST / worst)
    names = ", ".join(robot.joint_names[number] for number in stiff[:MOST_NAMES])
    return (
        f"--physics {physics.friction}: at steps of {timestep:g} s a slider of {physics.stiffness:g} N m/rad is too "
        f"stiff for {names}: k h²/4I is up to {worst:.2f} with the lightest rotors, expected at most {STIFFEST:.2f}, "
        f"and but for its motor's damping such a joint {does}; use --physics rows, --task.physics.stiffness "
        f"{_below(softer)}, or "
        f"--set task.timestep={_below(shorter)} with a task.decimation to match"
    )


def _below(value: float) -> str:
    """Return a positive number rounded down to two digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{float(f'{math.floor(value / unit + 1e-9) * unit:.2g}'):.10g}"
