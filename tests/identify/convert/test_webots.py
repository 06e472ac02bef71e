"""Fields for Webots, with the warning that they need torque control."""

from __future__ import annotations

import pytest

from stiction.formats.errors import StictionError
from stiction.formats.joints import Estimate, JointRecord
from stiction.identify.convert.physics import JointPhysics, joint_physics
from stiction.identify.convert.webots import webots_snippet


def joint(name: str, **changes) -> JointPhysics:
    """A motor from the bench, for the joint `name`."""
    numbers = {"inertia": 0.03, "viscous_friction": 0.07, "coulomb_friction": 0.4}
    values = {key: Estimate(value, 1e-9, (value, value)) for key, value in numbers.items()}
    return joint_physics("motor", JointRecord(**(values | {"test_condition": "bare_motor"} | changes)), name)


def lines(text: str) -> list[str]:
    """Return what is not comment."""
    return [line for line in text.splitlines() if not line.startswith("#")]


def test_the_fields_are_those_of_hinge_joint_parameters() -> None:
    """Friction and damping, one block a joint; what is null is left out."""
    done = webots_snippet([joint("hip"), joint("knee", coulomb_friction=None)])
    assert lines(done.text) == [
        "jointParameters HingeJointParameters {",
        "  staticFriction 0.4",
        "  dampingConstant 0.07",
        "}",
        "jointParameters HingeJointParameters {",
        "  dampingConstant 0.07",
        "}",
    ]


def test_what_webots_ignores_is_said() -> None:
    """Friction without torque control, and the rotor."""
    notes = " ".join(webots_snippet([joint("hip")]).notes)
    assert "only under torque control" in notes and "no rotor inertia: 0.03" in notes


def test_a_linear_axis_is_refused() -> None:
    """Newtons are no hinge's."""
    with pytest.raises(StictionError, match="linear"):
        webots_snippet([joint("rail", axis="linear")])


def test_a_name_stays_in_its_comment() -> None:
    """A line break would put it into the world."""
    assert len(lines(webots_snippet([joint("a\nRobot {}")]).text)) == 4
