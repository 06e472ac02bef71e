"""Whether dry friction holds: joints of an mjlab task under less torque than their friction must stay where they are.

The robot floats without gravity, contacts and joint limits, so that nothing but friction can hold a joint; the solver
has the task's own budget, physics step and settings of the rows of friction.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from mjlab.sim import Simulation

from stiction.exchange.mjlab.motors import motors_of

SHARE = 0.8
"""Torque over dry friction."""
SECONDS = 1.0
MOST = 5e-3
"""Largest motion of a joint that holds [rad] or [m]: rows as stiff as the timestep allows creep 1 to 2 mrad."""

FIELDS = ("dof_frictionloss", "dof_solref", "dof_solimp", "dof_armature", "dof_damping")
"""What a task may draw of a joint that friction holds."""


@dataclass(frozen=True)
class HeldRow:
    """What a joint did under 0.8 of its dry friction for a second."""

    joint: str
    friction: float
    """Dry friction, of the robot that has most of it [N m]."""
    moved: float
    """Furthest from where it was, in MuJoCo Warp, alone or with all others under torque [rad]."""
    moved_in_mujoco: float
    """The same in MuJoCo itself on the CPU, where policies are played [rad]; its solver needs a larger budget."""

    @property
    def ok(self) -> bool:
        """Whether the joint holds in training."""
        return self.moved <= MOST

    @property
    def verdict(self) -> str:
        """`ok` in words."""
        if not self.ok:
            return "does not hold"
        return "holds" if self.moved_in_mujoco <= MOST else "holds in training, not in MuJoCo on the CPU"


def audit_hold(env: Any) -> list[HeldRow]:
    """Return a row for each driven joint that has dry friction, of the robot of `env` that has most of it."""
    names: dict[str, int] = {}
    for asset in env.scene.entities.values():
        if getattr(asset, "actuators", ()):
            motors = motors_of(env, asset)
            dofs = asset.indexing.joint_v_adr[[motor.joint for motor in motors.values()]].tolist()
            names |= dict(zip(motors, dofs, strict=True))
    friction = env.sim.model.dof_frictionloss[:][:, [*names.values()]].double().cpu().numpy()
    world = int(friction.sum(axis=1).argmax())
    rubbing = {name: value for name, value in zip(names, friction[world].tolist(), strict=True) if value > 0}
    if not rubbing:
        return []
    cfg, model = _floating(env, world)
    dofs = [names[name] for name in rubbing]
    # A joint alone in each world but the last, and all of them there.
    torque = np.zeros((len(dofs) + 1, model.nv))
    torque[range(len(dofs)), dofs] = torque[-1, dofs] = SHARE * np.array([*rubbing.values()])
    pose = env.sim.data.qpos[world].double().cpu().numpy()
    addresses = model.jnt_qposadr[model.dof_jntid[dofs]]
    poses = _in_warp(Simulation(len(torque), cfg, model, env.device), pose, torque), _in_mujoco(model, pose, torque)
    moved = [_furthest(of_all, addresses) for of_all in poses]
    return [
        HeldRow(name, value, *(float(of_all[number]) for of_all in moved))
        for number, (name, value) in enumerate(rubbing.items())
    ]


def _floating(env: Any, world: int) -> tuple[Any, Any]:
    """Return the task's simulation in weightlessness, touching nothing, and its model with the joints of one robot."""
    budget = env.cfg.sim.mujoco
    flags = (*budget.disableflags, "contact", "limit", "actuation")
    cfg = replace(env.cfg.sim, mujoco=replace(budget, gravity=(0.0, 0.0, 0.0), disableflags=flags))
    model = copy.copy(env.sim.mj_model)
    cfg.mujoco.apply(model)
    for field in FIELDS:
        getattr(model, field)[:] = getattr(env.sim.model, field)[world].double().cpu().numpy()
    model.jnt_stiffness[:] = 0.0
    return cfg, model


def _furthest(poses: Iterator[np.ndarray], addresses: np.ndarray) -> np.ndarray:
    """Return how far joints went from where they began, in any world and at any time; not-a-number counts as far."""
    begin = next(poses)[:, addresses]
    moved = np.zeros(len(addresses))
    for pose in poses:
        moved = np.maximum(moved, np.nan_to_num(np.abs(pose[:, addresses] - begin), nan=np.inf).max(axis=0))
    return moved


def _in_warp(sim: Any, pose: np.ndarray, torque: np.ndarray) -> Iterator[np.ndarray]:
    """Yield poses of all worlds, shape (worlds, nq), from the begin on, in MuJoCo Warp."""
    sim.data.qpos[:] = sim.data.qpos.new_tensor(pose)
    sim.data.qfrc_applied[:] = sim.data.qfrc_applied.new_tensor(torque)
    for _ in range(round(SECONDS / sim.mj_model.opt.timestep) + 1):
        yield sim.data.qpos[:].double().cpu().numpy().copy()
        sim.step()


def _in_mujoco(model: Any, pose: np.ndarray, torque: np.ndarray) -> Iterator[np.ndarray]:
    """Yield poses as `_in_warp`, in MuJoCo itself."""
    worlds = [mujoco.MjData(model) for _ in torque]
    for data, of_world in zip(worlds, torque, strict=True):
        data.qpos[:], data.qfrc_applied[:] = pose, of_world
    for _ in range(round(SECONDS / model.opt.timestep) + 1):
        yield np.stack([data.qpos for data in worlds])
        for data in worlds:
            mujoco.mj_step(model, data)
