"""A bundle driving a fleet of MuJoCo robots: sensors with noise in, joint targets out. No torch.

Evaluation, golden vectors and clips are loops over `Rollout.step`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stiction.deploy.observation import Sensors
from stiction.deploy.policy import PolicyStep
from stiction.formats.contract import Contract
from stiction.formats.errors import StictionError
from stiction.formats.friction import Law, has_coefficient
from stiction.locomotion.config import NoiseCfg
from stiction.robots.catalog import find_robot
from stiction.robots.physics import EXACT, PhysicsCfg
from stiction.robots.spec import DELAY_SAMPLES, RobotSpec
from stiction.sim.fleet import Fleet
from stiction.sim.friction import joint_friction, needs_sensors
from stiction.sim.terrain import Terrain

COULOMB = Law("coulomb")
"""The law where none is named."""

INITIAL_ANGLE = 0.1
"""Half-width of the initial joint angles about the standing pose [rad], as in training: the first entry of
`locomotion.env.RESET_NOISE`, a module that needs torch. A test compares the two."""


class Driver(Protocol):
    """What turns sensors into joint targets for N robots: the deployed policy, or its twin in torch."""

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget the history and the last action of the robots in `mask`, bool, shape (N,)."""

    def step(self, sensors: Sensors, command: np.ndarray) -> PolicyStep:
        """Advance by one control period under the commands, shape (N, 3)."""


@dataclass(frozen=True)
class Moment:
    """What happened in one control period."""

    sensors: Sensors
    """What the robots measured at its start, noise included, shapes (N, ...)."""
    policy: PolicyStep
    """What the policy made of it, shapes (N, ...)."""
    blown_up: np.ndarray
    """Robots whose simulation became unstable and was put back to standing, ids."""


def robot_of(contract: Contract, robot: str | None = None) -> RobotSpec:
    """Return the robot that a contract was made for, checked against it.

    A bundle is data: its robot is looked up among the shipped ones only. A robot of one's own is named by `robot`, as
    `package.module:NAME`, since looking it up runs that module.

    Raises:
        StictionError: the robot is unknown, or its joints or torque limits are not those of the contract.

    """
    if robot is None and not contract.robot.partition("@")[0].isidentifier():
        raise StictionError(
            f"the bundle is for the robot {contract.robot!r}, which is not a shipped one; "
            "if you trust that module, name it with --robot"
        )
    spec = find_robot(robot or contract.robot)
    if spec.joint_names != contract.joint_names:
        raise StictionError(f"robot {spec.name!r} has the joints {spec.joint_names}, the bundle {contract.joint_names}")
    if not np.allclose(spec.joint_values("torque_limit"), contract.array("torque_limit")):
        raise StictionError(
            f"robot {spec.name!r} has other torque limits than the bundle; name the right one with --robot"
        )
    return spec


def friction_at(contract: Contract, level: np.ndarray, law: Law = COULOMB) -> np.ndarray:
    """Return what a law gives every joint at levels of shape (N,): torques [N m] or coefficients [-], shape (N, J)."""
    unit = np.ones(contract.num_joints) if has_coefficient(law.name) else contract.array("torque_limit")
    return np.asarray(level)[:, None] * unit


