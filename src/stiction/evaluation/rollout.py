"""Policy bundle on a fleet of MuJoCo robots, a walker of `virtual.drive`: noisy sensors in, joint targets out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.deploy.control import ControlLoop, Driver
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import PolicyStep
from stiction.files.contract import Contract
from stiction.joints.compensation import FrictionController
from stiction.joints.friction import Law, has_coefficient
from stiction.robots.model import DELAY_SAMPLES, Robot
from stiction.robots.physics import EXACT, PhysicsCfg
from stiction.robots.terrain import Terrain
from stiction.sim.fleet import Fleet, JointFriction
from stiction.task.config import NoiseCfg
from stiction.virtual.drive import INITIAL_ANGLE, Truth, disturbed, drawn_width

COULOMB = Law("coulomb")


@dataclass(frozen=True)
class RolloutStep:
    """Record of one control step."""

    sensors: Sensors
    """Sensor readings at its start, noise included, shapes (N, ...)."""
    policy: PolicyStep
    blown_up: np.ndarray
    """Ids of robots whose simulation became unstable and was reset to standing."""


def friction_at(contract: Contract, level: np.ndarray, law: Law = COULOMB) -> np.ndarray:
    """Return the friction of every joint by a law at levels (N,): torques [N m] or coefficients [-], shape (N, J)."""
    unit = np.ones(contract.num_joints) if has_coefficient(law.name) else contract.array("torque_limit")
    return np.asarray(level)[:, None] * unit


class Rollout:
    """N robots with the gains, inertias and viscous friction of the contract, driven by one policy."""

    def __init__(
        self,
        contract: Contract,
        policy: Driver,
        spec: Robot,
        friction: np.ndarray,
        generators: Sequence[np.random.Generator],
        threads: int = 1,
        noise: NoiseCfg | None = None,
        action_delay: float = 0.0,
        terrain: Terrain | None = None,
        law: Law = COULOMB,
        physics: PhysicsCfg = EXACT,
        timestep: float | None = None,
        compensation: FrictionController | None = None,
    ) -> None:
        """Put the robots into their standing pose.

        policy: with batch (N,); friction: as from `friction_at`, (N, J); generators: of noise, robot i uses number i
        modulo their count; noise: by default as in training; action_delay: between target and motor [s], in whole
        physics steps; terrain: flat by default; timestep: of the physics [s], by default the contract's; compensation:
        torque added by the joint controllers at every physics step. Raises `StictionError` where the delay is longer
        than the model's buffer, or combined with a compensation.
        """
        num = len(friction)
        timestep = contract.physics_timestep if timestep is None else timestep
        decimation = round(contract.physics_timestep * contract.decimation / timestep)
        longest = DELAY_SAMPLES * timestep
        if not 0.0 <= action_delay <= longest:
            raise ConfigurationError(
                f"action delay {action_delay} s; expected 0 to {longest:g} s, what the model holds"
            )
        if compensation is not None and action_delay:
            raise ConfigurationError(
                f"friction fed forward with an action delay of {action_delay} s: joint controllers feed it without; "
                "give one of the two, or a virtual robot, which has both"
            )
        loaded = law.spec.loaded
        self.fleet = Fleet(
            spec, num, timestep, decimation, threads, terrain=terrain, joint_sensors=loaded, physics=physics
        )
        self.fleet.set_gains(contract.array("kp"), contract.array("kd"))
        JointFriction(self.fleet, law).set_level(friction)
        self.fleet.damping[:] = contract.array("damping")
        self.fleet.armature[:] = contract.array("armature")
        self.fleet.delay[:] = round(action_delay / timestep) * timestep
        self.fleet.set_const(np.arange(num))
        self._contract, self._noise = contract, noise or NoiseCfg()
        self.loop = ControlLoop(policy, contract, compensation)
        if not self.loop.holds:
            self.fleet.before_step.append(self._command)
        self._generators, self._robots_per_generator = generators, num // len(generators)
        self._blown_up = np.zeros(0, dtype=np.int64)
        self.reset(np.arange(num))

    def _command(self, fleet: Fleet) -> None:
        """Set the command of a physics step: kp (a + τ_ff/kp − θ) is the controllers' torque plus τ_ff."""
        command = self.loop.command(fleet.joint_position, fleet.joint_velocity)
        fleet.set_targets(command.target + command.forward / command.kp)

    def _uniform(self, width: int) -> np.ndarray:
        """Return uniform random numbers in [-1, 1), one row per robot, shape (N, width)."""
        drawn = np.stack([generator.uniform(-1.0, 1.0, width) for generator in self._generators])
        return np.tile(drawn, (self._robots_per_generator, 1))

    def reset(self, ids: np.ndarray) -> None:
        """Stand the robots `ids` on the ground, joints slightly off the standing pose, the policy's history empty."""
        standing = self._contract.array("standing")
        position = standing + INITIAL_ANGLE * self._uniform(len(standing))
        position = np.clip(position, self._contract.array("lower"), self._contract.array("upper"))
        self.fleet.reset(ids, joint_position=position[ids])
        self.loop.reset(np.isin(np.arange(self.fleet.num_envs), ids))

    def sense(self) -> Sensors:
        """Return the sensor readings of the robots; roll and pitch are disturbed by a small rotation of the base."""
        fleet, layout = self.fleet, self._contract.observation
        true = Sensors(fleet.base_quaternion, fleet.base_angular_velocity, fleet.joint_position, fleet.joint_velocity)
        if layout.has("base_linear_velocity"):
            true = replace(true, base_linear_velocity=fleet.base_linear_velocity)
        if (scan := layout.heights) is not None:
            ground = fleet.ground_around(np.array(scan.points))
            true = replace(true, heights=fleet.base_position[:, 2:3] - ground)
        return disturbed(true, self._noise, self._uniform(drawn_width(self._contract.num_joints)))

    def step(self, command: np.ndarray) -> RolloutStep:
        """Advance by one control period under the commanded velocities, shape (N, 3)."""
        sensors = self.sense()
        step = self.loop.act(sensors, command)
        self.fleet.set_targets(step.target)
        blown_up = self.fleet.step()
        # The fleet reset them to standing itself: a start drawn here would shift the noise of robots that share
        # a stream.
        self.loop.reset(np.isin(np.arange(self.fleet.num_envs), blown_up))
        self._blown_up = blown_up
        return RolloutStep(sensors, step, blown_up)

    def truth(self) -> Truth:
        """Return the ground truth at the end of the last control period."""
        fleet, fallen = self.fleet, self.fleet.fallen()
        # The unstable robots were reset and stand again.
        fallen[self._blown_up] = True
        return Truth(
            velocity=np.hstack((fleet.base_linear_velocity[:, :2], fleet.base_angular_velocity[:, 2:])),
            position=fleet.base_position[:, :2],
            contact=fleet.foot_contact,
            torque=fleet.torque,
            joint_velocity=fleet.joint_velocity,
            friction=fleet.friction,
            fallen=fallen,
        )
