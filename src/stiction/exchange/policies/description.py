"""Description of a policy that was trained elsewhere, and the contract that follows from it.

Files of others state different parts. Each gives a `PolicySpec`; several are merged, later ones over earlier ones;
the fields still missing are asked for by name. Nothing is assumed that could be otherwise: a wrong scale or
order gives a robot that walks badly or falls, and blames its joints.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.files.contract import Contract, contract_of_others
from stiction.files.observation import (
    CLOCK_TERMS,
    FRAMES,
    NO_CLIP,
    GaitClock,
    HeightScan,
    ObservationLayout,
    Term,
)
from stiction.robots.catalog import is_shipped
from stiction.robots.model import Robot, with_standing_height
from stiction.robots.named import IMPORTED_ROBOT, raised, reordered

PerJoint = float | tuple[float, ...] | Mapping[str, float]
"""One number, one for each joint in the policy's order, or regular expression of whole names -> number."""

UNBOUNDED = 1000.0
"""Clip of the action that stands for none [-]: the contract's largest, which no network of a policy reaches."""

LARGEST_STEP = 0.005
"""Largest physics step where none is stated [s]: the largest part of the control period not above it is used."""


@dataclass(frozen=True)
class TermSpec:
    """One term of the observation, as a file describes it."""

    name: str
    """Our name of the term."""
    scale: float | tuple[float, ...] = 1.0
    clip: tuple[float, float] | None = None
    """Lowest and highest value; None: no clip."""
    clip_first: bool = False
    """True if the clip is before the scale."""
    history: int | None = None
    """Frames of this term; None: as many as of all."""
    offset: str | None = None
    """Offset of joint positions, `standing` or `none`; None: `standing`."""

    def bound(self) -> float | tuple[float, ...]:
        """Return the symmetric bound after scaling, for each entry where scales differ.

        Raises `ConfigurationError` where the clip is not symmetric.
        """
        if self.clip is None or self.clip == (-math.inf, math.inf):
            return NO_CLIP
        low, high = self.clip
        if not (high > 0 and math.isclose(low, -high)):
            raise ConfigurationError(
                f"observation {self.name!r} is cut off at {low:g} and {high:g}; a contract holds symmetric bounds alone"
            )
        if not self.clip_first:
            return min(high, NO_CLIP)
        if isinstance(self.scale, tuple):
            return tuple(min(high * scale, NO_CLIP) for scale in self.scale)
        return min(high * self.scale, NO_CLIP)


@dataclass(frozen=True)
class PolicySpec:
    """Partial description of a policy; None: not stated."""

    joint_names: tuple[str, ...] | None = None
    control_period: float | None = None
    physics_timestep: float | None = None
    kp: PerJoint | None = None
    kd: PerJoint | None = None
    default_position: PerJoint | None = None
    action_scale: PerJoint | None = None
    torque_limit: PerJoint | None = None
    action_clip: float | None = None
    """Bound of the action; infinite: the action is not cut off."""
    last_action: str | None = None
    observation: tuple[TermSpec, ...] | None = None
    history_length: int | None = None
    history_layout: str | None = None
    history_direction: str | None = None
    history_fill: str | None = None
    clock: GaitClock | None = None
    heights: HeightScan | None = None
    assumed: Mapping[str, str] | None = None
    """Name of the preset that filled gaps, `preset`, and names of the fields that it filled, `assumed`."""
    notes: tuple[str, ...] = ()
    """Notes on the reading of the file, for the user, a sentence each."""


MEANINGS = {
    "joint_names": "joints: the joints in the order of the network's output",
    "control_period": "control_period: time between two actions [s]",
    "kp": "kp: proportional gains of the joint controllers [N m/rad]",
    "kd": "kd: derivative gains [N m s/rad]",
    "default_position": "default_position: angles that an action of zero asks for [rad]",
    "action_scale": "action_scale: angle per unit of action [rad]",
    "action_clip": "action_clip: bound of the network's output [-], or none",
    "last_action": "last_action: clipped or raw, whether the action that is observed is the one after the clip",
    "observation": "observation: the terms in their order, each with its scale and clip",
    "history_length": "history.length: frames that the network sees, 1 for the present one alone",
    "history_layout": "history.layout: term_major (of each term all frames) or frame_major (whole frames)",
    "history_direction": "history.direction: oldest_first or newest_first",
    "history_fill": "history.fill: first or zero, what is before the first frame",
    "clock": "clock: the gait clock (period [s], offsets [rad], first, standing)",
    "heights": "heights: points (forward, left [m]) and offset [m] of the height scan",
}
"""Required field -> its entry in a file of settings, and its meaning."""


