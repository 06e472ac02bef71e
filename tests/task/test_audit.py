"""The audit of the randomisation: it passes for the robots that ship, and catches what it is there to catch."""

import dataclasses

import numpy as np
import pytest
import torch

from stiction.joints.friction import LAWS
from stiction.robots.catalog import find_robot
from stiction.sim.fleet import Fleet
from stiction.sim.friction import JointFriction
from stiction.task import audit
from stiction.task.config import RandomizationCfg, TaskCfg
from stiction.task.friction import FrictionCfg
from stiction.task.randomization import Randomizer
from stiction.task.rewards import RewardCfg

NAMES = {
    *("armature", "damping", "friction", "stiffness", "motor_strength", "ground_friction", "payload", "center_of_mass"),
    *("push_velocity", "action_delay", "encoder_offset", "derived constants"),
}


@pytest.mark.parametrize("robot", ["saturn_lite", "go1", "g1"])
def test_every_randomised_parameter_acts_as_its_formula_says(robot: str) -> None:
    """The rows of the paper's table, and the two that are ours; G1 cannot stand stiff, and its damping is not known."""
    spec = find_robot(robot)
    task = TaskCfg(robot=robot, friction=FrictionCfg(level=0.1), rewards=RewardCfg().for_robot(spec))
    rows = audit.check_randomization(task, spec)
    assert {row.parameter for row in rows} == NAMES
    assert [(row.parameter, row.quantity, row.share) for row in rows if not row.ok] == []


TASK = TaskCfg(robot="go1", friction=FrictionCfg(level=0.1))


def test_a_stiff_joint_is_judged_by_a_step_that_its_motor_can_follow() -> None:
    """The full step would saturate it: then no gain and no inertia shows."""
    go1 = find_robot("go1")
    joints = tuple(dataclasses.replace(joint, kp=6 * joint.kp, kd=4 * joint.kd) for joint in go1.joints)
    stand = audit.Stand(dataclasses.replace(go1, joints=joints), TASK)
    assert (stand.steps < 0.1).any() and failed(audit.audit_joints(stand)) == {}


@pytest.mark.parametrize("method", ["finetune", "iterative", "compensation"])
def test_every_way_to_train_with_friction_passes(method: str) -> None:
    """A schedule that begins without friction, and a command that friction is added to, are no faults: the last stage
    is what is audited.
    """
    cfg = dataclasses.replace(TASK, friction=FrictionCfg(method=method, level=0.1))
    assert failed(audit.audit_env(cfg)) == {}


def failed(rows: list[audit.AuditRow]) -> dict[str, str]:
    """Parameters that did not pass, and why."""
    return {row.parameter: row.verdict for row in rows if not row.ok}


def mutate(monkeypatch: pytest.MonkeyPatch, field: str, columns: slice | int) -> None:
    """Let `Randomizer.apply` forget some columns of one draw: they stay nominal."""
    whole = Randomizer.apply

    def apply(self: Randomizer, ids: torch.Tensor) -> None:
        kept = getattr(self.draws, field).clone()
        nominal = 1.0 if kept.max() > 0.5 else 0.0
        getattr(self.draws, field)[:, columns] = nominal
        whole(self, ids)
        setattr(self.draws, field, kept)

    monkeypatch.setattr(Randomizer, "apply", apply)


def test_a_multiplier_of_zero_is_caught() -> None:
    """A joint whose nominal damping is zero where others have some: the multiplier changes nothing there."""
    go1 = find_robot("go1")
    joints = (dataclasses.replace(go1.joints[0], damping=0.0), *go1.joints[1:])
    rows = audit.audit_joints(audit.Stand(dataclasses.replace(go1, joints=joints), TASK))
    assert list(failed(rows)) == ["damping"] and "CANNOT ACT" in failed(rows)["damping"]


