"""Hunting: a robot holds its standing pose on joints with friction, and what is fed forward must leave it at rest."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from stiction.core.provenance import seed_streams
from stiction.core.records import column
from stiction.core.rotation import UPRIGHT
from stiction.deploy.control import JointCommand
from stiction.engines.catalog import make_engine
from stiction.joints.compensation import Compensation, Hunting
from stiction.robots.model import Robot
from stiction.virtual.cases import Case, parse_level
from stiction.virtual.drive import INITIAL_ANGLE
from stiction.virtual.hidden import draw
from stiction.virtual.trial import RobotCase, World

SECONDS, SETTLE = 10.0, 2.0
"""How long a robot stands, and what is not measured at the start [s]."""

MOVES = 0.02
"""Speed above which a joint moves [rad/s]: a legged robot's joint at rest is some hundred times slower."""

OFTEN = 1.0
"""A joint hunts where it moves to and fro at least this often [1/s]."""


@dataclass(frozen=True)
class Standing:
    """How a robot stood; a row of standing.csv. On the page the first four are in words."""

    engine: str
    robot: int
    friction_level: str
    """Friction of the joints, as `parse_level` reads it."""
    fed: str
    """How friction was fed forward, as `parse_compensation` reads it; none: not."""
    rms_speed: float = field(metadata=column("joint speed, rms [rad/s]", form=".4f"))
    """Root mean square of all joints' true speeds [rad/s]."""
    hunting: float = field(metadata=column("joints that hunt", "%", form=".0%"))
    """Share of the joints that move to and fro at least `OFTEN` [-]."""
    rms_torque: float = field(metadata=column("motor torque, rms [N m]", form=".2f"))
    """Root mean square of all motors' torques [N m]; part of it holds the robot up."""
    torque_ripple: float = field(metadata=column("about its mean, rms [N m]", form=".3f"))
    """The same of each motor's torque less its mean [N m]: what does not hold the robot up."""


def hunting(speed: np.ndarray, period: float) -> np.ndarray:
    """Return which joints hunt, bool, shape (J,). speed: true, at rest otherwise [rad/s], shape (T, J); period [s]."""
    monitor = Hunting(speed.shape[1], period, MOVES, OFTEN, len(speed) * period)
    return [monitor.step(each) for each in speed][-1]


def rms(values: np.ndarray) -> float:
    """Return the root mean square of values of any shape."""
    return float(np.sqrt(np.square(values).mean()))


def stand(
    case: RobotCase, world: World, spec: Robot, friction: np.ndarray, compensation: Compensation | None
) -> tuple[float, float, float, float]:
    """Let a robot stand; return the last four columns of `Standing`.

    case, world: the robot and where it stands; spec: its data sheet; friction: as identified [N m], shape (J,);
    compensation: how it is fed forward; None: it is not.
    """
    start, sensing = seed_streams(case.seed, ["standing", "standing, sensors"]).values()
    robot = world.robot(case, spec, sensing)
    names = ("default_position", "kp", "kd", "torque_limit")
    target, kp, kd, limit = (spec.joint_values(name) for name in names)
    begin = target + INITIAL_ANGLE * start.uniform(-1.0, 1.0, spec.num_joints)
    robot.place(begin, np.array([0.0, 0.0, spec.standing_height]), UPRIGHT)
    by_computer = None
    if compensation is not None and compensation.in_motor:
        robot.program(compensation.controller(friction, world.timestep))
    elif compensation is not None:
        by_computer = compensation.controller(friction, world.period)
    speeds, torques, port = [], [], robot.handle
    for _ in range(round(SECONDS / world.period)):
        seen = port.read().sensors
        angle, speed = seen.joint_position, seen.joint_velocity
        port.exchange(JointCommand.position(target, kp, kd).against_friction(angle, speed, by_computer, limit))
        truth = robot.ground_truth()
        speeds.append(truth.motion.joint_velocity)
        torques.append(truth.torque)
    speed, torque = (np.array(values)[round(SETTLE / world.period) :] for values in (speeds, torques))
    return rms(speed), float(hunting(speed, world.period).mean()), rms(torque), rms(torque - torque.mean(axis=0))


def stand_by(engine: str, seed: int, level: str, spec: Robot, compensation: Compensation | None) -> Standing:
    """Return how a virtual robot stands whose friction in motion is known. Arguments as of `stand` and `Standing`.

    Of a level such as `0.2+0.02` the load's part is not fed: its coefficient is of forces that no motor knows.
    """
    case = Case(seed, "all", parse_level(level))
    friction = case.level.coulomb(spec) * case.robot(draw(spec, seed)).friction.share
    measured = stand(case, World(partial(make_engine, engine)), spec, friction, compensation)
    return Standing(f"{engine}+all", seed, level, "none" if compensation is None else compensation.label, *measured)
