"""Messages between processes: nothing lost on the way, nothing made of what is no message, and a million wild ones."""

from __future__ import annotations

import time
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from deployed import CONTRACT, JOINTS, PERIOD, SHORT, STANDING, Run, state
from stiction.deploy.control import ControlLoop, JointCommand
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import load_policy
from stiction.deploy.runtime.channel import IDLE, RUNNING, SENSORS, Channel, sight_layout, socket_pair, targets_layout
from stiction.deploy.runtime.config import OperatorCfg
from stiction.deploy.runtime.operator import Operator
from stiction.deploy.runtime.policy_process import PolicyProcess
from stiction.deploy.runtime.report import Timing
from stiction.deploy.runtime.runtime import Injected, _Loop
from stiction.deploy.runtime.supervisor import Stage, Supervisor
from stiction.deploy.transports.link import command_layout, command_of, state_layout, state_of, state_vectors
from stiction.deploy.transports.messages import HEAD, TAIL
from stiction.deploy.transports.udp import UdpLink
from stiction.files.bundle import find_bundle, read_bundle

STATES, COMMANDS = state_layout(JOINTS, 6), command_layout(JOINTS)


def test_states_and_commands_arrive_as_they_were_sent() -> None:
    """A joint's number arrives at another joint, or rounded."""
    generator = np.random.default_rng(0)
    robot_state = state(7, 1.25, joint_position=generator.standard_normal(JOINTS), command=12.0)
    message = STATES.unpack(STATES.pack(7, 1.25, state_vectors(robot_state)))
    assert message is not None
    heard = state_of(STATES, message, message.time)
    for name, value in vars(robot_state).items():
        if name == "sensors":
            for part, own in vars(value).items():
                np.testing.assert_array_equal(getattr(heard.sensors, part), own)
        else:
            np.testing.assert_array_equal(getattr(heard, name), value)
    sent = JointCommand(*generator.standard_normal((4, JOINTS)))
    again = COMMANDS.unpack(COMMANDS.pack(1, 0.0, vars(sent)))
    assert again is not None
    for name, value in vars(command_of(COMMANDS, again)).items():
        np.testing.assert_array_equal(value, getattr(sent, name))


def test_states_that_were_too_old_when_a_newer_one_was_read_are_counted() -> None:
    """One older than `--stale` behind newer ones is late, one younger than that is not."""
    link = UdpLink(("127.0.0.1", 9), CONTRACT.joint_names, (), PERIOD)
    ages = enumerate((SHORT.stale + 0.01, SHORT.stale - 0.01, 0.0), start=1)
    states = [state(n, PERIOD * n, age=age) for n, age in ages]
    link.receive = lambda: states  # type: ignore[method-assign]
    supervisor, operator = Supervisor(CONTRACT, SHORT, PERIOD, time.monotonic()), Operator(OperatorCfg(), 0.0)
    loop = _Loop(supervisor, link, None, None, None, None, operator, Timing(), Injected(), lambda text: None)
    loop._run_once()
    assert loop.states == 3 and link.arrivals.counts.late == 1
    link.close()


def test_every_damaged_message_is_none() -> None:
    """A message with one flipped bit, of another length, kind or robot is taken for a state."""
    data = STATES.pack(1, 0.5, state_vectors(state(1, 0.5)))
    generator = np.random.default_rng(1)
    for _ in range(500):
        damaged = bytearray(data)
        damaged[generator.integers(len(data))] ^= 1 << int(generator.integers(8))
        assert STATES.unpack(bytes(damaged)) is None
    for wrong in (b"", data[:-1], data + b"x", COMMANDS.pack(1, 0.0, {}), state_layout(JOINTS - 1, 6).pack(1, 0, {})):
        assert STATES.unpack(wrong) is None


def test_a_rehearsal_changes_no_answer() -> None:
    """A policy process that rehearses before every step sends the targets of one that does not."""
    bundle = read_bundle(find_bundle(Path("saturn_lite-flat-deception-0.2")))
    golden, layouts = bundle.golden, (targets_layout(bundle.contract), sight_layout(JOINTS))
    pairs = [socket_pair() for _ in range(2)]
    plain, rehearsed = (PolicyProcess(bundle, Channel(end, *layouts)) for end, _ in pairs)
    ours = [Channel(end, *reversed(layouts)) for _, end in pairs]
    for t in range(5):
        sight = {name: getattr(golden, name)[t] for name in SENSORS} | {"velocity": golden.command[t], "mode": RUNNING}
        for channel in ours:
            assert channel.send(0.0, {"mode": IDLE})
        # What a rehearsal takes counts only where nothing newer comes.
        for _ in range(t % 2):
            rehearsed.rehearse()
        for channel in ours:
            assert channel.send(0.0, sight | {"fault": 0.0})
        for _ in range(3 - t):
            rehearsed.rehearse()
        assert plain.step(0.0, 0) and rehearsed.step(0.0, 0)
        (expected,), (actual,) = (map(layouts[0].vectors, channel.receive()) for channel in ours)
        for name in ("target", "action", "requested", "limited_by", "frame"):
            np.testing.assert_array_equal(actual[name], expected[name])
            assert np.isfinite(actual[name]).all()
    for pair in pairs:
        for end in pair:
            end.close()


