"""Robots: what the paper says about them, and that they can be built and stand."""

import dataclasses
import sys
import types

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.robots.box_legs import build_model
from stiction.robots.catalog import find_robot, robot_names
from stiction.robots.model import box_inertia
from stiction.sim.fleet import Fleet


@pytest.mark.parametrize(
    ("name", "mass", "joints", "limits"),
    [("saturn_lite", 32.0, 18, (25.0, 25.0, 45.0)), ("go1", 12.0, 12, (23.7, 35.55, 35.55))],
)
def test_mass_joints_and_limits_are_the_papers(name: str, mass: float, joints: int, limits: tuple) -> None:
    """Table I: every result in fractions of the torque limit rests on these."""
    spec, model = find_robot(name), build_model(find_robot(name))
    assert model.body_mass.sum() == pytest.approx(mass) == spec.mass
    assert spec.weight == pytest.approx(9.81 * mass) and model.opt.gravity.tolist() == [0.0, 0.0, -9.81]
    assert spec.num_joints == joints == model.nu
    assert tuple(spec.joint_values("torque_limit")[:3]) == limits
    np.testing.assert_array_equal(model.actuator_forcerange[:3, 1], limits)


def test_shank_motors_are_the_papers() -> None:
    """Table III."""
    saturn, go1 = find_robot("saturn_lite").shank, find_robot("go1").shank
    assert (saturn.armature, saturn.damping, saturn.frictionloss) == (0.0145, 0.0704, 0.442)
    assert (go1.armature, go1.damping, go1.frictionloss) == (0.0121, 0.0342, 0.0481)


@pytest.mark.parametrize("name", robot_names())
def test_model_follows_the_specification(name: str) -> None:
    """Order and physics of the joints: a swapped joint would train a policy for another robot."""
    spec, model = find_robot(name), build_model(find_robot(name))
    assert tuple(model.actuator(i).name for i in range(model.nu)) == spec.joint_names
    assert tuple(model.joint(i + 1).name for i in range(model.nu)) == spec.joint_names
    np.testing.assert_array_equal(model.dof_armature[6:], spec.joint_values("armature"))
    np.testing.assert_array_equal(model.dof_frictionloss[6:], spec.joint_values("frictionloss"))
    np.testing.assert_array_equal(model.jnt_range[1:, 0], spec.joint_values("lower"))


@pytest.mark.parametrize("name", robot_names())
def test_robot_stands_by_itself(name: str) -> None:
    """Without friction and without a policy it stays up, on all feet, level within 0.1 rad."""
    fleet = Fleet(find_robot(name), 1)
    for _ in range(100):
        fleet.step()
    assert not fleet.fallen()[0]
    assert fleet.foot_contact.all()
    assert abs(fleet.base_quaternion[0, 2]) < 0.05
    assert fleet.foot_force[0].sum() == pytest.approx(9.81 * fleet.spec.mass, rel=0.02)


@pytest.mark.parametrize("name", ["saturn_lite", "go1"])
def test_the_trunk_carries_its_mass_in_its_middle(name: str) -> None:
    """An explicit inertia without a position is put by MuJoCo at the height of the body: a robot that is top-heavy."""
    model = build_model(find_robot(name))
    assert model.body("base").ipos == pytest.approx([0.0, 0.0, 0.0])


def test_box_inertia_by_hand() -> None:
    """12 kg, 1 x 2 x 3 m: m/12 (y² + z², x² + z², x² + y²)."""
    np.testing.assert_allclose(box_inertia(12.0, (1.0, 2.0, 3.0)), [13.0, 10.0, 5.0])


def test_a_robot_of_ones_own_touches_no_other_file(monkeypatch: pytest.MonkeyPatch) -> None:
    """Named as module:VARIABLE, an eight-legged robot builds and simulates."""
    from stiction.robots.model import LegSpec

    go1 = find_robot("go1")
    legs = [LegSpec(f"L{i}", (0.5 - 0.3 * i, 0.05, 0.0), i % 2) for i in range(4)]
    legs += [LegSpec(f"R{i}", (0.5 - 0.3 * i, -0.05, 0.0), 1 - i % 2) for i in range(4)]
    module = types.ModuleType("my_robots")
    module.SPIDER = dataclasses.replace(go1, name="spider", legs=tuple(legs))
    monkeypatch.setitem(sys.modules, "my_robots", module)
    fleet = Fleet(find_robot("my_robots:SPIDER"), 2)
    fleet.step()
    assert fleet.joint_position.shape == (2, 24)


@pytest.mark.parametrize("name", ["nobody", "no.such.module", "stiction.robots.go1:NOTHING"])
def test_unknown_robots_are_named_in_one_line(name: str) -> None:
    """The message says what was asked for."""
    with pytest.raises(StictionError, match="robot"):
        find_robot(name)


def test_a_variation_by_hand() -> None:
    """Gains kp times 4 and kd times 2 keep kd / (2 sqrt(kp J)); the torque limits double; everything else stays."""
    plain, varied = find_robot("go1"), find_robot("go1@kp=4,torque=2")
    for name, factor in (("stiffness", 4.0), ("derivative", 2.0), ("torque_limit", 2.0), ("armature", 1.0)):
        np.testing.assert_allclose(varied.joint_values(name), factor * plain.joint_values(name))
    assert varied.name == "go1@kp=4,torque=2" and varied.base == plain.base


@pytest.mark.parametrize(
    "name", ["go1@", "go1@kd=2", "go1@kp=0", "go1@kp=nan", "go1@kp=1e3", "go1@kp=2,kp=3", "no@kp=2"]
)
def test_a_variation_that_is_none_is_refused(name: str) -> None:
    """An experiment would run with the gains that it meant to vary."""
    with pytest.raises(StictionError, match="robot"):
        find_robot(name)


def test_impossible_robots_are_refused() -> None:
    """A standing pose outside the limits, one contact group only, legs of one name."""
    go1 = find_robot("go1")
    with pytest.raises(StictionError, match="standing"):
        dataclasses.replace(go1, hip=dataclasses.replace(go1.hip, standing=2.0))
    with pytest.raises(StictionError, match="group"):
        dataclasses.replace(go1, legs=tuple(dataclasses.replace(leg, group=0) for leg in go1.legs))
    with pytest.raises(StictionError, match="different names"):
        dataclasses.replace(go1, legs=(go1.legs[0], go1.legs[0]))
