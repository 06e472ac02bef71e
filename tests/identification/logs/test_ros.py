"""MCAP files of ROS 2: topics, stamps, the order of joints, and commands held onto states."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType

import logfiles
from stiction.core.errors import LogError
from stiction.identification.logs import open_log
from stiction.identification.logs.bags import Topic, choose_topics

STATE, ARRAY, TRAJECTORY = (
    "sensor_msgs/msg/JointState",
    "std_msgs/msg/Float64MultiArray",
    "trajectory_msgs/msg/JointTrajectory",
)
MS = 10**6
START = 1_700_000_000 * 10**9


def states(count: int = 10, **changes: Any) -> list[logfiles.Sent]:
    """Return states of a joint `a` every 5 ms, received 2 ms late; its position is its number."""
    return [
        ("/s", STATE, START + (5 * i + 2) * MS, logfiles.state(START + 5 * i * MS, ["a"], [float(i)]) | changes)
        for i in range(count)
    ]


def test_joints_are_matched_by_name(tmp_path: Path) -> None:
    """The command lists its joints in another order than the states."""
    for compression in CompressionType:
        log = open_log(logfiles.ros(tmp_path, compression))
        np.testing.assert_allclose(log.time, logfiles.TIME, atol=1e-9)
        assert list(log.joints) == ["a", "b"] and log.notes == ()
        for index, signals in enumerate(log.joints.values()):
            np.testing.assert_array_equal(signals.position, logfiles.POSITION[:, index])
            np.testing.assert_array_equal(signals.target, logfiles.TARGET[:, index])
            assert signals.torque is not None and signals.velocity is None


def test_commands_are_held(tmp_path: Path) -> None:
    """A command every 10 ms, 1 ms after a state: the state at 10 ms has that of 1 ms; the first one has none."""
    commands = [
        ("/cmd", STATE, START + (10 * i + 1) * MS, logfiles.state(START + (10 * i + 1) * MS, ["a"], [100.0 + i]))
        for i in range(5)
    ]
    log = open_log(logfiles.mcap(tmp_path / "x.mcap", states() + commands[::-1]))
    np.testing.assert_array_equal(log.joints["a"].position, np.arange(1.0, 10.0))
    np.testing.assert_array_equal(log.joints["a"].target, [100, 100, 101, 101, 102, 102, 103, 103, 104])
    assert log.notes == ("the first 1 states came before the first command and are left out",)


def test_arrays_of_commands_follow_the_order_of_the_states(tmp_path: Path) -> None:
    """They name no joints and have no stamps: both is noted."""
    layout = {"dim": [], "data_offset": 0}
    commands = [("/c", ARRAY, START - MS, {"layout": layout, "data": [7.0]})]
    log = open_log(logfiles.mcap(tmp_path / "x.mcap", commands + states()))
    assert set(log.joints["a"].target) == {7.0}  # type: ignore[arg-type]
    assert "states' order" in log.notes[0] and "different clocks" in log.notes[1]
    bad = [("/c", ARRAY, START - MS, {"layout": layout, "data": [7.0, 8.0]})]
    with pytest.raises(LogError, match=r"its messages have 2 values for 1 joints"):
        open_log(logfiles.mcap(tmp_path / "x.mcap", bad + states()))


def test_trajectories_of_one_point_are_commands(tmp_path: Path) -> None:
    """A point counts from its stamp plus its delay; trajectories of several points are rejected."""

    def trajectory(points: int) -> list[logfiles.Sent]:
        after = {"sec": 0, "nanosec": 6 * MS}
        point = {"positions": [7.0], "velocities": [], "accelerations": [], "effort": [], "time_from_start": after}
        header = {"stamp": {"sec": START // 10**9, "nanosec": 0}, "frame_id": ""}
        return [("/t", TRAJECTORY, START, {"header": header, "joint_names": ["a"], "points": [point] * points})]

    log = open_log(logfiles.mcap(tmp_path / "x.mcap", trajectory(1) + states()))
    assert log.joints["a"].position[0] == 2 and set(log.joints["a"].target) == {7.0}  # type: ignore[index, arg-type]
    with pytest.raises(LogError, match="several points"):
        open_log(logfiles.mcap(tmp_path / "x.mcap", trajectory(2) + states()))


@pytest.mark.parametrize(
    ("sent", "message"),
    [
        ([], "no topic of sensor_msgs"),
        (states(position=[]), "have no positions"),
        (states(effort=[1.0, 2.0]), "a message has 2 values of torque for 1 joints"),
        (states(name=["a", "a"]), "expected one different name each"),
        (states() + states(1, name=["b"]), r"position\.a is not in every message"),
        (states() + states(1, effort=[1.0]), r"torque\.a is not in every message"),
        ([("/other", *sent[1:]) for sent in states()] + states(), "which topic is the state"),
        ([*states(), ("/cmd", STATE, START + 10**9, logfiles.state(START + 10**9, ["a"], [1.0]))], "older"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, sent: list[logfiles.Sent], message: str) -> None:
    """One line that names the topic and the trouble."""
    with pytest.raises(LogError, match=message):
        open_log(logfiles.mcap(tmp_path / "x.mcap", sent))


def test_topics_are_chosen_or_asked_for() -> None:
    """One candidate is taken; of joint states, the one with a word for command is the command; else ask."""
    first, second, wish = Topic("/a", STATE), Topic("/b", STATE), Topic("/joint_cmd", STATE)
    array, other = Topic("/c", ARRAY), Topic("/d", "std_msgs/msg/String")
    assert choose_topics("x", [other, first], {}) == {"state": first}
    assert choose_topics("x", [wish, first, other], {}) == {"state": first, "command": wish}
    assert choose_topics("x", [first, array], {}) == {"state": first, "command": array}
    assert choose_topics("x", [first, second], {"command": "/b"}) == {"state": first, "command": second}
    assert choose_topics("x", [first, second], {"state": "/b"}) == {"state": second}
    with pytest.raises(LogError, match=r"which topic is the command\? Say command=TOPIC; there are /a .*/joint_cmd"):
        choose_topics("x", [first, wish, array], {})
    for asked in ({"state": "/c"}, {"command": "/d"}, {"state": "/x"}):
        with pytest.raises(LogError, match=r"expected a topic of .*; there are /a"):
            choose_topics("x", [first, array, other], asked)


def test_a_database_is_read_like_a_bag(tmp_path: Path) -> None:
    """rosbag2's older form holds the same messages."""
    log = open_log(logfiles.database(tmp_path))
    np.testing.assert_allclose(log.time, logfiles.TIME, atol=1e-9)
    for index, signals in enumerate(log.joints.values()):
        np.testing.assert_array_equal(signals.position, logfiles.POSITION[:, index])
        np.testing.assert_array_equal(signals.target, logfiles.TARGET[:, index])
    (tmp_path / "x.db3").write_bytes(b"hello")
    with pytest.raises(LogError, match="not a rosbag2 database"):
        open_log(tmp_path / "x.db3")


