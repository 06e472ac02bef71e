"""Swaps between B and kd on a whole robot in the simulator of the training, hanging in the air and walking.

There joint damping and controller are two parts of the model, integrated implicitly: an independent check.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.core.provenance import seed_streams
from stiction.deploy.policy import load_policy
from stiction.evaluation.course import SETTLE
from stiction.evaluation.rollout import Rollout, friction_at
from stiction.files.bundle import Bundle
from stiction.files.contract import robot_of
from stiction.files.results import DIRECTIONS
from stiction.files.velocity import parse_command
from stiction.robots.catalog import find_robot
from stiction.sim.fleet import BASE_DOFS, Fleet
from stiction.virtual.drive import drive
from stiction_experiments.damping.joint import DampingCfg, RobotRow

MOVED = 0.5
"""Share of kd that is moved to B."""

TWIN = 1e-9
"""Offset of the twin's joints at the start [rad]: it shows how far contacts amplify rounding."""

AT_LIMIT = 0.999
"""Share of the torque limit from which a motor counts as saturated."""

LIFTED = 100.0
"""Factor of the torque limits where they are lifted."""

FIRST = 1.0
"""How long motions are compared [s]."""

LONGEST = 60.0
"""Longest walk: every angle is kept [s]."""


@dataclass(frozen=True)
class WalkCfg:
    """How the walking robots are driven."""

    friction_levels: tuple[float, ...] = (0.0, 0.2)
    """Dry friction over torque limit [-]."""
    commands: tuple[str, ...] = DIRECTIONS
    """Commanded velocities."""
    episodes: int = 8
    """Robots per level, command and torque limits, each without a swap, with one, and as a twin."""
    seconds: float = 10.0
    """Length of a walk [s]; its first 2 s do not count for speed and saturation."""
    seed: int = 0
    """Seed of initial states and sensor noise; robot, swapped robot and twin share theirs."""

    def __post_init__(self) -> None:
        """Refuse walks of which nothing would be measured."""
        if self.episodes < 1 or not SETTLE < self.seconds <= LONGEST:
            raise ConfigurationError(
                f"{self.episodes} walks of {self.seconds} s: expected at least one, over {SETTLE:g} s and at most "
                f"{LONGEST:g} s long"
            )


def air_row(robot: str, level: float, cfg: DampingCfg) -> RobotRow:
    """Swing all joints of three floating robots whose trunk is held: plain, swapped, and a twin of the first."""
    spec = find_robot(robot)
    fleet = Fleet(spec, 3)
    fleet.set_gravity((0.0, 0.0, 0.0))
    fleet.clamp(np.zeros((3, spec.num_joints), bool), base=range(BASE_DOFS))
    fleet.friction[:] = level * fleet.torque_limit
    fleet.set_gains(fleet.nominal_kp, (1.0 - MOVED) * fleet.nominal_kd, np.array([1]))
    fleet.damping[1] += MOVED * fleet.nominal_kd
    fleet.base_position[:, 2] += 1.0
    fleet.joint_position[2] += TWIN
    recorder = _Recorder(fleet, 1.0)
    for angle in cfg.target(fleet.control_period):
        fleet.set_targets(fleet.standing + np.full((3, 1), angle))
        fleet.step()
        recorder.record()
    return recorder.finish(0.0).row(("in the air", level, robot, "own"), slice(0, 1), 1)


