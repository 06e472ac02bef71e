"""From `joints.json` to a robot's nominal joints: nothing counted twice, nothing made up."""

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.files.joints import Estimate, JointRecord, JointsFile
from stiction.task.randomization import identified_joints

NAMES = ("FL_hip", "FL_shank", "FR_hip", "FR_shank")
LINKS = np.array([0.05, 0.01, 0.05, 0.01])
LIMITS = np.array([20.0, 40.0, 20.0, 40.0])


def number(value: float) -> Estimate:
    """An estimate that is almost certain."""
    return Estimate(value, 1e-9, (value, value))


def shank(**changes) -> JointRecord:
    """A shank on the bench."""
    values = {"inertia": number(0.03), "viscous_friction": number(0.07), "coulomb_friction": number(0.4)}
    return JointRecord(**(values | {"test_condition": "bare_motor"} | changes))


def test_a_kind_stands_for_all_its_joints_and_the_others_stay() -> None:
    """`shank` is both shanks; the hips keep what the robot says."""
    joints = identified_joints(JointsFile({"shank": shank()}), NAMES, LINKS, LIMITS)
    assert joints.armature == (None, 0.03, None, 0.03)
    assert joints.damping == (None, 0.07, None, 0.07) and joints.frictionloss == (None, 0.4, None, 0.4)
    assert joints.warnings == ()


def test_links_are_taken_off_an_inertia_measured_in_the_air() -> None:
    """The simulator adds them again: 0.03 - 0.01."""
    joints = identified_joints(JointsFile({"shank": shank(test_condition="in_air")}), NAMES, LINKS, LIMITS)
    assert joints.armature[1] == pytest.approx(0.02)


@pytest.mark.parametrize("condition", ["loaded", None])
def test_an_inertia_with_an_unknown_load_is_not_used(condition: str | None) -> None:
    """Friction is; and the user is told."""
    joints = identified_joints(JointsFile({"shank": shank(test_condition=condition)}), NAMES, LINKS, LIMITS)
    assert joints.armature == (None,) * 4 and joints.frictionloss[1] == 0.4
    assert len(joints.warnings) == 1 and "inertia" in joints.warnings[0]


def test_friction_that_is_known_as_a_ratio_only_is_that_share_of_the_limit() -> None:
    """A log without torque: 2 % of the shank's 40 N m is 0.8, and the user is told; newton metres go before it."""
    unknown = {"inertia": None, "viscous_friction": None, "coulomb_friction": None}
    joints = identified_joints(
        JointsFile({"shank": shank(friction_ratio=number(0.02), **unknown)}), NAMES, LINKS, LIMITS
    )
    assert joints.frictionloss == (None, pytest.approx(0.8), None, pytest.approx(0.8))
    assert joints.armature == joints.damping == (None,) * 4
    assert len(joints.warnings) == 1 and "'shank'" in joints.warnings[0] and "2 %" in joints.warnings[0]
    both = identified_joints(JointsFile({"shank": shank(friction_ratio=number(0.02))}), NAMES, LINKS, LIMITS)
    assert both.frictionloss[1] == 0.4 and both.warnings == ()
    negative = identified_joints(
        JointsFile({"shank": shank(friction_ratio=number(-0.02), **unknown)}), NAMES, LINKS, LIMITS
    )
    assert negative.frictionloss[1] == 0.0


@pytest.mark.parametrize(
    ("record", "match"),
    [
        (shank(axis="linear"), "linear"),
        (shank(test_condition="in_air", inertia=number(0.005)), r"FL_shank.*0\.005 .*0\.01;"),
        (shank(test_condition="in_air", inertia=number(0.01)), "FL_shank"),
        (shank(inertia=number(-0.01)), "FL_shank.*positive"),
        (shank(inertia=None, viscous_friction=None, coulomb_friction=None), "can be used for"),
    ],
)
def test_what_cannot_be_is_refused(record: JointRecord, match: str) -> None:
    """A line that names the joint or the number."""
    with pytest.raises(StictionError, match=match):
        identified_joints(JointsFile({"shank": record}), NAMES, LINKS, LIMITS)
