"""Supervisor: accepted messages, their order, and a stop that is damping until the robot rests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deployed import CONTRACT, JOINTS, PERIOD, SHORT, STANDING, Run, state
from stiction.core.errors import ConfigurationError
from stiction.deploy.control import RANGE, SLEW, TORQUE
from stiction.deploy.plausibility import Violation
from stiction.deploy.runtime.config import SupervisorCfg
from stiction.deploy.runtime.report import hunting_joints
from stiction.deploy.runtime.settling import REST_SECONDS
from stiction.deploy.runtime.supervisor import Stage, Supervisor
from stiction.deploy.transports.link import Peers
from stiction.files.contract_rules import TARGET_LIMITS
from stiction.joints.compensation import BY_SPEED


def test_a_run_goes_through_its_stages_and_ends_in_damping() -> None:
    """A run skips standing up, or ends with stiff joints."""
    run = Run().until(Stage.DONE)
    stages = [out.stage for out in run.outs]
    assert [stage for n, stage in enumerate(stages) if n == 0 or stage is not stages[n - 1]] == [
        *(Stage.PASSIVE, Stage.STAND, Stage.RUN, Stage.DAMP, Stage.DONE)
    ]
    last = run.frames()[-1].command
    assert last is not None and not last.kp.any() and (last.kd == CONTRACT.array("kd")).all()
    assert run.supervisor.stop_record is None


def test_nothing_is_stiff_before_the_policy_is_there() -> None:
    """The robot moves because a process started."""
    run = Run()
    run.answers = False
    for _ in range(500):
        run.step()
    assert run.supervisor.stage is Stage.PASSIVE
    assert all(not out.command.kp.any() for out in run.frames())  # type: ignore[union-attr]


def test_the_first_target_is_the_measured_pose_and_the_way_up_is_slow() -> None:
    """The robot jumps to its standing pose from wherever it lies."""
    run = Run()
    run.place(STANDING + 0.3)
    run.perfect = False
    while not any(out.stage is Stage.STAND for out in run.outs):
        run.step()
    first = run.frames()[-1].command
    assert first is not None and first.kp.any()
    np.testing.assert_allclose(first.target, STANDING + 0.3, atol=1e-12)
    run.perfect = True
    before, fastest = first.target, 0.0
    while run.supervisor.stage is Stage.STAND:
        for out in run.step():
            if out.command is not None:
                fastest = max(fastest, float(np.abs(out.command.target - before).max()) / PERIOD)
                before = out.command.target
    # A cosine over 2 s and 0.3 rad is at most 0.3 π/4 rad/s fast.
    assert fastest == pytest.approx(0.3 * np.pi / 4, rel=0.02)
    np.testing.assert_allclose(before, STANDING, atol=1e-9)


def test_a_pose_far_behind_a_limit_is_not_pulled_back() -> None:
    """The first target tears a joint that was pushed behind its limit back by more than 0.1 rad."""
    run = Run()
    pose = STANDING.copy()
    pose[2] = CONTRACT.lower[2] - 0.15
    run.place(pose)
    run.perfect = False
    stop = run.ended()
    assert (stop.violation.rule, stop.violation.joint) == ("first target", CONTRACT.joint_names[2])
    assert stop.violation.value == pytest.approx(0.15 + TARGET_LIMITS["margin"])


def test_a_robot_that_did_not_stand_up_does_not_run() -> None:
    """The policy takes over a robot that lies."""
    run = Run()
    run.place(STANDING - 0.6)
    run.perfect = False
    assert run.ended(most=10.0).violation.rule == "did not stand up"


def test_a_stop_is_damping_at_the_full_rate_for_the_settling_time_and_then_nothing() -> None:
    """Every period has a damping frame after a stop, as any of them can be lost; nothing wakes the robot again."""
    run = Run().until(Stage.RUN)
    run.outs.clear()
    begin = run.now
    stop = run.supervisor.stop(Violation("operator", None, np.nan, np.nan), run.now, "a key")
    assert stop is not None and stop.command is not None and not stop.command.kp.any()
    run.until(Stage.STOPPED, 1.0)
    # At rest for 0.2 s, which is longer than the settling time of these runs.
    assert run.now - begin == pytest.approx(REST_SECONDS, abs=2 * PERIOD)
    frames = run.frames()
    assert len(frames) == pytest.approx(REST_SECONDS / PERIOD, abs=2)
    assert not any(out.command.kp.any() for out in frames)  # type: ignore[union-attr]
    run.outs.clear()
    for _ in range(2000):
        run.step()
    assert run.frames() == [] and run.supervisor.stage is Stage.STOPPED
    assert run.supervisor.stop(Violation("tilt", None, 1.0, 0.8), run.now) is None
    assert run.supervisor.stop_record.sentence() == "operator: a key"  # type: ignore[union-attr]


def test_damping_goes_on_while_the_robot_moves_and_ends_at_its_limit() -> None:
    """A robot that falls slowly, or says nothing any more, is damped until it rests, at most for the limit."""
    cfg = replace(SHORT, settle=0.3, settle_limit=2.0)
    for falls_for, expected in ((0.7, 0.7 + REST_SECONDS), (9.0, 2.0)):
        run = Run(cfg).until(Stage.RUN)
        begin = run.now
        run.supervisor.stop(Violation("operator", None, np.nan, np.nan), run.now)
        while not run.supervisor.ended:
            fallen = STANDING - 0.5 * min(run.now - begin, falls_for)
            run.step(state(run.number + 1, run.now + PERIOD, joint_position=fallen))
        assert run.now - begin == pytest.approx(expected, abs=0.05)
    run = Run(cfg).until(Stage.RUN)
    run.outs.clear()
    while not run.supervisor.ended:
        run.step(silent=True)
    damped = [out for out in run.frames() if not out.command.kp.any()]  # type: ignore[union-attr]
    assert len(damped) == pytest.approx(2.0 / PERIOD, abs=3)


@pytest.mark.parametrize("seed", range(4))
def test_a_stop_reaches_a_robot_that_loses_three_of_ten_commands(seed: int) -> None:
    """A stop gets through a network that loses 30 % of the frames, within ten frames, each time."""
    run, chance = Run().until(Stage.RUN), np.random.default_rng(seed)
    run.perfect, stiff, frames = False, True, 0
    outs = [run.supervisor.stop(Violation("operator", None, np.nan, np.nan), run.now)]
    while not run.supervisor.ended:
        for out in outs:
            if out is not None and out.command is not None and chance.random() >= 0.3:
                stiff = bool(out.command.kp.any())
            frames += stiff
        outs = list(run.step())
    assert not stiff and frames < 10


def test_a_supervisor_that_was_halted_stops_in_its_first_turn() -> None:
    """A halt of 200 ms is a stop before anything that waited is read; turns within the limit are none."""
    run = Run().until(Stage.RUN)
    assert run.supervisor.turn(run.now) is None
    assert run.supervisor.turn(run.now + 0.9 * SHORT.gap) is None
    out = run.supervisor.turn(run.now + 0.9 * SHORT.gap + 0.2)
    assert out is not None and out.command is not None and not out.command.kp.any()
    stop = run.supervisor.stop_record
    assert stop is not None and stop.violation.rule == "supervisor halted"
    assert stop.violation.value == pytest.approx(0.2)


def test_a_state_is_as_old_as_it_is_and_not_as_late_as_it_is_read() -> None:
    """After a halt the newest state in a full queue is old: that stops the run, an old one before it does not."""
    run = Run().until(Stage.RUN)
    late = state(run.number + 1, run.now + PERIOD, joint_position=run.position.copy(), age=0.05)
    assert run.supervisor.passed(late, run.now + PERIOD) is None
    outs = run.step(state(run.number + 2, run.now + 2 * PERIOD, joint_position=run.position.copy(), age=0.031))
    stop = run.supervisor.stop_record
    assert stop is not None and (stop.violation.rule, stop.violation.value) == ("stale state", 0.031)
    assert not any(out.command.kp.any() for out in outs if out.command is not None)


@pytest.mark.parametrize(
    ("peers", "armed", "rule"),
    [
        (Peers(("a",), ("a", "log")), True, "further reader"),
        (Peers(("a",), ("a", "log")), False, ""),
        (Peers(("a",), ("a",)), True, ""),
        (Peers(("a", "b")), True, "second robot"),
        (Peers(("a", "b")), False, "second robot"),
        (Peers(("a",), ("a",), ("pad",)), True, "second writer"),
        (Peers(), True, ""),
    ],
)
def test_one_robot_and_nobody_else_at_the_other_end(peers: Peers, armed: bool, rule: str) -> None:
    """A second robot ends any run; further readers and writers of commands end one that sends them. All are named."""
    run = Run(replace(SHORT, armed=armed)).until(Stage.RUN)
    out = run.supervisor.meet(peers, run.now)
    stop = run.supervisor.stop_record
    assert (stop is None) == (out is None) == (rule == "")
    if stop is not None:
        assert stop.violation.rule == rule and stop.detail in ("a; b", "a; log", "pad")
    agreed = Run(replace(SHORT, armed=armed, readers=2))
    assert (agreed.supervisor.meet(peers, 0.0) is None) == (rule in ("", "further reader"))


def test_targets_are_clipped_by_slew_range_and_torque_each_by_name() -> None:
    """A wild policy throws the robot, drives it into its stops, or asks for more than its motors give."""
    run = Run(replace(SHORT, limits=replace(SHORT.limits, slew=8.0)))
    run.until(Stage.RUN)
    run.perfect = False
    run.target = STANDING.copy()
    run.target[0] += 5.0
    for _ in range(11):
        run.step()
    out = run.frames()[-1]
    # 8 rad/s over the 20 ms between two answers.
    assert out.limited.by[0] == SLEW and out.command is not None
    assert out.command.target[0] == pytest.approx(STANDING[0] + 0.16)
    assert (out.limited.by[1:] == 0).all()
    run.perfect = True
    for _ in range(200):
        run.step()
    out = run.frames()[-1]
    assert out.limited.by[0] == RANGE and out.command is not None
    assert out.command.target[0] == pytest.approx(CONTRACT.upper[0] - TARGET_LIMITS["margin"])
    run.perfect = False
    run.target[1] = run.position[1] + 0.35
    for _ in range(20):
        run.step()
    out = run.frames()[-1]
    assert out.limited.by[1] == TORQUE and out.command is not None
    assert CONTRACT.kp[1] * (out.command.target[1] - run.position[1]) == pytest.approx(CONTRACT.torque_limit[1])


@pytest.mark.parametrize(
    ("rule", "change"),
    [
        ("not finite", {"joint_position": np.full(JOINTS, np.nan)}),
        ("not finite", {"angular_velocity": np.array([np.inf, 0, 0])}),
        ("not finite", {"joint_torque": np.where(np.arange(JOINTS) == 3, np.nan, 0.0)}),
        ("not finite", {"temperature": np.where(np.arange(JOINTS) == 3, np.inf, 30.0)}),
        ("not finite", {"acceleration": np.array([0.0, np.nan, 9.81])}),
        ("quaternion length", {"quaternion": np.zeros(4)}),
        ("joint range", {"joint_position": np.degrees(STANDING)}),
        ("joint rate", {"joint_velocity": np.full(JOINTS, 60.0)}),
        ("joint speed", {"joint_velocity": np.full(JOINTS, 30.0), "joint_position": STANDING + 0.03}),
        ("orientation jump", {"quaternion": np.array([np.cos(0.45), np.sin(0.45), 0, 0])}),
        ("predicted tilt", {"angular_velocity": np.array([19.0, 0.0, 0.0])}),
        ("temperature", {"temperature": np.full(JOINTS, 120.0)}),
        ("drive torque limit", {"torque_limit": 2.0 * CONTRACT.array("torque_limit")}),
        ("drive kp", {"kp": 1.5 * CONTRACT.array("kp"), "kd": CONTRACT.array("kd")}),
        ("second writer", {"command": 17.0}),
        ("time stands still", {"time": 0.1}),
    ],
)
def test_one_bad_state_stops_at_once(rule: str, change: dict) -> None:
    """A state that is dangerous, or cannot be true, is acted upon."""
    run = Run().until(Stage.RUN)
    run.supervisor.sent(1000.0, run.now)
    outs = run.step(state(run.number + 1, change.pop("time", run.now + PERIOD), **change))
    assert run.supervisor.stop_record is not None
    assert run.supervisor.stop_record.violation.rule == rule
    assert run.supervisor.stop_record.time == pytest.approx(run.now)
    frames = [out.command for out in outs if out.command is not None]
    assert frames and not any(frame.kp.any() for frame in frames)
    assert all(np.isfinite(frame.target).all() for frame in frames)


def test_silence_of_the_robot_and_of_the_policy_stop_within_their_times() -> None:
    """A robot or a policy that is gone is waited for."""
    run = Run().until(Stage.RUN)
    last = run.now
    stop = run.ended(silent=True)
    assert stop.violation.rule == "stale state"
    assert SHORT.stale < stop.time - last <= SHORT.stale + 2 * PERIOD
    run = Run().until(Stage.RUN)
    run.answers, last = False, run.now
    stop = run.ended()
    assert stop.violation.rule == "policy silent"
    assert stop.time - last <= SHORT.silence + 2 * PERIOD


def test_an_imu_that_repeats_itself_is_frozen_after_30_ms() -> None:
    """Frozen sensors are acted upon for longer than a state may be old."""
    run = Run().until(Stage.RUN)
    good = state(run.number, run.now)
    begin = run.now
    while not run.supervisor.ended and run.now < begin + 1.0:
        run.step(replace(good, number=run.number + 1, time=run.now + PERIOD))
    stop = run.supervisor.stop_record
    assert stop is not None and stop.violation.rule == "frozen IMU"
    assert stop.time - begin <= SHORT.frozen + 2 * PERIOD


def test_a_policy_that_asks_for_no_number_or_fails_stops() -> None:
    """NaN reaches a motor controller."""
    run = Run().until(Stage.RUN)
    run.target = STANDING.copy()
    run.target[4] = np.nan
    stop = run.ended()
    assert (stop.violation.rule, stop.violation.joint) == ("target not finite", CONTRACT.joint_names[4])
    assert all(np.isfinite(out.command.target).all() for out in run.frames())  # type: ignore[union-attr]
    run = Run().until(Stage.RUN)
    assert (
        run.supervisor.stop(Violation("policy gone", None, np.nan, np.nan), run.now, "its process ended with status -9")
        is not None
    )
    assert run.supervisor.stop_record.sentence() == "policy gone: its process ended with status -9"  # type: ignore[union-attr]


def test_lost_velocity_commands_stand_then_stop() -> None:
    """The robot walks on by the last command of somebody who is gone."""
    cfg = replace(SHORT, duration=20.0, command_timeout=0.1, command_stop=0.3)
    run = Run(cfg).until(Stage.RUN)
    run.supervisor.command_velocity(np.array([0.5, 0.0, 0.0]), run.now, remote=True)
    begin = run.now
    while run.supervisor.velocity.any():
        run.step()
    assert run.now - begin == pytest.approx(cfg.command_timeout, abs=3 * PERIOD)
    stop = run.ended()
    assert stop.violation.rule == "command lost"
    assert stop.time - begin == pytest.approx(cfg.command_stop, abs=3 * PERIOD)
    # A command that was typed in is not lost.
    run = Run(replace(cfg, duration=0.5)).until(Stage.RUN)
    run.supervisor.command_velocity(np.array([0.5, 0.0, 0.0]), run.now)
    run.until(Stage.DONE)


def test_a_command_beyond_training_stops_before_anything_moves() -> None:
    """A velocity that the policy was never asked for acts."""
    run = Run()
    run.supervisor.command_velocity(np.array([3.0, 0.0, 0.0]), 0.0)
    run.step()
    assert run.supervisor.stop_record is not None and run.supervisor.stop_record.violation.rule == "command"


def test_a_robot_or_policy_that_never_comes_ends_the_run() -> None:
    """The command waits for ever."""
    run = Run(replace(SHORT, ready_timeout=0.5))
    run.answers = False
    stop = run.ended(most=1.0)
    assert stop.violation.rule == "not ready" and "policy" in stop.sentence()


def test_a_state_that_came_too_late_to_act_on_is_judged_too() -> None:
    """A fault that shows in one reading passes, because two came at once."""
    run = Run().until(Stage.RUN)
    good = state(run.number + 1, run.now + PERIOD, joint_position=run.position.copy())
    assert run.supervisor.passed(good, run.now + PERIOD) is None
    bad = state(run.number + 2, run.now + 2 * PERIOD, joint_velocity=np.full(JOINTS, 60.0))
    out = run.supervisor.passed(bad, run.now + 2 * PERIOD)
    assert out is not None and out.command is not None and not out.command.kp.any()
    assert run.supervisor.passed(good, run.now + 3 * PERIOD) is None


@pytest.mark.parametrize(
    "wrong", [{"ramp": 1.0}, {"duration": -1.0}, {"stale": 0.0}, {"silence": np.nan}, {"command_stop": 0.1}]
)
def test_settings_that_are_none_are_refused(wrong: dict) -> None:
    """A ramp of a second throws the robot up; a timeout of zero stops every run, one of NaN none."""
    with pytest.raises(ConfigurationError, match="expected"):
        SupervisorCfg(**wrong)


def test_friction_is_fed_forward_while_the_policy_runs_and_never_else() -> None:
    """Feeds 75 % of f at 0.05 rad from the target, joints at rest; nothing in standing up and damping."""
    run, friction = Run(), np.linspace(0.5, 1.5, JOINTS)
    run.supervisor = Supervisor(CONTRACT, SHORT, PERIOD, 0.0, None, BY_SPEED.controller(friction, PERIOD))
    run.perfect = False
    run.until(Stage.DONE)
    for out in run.frames():
        assert out.command is not None
        fed = 0.75 * friction if out.stage is Stage.RUN and out.command.target[0] > STANDING[0] else 0.0 * friction
        np.testing.assert_allclose(out.command.forward, fed, atol=1e-9)
    assert any(out.command.forward.any() for out in run.frames())  # type: ignore[union-attr]


def test_torques_that_came_before_a_command_do_not_answer_it() -> None:
    """A starved supervisor reads bursts, behind a command that the robot did not have yet: no other joint's torque."""
    torque = 0.5 * CONTRACT.array("torque_limit")
    for age, rule in ((0.02, None), (0.0, "torque and command")):
        run = Run().until(Stage.RUN)
        for number in range(100):
            run.supervisor.sent(number, run.now + PERIOD - 0.01)
            run.step(state(run.number + 1, run.now + PERIOD, joint_position=run.position, joint_torque=torque, age=age))
        stop = run.supervisor.stop_record
        assert (None if stop is None else stop.violation.rule) == rule


