"""Input of the policy, built from raw sensors in NumPy: the deployed twin of the observation that training builds.

One robot (shape (J,)) and a batch of N (shape (N, J)) run the same code. Golden vectors test that both twins agree.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stiction.core.errors import PolicyError
from stiction.core.rotation import roll_pitch, up_in_frames
from stiction.files.known_friction import TERM
from stiction.files.observation import CLOCK_TERMS, FIRST_SIDE, PLACEHOLDERS, SLOW_TERMS, GaitClock, ObservationLayout


@dataclass(frozen=True)
class Sensors:
    """Measurements at one instant; leading axes are the batch, empty for one robot."""

    quaternion: np.ndarray
    """Orientation of the base, unit, w x y z, shape (..., 4)."""
    angular_velocity: np.ndarray
    """Angular velocity in the base frame [rad/s], shape (..., 3)."""
    joint_position: np.ndarray
    """Joint angles [rad], shape (..., J)."""
    joint_velocity: np.ndarray
    """Joint velocities [rad/s], shape (..., J)."""
    base_linear_velocity: np.ndarray | None = None
    """Velocity of the base in its own frame [m/s], shape (..., 3), by an estimator or a simulator: no sensor has it."""
    heights: np.ndarray | None = None
    """Heights of the base over the ground [m] at the points of the layout's `HeightScan`, shape (..., points)."""

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the measurements by name."""
        return {name: value for name, value in vars(self).items() if value is not None}

    def each(self, change: Callable[[np.ndarray], np.ndarray]) -> Sensors:
        """Return the measurements with a function applied to every array."""
        return Sensors(**{name: change(value) for name, value in self.arrays().items()})


MEASURED: dict[str, Callable[[Sensors, np.ndarray, np.ndarray], np.ndarray]] = {
    "angular_velocity": lambda sensors, command, action: sensors.angular_velocity,
    "roll_pitch": lambda sensors, command, action: roll_pitch(sensors.quaternion),
    "projected_gravity": lambda sensors, command, action: -up_in_frames(sensors.quaternion),
    "command": lambda sensors, command, action: command,
    "command_linear": lambda sensors, command, action: command[..., :2],
    "command_turn": lambda sensors, command, action: command[..., 2:],
    "joint_position": lambda sensors, command, action: sensors.joint_position,
    "joint_velocity": lambda sensors, command, action: sensors.joint_velocity,
    "last_action": lambda sensors, command, action: action,
    "base_linear_velocity": lambda sensors, command, action: _estimated(
        sensors.base_linear_velocity, "the velocity of its base", "base_linear_velocity"
    ),
    "height_scan": lambda sensors, command, action: _estimated(sensors.heights, "the ground around it", "heights"),
}
"""Term -> its function of the sensors, the command and the last action."""


def _estimated(value: np.ndarray | None, quantity: str, field: str) -> np.ndarray:
    """Return an observed signal that no sensor of a robot has.

    Raises `PolicyError` where it is missing: zeros would tell the policy that the robot stands still.
    """
    if value is None:
        raise PolicyError(
            f"this policy observes {quantity}, which no sensor of a robot measures; it walks in the engine "
            f"mujoco, and on a robot only with an estimator that gives Sensors.{field}"
        )
    return value


class ObservationBuilder:
    """Builder of stacked frames, o_t^H: each term is clip((raw - offset) * scale); the order is the layout's."""

    def __init__(
        self,
        layout: ObservationLayout,
        standing: np.ndarray,
        batch: tuple[int, ...] = (),
        known_friction: np.ndarray | None = None,
        action_scale: float | np.ndarray | None = None,
        control_period: float | None = None,
    ) -> None:
        """Start with an empty history.

        standing: pose [rad], shape (J,); batch: leading shape, `()` for one robot or `(N,)`; known_friction: f/τ_max of
        each kind of joint [-], shape (kinds,), or of each robot, (*batch, kinds); action_scale: joint angle per unit of
        action [rad], for slow means; control_period: between two steps [s], for a gait clock. Raises `StictionError`:
        the friction has another shape, is not finite or negative, or no term has it; `ValueError`: slow means without a
        scale of the action, or a clock without a period.
        """
        self.layout = layout
        self._standing = np.asarray(standing, dtype=np.float64)
        self._batch = batch
        self._terms = [(term.name, (*batch, term.size), MEASURED.get(term.name)) for term in layout.terms]
        self._constant = {name: np.zeros(shape) for name, shape, _ in self._terms if name in PLACEHOLDERS}
        self._constant |= {name: np.ones(shape) for name, shape, _ in self._terms if name == FIRST_SIDE}
        if known_friction is not None:
            self._constant[TERM] = friction_of_robots(layout, known_friction, batch)
        self._lacks_friction = known_friction is None and layout.has(TERM)
        zero = {} if layout.heights is None else {"height_scan": layout.heights.offset}
        zeros = [self._standing if term.offset == "standing" else zero.get(term.name, 0.0) for term in layout.terms]
        self._offset = np.concatenate(
            [np.broadcast_to(value, term.size) for value, term in zip(zeros, layout.terms, strict=True)]
        )
        self._scale = np.concatenate([term.scales for term in layout.terms])
        self._most = np.concatenate([term.clips for term in layout.terms])
        self._least = -self._most
        self._history = np.zeros((*batch, layout.depth, layout.frame_size), np.float32)
        order = layout.order()
        # Most layouts are stacked as the history is kept: then nothing has to be reordered at every step.
        self._order = None if np.array_equal(order, np.arange(layout.depth * layout.frame_size)) else order
        self._empty = np.ones(batch, dtype=bool)
        self._slow: SlowMeans | None = None
        if layout.slow_kept is not None:
            if action_scale is None:
                raise ValueError("a layout with slow means needs action_scale, the joint angle per unit of action")
            self._slow, self._action_scale = SlowMeans((*batch, len(standing)), layout.slow_kept), action_scale
        self._clock: Clock | None = None
        if layout.clock is not None:
            if control_period is None:
                raise ValueError("a layout with a gait clock needs control_period, the time between two steps")
            self._clock = Clock(layout.clock, control_period, batch)

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Empty the history of the robots in `mask` (bool, the batch's shape), or of all."""
        self._empty |= True if mask is None else np.asarray(mask, dtype=bool)

    def frame(self, sensors: Sensors, command: np.ndarray, last_action: np.ndarray) -> np.ndarray:
        """Return one frame, o_t^prio, scaled and clipped, shape (*batch, frame size). Slow means are as of `step`.

        command: forward, sideways [m/s], turn [rad/s], shape (*batch, 3); last_action: the network's output of the
        previous step, after clipping, (*batch, J); zero at first. Raises `StictionError`: the layout has the joints'
        known friction, and none was given.
        """
        known = self._constant
        if self._slow is not None:
            known = known | self._slow.terms()
        if self._clock is not None:
            known = known | self._clock.terms()
        if self._lacks_friction:
            raise PolicyError(
                "this policy observes the friction of its joints, which is not known: export its bundle again, "
                "with --joints for what a bench identified, or give known_friction"
            )
        parts = []
        for name, shape, measure in self._terms:
            value = known[name] if measure is None else np.asarray(measure(sensors, command, last_action))
            if value.shape != shape:
                raise ValueError(f"{name} has shape {value.shape}; expected {shape}")
            parts.append(value)
        frame = np.concatenate(parts, axis=-1) - self._offset
        frame *= self._scale
        # As np.clip, in half of its time for one robot.
        np.maximum(frame, self._least, out=frame)
        return np.minimum(frame, self._most, out=frame)

    def step(self, sensors: Sensors, command: np.ndarray, last_action: np.ndarray) -> np.ndarray:
        """Append the present frame and return the network's input, a new float32 array, shape (*batch, size).

        After a reset every frame of the history is the present one.
        """
        if self._slow is not None:
            error = self._standing + self._action_scale * last_action - sensors.joint_position
            self._slow.step(error, np.asarray(sensors.joint_velocity), self._empty)
        if self._clock is not None:
            self._clock.step(command, self._empty)
        frame = self.frame(sensors, command, last_action).astype(np.float32)
        if self._empty.any():
            before = frame[..., None, :] if self.layout.fill == "first" else np.zeros(1, np.float32)
            self._history = np.where(self._empty[..., None, None], before, self._history)
            self._empty = np.zeros(self._batch, dtype=bool)
        self._history[..., :-1, :] = self._history[..., 1:, :]
        self._history[..., -1, :] = frame
        stacked = self._history.reshape(*self._batch, -1)
        # A copy: what is handed out must not change when the history moves on.
        return stacked.copy() if self._order is None else stacked[..., self._order]


class Clock:
    """Phases of a gait clock, of every robot."""

    def __init__(self, clock: GaitClock, control_period: float, batch: tuple[int, ...]) -> None:
        """Wait for the first step; control_period: time between two steps [s]; batch: leading shape."""
        self._clock, self._phase_step = clock, 2 * np.pi * control_period / clock.period
        self._count = np.zeros(batch, dtype=np.int64)
        self._stands = np.zeros(batch, dtype=bool)

    def step(self, command: np.ndarray, fresh: np.ndarray) -> None:
        """Advance by one step under a command, (*batch, 3); fresh: True where an episode starts, (*batch,)."""
        clock, stood = self._clock, self._stands & ~fresh
        self._count = np.where(fresh, clock.first, self._count + 1)
        if clock.standing is not None:
            below = clock.standing_below
            slow = np.linalg.norm(np.asarray(command)[..., :2], axis=-1) < below
            self._stands = slow & (np.abs(np.asarray(command)[..., 2]) < below)
            # A robot that stood starts its gait again, see `GaitClock.standing`.
            self._count = np.where(stood & ~self._stands, 0, self._count)

    def terms(self) -> dict[str, np.ndarray]:
        """Return the terms of the clock, see `CLOCK_TERMS`."""
        phase = np.array(self._clock.offsets) + (self._phase_step * self._count)[..., None]
        if self._clock.standing is not None:
            phase = np.where(self._stands[..., None], self._clock.standing, phase)
        sine, cosine = np.sin(phase), np.cos(phase)
        return dict(zip(CLOCK_TERMS, (np.concatenate([sine, cosine], axis=-1), sine, cosine), strict=True))


class SlowMeans:
    """Exponential means of products of error and velocity, which show a joint's dry friction, see `SLOW_TERMS`."""

    def __init__(self, shape: tuple[int, ...], decay: float) -> None:
        """Start without frames; shape: (*batch, J); decay: see `ObservationLayout.slow_kept`."""
        self._decay = decay
        self._sums = np.zeros((len(SLOW_TERMS), *shape))
        # Not zeros: before the first frame the means are 0/1, and not 0/0.
        self._weight = np.ones((*shape[:-1], 1))

    def step(self, error: np.ndarray, velocity: np.ndarray, fresh: np.ndarray) -> None:
        """Add a frame.

        error: of the last target [rad], velocity [rad/s], shape (*batch, J); fresh: robots that start anew, bool, the
        batch's shape.
        """
        products = np.stack([np.abs(error), np.abs(velocity), error * velocity])
        self._sums = products + np.where(fresh[..., None], 0.0, self._decay * self._sums)
        # The weights are summed up like what they weigh: a mean from the first frame on, and no sum that has yet to
        # grow.
        self._weight = 1.0 + np.where(fresh[..., None], 0.0, self._decay * self._weight)

    def terms(self) -> dict[str, np.ndarray]:
        """Return the means by term, each of shape (*batch, J)."""
        return dict(zip(SLOW_TERMS, self._sums / self._weight, strict=True))


def friction_of_robots(layout: ObservationLayout, known_friction: np.ndarray, batch: tuple[int, ...]) -> np.ndarray:
    """Return the known friction of every robot, shape (*batch, kinds); arguments and errors as of `ObservationBuilder`.

    A single number for each kind of joint holds for all robots.
    """
    value = np.asarray(known_friction, dtype=np.float64)
    size = next((term.size for term in layout.terms if term.name == TERM), None)
    if size is None:
        raise PolicyError(f"known friction {value.tolist()}: this policy observes none; leave it out")
    if value.shape not in ((size,), (*batch, size)):
        raise PolicyError(f"known friction of shape {value.shape}; expected {(size,)} or {(*batch, size)}")
    if not np.isfinite(value).all() or value.min() < 0:
        raise PolicyError(f"known friction {value.tolist()}: expected fractions of the torque limit, from 0 on")
    return np.broadcast_to(value, (*batch, size))
