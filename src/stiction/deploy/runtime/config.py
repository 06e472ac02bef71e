"""Settings of a run. They load neither a network nor a simulator: `--help` must be quick."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from stiction.core.errors import ConfigurationError
from stiction.core.flags import FLAG
from stiction.files.contract_rules import TARGET_LIMITS

if TYPE_CHECKING:
    from stiction.files.contract import Contract


@dataclass(frozen=True)
class LimitsCfg:
    """Speed and range limits of targets."""

    slew: Annotated[float | None, FLAG] = None
    """Largest speed of a joint's target [rad/s]; by default the bundle's, of older bundles 40, more than the shipped
    policies ask for (results/deploy)."""
    margin: Annotated[float | None, FLAG] = None
    """Distance that targets keep from the joint's limits [rad]; by default the bundle's, of older bundles 0.02."""

    def __post_init__(self) -> None:
        slew, margin = self.resolved(None)
        if not (0 < slew <= 1000 and 0 <= margin <= 1):
            raise ConfigurationError(
                f"slew and margin: got {slew} rad/s and {margin} rad, expected up to 1000 rad/s and 0 to 1 rad"
            )

    def resolved(self, contract: Contract | None) -> tuple[float, float]:
        """Return slew [rad/s] and margin [rad] for a bundle: these, else its own, else those of new bundles."""
        usual = (None if contract is None else contract.target_limits) or TARGET_LIMITS
        return (
            usual["slew"] if self.slew is None else self.slew,
            usual["margin"] if self.margin is None else self.margin,
        )


@dataclass(frozen=True)
class SafetyCfg:
    """Limits of the robot's motion and condition, beyond which it is stopped."""

    tilt: float = 1.0
    """Largest angle between the base's z axis and the vertical [rad]. Training counts 1.05 rad as a fall; how far
    robots lean that are pushed and do not fall is in results/deploy."""
    predicted_tilt: float = 1.05
    """Largest tilt after safety.horizon if the base goes on turning as it does [rad]."""
    horizon: float = 0.1
    """Time over which a tilt is predicted [s]: gravity in the base's frame turns by −ω × g."""
    joint_speed: float = 25.0
    """Largest speed of a joint [rad/s]; what the shipped policies reach is in results/deploy."""
    torque: float = 1.3
    """Largest measured torque over the motor's limit [1], as a mean over some time: beyond, drive and data sheet
    disagree."""
    torque_seconds: float = 0.1
    """Time of that mean [s]."""
    torque_error: float = 0.2
    """Largest difference between a motor's measured torque and what its gains ask for at the measured angle and speed,
    over its limit [1], as a mean over some time: beyond, an angle, or the torque, is another joint's. Not judged where
    a robot does not report torques."""
    torque_error_seconds: float = 0.15
    """The time of that mean [s]."""
    apart: float = 0.1
    """Largest distance between a joint's angle and what its velocity adds up to within 0.1 s [rad]."""
    temperature: float = 80.0
    """Highest temperature of a motor [°C]; not judged where a robot does not report temperatures."""
    flailing: float = 8.0
    """Largest root mean square of all joints' speeds over some time [rad/s]; that of walks is in
    results/deploy."""
    flailing_seconds: float = 0.3
    """Time of that mean [s]."""
    lost: float = 10.0
    """Most messages of a motor that the robot's own bus may lose within 0.1 s, of some 50; not judged where a robot
    does not count them."""
    losses: float = 0.3
    """Largest share of the robot's states, within a second, that may be lost, come twice, or behind a newer one [1]:
    with as many commands lost, one of the first four damping frames gets through in 99 of 100 cases."""
    motor_fault: bool = True
    """True if a fault that a motor reports stops the robot."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not isinstance(value, bool) and not 0 < value < 1e4:
                raise ConfigurationError(f"--set safety.{name}: got {value}, expected a positive number")


@dataclass(frozen=True)
class SupervisorCfg:
    """Times of the stages of a run, and conditions that end it."""

    armed: bool = False
    """True if commands are sent to the robot."""
    duration: float | None = None
    """Longest time of the run after standing up [s]; None: until it is stopped, or a motion is over."""
    ramp: float = 2.0
    """Time from the measured pose to the standing pose [s], at least 2."""
    hold: float = 0.5
    """Time in the standing pose before the run [s]."""
    settle: float = 1.0
    """Shortest time of damping after a run, however it ended [s]; it goes on while the robot moves."""
    settle_limit: float = 5.0
    """Longest time of damping after a run [s]."""
    first_target: float = 0.1
    """Largest distance of the first target from the measured pose [rad]."""
    standing_error: float = 0.5
    """Largest distance of a joint from the standing pose when the run begins [rad]."""
    stale: float = 0.03
    """Maximum age of a robot state [s]: at 500 Hz fifteen were missed."""
    gap: float = 0.06
    """Longest time between two turns of the supervisor's own loop [s]: three control periods of 20 ms."""
    readers: int = 1
    """Number of programs that may read the commands, the robot's own included."""
    frozen: float = 0.03
    """Time after which an IMU with bit-identical readings counts as frozen [s]; the same as for a stale state."""
    silence: float = 0.06
    """Longest time after the policy's last answer [s]: three control periods of 20 ms."""
    command_timeout: float = 0.5
    """Age of the last remote velocity command above which the robot stands [s]."""
    command_stop: float = 3.0
    """Age of the last remote velocity command above which the robot is stopped [s]."""
    ready_timeout: float = 30.0
    """Longest time until policy and robot are ready [s]."""
    limits: LimitsCfg = field(default_factory=LimitsCfg)
    """Command limits."""
    safety: SafetyCfg = field(default_factory=SafetyCfg)
    """Safety limits."""

    def __post_init__(self) -> None:
        if not 2.0 <= self.ramp <= 60.0:
            raise ConfigurationError(f"ramp: got {self.ramp} s to stand up, expected 2 to 60 s")
        if self.duration is not None and not 0 < self.duration <= 86400:
            raise ConfigurationError(f"--duration: got {self.duration} s, expected up to 86,400 s, one day")
        times = ("hold", "settle", "settle_limit", "stale", "gap", "frozen", "silence", "command_timeout")
        for name in (*times, "first_target", "standing_error"):
            if not 0 < getattr(self, name) <= 10:
                raise ConfigurationError(f"{name}: got {getattr(self, name)}, expected a positive number of at most 10")
        if self.settle_limit < self.settle:
            raise ConfigurationError(
                f"settle_limit: got {self.settle_limit} s, expected {self.settle} s (settle) or more"
            )
        if not 1 <= self.readers <= 1000:
            raise ConfigurationError(f"--readers: got {self.readers}, expected 1 to 1000; count the robot's own")
        if not self.command_timeout < self.command_stop <= 600:
            raise ConfigurationError(
                f"command_stop: got {self.command_stop} s, expected more than command_timeout, {self.command_timeout} s"
            )


