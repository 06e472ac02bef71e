"""What is written for MuJoCo is what MuJoCo then simulates."""

from __future__ import annotations

import re

import pytest

from motors import joint, number
from stiction.core.errors import StictionError
from stiction.exchange.mujoco import FRICTION_D0, mujoco_snippet, patch_mujoco
from stiction.exchange.urdf import parse_markup

mujoco = pytest.importorskip("mujoco")

MODEL = """<mujoco model="leg">
  <!-- a comment -- no, a joint: <joint name="hip" damping="7"/> -->
  <option timestep="0.004"/>
  <default>
    <joint damping="2" frictionloss="0.1"/>
    <default class="knee"><joint range="-2 2"/></default>
    <default class="rail"><joint type="slide" axis="0 0 1"/></default>
  </default>
  <worldbody>
    <body name="thigh">
      <joint name='hip'   axis="0 1 0"
             damping='5' />
      <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="1"/>
      <body name="shank" pos="0 0 -0.2" childclass="knee">
        <joint name="knee" axis="0 1 0"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.5"/>
      </body>
    </body>
    <body name="cart" childclass="rail"><joint name="rail"/><geom size="0.1"/></body>
  </worldbody>
  <equality><joint name="couple" joint1="hip" joint2="knee" active="false"/></equality>
</mujoco>
""".replace("comment -- no", "comment, no")


def test_a_patched_model_compiles_to_the_identified_numbers() -> None:
    """Damping, friction, armature and the solver's settings of the two hinges; the slide keeps its own."""
    done = patch_mujoco(parse_markup(MODEL.encode(), "leg.xml"), [joint("hip"), joint("knee", inertia=None)], None)
    model = mujoco.MjModel.from_xml_string(done.text)
    assert model.dof_damping.ravel()[:2] == pytest.approx([0.07, 0.07])
    assert list(model.dof_frictionloss) == pytest.approx([0.4, 0.4, 0.1])
    assert list(model.dof_armature) == pytest.approx([0.03, 0.0, 0.0])
    assert model.dof_solref[:2, 0] == pytest.approx([0.008, 0.008]) and model.dof_solref[2, 0] == 0.02
    assert model.dof_solimp[:2, 0] == pytest.approx([FRICTION_D0, FRICTION_D0])
    assert done.joints == {"hip": "motor", "knee": "motor"}


def test_everything_else_stays_byte_for_byte() -> None:
    """Without the new comment and the two tags, the documents are the same."""
    done = patch_mujoco(parse_markup(MODEL.encode(), "leg.xml"), [joint("hip"), joint("knee")], None)
    text = re.sub(r"\n<!--\n  written by.*?-->", "", done.text, count=1, flags=re.DOTALL)
    tags = (r"<joint name='hip'[^>]*/>", r'<joint name="knee"[^>]*/>')
    for tag in tags:
        (new,), (old,) = re.findall(tag, text), re.findall(tag, MODEL)
        text = text.replace(new, old)
    assert text == MODEL
    assert '<joint name=\'hip\'   axis="0 1 0"\n             damping="0.07" frictionloss' in done.text


def test_a_damping_that_stood_for_the_controller_is_noticed() -> None:
    """5 of the joint itself, 2 of its default class: both are far more than 0.07."""
    done = patch_mujoco(parse_markup(MODEL.encode(), "leg.xml"), [joint("hip"), joint("knee")], None)
    noticed = [note for note in done.notes if "kd, give that to the actuator" in note]
    assert len(noticed) == 2 and "was 5" in noticed[0] and "was 2" in noticed[1]
    near = patch_mujoco(parse_markup(MODEL.encode(), "leg.xml"), [joint("hip", viscous_friction=number(4.0))], None)
    assert not any("give that to the actuator" in note for note in near.notes)


def test_an_axis_has_to_fit_its_joint() -> None:
    """The rail's type comes from its class."""
    markup = parse_markup(MODEL.encode(), "leg.xml")
    with pytest.raises(StictionError, match=r"'rail' is of type slide.*rotary"):
        patch_mujoco(markup, [joint("rail")], None)
    with pytest.raises(StictionError, match=r"'hip' is of type hinge.*linear"):
        patch_mujoco(markup, [joint("hip", axis="linear")], None)
    done = patch_mujoco(markup, [joint("rail", axis="linear")], None)
    assert mujoco.MjModel.from_xml_string(done.text).dof_frictionloss[2] == pytest.approx(0.4)


def test_the_friction_holds_below_its_limit_and_gives_way_above() -> None:
    """Ninety per cent of it for one second moves the joint by less than a milliradian; 110 % accelerates as it must.

    0.04 N m on 0.03 kg m2 of armature and 0.01 of link, less damping: 0.04/0.07 (1 - exp(-t 0.07/0.04)) rad/s.
    """
    base = (
        '<mujoco><option timestep="0.004" integrator="implicitfast" gravity="0 0 0"/><worldbody><body>'
        '<joint name="knee" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/></body>'
        '</worldbody><actuator><motor joint="knee"/></actuator></mujoco>'
    )
    done = patch_mujoco(parse_markup(base.encode(), "one.xml"), [joint("knee")], None)
    model = mujoco.MjModel.from_xml_string(done.text)
    moved = {}
    for torque in (0.36, 0.44):
        data = mujoco.MjData(model)
        data.ctrl[0] = torque
        for _ in range(250):
            mujoco.mj_step(model, data)
        moved[torque] = (data.qpos[0], data.qvel[0])
    assert abs(moved[0.36][0]) < 1e-3
    assert moved[0.44][1] == pytest.approx(0.04 / 0.07 * (1 - 2.718281828 ** (-0.07 / 0.04)), rel=0.03)


def test_a_snippet_is_a_default_class_that_compiles() -> None:
    """Pasted into a model, a joint of that class has the numbers; the timestep is the caller's."""
    done = mujoco_snippet([joint("shank")], 0.005)
    body = "<worldbody><body><joint class='shank_identified'/><geom size='1'/></body></worldbody>"
    whole = f"<mujoco>{done.text}{body}</mujoco>"
    model = mujoco.MjModel.from_xml_string(whole)
    assert model.dof_frictionloss[0] == pytest.approx(0.4) and model.dof_solref[0, 0] == pytest.approx(0.01)
    with pytest.raises(StictionError, match="does not fit"):
        mujoco_snippet([joint('a"b')], None)