def walk_rows(
    bundle: Bundle,
    cfg: WalkCfg,
    lift: bool,
    threads: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> Iterator[RobotRow]:
    """Yield a row for every friction level and command of a policy, driven on plain, swapped and twin robots.

    lift: with torque limits that are never reached. Raises `StictionError` where the bundle does not fit the robot.
    """
    contract = bundle.contract
    commands = [parse_command(text) for text in cfg.commands]
    cells = [(level, command) for level in cfg.friction_levels for command in commands]
    plain = len(cells) * cfg.episodes
    level = np.tile(np.repeat([level for level, _ in cells], cfg.episodes), 3)
    velocity = np.tile(np.repeat([command.velocity for _, command in cells], cfg.episodes, axis=0), (3, 1))
    streams = seed_streams(cfg.seed, [f"episode {number}" for number in range(cfg.episodes)])
    policy = load_policy(contract, bundle.policy, (3 * plain,))
    rollout = Rollout(
        contract, policy, robot_of(contract), friction_at(contract, level), list(streams.values()), threads
    )
    fleet = rollout.fleet
    derivative = contract.array("kd")
    fleet.set_gains(contract.array("kp"), (1.0 - MOVED) * derivative, np.arange(plain, 2 * plain))
    fleet.damping[plain : 2 * plain] += MOVED * derivative
    fleet.joint_position[2 * plain :] += TWIN
    factor = LIFTED if lift else 1.0
    fleet.simulation.expand("actuator_forcerange")[:] *= factor
    recorder, steps = _Recorder(fleet, factor), round(cfg.seconds / contract.control_period)
    for _ in drive(rollout, velocity, steps, progress):
        recorder.record()
    record = recorder.finish(SETTLE)
    for index, (friction, command) in enumerate(cells):
        robots = slice(index * cfg.episodes, (index + 1) * cfg.episodes)
        named = bundle.name, friction, command.label, "lifted" if lift else "own"
        yield record.row(named, robots, plain, command.direction)


@dataclass(frozen=True)
class _Record:
    """Motion of the robots; plain ones first, then as many swapped ones, then their twins."""

    angle: np.ndarray
    """Joint angles in the first second [rad], shape (T, N, J)."""
    limited: np.ndarray
    """True if any motor of a robot reached its limit in the first second, shape (N,)."""
    velocity: np.ndarray
    """vx, vy, yaw rate of the base once settled, base frame, shape (T, N, 3)."""
    saturated: np.ndarray
    """Share of joints and physics steps at the limit once settled, by control step, shape (T, N)."""

    def row(
        self, named: tuple[str, float, str, str], robots: slice, plain: int, direction: np.ndarray | None = None
    ) -> RobotRow:
        """Return the row of some plain robots; the swapped ones and the twins stand `plain` and 2 `plain` further on.

        named: the first four fields of the row; direction: unit vector of the commanded velocity, shape (3,), None in
        the air.
        """
        own, swapped, twin = (slice(robots.start + n * plain, robots.stop + n * plain) for n in range(3))
        gap = np.abs(self.angle[:, swapped] - self.angle[:, own]).max(axis=(0, 2))
        limited = self.limited[own] | self.limited[swapped]
        speeds = [
            None if direction is None else float((self.velocity[:, part] @ direction).mean()) for part in (own, swapped)
        ]
        return RobotRow(
            *named,
            saturated_share=float(self.saturated[:, own].mean()),
            speed=speeds[0],
            speed_swapped=speeds[1],
            free_robots=int((~limited).sum()),
            free_difference=None if limited.all() else float(gap[~limited].max()),
            limited_robots=int(limited.sum()),
            limited_difference=float(gap[limited].max()) if limited.any() else None,
            twin_difference=float(np.abs(self.angle[:, twin] - self.angle[:, own]).max()),
        )


class _Recorder:
    """Records the motion of a fleet, and which motors are at their limit at every physics step."""

    def __init__(self, fleet: Fleet, lift: float) -> None:
        """Start with nothing recorded; lift: factor of the torque limits.

        The fleet's `torque` is that of the step before, so it is looked at before each step.
        """
        self.fleet, self.share = fleet, np.zeros(fleet.num_envs)
        self.limit = AT_LIMIT * lift * fleet.torque_limit
        self.angles: list[np.ndarray] = []
        self.velocities: list[np.ndarray] = []
        self.saturated: list[np.ndarray] = []
        fleet.before_step.append(self._count)

    def _count(self, fleet: Fleet) -> None:
        self.share += (np.abs(fleet.torque) >= self.limit).mean(axis=1) / fleet.decimation

    def record(self) -> None:
        """Record the end of a control period."""
        self.angles.append(self.fleet.joint_position.copy())
        yaw_rate = self.fleet.base_angular_velocity[:, 2:]
        self.velocities.append(np.hstack([self.fleet.base_linear_velocity[:, :2], yaw_rate]))
        self.saturated.append(self.share)
        self.share = np.zeros(self.fleet.num_envs)

    def finish(self, settle: float) -> _Record:
        """Return the record; settle: what does not count for speed and saturation [s]."""
        early, settled = (round(time / self.fleet.control_period) for time in (FIRST, settle))
        saturated = np.array(self.saturated)
        # One step more of the motors: the torque that is looked at is that of the step before.
        angles, limited = np.array(self.angles[:early]), np.any(saturated[: early + 1] > 0.0, axis=0)
        return _Record(angles, np.asarray(limited), np.array(self.velocities[settled:]), saturated[settled:])
