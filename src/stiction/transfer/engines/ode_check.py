"""What would make ODE end the process, refused before it gets there.

After an error ODE calls exit(), after a failed assertion abort(); builds without assertions go on with garbage, and a
linear complementarity problem that holds a NaN may never end. No number that is none, and no body without mass, comes
past here; the ground checks itself.
"""

from __future__ import annotations

import numpy as np

from stiction.formats.errors import StictionError
from stiction.robots.links import links
from stiction.transfer.engines.engine import BlownUp, Body

WIDEST = 2 * np.pi
"""Range of a joint [rad]: ODE has angles from -π to π."""


def check_body(body: Body) -> None:
    """Raise `StictionError` for a robot that ODE cannot build."""
    spec, tree = body.spec, links(body.spec)
    _expect(spec.name, "mass [kg]", [spec.base.mass, *(link.mass for link in tree)], above=0.0)
    _expect(spec.name, "moment of inertia [kg m²]", np.array([link.inertia for link in tree]), above=0.0)
    _expect(spec.name, "size of the trunk [m]", spec.base.size, above=0.0)
    _expect(spec.name, "length of the shanks [m]", [spec.shank_link.size[2]], above=0.0)
    _expect(spec.name, "radius of the feet [m]", [spec.foot_radius], above=0.0)
    _expect(spec.name, "range of a joint [rad]", spec.joint_values("upper") - spec.joint_values("lower"), below=WIDEST)
    _expect(spec.name, "place of the trunk's centre of mass [m]", body.base_com)
    _expect(spec.name, "friction of the feet [1]", [body.ground_friction], least=0.0)
    _expect(spec.name, "armature [kg m²]", body.armature, least=0.0)
    _expect(spec.name, "damping [N m s/rad]", body.damping, least=0.0)
    _expect(spec.name, "sum of armature and damping", np.add(body.armature, body.damping), above=0.0)


def check_pose(joint_position: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> None:
    """Raise `StictionError` for a pose that is none; arguments as those of `Engine.reset`."""
    if not (np.isfinite(joint_position).all() and np.isfinite(position).all() and _is_unit(quaternion)):
        raise StictionError(
            f"reset of a robot to {position} m, quaternion {quaternion}, joint angles of {np.min(joint_position)} to "
            f"{np.max(joint_position)} rad; expected finite numbers, and a quaternion of length 1"
        )


def check_drive(torque: np.ndarray, friction: np.ndarray) -> None:
    """Refuse torques and bounds that are none; arguments as those of `Engine.step`.

    Raises:
        BlownUp: one is not a finite number.
        StictionError: a bound is negative.

    """
    for name, values in (("torque", torque), ("bound of friction", friction)):
        if not np.isfinite(values).all():
            joint = int(np.argmin(np.isfinite(values)))
            raise BlownUp(f"the {name} of joint {joint} is {values[joint]} N m; expected a finite number")
    if np.min(friction) < 0:
        raise StictionError(f"the bound of friction of a joint is {np.min(friction):g} N m; expected none under zero")


def _expect(
    robot: str,
    name: str,
    values: object,
    least: float = -np.inf,
    above: float = -np.inf,
    below: float = np.inf,
) -> None:
    """Raise `StictionError` unless values of a robot are finite and in a range, the first bound included."""
    numbers = np.ravel(np.asarray(values, float))
    wrong = ~(np.isfinite(numbers) & (numbers >= least) & (numbers > above) & (numbers < below))
    if wrong.any():
        bounds = ((least, "at least"), (above, "above"), (below, "below"))
        wanted = [f"{word} {bound:.4g}" for bound, word in bounds if np.isfinite(bound)]
        raise StictionError(
            f"robot {robot!r}: {name} of {numbers[wrong][0]:g}; the engine 'ode' expects "
            f"{' and '.join(['a finite number', *wanted])}"
        )


def _is_unit(quaternion: np.ndarray) -> bool:
    """Say whether a quaternion has length 1."""
    return bool(abs(np.linalg.norm(quaternion) - 1.0) < 1e-6)
