"""Logs of walking robots in simulation: simulated readings of encoders, motors and IMU at the physics rate.

Robot e of a level and a command is episode e of the evaluation, step for step; the noise of its observation and the
errors of the log (`LogNoiseCfg`) are independent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.core.provenance import seed_streams
from stiction.core.rotation import into_frames, tilted
from stiction.evaluation.evaluate import ENGINE, EvaluationCfg, batch_policy
from stiction.evaluation.rollout import Rollout
from stiction.files.bundle import Bundle
from stiction.files.contract import robot_of
from stiction.files.walk import WalkHeader, WalkLog, has_walk, write_walk
from stiction.joints.net import TORQUE_SOURCES
from stiction.sim.fleet import BASE_DOFS, Fleet
from stiction.virtual.drive import drive, ignore_progress

SHORTEST = 1.0
"""Shortest walk before a fall that is logged [s]."""


@dataclass(frozen=True)
class LogNoiseCfg:
    """Errors of the logged sensors: white unless stated otherwise; 0 disables one."""

    encoder_resolution: float = 2 * np.pi / 2**15
    """Resolution of the measured angle [rad]: 15 bits at the joint, as 12 bits at a motor with a gear ratio of 8."""
    joint_velocity: float = 0.02
    """Standard deviation of the motor controller's velocity [rad/s]."""
    joint_torque: float = 0.005
    """Standard deviation of the torque over the motor's limit [1], without errors of the torque constant."""
    joint_torque_zero: float = 0.005
    """Half-width of each motor's constant torque error over its limit [1]: the zero offset of the current sensor."""
    angular_velocity: float = 0.003
    """Standard deviation of the gyroscope [rad/s]: 0.01 °/s/√Hz over 200 Hz."""
    specific_force: float = 0.05
    """Standard deviation of the accelerometer [m/s²]: some 400 µg/√Hz over 200 Hz, a cheap sensor."""
    specific_force_bias: float = 0.05
    """Half-width of the accelerometer's constant error along each axis [m/s²]: 5 mg is common after calibration."""
    roll_pitch: float = 0.005
    """Half-width of the orientation filter's constant error in roll and pitch [rad]."""

    def __post_init__(self) -> None:
        """Reject negative sizes."""
        for name, value in asdict(self).items():
            if not 0 <= value < 1e3:
                raise ConfigurationError(f"log noise {name} is {value}; expected a size of at least 0")


@dataclass(frozen=True)
class RecordCfg:
    """Number, length and sensors of the logged walks."""

    robots: int = 4
    """Number of robots per level and command."""
    seconds: float = 10.0
    """Length of a log [s]; a fall ends it sooner."""
    noise: LogNoiseCfg = field(default_factory=LogNoiseCfg)
    """Errors of the sensors."""
    torque: Literal["motor_side", "output_side"] = "motor_side"
    """Logged torque: `motor_side`, the motor's; `output_side`, behind the gear, which is the motor's less the solver's
    dry friction and B q', plus the rotor's I q''."""

    def __post_init__(self) -> None:
        """Reject invalid numbers of robots, lengths and torques."""
        if self.torque not in TORQUE_SOURCES:
            raise ConfigurationError(f"torque logged on {self.torque!r}; expected {' or '.join(TORQUE_SOURCES)}")
        if not (1 <= self.robots <= 1000 and SHORTEST <= self.seconds <= 3600):
            raise ConfigurationError(
                f"logs of {self.robots} robots over {self.seconds} s; expected 1 to 1000 and {SHORTEST:g} to 3600 s"
            )


@dataclass(frozen=True)
class RecordedWalk:
    """Log of one robot's walk, and its conditions."""

    law: str
    level: float
    """Dry friction of the joints as a fraction of the torque limit, or the law's coefficient [-]."""
    command: str
    robot: int
    log: WalkLog | None
    """Log; None where the robot fell within `SHORTEST`."""

    @property
    def file_name(self) -> str:
        """Name of the log's file, without the bundle: `0.1--vx=0.5--0.npz`, `load-0.1--...` of another law."""
        law = "" if self.law == "coulomb" else f"{self.law}-"
        return f"{law}{self.level:g}--{self.command}--{self.robot}.npz"


def log_all(
    bundles: Sequence[Bundle],
    evaluation: EvaluationCfg,
    cfg: RecordCfg,
    folder: Path,
    robot: str | None = None,
    threads: int = 1,
    progress: Callable[[str, float], None] = lambda name, share: None,
    overwrite: bool = False,
) -> list[str]:
    """Walk bundles and write logs into `folder`, `<bundle>--<level>--<command>--<robot>.npz`; return their names.

    A robot that fell within `SHORTEST` has none. Raises `StictionError` for a file of another walk, unless `overwrite`.
    """
    written: list[str] = []
    for bundle in bundles:
        walks = record_walks(bundle, evaluation, cfg, robot, threads, partial(progress, f"{bundle.name}, logs"))
        logs = {f"{bundle.name}--{walk.file_name}": walk.log for walk in walks if walk.log is not None}
        for name, log in logs.items():
            if not overwrite and (folder / name).exists() and not has_walk(folder / name, log):
                raise ConfigurationError(
                    f"{folder / name} exists already, of another walk; choose another --log, or add --overwrite"
                )
        for name, log in logs.items():
            write_walk(folder / name, log)
        written += logs
    return written


