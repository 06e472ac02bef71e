"""Values written for MuJoCo are the values that MuJoCo simulates."""

from __future__ import annotations

import re

import numpy as np
import pytest

from motors import joint, number
from quads import JOINTS, quad
from stiction.core.errors import StictionError
from stiction.exchange.mujoco import mujoco_snippet, patch_mujoco
from stiction.exchange.physics import Conversion
from stiction.exchange.urdf import parse_markup
from stiction.robots.physics import FRICTION_D0

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


def solved(done: Conversion) -> tuple[np.ndarray, np.ndarray]:
    """Return inertia of a quadruped's joints behind its links' [kg m²], and damping [N m s/rad], by MuJoCo."""
    model = mujoco.MjModel.from_xml_string(done.text)
    plain = mujoco.MjModel.from_xml_string(quad(joint=""))
    values = []
    for each in (model, plain):
        data, inertia = mujoco.MjData(each), np.zeros((each.nv, each.nv))
        data.qvel[6:] = 1.0
        mujoco.mj_forward(each, data)
        mujoco.mj_fullM(each, data, inertia)
        values.append((np.diag(inertia)[6:], data.qfrc_damper[6:].copy()))
    return values[0][0] - values[1][0], values[1][1] - values[0][1]


@pytest.mark.parametrize(
    ("own", "actuator", "default"),
    [
        ('armature="0.002" damping="0.1"', '<motor gear="10" armature="0.0001" damping="0.01"', ""),
        (
            "",
            '<position kp="1" class="m"',
            '<default class="m"><motor gear="3" armature="0.1" damping="1 2 3"/></default>',
        ),
        ("", '<motor damping="0"', '<general damping="1 2 3" armature="0.1"/>'),
        ("", "<motor", '<joint damping="1 2 3"/>'),
        ('damping="5"', "<motor", '<joint damping="1 2 3"/>'),
    ],
)
def test_what_stands_at_the_actuator_is_not_counted_twice(own: str, actuator: str, default: str) -> None:
    """The simulated inertia and damping are the identified ones, 0.03 and 0.07, whatever the file had where."""
    text = quad(joint=own, actuator=actuator).replace("<worldbody>", f"<default>{default}</default><worldbody>")
    done = patch_mujoco(parse_markup(text.encode(), "quad.xml"), [joint(name) for name in JOINTS], None)
    inertia, damping = solved(done)
    assert inertia == pytest.approx(np.full(12, 0.03)) and damping == pytest.approx(np.full(12, 0.07))
    assert any("at the actuators of FL_hip_joint" in note for note in done.notes) == ("armature" in actuator + default)


def test_the_damping_before_counts_that_of_the_actuator() -> None:
    """10² 0.01 = 1 N m s/rad is far more than 0.07."""
    text = quad(actuator='<motor gear="10" damping="0.01"')
    done = patch_mujoco(parse_markup(text.encode(), "quad.xml"), [joint(JOINTS[0])], None)
    assert any("damping was 1, now 0.07" in note for note in done.notes)


def turned(model: mujoco.MjModel, share: float) -> float:
    """Return how far a calf of 2 N m friction turns in 2 s under `share` of it, in the air without weight [rad]."""
    model.opt.gravity[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    calf = model.joint("FL_calf_joint")
    data.qfrc_applied[calf.dofadr[0]] = share * 2.0
    for _ in range(round(2.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    return float(abs(data.qpos[calf.qposadr[0]] + 1.6))


def test_a_budget_under_which_friction_slips_is_raised() -> None:
    """At 10 and 20 a joint under 0.8 of its friction turns by more than 0.1 rad; the written model holds it."""
    option = 'integrator="implicitfast" iterations="10" ls_iterations="20"'
    markup = parse_markup(quad(option=option).encode(), "quad.xml")
    record = {"inertia": number(0.005), "viscous_friction": number(0.0), "coulomb_friction": number(2.0)}
    done = patch_mujoco(markup, [joint(name, **record) for name in JOINTS], None)
    assert any("ls_iterations 20" in note and "expected at least 20 and 50" in note for note in done.notes)
    model = mujoco.MjModel.from_xml_string(done.text)
    assert (model.opt.iterations, model.opt.ls_iterations) == (20, 50)
    assert turned(model, 0.8) < 0.01
    model.opt.iterations, model.opt.ls_iterations = 10, 20
    assert turned(model, 0.8) > 0.1
    enough = patch_mujoco(parse_markup(quad().encode(), "quad.xml"), [joint(JOINTS[0])], None)
    assert "ls_iterations=" not in enough.text


@pytest.mark.parametrize(("flag", "least", "most"), [("disable", 0.1, 1.0), ("enable", 9.99, 10.01)])
def test_a_slide_whose_mass_is_its_rotor_hardly_brakes(flag: str, least: float, most: float) -> None:
    """Friction of 10 N acts as 0.5 N with a body of 1 mg and a rotor of 1 kg; fully with the exact diagonal."""
    body = '<inertial pos="0 0 0" mass="1e-6" diaginertia="1e-6 1e-6 1e-6"/>'
    text = f'<mujoco><option><flag diagexact="{flag}"/></option><worldbody><body><joint name="s" type="slide"/>{body}'
    record = {"inertia": number(1.0), "viscous_friction": number(0.0), "coulomb_friction": number(10.0)}
    slide = joint("s", axis="linear", **record)
    done = patch_mujoco(parse_markup(f"{text}</body></worldbody></mujoco>".encode(), "s.xml"), [slide], None)
    assert any("leaves armature out" in note for note in done.notes)
    model = mujoco.MjModel.from_xml_string(done.text)
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    mujoco.mj_step(model, data)
    assert least < -data.qfrc_constraint[0] < most
