"""Friction by speed, motor torque and load in mjlab: a joint holds below the law, and moves as the closed form says."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("mjlab", reason="the package mjlab is not installed here; `make test-mjlab` makes its environment")

import numpy as np
import torch
from mjlab.actuator import BuiltinPositionActuatorCfg, XmlActuatorCfg
from mjlab.entity import EntityArticulationInfoCfg
from scipy.optimize import brentq

from mjlab_leg import leg_cfg, made
from motors import motor, number
from stiction.core.errors import StictionError
from stiction.files.joints import JointsFile, write_training
from stiction.mjlab import IdentifiedActuatorCfg, audit_hold, friction_events, friction_law_event, with_joints

MOVING, REST, SPEED, VISCOUS = 1.0, 1.6, 0.5, 0.4
"""Dry friction in motion and at rest [N m], Stribeck velocity [rad/s], viscous friction [N m s/rad]."""


def actuator(name: str, torque: float, **changes: float) -> IdentifiedActuatorCfg:
    """Return an actuator that gives a constant torque [N m]: the limit of gains that ask for much more."""
    law = {"coulomb_friction": MOVING, "static_friction": REST, "stribeck_velocity": SPEED}
    law |= {"viscous_damping": VISCOUS, "armature": 0.02}
    return IdentifiedActuatorCfg(
        target_names_expr=(f"{name}_joint",),
        stiffness=1e5,
        damping=0.0,
        effort_limit=torque,
        **law | changes,
    )


def speeds(hip: IdentifiedActuatorCfg, shank: IdentifiedActuatorCfg) -> torch.Tensor:
    """Return the speeds of the joints of four robots after 2 s under constant torque [rad/s], shape (4, 2)."""
    cfg = leg_cfg(num_envs=4)
    robot = cfg.scene.entities["robot"]
    cfg.scene.entities["robot"] = replace(robot, articulation=EntityArticulationInfoCfg((hip, shank)))
    cfg.events |= friction_law_event()
    env = made(cfg)
    for _ in range(100):
        env.step(torch.full((4, 2), 1000.0))
    return env.scene["robot"].data.joint_vel.clone()


def steady(torque: float, coefficient: float = 0.0) -> float:
    """Return the speed at which friction is the torque [rad/s]."""

    def over(speed: float) -> float:
        dry = MOVING + (REST - MOVING) * np.exp(-((speed / SPEED) ** 2))
        return torque - coefficient * torque - dry - VISCOUS * speed

    return brentq(over, SPEED, 100.0)


def test_a_joint_holds_at_rest_and_moves_with_the_steady_speed() -> None:
    """1.5 N m are below 1.6, above what brakes in motion: held; 1.8 are above: 0.8 N m less the rest over 0.4."""
    held, moving = speeds(actuator("hip", 1.5), actuator("shank", 1.8)).T
    assert held.abs().max() < 2e-3
    np.testing.assert_allclose(moving, steady(1.8), rtol=5e-3)


def test_friction_grows_with_the_torque_of_the_motor() -> None:
    """A coefficient of 0.2: 1.9 N m are held, for 1.6 + 0.38 is more; 2.4 move."""
    held, moving = speeds(*(actuator(n, t, torque_coefficient=0.2) for n, t in (("hip", 1.9), ("shank", 2.4)))).T
    assert held.abs().max() < 2e-3
    np.testing.assert_allclose(moving, steady(2.4, 0.2), rtol=5e-3)


def test_friction_grows_with_the_load_from_outside() -> None:
    """The weight of 1 kg at 0.1 m, 0.981 N m, reaches the joint; the motor's torque is none of it."""
    from mjlab_leg import spec

    def heavy():
        made = spec()
        for body in made.bodies:
            if body.name in ("hip", "shank"):
                body.ipos = (0.1, 0.0, 0.0)
        return made

    cfg = leg_cfg(num_envs=2)
    cfg.sim.mujoco.gravity = (0.0, 0.0, -9.81)
    joints = tuple(actuator(name, 0.2, load_coefficient=0.5) for name in ("hip", "shank"))
    robot = replace(cfg.scene.entities["robot"], spec_fn=heavy, articulation=EntityArticulationInfoCfg(joints))
    cfg.scene.entities["robot"] = robot
    cfg.events |= friction_law_event()
    env = made(cfg)
    env.step(torch.zeros(2, 2))
    torch.testing.assert_close(env.scene["robot"].actuators[0].load(), torch.full((2, 1), 0.981), atol=1e-3, rtol=0)
    friction = env.sim.model.dof_frictionloss[:]
    torch.testing.assert_close(friction, torch.full((2, 2), REST + 0.5 * 0.981), atol=2e-3, rtol=0)


