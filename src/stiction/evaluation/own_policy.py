"""A policy that is a function in Python: for evaluation only, and named anew each time.

It gets what the robots measure and what they are told, and returns joint targets; what it computes from them is its own
affair. It has no contract and no golden vectors, so that it cannot be exported, signed or deployed. A file never names
it: whoever names such a function runs its module.
"""

from __future__ import annotations

import hashlib
import inspect
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from stiction.core.errors import ConfigurationError, PolicyError
from stiction.core.plugins import find_named
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import PolicyStep
from stiction.files.bundle import Bundle
from stiction.files.contract import contract_of_others
from stiction.files.observation import NO_CLIP, ObservationLayout, Term
from stiction.robots.catalog import find_robot

TIMESTEP = 0.005
"""Largest physics step [s]."""


@dataclass(frozen=True)
class OwnPolicy(Bundle):
    """A function in the place of a bundle's network."""

    function: str = ""
    """Its name, `package.module:FUNCTION`."""
    act: Callable[..., Any] | None = None
    """The function itself, where it was handed over and has to stay in this process."""


class FunctionDriver:
    """Drives N robots with a function of sensors, commands and the robots that were reset."""

    def __init__(self, policy: OwnPolicy, num: int) -> None:
        """Take the function, or find it by its name; raise `StictionError` where there is none."""
        self._name, self._contract = policy.function, policy.contract
        self._act = policy.act or _found(policy.function)
        self._fresh = np.ones(num, dtype=bool)

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Tell the function, at the next step, that the robots in `mask` (bool, (N,)) start anew; all without it."""
        self._fresh |= True if mask is None else np.asarray(mask, dtype=bool)

    def step(self, sensors: Sensors, command: np.ndarray) -> PolicyStep:
        """Return the function's targets.

        Raises `PolicyError`: it failed, or its targets have another shape than (N, J) or are not finite.
        """
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
    """Return a function as what an evaluation takes.

    Args:
        function: `package.module:FUNCTION`, or the function, which is called in this process alone; called as
            `FUNCTION(sensors, command, fresh)` with `Sensors` of shapes (N, ...), the base's velocity among them,
            commands (N, 3), and who starts anew, bool, (N,); returns joint targets [rad], shape (N, J).
        robot: the robot, see `find_robot`; its joints, gains and pose are the function's.
        control_period: time between two calls [s].

    Raises `StictionError`: there is no such function or robot.

    """
    act = _found(function) if isinstance(function, str) else function
    spec, module = find_robot(robot), inspect.getmodule(act)
    handed = None if isinstance(function, str) else function
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
    if handed is not None and getattr(module, getattr(act, "__name__", ""), None) is not act:
        # A closure, a method, an object: no source says what it holds, so that no walk that was kept is of it.
        source += os.urandom(16).hex()
    # Parted by NUL, which none of them contains: other parts cannot make the same text.
    digest = hashlib.sha256(f"{function}\0{robot}\0{control_period!r}\0{source}".encode()).hexdigest()
    return OwnPolicy(function.replace(":", "."), contract, b"", None, "", digest, 0, function=function, act=handed)


def _found(function: str) -> Any:
    """Return the function of a name; raise `ConfigurationError` where it is none."""
    found = find_named("policy", function)
    if not callable(found):
        raise ConfigurationError(f"policy {function!r} is {type(found).__name__}; expected a function")
    return found