def test_the_policy_sees_in_a_run_what_it_saw_in_training() -> None:
    """Through state and sight, some term of the observation differs from the recorded one by more than 1e-6."""
    bundle = read_bundle(find_bundle(Path("saturn_lite-flat-deception-0.2")))
    contract, golden = bundle.contract, bundle.golden
    policy = load_policy(contract, bundle.policy)
    loop = ControlLoop(policy, contract)
    sights = sight_layout(contract.num_joints)
    worst = 0.0
    for t in range(500):
        if golden.reset[t]:
            loop.reset()
        recorded = {name: getattr(golden, name)[t] for name in SENSORS}
        message = STATES.unpack(STATES.pack(t, golden.time[t], state_vectors(state(t, golden.time[t], **recorded))))
        assert message is not None
        heard = state_of(STATES, message, message.time).sensors
        told = {name: getattr(heard, name) for name in SENSORS} | {"velocity": golden.command[t]}
        sight = sights.unpack(sights.pack(t, 0.0, told))
        assert sight is not None
        seen = sights.vectors(sight)
        step = loop.act(Sensors(*(seen[name] for name in SENSORS)), seen["velocity"])
        policy.take_over(golden.action[t])
        worst = max(worst, float(np.abs(step.observation - golden.observation[t]).max()))
    assert worst <= 1e-6


def wild(generator: np.random.Generator, number: int, time: float) -> bytes:
    """Return a state with a checksum that holds, and in it whatever float64 can say."""
    data = bytearray(STATES.pack(number, time, state_vectors(state(number, time))))
    for _ in range(int(generator.integers(0, 4))):
        place = HEAD.size + 8 * int(generator.integers(STATES.size))
        kind = generator.integers(5)
        if kind == 0:
            data[place : place + 8] = generator.bytes(8)
        elif kind == 1:
            data[place : place + 8] = np.float64(generator.choice(SPECIAL)).tobytes()
        else:
            value = np.frombuffer(data, "<f8", 1, place)[0]
            data[place : place + 8] = np.float64(value + generator.normal() * 10.0 ** float(kind - 4)).tobytes()
    data[-TAIL.size :] = TAIL.pack(zlib.crc32(bytes(data[: -TAIL.size])))
    return bytes(data)


SPECIAL = (np.nan, np.inf, -np.inf, 0.0, -0.0, 1e308, -1e308, 5e-324, 1.0, 57.3)
"""Numbers that code forgets."""

LOWER, UPPER = CONTRACT.array("lower"), CONTRACT.array("upper")


def fuzz(states: int, seed: int) -> dict[str, int]:
    """Feed wild states to supervisors, each until it has damped at some; return how often each rule stopped one.

    Raises `AssertionError` where a target is outside the joint's limits or no number.
    """
    generator = np.random.default_rng(seed)
    stops: dict[str, int] = {}
    run, left, damped = Run(replace(SHORT, duration=5.0)).until(Stage.RUN), states, 0
    while left:
        left -= 1
        run.number += 1
        run.now += 0.002
        data = wild(generator, run.number, run.now)
        if generator.random() < 0.02:
            data = data[: int(generator.integers(len(data)))]
        message = STATES.unpack(data)
        outs = [run.supervisor.tick(run.now)]
        if message is not None:
            outs.append(run.supervisor.state(state_of(STATES, message, message.time), run.now))
        if run.number % 10 == 0:
            outs.append(run.supervisor.policy_targets(STANDING + generator.normal(0.0, 3.0, JOINTS), run.now))
        for out in outs:
            if out is not None and out.command is not None:
                target = out.command.target
                assert np.isfinite(target).all()
                assert not out.command.kp.any() or ((target >= LOWER) & (target <= UPPER)).all()
        damped += run.supervisor.stop_record is not None
        if run.supervisor.ended or damped > 3:
            damped = 0
            stop = run.supervisor.stop_record
            name = "end" if stop is None else stop.violation.rule
            stops[name] = stops.get(name, 0) + 1
            run = Run(replace(SHORT, duration=5.0, ramp=2.0, hold=0.01))
            run.supervisor.policy_waits(run.now)
            run.supervisor.stage = Stage.PASSIVE
            run = started(run)
    return stops


def started(run: Run) -> Run:
    """Return a run in its last stage but one, without the two seconds of standing up."""
    run.step()
    run.supervisor.policy_waits(run.now)
    run.step()
    run.supervisor.stage, run.supervisor._since = Stage.RUN, run.now
    return run


def test_wild_states_move_nothing_beyond_its_limits() -> None:
    """A state of chance crashes or hangs the supervisor, or a target leaves the joint's limits."""
    stops = fuzz(3000, 0)
    assert sum(stops.values()) > 100 and "not finite" in stops and "joint range" in stops


def test_a_channel_gives_messages_whole_and_says_who_is_gone() -> None:
    """A full channel blocks the supervisor, or a dead policy goes unnoticed."""
    ends = socket_pair()
    targets, sights = targets_layout(CONTRACT), sight_layout(JOINTS)
    ours, theirs = Channel(ends[0], sights, targets), Channel(ends[1], targets, sights)
    assert ours.send(1.0, {"velocity": [1.0, 2.0, 3.0]}) and ours.send(2.0, {})
    first, second = theirs.receive()
    assert (first.number, first.time, second.number) == (1, 1.0, 2)
    np.testing.assert_array_equal(sights.vectors(first)["velocity"], [1.0, 2.0, 3.0])
    assert np.isnan(sights.vectors(first)["mode"]).all()
    for _ in range(20_000):
        assert ours.send(0.0, {})
    assert ours.lost > 0
    assert len(list(theirs.receive())) > 0
    theirs.close()
    assert not ours.send(0.0, {})
    ours.close()
