"""Fields for Webots, with the warning that they need torque control."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motors import joint
from stiction.core.errors import StictionError
from stiction.exchange.webots_joints import parse_nodes, patch_webots, webots_snippet


def lines(text: str) -> list[str]:
    """Return the lines without comments."""
    return [line for line in text.splitlines() if not line.startswith("#")]


def test_the_fields_are_those_of_hinge_joint_parameters() -> None:
    """Friction and damping, one block a joint; what is null is left out."""
    done = webots_snippet([joint("hip"), joint("knee", coulomb_friction=None)])
    block = "jointParameters HingeJointParameters {", "  dampingConstant 0.07", "}"
    assert lines(done.text) == [block[0], "  staticFriction 0.4", *block[1:], *block]


def test_what_webots_ignores_is_said() -> None:
    """Friction without torque control, and the rotor."""
    notes = " ".join(webots_snippet([joint("hip")]).notes)
    assert "only under torque control" in notes and "no rotor inertia" in notes and "0.03 is left out" in notes


PROTO = """#VRML_SIM R2023b utf8
# a joint: HingeJoint { }
PROTO Leg [ field SFString name "leg {" ] {
  Robot {
    children [
      %< let ü = "{"; >%
      HingeJoint {
        jointParameters DEF HIP HingeJointParameters {
          axis 0 1 0
          staticFriction 9  # old
        }
        device [
          PositionSensor { name "hip_sensor" }
          RotationalMotor { name "hip" maxTorque 20 }
        ]
        endPoint Solid {
          children [
            HingeJoint {
              device RotationalMotor { name "knee" }
              jointParameters HingeJointParameters { axis 0 1 0 }
            }
            HingeJoint { device RotationalMotor { name IS name } jointParameters HingeJointParameters { } }
            HingeJoint {
              jointParameters HingeJointParameters { staticFriction IS rub }
              device [ RotationalMotor { name "foot" } ]
            }
          ]
        }
      }
    ]
  }
}
"""


def test_a_proto_is_changed_at_its_joints_only() -> None:
    """A field that was there, two that were not; what is nested belongs to its own joint."""
    done = patch_webots(PROTO.encode(), "leg.proto", [joint("hip"), joint("knee", viscous_friction=None)])
    first, _, rest = done.text.partition("\n")
    assert first == "#VRML_SIM R2023b utf8"
    body = "\n".join(line for line in rest.splitlines() if line[:2] != "# " or line.startswith("# a joint:"))
    expected = PROTO.partition("\n")[2].rstrip("\n")
    expected = expected.replace("{\n          axis 0 1 0", "{\n          dampingConstant 0.07\n          axis 0 1 0")
    expected = expected.replace("staticFriction 9", "staticFriction 0.4")
    assert body == expected.replace("{ axis 0 1 0 }", "{ staticFriction 0.4 axis 0 1 0 }")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"A {", "brace does not close"),
        (b"A }", "never opened"),
        (b'A { b "c }', "quote does not close"),
        (b'"' + b'\\"' * 100_000, "quote does not close"),
        (b"%<" * 100_000, "template"),
        (b"\xff", "not UTF-8"),
    ],
)
def test_a_broken_file_is_refused_at_once(data: bytes, message: str) -> None:
    """One line, and no time to speak of."""
    with pytest.raises(StictionError, match=message):
        parse_nodes(data, "x.proto")


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(data: bytes) -> None:
    """Only the one error."""
    try:
        nodes = parse_nodes(data, "any")
    except StictionError:
        return
    assert all(node.parent is None or node.parent < index for index, node in enumerate(nodes))
