"""Bench: the robot is bolted to a stand, legs in the air, and its joints are moved, logged and identified.

The log is what a user would record through its `Port`: encoder angles, the next target, and the motors' mean torque in
the period after; nothing of the hidden truth. All joints of a kind move at once, one in every leg, as `stiction excite`
does: a slow triangle, where nearly all of the torque is dry friction, then a sum of sines, twice. Expected errors are
measured by `stiction study bench`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from math import pi
from pathlib import Path

import numpy as np

from stiction.core.cache import key_of, publish_entry
from stiction.core.errors import ConfigurationError, RobotError, StictionError
from stiction.core.provenance import seed_streams
from stiction.deploy.control import ControlStep, JointCommand, Port, Reading
from stiction.engines.catalog import binaries, make_engine
from stiction.files.bundle import Bundle
from stiction.files.joints import JointsFile, refused
from stiction.files.log import JointSignals, Log, LogSetup
from stiction.files.walk import WalkHeader, WalkLog
from stiction.identification.excite.pattern import Pattern
from stiction.identification.pipeline import identify_log
from stiction.identification.verdict import write_proposal
from stiction.joints.net import TorqueSource
from stiction.robots.model import Robot
from stiction.virtual.cases import Case
from stiction.virtual.robot import VirtualRobot
from stiction.virtual.trial import World

SETTLING = 1.0
"""Time at rest before each log [s]."""

MOTION = Pattern(
    share=0.4,
    slow_frequency=0.25,
    slow_amplitude=0.35,
    frequencies=(0.6, 1.7, 3.1),
    amplitudes=(1.0, 0.6, 0.35),
    phases=(0.0, 0.5 * pi, 1.1 * pi),
    fast_peak=0.35,
)
"""Motion about the standing pose. The swing is more than twice the dead band of a friction of 30 % of the torque
limit."""


@dataclass(frozen=True)
class BenchCfg:
    """Settings of a bench log."""

    kinds: tuple[str, ...] = ()
    """Kinds of joints to log, in this order; one alone after a repair, for example. Empty: all of the robot's."""
    seconds: float = 20.0
    """Length of each kind's log [s]: the motion, twice."""
    motion: Pattern = field(default_factory=lambda: MOTION)
    """Offsets from the standing pose."""
    stiffness: float = 1.0
    """Gains during the log over those of the data sheet [1]; kd scales with the root, which keeps the damping ratio."""

    def __post_init__(self) -> None:
        """Reject settings that cannot be identified from."""
        if len(set(self.kinds)) < len(self.kinds):
            raise ConfigurationError(f"bench logs of {self.kinds}: expected different kinds of joints")
        if not (4.0 <= self.seconds <= 600.0 and 0.1 <= self.stiffness <= 10.0):
            raise ConfigurationError(
                f"bench logs of {self.seconds} s at {self.stiffness} times the gains: expected 4 to 600 s, 0.1 to 10"
            )


def bench_log(port: Port, spec: Robot, cfg: BenchCfg | None = None) -> Log:
    """Move every joint of a robot on its bench and return the log. Raises `StictionError` for another robot or kind."""
    cfg = cfg or BenchCfg()
    if port.joint_names != spec.joint_names:
        raise RobotError(f"the robot has the joints {port.joint_names}, its data sheet {spec.joint_names}")
    kp = cfg.stiffness * spec.joint_values("kp")
    # Damping ratio is kd / (2 sqrt(kp I)).
    kd = cfg.stiffness**0.5 * spec.joint_values("kd")
    count = round(cfg.seconds / port.period / 2)
    offsets = np.tile(cfg.motion.offsets(count, 1.0 / port.period), 2)
    joints: dict[str, JointSignals] = {}
    for kind in cfg.kinds or spec.joint_kinds:
        moved = spec.joints_of(kind)
        path = np.tile(spec.joint_values("default_position"), (len(offsets), 1))
        path[:, moved] += offsets[:, None]
        readings = _play(port, path, kp, kd)
        for joint in moved.tolist():
            joints[spec.joint_names[joint]] = JointSignals(
                position=np.array([reading.sensors.joint_position[joint] for reading in readings[:-1]]),
                velocity=np.array([reading.sensors.joint_velocity[joint] for reading in readings[:-1]]),
                target=path[:, joint],
                # A torque is the mean over the period before its reading: that of the period after a position comes
                # with the next one.
                torque=np.array([reading.joint_torque[joint] for reading in readings[1:]]),
            )
    limit = spec.joint_values("torque_limit")
    kinds = {
        kind: LogSetup(kp=float(kp[number]), kd=float(kd[number]), torque_limit=float(limit[number]))
        for kind, number in ((kind, spec.joints_of(kind)[0]) for kind in spec.joint_kinds)
    }
    setup = LogSetup(torque_source="motor_side", test_condition="in_air", axis="rotary", joints=kinds)
    time = np.arange(len(offsets)) * port.period
    return Log("bench", time, {name: joints[name] for name in spec.joint_names if name in joints}, setup)


