"""What would make ODE end the process, refused before it gets there.

ODE's error is exit(), its failed assertion abort(), in the builds of some systems; other builds go on with garbage, and
a linear complementarity problem that holds a NaN may never end. Nothing that is not a number, and no body without mass,
comes through here.
"""

from __future__ import annotations

import numpy as np

from stiction.formats.errors import StictionError
from stiction.robots.links import links
from stiction.transfer.engines.engine import BlownUp, Body
from stiction.transfer.engines.ground import Ground

WIDEST = 2 * np.pi
"""Range of a joint [rad]: ODE has angles from -π to π."""


def check_body(body: Body) -> None:
    """Raise `StictionError` for a robot that ODE cannot build."""
    spec = body.spec
    masses = [spec.base.mass, *(link.mass for link in links(spec))]
    sizes = [*spec.base.size, spec.shank_link.size[2], spec.foot_radius]
    _refuse(spec.name, "masses [kg]", masses, "positive numbers", _all_positive(masses))
    _refuse(spec.name, "sizes of trunk, shank and foot [m]", sizes, "positive numbers", _all_positive(sizes))
    inertias = np.array([link.inertia for link in links(spec)])
    _refuse(spec.name, "inertias [kg m²]", inertias, "positive numbers", _all_positive(inertias))
    ranges = spec.joint_values("upper") - spec.joint_values("lower")
    _refuse(spec.name, "ranges of joints [rad]", ranges, f"less than {WIDEST:.4g}", bool((ranges < WIDEST).all()))
    inside = np.isfinite([*body.base_com, body.ground_friction]).all() and body.ground_friction >= 0
    given = (*body.base_com, body.ground_friction)
    _refuse(spec.name, "centre of mass and friction of the feet", given, "numbers, friction not negative", inside)
    rotor = np.concatenate((body.armature, body.damping))
    whole = np.isfinite(rotor).all() and (rotor >= 0).all() and (np.add(body.armature, body.damping) > 0).all()
    _refuse(spec.name, "armature and damping", rotor, "numbers, not negative, one of each joint's positive", whole)


def check_ground(ground: Ground) -> None:
    """Raise `StictionError` for boxes without size, place or orientation; a height field checks itself."""
    for half, place, turn in zip(ground.half_sizes, ground.positions, ground.quaternions, strict=True):
        if not (_all_positive(half) and np.isfinite(place).all() and _is_unit(turn)):
            raise StictionError(
                f"box of half sizes {half} m at {place} m, turned by {turn}; expected positive half sizes, a place, "
                "and a quaternion of length 1"
            )


def check_pose(joint_position: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> None:
    """Raise `StictionError` for a pose that is none; arguments as those of `Engine.reset`."""
    if not (np.isfinite(joint_position).all() and np.isfinite(position).all() and _is_unit(quaternion)):
        raise StictionError(
            f"reset to joint angles {joint_position} rad, place {position} m, quaternion {quaternion}; expected finite "
            "numbers, and a quaternion of length 1"
        )


def check_drive(torque: np.ndarray, friction: np.ndarray) -> None:
    """Refuse torques and bounds that are none; arguments as those of `Engine.step`.

    Raises:
        BlownUp: one is not a finite number.
        StictionError: a bound is negative.

    """
    if not (np.isfinite(torque).all() and np.isfinite(friction).all()):
        raise BlownUp(f"torques {torque} and bounds of friction {friction} N m in the engine 'ode'; expected numbers")
    if np.min(friction) < 0:
        raise StictionError(f"bounds of friction {friction} N m; expected none that is negative")


def _refuse(robot: str, what: str, given: object, wanted: str, good: object) -> None:
    """Raise `StictionError` unless something of a robot is good."""
    if not good:
        raise StictionError(f"robot {robot!r}: {what} {given}; the engine ode expects {wanted}")


def _all_positive(values: object) -> bool:
    """Say whether all values are finite and positive."""
    numbers = np.asarray(values, float)
    return bool(np.isfinite(numbers).all() and (numbers > 0).all())


def _is_unit(quaternion: np.ndarray) -> bool:
    """Say whether a quaternion has length 1."""
    return bool(abs(np.linalg.norm(quaternion) - 1.0) < 1e-6)