@dataclass(frozen=True)
class OperatorCfg:
    """Remote and local ways to stop or steer a run."""

    stop_file: Annotated[Path | None, FLAG] = None
    """File whose appearance stops the run."""
    heartbeat: Annotated[str | None, FLAG] = None
    """HOST:PORT of this machine for a second machine's `alive` by UDP; the run stops when that ends. It
    listens at that address alone."""
    heartbeat_timeout: Annotated[float, FLAG] = 0.5
    """Time without `alive` after which the run stops [s]."""
    command_from: Annotated[str | None, FLAG] = None
    """HOST:PORT of this machine for velocity commands by UDP, JSON such as {"vx": 0.5}, some ten times a
    second. Without them the robot stands, then stops."""

    def __post_init__(self) -> None:
        if not 0.05 <= self.heartbeat_timeout <= 60:
            raise ConfigurationError(f"--heartbeat-timeout: got {self.heartbeat_timeout} s, expected 0.05 to 60 s")


@dataclass(frozen=True)
class RunCfg:
    """Settings of a run, besides its robot and its policy."""

    out: Path
    """Folder of the run: `log/`, `report.json`."""
    supervisor: SupervisorCfg = field(default_factory=SupervisorCfg)
    """Times of the stages of the run, and conditions that end it."""
    operator: OperatorCfg = field(default_factory=OperatorCfg)
    """Remote stop and velocity inputs."""
    keep_minutes: float = 120.0
    """Minutes of the log to keep, the newest; 0: no log."""
    realtime: int | None = None
    """Priority of supervisor and policy under SCHED_FIFO, 1 to 99; None: as all processes."""

    def __post_init__(self) -> None:
        if not 0 <= self.keep_minutes <= 24 * 60:
            raise ConfigurationError(f"--keep-minutes: got {self.keep_minutes}, expected 0 to 1440, one day")
        if self.realtime is not None and not 1 <= self.realtime <= 99:
            raise ConfigurationError(f"--realtime: got {self.realtime}, expected 1 to 99")
