"""Policies of an evaluation: their training methods, the friction that they observe, functions as policies.

The training method follows from the contract. Policies that observe their joints' friction receive it from a source:
`contract` is the bundle as it is deployed; `true` is the result of a perfect bench on each robot, and `true*0.7` one
that is wrong by 30 %; `bench` is the result on a virtual robot's own bench, and equals `true` on the robot of the data
sheet. A policy that is a Python function is for evaluation only: it has no contract and no golden vectors, and no file
may name it, since naming such a function runs its module.
"""

from __future__ import annotations

import hashlib
import inspect
import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from stiction.core.errors import ConfigurationError, PolicyError
from stiction.core.plugins import find_named
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import PolicyStep
from stiction.files.bundle import Bundle
from stiction.files.contract import Contract, contract_of_others
from stiction.files.contract_rules import IMPORTED
from stiction.files.known_friction import kind_average
from stiction.files.method import installed_methods, known_method
from stiction.files.observation import NO_CLIP, ObservationLayout, Term
from stiction.joints.compensation import SHARES, Compensation
from stiction.joints.friction import MAX_LEVEL, Law
from stiction.robots.catalog import find_robot
from stiction.robots.model import Robot
from stiction.task.friction import friction_share

FORWARD = "+forward"
"""Suffix of policy and method with friction fed forward by the position error."""

FED = f"none{FORWARD}"
"""Conventional policy with the full friction fed forward by the position error."""

FED_BY_REFERENCE, FED_BY_MEASURED = "none+reference", "none+measured"
"""Conventional policy with friction fed forward by the target's or the joint's speed, by the error while stuck."""


def fed_suffix(compensation: Compensation) -> str:
    """Return the suffix of policy and method for friction fed forward: `+reference=0.8`."""
    return f"+{compensation.label.replace('error', FORWARD[1:])}"


@dataclass(frozen=True)
class MethodCell:
    """Training method in one cell of a grid."""

    method: str
    """Training method with friction; in brackets the settings that distinguish this training."""
    engine: str
    """Engine, and the real properties of a virtual robot in it."""
    friction_law: str
    """Law of the friction."""
    friction_level: float
    """Friction over the torque limit, or a coefficient [-]."""
    terrain: str
    """Ground."""
    command: str
    """Commanded velocity."""


KNOWN_FRICTION = "told"
"""Method of policies that observe their joints' friction, however it was drawn in training."""

BEHIND_GEAR = "actuator-output"
"""Method of policies trained through an Actuator Net of torque behind the gear, as in the paper."""

METHODS = {
    "none": "conventional randomisation, without friction",
    FED: "the same policy, the friction that was identified fed forward in the joint controllers at 500 Hz",
    FED_BY_REFERENCE: f"the same, {SHARES['reference']:g} of it, by the target's speed, and by the error while stuck",
    FED_BY_MEASURED: f"the same, {SHARES['measured']:g} of it, by the measured speed, and by the error while stuck",
    BEHIND_GEAR: "Actuator Net: without friction of its own, through a net of the torque behind the gears, friction in "
    "it, that a robot of this kind logged while `none` walked backward",
    "actuator": "its control: the same with the torque that the motors logged, which no friction is in",
    "deception": "friction-aware: friction from none to 1.2 of the nominal one",
    "identified": "friction-aware, around each joint's friction as identified on the bench of a robot of the same kind",
    KNOWN_FRICTION: "friction-aware, and told the friction of each kind of joint, as a bench identifies it",
    "direct": "friction within 0.8 to 1.2 of the nominal one",
    "point": "one value of friction and no range: each joint's as identified on the bench of a robot of the same kind",
    IMPORTED: "trained elsewhere: what friction it met is not known",
}


def method_texts() -> dict[str, str]:
    """Return every training method -> its description, including methods of installed distributions."""
    texts = dict(METHODS)
    for method in installed_methods():
        texts |= method.names or {method.name: method.description}
    return texts


def method_of(contract: Contract) -> str:
    """Return the training method of a policy, one of `method_texts`; of an uninstalled one only its name."""
    if contract.actuator is not None:
        return BEHIND_GEAR if contract.torque_source == "output_side" else "actuator"
    if contract.observes_friction:
        return KNOWN_FRICTION
    if contract.method == "deception" and contract.joints_file is not None:
        return "identified"
    if (method := known_method(contract.method)) is not None and method.called is not None:
        return method.called(contract)
    low, high = contract.friction_range
    return "point" if contract.method == "direct" and low == high else contract.method


Source = Literal["contract", "true", "bench"]

LARGEST_FACTOR = 10.0
"""Largest factor of a wrong friction [1]."""


@dataclass(frozen=True)
class FrictionSource:
    """Source of the friction that a policy observes."""

    source: Source | float
    """Name of the source; a number is f/τ_max of every kind of joint [-]."""
    factor: float = 1.0
    """Factor on the true or identified friction [1]."""


