"""Which friction an evaluation gives to policies that observe their joints' friction; others are given none.

`contract` is the bundle as it is deployed; `true` is what a perfect bench would identify on each robot, and `true*0.7`
one that is wrong by 30 %; `bench` is what was identified on a virtual robot's own bench. The robot of the data sheet is
on no bench: there `bench` is `true`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.files.contract import Contract
from stiction.files.known_friction import kind_average
from stiction.joints.friction import MAX_LEVEL, Law
from stiction.robots.model import Robot
from stiction.task.friction import friction_share

Source = Literal["contract", "true", "bench"]
"""Where the friction comes from, if it is not a number."""

LARGEST_FACTOR = 10.0
"""Largest factor by which it may be wrong [1]."""


@dataclass(frozen=True)
class FrictionSource:
    """Where the friction that a policy is given comes from."""

    source: Source | float
    """A number is f/τ_max of every kind of joint [-]."""
    factor: float = 1.0
    """By which the truth, or what a bench says, is multiplied [1]."""


def parse_source(text: str) -> FrictionSource:
    """Return the source that a text names: `contract`, `true`, `bench`, f/τ_max as a number; `true*0.7` is 30 % off.

    Raises `StictionError` where it is none of these.
    """
    base, times, factor = text.strip().partition("*")
    try:
        source = next((name for name in get_args(Source) if name == base), None)
        parsed = FrictionSource(float(base) if source is None else source, float(factor) if times else 1.0)
    except ValueError:
        parsed = FrictionSource(math.nan)
    in_range = isinstance(parsed.source, str) or 0 <= parsed.source <= MAX_LEVEL
    may_scale = not times or parsed.source in ("true", "bench")
    if not in_range or not may_scale or not 0 <= parsed.factor <= LARGEST_FACTOR:
        raise ConfigurationError(
            f"known friction {text!r}: expected contract, true, bench, a fraction of the torque limit up to "
            f"{MAX_LEVEL}, or true and bench with an error: true*0.7, bench*1.3"
        )
    return parsed


def nominal_known(contract: Contract, spec: Robot) -> np.ndarray:
    """Return the nominal friction of training, mean f/τ_max of each kind of joint [-], shape (kinds,)."""
    share = friction_share(contract.friction_law, contract.array("friction"), spec)
    return share @ kind_average(contract.kinds)


def known_to(
    contract: Contract, spec: Robot, given: FrictionSource, law: Law, friction: np.ndarray
) -> np.ndarray | None:
    """Return the friction that a policy is given on N robots of the data sheet, f/τ_max by kind [-], shape (N, kinds).

    None where it observes none, or takes what its contract says. friction: of each robot's joints, torques [N m] or the
    law's coefficients, shape (N, J).
    """
    if not contract.observes_friction or given.source == "contract":
        return None
    average = kind_average(contract.kinds)
    if not isinstance(given.source, str):
        return np.full((len(friction), average.shape[1]), given.source)
    return given.factor * friction_share(law.name, friction, spec) @ average
