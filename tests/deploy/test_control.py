"""The one control step: every caller of it gives the same joint command, and its limits are the contract's."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import deployed
from bundles import make_contract
from deployed import PERIOD, SHORT, Run, state
from stiction.deploy.control import FREE, RANGE, SLEW, CommandCorrection, ControlLoop, JointCommand, Pilot, Reading
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import PolicyStep
from stiction.deploy.runtime.supervisor import Stage, Supervisor
from stiction.exchange.webots.controller import PolicyLoop
from stiction.files.contract_rules import COMMAND_CORRECTION
from stiction.joints.compensation import BY_SPEED, FrictionController

# One physics step in a control period, so that all callers read at the same times.
CONTRACT = make_contract(decimation=1, physics_timestep=0.02, target_limits={"slew": 10.0, "margin": 0.02})
JOINTS, STANDING = CONTRACT.num_joints, CONTRACT.array("standing")
STILL = Sensors(np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), STANDING, np.zeros(JOINTS))
FRICTION = 0.4 * CONTRACT.array("torque_limit")
COMMANDS = np.random.default_rng(0).uniform(-1.0, 1.0, (15, 3))


class Asking:
    """A policy that asks for targets as far from the standing pose as it is commanded to go forward [rad]."""

    contract = CONTRACT

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Do nothing: there is no state."""

    def step(self, sensors: Sensors, command: np.ndarray) -> PolicyStep:
        """Return the targets."""
        return PolicyStep(np.zeros(0), np.zeros(JOINTS), STANDING + command[..., :1] * np.linspace(0.1, 3.0, JOINTS))


class Standing:
    """A port whose joints rest in the standing pose."""

    joint_names, period = CONTRACT.joint_names, CONTRACT.control_period

    def __init__(self) -> None:
        """Begin without commands."""
        self.sent: list[JointCommand] = []

    def read(self) -> Reading:
        """Return the standing pose."""
        return Reading(0.0, STILL, np.zeros(JOINTS), np.ones(6, bool))

    def exchange(self, command: JointCommand) -> Reading:
        """Keep the command."""
        self.sent.append(command)
        return self.read()


def commands(forward: FrictionController | None = None) -> list[JointCommand]:
    """Return the joint commands of one robot, as evaluation, golden vectors and the policy's process get them."""
    loop = ControlLoop(Asking(), CONTRACT, forward)
    return [(loop.act(STILL, each), loop.command(STANDING, np.zeros(JOINTS)))[1] for each in COMMANDS]


def test_a_batch_a_port_and_webots_get_the_same_command_to_the_last_bit() -> None:
    """Evaluation, port and Webots compute the same command, with free targets and at each limit."""
    expected, (kp, limit) = commands(), (CONTRACT.array("kp"), CONTRACT.array("torque_limit"))
    batch, port, webots = ControlLoop(Asking(), CONTRACT), Standing(), PolicyLoop(CONTRACT, Asking())  # type: ignore[arg-type]
    batch.reset(np.ones(3, bool))
    pilot, seen = Pilot(port, Asking()), set()
    tiled = STILL.each(lambda value: np.tile(value, (3, 1)))
    for command, one in zip(COMMANDS, expected, strict=True):
        batch.act(tiled, np.tile(command, (3, 1)))
        seen |= set(batch.limited.by.ravel().tolist())
        many = batch.command(tiled.joint_position, tiled.joint_velocity)
        np.testing.assert_array_equal(many.target, np.tile(one.target, (3, 1)))
        pilot.step(command)
        np.testing.assert_array_equal(
            webots.torque(STILL, command), np.clip(kp * (one.target - STANDING), -limit, limit)
        )
    np.testing.assert_array_equal([sent.target for sent in port.sent], [one.target for one in expected])
    assert seen == {FREE, SLEW, RANGE}
    # At the torque's limit in some joint, as it is computed from the target.
    torque = kp * (np.array([one.target for one in expected]) - STANDING)
    assert (np.abs(torque) <= limit * (1 + 1e-12)).all() and np.isclose(np.abs(torque), limit).any()


def test_the_robots_supervisor_passes_the_control_step_on_to_the_last_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    """The supervisor's limits and feed-forward are evaluation's; its clock, which rounds differently, changes none."""
    monkeypatch.setattr(deployed, "CONTRACT", CONTRACT)
    run, feed = Run(replace(SHORT, duration=2.0)), BY_SPEED.controller(FRICTION, PERIOD)
    run.supervisor = Supervisor(CONTRACT, run.cfg, PERIOD, 0.0, None, feed)
    run.until(Stage.RUN)
    run.answers, loop = False, ControlLoop(Asking(), CONTRACT)
    # The first answer comes in the beat of those before it.
    while run.number % 10:
        run.step()
    for number, (command, one) in enumerate(zip(COMMANDS, commands(feed), strict=True)):
        step = loop.act(STILL, command)
        assert run.supervisor.policy_targets(step.target, run.now, loop.requested, loop.limited.by) is None
        for tick in range(10):
            # A joint that rests while others are told to walk is taken for a frozen encoder after a second.
            robot_state = state(run.number + 1, run.now + PERIOD)
            out = run.step(robot_state)[0]
            assert out.stage is Stage.RUN, (number, tick, run.supervisor.stop_record)
            assert out.command is not None
            np.testing.assert_array_equal(out.command.target, one.target)
            np.testing.assert_array_equal(out.command.forward, one.forward)
            np.testing.assert_array_equal(out.requested, loop.requested)


