"""Columns of results.csv as pure functions of a recording. After a fall a robot's speed counts as zero."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stiction.evaluation.course import FLAT, Course
from stiction.files.results import COLUMNS
from stiction.files.velocity import Command
from stiction.files.walk import Recording

WINDOW = 1.0
"""Windows over which velocity is averaged before it is compared with the command [s]: sway within a stride is no
error."""

MOVING_SPEED = 0.1
"""Speed of the base above which a step counts as moving [m/s]; yaw rate [rad/s] in a pure turn."""

SHORTEST_DISTANCE = 0.1
"""Smallest mean displacement for a cost of transport [m]."""


@dataclass(frozen=True)
class Metrics:
    """Measured columns of one row of results.csv, and the metrics stored only in summary.json."""

    speed_ratio: float | None
    tracking_error: float
    fall_rate: float
    distance: float
    cost_of_transport: float | None
    joint_jitter: float
    tripod_share: float | None
    flight_share: float | None
    group_share: tuple[float, float] | None
    """Share of moving steps with exactly contact group 0, and exactly group 1, on the ground [-]."""
    moving_share: float | None
    """Share of moving steps in all steps [-], the base of the shares above; None where no motion is commanded."""
    mean_vx: float
    """Mean forward velocity in the base's frame, zero after a fall [m/s]."""
    mean_vy: float
    """Mean sideways velocity [m/s]."""
    mean_wz: float
    """Mean yaw rate [rad/s]."""
    mean_friction: float | None = None
    """Mean bound of the joints' dry friction, falls included [N m]; None where not recorded."""
    steps_climbed: float | None = None
    """Mean number of stairs passed, up and down; None on ground without stairs."""
    crossed: float | None = None
    """Share of episodes in which the robot crossed its course; None on flat ground."""
    joint_chatter: float | None = None
    """Root mean square of joint acceleration, by physics step [rad/s²]; None where not recorded."""

    @property
    def mean_velocity(self) -> tuple[float, float, float]:
        """Mean vx, vy [m/s] and wz [rad/s]."""
        return self.mean_vx, self.mean_vy, self.mean_wz

    @property
    def columns(self) -> dict[str, Any]:
        """Metrics stored in results.csv: column -> value."""
        return {name: value for name, value in vars(self).items() if name in COLUMNS}

    @property
    def summary_only(self) -> dict[str, Any]:
        """Metrics stored only in summary.json: name -> value."""
        return {name: value for name, value in vars(self).items() if name not in COLUMNS}


def measure(
    recording: Recording, command: Command, groups: np.ndarray | None, weight: float, course: Course = FLAT
) -> Metrics:
    """Return the metrics of one row, over all its episodes, after settling.

    groups: contact group (0 or 1) of each foot, shape (L,), None without; weight: of the robot [N].
    """
    steps_climbed, crossed = course.judge(recording.position, recording.upright)
    distance = displacement(recording)
    moving = moving_steps(recording, command)
    flight, groups_share = gait_shares(recording, moving, groups)
    vx, vy, wz = _velocity(recording).mean(axis=(0, 1), dtype=float).tolist()
    return Metrics(
        speed_ratio=speed_ratio(recording, command),
        tracking_error=tracking_error(recording, command),
        fall_rate=float(1.0 - recording.upright[-1].mean()),
        distance=distance,
        cost_of_transport=cost_of_transport(recording, distance, weight),
        joint_jitter=rms_upright(recording, recording.square_acceleration),
        tripod_share=None if groups_share is None else sum(groups_share),
        flight_share=flight,
        group_share=groups_share,
        moving_share=None if moving is None else float(moving.mean()),
        mean_vx=vx,
        mean_vy=vy,
        mean_wz=wz,
        mean_friction=None if recording.friction is None else float(recording.friction.mean()),
        steps_climbed=steps_climbed,
        crossed=crossed,
        joint_chatter=None if recording.square_chatter is None else rms_upright(recording, recording.square_chatter),
    )


