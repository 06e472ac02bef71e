"""Measurements of `stiction doctor --mjlab`: draws with and without effect, joints that hold or creep."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("mjlab", reason="the package mjlab is not installed here; `make test-mjlab` makes its environment")

from mjlab.entity import EntityArticulationInfoCfg
from mjlab.envs.mdp import dr
from mjlab.managers.event_manager import EventTermCfg, requires_model_fields
from mjlab.managers.scene_entity_config import SceneEntityCfg
from mjlab.tasks.registry import list_tasks, register_mjlab_task

from mjlab_leg import leg_cfg, made
from stiction.cli.main import main
from stiction.files.joints import write_training
from stiction.mjlab import (
    DrawFriction,
    IdentifiedActuatorCfg,
    audit_draws,
    audit_hold,
    friction_events,
    friction_law_event,
)

ROBOT = SceneEntityCfg("robot", joint_names=(".*",))
TRAINING = {"friction": {"method": "deception", "level": 0.2, "law": "coulomb", "per": "robot"}, "range": [0.1, 0.24]}


def event(func: Any, mode: str = "startup", **params: Any) -> EventTermCfg:
    """Return an event of both joints."""
    return EventTermCfg(func=func, mode=mode, params={"asset_cfg": ROBOT, **params})


def forgotten(env: Any, env_ids: Any, asset_cfg: Any) -> None:
    """Draw armature without naming the field: all worlds share its memory."""
    drawn = env.sim.model.dof_armature[0].new_empty(env.num_envs, 2).uniform_(0.01, 0.02)
    for world in range(env.num_envs):
        env.sim.model.dof_armature[world] = drawn[world]


@requires_model_fields("dof_damping")
def twice(env: Any, env_ids: Any, asset_cfg: Any) -> None:
    """Draw damping of the second joint alone."""
    env.sim.model.dof_damping[env_ids, 1] = env.sim.model.dof_damping[env_ids, 1].uniform_(0.1, 0.2)


@requires_model_fields("dof_damping")
def idle(env: Any, env_ids: Any, asset_cfg: Any) -> None:
    """Name a field, and leave it as it is."""


@requires_model_fields("dof_damping", "dof_solref")
def constant(env: Any, env_ids: Any, asset_cfg: Any) -> None:
    """Write numbers that are no draw."""
    env.sim.model.dof_damping[env_ids, 1] = 0.15
    env.sim.model.dof_solref[env_ids, :, 0] = 0.01


def test_draws_of_mjlab_act_and_are_in_their_ranges() -> None:
    """Joints, gains, limits, masses, delays; values are compared as the configuration says them."""
    cfg = leg_cfg(num_envs=8)
    cfg.events = {
        "armature": event(dr.joint_armature, "reset", ranges=(0.8, 1.2), operation="scale"),
        "damping": event(dr.joint_damping, ranges={"hip_joint": (0.1, 0.2), "shank_.*": (0.3, 0.4)}),
        "gains": event(dr.pd_gains, kp_range=(0.9, 1.1), kd_range=(0.5, 1.5)),
        "limits": event(dr.effort_limits, "reset", effort_limit_range=(0.7, 1.0)),
        "mass": event(dr.pseudo_inertia, alpha_range=(-0.1, 0.1)),
        "com": event(dr.body_com_offset, ranges={0: (-0.02, 0.02), 2: (0.0, 0.01)}),
        "encoder": event(dr.encoder_bias, bias_range=(-0.015, 0.015)),
    }
    for actuator in cfg.scene.entities["robot"].articulation.actuators:
        actuator.delay_max_lag = 3
    env = made(cfg)
    before = env.sim.model.dof_damping[:].clone()
    rows = {(row.event, row.quantity): row for row in audit_draws(env)}
    assert {row.verdict for row in rows.values()} == {"acts"}
    declared = {key: row.declared for key, row in rows.items() if row.declared is not None}
    assert declared.pop(("mass", "body_mass / default")) == pytest.approx((0.8187, 1.2214), abs=1e-4)
    assert declared == {
        ("armature", "dof_armature / default"): (0.8, 1.2),
        ("damping", "dof_damping of hip_joint"): (0.1, 0.2),
        ("damping", "dof_damping of shank_.*"): (0.3, 0.4),
        ("gains", "kp / default"): (0.9, 1.1),
        ("gains", "kd / default"): (0.5, 1.5),
        ("limits", "effort limit / default"): (0.7, 1.0),
        ("com", "body_ipos[0] - default"): (-0.02, 0.02),
        ("com", "body_ipos[2] - default"): (0.0, 0.01),
        ("encoder", "encoder_bias"): (-0.015, 0.015),
        ("(actuator)", "delay of hip_joint ... [physics steps]"): (0.0, 3.0),
        ("(actuator)", "delay of shank_joint ... [physics steps]"): (0.0, 3.0),
    }
    assert (env.sim.model.dof_damping[:] == before).all()  # what is drawn at startup stays
    low, high = rows["armature", "dof_armature / default"].seen
    assert 0.8 <= low < 0.85 and 1.15 < high <= 1.2


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_draws_that_do_not_act_are_told() -> None:
    """A multiple of zero, a shared field, one that is left alone, and one that another event writes over."""
    cfg = leg_cfg(num_envs=8)
    cfg.events = {
        "zero": event(dr.joint_friction, ranges=(0.5, 1.5), operation="scale"),
        "forgotten": event(forgotten, "reset"),
        "idle": event(idle, "reset"),
        "lost": event(dr.joint_stiffness, ranges=(1.0, 2.0)),
        "winner": event(dr.joint_stiffness, ranges=(3.0, 4.0)),
    }
    verdicts = {row.event: row.verdict for row in audit_draws(made(cfg))}
    assert verdicts == {
        "zero": "does not act: the same in all worlds and resets: hip_joint, shank_joint",
        "forgotten": "does not act: one value for all worlds",
        "idle": "does not act: the same in all worlds and resets",
        "lost": "does not act: outside its range",
        "winner": "acts",
    }


def test_a_draw_into_memory_that_all_worlds_share_is_no_constant() -> None:
    """Drawn once, as the environment is made, it never changes again; called anew it would."""
    cfg = leg_cfg(num_envs=8)
    cfg.events = {"forgotten": event(forgotten)}
    (row,) = audit_draws(made(cfg))
    assert (row.verdict, row.ok) == ("does not act: the same in all worlds and resets", False)


def test_a_constant_of_ones_own_is_no_failure() -> None:
    """A custom constant is named and passes; a named field that is never written fails."""
    cfg = leg_cfg(num_envs=8)
    cfg.events = {"constant": event(constant, "reset"), "idle": event(idle, "reset")}
    env = made(cfg)
    before = env.sim.model.dof_damping[:].clone(), env.sim.model.dof_solref[:].clone()
    rows = [(row.event, row.quantity, row.verdict, row.ok) for row in audit_draws(env)]
    assert rows == [
        ("constant", "dof_solref", "constant, no range declared", True),
        ("constant", "dof_damping", "constant, no range declared", True),
        ("idle", "dof_damping", "does not act: the same in all worlds and resets", False),
    ]
    assert (env.sim.model.dof_damping[:] == before[0]).all() and (env.sim.model.dof_solref[:] == before[1]).all()


def test_a_draw_of_a_small_part_of_its_range_does_not_act(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A range up to 24 % of the torque limit, drawn up to a millionth."""
    write_training(tmp_path / "training.json", TRAINING | {"range": [0.0, 0.24]})
    cfg = leg_cfg(num_envs=8)
    cfg.events |= friction_events(tmp_path / "training.json")
    env = made(cfg)
    drawn = DrawFriction.__call__
    tiny = {"shares": (0.0, 1e-6)}
    monkeypatch.setattr(DrawFriction, "__call__", lambda *args, **kwargs: drawn(*args, **kwargs | tiny))
    (row,) = audit_draws(env)
    assert not row.ok and row.verdict.startswith("does not act: covers 0.000")


