"""GPU backend: MuJoCo Warp, one world per robot, float32, tested on Warp's own processor device.

The solver's tolerance is 1e-6 at best; derived fields of reset robots are those of the *nominal* robot; on a GPU sums
are taken in any order, so that runs are not reproducible bit by bit.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import warp as wp

from stiction.sim.native import STATE, Simulation, out_of_bounds
from stiction.sim.worlds import CONTACTS, DERIVED, Worlds


# Fields are written by whoever holds a view of them (fleets, friction laws, audits): a flag that each had to set would
# be forgotten once, and the write then do nothing. To compare all fields with copies costs every step.
class Flagged(np.ndarray):
    """Array that records writes to it or to its views; results of computations with it are plain arrays."""

    mirror: Mirror | None = None

    def __array_finalize__(self, of: Any) -> None:
        """Let views write through; a write to a copy sets the flag too, which costs an upload but is no error."""
        self.mirror = getattr(of, "mirror", None)

    def _wrote(self) -> np.ndarray:
        """Set the flag; return the memory to write."""
        if self.mirror is not None:
            self.mirror.written = True
        return self.view(np.ndarray)

    def __setitem__(self, key: Any, value: Any) -> None:
        """Write some entries."""
        self._wrote()[key] = value

    def fill(self, value: Any) -> None:
        """Write every entry."""
        self._wrote().fill(value)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, out: Any = None, **options: Any) -> Any:
        """Compute with plain arrays; an in-place operation has itself as `out`, `np.add.at` as its first input."""
        if method == "at" and isinstance(inputs[0], Flagged):
            inputs = (inputs[0]._wrote(), *inputs[1:])
        if out is not None:
            options["out"] = tuple(target._wrote() if isinstance(target, Flagged) else target for target in out)
        result = getattr(ufunc, method)(*map(_plain, inputs), **options)
        return result if out is None else out[0] if len(out) == 1 else out

    def __array_function__(self, func: Callable, types: Any, args: Any, kwargs: Any) -> Any:
        """Compute with plain arrays, and record the two ways in which NumPy's functions write."""
        if func is np.copyto and isinstance(args[0], Flagged):
            args = (args[0]._wrote(), *args[1:])
        if isinstance(kwargs.get("out"), Flagged):
            kwargs["out"]._wrote()
        return super().__array_function__(func, types, args, kwargs)


def _plain(value: Any) -> Any:
    """Return an argument of a computation without its flag."""
    return value.view(np.ndarray) if isinstance(value, Flagged) else value


class Mirror:
    """Device array and its host twin: float64 for the device's float32, without loss on the way back."""

    def __init__(self, device: wp.array, shape: tuple[int, ...]) -> None:
        """Copy the device array. `shape`: of the host twin, (num, ...) as MuJoCo has it."""
        values = device.numpy()
        self.device, self._device_shape, self._device_type = device, values.shape, values.dtype
        values = values.reshape(shape)
        # Callers write float64 everywhere, as native MuJoCo has it.
        self.values = values.astype(np.float64) if values.dtype == np.float32 else values.copy()
        self.written = False

    @property
    def host(self) -> np.ndarray:
        """Host twin for writing, which sets `written`."""
        host = self.values.view(Flagged)
        host.mirror = self
        return host

    @property
    def view(self) -> np.ndarray:
        """Host twin, read-only."""
        view = self.values.view()
        view.flags.writeable = False
        return view

    def upload(self, always: bool = False) -> None:
        """Upload the host twin if it was written since the last transfer, or `always`."""
        if always or self.written:
            self.device.assign(self.values.astype(self._device_type).reshape(self._device_shape))
            self.written = False

    def download(self) -> None:
        """Download the device array to the host."""
        self.values[...] = self.device.numpy().reshape(self.values.shape)
        self.written = False


