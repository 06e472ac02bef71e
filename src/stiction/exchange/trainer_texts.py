"""Python texts to paste into other trainers: one a trainer, for values and for ranges of joint friction.

Each text has the friction of a joint as its lowest and highest value [N m], the same twice where it is not drawn, and
viscous friction [N m s/rad] and armature [kg m²] where those were identified.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from string import Template

from stiction.exchange.physics import number
from stiction.robots.physics import LEAST_ITERATIONS, LEAST_LS_ITERATIONS, friction_row

Span = tuple[float, float]
"""Lowest and highest value."""


@dataclass(frozen=True)
class Tables:
    """Numbers of a text, by joint of the model."""

    friction: Mapping[str, Span]
    """Dry friction [N m], or a coefficient of the load [1]; at rest for a text that has `moving`."""
    viscous: Mapping[str, float] = field(default_factory=dict)
    """Viscous friction [N m s/rad]."""
    armature: Mapping[str, float] = field(default_factory=dict)
    """Rotor inertia at the joint [kg m²]."""
    moving: Span = (1.0, 1.0)
    """Friction in motion over friction at rest [1]."""
    together: bool = True
    """True if one random number a robot is for all its joints; else one each."""
    written: str = "joint_friction_coeff=rest, joint_dynamic_friction_coeff=moving"
    """Arguments of Isaac Lab's setter."""


def trainer_text(template: Template, tables: Tables) -> str:
    """Return a text with its numbers."""
    values: dict[str, object] = {
        "friction": _table("FRICTION", {name: _ends(span) for name, span in tables.friction.items()}),
        "viscous": _table("VISCOUS", {name: number(value) for name, value in tables.viscous.items()}),
        "armature": _table("ARMATURE", {name: number(value) for name, value in tables.armature.items()}),
        "moving": _ends(tables.moving),
        "written": tables.written,
        # Columns of random numbers, and the words that draw the share of one joint.
        "columns": "1" if tables.together else "len(FRICTION)",
        "share": "np.random.uniform()" if tables.together else "None",
        **{"solimp": [*friction_row(0.0)[1]], "iterations": LEAST_ITERATIONS, "ls_iterations": LEAST_LS_ITERATIONS},
    }
    return template.substitute(values)


def _ends(span: Span) -> str:
    """Return a range in Python."""
    return f"({number(span[0])}, {number(span[1])})"


def _table(name: str, entries: Mapping[str, str]) -> str:
    """Return an assignment of a dictionary in Python, a line for each joint."""
    if not entries:
        return f"{name}: dict = {{}}"
    return "\n".join([f"{name} = {{", *(f"    {joint!r}: {entry}," for joint, entry in entries.items()), "}"])


ISAACLAB = Template('''\
import re

import torch
from isaaclab.managers import EventTermCfg, ManagerTermBase
from isaaclab.utils import configclass

# friction at rest [N m], lowest and highest
$friction
MOVING = $moving  # friction in motion over that at rest


class DrawJointFriction(ManagerTermBase):
    """Draw dry friction at rest, and its share in motion, for the robots that are reset."""

    def __init__(self, cfg, env):
        super().__init__(cfg, env)
        self.asset = env.scene[cfg.params.get("asset_name", "robot")]
        # By default they come in the order of the asset, and a joint would get the range of another one.
        names = [re.escape(name) for name in FRICTION]
        self.joint_ids, _ = self.asset.find_joints(names, preserve_order=True)
        self.ends = torch.tensor(list(FRICTION.values()), device=self.asset.device).unbind(-1)
        newer = getattr(self.asset, "write_joint_friction_coefficient_to_sim_index", None)
        self.write = newer or self.asset.write_joint_friction_coefficient_to_sim

    def __call__(self, env, env_ids, asset_name="robot"):
        if env_ids is None:
            env_ids = torch.arange(env.scene.num_envs, device=self.asset.device)
        low, high = self.ends
        share, ratio = torch.rand(2, len(env_ids), $columns, device=self.asset.device)
        rest = low + (high - low) * share
        moving = (MOVING[0] + (MOVING[1] - MOVING[0]) * ratio) * rest
        self.write($written, joint_ids=self.joint_ids, env_ids=env_ids)


@configclass
class FrictionEvents:
    """Mix it into the events of the environment."""

    joint_friction = EventTermCfg(func=DrawJointFriction, mode="reset")
''')
"""Isaac Lab, whose own `randomize_joint_parameters` draws friction at rest and in motion apart, and viscous friction
from the range of the dry one."""

COEFFICIENT = Template('''\
import numpy as np

# coefficients of the load [1], lowest and highest
$friction


def draw_friction(props, names):
    """Write drawn friction into the properties of one robot's joints; call it from _process_dof_props."""
    one = $share
    for index, name in enumerate(names):
        if name in FRICTION:
            low, high = FRICTION[name]
            share = np.random.uniform() if one is None else one
            props["friction"][index] = low + share * (high - low)
    return props
''')
"""Isaac Gym's own joint friction, drawn once a robot."""