def test_gains_and_friction_fed_forward_stay_within_the_torque_limit_by_hand() -> None:
    """Gains that ask 8 of 10 N m leave 2 of 4 to be fed, those that ask 12 none, those that ask 8 backward all 4."""
    feed = SimpleNamespace(torque=lambda *_: np.array([4.0, -4.0, 4.0, -4.0, 4.0]))
    targets, still = np.array([0.08, -0.08, 0.12, 0.08, 0.03]), np.zeros(5)
    command = JointCommand.position(targets, np.full(5, 100.0), still)
    fed = command.against_friction(still, still, feed, np.full(5, 10.0)).forward  # type: ignore[arg-type]
    np.testing.assert_allclose(fed, [2.0, -2.0, 0.0, -4.0, 4.0])


def test_what_is_evaluated_keeps_to_the_torque_limit_too() -> None:
    """With f of 40 % of the limit some joints are cut, and none of any command goes beyond."""
    kp, limit = CONTRACT.array("kp"), CONTRACT.array("torque_limit")
    sent = commands(BY_SPEED.controller(FRICTION, CONTRACT.control_period))
    fed, target = (np.array([getattr(one, name) for one in sent]) for name in ("forward", "target"))
    torque = kp * (target - STANDING) + fed
    assert (np.abs(torque) <= limit * (1 + 1e-12)).all()
    pushed = 0.75 * FRICTION * np.clip((target - STANDING) / 0.05, -1.0, 1.0)
    cut = np.abs(fed - pushed) > 1e-9
    assert cut.any() and not cut.all() and np.isclose(np.abs(torque[cut]), np.tile(limit, (15, 1))[cut]).all()


def test_an_older_bundle_has_no_limits_in_its_control_step() -> None:
    """The evaluation of an older bundle is unchanged, bit for bit."""
    loop, far = ControlLoop(Asking(), make_contract()), np.array([9.0, 0.0, 0.0])
    asked = Asking().step(STILL, far).target
    np.testing.assert_array_equal(loop.act(STILL, far).target, asked)
    np.testing.assert_array_equal(loop.command(STANDING, np.zeros(JOINTS)).target, asked)
    assert loop.holds


def test_the_correction_by_hand() -> None:
    """U ← u + T/T_i (c − v), within 60 % of the command and 0.05 beside it; none while standing is commanded."""
    correction, command = CommandCorrection(1.0, 0.6, 0.05, period=0.02), np.array([0.5, 0.0, 0.0])
    correction.step(command, np.array([0.3, 0.1, 0.0]))
    np.testing.assert_allclose(correction.corrected(command), [0.5 + 0.02 * 0.2, -0.02 * 0.1, 0.0])
    for _ in range(200):
        correction.step(command, np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(correction.corrected(command), [0.5 + 0.6 * 0.5 + 0.05, -0.05, 0.0])
    # A slower command at once gets no more than its own share.
    np.testing.assert_allclose(correction.corrected(0.2 * command), [0.1 + 0.6 * 0.1 + 0.05, -0.05, 0.0])
    assert not correction.corrected(np.zeros(3)).any()
    correction.step(np.zeros(3), np.ones(3))
    np.testing.assert_array_equal(correction.corrected(command), command)


def test_a_policy_that_reaches_half_of_the_command_is_told_until_it_reaches_all() -> None:
    """Integral action: v = 0.7 u settles at the command, one robot of a batch that begins anew starts from none."""
    contract = replace(CONTRACT, command_correction=COMMAND_CORRECTION, target_limits=None)
    told: list[np.ndarray] = []

    class Slow(Asking):
        def step(self, sensors: Sensors, command: np.ndarray) -> PolicyStep:
            told.append(command)
            return PolicyStep(np.zeros(0), np.zeros(JOINTS), STANDING, 0.7 * command[..., :2])

    loop, tiled = ControlLoop(Slow(), contract), STILL.each(lambda value: np.tile(value, (2, 1)))
    command = np.tile([0.5, -0.2, 0.0], (2, 1))
    for _ in range(500):
        loop.act(tiled, command)
    np.testing.assert_array_equal(told[0], command)
    np.testing.assert_allclose(0.7 * told[-1][:, :2], command[:, :2], atol=1e-3)
    loop.reset(np.array([True, False]))
    loop.act(tiled, command)
    np.testing.assert_array_equal(told[-1][0], command[0])
    np.testing.assert_allclose(told[-1][1], told[-2][1], atol=1e-4)


def test_limits_of_the_robots_that_begin_anew_begin_at_the_standing_pose() -> None:
    """The slew of the others goes on from their last target."""
    loop = ControlLoop(Asking(), CONTRACT)
    tiled, command = STILL.each(lambda value: np.tile(value, (2, 1))), np.tile([1.0, 0.0, 0.0], (2, 1))
    first = loop.act(tiled, command).target
    loop.reset(np.array([False, True]))
    second = loop.act(tiled, command).target
    np.testing.assert_array_equal(second[1], first[1])
    assert second[0, -1] > first[0, -1] or first[0, -1] == CONTRACT.upper[-1] - 0.02
