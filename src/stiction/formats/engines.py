"""What physics engines did in the conformance suite, and how the same policies walk in them, as records."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

TRAINING, FINE_TRAINING = "training", "training (1 ms)"
"""The simulator that policies were trained in, many robots at once, their controllers part of the engine: at its own
step, and at a finer one."""

MUJOCO, COARSE, STIFF = "mujoco", "mujoco (training's step)", "mujoco (contacts of 4 ms)"
"""MuJoCo with one robot and torque from outside: at the step of the other engines, at the step of the training, and at
the step of the others with contacts about as stiff as theirs."""


@dataclass(frozen=True)
class FigureRow:
    """One figure of the conformance suite in one engine."""

    engine: str
    """Name of the engine."""
    timestep: float
    """Physics step [s]."""
    check: str
    """Name of the check."""
    figure: str
    """What was measured."""
    value: float | None
    """What came out, zero were perfect; None where it is not a number."""
    unit: str
    """Its unit, `1` for a ratio."""
    bound: float
    """Largest magnitude that passes."""
    passed: bool
    """Whether it does."""


@dataclass(frozen=True)
class PaceRow:
    """How fast one engine steps, all engines side by side in one run."""

    engine: str
    """Name of the engine."""
    timestep: float
    """Physics step [s]."""
    steps_per_second: float
    """Steps per second of processor time, median over rounds [1/s]."""
    share: float
    """... over that of the first engine in the same rounds, median [1]."""


@dataclass(frozen=True)
class WalkRow:
    """How one policy walked in one simulator at one friction level and command."""

    policy: str
    """Name of the bundle."""
    simulator: str
    """`TRAINING`, `FINE_TRAINING`, `COARSE`, `STIFF`, or the name of an engine."""
    timestep: float
    """Physics step [s]."""
    friction_level: float
    """Dry friction in every joint as a fraction of its torque limit [-]."""
    command: str
    """Commanded velocity: `vx=0.5`."""
    episodes: int
    """Number of walks, each from other joint angles."""
    speed_ratio: float
    """Mean speed along the command over the commanded speed [-]."""
    speed_low: float | None
    """Lower end of the 95 % t-interval of that mean over episodes; None for one episode."""
    speed_high: float | None
    """Its upper end."""
    falls: int
    """Episodes with a fall."""
    fall_low: float
    """Lower end of Wilson's 95 % interval of the share of falls."""
    fall_high: float
    """Its upper end."""
    to_training: float | None
    """Speed over that in `TRAINING` [-]; None there, and where that is zero."""
    to_training_low: float | None
    """Lower end of its 95 % interval (the delta method); None where there is none."""
    to_training_high: float | None
    """Its upper end."""


@dataclass(frozen=True)
class EpisodeRow:
    """One walk behind a `WalkRow`."""

    policy: str
    """Name of the bundle."""
    simulator: str
    """As in `WalkRow`."""
    friction_level: float
    """As in `WalkRow`."""
    command: str
    """As in `WalkRow`."""
    episode: int
    """Its number."""
    speed_ratio: float
    """Mean speed along the command over the commanded speed, zero after a fall [-]."""
    fell: bool
    """Whether the robot fell."""


@dataclass(frozen=True)
class Traces:
    """Two motions of every engine, to be drawn; arrays of shape (samples,)."""

    time: np.ndarray
    """Of the joint's samples [s]."""
    load: np.ndarray
    """Torque on the joint over its dry friction [1]."""
    exact_speed: np.ndarray
    """Of the joint, in closed form [rad/s]."""
    speed: dict[str, np.ndarray]
    """Engine -> speed of the joint [rad/s]."""
    error: dict[str, np.ndarray]
    """Engine -> magnitude of the error of the joint's angle [rad]."""
    flight: dict[str, np.ndarray]
    """Engine -> largest error of a joint's angle in free flight, from the start to its end [rad]."""
    flight_time: np.ndarray
    """Of the flight's samples [s]."""