def test_the_friction_law_is_no_draw() -> None:
    """The event of the friction law prepares the actuators; a task with it passes."""
    cfg = leg_cfg(num_envs=8)
    law = IdentifiedActuatorCfg(
        target_names_expr=(".*",), stiffness=20.0, damping=0.5, effort_limit=45.0, coulomb_friction=1.0
    )
    robot = cfg.scene.entities["robot"]
    cfg.scene.entities["robot"] = replace(robot, articulation=EntityArticulationInfoCfg((law,)))
    cfg.events |= friction_law_event()
    env = made(cfg)
    assert audit_draws(env) == []
    rows = audit_hold(env)
    assert len(rows) == 2 and all(row.ok for row in rows)


def test_a_draw_of_ones_own_is_found_where_it_writes() -> None:
    """A custom draw is named where it writes, with an unknown range; an untouched joint is left out."""
    cfg = leg_cfg(num_envs=8)
    cfg.events = {"twice": event(twice, "reset")}
    (row,) = audit_draws(made(cfg))
    assert row.ok and row.declared is None and row.quantity == "dof_damping"
    assert 0.1 <= row.seen[0] < row.seen[1] <= 0.2


@pytest.mark.parametrize(
    ("budget", "verdict"), [((10, 20), "holds in training, not in MuJoCo on the CPU"), ((20, 50), "holds")]
)
def test_friction_as_stiff_as_the_timestep_allows_holds(tmp_path: Path, budget: tuple[int, int], verdict: str) -> None:
    """Friction of `friction_events` holds; mjlab's solver budget is enough for MuJoCo Warp, not for MuJoCo."""
    write_training(tmp_path / "training.json", TRAINING)
    cfg = leg_cfg(num_envs=8)
    cfg.events |= friction_events(tmp_path / "training.json")
    cfg.sim.mujoco.iterations, cfg.sim.mujoco.ls_iterations = budget
    env = made(cfg)
    rows = audit_hold(env)
    friction = env.sim.model.dof_frictionloss[:]
    world = int(friction.sum(dim=1).argmax())
    assert [(row.joint, row.friction) for row in rows] == [
        ("hip_joint", pytest.approx(float(friction[world, 0]))),
        ("shank_joint", pytest.approx(float(friction[world, 1]))),
    ]
    assert all(row.ok and row.verdict == verdict and 0 < row.moved < 5e-3 for row in rows)
    assert audit_hold(made(leg_cfg())) == []


