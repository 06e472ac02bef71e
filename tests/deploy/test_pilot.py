"""Commands of a pilot to the joint controllers between two actions of its policy."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bundles import make_contract
from stiction.core.errors import StictionError
from stiction.deploy.control import JointCommand, Pilot, Reading
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import PolicyStep
from stiction.joints.compensation import Compensation

CONTRACT = make_contract()
JOINTS = CONTRACT.num_joints
FRICTION = np.linspace(1.0, 2.7, JOINTS)


class Approaching:
    """A port whose joints come 0.01 rad nearer to their targets, which are at 0.04 rad, at every reading."""

    joint_names, period = CONTRACT.joint_names, CONTRACT.control_period / 5

    def __init__(self) -> None:
        """Begin at the origin."""
        self.sent: list[JointCommand] = []

    def read(self) -> Reading:
        """Return where the joints are now."""
        still = Sensors(np.array([1.0, 0, 0, 0]), np.zeros(3), np.full(JOINTS, 0.01 * len(self.sent)), np.zeros(JOINTS))
        return Reading(0.0, still, np.zeros(JOINTS), np.ones(6, bool))

    def exchange(self, command: JointCommand) -> Reading:
        """Keep the command and move on."""
        self.sent.append(command)
        return self.read()


def policy(**changes):
    """Return a policy that always asks for 0.04 rad."""
    step = PolicyStep(np.zeros(1), np.zeros(JOINTS), np.full(JOINTS, 0.04))
    return SimpleNamespace(contract=make_contract(**changes), step=lambda sensors, velocity: step, reset=lambda: None)


def test_friction_is_fed_forward_from_the_angle_of_every_reading() -> None:
    """The torque falls as the joint approaches its target: 4/5, 3/5, 2/5, 1/5, 0."""
    port = Approaching()
    Pilot(port, policy(), FRICTION).step(np.zeros(3))
    for command, share in zip(port.sent, (0.8, 0.6, 0.4, 0.2, 0.0), strict=True):
        np.testing.assert_allclose(command.forward, share * FRICTION, atol=1e-12)
        np.testing.assert_allclose(command.target, 0.04)


def test_a_stuck_joint_is_pushed_with_a_share_and_the_less_the_nearer_it_is() -> None:
    """The target rests, the joint does too: 0.75 of what the way `error` gives."""
    port = Approaching()
    Pilot(port, policy(), FRICTION, Compensation("reference", 0.75)).step(np.zeros(3))
    for command, share in zip(port.sent, (0.6, 0.45, 0.3, 0.15, 0.0), strict=True):
        np.testing.assert_allclose(command.forward, share * FRICTION, atol=1e-12)


def test_friction_that_grows_with_the_torque_is_fed_from_that_of_the_gains() -> None:
    """At 0.04 rad before the target 0.6 (f + 0.1 kp 0.04), at 0.03 rad 0.45 (f + 0.1 kp 0.03); by the error only f."""
    kp = CONTRACT.array("kp")
    for way, load in ((Compensation("reference", 0.75), 0.1), (Compensation("error", 0.75), 0.0)):
        port = Approaching()
        Pilot(port, policy(kd=(0.0,) * JOINTS), FRICTION, way, np.full(JOINTS, 0.1)).step(np.zeros(3))
        for command, share, error in zip(port.sent, (0.6, 0.45, 0.3), (0.04, 0.03, 0.02), strict=False):
            np.testing.assert_allclose(command.forward, share * (FRICTION + load * kp * error), atol=1e-12)
    port = Approaching()
    Pilot(port, policy(), None, Compensation("reference", 0.75), 0.1).step(np.zeros(3))
    assert not any(command.forward.any() for command in port.sent)


def test_what_runs_in_the_motors_is_not_done_by_the_computer() -> None:
    """Friction is fed forward once: in the motors or by the computer."""
    with pytest.raises(StictionError, match="expected 'measured' here"):
        Pilot(Approaching(), policy(), FRICTION, Compensation("measured-motor", 0.75))


def test_friction_is_not_compensated_twice() -> None:
    """Rejects feed-forward for a policy that already shifts its targets."""
    with pytest.raises(StictionError, match="once more"):
        Pilot(Approaching(), policy(compensation=tuple(0.1 for _ in range(JOINTS))), FRICTION)
