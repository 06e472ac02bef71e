"""Driver of walks: `drive` advances any walker from control period to control period; noise of its sensors.

A walker is a batch (`evaluation.rollout.Rollout`) or one virtual robot (`virtual.trial.VirtualWalk`). Recordings, logs,
golden vectors and clips are loops over `drive`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import DTypeLike

from stiction.core.rotation import tilted
from stiction.deploy.control import JointCommand, Port, Reading
from stiction.deploy.observation import Sensors
from stiction.files.walk import Recording
from stiction.task.config import NoiseCfg

Step = TypeVar("Step", covariant=True)

Commands = np.ndarray | Callable[[int], np.ndarray]
"""Commanded velocities: forward, sideways [m/s], turn [rad/s], shape (*batch, 3), constant or by number of the
control step."""


@dataclass(frozen=True)
class Truth:
    """Ground truth of N robots at the end of a control period. Arrays are live: the next step changes them."""

    velocity: np.ndarray
    """Forward and sideways velocity of the base [m/s] and its yaw rate [rad/s], base frame, shape (N, 3)."""
    position: np.ndarray
    """Horizontal position of the base in the world [m], shape (N, 2)."""
    contact: np.ndarray
    """Feet on the ground, bool, shape (N, L)."""
    torque: np.ndarray
    """Torque of the motors in the last physics step [N m], shape (N, J)."""
    joint_velocity: np.ndarray
    """[rad/s], shape (N, J)."""
    friction: np.ndarray
    """Bounds of the joints' dry friction [N m], shape (N, J)."""
    fallen: np.ndarray
    """True for robots that have fallen, or blew up in this period, bool, shape (N,)."""
    chatter: np.ndarray | None = None
    """Integral since the start of the joints' squared acceleration, by physics step, mean over joints [rad²/s³], shape
    (N,); None of a batch, which takes its physics steps unseen."""


class Walker(Protocol[Step]):
    """One robot or a batch with a policy."""

    def step(self, command: np.ndarray, /) -> Step:
        """Advance by one control period under commanded velocities, shape (*batch, 3)."""


class Observed(Walker[Step], Protocol[Step]):
    """Walker with known ground truth."""

    def truth(self) -> Truth:
        """Return the ground truth at the end of the last control period."""


def ignore_progress(share: float) -> None:
    """Ignore the progress of a walk."""


def drive(
    walker: Walker[Step], commands: Commands, steps: int, progress: Callable[[float], None] = ignore_progress
) -> Iterator[Step]:
    """Advance a walker by `steps` control periods and yield each step when it is done; a caller may stop sooner.

    progress: called with the finished share [-]. Raises any error of the walker's step, such as `BlownUp`.
    """
    for number in range(steps):
        yield walker.step(commands(number) if callable(commands) else commands)
        progress((number + 1) / steps)