class Rollout:
    """N robots with the gains, inertias and viscous friction of the contract, driven by one policy."""

    def __init__(
        self,
        contract: Contract,
        policy: Driver,
        spec: RobotSpec,
        friction: np.ndarray,
        generators: Sequence[np.random.Generator],
        threads: int = 1,
        noise: NoiseCfg | None = None,
        action_delay: float = 0.0,
        terrain: Terrain | None = None,
        law: Law = COULOMB,
        physics: PhysicsCfg = EXACT,
        timestep: float | None = None,
    ) -> None:
        """Put the robots into their standing pose.

        Args:
            contract: what the policy expects.
            policy: what drives the robots, its batch (N,).
            spec: the robot, as from `robot_of`.
            friction: what the law gives each robot's joints, torques [N m] or coefficients, (N, J); see `friction_at`.
            generators: sources of noise; robot i uses number i modulo their count, so that robots that share one
                meet the same noise.
            threads: threads of the simulator.
            noise: sensor noise, by default as in training.
            action_delay: delay between target and motor [s], in whole physics steps as in training.
            terrain: courses of the robots, flat ground by default.
            law: law of the dry friction.
            physics: how dry friction is simulated, and
            timestep: the physics step [s], a part of the contract's control period: other ones than evaluation's only
                to see what they do to a walk.

        Raises:
            StictionError: the delay is longer than the model holds.

        """
        num = len(friction)
        timestep = contract.physics_timestep if timestep is None else timestep
        decimation = round(contract.physics_timestep * contract.decimation / timestep)
        longest = DELAY_SAMPLES * timestep
        if not 0.0 <= action_delay <= longest:
            raise StictionError(f"action delay {action_delay} s; expected 0 to {longest:g} s, what the model holds")
        sensors = needs_sensors(law)
        self.fleet = Fleet(
            spec,
            num,
            timestep,
            decimation,
            threads,
            terrain=terrain,
            joint_sensors=sensors,
            physics=physics,
        )
        self.fleet.set_gains(contract.array("kp"), contract.array("kd"))
        joint_friction(self.fleet, law).set_level(friction)
        self.fleet.damping[:] = contract.array("damping")
        self.fleet.armature[:] = contract.array("armature")
        self.fleet.delay[:] = round(action_delay / timestep) * timestep
        self.fleet.set_const(np.arange(num))
        self._policy = policy
        self._contract = contract
        self._noise = noise or NoiseCfg()
        self._generators = generators
        self._robots_per_generator = num // len(generators)
        self.reset(np.arange(num))

    def _uniform(self, width: int) -> np.ndarray:
        """Return numbers in [-1, 1), one row per robot, shape (N, width)."""
        drawn = np.stack([generator.uniform(-1.0, 1.0, width) for generator in self._generators])
        return np.tile(drawn, (self._robots_per_generator, 1))

    def reset(self, ids: np.ndarray) -> None:
        """Stand the robots `ids` on the ground, joints slightly off the standing pose, the policy's history empty."""
        standing = self._contract.array("standing")
        position = standing + INITIAL_ANGLE * self._uniform(len(standing))
        position = np.clip(position, self._contract.array("lower"), self._contract.array("upper"))
        self.fleet.reset(ids, joint_position=position[ids])
        self._policy.reset(np.isin(np.arange(self.fleet.num_envs), ids))

    def sense(self) -> Sensors:
        """Return what the robots measure now; roll and pitch are disturbed by a small rotation of the base."""
        fleet = self.fleet
        true = Sensors(fleet.base_quaternion, fleet.base_angular_velocity, fleet.joint_position, fleet.joint_velocity)
        return disturbed(true, self._noise, self._uniform(drawn_width(self._contract.num_joints)))

    def act(self, command: np.ndarray) -> tuple[Sensors, PolicyStep]:
        """Sense, and set the policy's joint targets under the commanded velocities, shape (N, 3); no time passes."""
        sensors = self.sense()
        step = self._policy.step(sensors, command)
        self.fleet.set_targets(step.target)
        return sensors, step

    def step(self, command: np.ndarray) -> Moment:
        """Advance by one control period under the commanded velocities, shape (N, 3)."""
        sensors, step = self.act(command)
        blown_up = self.fleet.step()
        self._policy.reset(np.isin(np.arange(self.fleet.num_envs), blown_up))
        return Moment(sensors, step, blown_up)


def drawn_width(joints: int) -> int:
    """Return how many random numbers the noise of one robot's sensors takes."""
    return 5 + 2 * joints


def disturbed(true: Sensors, noise: NoiseCfg, drawn: np.ndarray) -> Sensors:
    """Return what N robots measure; drawn: numbers in [-1, 1), shape (N, `drawn_width`)."""
    joints = true.joint_position.shape[-1]
    tilt = np.hstack([np.ones((len(drawn), 1)), noise.roll_pitch / 2 * drawn[:, 3:5]])
    return Sensors(
        quaternion=tilted(true.quaternion, tilt),
        angular_velocity=true.angular_velocity + noise.angular_velocity * drawn[:, :3],
        joint_position=true.joint_position + noise.joint_position * drawn[:, 5 : 5 + joints],
        joint_velocity=true.joint_velocity + noise.joint_velocity * drawn[:, 5 + joints :],
    )


def tilted(quaternion: np.ndarray, tilt: np.ndarray) -> np.ndarray:
    """Return quaternions, shape (N, 4), times the small rotations 1 + a i + b j, shape (N, 3): rolls 2a, pitches 2b."""
    w, x, y, z = quaternion.T
    one, a, b = tilt.T
    turned = np.stack(
        [w * one - x * a - y * b, w * a + x * one - z * b, w * b + y * one + z * a, z * one + x * b - y * a], -1
    )
    return turned / np.linalg.norm(turned, axis=-1, keepdims=True)