def _play(port: Port, path: np.ndarray, kp: np.ndarray, kd: np.ndarray) -> list[Reading]:
    """Hold the first targets until the legs hang still, then play targets (T, J) [rad]; return T + 1 readings."""
    for _ in range(round(SETTLING / port.period)):
        port.exchange(JointCommand.position(path[0], kp, kd))
    return [port.read(), *(port.exchange(JointCommand.position(target, kp, kd)) for target in path)]


JOINTS = "joints.json"

BENCH_CODE = (
    *(
        "core/*.py",
        "identification/*.py",
        "identification/excite/pattern.py",
        "joints/*.py",
        "robots/*.py",
        "robots/shipped/*.json",
        "sim/fleet.py",
    ),
    *("engines/*.py", "engines/ode/*.py", "virtual/*.py", "deploy/control.py"),
    *(f"files/{name}.py" for name in ("advice", "following", "joints", "log", "onset")),
)
"""Modules that determine a bench's results."""


@dataclass(frozen=True)
class Bench:
    """Robot on its bench."""

    engine: str
    case: Case
    spec: Robot
    cfg: BenchCfg = field(default_factory=BenchCfg)

    @property
    def label(self) -> str:
        """Name of its folder: `saturn_lite--physx--all--0.1--1000`."""
        return f"{self.spec.name}--{self.engine}--{self.case.label}"

    @property
    def key(self) -> str:
        """Key of robot, engine, log and code, see `core.cache`."""
        return key_of([self.engine, self.case, self.spec, self.cfg, binaries(self.engine)], *BENCH_CODE)

    def robot(self) -> VirtualRobot:
        """Return the robot, bolted to its stand."""
        noise = seed_streams(self.case.seed, ["bench, noise"])["bench, noise"]
        return World(partial(make_engine, self.engine)).on_bench(self.case, self.spec, noise)


def identify_on_bench(bench: Bench, folder: Path, workers: int = 1) -> None:
    """Identify a robot on its bench into `folder`, an entry of `core.cache`; records are empty where this fails."""
    log = bench_log(bench.robot().handle, bench.spec, bench.cfg)
    try:
        joints = identified(log, workers)
    except StictionError as error:
        joints = JointsFile({name: refused(f"no joint was; {error}") for name in log.joints})
    with publish_entry(folder, bench.key, bench.label) as partial:
        write_bench_results(joints, partial)


def identified(log: Log, workers: int = 1) -> JointsFile:
    """Return the records of a bench log; raise `StictionError` where no joint can be identified."""
    identified_joints, refused = identify_log(log, workers=workers)
    records = {name: result.record for name, result in identified_joints.items()} | refused
    return JointsFile({name: records[name] for name in log.joints})


def write_bench_results(joints: JointsFile, folder: Path) -> None:
    """Write the results of a bench, as `stiction identify` does. May raise `OSError`."""
    joints.write(folder / JOINTS)
    write_proposal(folder, joints)


def walk_log(
    steps: Sequence[ControlStep],
    bundle: Bundle,
    spec: Robot,
    recorded_in: str,
    command: str = "",
    torque_source: TorqueSource = "motor_side",
) -> WalkLog:
    """Return the log of a walk, without the robot's hidden truth.

    steps: of the pilot, at least one; spec: the data sheet; recorded_in: name of the engine; command: its label.
    """
    contract = bundle.contract
    each = len(steps[0].readings)
    # Positions are those before a period, torques those of the period, which the reading after it brings.
    readings = [steps[0].before, *(reading for step in steps for reading in step.readings)]
    before, after = readings[:-1], readings[1:]

    def sensed(name: str) -> np.ndarray:
        return np.stack([getattr(reading.sensors, name) for reading in before])

    header = WalkHeader(
        robot=contract.robot,
        joint_names=contract.joint_names,
        foot_names=spec.foot_names,
        period=contract.control_period / each,
        kp=contract.kp,
        kd=contract.kd,
        torque_limit=contract.torque_limit,
        torque_source=torque_source,
        recorded_in=recorded_in,
        policy=bundle.name,
        command=command,
    )
    return WalkLog(
        header,
        time=np.array([reading.time for reading in before]),
        **{name: sensed(name) for name in before[0].sensors.arrays()},
        joint_target=np.repeat([step.policy.target for step in steps], each, axis=0),
        joint_torque=np.stack([reading.joint_torque for reading in after]),
        foot_contact=np.stack([reading.foot_contact for reading in before]),
        velocity_command=np.repeat([step.velocity for step in steps], each, axis=0),
    )
