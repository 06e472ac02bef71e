"""Dry friction fed forward by a joint controller: direction and size of the added torque.

Friction opposes motion, so the added torque must point in the direction in which the joint is to move. The ways differ
in how they find it:

* `error` uses the position error alone, f sat((a − θ)/width): it also pushes a joint that swings past its target.
* `reference` and `measured` are what a user of motors would do:

  τ_ff = share (f + c |τ|) sat( sat(v/v_s) + exp(−(θ'/v_f)²) sat((a − θ)/width) )

  with v the low-passed speed of the target, as in a motor controller, or the measured speed of the joint. The second
  term breaks away a stuck joint, which neither a measured speed of zero nor a target at rest can; it fades with the
  measured speed. c |τ| is friction that grows with the motor's torque τ. The share is below one: the remaining friction
  keeps the joint from oscillating about its target, and covers an error of the identification. These ways run in the
  computer, at every reading; `reference-motor` and `measured-motor` run in the motor's controller, from its encoder.

Training with `compensation` uses `measured`, once per control step, and shifts the target: see `compensated`.
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
"""Law of simulated friction whose level is c: all friction grows with the motor's torque."""

LARGEST_SHARE = 2.0
"""Maximum share of the friction that may be fed forward [1]; above 1, overcompensation, for measurements only."""


@dataclass(frozen=True)
class PushCfg:
    """Direction of the push, for all ways except `error`."""

    slow: float = 0.2
    """v_s: speed, of the target or measured, above which all is fed forward [rad/s]; in proportion below. Infinite: the
    speed is ignored."""
    smoothing: float = 0.04
    """Time constant of the low-pass on the target [s]: two control periods at 50 Hz, over which targets jump."""
    width: float = COMPENSATION_WIDTH
    """Distance to the target above which a joint at rest gets the full push [rad]; in proportion below."""
    fade: float = 0.3
    """v_f: measured speed at which that push has fallen to 37 % [rad/s]. Infinite: it does not fade."""

    def __post_init__(self) -> None:
        speeds, scales = (self.slow, self.fade), (self.smoothing, self.width)
        if not (all(speed > 0 for speed in speeds) and all(0 < number < np.inf for number in scales)):
            raise ConfigurationError(
                f"compensation with speeds {self.slow} and {self.fade} rad/s, smoothing {self.smoothing} s, width "
                f"{self.width} rad: expected four positive numbers"
            )


@dataclass(frozen=True)
class Compensation:
    """Feed-forward of friction: its way, and the share of the friction."""

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
        """True if it runs in the motor's controller."""
        return self.by.endswith("-motor")

    @property
    def feeds_load(self) -> bool:
        """True if it includes friction that grows with the motor's torque: all ways except `error`."""
        return self.by != "error"

    @property
    def label(self) -> str:
        """Text that `parse_compensation` reads."""
        return self.by if self.share == SHARES[self.by] else f"{self.by}={self.share:g}"

    def controller(
        self, friction: np.ndarray, period: float, width: float = COMPENSATION_WIDTH, load: np.ndarray | float = 0.0
    ) -> FrictionController:
        """Return the controller that computes the torque.

        friction: f, as identified [N m], shape (..., J); period: time between two calls [s]; width: of the way `error`
        [rad]; load: c, friction per torque of the motor, of the other ways [1], (..., J).
        """
        return FrictionController(self, np.asarray(friction, float), period, width, load)


SHARES: dict[By, float] = {by: 1.0 if by == "error" else 0.75 for by in get_args(By)}
"""Default share of the friction that is fed forward [1]."""


BY_ERROR = Compensation("error", SHARES["error"])
"""Default compensation of a run."""

BY_SPEED = Compensation("measured", SHARES["measured"])
"""Compensation of training with `compensation`, and of its policies on the robot."""