def merged(first: PolicySpec, second: PolicySpec) -> PolicySpec:
    """Return two descriptions merged: the second goes before the first, with a note where they differ."""
    both, notes = {}, [*first.notes, *second.notes]
    for part in fields(PolicySpec):
        if part.name == "notes":
            continue
        before, after = getattr(first, part.name), getattr(second, part.name)
        both[part.name] = before if after is None else after
        if before is not None and after is not None and before != after:
            notes.append(f"{part.name} is stated twice, and differently; the later file holds")
    return PolicySpec(**both, notes=tuple(notes))


def needed(spec: PolicySpec) -> list[str]:
    """Return the required fields of a description, names of `MEANINGS`."""
    names = [term.name for term in spec.observation or ()]
    longest = max([spec.history_length or 1, *(term.history or 1 for term in spec.observation or ())])
    parts = ["joint_names", "control_period", "kp", "kd", "default_position", "action_scale", "action_clip"]
    parts.append("observation")
    if spec.observation is None or any(term.history is None for term in spec.observation):
        parts.append("history_length")
    if longest > 1:
        parts += ["history_layout", "history_direction", "history_fill"]
    if "last_action" in names and spec.action_clip is not None and spec.action_clip < UNBOUNDED:
        parts.append("last_action")
    return parts + _sized(spec.observation or ())


def missing(spec: PolicySpec) -> list[str]:
    """Return the required fields that are missing."""
    return [name for name in needed(spec) if getattr(spec, name) is None]


def with_length(spec: PolicySpec, size: int, num_joints: int) -> PolicySpec:
    """Return the description with the history length that follows from the size of the network's input, if one does.

    size: numbers that the network takes; num_joints: actions that it gives.
    """
    terms = spec.observation or ()
    free = tuple(term for term in terms if term.history is None)
    if spec.history_length is not None or not free or any(getattr(spec, name) is None for name in _sized(terms)):
        return spec
    fixed = layout_of(replace(spec, observation=tuple(set(terms) - set(free))), num_joints).size
    frame = layout_of(replace(spec, observation=free, history_length=1), num_joints).size
    length, left = divmod(size - fixed, frame)
    if left or length < 1:
        return spec
    note = f"the history has {length} frames, by the network's {size} inputs and {frame} of a frame"
    return replace(spec, history_length=length, notes=(*spec.notes, *([note] if length > 1 else [])))


def _sized(terms: Sequence[TermSpec]) -> list[str]:
    """Return the fields that the sizes of terms depend on."""
    names = {term.name for term in terms}
    return [*(["clock"] if names & set(CLOCK_TERMS) else []), *(["heights"] if "height_scan" in names else [])]


def require(spec: PolicySpec, where: str) -> None:
    """Raise `ConfigurationError` for missing fields; where: the files that were read, with does or do."""
    if gaps := missing(spec):
        asked = "; ".join(MEANINGS[name] for name in gaps)
        raise ConfigurationError(
            f"{where} not describe all of the policy; add to a YAML file, with --settings: {asked}"
        )
    raw = spec.last_action == "raw" and any(term.name == "last_action" for term in spec.observation or ())
    if raw and spec.action_clip is not None and spec.action_clip < UNBOUNDED:
        raise ConfigurationError(
            f"the policy observes its action before it is cut off at {spec.action_clip:g}; a contract holds the action "
            "after the clip alone: export the network with the clip in it, and say action_clip: none"
        )


def per_joint(name: str, value: PerJoint, joints: tuple[str, ...]) -> tuple[float, ...]:
    """Return a value of every joint. Raises `ConfigurationError` where a joint has none, or a name is no joint's."""
    if isinstance(value, Mapping):
        for pattern in value:
            if not any(re.fullmatch(pattern, joint) for joint in joints):
                raise ConfigurationError(f"{name}: {unknown_name('joint', pattern, joints)}")
        numbers = [next((v for pattern, v in value.items() if re.fullmatch(pattern, joint)), None) for joint in joints]
        if None in numbers:
            raise ConfigurationError(f"{name}: no number for the joint {joints[numbers.index(None)]!r}")
        return tuple(float(number) for number in numbers if number is not None)
    if isinstance(value, tuple):
        if len(value) != len(joints):
            raise ConfigurationError(f"{name}: {len(value)} numbers for {len(joints)} joints; expected one each")
        return value
    return (float(value),) * len(joints)


