"""Identified joints in mjlab's robots: the values arrive in the compiled model, and the friction holds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("mjlab", reason="the package mjlab is not installed here; `make test-mjlab` makes its environment")

import mujoco
from mjlab.actuator import BuiltinPositionActuatorCfg, XmlActuatorCfg
from mjlab.entity import Entity, EntityArticulationInfoCfg

from mjlab_leg import KP, PERIOD, leg_cfg, made, spec
from motors import motor, number
from stiction.core.errors import StictionError
from stiction.files.joints import Finding, JointsFile
from stiction.mjlab import with_joints


def written(folder: Path, **records: Any) -> Path:
    """Write a joints.json."""
    JointsFile(records).write(folder / "joints.json")
    return folder / "joints.json"


def compiled(cfg: Any) -> mujoco.MjModel:
    """Return the robot of an environment's configuration as mjlab compiles it."""
    return Entity(cfg.scene.entities["robot"]).spec.compile()


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_values_are_in_the_configuration_and_in_the_model(tmp_path: Path) -> None:
    """The values of the other joint, the gains and the shared articulation stay unchanged."""
    before = leg_cfg()
    shared = before.scene.entities["robot"].articulation
    cfg = with_joints(before, written(tmp_path, shank=motor()))
    hip, shank = cfg.scene.entities["robot"].articulation.actuators
    assert cfg is before and hip == shared.actuators[0]
    assert (shank.armature, shank.frictionloss, shank.viscous_damping) == (0.03, 0.4, 0.07)
    assert shared.actuators[1].frictionloss is None and shank.stiffness == KP
    model = compiled(cfg)
    assert model.dof_frictionloss.tolist() == [0.0, 0.4]
    assert model.dof_damping.ravel()[:2].tolist() == [0.0, 0.07]
    assert model.dof_armature.tolist() == [0.02, 0.03]
    assert model.dof_solref[1].tolist() == [2 * PERIOD, 1.0] and model.dof_solimp[1][0] == 0.999
    assert (cfg.sim.mujoco.iterations, cfg.sim.mujoco.ls_iterations) == (20, 50)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_joints_of_one_actuator_that_differ_keep_their_own_values(tmp_path: Path) -> None:
    """Each joint keeps its own values, although one configuration has one number for all its joints."""
    cfg = leg_cfg()
    both = BuiltinPositionActuatorCfg(
        target_names_expr=(".*_joint",), stiffness=KP, damping=0.5, effort_limit=20.0, armature=0.02
    )
    robot = cfg.scene.entities["robot"]
    cfg.scene.entities["robot"] = replace(robot, articulation=EntityArticulationInfoCfg(actuators=(both,)))
    cfg.sim.njmax = 10
    records = {"shank": motor(), "hip": motor(inertia=None, coulomb_friction=number(0.2))}
    with_joints(cfg, written(tmp_path, **records), joint_map="shank=sh*_joint")
    (actuator,) = cfg.scene.entities["robot"].articulation.actuators
    assert (actuator.armature, actuator.frictionloss, actuator.viscous_damping) == (None, None, 0.07)
    model = compiled(cfg)
    assert model.dof_frictionloss.tolist() == [0.2, 0.4] and model.dof_armature.tolist() == [0.02, 0.03]
    assert cfg.sim.njmax == 12


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_joints_under_actuators_of_the_model_get_them_too(tmp_path: Path) -> None:
    """An XmlActuatorCfg takes these fields, and ignores them; MuJoCo adds an actuator's own to those of its joint."""

    def with_actuator() -> mujoco.MjSpec:
        changed = spec()
        actuator = changed.add_actuator(name="shank", target="shank_joint", trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_position(kp=KP)
        actuator.armature, actuator.damping[0] = 0.5, 0.5
        return changed

    cfg = leg_cfg()
    actuators = (XmlActuatorCfg(target_names_expr=("shank_joint",)),)
    robot = cfg.scene.entities["robot"]
    cfg.scene.entities["robot"] = replace(
        robot, spec_fn=with_actuator, articulation=EntityArticulationInfoCfg(actuators=actuators)
    )
    model = compiled(with_joints(cfg, written(tmp_path, shank=motor())))
    assert model.dof_frictionloss[1] == 0.4 and model.dof_armature[1] == 0.03
    assert not model.actuator_armature.any() and not model.actuator_damping.any()


def test_what_is_left_out_is_said_in_a_sentence(tmp_path: Path) -> None:
    """An inertia with the link in it is no armature, which stays as it was."""
    path = written(tmp_path, shank=motor(test_condition="in_air"))
    with pytest.warns(UserWarning, match=r"^joints.json: shank: the inertia 0.03 was measured in the air .*left out"):
        cfg = with_joints(leg_cfg(), path)
    assert compiled(cfg).dof_armature[1] == 0.02


def test_what_cannot_be_taken_is_refused_in_a_sentence(tmp_path: Path) -> None:
    """A fit that is not valid, a record without a joint, another axis, a robot's configuration, a wrong name."""
    path = written(tmp_path, shank=motor(findings=(Finding("unexplained_torque", "it is bad", "log again"),)))
    with pytest.raises(
        StictionError, match=r"'shank' is not valid, nothing of it is written: it is bad. Do first: log"
    ):
        with_joints(leg_cfg(), path)
    path = written(tmp_path, knee=motor())
    with pytest.raises(StictionError, match=r"no joint of the model takes the record 'knee'.* hip_joint, shank_joint"):
        with_joints(leg_cfg(), path)
    with pytest.raises(StictionError, match=r"got EntityCfg, expected the environment's ManagerBasedRlEnvCfg"):
        with_joints(leg_cfg().scene.entities["robot"], path)
    with pytest.raises(StictionError, match=r"unknown entity 'robots'"):
        with_joints(leg_cfg(), path, entity="robots")
    path = written(tmp_path, shank=motor(axis="linear"))
    with pytest.raises(StictionError, match=r"the record 'shank' of a linear axis"):
        with_joints(leg_cfg(), path, joint_map="shank=shank_joint")


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(("share", "moved"), [(0.8, (0.0, 1e-3)), (1.5, (8e-3, 0.02))])
def test_identified_friction_holds_below_its_bound_and_gives_way_above(
    tmp_path: Path, share: float, moved: tuple[float, float]
) -> None:
    """0.4 N m at kp 20: an error of the target of 0.016 rad holds, of 0.03 rad moves the joint by 0.01 rad or more."""
    env = made(with_joints(leg_cfg(), written(tmp_path, shank=motor())))
    target = share * 0.4 / KP
    for _ in range(50):
        env.step(env.sim.data.qpos.new_full((2, 2), target))
    hip, shank = env.scene["robot"].data.joint_pos[0].tolist()
    assert hip == pytest.approx(target, rel=0.01) and moved[0] - 1e-9 <= shank <= moved[1]
