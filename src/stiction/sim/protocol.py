"""The interface of the simulation's backends: many robots, one clock. No mujoco."""

from __future__ import annotations

from typing import Any, Literal, Protocol

import numpy as np

DeviceName = Literal["cpu", "cuda", "warp-cpu"]
"""What computes: MuJoCo on the processor; MuJoCo Warp on a GPU, with torch there too; MuJoCo Warp on the processor."""


STATE = (
    *("time", "qpos", "qvel", "act", "history", "qacc_warmstart", "ctrl", "qfrc_applied", "xfrc_applied"),
    "plastic",
)
"""The part of MuJoCo's integration state that is used here: what a checkpoint must hold."""


class Simulation(Protocol):
    """Many simulations of one model, stepped together."""

    num: int
    """Number of simulations."""

    def bind(self, name: str) -> np.ndarray:
        """Return a live (num, ...) array over a state field, or over a derived field, which is read-only."""
        ...

    def expand(self, name: str) -> np.ndarray:
        """Give a model field per-simulation values and return them, live, shape (num, ...)."""
        ...

    def set_const(self, ids: np.ndarray) -> None:
        """Recompute what derives from masses, inertias and armatures of the simulations `ids`."""
        ...

    def reset(self, ids: np.ndarray) -> None:
        """Put the simulations `ids` into the standing keyframe, velocities, warm start and delay lines cleared."""
        ...

    def step(self, nstep: int) -> np.ndarray:
        """Advance every simulation by `nstep` physics steps; return the ids of those that blew up, ascending.

        A simulation that blew up is left as it is: the caller resets it. None is reset silently.
        """
        ...

    def state(self) -> dict[str, np.ndarray]:
        """Return a copy of everything the next step depends on, for a checkpoint."""
        return {name: self.bind(name).copy() for name in STATE if self.bind(name).size}

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Restore what `state` returned; on the processor the next step is then bit-identical."""
        for name, value in state.items():
            self.bind(name)[...] = value

    def materialize(self, env: int) -> tuple[Any, Any]:
        """Return one simulation as a MuJoCo model and data of its own, to render or to inspect."""
        ...