LEGGED_GYM = Template('''\
import torch

# dry friction [N m], lowest and highest; viscous friction [N m s/rad]; rotor inertia [kg m^2]
$friction
$viscous
$armature

EPSILON = 0.1
"""Speed under which friction fades [rad/s]; keep it above friction times the physics step over the joint's inertia."""


class JointFriction:
    """Mix it in before LeggedRobot: class Robot(JointFriction, LeggedRobot)."""

    def _process_dof_props(self, props, env_id):
        props = super()._process_dof_props(props, env_id)
        for index, name in enumerate(self.dof_names):
            if name in ARMATURE:
                props["armature"][index] = ARMATURE[name]
        return props

    def _init_buffers(self):
        super()._init_buffers()
        ends = [FRICTION.get(name, (0.0, 0.0)) for name in self.dof_names]
        self.friction_ends = torch.tensor(ends, device=self.device)
        viscous = [VISCOUS.get(name, 0.0) for name in self.dof_names]
        self.viscous_friction = torch.tensor(viscous, device=self.device)
        self.friction = torch.zeros(self.num_envs, self.num_dof, device=self.device)
        self._draw_friction(torch.arange(self.num_envs, device=self.device))

    def _draw_friction(self, env_ids):
        low, high = self.friction_ends.unbind(-1)
        share = torch.rand(len(env_ids), $columns, device=self.device)
        self.friction[env_ids] = low + (high - low) * share

    def reset_idx(self, env_ids):
        super().reset_idx(env_ids)
        if len(env_ids) and hasattr(self, "friction"):
            self._draw_friction(env_ids)

    def _compute_torques(self, actions):
        braked = self.friction * torch.tanh(self.dof_vel / EPSILON) + self.viscous_friction * self.dof_vel
        return super()._compute_torques(actions) - braked
''')
"""Friction taken off the motor's torque, after it was clipped: Isaac Gym's own is a coefficient of the load."""

PLAYGROUND = Template('''\
import jax
import mujoco
from mujoco import mjx

# dry friction [N m], lowest and highest; viscous friction [N m s/rad]; rotor inertia [kg m^2]
$friction
$viscous
$armature


def domain_randomize(model, rng):
    """Return an mjx.Model with these joints, friction drawn for each key of rng, and its axes."""

    def dofs(names):
        joints = [mjx.name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in names]
        if -1 in joints:
            raise ValueError(f"the model has no joint {[*names][joints.index(-1)]!r}")
        return model.jnt_dofadr[joints]

    where, (low, high) = dofs(FRICTION), jax.numpy.array(list(FRICTION.values())).T
    if not (model.dof_frictionloss[where] > 0).all():
        raise ValueError("MJX makes friction rows where the XML has friction: give each joint a frictionloss of 0.01")

    @jax.vmap
    def draw(key):
        share = jax.random.uniform(key, ($columns,))
        return model.dof_frictionloss.at[where].set(low + (high - low) * share)

    fields = {
        # Rows as stiff as the timestep allows, and a line search under which they hold.
        "dof_solref": model.dof_solref.at[where].set(jax.numpy.stack([2 * model.opt.timestep, 1.0])),
        "dof_solimp": model.dof_solimp.at[where].set(jax.numpy.array($solimp)),
        "opt.iterations": max(model.opt.iterations, $iterations),
        "opt.ls_iterations": max(model.opt.ls_iterations, $ls_iterations),
    }
    if VISCOUS:
        # On top: Playground has the controller's kd in dof_damping.
        fields["dof_damping"] = model.dof_damping.at[dofs(VISCOUS)].add(jax.numpy.array(list(VISCOUS.values())))
    if ARMATURE:
        fields["dof_armature"] = model.dof_armature.at[dofs(ARMATURE)].set(jax.numpy.array(list(ARMATURE.values())))
    model = model.tree_replace(fields)
    in_axes = jax.tree_util.tree_map(lambda _: None, model).tree_replace({"dof_frictionloss": 0})
    return model.tree_replace({"dof_frictionloss": draw(rng)}), in_axes
''')
"""MuJoCo Playground, as its registry takes it; MJX has one number for rest and motion, as MuJoCo."""

GENESIS = Template('''\
import torch

# dry friction [N m], lowest and highest; viscous friction [N m s/rad]; rotor inertia [kg m^2]
$friction
$viscous
$armature


def _dofs(robot, names):
    return [robot.get_joint(name).dofs_idx_local[0] for name in names]


def with_joints(robot, dt):
    """Put these joints into a robot after scene.build; dt: physics step [s]."""
    for name in FRICTION:
        # Rows of friction as stiff as the step allows; Genesis has the same numbers for a joint's limits.
        robot.get_joint(name).set_sol_params((2 * dt, 1.0, *$solimp))
    if VISCOUS:
        robot.set_dofs_damping(list(VISCOUS.values()), _dofs(robot, VISCOUS))
    if ARMATURE:
        robot.set_dofs_armature(list(ARMATURE.values()), _dofs(robot, ARMATURE))
    low, high = zip(*FRICTION.values())
    robot.set_dofs_frictionloss([(a + b) / 2 for a, b in zip(low, high)], _dofs(robot, FRICTION))


def draw_friction(robot, envs_idx):
    """Draw friction for the environments that are reset; the scene needs RigidOptions(batch_dofs_info=True)."""
    low, high = torch.tensor(list(FRICTION.values())).unbind(-1)
    share = torch.rand(len(envs_idx), $columns)
    robot.set_dofs_frictionloss(low + (high - low) * share, _dofs(robot, FRICTION), envs_idx)
''')
"""Genesis, whose friction rows are MuJoCo's."""

MUJOCO = Template('''\
import numpy as np

# dry friction [N m], lowest and highest
$friction


def draw_friction(model, rng):
    """Write drawn friction into an MjModel; rng: numpy.random.Generator."""
    shares = np.ones(len(FRICTION)) * rng.random($columns)
    for share, (name, (low, high)) in zip(shares, FRICTION.items()):
        dof = model.joint(name).dofadr[0]
        model.dof_frictionloss[dof] = low + share * (high - low)
        model.dof_solref[dof] = [2 * model.opt.timestep, 1]
        model.dof_solimp[dof] = $solimp
    # With less of a line search, loaded joints slip below their friction.
    model.opt.iterations = max(model.opt.iterations, $iterations)
    model.opt.ls_iterations = max(model.opt.ls_iterations, $ls_iterations)
''')
"""Plain MuJoCo: a range; values go into its MJCF."""
