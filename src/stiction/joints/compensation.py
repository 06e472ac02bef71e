"""Dry friction fed forward by a joint controller: in which direction it pushes, and how much of the friction.

Friction opposes motion, so what a controller adds must point where the joint is to go. Where that is, is the question:

* `error` goes by the position error alone, f sat((a − θ)/width): it also pushes a joint that swings past its target.
* `reference` and `measured` are what a user of motors would do:

      τ_ff = share (f + c |τ|) sat( sat(v/v_s) + exp(−(θ'/v_f)²) sat((a − θ)/width) )

  with v the speed of the target, low-passed as a motor controller does, or the speed of the joint as measured. The
  second term breaks away a joint that is stuck, which a measured speed of zero cannot, and a target at rest neither; it
  fades with the measured speed. c |τ| is friction that grows with the motor's torque τ. The share is below one: what is
  left of the friction keeps the joint from hunting about its target, and covers an error of the identification. They
  run in the computer, at every reading; `reference-motor` and `measured-motor` do so in the motor's controller, from
  its own encoder.

Training with `compensation` goes by `measured`, once in a control step, and moves the target on: see `compensated`.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.joints.pd import COMPENSATION_WIDTH, fed_forward

By = Literal["error", "reference", "measured", "reference-motor", "measured-motor"]

LOAD_LAW = "effort"
"""The law of simulated friction whose level is c: all of its friction grows with the motor's torque."""

LARGEST_SHARE = 2.0
"""Largest share of the friction that may be fed forward [1]: over 1 it is overcompensated, to be measured, not used."""


@dataclass(frozen=True)
class PushCfg:
    """How the direction of the push is found, of all ways but `error`."""

    slow: float = 0.2
    """v_s: speed, of the target or measured, from which all is fed forward [rad/s]; in proportion below. Infinite:
    the speed plays no part."""
    smoothing: float = 0.04
    """Time constant of the low-pass on the target [s]: two control periods at 50 Hz, over which targets jump."""
    width: float = COMPENSATION_WIDTH
    """Distance of the target from which a joint at rest is pushed with all [rad]; in proportion below."""
    fade: float = 0.3
    """v_f: measured speed at which that push is down to 37 % [rad/s]. Infinite: it does not fade."""

    def __post_init__(self) -> None:
        speeds, others = (self.slow, self.fade), (self.smoothing, self.width)
        if not (all(speed > 0 for speed in speeds) and all(0 < number < np.inf for number in others)):
            raise ConfigurationError(
                f"compensation with speeds {self.slow} and {self.fade} rad/s, smoothing {self.smoothing} s, width "
                f"{self.width} rad: expected four positive numbers"
            )


@dataclass(frozen=True)
class Compensation:
    """How friction is fed forward, and which share of it."""

    by: By
    share: float
    """Share of the identified friction [1], see `SHARES`."""
    push: PushCfg = field(default_factory=PushCfg)

    def __post_init__(self) -> None:
        if self.by not in get_args(By):
            raise ConfigurationError(f"compensation: {unknown_name('way', self.by, get_args(By))}")
        if not 0 <= self.share <= LARGEST_SHARE:
            raise ConfigurationError(
                f"compensation of {self.share} of the friction; expected 0 to {LARGEST_SHARE:g}, 0.7 to 0.8 in use"
            )

    @property
    def in_motor(self) -> bool:
        """Whether it runs in the motor's controller."""
        return self.by.endswith("-motor")

    @property
    def feeds_load(self) -> bool:
        """Whether it feeds friction that grows with the motor's torque: all ways but `error`."""
        return self.by != "error"

    @property
    def label(self) -> str:
        """The text that `parse_compensation` reads."""
        return self.by if self.share == SHARES[self.by] else f"{self.by}={self.share:g}"

    def controller(
        self, friction: np.ndarray, period: float, width: float = COMPENSATION_WIDTH, load: np.ndarray | float = 0.0
    ) -> FrictionController:
        """Return what computes the torque.

        friction: f, as identified [N m], shape (..., J); period: time between two calls [s]; width: of the way `error`
        [rad]; load: c, friction per torque of the motor, of the other ways [1], (..., J).
        """
        return FrictionController(self, np.asarray(friction, float), period, width, load)


SHARES: dict[By, float] = {by: 1.0 if by == "error" else 0.75 for by in get_args(By)}
"""Share of the friction that is fed forward where none is named [1]: of `error` all, as it always was."""


BY_ERROR = Compensation("error", SHARES["error"])
"""What is done where nothing else is said."""

BY_SPEED = Compensation("measured", SHARES["measured"])
"""What training with `compensation` does, and its policies on the robot."""


def parse_compensation(text: str) -> Compensation:
    """Return the way that a text names, one of `By`; after a `=` the share: `reference=0.7`.

    Raises `StictionError` where it names none.
    """
    by, equals, share = text.strip().partition("=")
    known = next((name for name in get_args(By) if name == by), None)
    try:
        if known is None:
            raise ConfigurationError(
                f"compensation: {unknown_name('way', by, get_args(By))}; with a share: measured=0.7"
            )
        return Compensation(known, float(share) if equals else SHARES[known])
    except ValueError as error:
        raise ConfigurationError(f"compensation {text!r}: expected a share after the '=', such as {by}=0.7") from error


