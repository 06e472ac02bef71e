"""Torques, gains and inertias of actuators at a joint equal MuJoCo's."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from quads import JOINTS, quad
from stiction.robots.load import load_mechanism, load_robot
from stiction.robots.motors import armature, damping, gains, torque_limit, unread
from stiction.robots.physics import PhysicsCfg
from stiction.robots.record import Derived
from stiction.robots.sliders import weak_friction

LINK = """<mujoco><worldbody><body><joint name="j" axis="0 1 0" {joint}/><geom size=".1" mass="1" pos=".1 0 0"/></body>
</worldbody><actuator>{actuators}</actuator></mujoco>"""


def model(joint: str = "", *actuators: str) -> mujoco.MjModel:
    """Return a link on one joint."""
    return mujoco.MjModel.from_xml_string(LINK.format(joint=joint, actuators="".join(actuators)))


def loaded(tmp_path: Path, text: str) -> Derived:
    """Return the robot of a file."""
    (tmp_path / "quad.xml").write_text(text)
    return load_robot(tmp_path / "quad.xml")


def simulated(joint: str, *actuators: str) -> tuple[float, float]:
    """Return inertia [kg m²] and damping torque at 1 rad/s [N m], by MuJoCo, of the link less a plain one."""
    values = []
    for compiled in (model(joint, *actuators), model()):
        data, inertia = mujoco.MjData(compiled), np.zeros((1, 1))
        data.qvel[0] = 1.0
        mujoco.mj_forward(compiled, data)
        mujoco.mj_fullM(compiled, data, inertia)
        values.append((inertia[0, 0], -data.qfrc_passive[0]))
    return values[0][0] - values[1][0], values[0][1] - values[1][1]


@pytest.mark.parametrize(
    ("joint", "actuators"),
    [
        ('armature="0.002"', ['<motor joint="j" gear="10" armature="0.0001" damping="0.01"/>']),
        (
            "",
            ['<motor joint="j" gear="-3" armature="0.1"/>', '<position joint="j" kp="1" damping="2" armature=".01"/>'],
        ),
        ('damping="0.3"', ['<motor jointinparent="j" gear="2" armature="0.5"/>']),
        ('damping="0.3"', ['<pid joint="j" kp="3" input="pos vel"/>', '<motor joint="j" gear="4" damping="0.5"/>']),
    ],
)
def test_inertia_and_damping_are_those_of_the_simulation(joint: str, actuators: list[str]) -> None:
    """Gear squared times the actuator's, beside the joint's own; actuators with two controls shift no number."""
    compiled = model(joint, *actuators)
    assert (armature(compiled, 0), damping(compiled, 0)[0]) == pytest.approx(simulated(joint, *actuators))


def test_a_robot_has_the_inertia_at_its_actuators(tmp_path: Path) -> None:
    """0.002 + 10² 0.0001 = 0.012 kg m², and kp = 0.012 (2π 10 Hz)²; alone at the actuator it is not missing."""
    geared = '<motor gear="10" ctrlrange="-3 3" armature="0.0001"'
    both = loaded(tmp_path, quad('armature="0.002"', geared))
    assert both.robot.joint_values("armature") == pytest.approx([0.012] * 12)
    assert both.robot.joint_values("kp") == pytest.approx([0.012 * (20 * np.pi) ** 2] * 12)
    origin = next(o for o in both.origins if o.field == "armature")
    assert "actuator" in origin.source
    alone = loaded(tmp_path, quad("", geared)).robot
    assert alone.joint_values("armature") == pytest.approx([0.010] * 12)
    assert load_mechanism(tmp_path / "quad.xml").armature == pytest.approx([0.010] * 12)


def test_damping_at_an_actuator_is_a_claim_as_that_of_a_joint(tmp_path: Path) -> None:
    """10² 0.01 = 1 N m s/rad; powers of the speed are named."""
    notes = loaded(tmp_path, quad(actuator='<motor gear="10" ctrlrange="-3 3" damping="0.01"')).notes
    assert any("claims damping (hip 1, thigh 1, calf 1 N m s/rad)" in note for note in notes)
    notes = loaded(tmp_path, quad('armature="0.01" damping="0.2 0.1 0"')).notes
    assert any("claims damping (hip 0.2 and powers of the speed" in note for note in notes)


def test_servos_and_their_limits_are_read() -> None:
    """position, pid and the controller of a dcmotor ask for the same torque; a voltage or an angle is no torque."""
    position = model("", '<position joint="j" gear="2" kp="3" kv="0.5" forcerange="-7 7"/>')
    pid = model("", '<pid joint="j" gear="2" kp="3" kv="0.5" input="pos vel ff" ffrange="-1 1" forcerange="-7 7"/>')
    drive = 'motorconst=".1" resistance="2" input="pos" controller="3 0 .5" saturation="7 0 0"'
    dcmotor = model("", f'<dcmotor joint="j" gear="2" {drive}/>')
    for compiled in (position, pid, dcmotor):
        assert gains(compiled, 0) == (12.0, 2.0)
        assert torque_limit(compiled, 0)[0] == 14.0
    voltage = model("", '<dcmotor joint="j" motorconst="0.1" resistance="2" ctrlrange="-24 24"/>')
    assert torque_limit(voltage, 0)[0] == 0.0 and gains(voltage, 0) == (0.0, 0.0)
    rate = model("", '<general joint="j" dyntype="integrator" gainprm="3" ctrlrange="-5 5"/>')
    assert torque_limit(rate, 0)[0] == 0.0
    assert torque_limit(model("", '<motor joint="j" gear="2" ctrlrange="-5 5"/>'), 0)[0] == 10.0


@pytest.mark.parametrize(
    ("actuator", "message"),
    [
        ('<motor joint="j" name="m" delay="0.01" nsample="6"/>', "m delay their control"),
        ('<position joint="j" name="m" kp="1" timeconst="0.1"/>', "m filter or integrate"),
        ('<pid joint="j" name="m" kp="1" ki="2"/>', "m have an integral gain"),
        ('<dcmotor joint="j" name="m" motorconst=".1" resistance="2"/>', "m are dcmotors"),
        ('<motor joint="j" name="m"/>', ""),
    ],
)
def test_what_is_not_read_is_named(actuator: str, message: str) -> None:
    """One sentence for each kind, none for a plain motor."""
    notes = list(unread(model("", actuator)))
    assert len(notes) == bool(message) and all(message in note for note in notes)


def test_a_budget_under_which_friction_slips_is_named(tmp_path: Path) -> None:
    """Names a budget that is too small, in the file's <option> and in a task's rows; MuJoCo's default is enough."""
    low = loaded(tmp_path, quad(option='iterations="10" ls_iterations="20"'))
    assert any("expected at least 20 and 50" in note for note in low.notes)
    plain = loaded(tmp_path, quad())
    assert not any("ls_iterations" in note for note in plain.notes)
    rotors = plain.robot.joint_values("armature")
    assert "iterations 5" in (weak_friction(plain.robot, PhysicsCfg(iterations=5), 0.005, rotors) or "")
    assert weak_friction(plain.robot, PhysicsCfg(), 0.005, rotors) is None


def test_springs_of_any_power_are_named(tmp_path: Path) -> None:
    """stiffness="0 0 5" holds as a spring does."""
    notes = loaded(tmp_path, quad('armature="0.01" stiffness="0 0 5"')).notes
    assert any(f"springs at {JOINTS[0]}" in note for note in notes)
