"""`<dynamics>` in a URDF, read back by an XML parser and by MuJoCo."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest

from motors import joint
from stiction.core.errors import StictionError
from stiction.exchange.urdf import parse_markup, patch_urdf

LINK = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'

MODEL = f"""<?xml version="1.0"?>
<robot name="leg">
  <!-- hip and knee -->
  <link name="base"/>
  <link name="thigh">{LINK}</link>
  <link name="shank">{LINK}</link>
  <joint name="hip" type="revolute">
    <parent link="base"/><child link="thigh"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="20" velocity="9"/>
    <dynamics  friction='9' />
  </joint>
  <joint name="knee" type="continuous">
    <parent link="thigh"/><child link="shank"/>
    <axis xyz="0 1 0"/>
  </joint>
  <joint name="foot" type="fixed"><parent link="shank"/><child link="sole"/></joint>
  <link name="sole">{LINK}</link>
  <transmission name="t"><joint name="hip"/></transmission>
</robot>
"""


def test_a_parser_reads_back_what_was_written() -> None:
    """One element was there, one is new; nothing else is different."""
    done = patch_urdf(parse_markup(MODEL.encode(), "leg.urdf"), [joint("hip"), joint("knee")])
    tree = {item.get("name"): item for item in ElementTree.fromstring(done.text).findall("joint")}
    for name in ("hip", "knee"):
        assert [item.attrib for item in tree[name].findall("dynamics")] == [{"damping": "0.07", "friction": "0.4"}]
    assert tree["foot"].find("dynamics") is None
    plain = done.text.replace('<dynamics  friction="0.4" damping="0.07" />', "<dynamics  friction='9' />")
    plain = plain.replace('    <dynamics damping="0.07" friction="0.4"/>\n', "")
    head, _, rest = plain.partition("\n<!--\n  written by")
    assert head + rest.partition("-->")[2] == MODEL


def test_mujoco_reads_it() -> None:
    """MuJoCo's loader reads damping and friction from a URDF."""
    mujoco = pytest.importorskip("mujoco")
    done = patch_urdf(parse_markup(MODEL.encode(), "leg.urdf"), [joint("hip"), joint("knee")])
    model = mujoco.MjModel.from_xml_string(done.text)
    assert list(model.dof_frictionloss) == pytest.approx([0.4, 0.4])
    assert list(model.dof_damping.ravel()[:2]) == pytest.approx([0.07, 0.07])


def test_what_urdf_cannot_hold_is_said() -> None:
    """Notes name the rotor, which a URDF cannot hold; null values stay unchanged."""
    done = patch_urdf(parse_markup(MODEL.encode(), "leg.urdf"), [joint("hip", coulomb_friction=None)])
    assert any("no rotor inertia" in note and "0.03 is left out" in note for note in done.notes)
    assert "<dynamics  friction='9' damping=\"0.07\" />" in done.text
    rotor = joint("hip", coulomb_friction=None, viscous_friction=None)
    assert "<dynamics  friction='9' />" in patch_urdf(parse_markup(MODEL.encode(), "leg.urdf"), [rotor]).text


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("foot", {}, "'foot' is of type fixed.*expected revolute or continuous"),
        ("knee", {"axis": "linear"}, "'knee' is of type continuous.*expected prismatic"),
    ],
)
def test_a_joint_that_does_not_fit_is_refused(name: str, changes: dict, message: str) -> None:
    """Newton metres do not go into a rail."""
    with pytest.raises(StictionError, match=message):
        patch_urdf(parse_markup(MODEL.encode(), "leg.urdf"), [joint(name, **changes)])
