"""Proposed range of joint friction in newton metres, joint by joint.

A proposal is in shares of each joint's torque limit, so that the limits must be known: of a robot, or of the joints
that were identified.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from stiction.core.decode import is_number
from stiction.core.errors import FileError
from stiction.exchange.physics import Which, one_line


@dataclass(frozen=True)
class FrictionRange:
    """Dry friction to draw for joints with the same range."""

    joints: tuple[str, ...]
    """Names of the joints in the robot's model."""
    low: float
    """Lowest friction at rest [N m]."""
    high: float
    """Highest friction at rest [N m]."""


@dataclass(frozen=True)
class Recipe:
    """Friction ranges to write."""

    ranges: tuple[FrictionRange, ...]
    """Ranges, in the order of the joints."""
    together: bool
    """True if one random number a robot is for all its joints; else one each."""
    moving: tuple[float, float]
    """Friction in motion over friction at rest [-], lowest and highest; 1 where they were not identified apart."""
    alone: float
    """Friction of a place with one number over friction at rest [-]."""
    notes: tuple[str, ...]
    """Notes on the origin of the range."""


def recipe_of(training: Mapping[str, Any], limits: Mapping[str, float], which: Which = "moving") -> Recipe:
    """Return the ranges of a `training.json` for joints with these torque limits.

    training: as `files.joints.read_training` returns it; limits: name of a joint -> its torque limit [N m]; which:
    friction of a place with one number.
    Raises `FileError` where the proposal has no range, or is not of friction in newton metres.
    """
    friction, span = training["friction"], training.get("range")
    law = friction.get("law", "coulomb")
    if law not in ("coulomb", "stribeck"):
        raise FileError(f"the proposal is of the friction law {law!r}, of which no framework has a term; use coulomb")
    pair = isinstance(span, list) and len(span) == 2 and all(map(is_number, span))
    if not (isinstance(span, list) and pair and 0 <= span[0] <= span[1] < 1):
        raise FileError(f"'range' is {span!r}; expected two shares of the torque limit, from 0 to below 1")
    low, high = span
    if high == 0:
        raise FileError(
            f"method {friction['method']} proposes no friction to draw, and a range of 0 would erase what the model's "
            "joints have; leave that as it is, or convert the values of joints.json"
        )
    groups: dict[float, list[str]] = {}
    for name, limit in limits.items():
        groups.setdefault(limit, []).append(name)
    ranges = tuple(FrictionRange(tuple(names), low * limit, high * limit) for limit, names in groups.items())
    ends = friction.get("static_ratio", ())
    pair = isinstance(ends, list) and len(ends) == 2 and all(map(is_number, ends)) and 1 <= ends[0] <= ends[1]
    if law == "stribeck" and not pair:
        raise FileError(f"'friction.static_ratio' is {ends!r}; expected the lowest and the highest, from 1 on")
    # No more than what is drawn, where the joint has a larger ratio than training takes.
    ratio = max(_moving(training), 1.0 / ends[1]) if pair else _moving(training)
    moving = (1.0 / ends[1], 1.0 / ends[0]) if pair else (ratio, ratio)
    told = f"breakaway over moving: {1 / ratio:.3g}" if ratio < 1 else ""
    if told:
        told += "; a place with one number gets friction " + (
            "in motion (--friction static: at rest)" if which == "moving" else "at rest, and is braked by too much"
        )
    lines = (
        f"written by `stiction convert`: method {friction['method']}, {100 * low:g} to {100 * high:g} % of each "
        f"joint's torque limit{' at rest' if told else ''}",
        told,
        str(training.get("text", "")),
    )
    together = friction.get("per", "robot") == "robot"
    notes = tuple(one_line(text) for text in lines if text)
    return Recipe(ranges, together, moving, ratio if which == "moving" else 1.0, notes)


def _moving(training: Mapping[str, Any]) -> float:
    """Return friction in motion over that at rest of the joint that sets the level; 1 where they are not told apart."""
    joints = training.get("joints")
    known = [joint for joint in joints.values() if isinstance(joint, dict)] if isinstance(joints, dict) else []
    worst = max(
        known, key=lambda joint: joint["friction_level"] if is_number(joint.get("friction_level")) else 0.0, default={}
    )
    ratios = [worst.get(name) for name in ("friction_ratio", "dynamic_ratio")]
    rest, motion = (ratio.get("value", 0.0) if isinstance(ratio, dict) else 0.0 for ratio in ratios)
    return motion / rest if is_number(rest) and is_number(motion) and 0 < motion <= rest else 1.0