def test_friction_with_mujoco_s_own_rows_creeps() -> None:
    """Friction drawn by mjlab alone: 0.8 of 1 N m moves 0.0245 kg m² by far more than a few milliradians."""
    cfg = leg_cfg(num_envs=2)
    cfg.events = {"friction": event(dr.joint_friction, ranges={"shank_joint": (1.0, 1.0)})}
    (row,) = audit_hold(made(cfg))
    assert (row.joint, row.friction, row.verdict) == ("shank_joint", 1.0, "does not hold")
    assert 0.02 < row.moved < 0.5 and row.moved_in_mujoco == pytest.approx(row.moved, rel=0.05)


@pytest.mark.parametrize(("stiff", "status"), [(True, 0), (False, 1)])
def test_the_verb_tells_both_and_its_status(
    stiff: bool, status: int, tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """JSON and nothing else on standard output; rows that fail are shown, whole in 80 columns, the rest is a line."""
    monkeypatch.setenv("COLUMNS", "80")
    write_training(tmp_path / "training.json", TRAINING)
    cfg, name = leg_cfg(), f"Leg-{stiff}"
    drawn = friction_events(tmp_path / "training.json") if stiff else {}
    cfg.events |= drawn or {"friction": event(dr.joint_friction, ranges=(1.0, 2.0))}
    if name not in list_tasks():
        register_mjlab_task(name, cfg, cfg, None)
    assert main(["doctor", "--mjlab", name, "--json"]) == status
    captured = capsys.readouterr()
    audit = json.loads(captured.out)
    assert audit["task"] == name and audit["ok"] == (not status) and len(audit["holds"]) == 2
    assert all(row["ok"] for row in audit["draws"]) and all(row["ok"] == (not status) for row in audit["holds"])
    assert ("hip_joint does not hold, shank_joint does not hold" in captured.err) == bool(status)
    assert main(["doctor", "--mjlab", name]) == status
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= 80
    assert ({"hip_joint", "shank_joint"} <= {*shown.split()}) == bool(status)


def test_an_unknown_task_is_one_line(capsys: pytest.CaptureFixture) -> None:
    """With the nearest name."""
    assert main(["doctor", "--mjlab", "Mjlab-Velocity-Flat-Unitree-Go2"]) == 1
    assert "unknown task 'Mjlab-Velocity-Flat-Unitree-Go2'; did you mean 'Mjlab-" in capsys.readouterr().err


def test_an_unknown_task_is_all_that_is_told() -> None:
    """A warning of a library at its import is nothing that a user can mend."""
    command = [sys.executable, "-m", "stiction", "doctor", "--mjlab", "Leg"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, env={**os.environ}, check=False)
    assert ended.returncode == 1 and ended.stderr.count("\n") == 1 and "unknown task 'Leg'" in ended.stderr
