"""A leg of mjlab with two joints on a stand, in weightlessness: what is put into it is known."""

from __future__ import annotations

from typing import Any

import mujoco
from mjlab.actuator import BuiltinPositionActuatorCfg
from mjlab.entity import EntityArticulationInfoCfg, EntityCfg
from mjlab.envs import ManagerBasedRlEnv, ManagerBasedRlEnvCfg
from mjlab.envs.mdp.actions import JointPositionActionCfg
from mjlab.scene import SceneCfg
from mjlab.sim import MujocoCfg, SimulationCfg

LIMITS = {"hip": 20.0, "shank": 45.0}
"""Torque limit of each joint [N m]."""
KP, KD = 20.0, 0.5
PERIOD = 0.005
"""Physics step [s]."""


def spec() -> mujoco.MjSpec:
    """Return two joints side by side, neither of which moves the other: 0.0045 kg m² about each axis, no friction."""
    made = mujoco.MjSpec()
    base = made.worldbody.add_body(name="base", mass=1.0, inertia=(1.0, 1.0, 1.0), explicitinertial=True)
    for number, name in enumerate(LIMITS):
        link = base.add_body(
            name=name, pos=(0.0, number, 0.0), mass=1.0, inertia=(0.0045, 0.0045, 0.0045), explicitinertial=True
        )
        link.add_joint(name=f"{name}_joint", axis=(0.0, 1.0, 0.0))
    return made


def leg_cfg(num_envs: int = 2, decimation: int = 4) -> ManagerBasedRlEnvCfg:
    """Return an environment whose action is the targets of both joints [rad], with mjlab's budget of the solver."""
    actuators = tuple(
        BuiltinPositionActuatorCfg(
            target_names_expr=(f"{name}_.*",), stiffness=KP, damping=KD, effort_limit=limit, armature=0.02
        )
        for name, limit in LIMITS.items()
    )
    robot = EntityCfg(spec_fn=spec, articulation=EntityArticulationInfoCfg(actuators=actuators))
    return ManagerBasedRlEnvCfg(
        decimation=decimation,
        scene=SceneCfg(num_envs=num_envs, entities={"robot": robot}),
        actions={"joint_pos": JointPositionActionCfg(entity_name="robot", actuator_names=(".*",), scale=1.0)},
        sim=SimulationCfg(mujoco=MujocoCfg(timestep=PERIOD, iterations=10, ls_iterations=20, gravity=(0.0, 0.0, 0.0))),
        episode_length_s=100.0,
        seed=1,
    )


def made(cfg: ManagerBasedRlEnvCfg) -> Any:
    """Return the environment, after its first reset."""
    env = ManagerBasedRlEnv(cfg, device="cpu")
    env.reset()
    return env