def layout_of(spec: PolicySpec, num_joints: int) -> ObservationLayout:
    """Return the layout of the observation of a complete description."""
    terms, length = spec.observation or (), spec.history_length or 1
    phases, points = len(spec.clock.offsets) if spec.clock else 0, len(spec.heights.points) if spec.heights else 0
    sizes = {"roll_pitch": 2, "command_linear": 2, "command_turn": 1, "phase": 2 * phases, "height_scan": points}
    sizes |= dict.fromkeys(("phase_sin", "phase_cos"), phases)
    sizes |= dict.fromkeys(("angular_velocity", "command", "projected_gravity", "base_linear_velocity"), 3)
    sizes |= dict.fromkeys(("joint_position", "joint_velocity", "last_action"), num_joints)
    if odd := [term.name for term in terms if term.name not in sizes]:
        raise ConfigurationError(unknown_name("observation term", odd[0], sizes))
    with_sizes = tuple(
        Term(
            name=term.name,
            size=sizes[term.name],
            scale=term.scale,
            clip=term.bound(),
            frame=FRAMES[term.name],
            offset=(term.offset or "standing") if term.name == "joint_position" else "none",
            history_length=term.history if term.history != length else None,
        )
        for term in terms
    )
    return ObservationLayout(
        with_sizes,
        history_length=length,
        direction=spec.history_direction or "oldest_first",
        layout=spec.history_layout or "frame_major",
        fill=spec.history_fill or "first",
        clock=spec.clock if {term.name for term in terms} & set(CLOCK_TERMS) else None,
        heights=spec.heights if any(term.name == "height_scan" for term in terms) else None,
    )


def robot_for(spec: PolicySpec, robot: Robot) -> Robot:
    """Return the robot of a policy: its joints in the policy's order, with its gains, pose and scale of the action.

    A shipped robot whose gains or limits the policy raises gets another name, `go2_imported`.
    """
    names = spec.joint_names or ()
    robot = reordered(robot, names)
    stated: dict[str, Any] = {"kp": spec.kp, "kd": spec.kd, "default_position": spec.default_position}
    stated |= {"action_scale": spec.action_scale, "torque_limit": spec.torque_limit}
    values: dict[str, Any] = {
        name: per_joint(name, value, names) for name, value in stated.items() if value is not None
    }
    joints = tuple(
        replace(joint, **{name: value[number] for name, value in values.items()})
        for number, joint in enumerate(robot.joints)
    )
    varied = with_standing_height(replace(robot, joints=joints))
    if is_shipped(robot.name) and any(raised(varied, robot)):
        return replace(varied, name=f"{robot.name}{IMPORTED_ROBOT}")
    return varied


def contract_of(spec: PolicySpec, robot: Robot, network: tuple[str, bytes], revision: str, command: str) -> Contract:
    """Return the contract of a completely described policy.

    Args:
        spec: description of the policy; complete, see `require`.
        robot: the robot that it walks on; joints, gains and pose become the policy's.
        network: name and bytes of the file that it came from.
        revision: of this code.
        command: command line that reads it.

    Raises `StictionError` where robot and policy do not fit.

    """
    robot = robot_for(spec, robot)
    period = spec.control_period or 0.0
    if not 5e-4 <= period <= 0.2:
        raise ConfigurationError(f"control_period {period:g} s; expected 0.0005 to 0.2 s")
    decimation = (
        # Less a hair: the quotient of 0.035 and 0.005 is a little over 7 in binary, and would be eight steps.
        round(period / spec.physics_timestep) if spec.physics_timestep else math.ceil(period / LARGEST_STEP - 1e-9)
    )

    return contract_of_others(
        robot,
        period,
        decimation,
        layout_of(spec, robot.num_joints),
        action_clip=min(spec.action_clip or UNBOUNDED, UNBOUNDED),
        imported={"name": network[0], "sha256": hashlib.sha256(network[1]).hexdigest(), **(spec.assumed or {})},
        revision=revision,
        command=command,
    )


def unsupported_part(term: Term, names: Container[str]) -> str | None:
    """Return the part of a term that a format with the terms `names` cannot hold, or None."""
    if term.name not in names:
        return f"the term {term.name}"
    if term.name == "joint_position" and term.offset != "standing":
        return "joint angles that are not about the standing pose"
    return None