class WarpSimulation(Worlds, Simulation):
    """`Simulation` on MuJoCo Warp, with fields on the host; `step` uploads written fields, then downloads."""

    def __init__(
        self, model: mujoco.MjModel, num: int, threads: int = 1, device: str = "cpu", contacts: int = CONTACTS
    ) -> None:
        """Make `num` simulations on Warp's `device`, `cpu` or `cuda:0`, with room for `contacts` each."""
        super().__init__(model, num, device, contacts)
        self.time = np.zeros(num)
        self._fresh = np.ones(num, bool)
        self._fields: dict[str, Mirror] = {}
        self._results: dict[str, Mirror] = {}
        self._state = {name: self._mirror(name) for name in STATE if name != "time"}
        self._start: dict[str, np.ndarray] = {}
        self.reset(np.arange(num))
        for name, mirror in self._state.items():
            mirror.download()
            self._start[name] = mirror.values[0].copy()
        self._finite = [self.bind(name) for name in ("qpos", "qvel", "qacc")]

    def _mirror(self, name: str) -> Mirror:
        """Return the host twin of a field of the data."""
        return Mirror(getattr(self._d, name), (self.num, *getattr(self._standing, name).shape))

    def _undo(self) -> None:
        """Upload the host's state to the device."""
        self._upload(always=True)

    def _upload(self, always: bool = False) -> None:
        """Upload the host's state to the device."""
        for mirror in (*self._state.values(), *self._fields.values()):
            mirror.upload(always)

    def _choose(self, ids: np.ndarray) -> None:
        """Give the worlds `ids` the key 0, all others none."""
        key = np.full(self.num, -1, np.int32)
        key[ids] = 0
        self._key.assign(key)

    def bind(self, name: str) -> np.ndarray:
        """Return the live array of a state or derived field, shape (num, ...)."""
        if name == "time":
            return self.time
        if name in self._state:
            return self._state[name].host
        if name not in self._results:
            self._results[name] = self._mirror(name)
            self._results[name].values[self._fresh] = getattr(self._standing, name)
        return self._results[name].view

    def expand(self, name: str) -> np.ndarray:
        """Return the live array of a model field, (num, ...). Raises `StictionError` for an unsupported one."""
        if name not in self._fields:
            values = self._differ(name)
            shape = np.shape(getattr(self._owner(self.model, name), name.removeprefix("opt.")))
            self._fields[name] = Mirror(values, (self.num, *shape))
        return self._fields[name].host

    def set_const(self, ids: np.ndarray) -> None:
        """Recompute the constants that depend on masses, inertias and armatures, on the device."""
        if len(ids):
            self._upload()
            self._choose(ids)
            self._launch("constants", self._derive)

    def reset(self, ids: np.ndarray) -> None:
        """Reset `ids` to keyframe 0, on the device; derived fields are the nominal robot's in the standing pose."""
        if not len(ids):
            return
        self._choose(ids)
        self._launch("reset", self._stand)
        self.time[ids] = self.model.key_time[0]
        self._fresh[ids] = True
        for name, start in self._start.items():
            # The device has set these rows itself: nothing is to go up.
            self._state[name].values[ids] = start
        for name, mirror in self._results.items():
            mirror.values[ids] = getattr(self._standing, name)

    def step(self, nstep: int) -> np.ndarray:
        """Advance; return the ids that blew up. Raises `StictionError` where contacts had no room."""
        self._upload()
        self._launch(nstep, lambda: self._advance(nstep))
        for mirror in (*self._state.values(), *self._results.values()):
            mirror.download()
        self.time += nstep * self.model.opt.timestep
        self._fresh[:] = False
        self._check_room(self._d.overflow.numpy())
        return out_of_bounds(self._finite)

    def materialize(self, env: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Return one simulation's model, with its parameters, and its state, without derived fields."""
        model = copy.copy(self.model)
        for name in DERIVED:
            values = getattr(self._m, name).numpy()[env]
            getattr(model, name)[...] = values.reshape(getattr(model, name).shape)
        for name, mirror in self._fields.items():
            owner, attribute = self._owner(model, name), name.removeprefix("opt.")
            setattr(owner, attribute, mirror.values[env])
        data = mujoco.MjData(model)
        for name, mirror in self._state.items():
            getattr(data, name)[...] = mirror.values[env]
        data.time = self.time[env]
        # On the device stamps count from the last step, in MuJoCo from the beginning.
        data.history[self._stamps.numpy()] += data.time
        return model, data
