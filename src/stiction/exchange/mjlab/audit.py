"""Audit of a registered mjlab task: the draws of its events act, and the dry friction of its joints holds."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import mjlab.tasks  # noqa: F401
from mjlab.envs import ManagerBasedRlEnv
from mjlab.tasks.registry import list_tasks, load_env_cfg

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.exchange.mjlab.draws import DrawnRow, audit_draws
from stiction.exchange.mjlab.hold import HeldRow, audit_hold


@dataclass(frozen=True)
class TaskAudit:
    """The audit of a task."""

    task: str
    draws: list[DrawnRow]
    """Rows of draws; empty where no event draws anything of the model."""
    holds: list[HeldRow]
    """Rows of joints; empty where no driven joint has dry friction."""

    @property
    def failed(self) -> list[str]:
        """Draws without effect, and joints that do not hold."""
        draws = [f"{row.event} {row.quantity}" for row in self.draws if not row.ok]
        return draws + [f"{row.joint} does not hold" for row in self.holds if not row.ok]


def audit_task(task: str, num_envs: int = 8, report: Callable[[str], None] = lambda _: None) -> TaskAudit:
    """Build a registered task on the CPU, and audit it.

    Raises `ConfigurationError` for a task that is not registered.
    """
    if task not in list_tasks():
        raise ConfigurationError(f"--mjlab: {unknown_name('task', task, list_tasks())}")
    cfg = load_env_cfg(task)
    cfg.scene.num_envs, cfg.seed = num_envs, 0
    # The output of mjlab and Warp is not a result.
    with Path(os.devnull).open("w") as nowhere, redirect_stdout(nowhere):
        report(f"building {num_envs} robots on the CPU; the first time MuJoCo Warp compiles for minutes")
        env = ManagerBasedRlEnv(cfg, device="cpu")
        report("what the events draw")
        draws = audit_draws(env)
        report("what holds under its friction")
        holds = audit_hold(env)
        env.close()
    return TaskAudit(task, draws, holds)