def test_a_value_that_never_reaches_the_simulator_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Gains that are drawn and shown to the critic, but not written."""
    monkeypatch.setattr(Fleet, "set_gains", lambda *_: None)
    rows = audit.audit_joints(audit.Stand(find_robot("go1"), TASK))
    assert failed(rows) == {"stiffness": "DOES NOTHING", "motor_strength": "DOES NOTHING"}


@pytest.mark.parametrize(
    ("field", "columns"), [("armature", 4), ("motor_strength", slice(2, None, 3)), ("damping", 11)]
)
def test_one_dead_joint_is_caught(monkeypatch: pytest.MonkeyPatch, field: str, columns: slice | int) -> None:
    """Pooled over all joints, one that does not react would pass."""
    mutate(monkeypatch, field, columns)
    rows = audit.audit_joints(audit.Stand(find_robot("go1"), TASK))
    assert list(failed(rows)) == [field]


@pytest.mark.parametrize(("law", "level"), [("stribeck", 0.1), ("effort", 0.1), ("load", 0.4)])
def test_every_law_of_friction_acts_as_its_formula_says(law: str, level: float) -> None:
    """It holds below its bound, lets go at it, brakes by its formula above it, and brings a coasting joint to rest."""
    task = TaskCfg(robot="go1", friction=FrictionCfg(level=level, law=law))
    rows = audit.audit_friction(audit.Stand(find_robot("go1"), task))
    assert [row.quantity.partition(": ")[0] for row in rows] == [law] * 4
    assert all(abs(row.share - 1.0) < 0.03 for row in rows), rows


@pytest.mark.parametrize(("law", "wrong"), [("coulomb", {}), ("load", {"smoothing": 1.0})])
def test_a_law_that_does_not_act_is_caught(monkeypatch: pytest.MonkeyPatch, law: str, wrong: dict) -> None:
    """One joint that keeps its nominal friction, 1/1.2 of what was drawn; a load that never reaches the bound."""
    if not wrong:
        mutate(monkeypatch, "friction", 4)
    monkeypatch.setitem(LAWS, law, dataclasses.replace(LAWS[law], **wrong))
    rows = audit.audit_friction(
        audit.Stand(find_robot("go1"), TaskCfg("go1", friction=FrictionCfg(level=0.1, law=law)))
    )
    assert "torque of break-away" in {row.quantity.split(": ")[1].partition(",")[0] for row in rows if not row.ok}


BESIDE = TaskCfg(robot="go1", friction=FrictionCfg(level=0.1, load=(0.0, 0.2)))


def test_a_coefficient_of_load_beside_the_law_acts_as_its_formula_says() -> None:
    """Four rows of each: the law's own friction is put aside while that of the load is measured."""
    rows = audit.audit_friction(audit.Stand(find_robot("go1"), BESIDE))
    names = [(row.parameter, row.quantity.partition(": ")[0]) for row in rows]
    assert names == [("friction", "coulomb")] * 4 + [("load_coefficient", "load")] * 4
    assert all(abs(row.share - 1.0) < 0.03 for row in rows), rows


@pytest.mark.parametrize("joints", [slice(None), slice(5, 6)])
def test_a_coefficient_of_load_that_reaches_no_joint_is_caught(monkeypatch: pytest.MonkeyPatch, joints: slice) -> None:
    """Its draws fill their range, and no joint, or all but one, has the friction."""
    whole = JointFriction.set_level

    def set_level(self: JointFriction, *levels: np.ndarray, ids: np.ndarray) -> None:
        law, load = levels
        load = np.broadcast_to(load, law.shape).copy()
        load[:, joints] = 0.0
        whole(self, law, load, ids=ids)

    monkeypatch.setattr(JointFriction, "set_level", set_level)
    rows = audit.audit_friction(audit.Stand(find_robot("go1"), BESIDE))
    assert list(failed(rows)) == ["load_coefficient"]
    brakes = next(row for row in rows if row.parameter == "load_coefficient" and "brakes" in row.quantity)
    assert brakes.verdict == "DOES NOTHING"


