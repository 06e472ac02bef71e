"""The robot as a whole: when things happen, and that who drives it sees sensors and nothing else."""

from dataclasses import fields, replace

import numpy as np
import pytest

from bundles import make_contract, make_network
from hinges import Hinges
from stiction.deploy.control import JointCommand, Pilot, Reading
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import load_policy
from stiction.joints.compensation import parse_compensation
from stiction.robots.catalog import find_robot
from stiction.virtual.cases import Case, Level
from stiction.virtual.hidden import Delays, Hidden
from stiction.virtual.robot import VirtualRobot, Wear

SPEC = find_robot("saturn_lite")
ZERO, UP = np.zeros(18), np.array([1.0, 0.0, 0.0, 0.0])


def make(hidden: Hidden | None = None, level: float = 0.0, period: float = 0.002, wear: Wear | None = None):
    """Return a robot of hinges at angle zero, and its engine."""
    hidden = hidden or Hidden.perfect(18)
    engine = Hinges(hidden.body(SPEC), None, 0.001)
    friction = Case(0, "friction", Level(level)).friction(hidden, SPEC, 0.001)
    robot = VirtualRobot(engine, hidden, friction, np.random.default_rng(0), period, wear)
    robot.place(ZERO, np.zeros(3), UP)
    engine.torques.clear()
    engine.bounds.clear()
    return robot, engine


def push(torque: float) -> JointCommand:
    """Return the command of a torque, without gains."""
    return JointCommand(ZERO, ZERO, ZERO, np.full(18, torque))


def test_a_command_acts_when_it_arrives_and_a_motion_is_known_when_that_arrives() -> None:
    """The policy meets both delays one after the other: 3 ms there, 4 ms back, in readings every 1 ms."""
    robot, engine = make(replace(Hidden.perfect(18), delays=Delays(0.003, 0.004)), period=0.001)
    readings = [robot.handle.exchange(push(1.0)) for _ in range(10)]
    assert [torque[0] for torque in engine.torques] == [0.0] * 3 + [1.0] * 7
    moved = [reading.sensors.joint_position[0] > 0 for reading in readings]
    # The fourth step is the first that moves it; its end is known four steps later.
    assert moved.index(True) == 3 + 4
    assert [reading.joint_torque[0] for reading in readings].index(1.0) == 3 + 4
    assert readings[-1].time == pytest.approx(0.010)


def test_what_a_motor_feeds_forward_goes_by_its_own_encoder_and_not_by_the_bus() -> None:
    """Beside 5 N m of the gains 0.75 of 8 N m from the first step on, though readings are 6 ms late; limp is limp."""
    robot, engine = make(replace(Hidden.perfect(18), delays=Delays(0.0, 0.006)), period=0.004)
    robot.program(parse_compensation("measured-motor").controller(np.full(18, 8.0), 0.001))
    kp = np.where(np.arange(18) < 17, 50.0, 0.0)
    robot.handle.exchange(JointCommand(np.full(18, 0.1), kp, ZERO, ZERO))
    assert engine.torques[0][0] == pytest.approx(5.0 + 6.0) and not any(torque[17] for torque in engine.torques)
    robot.program(None)
    robot.handle.exchange(JointCommand(ZERO, ZERO, ZERO, ZERO))
    assert not engine.torques[-1].any()


def test_the_joint_controller_knows_neither_delay() -> None:
    """Its loop closes at the motor, at every physics step: kp acts on the angle of now, whatever the bus does."""
    robot, engine = make(replace(Hidden.perfect(18), delays=Delays(0.0, 0.006)), period=0.004)
    robot.handle.exchange(JointCommand(np.full(18, 0.1), np.full(18, 50.0), ZERO, ZERO))
    inertia = 0.01 + 0.0145
    angle, speed = 0.0, 0.0
    for torque in engine.torques:
        assert torque[0] == pytest.approx(50.0 * (0.1 - angle), rel=1e-9)
        speed = (speed + 0.001 * torque[0] / inertia) / (1 + 0.001 * 0.0704 / inertia)
        angle += 0.001 * speed


def test_a_robot_is_limp_until_its_first_command_and_starts_anew_when_it_is_put_down() -> None:
    """An episode must not begin with the commands, angles or battery of the one before."""
    hidden = replace(Hidden.perfect(18), delays=Delays(0.005, 0.005))
    robot, engine = make(hidden)
    first = [robot.handle.exchange(push(1.0)) for _ in range(20)]
    assert engine.torques[0][0] == 0.0
    robot.place(ZERO, np.zeros(3), UP)
    again = [robot.handle.exchange(push(1.0)) for _ in range(20)]
    for one, other in zip(first, again, strict=True):
        assert one.time == other.time
        np.testing.assert_array_equal(one.sensors.joint_position, other.sensors.joint_position)


def test_reported_torque_is_the_mean_of_the_period() -> None:
    """Targets come in steps; the last step alone would say too little, and the friction found would be wrong."""
    robot, engine = make(period=0.004)
    command = JointCommand(np.full(18, 0.1), np.full(18, 50.0), ZERO, ZERO)
    reading = robot.handle.exchange(command)
    assert reading.joint_torque[0] == pytest.approx(np.mean([torque[0] for torque in engine.torques]))
    assert reading.joint_torque[0] > engine.torques[-1][0]


