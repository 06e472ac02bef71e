"""CPU backend: MuJoCo's batch of simulations on a pool of C threads."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol

import mujoco
import numpy as np
from mujoco.batch import Batch

STATE = (
    *("time", "qpos", "qvel", "act", "history", "qacc_warmstart", "ctrl", "qfrc_applied", "xfrc_applied"),
    "plastic",
)
"""Part of MuJoCo's integration state in use, which a checkpoint must hold."""


class Simulation(Protocol):
    """Many simulations of one model, stepped together."""

    num: int

    def bind(self, name: str) -> np.ndarray:
        """Return a live (num, ...) array over a state field, or over a derived field, which is read-only."""
        ...

    def expand(self, name: str) -> np.ndarray:
        """Give a model field per-simulation values and return them, live, shape (num, ...)."""
        ...

    def set_const(self, ids: np.ndarray) -> None:
        """Recompute the constants that depend on masses, inertias and armatures of the simulations `ids`."""
        ...

    def reset(self, ids: np.ndarray) -> None:
        """Reset the simulations `ids` to the standing keyframe, with velocities, warm start and delay lines cleared."""
        ...

    def step(self, nstep: int) -> np.ndarray:
        """Advance by `nstep` physics steps; return the ids of simulations that blew up, which the caller resets."""
        ...

    def state(self) -> dict[str, np.ndarray]:
        """Return a copy of the complete state of the next step, for a checkpoint."""
        return {name: self.bind(name).copy() for name in STATE if self.bind(name).size}

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Restore a `state`; on the processor the next step is then bit-identical."""
        for name, value in state.items():
            self.bind(name)[...] = value

    def materialize(self, env: int) -> tuple[Any, Any]:
        """Return one simulation as a separate MuJoCo model and data, to render or to inspect."""
        ...


# MuJoCo would write every instability to a file in the current folder and to the terminal. `step` reports them instead.
mujoco.set_mju_user_warning(lambda message: None)


def out_of_bounds(fields: Iterable[np.ndarray]) -> np.ndarray:
    """Return the ids of simulations with an entry that is not finite or above MuJoCo's bound; fields: (num, ...)."""
    # A sum is finite exactly where all entries are (or overflows, which is a blow-up too). The sum over all simulations
    # bounds that of each and is several times as fast.
    sizes = [np.abs(field) for field in fields]
    if all(size.sum() < mujoco.mjMAXVAL for size in sizes):
        return np.zeros(0, np.intp)
    # Not `>=`: with NaN every comparison is false.
    return np.flatnonzero(np.any([~(size.sum(axis=1) < mujoco.mjMAXVAL) for size in sizes], axis=0))


class NativeSimulation(Simulation):
    """`Simulation` on `mujoco.batch.Batch`; bit-identical to a serial loop at any thread count."""

    def __init__(self, model: mujoco.MjModel, num: int, threads: int) -> None:
        """Make `num` simulations of a model, which must not reset itself on NaN (`ValueError`), in keyframe 0."""
        if not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_AUTORESET:
            raise ValueError("the model resets itself when a state turns NaN; set mjDSBL_AUTORESET in disableflags")
        self.num = num
        self.model = model
        self.batch = Batch(model, nsim=num, nthread=threads)
        self._finite = [self.bind(name) for name in ("qpos", "qvel", "qacc")]
        self.reset(np.arange(num))

    def bind(self, name: str) -> np.ndarray:
        """Return the live array of a state or derived field, shape (num, ...)."""
        return self.batch.bind(name)

    def expand(self, name: str) -> np.ndarray:
        """Return the live per-simulation array of a model field, shape (num, ...)."""
        return self.batch.expand(name)

    def set_const(self, ids: np.ndarray) -> None:
        """Recompute the constants derived from masses, inertias and armatures (30-60 µs a simulation)."""
        if len(ids):
            self.batch.set_const(ids)

    def reset(self, ids: np.ndarray) -> None:
        """Reset `ids` to keyframe 0; the derived fields are those of the standing pose."""
        if len(ids):
            self.batch.reset(ids, keyframe=0)

    def step(self, nstep: int) -> np.ndarray:
        """Advance by `nstep` physics steps; return the ids whose state is not finite or out of MuJoCo's bounds."""
        self.batch.step(nstep=nstep)
        return out_of_bounds(self._finite)

    def materialize(self, env: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Return one simulation's model, with its parameters, and its state, without derived fields."""
        return self.batch.get_model(env), self.batch.get_data(env)
