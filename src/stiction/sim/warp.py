"""The GPU backend: MuJoCo Warp, one world a robot, float32, without a loop over worlds.

It also runs on Warp's own processor device, slower than `native`, which is how it is tested where there is no GPU. What
differs from `native`: the numbers are float32; the solver's tolerance is 1e-6 at best; the reset robots' derived fields
are those of the *nominal* robot in the standing pose; and on a GPU sums are taken in any order, so that runs are not
reproducible bit by bit.
"""

from __future__ import annotations

import copy
from collections.abc import Callable

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from stiction.core.errors import EngineError
from stiction.sim.native import out_of_bounds
from stiction.sim.protocol import STATE, Simulation


class Mirror:
    """One device array and its host twin: float64 where the device has floats, else the device's own type.

    A value that came from the device goes back as the same bits: float32 to float64 and back loses nothing.
    """

    def __init__(self, device: wp.array, shape: tuple[int, ...]) -> None:
        """Copy the device array. `shape`: of the host twin, (num, ...) as MuJoCo has it."""
        values = device.numpy()
        self.device, self._device_shape, self._device_type = device, values.shape, values.dtype
        values = values.reshape(shape)
        self.host = values.astype(np.float64) if values.dtype == np.float32 else values.copy()
        self._synced = self.host.copy()

    @property
    def view(self) -> np.ndarray:
        """The host twin, read only."""
        view = self.host.view()
        view.flags.writeable = False
        return view

    def upload(self, always: bool = False) -> None:
        """Bring the device up to the host, where the caller changed anything since they last agreed, or `always`."""
        if always or not np.array_equal(self.host, self._synced):
            self.device.assign(self.host.astype(self._device_type).reshape(self._device_shape))
            self._synced[...] = self.host

    def download(self) -> None:
        """Bring the host up to the device."""
        self.host[...] = self.device.numpy().reshape(self.host.shape)
        self._synced[...] = self.host

    def agree(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Note that both sides hold `values` for the simulations `ids`, because the device was set so by itself."""
        self.host[ids] = values
        self._synced[ids] = values


@wp.kernel(enable_backward=False)
def restart_clocks(stamps: wp.array[int], time: wp.array[float], history: wp.array2d[float]):
    """Count the delay lines' time stamps from now."""
    world, k = wp.tid()
    history[world, stamps[k]] = history[world, stamps[k]] - time[world]


@wp.kernel(enable_backward=False)
def keep_others(key: wp.array[int], before: wp.array2d[float], after: wp.array2d[float]):
    """Undo a change in the worlds whose key is not 0."""
    world, k = wp.tid()
    if key[world] != 0:
        after[world, k] = before[world, k]


@wp.kernel(enable_backward=False)
def place_still(
    still: wp.array[int],
    position: wp.array2d[wp.vec3],
    quaternion: wp.array2d[wp.quat],
    world_position: wp.array2d[wp.vec3],
    world_rotation: wp.array2d[wp.mat33],
):
    """Put the geoms of the world itself where the model has them; Warp does so only once, before the first step."""
    world, k = wp.tid()
    geom = still[k]
    q = quaternion[world % quaternion.shape[0], geom]
    # MuJoCo's order is w, x, y, z, Warp's own is x, y, z, w.
    world_rotation[world, geom] = wp.quat_to_matrix(wp.quat(q[1], q[2], q[3], q[0]))
    world_position[world, geom] = position[world % position.shape[0], geom]


def rows_of(array: wp.array) -> wp.array:
    """Return an array of floats or vectors as (num, floats a world), on the same memory."""
    width = array.size * wp.types.type_size_in_bytes(array.dtype) // 4 // array.shape[0]
    return wp.array(ptr=array.ptr, dtype=float, shape=(array.shape[0], width), device=array.device)


def delay_stamps(model: mujoco.MjModel) -> np.ndarray:
    """Return the columns of `history` that hold times: each delay line is two numbers, its times, its values."""
    starts = np.concatenate((model.actuator_historyadr, model.sensor_historyadr))
    counts = np.concatenate((model.actuator_history[:, 0], model.sensor_history[:, 0]))
    return np.concatenate([start + 2 + np.arange(count) for start, count in zip(starts, counts, strict=True)])


def rows_per_contact(model: mujoco.MjModel) -> int:
    """Return how many rows of the solver one contact takes at most."""
    largest = int(model.geom_condim.max(initial=1))
    return max(1, 2 * (largest - 1)) if model.opt.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL else largest


def cuda_device(number: int = 0) -> str:
    """Return the name of one of Warp's CUDA devices. Raises `StictionError` where it has none of that number."""
    if not wp.is_cuda_available():
        raise EngineError(
            "MuJoCo Warp finds no CUDA device (no NVIDIA driver, or none that this machine lets it see); "
            "train with --device cpu"
        )
    if number >= wp.get_cuda_device_count():
        raise EngineError(f"there is no GPU {number} here, only {wp.get_cuda_device_count()}; start fewer processes")
    return f"cuda:{number}"


# Warp greets on standard output, and says there which kernels it compiles; that belongs to --json.
wp.config.log_level = wp.LOG_WARNING

CONTACTS = 32
"""Contacts for which there is room, a robot; the robots share it."""

FIELDS = (
    *("dof_armature", "dof_damping", "dof_frictionloss", "actuator_gainprm", "actuator_biasprm", "actuator_delay"),
    *("body_mass", "body_ipos", "geom_friction", "geom_pos", "geom_quat", "opt.gravity", "opt.tolerance"),
)
"""Model fields that may differ by simulation. Some others would silently have no effect: add one with its test against
`native`."""

DERIVED = ("body_subtreemass", "dof_invweight0", "body_invweight0", "actuator_acc0")
"""What `set_const` recomputes and the physics uses."""

ITERATED = mjw.OverflowType.ITERATIONS | mjw.OverflowType.LS_ITERATIONS
"""Not a lack of room: the solver stopped before its tolerance, as native MuJoCo does without a word."""


FOREIGN = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET) | int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
"""Flags that Warp refuses because it has neither: the reset of a world that blew up, and trees of geoms."""