@pytest.mark.parametrize("walks", [False, True])
def test_a_joint_that_hunts_while_it_is_to_stand_gets_no_friction_any_more(walks: bool) -> None:
    """A joint swings at 10 Hz under what is fed forward to it; in walking that is no hunting, which nobody can tell."""
    run, friction = Run(), np.ones(JOINTS)
    feed = BY_SPEED.controller(friction, PERIOD)
    run.supervisor = Supervisor(CONTRACT, replace(SHORT, duration=2.0), PERIOD, 0.0, None, feed)
    run.until(Stage.RUN)
    run.supervisor.command_velocity(np.array([0.3 * walks, 0.0, 0.0]), run.now)
    run.outs.clear()
    while run.supervisor.stage is Stage.RUN:
        turn = 2 * np.pi * 10 * run.now
        # All joints tremble, one more than it should.
        swing = np.where(np.arange(JOINTS) == 3, 0.3, 0.05)
        angle, speed = STANDING + 0.05 + swing / (2 * np.pi * 10) * np.sin(turn), swing * np.cos(turn)
        run.step(state(run.number + 1, run.now + PERIOD, joint_position=angle, joint_velocity=speed))
    assert run.supervisor.stop_record is None
    assert np.flatnonzero(run.supervisor.hunts).tolist() == ([] if walks else [3])
    first, last = ([out.command.forward for out in run.frames()[part]] for part in (slice(200), slice(-600, -100)))
    assert np.abs([forward[3] for forward in first]).max() == pytest.approx(0.75)
    assert np.abs([forward[3] for forward in last]).max() == pytest.approx(0.75 * walks)
    assert hunting_joints(run.supervisor) == ([] if walks else [CONTRACT.joint_names[3]])


@pytest.mark.parametrize(("waited", "stopped"), [(0.0, True), (0.4, False)])
def test_gains_that_a_robot_said_before_it_was_told_ours_are_not_judged(waited: float, stopped: bool) -> None:
    """A state of 0.2 s after the first command, read at 0.6 s on a busy computer, is not judged."""
    run = Run(replace(SHORT, stale=1.0))
    while run.supervisor.stage is not Stage.STAND:
        run.step()
    begin = run.now
    while run.now < begin + 0.6:
        run.step()
    old = {"kp": np.zeros(JOINTS), "kd": np.zeros(JOINTS), "joint_position": run.position.copy()}
    run.step(replace(state(run.number + 1, run.now + PERIOD, **old), age=waited))
    record = run.supervisor.stop_record
    assert (record is not None and record.violation.rule == "drive kp") == stopped
