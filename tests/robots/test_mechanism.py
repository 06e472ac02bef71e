"""Robots whose base is held: arms from files as they are, legged robots on a stand, and what is no tree of hinges."""

from __future__ import annotations

from pathlib import Path

import pytest

from stiction.core.errors import RobotError
from stiction.robots.catalog import find_mechanism

ARMS = Path(__file__).parents[1] / "identification" / "limb"

URDF = """<robot name="two"><link name="foot"/>
<joint name="a" type="revolute"><parent link="foot"/><child link="one"/><axis xyz="0 1 0"/>
<limit effort="30" velocity="5" lower="-1" upper="1"/></joint>
<link name="one"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="b" type="continuous"><parent link="one"/><child link="two"/><origin xyz="0 0 0.4"/><axis xyz="1 0 0"/>
<limit effort="12" velocity="5"/></joint>
<link name="two"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
</link></robot>"""


def test_an_arm_is_read_as_it_is() -> None:
    """The pedestal moves nothing, limits come from the file, and a gripper's slide is rigid and said to be so."""
    arm = find_mechanism(str(ARMS / "arm7.xml"))
    assert arm.joint_names == ("j1", "j2", "j3", "j4", "j5", "j6", "j7")
    assert arm.torque_limit == (87.0,) * 4 + (12.0,) * 3
    assert arm.rigid == ("finger",) and arm.links[-1].mass == pytest.approx(1.25)
    assert arm.chain(6) == tuple(range(7)) and arm.gravity[2] == pytest.approx(-9.81)
    six = find_mechanism(str(ARMS / "arm6.xml"))
    assert sum(link.mass for link in six.links) == pytest.approx(15.1)


def test_a_urdf_arm_and_what_a_robot_yaml_says_of_it(tmp_path: Path) -> None:
    """An arm's root is fixed to the world, which a legged robot's is not; the yaml's torque limit goes first."""
    (tmp_path / "two.urdf").write_text(URDF)
    assert find_mechanism(str(tmp_path / "two.urdf")).torque_limit == (30.0, 12.0)
    (tmp_path / "robot.yaml").write_text("model: two.urdf\njoints: {a: {torque_limit: 40}}\npose: {b: 0.5}\n")
    mechanism = find_mechanism(str(tmp_path / "robot.yaml"))
    assert mechanism.torque_limit == (40.0, 12.0) and mechanism.rest == (0.0, 0.5)
    assert mechanism.links[1].origin == pytest.approx((0, 0, 0.4))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("<mujoco><worldbody><body><geom size='1'/></body></worldbody></mujoco>", "no hinge"),
        (
            "<mujoco><worldbody><body name='a'><joint name='x'/><geom size='1'/><body name='b'><joint name='y'/>"
            "<geom size='1'/></body></body></worldbody><equality><weld name='loop' body1='b'/></equality></mujoco>",
            "closes a loop",
        ),
        ("<mujoco><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>", "a name of its own"),
        ("<mujoco><oops/></mujoco>", "MuJoCo cannot read it"),
    ],
)
def test_what_is_no_tree_of_named_hinges_is_refused(tmp_path: Path, content: str, message: str) -> None:
    """One sentence each; a mechanism made up from half a file would give friction that is wrong."""
    (tmp_path / "odd.xml").write_text(content)
    with pytest.raises(RobotError, match=message):
        find_mechanism(str(tmp_path / "odd.xml"))
