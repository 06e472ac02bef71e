"""Wear monitor: estimates each joint's friction from the observations of a walk, in NumPy.

Dry friction takes τ_f = f sign(θ'), so a joint with more of it has a larger error e = target - angle while it moves,
and the mean of e·sign(θ') over a window of walking grows with f. Load, gains, damping and delay act on the same mean;
from the other moments, and the other joints, a linear map tells them apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stiction.core.errors import BundleError
from stiction.files.contract import Contract
from stiction.files.observation import ObservationLayout
from stiction.files.wear import WearModel

SOFT_SIGN = 0.5
"""Speed at which sign(θ') is taken as tanh(1) [rad/s]: about the noise of the measured velocity."""

JOINT_MOMENTS = 11

BODY_MOMENTS = 13


class Moments:
    """Features of two neighbouring frames, whose means over a window are the monitor's input."""

    def __init__(self, layout: ObservationLayout, action_scale: float | np.ndarray) -> None:
        """Find the terms in a frame. `action_scale`: joint angle per unit of action [rad]."""
        ends = np.cumsum([term.size for term in layout.terms])
        if layout.layout != "frame_major" or layout.direction != "oldest_first":
            raise BundleError(
                "a wear monitor reads whole frames, the oldest first; this policy's are stacked otherwise"
            )
        self._at = {
            t.name: (slice(end - t.size, end), t.scales if isinstance(t.scale, tuple) else t.scale)
            for t, end in zip(layout.terms, ends, strict=True)
        }
        self._action_scale = action_scale

    def __call__(self, before: np.ndarray, now: np.ndarray) -> np.ndarray:
        """Return the features, shape (..., size), of frames of a step and of the step before, shape (..., frame)."""

        def raw(frame: np.ndarray, name: str) -> np.ndarray:
            part, scale = self._at[name]
            return frame[..., part] / scale

        angle, velocity = raw(now, "joint_position"), raw(now, "joint_velocity")
        change = velocity - raw(before, "joint_velocity")
        error = self._action_scale * raw(now, "last_action") - angle
        sign = np.tanh(velocity / SOFT_SIGN)
        joints = [error, angle, velocity, error * sign, velocity * sign, np.abs(error), error**2, error * velocity]
        joints += [change * sign, np.abs(change), sign**2]
        command, rate, tilt = (raw(now, name) for name in ("command", "angular_velocity", "roll_pitch"))
        return np.concatenate([*joints, command, command**2, rate**2, tilt, tilt**2], axis=-1, dtype=np.float64)


HELD_UNCALIBRATED = (0.07, 0.87)
"""Share of windows whose 95 % interval of the level held the truth on virtual robots, of two maps that were not
calibrated on any: results/wear, five robots each. Of their single joints nothing is known."""


@dataclass(frozen=True)
class WearEstimate:
    """Dry friction as fractions of the torque limits, from one window of walking; NaN where it is not estimated."""

    friction: np.ndarray
    """f/τ_max of each joint [-], shape (J,)."""
    interval95: np.ndarray
    """Lower and upper ends, shape (2, J); not below 0."""
    level: float
    """Mean of f/τ_max over the joints [-]."""
    level_interval95: tuple[float, float]
    unusual: bool
    """True if the window was unlike those that the map was fitted on, and the numbers are not to be trusted."""
    calibrated: bool
    """True if the intervals are those of virtual robots, else of the simulator that the map was fitted in."""
    held: np.ndarray
    """Share of windows on virtual robots whose interval held the truth [-], shape (J,); NaN: not measured."""
    level_held: float
    """Share of such windows for the level [-]."""
    untold: tuple[str | None, ...]
    """Reason why this reading does not tell the friction, for each joint, then for the level; None where it does."""


class WearMonitor:
    """Monitor that reads the policy's input and estimates the joints' friction after every window."""

    def __init__(self, contract: Contract, model: WearModel) -> None:
        """Start with an empty window. model: the bundle's, or a calibrated one of the same policy.

        Raises `StictionError`: the map is for other joints or another layout.
        """
        self.model = model
        self._moments = Moments(contract.observation, contract.scale)
        self._frame = contract.observation.frame_size
        size = JOINT_MOMENTS * contract.num_joints + BODY_MOMENTS
        if model.joint_names != contract.joint_names or len(model.center) != size:
            raise BundleError(
                f"wear.json is for the joints {model.joint_names} and {len(model.center)} features; the contract has "
                f"{contract.joint_names} and {size}; export the bundle again"
            )
        self.reset()

    def reset(self) -> None:
        """Empty the window: after a stop, a fall, or a pause of the loop."""
        self._sum, self._count = np.zeros(len(self.model.center)), 0
        self._before: np.ndarray | None = None

    def step(self, observation: np.ndarray) -> WearEstimate | None:
        """Add one input of the network, shape (size,); return an estimate at the end of a window, else None."""
        frame = np.asarray(observation[-self._frame :], dtype=np.float64)
        if self._before is not None:
            self._sum += self._moments(self._before, frame)
            self._count += 1
        self._before = frame
        if self._count < self.model.window:
            return None
        mean = self._sum / self._count
        self._sum, self._count = np.zeros_like(self._sum), 0
        return estimate(self.model, mean)


def estimate(model: WearModel, mean: np.ndarray) -> WearEstimate:
    """Return the estimate of a window's mean features, shape (features,)."""
    calibration, unusual = model.calibration, bool((_standard(model, mean) ** 2).mean() > model.unusual)
    value = raw_estimate(model, mean)
    if calibration is None:
        shift, spread = np.zeros(len(value)), np.array([[-1.0], [1.0]]) * np.array(model.reach)
        # The worse of the two maps that were tried: it is not known which of them this one is like.
        held = np.append(np.full(len(value) - 1, np.nan), min(HELD_UNCALIBRATED))
    else:
        shift, spread = np.array(calibration.shift), np.array([calibration.lower, calibration.upper])
        held = np.array(calibration.held)
    # A calibration's ends count from the map's own estimate, and so does its shift. No friction is below zero.
    ends, value = np.maximum(value + spread, 0.0), np.maximum(value + shift, 0.0)
    return WearEstimate(
        friction=value[:-1],
        interval95=ends[:, :-1],
        level=float(value[-1]),
        level_interval95=(float(ends[0, -1]), float(ends[1, -1])),
        unusual=unusual,
        calibrated=calibration is not None,
        held=held[:-1],
        level_held=float(held[-1]),
        untold=tuple(_untold(model, unusual, *each) for each in zip(value, (spread[1] - spread[0]), strict=True)),
    )


def raw_estimate(model: WearModel, mean: np.ndarray) -> np.ndarray:
    """Return the map's estimate of each target [-], shape (J + 1,); NaN where it does not estimate one."""
    standard = _standard(model, mean)
    return np.where(model.estimated, np.array(model.intercept) + standard @ np.array(model.weights), np.nan)


def _standard(model: WearModel, mean: np.ndarray) -> np.ndarray:
    return np.clip((mean - np.array(model.center)) / np.array(model.scale), -model.limit, model.limit)


def _untold(model: WearModel, unusual: bool, value: float, width: float) -> str | None:
    """Return the reason why a window does not show a friction: its value [-] and the width of its interval [-]."""
    if not math.isfinite(value):
        return "the map does not estimate it: a walk hardly depends on it"
    if unusual:
        return "the window is unlike those that the map was fitted on"
    if width >= model.highest:
        return f"its interval is as wide as all that the map was fitted on, 0 to {model.highest:g}"
    if value > model.highest:
        return f"above {model.highest:g}, the highest friction that the map was fitted on"
    return None