def combine(episodes: Sequence[Metrics]) -> Metrics:
    """Return the metrics of a row from those of its episodes, each measured alone.

    Shares are weighted by moving steps, a cost of transport by distance; jitter is a root mean square. `measure` gives
    the same at once, except for jitter after falls and the energy of robots that did not move.
    """

    def mean(name: str, weight: str | None = None) -> float | None:
        values = [getattr(episode, name) for episode in episodes]
        weights = [1.0 if weight is None else getattr(episode, weight) or 0.0 for episode in episodes]
        known = [(value, by) for value, by in zip(values, weights, strict=True) if value is not None and by > 0.0]
        return sum(value * by for value, by in known) / sum(by for _, by in known) if known else None

    def plain_mean(name: str) -> float:
        return float(np.mean([getattr(episode, name) for episode in episodes]))

    def root_mean_square(name: str) -> float | None:
        values = [(getattr(episode, name), episode.fall_rate) for episode in episodes]
        if any(value is None for value, _ in values):
            return None
        # A robot that had fallen before the measured part has a jitter of zero, which stands for no value.
        known = [value**2 for value, fell in values if value or not fell]
        return float(np.sqrt(np.mean(known))) if known else 0.0

    groups = [
        (episode.group_share, episode.moving_share or 0.0) for episode in episodes if episode.group_share is not None
    ]
    moved = sum(by for _, by in groups)
    first, second = (sum(share[side] * by for share, by in groups) / moved if moved else None for side in (0, 1))
    return Metrics(
        speed_ratio=mean("speed_ratio"),
        tracking_error=plain_mean("tracking_error"),
        fall_rate=plain_mean("fall_rate"),
        distance=plain_mean("distance"),
        cost_of_transport=mean("cost_of_transport", "distance"),
        joint_jitter=root_mean_square("joint_jitter") or 0.0,
        tripod_share=mean("tripod_share", "moving_share"),
        flight_share=mean("flight_share", "moving_share"),
        group_share=None if first is None or second is None else (first, second),
        moving_share=mean("moving_share"),
        mean_vx=plain_mean("mean_vx"),
        mean_vy=plain_mean("mean_vy"),
        mean_wz=plain_mean("mean_wz"),
        mean_friction=mean("mean_friction"),
        steps_climbed=mean("steps_climbed"),
        crossed=mean("crossed"),
        joint_chatter=root_mean_square("joint_chatter"),
    )


def _velocity(recording: Recording) -> np.ndarray:
    """Return the velocity with zeros after a fall, shape (T, N, 3)."""
    return recording.velocity * recording.upright[..., None]


def speed_ratio(recording: Recording, command: Command) -> float | None:
    """Return the mean speed along the command over the commanded speed; None where none is commanded."""
    if command.direction is None:
        return None
    return float((_velocity(recording) @ command.direction).mean() / command.speed)


def tracking_error(recording: Recording, command: Command) -> float:
    """Return the mean distance between velocity and command [m/s]; for a pure turn, of the yaw rate [rad/s]."""
    width = max(1, round(WINDOW / recording.period))
    velocity = _velocity(recording)
    count = max(1, len(velocity) // width)
    # Windows of nearly that width cover the whole recording.
    windows = np.stack([part.mean(axis=0) for part in np.array_split(velocity, count)])
    difference = windows - np.array(command.velocity)
    axes = slice(2, 3) if command.is_turn else slice(0, 2)
    return float(np.linalg.norm(difference[..., axes], axis=-1).mean())


def displacement(recording: Recording) -> float:
    """Return the mean distance from the first position to the last one before a fall [m]."""
    # Upright is true up to a fall and false ever after: its sum counts the steps before.
    last = np.maximum(recording.upright.sum(axis=0) - 1, 0)
    end = recording.position[last, np.arange(recording.position.shape[1])]
    return float(np.linalg.norm(end - recording.position[0], axis=-1).mean())


def cost_of_transport(recording: Recording, distance: float, weight: float) -> float | None:
    """Return energy over weight times displacement, means over episodes [-]; None under `SHORTEST_DISTANCE`."""
    if distance < SHORTEST_DISTANCE:
        return None
    energy = (recording.power * recording.upright).sum(axis=0).mean() * recording.period
    return float(energy / (weight * distance))


def rms_upright(recording: Recording, square: np.ndarray) -> float:
    """Return the root mean of squares, shape (T, N), over the steps before falls; 0 where all fell."""
    return float(np.sqrt(square[recording.upright].mean())) if recording.upright.any() else 0.0


def moving_steps(recording: Recording, command: Command) -> np.ndarray | None:
    """Return the moving steps (see `MOVING_SPEED`), bool, shape (T, N); None where no motion is commanded."""
    if command.direction is None:
        return None
    velocity = recording.velocity
    speed = np.abs(velocity[..., 2]) if command.is_turn else np.hypot(velocity[..., 0], velocity[..., 1])
    return recording.upright & (speed > MOVING_SPEED)


def gait_shares(
    recording: Recording, moving: np.ndarray | None, groups: np.ndarray | None
) -> tuple[float | None, tuple[float, float] | None]:
    """Return the shares of moving steps in flight, and on exactly group 0 and 1, as in r_trot; None without any."""
    if moving is None or not moving.any():
        return None, None
    contact = recording.contact[moving]
    flight = set_share(contact, np.zeros(contact.shape[-1], dtype=bool))
    if groups is None:
        return flight, None
    return flight, (set_share(contact, groups == 0), set_share(contact, groups == 1))


def set_share(contact: np.ndarray, feet: np.ndarray) -> float:
    """Return the share of steps, bool (num_steps, L), in which the feet on the ground are exactly `feet`, (L,)."""
    return float((contact == feet).all(axis=-1).mean())
