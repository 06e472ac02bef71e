"""The whole way round a virtual robot: its process's messages, the supervisor and the policy, on a clock of its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lockstep import Lockstep
from stiction.deploy.plausibility import Violation
from stiction.deploy.runtime.config import SupervisorCfg
from stiction.deploy.runtime.supervisor import Stage
from stiction.deploy.transports.arrivals import STEP
from stiction.files.bundle import find_bundle, read_bundle
from stiction.virtual.faults import OF_ROBOT
from stiction.virtual.serve import VirtualCfg

BUNDLE = read_bundle(find_bundle(Path("saturn_lite-flat-deception-0.2")))


ARMED = SupervisorCfg(armed=True, duration=3.0)


def lockstep(cfg: SupervisorCfg, virtual: VirtualCfg) -> Lockstep:
    """Return a run of the shipped policy that is told to walk forward."""
    return Lockstep(BUNDLE, cfg, virtual, np.array([0.5, 0.0, 0.0]))


def test_the_policy_walks_under_the_supervisor() -> None:
    """Standing up, limits or messages keep a policy from walking that walks in evaluation."""
    loop = lockstep(ARMED, VirtualCfg(seed=3, level="0.1"))
    loop.run(2.6)
    assert loop.supervisor.stage is Stage.RUN
    begin = loop.robot._robot.ground_truth().motion.base_position[0]
    loop.run(2.9)
    motion = loop.robot._robot.ground_truth().motion
    assert loop.supervisor.stage is Stage.RUN, loop.supervisor.stop_record
    assert 0.25 < (motion.base_position[0] - begin) / 2.9 < 0.75
    end = loop.now + 0.1 + ARMED.settle_limit
    while not loop.supervisor.ended and loop.now < end:
        loop.step()
    # It sinks for longer than the settling time, and is damped until it lies.
    assert loop.supervisor.stage is Stage.DONE and loop.supervisor.stop_record is None
    loop.close()


EXPECTED = {
    "stale": {"stale state"},
    "frozen": {"frozen IMU", "velocity and angle"},
    "frozen-clock": {"time stands still"},
    "nan": {"not finite"},
    "inf": {"not finite"},
    "degrees": {"joint range", "joint jump"},
    "jump": {"joint jump", "joint range"},
    "quaternion": {"quaternion length"},
    "xyzw": {"orientation jump"},
    "tilt": {"orientation jump"},
    "tilting": {"predicted tilt", "attitude and gyroscope"},
    "joint-speed": {"joint rate"},
    "torque": {"torque", "torque and command"},
    "temperature": {"temperature"},
    "flailing": {"flailing", "velocity and angle", "joint rate"},
    "motor-lost": {"motor lost"},
    "motor-fault": {"motor fault"},
    "drive-gains": {"drive kp"},
    "frozen-angle": {"frozen angle", "velocity and angle"},
    "frozen-angles": {"frozen angle", "velocity and angle"},
    "dead-gyroscope": {"frozen gyroscope"},
    "swapped-joints": {"velocity and angle", "torque and command"},
    "offset-joint": {"velocity and angle"},
    "slow-clock": {"velocity and angle", "clock rate"},
    "second-robot": {"second robot"},
    "lossy": {"lossy link"},
    "nan-torque": {"not finite"},
}
"""Fault of the robot -> the rules that may find it."""

SLOW = {"lossy": 1.0} | dict.fromkeys(("tilting", "torque"), 0.3)
SLOW |= dict.fromkeys(("frozen-angle", "frozen-angles", "dead-gyroscope", "swapped-joints", "slow-clock"), 0.3)
"""Fault -> time within which it is found, where that takes a while [s], see docs/safety.md: it begins small, or is
judged as a mean."""


@pytest.mark.parametrize("name", OF_ROBOT)
def test_each_fault_of_the_robot_is_damped_in_time(name: str) -> None:
    """A fault is not found, found too late, or called another."""
    loop = lockstep(replace(ARMED, duration=None), VirtualCfg(seed=4, level="0", cell="sensors"))
    # Two seconds of standing up would show nothing new.
    loop.begin()
    loop.run(0.1)
    assert loop.supervisor.stage is Stage.RUN, loop.supervisor.stop_record
    loop.break_(name)
    begin = loop.now
    while loop.supervisor.stop_record is None and loop.now < begin + 2.0:
        loop.step()
    stop = loop.supervisor.stop_record
    assert stop is not None, f"{name} was not found"
    assert stop.violation.rule in EXPECTED[name], stop.sentence()
    assert stop.time - begin <= SLOW.get(name, 0.04), stop.sentence()
    # Damping frames and no other, and the robot acts on them.
    stopped = len(loop.frames)
    assert not loop.frames[-1]
    loop.run(0.1)
    assert len(loop.frames) >= stopped + 45 and not any(loop.frames[stopped:])
    assert not loop.robot._command.kp.any()
    loop.close()


WAYS = {"lost-states": "dropped", "double-states": "twice", "swapped-states": "reordered"}
"""Fault of the way -> what it is counted as."""


@pytest.mark.parametrize("name", [*WAYS, "clock-back", "clock-forward"])
def test_a_network_that_errs_now_and_then_ends_nothing(name: str) -> None:
    """States that are lost, come twice or behind a newer one, and a clock that is set, are counted, no more."""
    loop = lockstep(replace(ARMED, duration=None), VirtualCfg(seed=4, level="0", cell="sensors"))
    loop.begin()
    loop.break_(name)
    loop.run(1.5)
    assert loop.supervisor.stop_record is None, loop.supervisor.stop_record
    counted = loop.link.arrivals.counts.reported()
    expected = dict.fromkeys(counted, 0) | ({WAYS[name]: 75} if name in WAYS else {"clock_steps": 1})
    for what, number in expected.items():
        # The last one may still be on its way.
        assert number - 1 <= counted[what] <= number, counted
    loop.close()


@pytest.mark.parametrize("sign", [1, -1])
def test_no_size_of_a_step_of_the_clock_ends_a_walk(sign: int) -> None:
    """The clock is set by 3 ms to an hour, in another phase of the gait each time: the robot walks on."""
    loop = lockstep(replace(ARMED, duration=None), VirtualCfg(seed=4, level="0", cell="sensors"))
    loop.begin()
    loop.run(1.0)
    for step in (0.003, 0.01, 0.015, 0.02, 0.03, 0.045, 0.049, 0.06, 3600.0):
        # As if the last one had been ten seconds ago.
        loop.link.arrivals.begin()
        loop.robot._clock += sign * step
        loop.run(0.33)
        assert loop.supervisor.stop_record is None, (step, loop.supervisor.stop_record)
        assert loop.link.arrivals.counts.clock_steps == (sign < 0 or step > STEP)
    loop.close()


@pytest.mark.parametrize("seed", range(2))
def test_a_stop_gets_through_where_three_of_ten_commands_are_lost(seed: int) -> None:
    """The robot is damped within some frames of a stop though a third of them is lost, and rests at the end."""
    loop = lockstep(replace(ARMED, duration=None), VirtualCfg(seed=seed, level="0", cell="sensors"))
    loop.begin()
    loop.break_("lost-commands")
    loop.run(0.1)
    assert loop.robot._command.kp.any() and loop.supervisor.stop_record is None
    loop.supervisor.stop(Violation("operator", None, np.nan, np.nan), loop.now)
    loop.run(0.02)
    assert not loop.robot._command.kp.any()
    loop.run(ARMED.settle_limit)
    assert loop.supervisor.stage is Stage.STOPPED and not loop.robot._command.kp.any()
    loop.close()