class WarpSimulation(Simulation):
    """`Simulation` on MuJoCo Warp. Fields are float64 on the host; `step` uploads what changed and downloads the rest.

    Warp tells the samples of a delay line apart by time stamps, to a microsecond; after 16 s a float32 clock is coarser
    than that, and a delay would be a step too long. So the device's clock and stamps count from the end of the last
    `step`; `time` is on the host.
    """

    def __init__(
        self, model: mujoco.MjModel, num: int, threads: int = 1, device: str = "cpu", contacts: int = CONTACTS
    ) -> None:
        """Make `num` simulations of `model`, all in keyframe 0; `threads` is not used.

        `device`: of Warp, `cpu` or `cuda:0`; `contacts`: room for them, a simulation.
        """
        self.num, self.model, self.contacts = num, model, contacts
        self._device = wp.get_device(device)
        model = copy.copy(model)
        model.opt.disableflags &= ~FOREIGN
        rows = model.nv + model.njnt + contacts * rows_per_contact(model)
        with wp.ScopedDevice(self._device):
            self._m = mjw.put_model(model, batch_sizes=dict.fromkeys(DERIVED, num))
            self._m.opt.warn_overflow = 0
            self._m.opt.graph_conditional = not self._device.is_cuda or wp.is_conditional_graph_supported()
            self._d = mjw.make_data(model, nworld=num, nconmax=contacts, njmax=rows)
            self._key = wp.zeros(num, dtype=int)
            self._stamps = wp.array(delay_stamps(model), dtype=int)
            self._still = wp.array(np.flatnonzero(model.geom_bodyid == 0), dtype=int)
            self._before = [wp.zeros_like(rows_of(getattr(self._m, name))) for name in DERIVED]
        self._graphs: dict[str | int, wp.Graph] = {}
        self._standing = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, self._standing, 0)
        mujoco.mj_forward(model, self._standing)
        self.time = np.zeros(num)
        self._fresh = np.ones(num, bool)
        self._fields: dict[str, Mirror] = {}
        self._results: dict[str, Mirror] = {}
        self._state = {name: self._mirror(name) for name in STATE if name != "time"}
        self._start: dict[str, np.ndarray] = {}
        self.reset(np.arange(num))
        for name, mirror in self._state.items():
            mirror.download()
            self._start[name] = mirror.host[0].copy()
        self._finite = [self.bind(name) for name in ("qpos", "qvel", "qacc")]

    def _mirror(self, name: str) -> Mirror:
        """Return the host twin of a field of the data."""
        return Mirror(getattr(self._d, name), (self.num, *getattr(self._standing, name).shape))

    def _launch(self, what: str | int, work: Callable[[], None]) -> None:
        """Run `work` on the device, on a GPU as a graph that is captured once: a launch costs more than a kernel."""
        with wp.ScopedDevice(self._device):
            if not self._device.is_cuda:
                work()
                return
            if what not in self._graphs:
                # Modules cannot be loaded during a capture: the first run loads them, and is undone.
                work()
                self._upload(always=True)
                with wp.ScopedCapture() as capture:
                    work()
                self._graphs[what] = capture.graph
            wp.capture_launch(self._graphs[what])

    def _upload(self, always: bool = False) -> None:
        """Bring the device up to the host."""
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
            self._results[name].host[self._fresh] = getattr(self._standing, name)
        return self._results[name].view

    def expand(self, name: str) -> np.ndarray:
        """Return the live per-simulation array of a model field, shape (num, ...).

        Raises `StictionError` for a field that has not been seen to act.
        """
        if name not in FIELDS:
            raise EngineError(
                f"the model field {name!r} cannot differ by robot on the GPU backend, only: {', '.join(FIELDS)}; "
                "use --device cpu"
            )
        if name not in self._fields:
            owner, attribute = self._owner(self._m, name), name.removeprefix("opt.")
            shared = getattr(owner, attribute)
            values = np.repeat(shared.numpy(), self.num, axis=0)
            setattr(owner, attribute, wp.array(values, dtype=shared.dtype, device=self._device))
            shape = np.shape(getattr(self._owner(self.model, name), attribute))
            self._fields[name] = Mirror(getattr(owner, attribute), (self.num, *shape))
            self._graphs.clear()
        return self._fields[name].host

    @staticmethod
    def _owner(model: mujoco.MjModel | mjw.Model, name: str) -> object:
        """Return what holds a field: the model, or its options."""
        return model.opt if name.startswith("opt.") else model

    def set_const(self, ids: np.ndarray) -> None:
        """Recompute the constants derived from masses, inertias and armatures, on the device."""
        if len(ids):
            self._upload()
            self._choose(ids)
            self._launch("constants", self._derive)

    def _derive(self) -> None:
        """Recompute the constants of all worlds, and put back those of the worlds without a key."""
        rows = [rows_of(getattr(self._m, name)) for name in DERIVED]
        for before, now in zip(self._before, rows, strict=True):
            wp.copy(before, now)
        mjw.set_const(self._m, self._d, mjw.SetConstGroup.FIXED | mjw.SetConstGroup.INERT0)
        for before, now in zip(self._before, rows, strict=True):
            wp.launch(keep_others, now.shape, [self._key, before], [now])

    def reset(self, ids: np.ndarray) -> None:
        """Put `ids` into keyframe 0, on the device; the derived fields are the nominal robot's in the standing pose."""
        if not len(ids):
            return
        self._choose(ids)
        self._launch("reset", lambda: mjw.reset_data_keyframe(self._m, self._d, self._key))
        self.time[ids] = self.model.key_time[0]
        self._fresh[ids] = True
        for name, start in self._start.items():
            self._state[name].agree(ids, start)
        for name, mirror in self._results.items():
            mirror.host[ids] = getattr(self._standing, name)

    def step(self, nstep: int) -> np.ndarray:
        """Advance by `nstep` physics steps; return the ids whose state is not finite or out of MuJoCo's bounds.

        Raises `StictionError` where a robot had more contacts than there was room for.
        """
        self._upload()
        self._launch(nstep, lambda: self._advance(nstep))
        for mirror in (*self._state.values(), *self._results.values()):
            mirror.download()
        self.time += nstep * self.model.opt.timestep
        self._fresh[:] = False
        lacking = self._d.overflow.numpy() & ~int(ITERATED)
        if lacking.any():
            names = mjw.OverflowType(int(np.bitwise_or.reduce(lacking))).name
            raise EngineError(
                f"the GPU backend has room for {self.contacts} contacts a robot, and {np.count_nonzero(lacking)} of "
                f"{self.num} robots needed more ({names}); raise --contacts"
            )
        return out_of_bounds(self._finite)

    def _advance(self, nstep: int) -> None:
        """Take physics steps, then set the clocks back to zero."""
        wp.launch(
            place_still,
            (self.num, self._still.size),
            [self._still, self._m.geom_pos, self._m.geom_quat],
            [self._d.geom_xpos, self._d.geom_xmat],
        )
        for _ in range(nstep):
            mjw.step(self._m, self._d)
        wp.launch(restart_clocks, (self.num, self._stamps.size), [self._stamps, self._d.time], [self._d.history])
        self._d.time.zero_()

    def materialize(self, env: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Return one simulation's model, with its own parameters, and its state; nothing derived is computed yet."""
        model = copy.copy(self.model)
        for name in DERIVED:
            values = getattr(self._m, name).numpy()[env]
            getattr(model, name)[...] = values.reshape(getattr(model, name).shape)
        for name, mirror in self._fields.items():
            owner, attribute = self._owner(model, name), name.removeprefix("opt.")
            setattr(owner, attribute, mirror.host[env])
        data = mujoco.MjData(model)
        for name, mirror in self._state.items():
            getattr(data, name)[...] = mirror.host[env]
        data.time = self.time[env]
        data.history[self._stamps.numpy()] += data.time
        return model, data