def record_walks(
    bundle: Bundle,
    evaluation: EvaluationCfg,
    cfg: RecordCfg,
    robot: str | None = None,
    threads: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> list[RecordedWalk]:
    """Walk a bundle at every level and command; return the logs in that order. Raises `StictionError`."""
    contract, spec = bundle.contract, robot_of(bundle.contract, robot)
    evaluation = replace(evaluation, episodes=cfg.robots, first_episode=0)
    commands, number, level = evaluation.parsed_commands, cfg.robots, evaluation.robot_levels
    streams = seed_streams(evaluation.seed, [f"episode {index}" for index in evaluation.numbers])
    friction = evaluation.friction(contract)
    rollout = Rollout(
        contract,
        batch_policy(bundle, spec, evaluation, friction),
        spec,
        friction,
        list(streams.values()),
        threads,
        evaluation.noise,
        evaluation.action_delay,
        law=evaluation.law,
    )
    steps = round(cfg.seconds / contract.control_period)
    meter = FrictionMeter(rollout.fleet) if cfg.torque == "output_side" else None
    truths = record_motion(rollout, contract.array("kd"), evaluation.robot_commands, steps, progress, meter)
    sensors = seed_streams(evaluation.seed, [f"log {index}" for index in range(len(level))])
    walks = []
    for index, (truth, generator) in enumerate(zip(truths, sensors.values(), strict=True)):
        command = commands[index // number % len(commands)].label
        header = WalkHeader(
            robot=contract.robot,
            joint_names=contract.joint_names,
            foot_names=spec.foot_names,
            period=contract.physics_timestep,
            kp=contract.kp,
            kd=contract.kd,
            torque_limit=contract.torque_limit,
            torque_source=cfg.torque,
            recorded_in=ENGINE,
            policy=bundle.name,
            command=command,
            noise=asdict(cfg.noise),
        )
        measured = None if truth is None else measure_walk(WalkLog(header, **truth), cfg.noise, generator)
        walks.append(RecordedWalk(evaluation.friction_law, float(level[index]), command, index % number, measured))
    return walks


def record_motion(
    rollout: Rollout,
    kd: np.ndarray,
    velocity: np.ndarray,
    steps: int,
    progress: Callable[[float], None] = ignore_progress,
    meter: FrictionMeter | None = None,
) -> list[dict[str, np.ndarray] | None]:
    """Walk a batch; return each robot's true signals, fields of `WalkLog`, up to its fall; None below `SHORTEST`.

    kd: gains of the joint controllers [N m s/rad], (J,); velocity: commands, (N, 3). The torque is the motor's mean
    over the physics step; with a `meter` it is behind the gear: less dry friction as the solver applied it, and B θ'.
    """
    fleet = rollout.fleet
    recorder = _MotionRecorder(fleet, kd, velocity, steps, meter)
    for _ in drive(rollout, velocity, steps, progress):
        pass
    samples, alive = recorder.samples, recorder.alive
    stacked = {name: np.stack([sample[name] for sample in samples], axis=1) for name in samples[0]}
    shortest = round(SHORTEST / fleet.timestep)
    return [
        {"time": np.arange(end) * fleet.timestep} | {name: array[env, :end] for name, array in stacked.items()}
        if (end := alive[env]) >= shortest
        else None
        for env in range(fleet.num_envs)
    ]


class _MotionRecorder:
    """Recorder of the true signals of every physics step of a batch, and of each robot's time of fall."""

    def __init__(
        self, fleet: Fleet, kd: np.ndarray, velocity: np.ndarray, steps: int, meter: FrictionMeter | None
    ) -> None:
        """Record every physics step from now on; arguments as of `record_motion`."""
        self._kd, self._velocity, self._meter = kd, velocity, meter
        self._upright = np.ones(fleet.num_envs, bool)
        self.alive = np.full(fleet.num_envs, steps * fleet.decimation)
        """Number of physics steps walked by each robot, shape (N,)."""
        self.samples: list[dict[str, np.ndarray]] = []
        """Signals of every physics step, shapes (N, ...)."""
        # Before the joints' controllers: the targets before they change them.
        fleet.before_step.insert(0, self._begin)
        fleet.after_step.append(self._end)
        if meter is not None:
            fleet.before_step.append(meter)

    def _begin(self, fleet: Fleet) -> None:
        """Store the state at the start of a physics step."""
        self._state, self._before = _state(fleet, self._velocity), fleet.qvel.copy()

    def _end(self, fleet: Fleet, blown_up: np.ndarray) -> None:
        """Add a physics step; robots that blew up stand again, so that the signals of the rest stay finite."""
        forces = _forces(fleet, self._state["quaternion"], self._kd, fleet.qvel - self._before)
        if self._meter is not None:
            forces["joint_torque"] += self._meter.torque - fleet.damping * fleet.joint_velocity
        self.samples.append(self._state | forces)
        self._upright[blown_up] = False
        fleet.reset(blown_up)
        self._upright &= ~fleet.fallen()
        # Without the step of the fall; the minimum keeps the first fall.
        fallen = ~self._upright
        self.alive[fallen] = np.minimum(self.alive[fallen], len(self.samples) - 1)


def _state(fleet: Fleet, velocity: np.ndarray) -> dict[str, np.ndarray]:
    """Return copies of the state at the start of a physics step, shapes (N, ...)."""
    return {
        "joint_position": fleet.joint_position.copy(),
        "joint_velocity": fleet.joint_velocity.copy(),
        "joint_target": fleet.targets.copy(),
        "angular_velocity": fleet.base_angular_velocity.copy(),
        "quaternion": fleet.base_quaternion.copy(),
        "velocity_command": np.asarray(velocity, float),
    }


def _forces(fleet: Fleet, quaternion: np.ndarray, kd: np.ndarray, change: np.ndarray) -> dict[str, np.ndarray]:
    """Return torques, forces and contacts of the last physics step, shapes (N, ...); change: of velocities, (N, 6 + J).

    The simulator's own accelerations are not used: they omit the implicit part of its integrator.
    """
    # MuJoCo's implicit integrator takes -kd θ' at the end of the step, unless the motor is at its limit, and reports
    # the one at the start. The difference, kd θ'' Δt, is as large as the rotor's inertial torque.
    free = np.abs(fleet.torque) < fleet.torque_limit * (1 - 1e-9)
    acceleration = change[:, :3] / fleet.timestep
    return {
        "joint_torque": fleet.torque - free * kd * change[:, BASE_DOFS:],
        "specific_force": into_frames(quaternion, acceleration - fleet.model.opt.gravity),
        "foot_contact": fleet.foot_contact,
    }


def measure_walk(truth: WalkLog, noise: LogNoiseCfg, generator: np.random.Generator) -> WalkLog:
    """Return a true log with the errors of its sensors added."""

    def white(array: np.ndarray, size: float | np.ndarray) -> np.ndarray:
        return array + size * generator.standard_normal(array.shape)

    step = noise.encoder_resolution
    position = np.round(truth.joint_position / step) * step if step else truth.joint_position
    bias = noise.specific_force_bias * generator.uniform(-1, 1, 3)
    tilt = np.array([[1.0, *(noise.roll_pitch / 2 * generator.uniform(-1, 1, 2))]])
    limit = np.array(truth.header.torque_limit)
    zero = noise.joint_torque_zero * limit * generator.uniform(-1, 1, len(limit))
    assert truth.joint_torque is not None and truth.specific_force is not None
    return replace(
        truth,
        joint_position=position,
        joint_velocity=white(truth.joint_velocity, noise.joint_velocity),
        joint_torque=white(truth.joint_torque, noise.joint_torque * limit) + zero,
        angular_velocity=white(truth.angular_velocity, noise.angular_velocity),
        quaternion=tilted(truth.quaternion, np.repeat(tilt, len(truth), axis=0)),
        specific_force=white(truth.specific_force, noise.specific_force) + bias,
    )


class FrictionMeter:
    """Meter of the dry friction in the coming physics step, solved once more for each robot; append it last."""

    def __init__(self, fleet: Fleet) -> None:
        """Copy each robot's current model; only its dry friction may change later."""
        self._copies = [fleet.simulation.materialize(env) for env in range(fleet.num_envs)]
        self.torque = np.zeros((fleet.num_envs, fleet.spec.num_joints))
        """Torque of dry friction on each joint, against its motion [N m], shape (N, J)."""

    def __call__(self, fleet: Fleet) -> None:
        """Solve the coming step of every robot and store the forces of its friction rows."""
        state = fleet.simulation.state()
        for env, (model, data) in enumerate(self._copies):
            for name, values in state.items():
                if name == "time":
                    data.time = float(np.ravel(values[env])[0])
                else:
                    field = getattr(data, name)
                    field[...] = values[env].reshape(field.shape)
            model.dof_frictionloss[BASE_DOFS:] = fleet.friction[env]
            mujoco.mj_forward(model, data)
            rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF
            self.torque[env] = 0.0
            self.torque[env, data.efc_id[rows] - BASE_DOFS] = data.efc_force[rows]