def parse_source(text: str) -> FrictionSource:
    """Return the source in a text: `contract`, `true`, `bench`, a number f/τ_max, `true*0.7`.

    Raises `StictionError`.
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
    contract: Contract, spec: Robot, source: FrictionSource, law: Law, friction: np.ndarray
) -> np.ndarray | None:
    """Return the friction observed by a policy on N robots of the data sheet, f/τ_max by kind, (N, kinds).

    None where the contract holds it, or the policy observes none. friction: of each robot's joints, torques [N m] or
    the law's coefficients, shape (N, J).
    """
    if not contract.observes_friction or source.source == "contract":
        return None
    average = kind_average(contract.kinds)
    if not isinstance(source.source, str):
        return np.full((len(friction), average.shape[1]), source.source)
    return source.factor * friction_share(law.name, friction, spec) @ average


TIMESTEP = 0.005
"""Largest physics step [s]."""


@dataclass(frozen=True)
class OwnPolicy(Bundle):
    """Function in place of a bundle's network."""

    function: str = ""
    """Name of the function, `package.module:FUNCTION`."""
    act: Callable[..., Any] | None = None
    """Function itself, for one passed as an object, which stays in this process."""


class FunctionDriver:
    """Driver of N robots by a function of sensors, commands and the robots that were reset."""

    def __init__(self, policy: OwnPolicy, num: int) -> None:
        """Take the function, or import it by its name. Raises `StictionError` for an unknown one."""
        self._name, self._contract = policy.function, policy.contract
        self._act = policy.act or _function(policy.function)
        self._fresh = np.ones(num, dtype=bool)

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Mark the robots in `mask` (bool, (N,)), by default all, as reset at the function's next call."""
        self._fresh |= True if mask is None else np.asarray(mask, dtype=bool)

    def step(self, sensors: Sensors, command: np.ndarray) -> PolicyStep:
        """Return the function's targets. Raises `PolicyError` where it fails, or they are not (N, J) and finite."""
        try:
            target = np.asarray(self._act(sensors, command, self._fresh), dtype=np.float64)
        except Exception as error:  # whatever the user's code raises
            raise PolicyError(f"{self._name} failed: {type(error).__name__}: {error}") from error
        self._fresh = np.zeros_like(self._fresh)
        shape = (len(self._fresh), self._contract.num_joints)
        if target.shape != shape or not np.isfinite(target).all():
            raise PolicyError(
                f"{self._name} returned targets of shape {target.shape}; expected {shape}, all finite [rad]"
            )
        nothing = np.zeros((shape[0], 0), dtype=np.float32)
        return PolicyStep(nothing, nothing, target)


def own_policy(function: str | Callable[..., Any], robot: str, control_period: float) -> OwnPolicy:
    """Return a function, or `package.module:FUNCTION`, as a bundle for an evaluation.

    It is called as `FUNCTION(sensors, command, fresh)` with `Sensors` of shapes (N, ...), the base's velocity among
    them, commands (N, 3), and the robots that were reset, bool (N,); returns joint targets [rad], (N, J).
    control_period: between calls [s]. Raises `StictionError` for an unknown function or robot.
    """
    act = _function(function) if isinstance(function, str) else function
    spec, module = find_robot(robot), inspect.getmodule(act)
    passed = None if isinstance(function, str) else function
    function = function if isinstance(function, str) else f"python:{getattr(act, '__qualname__', type(act).__name__)}"
    # In floating point 0.035 / 0.005 is a little more than 7.
    decimation = max(1, int(np.ceil(control_period / TIMESTEP - 1e-9)))

    seen = (Term("angular_velocity", 3, 1.0, NO_CLIP, "base"), Term("base_linear_velocity", 3, 1.0, NO_CLIP, "base"))
    contract = contract_of_others(
        spec,
        control_period,
        decimation,
        ObservationLayout(seen, history_length=1),
        action_clip=1.0,
        revision="none",
        command=function,
    )
    try:
        source = "" if module is None else inspect.getsource(module)
    except (OSError, TypeError):
        source = ""
    if passed is not None and getattr(module, getattr(act, "__name__", ""), None) is not act:
        # A closure, a method, an object: no source describes its state, so that no stored walk is used for it.
        source += os.urandom(16).hex()
    # Separated by NUL, which none of them contains, so that the text is unique.
    digest = hashlib.sha256(f"{function}\0{robot}\0{control_period!r}\0{source}".encode()).hexdigest()
    return OwnPolicy(function.replace(":", "."), contract, b"", None, "", digest, 0, function=function, act=passed)


def _function(function: str) -> Any:
    """Return the function of a name. Raises `ConfigurationError` where it is not callable."""
    act = find_named("policy", function)
    if not callable(act):
        raise ConfigurationError(f"policy {function!r} is {type(act).__name__}; expected a function")
    return act