def parse_compensation(text: str) -> Compensation:
    """Return the compensation of a text: a way, one of `By`, optionally with a share, `reference=0.7`.

    Raises `StictionError` for another text.
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
    """Controller of the torque added against friction; all ways except `error` remember earlier targets."""

    def __init__(
        self, way: Compensation, friction: np.ndarray, period: float, width: float, load: np.ndarray | float
    ) -> None:
        """Start with the first target at rest; arguments as of `Compensation.controller`."""
        self._way, self._friction, self._width, self._load = way, friction, width, load
        # The share of a gap that a first-order low-pass closes in a period, exact for a target that is held meanwhile.
        self._period, self._step = period, -np.expm1(-period / way.push.smoothing)
        self._smooth: np.ndarray | None = None

    def reset(self, ids: np.ndarray | None = None) -> None:
        """Restart with the next target at rest, for the robots `ids` of a batch, or all."""
        if ids is None or self._smooth is None:
            self._smooth = None
        else:
            # NaN marks those robots whose next target counts as their first.
            self._smooth[ids] = np.nan

    def torque(self, target: Any, position: Any, velocity: Any, requested: Any = 0.0) -> np.ndarray:
        """Return τ_ff [N m], shape (..., J), and advance by one period.

        target: a [rad]; position, velocity: θ, θ' as measured [rad, rad/s]; requested: τ, torque of the gains [N m].
        The first target after a reset counts as constant until then.
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
        return way.share * (self._friction + self._load * np.abs(requested)) * direction


class Hunting:
    """Detector of joints that oscillate about a target at rest, because too much friction is fed forward.

    A turn is the time at which a joint reverses its last direction of motion; two turns are one oscillation.
    """

    def __init__(
        self, joints: int, period: float, moves: float = 0.1, often: float = 5.0, seconds: float = 1.0
    ) -> None:
        """Start with joints at rest.

        period: time between two readings [s]; moves: minimum speed of motion [rad/s]; often: oscillations per second
        that count as hunting [1/s]; seconds: length of the window [s]. The defaults are for measured speeds of virtual
        robots in PhysX with all imperfections that hold their pose: with an f that is 50 % too high, hunting joints
        oscillate 14 to 67 times a second at 0.2 to 0.9 rad/s; with the right f none oscillates once.
        """
        self._moves, self._most = moves, 2.0 * often * seconds
        self._turned: deque[np.ndarray] = deque(maxlen=max(1, round(seconds / period)))
        self._count, self._direction = np.zeros(joints, int), np.zeros(joints)

    def reset(self) -> None:
        """Restart: joints that are commanded to move do not hunt."""
        self._turned.clear()
        self._count, self._direction = np.zeros_like(self._count), np.zeros_like(self._direction)

    def step(self, speed: np.ndarray) -> np.ndarray:
        """Add the joints' speeds [rad/s], shape (J,); return the mask of hunting joints, bool, shape (J,)."""
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

    Section V of the paper does not state the direction: here it is that of the measured motion. target: a [rad];
    position, velocity: θ, θ' as measured [rad, rad/s]; angle: the compensated share of f, over kp [rad]. NumPy arrays
    and torch tensors alike.
    """
    return target + angle * push_direction(velocity, target - position, velocity, cfg)


def push_direction(speed: Any, error: Any, velocity: Any, cfg: PushCfg) -> Any:
    """Return the direction and strength of the push, in [−1, 1]: sat( sat(v/v_s) + exp(−(θ'/v_f)²) sat(e/w) ).

    speed: v, of the low-passed target, or θ' itself [rad/s]; error: e = a − θ [rad]; velocity: θ', as measured [rad/s];
    NumPy arrays or torch tensors of any shape.
    """
    # Methods and not NumPy's functions, for torch's tensors come here too; only of `exp` arrays have none.
    fading = -((velocity / cfg.fade) ** 2)
    share = fading.exp() if hasattr(fading, "exp") else np.exp(fading)
    stuck = share * (error / cfg.width).clip(-1.0, 1.0)
    return ((speed / cfg.slow).clip(-1.0, 1.0) + stuck).clip(-1.0, 1.0)