@pytest.mark.parametrize(("family", "motors"), [("unitree_go", 20), ("unitree_hg", 35)])
def test_unitree_s_layouts_are_those_of_its_definitions(tmp_path: Path, family: str, motors: int) -> None:
    """Encoded by another program from the definitions: every motor's number must be where it is looked for."""

    def motor(**known: float) -> dict[str, Any]:
        shapes: dict[str, Any] = {"temperature": [1, 2] if motors == 35 else 1, "sensor": [3, 4]}
        shapes["reserve"] = [5] * (4 if motors == 35 else 2)
        names = ("mode", "ddq", "q_raw", "dq_raw", "ddq_raw", "lost", "vol", "motorstate", "dq", "tau")
        return dict.fromkeys(names, 9) | shapes | known

    head = {"head": [1, 2], "level_flag": 3, "frame_reserve": 4, "sn": [5, 6], "version": [7, 8], "bandwidth": 9}
    head |= {"mode_pr": 1, "mode_machine": 2, "tick": 10, "crc": 11}
    imu = {name: [0.5] * size for name, size in (("quaternion", 4), ("gyroscope", 3), ("accelerometer", 3), ("rpy", 3))}
    sent = []
    for index in range(4):
        states = [motor(q=i + index, dq=100 + i, tau_est=200 + i) for i in range(3)]
        idle = [motor(q=0.0, dq=0.0, tau_est=0.0)] * (motors - 3)
        asked = [motor(q=300 + i, kp=20.0, kd=1.5) for i in range(motors)]
        for one in asked:
            one["reserve"] = [1, 2, 3] if motors == 20 else 1
        now = START + 2 * index * MS
        sent.append(("/lowcmd", f"{family}/msg/LowCmd", now - 1, head | {"motor_cmd": asked}))
        state = head | {"imu_state": imu | {"temperature": 30}, "motor_state": states + idle}
        sent.append(("/lowstate", f"{family}/msg/LowState", now, state))
    log = open_log(logfiles.bag(tmp_path / "go2.db3", sent, logfiles.UNITREE))
    assert list(log.joints) == ["joint_0", "joint_1", "joint_2"]
    for number, signals in enumerate(log.joints.values()):
        np.testing.assert_array_equal(signals.position, number + np.arange(4))
        assert set(signals.velocity) == {100 + number} and set(signals.torque) == {200 + number}  # type: ignore[arg-type]
        assert set(signals.target) == {300 + number}  # type: ignore[arg-type]
    assert "the commands carry the gains kp 20, 20, 20; kd 1.5, 1.5, 1.5" in log.notes[1]
    assert log.notes[2].startswith(f"{motors - 3} motors say zero in every row")


def test_a_bag_of_ros_1_is_read_without_ros(tmp_path: Path) -> None:
    """Joint states and commands of ROS 1 are those of ROS 2 but for the header's count."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC)
    made = types.types
    with Writer(tmp_path / "run.bag") as writer:
        topics = {
            name: writer.add_connection(name, STATE, typestore=types) for name in ("/joint_command", "/joint_states")
        }
        for topic, _, received, fields in logfiles.joint_messages():
            stamp = fields["header"]["stamp"]
            time = made["builtin_interfaces/msg/Time"](stamp["sec"], stamp["nanosec"])
            numbers = [np.array(fields[name], float) for name in ("position", "velocity", "effort")]
            message = made[STATE](made["std_msgs/msg/Header"](1, time, ""), fields["name"], *numbers)
            writer.write(topics[topic], received, types.serialize_ros1(message, STATE))
    log = open_log(tmp_path / "run.bag")
    np.testing.assert_allclose(log.time, logfiles.TIME, atol=1e-9)
    for index, signals in enumerate(log.joints.values()):
        np.testing.assert_array_equal(signals.position, logfiles.POSITION[:, index])
        np.testing.assert_array_equal(signals.target, logfiles.TARGET[:, index])