class FrictionController:
    """Computes what is added against friction; all ways but `error` remember the targets of before."""

    def __init__(
        self, way: Compensation, friction: np.ndarray, period: float, width: float, load: np.ndarray | float
    ) -> None:
        """Begin with the first target at rest; arguments as of `Compensation.controller`."""
        self._way, self._friction, self._width, self._load = way, friction, width, load
        # The share of a gap that a first-order low-pass closes in a period, exact for a target that is held meanwhile.
        self._period, self._step = period, -np.expm1(-period / way.push.smoothing)
        self._smooth: np.ndarray | None = None

    def reset(self, ids: np.ndarray | None = None) -> None:
        """Begin with the next target at rest, of the robots `ids` of a batch, or all."""
        if ids is None or self._smooth is None:
            self._smooth = None
        else:
            # NaN marks those robots whose next target counts as their first.
            self._smooth[ids] = np.nan

    def torque(self, target: Any, position: Any, velocity: Any, given: Any = 0.0) -> np.ndarray:
        """Return τ_ff [N m], shape (..., J), and advance by one period.

        target: a [rad]; position, velocity: θ, θ' as measured [rad, rad/s]; given: τ, the torque that the gains ask for
        [N m]. The first target after a reset is taken as if it had been there forever.
        """
        way = self._way
        if way.by == "error":
            return np.asarray(fed_forward(target, position, way.share * self._friction, self._width))
        if self._smooth is None:
            self._smooth = np.array(target, float)
        before = np.where(np.isnan(self._smooth), target, self._smooth)
        self._smooth = before + self._step * (target - before)
        speed = velocity if way.by.startswith("measured") else (self._smooth - before) / self._period
        direction: np.ndarray = push_direction(speed, target - position, velocity, way.push)
        return way.share * (self._friction + self._load * np.abs(given)) * direction


class Hunting:
    """Finds joints that hunt: that go to and fro about a target at rest, for too much friction is fed forward to them.

    A turn is the time at which a joint that has last moved one way moves the other way; two are to and fro.
    """

    def __init__(
        self, joints: int, period: float, moves: float = 0.1, often: float = 5.0, seconds: float = 1.0
    ) -> None:
        """Begin with joints at rest.

        period: time between two readings [s]; moves: speed from which a joint moves [rad/s]; often: how often to and
        fro is hunting [1/s]; seconds: over which it is counted [s]. The defaults are for measured speeds: of virtual
        robots in PhysX with everything real that hold their pose, with an f that is 50 % too high, joints that hunt
        turn 14 to 67 times a second to and fro at 0.2 to 0.9 rad/s, with the right f none does once.
        """
        self._moves, self._most = moves, 2.0 * often * seconds
        self._turned: deque[np.ndarray] = deque(maxlen=max(1, round(seconds / period)))
        self._count, self._direction = np.zeros(joints, int), np.zeros(joints)

    def reset(self) -> None:
        """Begin anew: what joints do while they are to move is no hunting."""
        self._turned.clear()
        self._count, self._direction = np.zeros_like(self._count), np.zeros_like(self._direction)

    def step(self, speed: np.ndarray) -> np.ndarray:
        """Take the joints' speeds [rad/s], shape (J,); return which hunt, bool, shape (J,)."""
        direction = np.where(np.abs(speed) > self._moves, np.sign(speed), self._direction)
        turned = direction * self._direction < 0
        if len(self._turned) == self._turned.maxlen:
            self._count -= self._turned[0]
        self._turned.append(turned)
        self._count += turned
        self._direction = direction
        return self._count >= self._most


def compensated(target: Any, position: Any, velocity: Any, angle: Any, cfg: PushCfg) -> Any:
    """Return the target with friction compensated, a + angle · direction, see `push_direction`; shapes broadcast.

    Section V of the paper does not say how the direction is chosen: here it is that of the measured motion. target: a
    [rad]; position, velocity: θ, θ' as measured [rad, rad/s]; angle: the share of f that is compensated, over kp [rad].
    NumPy arrays and torch tensors alike.
    """
    return target + angle * push_direction(velocity, target - position, velocity, cfg)


def push_direction(speed: Any, error: Any, velocity: Any, cfg: PushCfg) -> Any:
    """Return where, and how much of, a joint is pushed, in [−1, 1]: sat( sat(v/v_s) + exp(−(θ'/v_f)²) sat(e/w) ).

    speed: v, of the low-passed target, or θ' itself [rad/s]; error: e = a − θ [rad]; velocity: θ', as measured
    [rad/s]; NumPy arrays or torch tensors of any shape.
    """
    # Methods and not NumPy's functions, for torch's tensors come here too; only of `exp` arrays have none.
    fading = -((velocity / cfg.fade) ** 2)
    share = fading.exp() if hasattr(fading, "exp") else np.exp(fading)
    stuck = share * (error / cfg.width).clip(-1.0, 1.0)
    return ((speed / cfg.slow).clip(-1.0, 1.0) + stuck).clip(-1.0, 1.0)