def test_friction_reaches_the_engine_as_a_bound_and_grows_with_wear() -> None:
    """10 % of 45 N m at the shank; a worn joint goes from a third to three times of it in 10 ms, others stay."""
    robot, engine = make(level=0.1)
    robot.handle.exchange(push(0.0))
    np.testing.assert_allclose(engine.bounds[0], 0.1 * SPEC.joint_values("torque_limit"))
    robot, engine = make(level=0.1, wear=Wear(("FL_shank",), 1 / 3, 3.0, 0.01))
    for _ in range(6):
        robot.handle.exchange(push(0.0))
    assert [bound[2] for bound in engine.bounds] == pytest.approx(
        [4.5 / 3 * 9 ** min(step / 10, 1.0) for step in range(12)]
    )
    np.testing.assert_allclose([bound[5] for bound in engine.bounds], 4.5)


def test_joints_shake_by_what_their_speed_changes_in_each_physics_step() -> None:
    """Pushed for 2 ms and pulled for 2 ms a joint is at rest again; it shook all the same, and no more when placed."""
    fine, coarse = make(period=0.001)[0], make(period=0.004)[0]
    before, shaken = ZERO, 0.0
    for torque in (1.0, 1.0, -1.0, -1.0):
        fine.handle.exchange(push(torque))
        speed = fine.ground_truth().motion.joint_velocity
        shaken += float(np.square(speed - before).mean()) / 0.001
        before = speed.copy()
    assert fine.ground_truth().chatter == pytest.approx(shaken) and shaken > 0.0
    coarse.handle.exchange(push(1.0))
    speed = coarse.ground_truth().motion.joint_velocity
    assert coarse.ground_truth().chatter == pytest.approx(float(np.square(speed / 4).mean()) * 4 / 0.001, rel=1e-4)
    fine.place(ZERO, np.zeros(3), UP)
    assert fine.ground_truth().chatter == 0.0


@pytest.mark.parametrize(("load", "watched", "force"), [(0.0, False, 0.0), (0.1, False, 5.0), (0.0, True, 5.0)])
def test_what_joints_transmit_is_known_to_friction_that_depends_on_it(load: float, watched: bool, force: float) -> None:
    """Without it friction under load would be none; the study of benches may watch it all the same."""
    hidden = Hidden.perfect(18)
    engine = Hinges(hidden.body(SPEC), None, 0.001)
    engine.force[:] = 5.0
    friction = Case(0, "friction", Level(0.1, load)).friction(hidden, SPEC, 0.001)
    robot = VirtualRobot(engine, hidden, friction, np.random.default_rng(0), loads=watched)
    robot.handle.exchange(push(0.0))
    assert robot.ground_truth().motion.joint_force.tolist() == [force] * 18
    assert engine.bounds[-1] == pytest.approx(0.1 * SPEC.joint_values("torque_limit") + load * 5.0)


class Bare:
    """A port and nothing else: what a pilot touches beyond this raises `AttributeError`."""

    __slots__ = ("commands", "joint_names", "period")

    def __init__(self) -> None:
        """Be a robot that stands still."""
        self.joint_names, self.period, self.commands = SPEC.joint_names, 0.002, []

    def read(self) -> Reading:
        """Return a robot at rest."""
        standing = SPEC.joint_values("default_position")
        return Reading(0.0, Sensors(UP, np.zeros(3), standing, ZERO), ZERO, np.ones(6, bool))

    def exchange(self, command: JointCommand) -> Reading:
        """Keep the command."""
        self.commands.append(command)
        return self.read()


def test_a_pilot_needs_nothing_but_a_port() -> None:
    """Drives a robot through its port alone, as on a real one."""
    contract = make_contract()
    port = Bare()
    pilot, alone = (load_policy(contract, make_network(contract)) for _ in range(2))
    turn = Pilot(port, pilot).step(np.array([0.5, 0.0, 0.0]))
    expected = alone.step(port.read().sensors, np.array([0.5, 0.0, 0.0]))
    assert len(port.commands) == len(turn.readings) == 10
    for command in port.commands:
        np.testing.assert_array_equal(command.target, expected.target)
        np.testing.assert_array_equal(command.kp, contract.array("kp"))
        np.testing.assert_array_equal(command.kd, contract.array("kd"))
        assert not command.forward.any()


def test_the_handle_shows_sensors_and_nothing_of_the_robot() -> None:
    """By accident nobody reads a parameter: what has no leading underscore is names, a period and sensors."""
    handle = make()[0].handle
    public = {name for name in dir(handle) if not name.startswith("_")}
    assert public == {"joint_names", "period", "read", "exchange"}
    assert not hasattr(handle, "__dict__")
    assert {item.name for item in fields(Reading)} == {"time", "sensors", "joint_torque", "foot_contact"}
    reading = handle.read()
    assert reading.sensors.arrays().keys() == {
        "quaternion",
        "angular_velocity",
        "joint_position",
        "joint_velocity",
    }
    reading.sensors.joint_position[:] = 99.0
    assert handle.exchange(push(0.0)).sensors.joint_position[0] == 0.0