class Recorder:
    """Recorder of the ground truth of a walk: call `record` at the end of every control period."""

    def __init__(self, walker: Observed[object], period: float, steps: int, dtype: DTypeLike = np.float32) -> None:
        """Start with the robots in place. period: of control [s]; steps: maximum number; dtype: of the arrays."""
        truth = walker.truth()
        num, feet = truth.contact.shape

        def zeros(*shape: int, dtype: DTypeLike = dtype) -> np.ndarray:
            return np.zeros((steps, num, *shape), dtype)

        self._walker, self._count = walker, 0
        self._friction = zeros()
        self._recording = Recording(
            period,
            velocity=zeros(3),
            position=zeros(2),
            contact=zeros(feet, dtype=bool),
            power=zeros(),
            square_acceleration=zeros(),
            upright=zeros(dtype=bool),
            friction=self._friction,
            square_chatter=None if truth.chatter is None else zeros(),
        )
        self._last_velocity = truth.joint_velocity.copy()
        self._chatter = 0.0 if truth.chatter is None else truth.chatter
        self.upright = np.ones(num, dtype=bool)
        """True for robots that have not fallen yet, bool, shape (N,)."""

    def record(self) -> None:
        """Record the end of a control period."""
        truth, recording, t = self._walker.truth(), self._recording, self._count
        # A robot that was put back after it blew up stands again, and would pass for one that never fell.
        self.upright = self.upright & ~truth.fallen
        recording.velocity[t] = truth.velocity
        recording.position[t] = truth.position
        recording.contact[t] = truth.contact
        recording.power[t] = np.abs(truth.torque * truth.joint_velocity).sum(axis=1)
        change = (truth.joint_velocity - self._last_velocity) / recording.period
        recording.square_acceleration[t] = np.square(change).mean(axis=1)
        recording.upright[t] = self.upright
        self._friction[t] = truth.friction.mean(axis=1)
        if recording.square_chatter is not None and truth.chatter is not None:
            recording.square_chatter[t] = (truth.chatter - self._chatter) / recording.period
            self._chatter = truth.chatter
        self._last_velocity = truth.joint_velocity.copy()
        self._count += 1

    def record_fall(self) -> None:
        """Record robots whose simulation failed as fallen at their last place."""
        if not self._count:
            self.record()
        else:
            for values in self._recording.signals.values():
                values[self._count] = values[self._count - 1]
            self._count += 1
        self.upright[:] = self._recording.upright[self._count - 1] = False

    def recording(self) -> Recording:
        """Return the recording so far, shapes (T, N, ...)."""
        return self._recording.of(slice(None), 0, self._count)


def record(walker: Observed[object], commands: Commands, period: float, steps: int) -> Recording:
    """Drive a batch and record it, fallen robots included; arguments as of `drive` and `Recorder`."""
    recorder = Recorder(walker, period, steps)
    for _ in drive(walker, commands, steps):
        recorder.record()
    return recorder.recording()


def disturbed(true: Sensors, noise: NoiseCfg, drawn: np.ndarray) -> Sensors:
    """Return noisy measurements of N robots, without noise on velocity and heights; drawn: in [-1, 1), (N,
    `drawn_width`).
    """
    joints = true.joint_position.shape[-1]
    # A quaternion of a small turn: (1, half of the angles).
    tilt = np.hstack([np.ones((len(drawn), 1)), noise.roll_pitch / 2 * drawn[:, 3:5]])
    return replace(
        true,
        quaternion=tilted(true.quaternion, tilt),
        angular_velocity=true.angular_velocity + noise.angular_velocity * drawn[:, :3],
        joint_position=true.joint_position + noise.joint_position * drawn[:, 5 : 5 + joints],
        joint_velocity=true.joint_velocity + noise.joint_velocity * drawn[:, 5 + joints :],
    )


def drawn_width(joints: int) -> int:
    """Return the number of random numbers for the noise of one robot's sensors."""
    return 5 + 2 * joints


INITIAL_ANGLE = 0.1
"""Half-width of the initial joint angles about the standing pose [rad], as in training: the first entry of
`task.events.RESET_NOISE`, a module that needs torch. A test compares the two."""


class Noisy:
    """`Port` that adds the training's noise to another one; each `read` draws new noise."""

    def __init__(self, port: Port, noise: NoiseCfg, generator: np.random.Generator) -> None:
        """Add noise to the readings of `port`."""
        self._port, self._noise, self._generator = port, noise, generator
        self.joint_names, self.period = port.joint_names, port.period

    def read(self) -> Reading:
        """Return the last reading, with noise."""
        reading = self._port.read()
        drawn = self._generator.uniform(-1.0, 1.0, (1, drawn_width(len(self.joint_names))))
        noisy = disturbed(reading.sensors.each(lambda value: value[None]), self._noise, drawn)
        return replace(reading, sensors=noisy.each(lambda value: value[0]))

    def exchange(self, command: JointCommand) -> Reading:
        """Send a command; the reading has no noise: it is for joint controllers, not policies."""
        return self._port.exchange(command)
