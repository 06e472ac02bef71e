"""Check that dry friction holds: joints of an mjlab task under less torque than their friction must not move.

The robot floats without gravity, contacts and joint limits, so that nothing but friction can hold a joint; the solver
has the task's own budget, physics step and settings of the rows of friction.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from mjlab.sim import Simulation

from stiction.core.draws import CREEP, check_hold
from stiction.exchange.mjlab.motors import motors_of

SECONDS = 1.0

FIELDS = ("dof_frictionloss", "dof_solref", "dof_solimp", "dof_armature", "dof_damping")
"""Fields of a joint held by friction that a task may draw."""


@dataclass(frozen=True)
class HeldRow:
    """Movement of a joint under 0.8 of its dry friction for a second."""

    joint: str
    friction: float
    """Dry friction, of the robot that has most of it [N m]."""
    moved: float
    """Largest distance from the start, in MuJoCo Warp, alone or with all others under torque [rad]."""
    moved_in_mujoco: float
    """Largest distance in MuJoCo itself on the CPU, where policies are played [rad]; it needs a larger budget."""

    @property
    def ok(self) -> bool:
        """True if the joint holds in training."""
        return self.moved <= CREEP

    @property
    def verdict(self) -> str:
        """Words for `ok`."""
        if not self.ok:
            return "does not hold"
        return "holds" if self.moved_in_mujoco <= CREEP else "holds in training, not in MuJoCo on the CPU"


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
    loads = {name: [*(value if other == name else 0.0 for other in rubbing), value] for name, value in rubbing.items()}
    pose = env.sim.data.qpos[world].double().cpu().numpy()
    worlds, steps = len(dofs) + 1, round(SECONDS / model.opt.timestep)
    in_warp = _in_warp(Simulation(worlds, cfg, model, env.device), pose, dofs)
    held = [check_hold(*in_one, loads, steps=steps) for in_one in (in_warp, _in_mujoco(model, worlds, pose, dofs))]
    return [HeldRow(warp.name, warp.friction, warp.moved, exact.moved) for warp, exact in zip(*held, strict=True)]


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


Simulated = tuple[Callable[[np.ndarray], None], Callable[[], np.ndarray]]
"""`step` and `read` of `check_hold`."""


def _in_warp(sim: Any, pose: np.ndarray, dofs: list[int]) -> Simulated:
    """Return functions that load and read joints of MuJoCo Warp, all worlds in one pose; dofs: of the joints."""
    addresses = sim.mj_model.jnt_qposadr[sim.mj_model.dof_jntid[dofs]]
    sim.data.qpos[:] = sim.data.qpos.new_tensor(pose)

    def step(torque: np.ndarray) -> None:
        sim.data.qfrc_applied[:, dofs] = sim.data.qfrc_applied.new_tensor(torque)
        sim.step()

    return step, lambda: sim.data.qpos[:].double().cpu().numpy()[:, addresses]


def _in_mujoco(model: Any, worlds: int, pose: np.ndarray, dofs: list[int]) -> Simulated:
    """Return functions that load and read joints as `_in_warp`, in MuJoCo itself."""
    addresses = model.jnt_qposadr[model.dof_jntid[dofs]]
    data = [mujoco.MjData(model) for _ in range(worlds)]
    for world in data:
        world.qpos[:] = pose

    def step(torque: np.ndarray) -> None:
        for world, of_world in zip(data, torque, strict=True):
            world.qfrc_applied[dofs] = of_world
            mujoco.mj_step(model, world)

    return step, lambda: np.stack([world.qpos[addresses] for world in data])
