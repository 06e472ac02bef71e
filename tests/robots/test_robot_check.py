"""The checks of a robot: each finds what it is there for, in a robot that has nothing else wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quads import quad
from stiction.robots.catalog import find_robot, robot_names
from stiction.robots.check import Finding, check_robot, standing_torques
from stiction.robots.load import load_robot
from stiction.robots.model import Robot


def states(robot: Robot) -> dict[str, str]:
    """Return the worst state of each check."""
    order = ("good", "note", "bad")
    by_check: dict[str, str] = {}
    for finding in check_robot(robot):
        by_check[finding.check] = max(by_check.get(finding.check, "good"), finding.state, key=order.index)
    return by_check


@pytest.mark.parametrize("name", robot_names())
def test_shipped_robots_pass(name: str) -> None:
    """Nothing to mend; a biped does not stand without a policy, which is no fault."""
    by_check = states(find_robot(name))
    assert "bad" not in by_check.values()
    assert by_check["stands"] == ("note" if name == "g1" else "good")


def altered(robot: Robot, **fields: float) -> Robot:
    """Return a robot with other values at every joint."""
    return replace(robot, joints=tuple(replace(joint, **fields) for joint in robot.joints))


GO1 = find_robot("go1")


@pytest.mark.parametrize(
    ("check", "robot", "words"),
    [
        ("mass", replace(GO1, base=replace(GO1.base, mass=0.1)), "the trunk's mass is lost"),
        ("inertia", replace(GO1, base=replace(GO1.base, inertia=(0.1, 0.1, 0.5, 0, 0, 0))), "base (0.1, 0.1, 0.5"),
        ("inertia", replace(GO1, base=replace(GO1.base, inertia=(0.0,) * 6)), "base (0, 0, 0"),
        ("limits", altered(GO1, lower=-90.0, upper=90.0), "is it in degrees"),
        (
            "motors",
            altered(GO1, torque_limit=35500.0),
            "3.55e+04 N m, 912 times the robot's weight at its height; is it in N m?",
        ),
        (
            "motors",
            altered(GO1, armature=10.0),
            "of 10 kg m², 8.1 times the whole robot's inertia about its feet; is it in",
        ),
        ("motors", altered(GO1, kp=40000.0), "23.7 N m at an error of 0.00059 rad, kp 4e+04; is it in N m/rad?"),
        ("gravity", altered(GO1, torque_limit=4.0), "of the torque limit at"),
        ("stands", altered(GO1, kp=3.0), "it falls"),
        ("feet", replace(GO1, feet=(replace(GO1.feet[0], group=None),)), "one foot"),
    ],
    ids=["mass", "triangle", "zero", "degrees", "mNm", "rotor", "stiff", "weak", "soft", "foot"],
)
def test_what_is_broken_is_found(check: str, robot: Robot, words: str) -> None:
    """A finding says what was found and the line that mends it."""
    findings = check_robot(robot)
    bad = [finding for finding in findings if finding.check == check and finding.state == "bad"]
    assert len(bad) == 1 and words in bad[0].text and bad[0].mend


def test_standing_torques_by_hand() -> None:
    """Go1 in its pose: what the feet push up times their lever, less the weight of thigh and calf, at each knee."""
    torque = standing_torques(GO1)
    knees = torque[2::3]
    angle = GO1.joints[1].default_position + GO1.joints[2].default_position
    # A quarter of the weight pushes up 0.213 m along the calf; its lever about the knee is 0.213 sin(angle).
    lever = 0.213 * np.sin(angle)
    assert np.abs(knees).mean() == pytest.approx(abs(GO1.weight / 4 * lever), rel=0.1)
    mirrored = torque.reshape(4, 3)
    np.testing.assert_allclose(mirrored[0], mirrored[1] * [-1, 1, 1], atol=0.2)


def check_of(tmp_path: Path, model: str) -> Finding:
    """Return whether the robot of a file stands."""
    (tmp_path / "quad.xml").write_text(model)
    return next(
        finding for finding in check_robot(load_robot(tmp_path / "quad.xml").robot) if finding.check == "stands"
    )


def test_a_robot_on_its_knees_or_belly_does_not_stand(tmp_path: Path) -> None:
    """Thighs at 0 and calves at -1.85: knees at 0.2 m under the hips, feet at 0.145 + 0.02; one that folds up lies."""
    servo = '<position kp="35" kv="0.5" forcerange="-30 30"'
    knees = check_of(tmp_path, quad('armature="0.005"', servo, calf=(-2.8, -0.9), trunk=6, key=False))
    assert knees.state == "bad" and "FL_calf, FR_calf, RL_calf, RR_calf reach up to 0.035 m below" in knees.text
    folds = check_of(tmp_path, quad('armature="0.005"', servo, trunk=30))
    assert folds.state == "bad" and "on base" in folds.text
    assert check_of(tmp_path, quad('armature="0.005"', servo, trunk=6)).state == "good"
