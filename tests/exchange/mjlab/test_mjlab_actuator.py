"""Friction by speed, motor torque and load in mjlab: a joint holds below the law, and moves as the closed form says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("mjlab", reason="the package mjlab is not installed here; `make test-mjlab` makes its environment")

import numpy as np
import torch
from mjlab.entity import EntityArticulationInfoCfg
from scipy.optimize import brentq

from mjlab_leg import leg_cfg, made
from motors import motor, number
from stiction.core.errors import StictionError
from stiction.files.joints import JointsFile
from stiction.mjlab import IdentifiedActuatorCfg, friction_law_event, identified_actuator

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
    """Friction at rest and in motion, viscous friction, armature, and a coefficient of what the record says."""
    law = {"law": "effort", "parameters": {"coulomb_friction": number(0.3).to_dict()}, "regressor": "motor_torque"}
    records = {"hip": motor(load_coefficient=number(0.1), friction_law=law)}
    records["shank"] = motor(static_friction=number(0.6), stribeck_velocity=number(0.05))
    JointsFile(records).write(tmp_path / "joints.json")
    given = {"target_names_expr": (".*",), "stiffness": 20.0, "damping": 0.5, "effort_limit": 45.0}
    hip, shank = (identified_actuator(tmp_path / "joints.json", name, **given) for name in ("hip", "shank"))
    assert (hip.coulomb_friction, hip.torque_coefficient, hip.load_coefficient) == (0.3, 0.1, 0.0)
    assert (shank.static_friction, shank.stribeck_velocity, shank.viscous_damping, shank.armature) == (
        0.6,
        0.05,
        0.07,
        0.03,
    )
    with pytest.raises(StictionError, match="unknown joint"):
        identified_actuator(tmp_path / "joints.json", "wrist", **given)


@pytest.mark.parametrize(
    "changes", [{"coulomb_friction": -1.0}, {"static_friction": 0.5}, {"stribeck_velocity": 0.0}, {"frictionloss": 0.3}]
)
def test_numbers_without_meaning_are_refused(changes: dict[str, float]) -> None:
    """In one sentence that names them."""
    with pytest.raises(StictionError, match="IdentifiedActuatorCfg: got"):
        actuator("hip", 1.0, **changes)


def test_robots_that_share_one_friction_are_refused() -> None:
    """Without the event, all of them would have that of the last one."""
    cfg = leg_cfg(num_envs=2)
    joints = tuple(actuator(name, 1.0) for name in ("hip", "shank"))
    cfg.scene.entities["robot"] = replace(cfg.scene.entities["robot"], articulation=EntityArticulationInfoCfg(joints))
    with pytest.raises(StictionError, match=r"add cfg.events \|= friction_law_event\(\)"):
        made(cfg)