def test_a_record_becomes_an_actuator(tmp_path: Path) -> None:
    """Friction at rest and in motion, viscous friction, armature, a coefficient; gains, limit and delay stay."""
    law = {"law": "effort", "parameters": {"coulomb_friction": number(0.3).to_dict()}, "regressor": "motor_torque"}
    records = {"hip": motor(load_coefficient=number(0.1), friction_law=law)}
    records["shank"] = motor(static_friction=number(0.6), stribeck_velocity=number(0.05), inertia=None)
    JointsFile(records).write(tmp_path / "joints.json")
    cfg = leg_cfg()
    for before in cfg.scene.entities["robot"].articulation.actuators:
        before.delay_min_lag = before.delay_max_lag = 2
    cfg.sim.njmax = 10
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        with_joints(cfg, tmp_path / "joints.json", friction="law")
    assert not [one for one in told if "is not represented" in str(one.message) or "replaced" in str(one.message)]
    hip, shank = cfg.scene.entities["robot"].articulation.actuators
    assert isinstance(hip, IdentifiedActuatorCfg) and isinstance(shank, IdentifiedActuatorCfg)
    assert (hip.coulomb_friction, hip.torque_coefficient, hip.load_coefficient) == (0.3, 0.1, 0.0)
    assert (shank.static_friction, shank.stribeck_velocity, shank.viscous_damping) == (0.6, 0.05, 0.07)
    assert (hip.armature, shank.armature) == (0.03, 0.02)  # a record without it leaves the configuration's
    assert [(a.stiffness, a.damping, a.effort_limit, a.delay_max_lag) for a in (hip, shank)] == [
        (20.0, 0.5, 20.0, 2),
        (20.0, 0.5, 45.0, 2),
    ]
    assert (cfg.sim.mujoco.iterations, cfg.sim.mujoco.ls_iterations, cfg.sim.njmax) == (20, 50, 12)
    assert "friction_law" in cfg.events


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_an_actuator_with_other_joints_is_split(tmp_path: Path) -> None:
    """The joint that was not identified keeps its actuator; of MuJoCo on the CPU both hold with the raised budget."""
    JointsFile({"shank": motor(static_friction=number(0.6))}).write(tmp_path / "joints.json")
    cfg = leg_cfg()
    both = BuiltinPositionActuatorCfg(target_names_expr=(".*_joint",), stiffness=20.0, damping=0.5, effort_limit=20.0)
    cfg.scene.entities["robot"] = replace(cfg.scene.entities["robot"], articulation=EntityArticulationInfoCfg((both,)))
    with_joints(cfg, tmp_path / "joints.json", joint_map="shank=shank_joint", friction="law")
    env = made(cfg)
    rest, law = env.scene["robot"].actuators
    assert (rest.target_names, law.target_names) == (["hip_joint"], ["shank_joint"])
    assert type(rest.cfg) is BuiltinPositionActuatorCfg and law.cfg.static_friction == 0.6
    (row,) = audit_hold(env)
    assert (row.joint, row.verdict, row.friction) == ("shank_joint", "holds", pytest.approx(0.6, rel=1e-3))


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_what_cannot_follow_the_law_is_refused(tmp_path: Path) -> None:
    """An actuator without gains, and a record without dry friction."""
    JointsFile({"shank": motor()}).write(tmp_path / "joints.json")
    cfg = leg_cfg()
    cfg.scene.entities["robot"] = replace(
        cfg.scene.entities["robot"],
        articulation=EntityArticulationInfoCfg((XmlActuatorCfg(target_names_expr=(".*_joint",)),)),
    )
    with pytest.raises(StictionError, match=r"joint 'hip_joint': got XmlActuatorCfg, expected BuiltinPosition.*gains"):
        with_joints(cfg, tmp_path / "joints.json", joint_map="shank=*_joint", friction="law")
    JointsFile({"shank": motor(coulomb_friction=None)}).write(tmp_path / "joints.json")
    with pytest.raises(StictionError, match=r"record 'shank': got no dry friction, expected one"):
        with_joints(leg_cfg(), tmp_path / "joints.json", friction="law")


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_friction_drawn_under_the_law_is_refused(tmp_path: Path) -> None:
    """Rejects drawn friction, which the law overwrites."""
    JointsFile({"shank": motor()}).write(tmp_path / "joints.json")
    friction = {"method": "deception", "level": 0.2, "law": "coulomb", "per": "robot"}
    write_training(tmp_path / "training.json", {"friction": friction, "range": [0.1, 0.24]})
    cfg = with_joints(leg_cfg(), tmp_path / "joints.json", friction="law")
    cfg.events |= friction_events(tmp_path / "training.json")
    with pytest.raises(StictionError, match=r"friction_events: got joint 'shank_joint' of an IdentifiedActuator"):
        made(cfg)


def test_a_small_budget_of_the_solver_is_told() -> None:
    """The 10 and 20 of mjlab, by a configuration that was written by hand."""
    cfg = leg_cfg()
    joints = tuple(actuator(name, 1.0) for name in ("hip", "shank"))
    cfg.scene.entities["robot"] = replace(cfg.scene.entities["robot"], articulation=EntityArticulationInfoCfg(joints))
    cfg.events |= friction_law_event()
    with pytest.warns(UserWarning, match=r"on the CPU, .* with iterations 10 and ls_iterations 20 MuJoCo's solver"):
        made(cfg)


@pytest.mark.parametrize(
    "changes", [{"coulomb_friction": -1.0}, {"static_friction": 0.5}, {"stribeck_velocity": 0.0}, {"frictionloss": 0.3}]
)
def test_numbers_without_meaning_are_refused(changes: dict[str, float]) -> None:
    """In one sentence that names them."""
    with pytest.raises(StictionError, match="IdentifiedActuatorCfg: got"):
        actuator("hip", 1.0, **changes)


def test_robots_that_share_one_friction_are_refused() -> None:
    """Rejects shared memory: without the event all robots have the last one's friction."""
    cfg = leg_cfg(num_envs=2)
    joints = tuple(actuator(name, 1.0) for name in ("hip", "shank"))
    cfg.scene.entities["robot"] = replace(cfg.scene.entities["robot"], articulation=EntityArticulationInfoCfg(joints))
    with pytest.raises(StictionError, match=r"add cfg.events \|= friction_law_event\(\)"):
        made(cfg)
