"""mjlab's flat velocity tasks of Go1 and G1, with dry friction in the joints: found by `import mjlab`, by entry point.

Friction is drawn at each reset, one share of the torque limits a robot, from none to 24 %: the range that `stiction
train` draws at its level of 20 %. The critic is told.
"""

from __future__ import annotations

from typing import Any

import mjlab.tasks  # noqa: F401
from mjlab.managers.observation_manager import ObservationTermCfg
from mjlab.tasks.registry import list_tasks, load_env_cfg, load_rl_cfg, load_runner_cls, register_mjlab_task

from stiction.exchange.mjlab.friction import draw_event, friction_told
from stiction.exchange.mjlab.rows import with_budget

SHARES = (0.0, 0.24)
"""Dry friction over torque limit, lowest and highest [1]."""

ROBOTS = ("Go1", "G1")

MOST_JOINTS = 32
"""Number of joints of the larger robot, at least."""


def _with_friction(cfg: Any) -> Any:
    """Return a task's configuration with friction that is drawn and observed, and the solver's budget for it."""
    cfg.events |= draw_event(SHARES)
    cfg.observations["critic"].terms["friction"] = ObservationTermCfg(func=friction_told)
    cfg.sim = with_budget(cfg.sim, MOST_JOINTS)
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
