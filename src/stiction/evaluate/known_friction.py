"""What an evaluation tells policies that observe their joints' friction: the truth, a bench's number, or another one.

Others are told nothing, whatever is asked. `contract` is the bundle as it is deployed; `true` is what a perfect bench
would say of each robot, and `true*0.7` one that is wrong by 30 %; `bench` is what a bench did say, of a virtual robot
its own. The robot of the data sheet is on no bench: there `bench` is `true`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.formats.contract import Contract
from stiction.formats.known_friction import kind_average
from stiction.joints.friction import MAX_LEVEL, Law
from stiction.locomotion.friction import friction_share
from stiction.robots.model import RobotSpec

Source = Literal["contract", "true", "bench"]
"""Where the friction that is told comes from, if it is not a number."""

LARGEST_FACTOR = 10.0
"""Most by which what is told may be wrong [1]."""


@dataclass(frozen=True)
class Told:
    """What policies are told."""

    source: Source | float
    """A number is f/τ_max of every kind of joint [-]."""
    factor: float = 1.0
    """By which the truth, or what a bench says, is multiplied [1]."""


def parse_told(text: str) -> Told:
    """Return what a text asks for: `contract`, `true`, `bench`, or f/τ_max as a number; `true*0.7` is wrong by 30 %.

    Raises:
        StictionError: it is none of these.

    """
    base, times, factor = text.strip().partition("*")
    try:
        source = next((name for name in get_args(Source) if name == base), None)
        told = Told(float(base) if source is None else source, float(factor) if times else 1.0)
    except ValueError:
        told = Told(math.nan)
    numbers = isinstance(told.source, str) or 0 <= told.source <= MAX_LEVEL
    free = not times or told.source in ("true", "bench")
    if not numbers or not free or not 0 <= told.factor <= LARGEST_FACTOR:
        raise ConfigurationError(
            f"known friction {text!r}: expected contract, true, bench, a fraction of the torque limit up to "
            f"{MAX_LEVEL}, or true and bench with an error: true*0.7, bench*1.3"
        )
    return told


def nominal_known(contract: Contract, spec: RobotSpec) -> np.ndarray:
    """Return the nominal friction of training as it would be told: mean f/τ_max of each kind of joint, (kinds,)."""
    share = friction_share(contract.friction_law, contract.array("friction"), spec)
    return share @ kind_average(contract.joint_names)


def told_in_batch(contract: Contract, spec: RobotSpec, told: Told, law: Law, friction: np.ndarray) -> np.ndarray | None:
    """Return `told_at` for a policy that observes its joints' friction; None: what its contract says, or nothing."""
    if not contract.knows_friction or told.source == "contract":
        return None
    return told_at(contract, spec, told, law, friction)


def told_at(contract: Contract, spec: RobotSpec, told: Told, law: Law, friction: np.ndarray) -> np.ndarray:
    """Return what is told on each of N robots of the data sheet [-], shape (N, kinds).

    friction: of each robot's joints, torques [N m] or the law's coefficients, shape (N, joints); told: other than
    `contract`.
    """
    average = kind_average(contract.joint_names)
    if not isinstance(told.source, str):
        return np.full((len(friction), average.shape[1]), told.source)
    return told.factor * friction_share(law.name, friction, spec) @ average