def test_a_delay_that_never_reaches_the_motor_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawn, but zero in the model."""
    mutate(monkeypatch, "action_delay", 0)
    assert list(failed(audit.audit_joints(audit.Stand(find_robot("go1"), TASK)))) == ["action_delay"]


@pytest.mark.parametrize(("axis", "name"), list(enumerate("xyz")))
def test_a_centre_of_mass_that_does_not_move_is_caught(monkeypatch: pytest.MonkeyPatch, axis: int, name: str) -> None:
    """Each axis on its own."""
    mutate(monkeypatch, "center_of_mass", axis)
    rows = audit.audit_body(audit.Stand(find_robot("go1"), TASK))
    assert [row.quantity for row in rows if not row.ok] == [f"moment of gravity, {name}"]


def test_an_encoder_offset_that_the_controller_does_not_see_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """The observation alone is not enough: the joint is held where the encoder says."""
    whole = Fleet.set_targets
    standing = find_robot("go1").joint_values("default_position")
    monkeypatch.setattr(Fleet, "set_targets", lambda fleet, targets: whole(fleet, np.tile(standing, (len(targets), 1))))
    rows = audit.audit_env(TASK)
    assert [row.quantity for row in rows if not row.ok] == ["angle held by the controller"]


def test_a_push_that_does_not_push_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """The interval passes, and nothing happens."""
    monkeypatch.setattr(Fleet, "push", lambda *_: None)
    assert list(failed(audit.audit_env(TASK))) == ["push_velocity"]


def test_a_derived_constant_that_is_not_recomputed_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Masses change, what MuJoCo derives from them does not."""
    monkeypatch.setattr(Fleet, "set_const", lambda *_: None)
    assert "derived constants" in failed(audit.audit_env(TASK))


def test_softer_ground_lets_feet_sink_by_its_formula(monkeypatch: pytest.MonkeyPatch) -> None:
    """As deep as MuJoCo's impedance says; and an end that is not written is caught."""
    soft = dataclasses.replace(TASK, randomization=RandomizationCfg(contact_time=(0.01, 0.03)))
    rows = {row.parameter: row for row in audit.audit_body(audit.Stand(find_robot("go1"), soft))}
    assert rows["contact_time"].share == pytest.approx(1.0, abs=0.03)
    monkeypatch.setattr(Fleet, "set_contact_time", lambda *_: None)
    assert list(failed(audit.audit_body(audit.Stand(find_robot("go1"), soft)))) == ["contact_time"]


def test_ground_friction_that_is_not_applied_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same for a contact parameter."""
    monkeypatch.setattr(Fleet, "set_ground_friction", lambda *_: None)
    assert list(failed(audit.audit_body(audit.Stand(find_robot("go1"), TASK)))) == ["ground_friction"]


def test_share_by_hand() -> None:
    """<measured, expected> / <expected, expected>: half the effect is 0.5, a formula without effect has no share."""
    assert audit.effect_share(np.array([1.0, 2.0]), np.array([2.0, 4.0])) == 0.5
    assert np.isnan(audit.effect_share(np.array([1.0]), np.array([0.0])))
    assert audit.effect_share(np.array([[1.0], [0.2], [1.1]]), np.ones((3, 1))) == 0.2


def test_what_a_task_leaves_out_is_not_audited() -> None:
    """Ranges of no width and no pushes: there is nothing to measure, and no row claims it."""
    narrow = RandomizationCfg.literal()
    narrow = dataclasses.replace(narrow, payload=(0.0, 0.0), center_of_mass=(0.0, 0.0), push_interval=0.0)
    task = TaskCfg(robot="go1", randomization=narrow, friction=FrictionCfg("none"))
    names = {row.parameter for row in audit.check_randomization(task, find_robot("go1"))}
    left_out = {"action_delay", "encoder_offset", "payload", "center_of_mass", "push_velocity", "friction"}
    assert names == NAMES - left_out
