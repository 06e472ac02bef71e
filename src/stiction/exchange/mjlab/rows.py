"""Rows of dry friction in the constraint solver of an mjlab task: their stiffness, number and budget."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

from stiction.robots.physics import LEAST_ITERATIONS, LEAST_LS_ITERATIONS, budget_objection, friction_row


def with_budget(sim: Any, rows: int) -> Any:
    """Return mjlab's configuration of a simulation with the solver budget under which friction holds.

    rows: joints that may have friction, each one more row, for which a number of rows that was set leaves no room.
    """
    budget = {"iterations": LEAST_ITERATIONS, "ls_iterations": LEAST_LS_ITERATIONS}
    solver = replace(sim.mujoco, **{name: max(least, getattr(sim.mujoco, name)) for name, least in budget.items()})
    return replace(sim, mujoco=solver, njmax=None if sim.njmax is None else sim.njmax + rows)


def warn_of_budget(env: Any) -> None:
    """Emit a `UserWarning` where the solver of an environment lets joints slip when a policy is played."""
    solver = env.cfg.sim.mujoco
    if (objection := budget_objection(solver.iterations, solver.ls_iterations)) is not None:
        warnings.warn(f"sim.mujoco: on the CPU, where policies are played, {objection}", stacklevel=2)


def stiffen_rows(env: Any, robots: Any, dofs: Any) -> None:
    """Make rows of friction as stiff as the physics step allows; robots: their numbers, or all."""
    model = env.sim.model
    for field, values in zip((model.dof_solref, model.dof_solimp), friction_row(env.physics_dt), strict=True):
        field[robots, dofs] = field[0, 0].new_tensor(values)
