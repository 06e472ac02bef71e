"""The audit of the randomisation: it passes for the robots that ship, and catches what it is there to catch."""

import dataclasses
from typing import Any

import numpy as np
import pytest
import torch

from stiction.joints.friction import LAWS
from stiction.robots.catalog import find_robot
from stiction.sim.fleet import Fleet, JointFriction
from stiction.task import audit
from stiction.task.config import TaskCfg
from stiction.task.friction import FrictionCfg
from stiction.task.randomization import NUMBERS, Randomizer
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


@pytest.mark.parametrize("joints", [slice(None), slice(5, 6)])
def test_a_coefficient_of_load_that_reaches_no_joint_is_caught(monkeypatch: pytest.MonkeyPatch, joints: slice) -> None:
    """Its draws fill their range, and no joint, or all but one, has the friction."""
    whole = JointFriction.set_level

    def set_level(self: JointFriction, *levels: np.ndarray, **more: Any) -> None:
        law, load = levels
        load = np.broadcast_to(load, law.shape).copy()
        load[:, joints] = 0.0
        whole(self, law, load, **more)

    monkeypatch.setattr(JointFriction, "set_level", set_level)
    rows = audit.audit_friction(audit.Stand(find_robot("go1"), BESIDE))
    assert list(failed(rows)) == ["load_coefficient"]
    brakes = next(row for row in rows if row.parameter == "load_coefficient" and "brakes" in row.quantity)
    assert brakes.verdict == "DOES NOTHING"


RISING = FrictionCfg(level=0.1, law="stribeck", static_ratio=(1.2, 1.8), stribeck_velocity=(0.05, 0.3))


@pytest.mark.parametrize("reaches", [True, False])
def test_a_rise_at_rest_that_is_drawn_acts_or_is_caught(monkeypatch: pytest.MonkeyPatch, reaches: bool) -> None:
    """With the highest ratio and speed of the ranges, and not with the middle that all robots would have."""
    if not reaches:
        whole = JointFriction.set_level
        monkeypatch.setattr(JointFriction, "set_level", lambda law, *levels, ids, numbers: whole(law, *levels, ids=ids))
    rows = audit.audit_friction(audit.Stand(find_robot("go1"), TaskCfg("go1", friction=RISING)))
    wrong = {row.quantity.split(": ")[1].partition(",")[0] for row in rows if not row.ok}
    # 0.9 of 1.8 times the level is more than 1.5 times it.
    assert wrong >= {"holds below its bound", "torque of break-away"} if not reaches else wrong == set()
    spans = [row for row in audit.audit_env(TaskCfg("go1", friction=RISING)) if row.parameter in NUMBERS]
    assert [row.parameter for row in spans] == [*NUMBERS] and all(row.ok for row in spans)


def test_a_delay_that_never_reaches_the_motor_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawn, but zero in the model."""
    mutate(monkeypatch, "action_delay", 0)
    assert list(failed(audit.audit_joints(audit.Stand(find_robot("go1"), TASK)))) == ["action_delay"]


def test_share_by_hand() -> None:
    """<measured, expected> / <expected, expected>: half the effect is 0.5, a formula without effect has no share."""
    assert audit.effect_share(np.array([1.0, 2.0]), np.array([2.0, 4.0])) == 0.5
    assert np.isnan(audit.effect_share(np.array([1.0]), np.array([0.0])))
    assert audit.effect_share(np.array([[1.0], [0.2], [1.1]]), np.ones((3, 1))) == 0.2
