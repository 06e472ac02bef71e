"""Left-right symmetry of the task: every observation group and the actions of the mirrored robot in the mirrored world.

  o'_i = factor_i o_index_i + shift_i

* Vectors in the base follow the reflection y -> -y: (x, -y, z), angular velocities (-x, y, -z), roll and pitch (-φ, ψ),
  commands (v_x, -v_y, -ω).
* The first side changes its sign, and phases of the gait clock are exchanged with those of the other feet.
* Angles, velocities and actions of joints are exchanged with those of the mirror image, with its sign.
* Means of |e|, |θ'| and e θ', friction, rotor inertia and damping are exchanged without sign. The last two multiply a
  joint's own nominal value, and are converted where that differs from its image's (factor and shift).
* Values of a kind of joint are exchanged with those of the kind of its joints' images.
* The elevation map is looked up at (x, -y); a history is mirrored frame by frame.

A step of the mirrored robot is the mirror image of the robot's, to rounding, if the solver converges: Newton does, the
few sweeps of PGS do not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from tensordict import TensorDict
from torch import nn

from stiction.core.errors import ConfigurationError, RobotError
from stiction.files.observation import FIRST_SIDE, PLACEHOLDERS, Term
from stiction.robots.mirror import POSITION, ROTATION, RobotMirror, mirrored_kinds, robot_mirror
from stiction.robots.model import Robot
from stiction.task.env import LocomotionEnv
from stiction.task.randomization import MULTIPLIER_UNIT, PRIVILEGED_TERMS
from stiction.task.terrain import SCAN_POINTS


@dataclass(frozen=True)
class Rows:
    """Entries of a mirrored vector, arrays of one length: value i is factor_i x_index_i + shift_i."""

    index: np.ndarray
    factor: np.ndarray
    shift: np.ndarray | None = None

    @classmethod
    def exchanged(cls, index: np.ndarray) -> Rows:
        """Return rows that exchange entries, unchanged."""
        return cls(index, np.ones(len(index)))

    @classmethod
    def signed(cls, sign: np.ndarray) -> Rows:
        """Return rows that keep entries in place, each with its sign."""
        return cls(np.arange(len(sign)), sign)

    @classmethod
    def joined(cls, parts: list[Rows]) -> Rows:
        """Return the rows of concatenated parts of a vector."""
        begin = np.cumsum([0, *(len(part.index) for part in parts)])
        shifts = [np.zeros(len(part.index)) if part.shift is None else part.shift for part in parts]
        return cls(
            np.concatenate([part.index + first for part, first in zip(parts, begin, strict=False)]),
            np.concatenate([part.factor for part in parts]),
            None if all(part.shift is None for part in parts) else np.concatenate(shifts),
        )


class VectorMirror(nn.Module):
    """Mirror of the last axis of a tensor. Its numbers are part of the checkpoint of the network that uses them."""

    index: torch.Tensor
    factor: torch.Tensor
    shift: torch.Tensor | None

    def __init__(self, rows: Rows) -> None:
        """Register the rows as buffers."""
        super().__init__()
        self.register_buffer("index", torch.as_tensor(rows.index, dtype=torch.long))
        self.register_buffer("factor", torch.as_tensor(rows.factor, dtype=torch.float32))
        shift = None if rows.shift is None else torch.as_tensor(rows.shift, dtype=torch.float32)
        self.register_buffer("shift", shift)

    def forward(self, value: torch.Tensor) -> torch.Tensor:
        """Return the mirror image of vectors, shape (..., size)."""
        image = value.index_select(-1, self.index) * self.factor
        return image if self.shift is None else image + self.shift


class TaskMirror(nn.Module):
    """Mirror of observations and actions of a task."""

    def __init__(self, groups: dict[str, Rows], action: Rows) -> None:
        """Store the mirrors; `groups`: of every observation group; `action`: of the action."""
        super().__init__()
        self.rows = {**groups, "action": action}
        self.groups = nn.ModuleDict({name: VectorMirror(rows) for name, rows in groups.items()})
        self.action = VectorMirror(action)

    def forward(self, observations: TensorDict) -> TensorDict:
        """Return the mirror image of every group. Raises `StictionError` for a group without a rule."""
        image = {name: self.group(name)(value) for name, value in observations.items()}
        return TensorDict(image, batch_size=observations.batch_size)

    def group(self, name: str) -> VectorMirror:
        """Return the mirror of one group. Raises `StictionError` for a group without a rule."""
        if name not in self.groups:
            raise _no_rule(name)
        mirror = self.groups[name]
        assert isinstance(mirror, VectorMirror)
        return mirror


def task_mirror(env: LocomotionEnv) -> TaskMirror:
    """Return the mirror of a task.

    Raises `StictionError` where the robot has no mirror image, a group or term no rule, or an unobserved part of the
    task differs from left to right: the friction that `compensation` adds, the groups of an Actuator Net.
    """
    mirror = robot_mirror(env.spec)
    _check_fixed_parts(env, mirror)
    groups = {}
    for name, value in env.get_observations().items():
        if name not in RULES:
            raise _no_rule(name)
        groups[name] = RULES[name](env, mirror)
        size, ruled = value.shape[-1], len(groups[name].index)
        if size != ruled:
            raise ConfigurationError(f"observation group {name!r} has {size} entries and its mirror rule {ruled}")
    return TaskMirror(groups, Rows(mirror.joints, mirror.sign))


def _no_rule(group: str) -> ConfigurationError:
    """Return the error of an observation group without a rule."""
    return ConfigurationError(f"observation group {group!r} has no mirror rule; those with one: {', '.join(RULES)}")


def _check_fixed_parts(env: LocomotionEnv, mirror: RobotMirror) -> None:
    """Reject a task whose unobserved parts are not their own mirror image."""
    names = env.spec.joint_names
    if env.compensation is not None:
        angle = env.compensation.cpu().numpy()
        image = angle[mirror.joints]
        for number in np.flatnonzero(~np.isclose(angle, image))[:1]:
            raise RobotError(
                f"compensation adds {angle[number]:.4g} rad to joint {names[number]!r} and {image[number]:.4g} to its "
                f"mirror image {names[mirror.joints[number]]!r}: the task is not symmetric; use --symmetry none"
            )
    if env.motors is not None:
        number = {name: count for count, group in enumerate(env.motors.net.groups) for name in group}
        for joint, image, sign in zip(names, mirror.joints, mirror.sign, strict=True):
            if number[joint] != number[names[image]] or sign < 0:
                raise RobotError(
                    f"the Actuator Net treats joint {joint!r} and its mirror image {names[image]!r} differently; train "
                    "one with both in a group, or use --symmetry none"
                )


def _term(term: Term, robot: Robot, mirror: RobotMirror) -> Rows:
    """Return the rule of a term of a frame."""
    if term.name in PLACEHOLDERS:
        return Rows.signed(np.ones(term.size))
    if term.frame == "kind":
        return Rows.exchanged(mirrored_kinds(robot, mirror))
    if term.frame == "clock":
        return Rows.exchanged(np.concatenate([mirror.feet, len(mirror.feet) + mirror.feet]))
    if term.frame == "joint":
        return Rows(mirror.joints, mirror.sign)
    if term.frame == "joint_size":
        return Rows.exchanged(mirror.joints)
    rules = {
        "angular_velocity": ROTATION,
        "roll_pitch": ROTATION[:2],
        "command": np.array([POSITION[0], POSITION[1], ROTATION[2]]),
        FIRST_SIDE: np.array([-1.0]),
    }
    if term.name not in rules:
        raise ConfigurationError(
            f"observation term {term.name!r} has no mirror rule; those with one: {', '.join(rules)}"
        )
    return Rows.signed(rules[term.name])


def _frame(env: LocomotionEnv, mirror: RobotMirror) -> Rows:
    """Return the rule of o_prio, term by term."""
    return Rows.joined([_term(term, env.spec, mirror) for term in env.layout.terms])


def _history(env: LocomotionEnv, mirror: RobotMirror) -> Rows:
    """Return the rule of o_H, frame by frame."""
    return Rows.joined([_frame(env, mirror)] * env.layout.history_length)


def _privileged(env: LocomotionEnv, mirror: RobotMirror) -> Rows:
    """Return the rule of o_priv; multipliers are converted to the nominal value of the mirror image."""
    parts = []
    for name, per in PRIVILEGED_TERMS:
        if per == "robot":
            parts.append(Rows.signed(np.ones(1)))
            continue
        ratio = np.ones(len(mirror.joints))
        if name != "friction":
            ratio = _ratio(name, getattr(env.randomizer.nominal, name), env.spec.joint_names, mirror)
        # Observed is (multiplier - 1) / MULTIPLIER_UNIT, which a ratio of nominal values also shifts.
        parts.append(Rows(mirror.joints, ratio, (ratio - 1.0) / MULTIPLIER_UNIT))
    return Rows.joined(parts)


def _ratio(name: str, nominal: np.ndarray, joint_names: tuple[str, ...], mirror: RobotMirror) -> np.ndarray:
    """Return the nominal value of each joint's image over its own; raise `StictionError` where only one is zero."""
    other = nominal[mirror.joints]
    alone = np.flatnonzero((nominal == 0.0) & (other != 0.0))
    if len(alone):
        joint, image = joint_names[alone[0]], joint_names[mirror.joints[alone[0]]]
        raise RobotError(
            f"joint {joint!r} has no nominal {name} and its mirror image {image!r} {other[alone[0]]:g}: no multiplier "
            "makes them equal; identify both, or use --symmetry none"
        )
    return np.where(nominal == 0.0, 1.0, other / np.where(nominal == 0.0, 1.0, nominal))


def _explicit(env: LocomotionEnv, mirror: RobotMirror) -> Rows:
    """Return the rule of o_exp: the base's velocity, the contact of feet, and the friction of kinds of joints."""
    parts = [Rows.signed(POSITION), Rows.exchanged(mirror.feet)]
    if env.cfg.estimated_friction:
        parts.append(Rows.exchanged(mirrored_kinds(env.spec, mirror)))
    return Rows.joined(parts)


def _elevation(env: LocomotionEnv, mirror: RobotMirror) -> Rows:
    """Return the rule of e_t."""
    reflected = SCAN_POINTS * POSITION[:2]
    # Matched by place, not by number: the mirror holds for any grid, or is refused.
    distance = np.abs(reflected[:, None] - SCAN_POINTS).max(axis=-1)
    if distance.min(axis=1).max() > 1e-9:
        raise ConfigurationError("the points of the elevation map are not their own mirror image")
    return Rows.exchanged(distance.argmin(axis=1))


RULES: dict[str, Callable[[LocomotionEnv, RobotMirror], Rows]] = {
    "proprioception": _frame,
    "history": _history,
    "privileged": _privileged,
    "explicit": _explicit,
    "elevation": _elevation,
}
