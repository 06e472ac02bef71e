"""Sliders that are too stiff for the physics step: the bound by what a joint does, and the line that says so."""

from __future__ import annotations

import re

import numpy as np
import pytest

from stiction.cli.main import main
from stiction.robots.catalog import find_robot, robot_names
from stiction.robots.model import Robot
from stiction.robots.physics import EXACT, FAST, PhysicsCfg
from stiction.robots.sliders import HOLDS, STIFFEST, moved_inertia, stiff_sliders, stiffness_ratio
from stiction.sim.fleet import BASE_DOFS, Fleet

STEP = 0.005

ANKLES = {"left_ankle_roll_joint", "right_ankle_roll_joint", "left_ankle_pitch_joint", "right_ankle_pitch_joint"}


def lightest(robot: Robot) -> np.ndarray:
    """Return the least inertia of each rotor that a training draws by default [kg m²], shape (joints,)."""
    return 0.8 * robot.joint_values("armature")


def sticks(ratio: float, load: float, joint: int = 0, stiffness: float = 1000.0) -> bool:
    """Whether a lone joint, its k h²/4I set by its rotor, sticks under a sudden share of its friction."""
    fleet = Fleet(find_robot("saturn_lite"), 1, STEP, 1, physics=PhysicsCfg("plastic", stiffness=stiffness))
    fleet.set_gravity((0.0, 0.0, 0.0))
    fleet.base_position[:, 2] += 1.0
    zero = np.zeros((1, fleet.spec.num_joints))
    fleet.set_gains(zero, zero)
    fleet.damping[:], fleet.friction[:] = 0.0, 5.0
    fleet.armature[:, joint] = stiffness * STEP**2 / (4 * ratio) - fleet.link_inertia()[joint]
    held = np.ones((1, fleet.spec.num_joints), bool)
    held[:, joint] = False
    fleet.clamp(held, base=range(6))
    for _ in range(400):
        fleet.simulation.bind("qfrc_applied")[:, BASE_DOFS + joint] = load * 5.0
        fleet.step()
    return bool(abs(fleet.simulation.bind("plastic")[0, joint] - fleet.standing[joint]) < 1e-9)


def test_the_bound_is_where_a_joint_breaks_away_too_early() -> None:
    """A load that comes at once breaks a joint away at f/2; at 5/9 it does at four fifths of that, as derived."""
    assert pytest.approx(5 / 9) == STIFFEST
    assert sticks(0.01, 0.48) and not sticks(0.01, 0.52)
    assert sticks(STIFFEST, 0.97 * HOLDS / 2) and not sticks(STIFFEST, 1.03 * HOLDS / 2)


def test_beyond_one_a_joint_never_sticks() -> None:
    """Below r = 1 a hundredth of its friction does not move it, above it does."""
    assert sticks(0.95, 0.01) and not sticks(1.05, 0.01)


def test_what_a_joint_moves_is_least_in_the_air() -> None:
    """Less than with all other joints held, and a shank that is nearly alone nearly as much."""
    robot = find_robot("saturn_lite")
    held = Fleet(robot, 1).link_inertia() + robot.joint_values("armature")
    moved = moved_inertia(robot, robot.joint_values("armature"))
    assert (moved < held).all() and (moved > robot.joint_values("armature")).all()
    shank = robot.joint_names.index("FL_shank")
    assert moved[shank] == pytest.approx(held[shank], rel=0.1)
    assert (moved_inertia(robot, lightest(robot)) < moved).all()


@pytest.mark.parametrize("name", robot_names())
def test_of_the_shipped_robots_the_ankles_of_g1_alone_are_too_light(name: str) -> None:
    """At the defaults of a training, the rotors as light as they are drawn; on rows there is nothing to say."""
    robot = find_robot(name)
    line = stiff_sliders(robot, FAST, STEP, lightest(robot))
    assert stiff_sliders(robot, EXACT, STEP, lightest(robot)) is None
    if not name.startswith("g1"):
        assert line is None
        return
    assert line is not None and "\n" not in line
    named = re.search("too stiff for (.*): k h²/4I is up to 1.02 ", line)
    assert named is not None and set(named[1].split(", ")) == ANKLES


def test_what_the_line_advises_is_enough() -> None:
    """The softer slider and the shorter step pass, and those a tenth beyond do not."""
    robot = find_robot("g1")
    line = stiff_sliders(robot, FAST, STEP, lightest(robot))
    assert line is not None
    softer, shorter = (float(re.search(f"{flag}[ =]([0-9.]+)", line)[1]) for flag in ("stiffness", "timestep"))
    for factor, passes in ((1.0, True), (1.2, False)):
        assert (
            stiff_sliders(robot, PhysicsCfg("plastic", stiffness=factor * softer), STEP, lightest(robot)) is None
        ) == passes
        assert (stiff_sliders(robot, FAST, factor * shorter, lightest(robot)) is None) == passes
    assert stiffness_ratio(robot, FAST, shorter, lightest(robot)).max() < STIFFEST
    stiff = stiff_sliders(robot, PhysicsCfg("plastic", stiffness=5000.0), STEP, lightest(robot))
    assert stiff is not None and "chatters and never sticks" in stiff


def test_train_and_doctor_say_it(tmp_path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    """One line on standard error, before a minute is spent; none for another robot or physics."""
    monkeypatch.setattr("stiction.task.audit.check_randomization", lambda *_: [])
    monkeypatch.setattr("stiction.cli.train._run", lambda *_: 0)
    for number, (robot, physics, said) in enumerate((("g1", "plastic", 1), ("g1", "rows", 0), ("go1", "plastic", 0))):
        asked = ["--robot", robot, "--physics", physics, "--friction-level", "0.1"]
        for verb in (["train", "--out", str(tmp_path / str(number))], ["doctor", "--randomization"]):
            assert main([*verb, *asked]) == 0
            err = capsys.readouterr().err
            assert err.count(f"stiction {verb[0]}: warning: --physics plastic: at steps of 0.005 s") == said
