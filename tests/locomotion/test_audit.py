"""The audit of the randomisation: it passes for the robots that ship, and catches what it is there to catch."""

import dataclasses

import numpy as np
import pytest

from stiction.locomotion import audit
from stiction.locomotion.config import FrictionCfg, RandomizationCfg, TaskCfg
from stiction.robots.catalog import find_robot
from stiction.sim.fleet import Fleet

NAMES = {
    *("armature", "damping", "friction", "stiffness", "motor_strength", "ground_friction", "payload", "center_of_mass"),
    *("push_velocity", "action_delay", "encoder_offset", "derived constants"),
}


@pytest.mark.parametrize("robot", ["saturn_lite", "go1"])
def test_every_randomised_parameter_acts_as_its_formula_says(robot: str) -> None:
    """The rows of the paper's table, and the two that are ours."""
    rows = audit.check_randomization(TaskCfg(robot=robot, friction=FrictionCfg(level=0.1)), find_robot(robot))
    assert {row.parameter for row in rows} == NAMES
    assert [(row.parameter, row.quantity, row.share) for row in rows if not row.ok] == []


def test_a_multiplier_of_zero_is_caught() -> None:
    """A robot whose nominal damping is zero: the multiplier changes nothing, and the formula knows it."""
    go1 = find_robot("go1")
    joints = {kind: dataclasses.replace(getattr(go1, kind), damping=0.0) for kind in ("hip", "thigh", "shank")}
    bench = audit.Bench(dataclasses.replace(go1, **joints), RandomizationCfg(), 0.1)
    bad = [row.parameter for row in audit.audit_joints(bench) if not row.ok]
    assert bad == ["damping"]


def test_a_value_that_never_reaches_the_simulator_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Gains that are drawn and shown to the critic, but not written."""
    monkeypatch.setattr(Fleet, "set_gains", lambda *_: None)
    rows = audit.audit_joints(audit.Bench(find_robot("go1"), RandomizationCfg(), 0.1))
    bad = {row.parameter: row.verdict for row in rows if not row.ok}
    assert bad == {"stiffness": "DOES NOTHING", "motor_strength": "DOES NOTHING"}


def test_a_derived_constant_that_is_not_recomputed_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Masses change, what MuJoCo derives from them does not."""
    monkeypatch.setattr(Fleet, "set_const", lambda *_: None)
    rows = audit.audit_env(TaskCfg(robot="go1"))
    assert "derived constants" in {row.parameter for row in rows if not row.ok}


def test_ground_friction_that_is_not_applied_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same for a contact parameter."""
    monkeypatch.setattr(Fleet, "set_ground_friction", lambda *_: None)
    rows = audit.audit_body(audit.Bench(find_robot("go1"), RandomizationCfg(), 0.1))
    assert [row.parameter for row in rows if not row.ok] == ["ground_friction"]


def test_share_by_hand() -> None:
    """<measured, expected> / <expected, expected>: half the effect is 0.5, a formula without effect has no share."""
    assert audit.effect_share(np.array([1.0, 2.0]), np.array([2.0, 4.0])) == 0.5
    assert np.isnan(audit.effect_share(np.array([1.0]), np.array([0.0])))


def test_parameters_that_a_literal_task_leaves_out_are_not_audited() -> None:
    """Without delay and offset there is nothing to measure, and no row claims it."""
    task = TaskCfg(robot="go1", randomization=RandomizationCfg.literal())
    names = {row.parameter for row in audit.check_randomization(task, find_robot("go1"))}
    assert names == NAMES - {"action_delay", "encoder_offset"}
