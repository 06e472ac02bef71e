"""Friction fed forward on a robot: f and c of each joint from a `joints.json`, checked against the contract."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import FileError
from stiction.files.bam import load_joints
from stiction.files.contract import Contract
from stiction.joints.compensation import BY_SPEED, FrictionController

LARGEST = 0.45
"""Maximum friction at full torque over the torque limit [1]: friction of 30 % fed 50 % too high, the most with which
simulated robots walked (results/compensation). With `BY_SPEED.share` of it a third of the limit pushes, and two
thirds control."""

TOLERANCE = 0.01
"""Maximum relative difference between the torque limits of a record and of the contract [1]."""


@dataclass(frozen=True)
class FedFriction:
    """Friction of each joint, fed forward by `BY_SPEED`."""

    friction: dict[str, float]
    """Joint -> f, friction without load [N m]."""
    load: dict[str, float]
    """Joint -> c, friction per torque of the motor [1]."""

    def controller(self, period: float) -> FrictionController:
        """Return the controller of the fed torque; period: time between two readings [s]."""
        friction, load = (np.array([*values.values()]) for values in (self.friction, self.load))
        return BY_SPEED.controller(friction, period, load=load)

    def summary(self) -> dict[str, Any]:
        """Return plain data for the report."""
        return {"way": BY_SPEED.label, "share": BY_SPEED.share, "friction": self.friction, "load": self.load}

    def sentence(self, kinds: Sequence[str]) -> str:
        """Return the friction in one line; kinds: of each joint."""
        parts = []
        for kind in dict.fromkeys(kinds):
            values = [value for value, other in zip(self.friction.values(), kinds, strict=True) if other == kind]
            ends = dict.fromkeys(f"{end:.3g}" for end in (min(values), max(values)))
            parts.append(f"{kind} {' to '.join(ends)}")
        load = max(self.load.values())
        more = f", and of at most {load:.2g} times the torque" if load else ""
        return f"friction fed forward: {100 * BY_SPEED.share:g} % of {', '.join(parts)} N m{more}"


def read_fed_friction(path: Path, contract: Contract) -> FedFriction:
    """Return the friction of a `joints.json` for the joints of a contract.

    Raises `FileError` for a joint without usable friction, and for friction that is negative, over `LARGEST`, or of
    another motor.
    """
    file, friction, load = load_joints(path), dict[str, float](), dict[str, float]()
    for name, limit in zip(contract.joint_names, contract.torque_limit, strict=True):
        _, friction[name], load[name] = file.fed_forward(name)
        record, most = file.record(name), friction[name] + load[name] * limit
        estimate, stated, wrong = record.coulomb_friction, record.torque_limit, ""
        if record.axis != "rotary":
            wrong = "a linear axis (N), expected a rotary joint (N m)"
        elif stated is not None and not math.isclose(stated, limit, rel_tol=TOLERANCE):
            wrong = f"a torque limit of {stated:g} N m, expected {limit:g} N m as in the bundle"
        elif estimate is not None and estimate.value < 0.0 and not record.objections:
            # With the one objection that passes here friction reaches zero, and counts as zero.
            wrong = f"dry friction of {estimate.value:g} N m, expected none that is negative"
        elif most > LARGEST * limit:
            bound = f"{LARGEST * limit:.3g} N m, {100 * LARGEST:g} % of the torque limit"
            wrong = f"dry friction of {most:.3g} N m at full torque, expected at most {bound}"
        if wrong:
            raise FileError(f"--forward {path.name}: {name}: got {wrong}; identify the joints of this robot")
    return FedFriction(friction, load)
