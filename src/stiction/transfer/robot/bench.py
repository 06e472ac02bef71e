"""The bench: the robot is bolted to a stand, legs in the air, and its joints are moved and logged, kind by kind.

The log is what a person with this robot would make, through its `Port` and from its data sheet: the angles that the
encoders say, the target that is then sent, and the motors' torque, mean over the period that follows, as in walking
logs. `stiction identify` makes joints.json of it. Nothing of the truth is in it.

All joints of a kind move at once, one in every leg: on a stand no leg feels another. The motion is that of
`stiction excite`: a slow triangle, where nearly all of the torque is dry friction, then a sum of sines, twice.

How right it is. Three joints of the robot with seed 0 in MuJoCo, friction at the bench's values (0.44 and 0.25 N m),
one group real at a time, dry friction found over dry friction that was there:

    none      +0.2 to +0.8 %   torque held for 1 ms and logged over 2 is half a millisecond early: B −4 to −10 %
    friction  +1.5 to +2.7 %   in the standard values, which have no Stribeck curve; without noise it is found in every
                               joint, its friction in motion and at rest within 1.5 %
    delays    +0.2 to +0.8 %   angle and torque are of one instant, whenever they arrive
    gears     −1.0 to +5.0 %   in the gap a rotor has neither link nor friction: inertia −8 to +1 %
    sensors   +0.2 to +3.0 %
    motors    +0.2 to +0.9 %   of f/k, with the motor's true strength k in it, which no log of a robot shows
    all       +1.5 to +8.3 %

95 % intervals hold friction in all of these but `friction`, whose law is not Coulomb's and whose log has no noise, and
one joint each of `sensors` and `all`. In PhysX, all groups real at 10 % of the torque limit, seed 7, all 18 joints: 13
intervals hold it, half of the joints are within 1.2 %, all within 8 %. An inertia measured in the air has the links in
it: wrong masses become a wrong rotor.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi

import numpy as np

from stiction.formats.errors import StictionError
from stiction.formats.log import JointSignals, Log
from stiction.formats.sidecar import LogSetup
from stiction.identify.excite.motion import Pattern
from stiction.robots.spec import JOINT_KINDS, RobotSpec
from stiction.transfer.robot.port import JointCommand, Port, Reading

SETTLING = 1.0
"""Time that the legs hang at rest before each log [s]."""

MOTION = Pattern(
    share=0.4,
    slow_frequency=0.25,
    slow_amplitude=0.35,
    frequencies=(0.6, 1.7, 3.1),
    amplitudes=(1.0, 0.6, 0.35),
    phases=(0.0, 0.5 * pi, 1.1 * pi),
    fast_peak=0.35,
)
"""About the standing pose. Even a friction of 30 % of the torque limit makes a dead band of 0.135 rad at the gains of
Saturn Lite: the swing is more than twice that."""


@dataclass(frozen=True)
class BenchCfg:
    """How a bench log is made."""

    kinds: tuple[str, ...] = JOINT_KINDS
    """Kinds of joints to log, in this order; one alone after a repair, say."""
    seconds: float = 20.0
    """Length of each kind's log [s]: the motion, twice."""
    motion: Pattern = field(default_factory=lambda: MOTION)
    """Offsets from the standing pose."""
    stiffness: float = 1.0
    """Gains during the log over those of the data sheet [1]; kd goes with the root, which keeps the damping ratio."""

    def __post_init__(self) -> None:
        """Refuse logs that say nothing."""
        if not self.kinds or set(self.kinds) - set(JOINT_KINDS) or len(set(self.kinds)) < len(self.kinds):
            raise StictionError(f"bench logs of {self.kinds}: expected different ones of {', '.join(JOINT_KINDS)}")
        if not (4.0 <= self.seconds <= 600.0 and 0.1 <= self.stiffness <= 10.0):
            raise StictionError(
                f"bench logs of {self.seconds} s at {self.stiffness} times the gains: expected 4 to 600 s, 0.1 to 10"
            )


def bench_log(port: Port, spec: RobotSpec, cfg: BenchCfg | None = None) -> Log:
    """Move every joint of a robot that is bolted to its bench and return the log, with its sidecar.

    port: the robot; spec: its data sheet.

    Raises:
        StictionError: the robot is not that of the data sheet.

    """
    cfg = cfg or BenchCfg()
    if port.joint_names != spec.joint_names:
        raise StictionError(f"the robot has the joints {port.joint_names}, its data sheet {spec.joint_names}")
    kp = cfg.stiffness * spec.joint_values("stiffness")
    kd = cfg.stiffness**0.5 * spec.joint_values("derivative")
    count = round(cfg.seconds / port.period / 2)
    offsets = np.tile(cfg.motion.offsets(count, 1.0 / port.period), 2)
    joints: dict[str, JointSignals] = {}
    for number in map(JOINT_KINDS.index, cfg.kinds):
        path = np.tile(spec.joint_values("standing"), (len(offsets), 1))
        path[:, number :: len(JOINT_KINDS)] += offsets[:, None]
        readings = _play(port, path, kp, kd)
        for joint in range(number, spec.num_joints, len(JOINT_KINDS)):
            joints[spec.joint_names[joint]] = JointSignals(
                position=np.array([reading.sensors.joint_position[joint] for reading in readings[:-1]]),
                velocity=np.array([reading.sensors.joint_velocity[joint] for reading in readings[:-1]]),
                target=path[:, joint],
                torque=np.array([reading.joint_torque[joint] for reading in readings[1:]]),
            )
    time = np.arange(len(offsets)) * port.period
    return Log(
        "bench", time, {name: joints[name] for name in spec.joint_names if name in joints}, bench_setup(spec, kp, kd)
    )


def bench_setup(spec: RobotSpec, kp: np.ndarray, kd: np.ndarray) -> LogSetup:
    """Return the log's sidecar: gains [N m/rad], [N m s/rad], shape (J,), and what the data sheet says, by kind."""
    limit = spec.joint_values("torque_limit")
    kinds = {
        kind: LogSetup(kp=float(kp[number]), kd=float(kd[number]), torque_limit=float(limit[number]))
        for number, kind in enumerate(JOINT_KINDS)
    }
    return LogSetup(torque_source="motor_side", test_condition="in_air", axis="rotary", joints=kinds)


def _play(port: Port, path: np.ndarray, kp: np.ndarray, kd: np.ndarray) -> list[Reading]:
    """Hold the first targets until the legs hang still, then play targets (T, J) [rad] back.

    Returns T + 1 readings: what had come when each target was sent, and what came last.
    """
    for _ in range(round(SETTLING / port.period)):
        port.exchange(JointCommand.position(path[0], kp, kd))
    return [port.read(), *(port.exchange(JointCommand.position(target, kp, kd)) for target in path)]
