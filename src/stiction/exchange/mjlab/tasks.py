"""mjlab's flat velocity tasks of Go1 and G1, with dry friction in the joints: found by `import mjlab`, by entry point.

Friction is drawn at each reset, one share of the torque limits a robot, from none to 24 %: the range that `stiction
train` draws at its level of 20 %. The critic is told.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mjlab.tasks  # noqa: F401
from mjlab.managers.event_manager import EventTermCfg
from mjlab.managers.observation_manager import ObservationTermCfg
from mjlab.tasks.registry import list_tasks, load_env_cfg, load_rl_cfg, load_runner_cls, register_mjlab_task

from stiction.exchange.mjlab.friction import DrawFriction, friction_told
from stiction.robots.physics import LEAST_ITERATIONS, LEAST_LS_ITERATIONS

SHARES = (0.0, 0.24)
"""Dry friction over torque limit, lowest and highest [1]."""

ROBOTS = ("Go1", "G1")


def _with_friction(cfg: Any) -> Any:
    """Return a task's configuration with friction drawn and told, and the solver's budget under which it holds."""
    params = {"shares": SHARES, "together": True, "entity": "robot"}
    cfg.events |= {"joint_friction": EventTermCfg(func=DrawFriction, mode="reset", params=params)}
    cfg.observations["critic"].terms["friction"] = ObservationTermCfg(func=friction_told)
    solver = cfg.sim.mujoco
    budget = {
        "iterations": max(LEAST_ITERATIONS, solver.iterations),
        "ls_iterations": max(LEAST_LS_ITERATIONS, solver.ls_iterations),
    }
    # A row more for each joint of the larger robot.
    rows = None if cfg.sim.njmax is None else cfg.sim.njmax + 32
    cfg.sim = replace(cfg.sim, mujoco=replace(solver, **budget), njmax=rows)
    return cfg


for _robot in ROBOTS:
    _theirs, _ours = (f"{_maker}-Velocity-Flat-Unitree-{_robot}" for _maker in ("Mjlab", "Stiction"))
    if _ours not in list_tasks():
        register_mjlab_task(
            task_id=_ours,
            env_cfg=_with_friction(load_env_cfg(_theirs)),
            play_env_cfg=_with_friction(load_env_cfg(_theirs, play=True)),
            rl_cfg=load_rl_cfg(_theirs),
            runner_cls=load_runner_cls(_theirs),
        )
