"""Many worlds of MuJoCo Warp, run on a GPU as graphs; `sim.warp` fills them from the host, `sim.torch_fleet` on the
device.
"""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from stiction.core.errors import EngineError


@wp.kernel(enable_backward=False)
def restart_clocks(stamps: wp.array[int], time: wp.array[float], history: wp.array2d[float]):
    """Restart the delay lines' time stamps from now."""
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
    """Place the geoms of the world body as in the model; Warp does so only once, before the first step."""
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
    """Return the columns of `history` with times: each delay line is two numbers, its times, its values."""
    starts = np.concatenate((model.actuator_historyadr, model.sensor_historyadr))
    counts = np.concatenate((model.actuator_history[:, 0], model.sensor_history[:, 0]))
    return np.concatenate([start + 2 + np.arange(count) for start, count in zip(starts, counts, strict=True)])


def rows_per_contact(model: mujoco.MjModel) -> int:
    """Return the maximum number of the solver's rows per contact."""
    largest = int(model.geom_condim.max(initial=1))
    return max(1, 2 * (largest - 1)) if model.opt.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL else largest


def cuda_device(number: int = 0) -> str:
    """Return the name of one of Warp's CUDA devices. Raises `StictionError` for a number without a device."""
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
"""Room for contacts, per robot; the robots share it."""

FIELDS = (
    *("dof_armature", "dof_damping", "dof_frictionloss", "actuator_gainprm", "actuator_biasprm", "actuator_delay"),
    *("body_mass", "body_ipos", "geom_friction", "geom_solref", "geom_pos", "geom_quat"),
    *("opt.gravity", "opt.tolerance"),
)
"""Model fields that may differ by simulation. Some others would silently have no effect: add one with its test against
`native`."""

DERIVED = ("body_subtreemass", "dof_invweight0", "body_invweight0", "actuator_acc0")
"""Constants that `set_const` recomputes and the physics uses."""

ITERATED = mjw.OverflowType.ITERATIONS | mjw.OverflowType.LS_ITERATIONS
"""Flag for a solver that stopped before its tolerance, which is not a lack of room; native MuJoCo does not report
it."""


FOREIGN = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET) | int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
"""Flags for features that Warp lacks: the reset of a world that blew up, and trees of geoms."""


class Worlds(ABC):
    """`num` worlds of one model, all in keyframe 0.

    Samples of a delay line have time stamps, float32: the device's clock counts from the end of the last `_advance`.
    """

    def __init__(self, model: mujoco.MjModel, num: int, device: str, contacts: int) -> None:
        """Load the model on Warp's `device`, `cpu` or `cuda:0`; `contacts`: room for them, per world."""
        self.num, self.model, self.contacts = num, model, contacts
        self._device = wp.get_device(device)
        model = copy.copy(model)
        model.opt.disableflags &= ~FOREIGN
        # One row a degree of freedom for dry friction, one a joint for its limit, and those of the contacts.
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

    @abstractmethod
    def _undo(self) -> None:
        """Restore the state before the first run of some work."""

    def _launch(self, what: str | int, work: Callable[[], None]) -> None:
        """Run `work` on the device, on a GPU as a graph that is captured once: a launch costs more than a kernel."""
        with wp.ScopedDevice(self._device):
            if not self._device.is_cuda:
                work()
                return
            if what not in self._graphs:
                # Modules cannot be loaded during a capture: the first run loads them, and is undone.
                work()
                self._undo()
                with wp.ScopedCapture() as capture:
                    work()
                self._graphs[what] = capture.graph
            wp.capture_launch(self._graphs[what])

    def _differ(self, name: str) -> wp.array:
        """Make a model field per-world; return its values.

        Raises `StictionError` for an unsupported field.
        """
        if name not in FIELDS:
            raise EngineError(
                f"the model field {name!r} cannot differ by robot on the GPU backend, only: {', '.join(FIELDS)}; "
                "use --device cpu"
            )
        owner, attribute = self._owner(self._m, name), name.removeprefix("opt.")
        shared = getattr(owner, attribute)
        per_world = wp.array(np.repeat(shared.numpy(), self.num, axis=0), dtype=shared.dtype, device=self._device)
        setattr(owner, attribute, per_world)
        # A captured graph would go on reading the array that was replaced.
        self._graphs.clear()
        return per_world

    @staticmethod
    def _owner(model: mujoco.MjModel | mjw.Model, name: str) -> object:
        """Return the owner of a field: the model, or its options."""
        return model.opt if name.startswith("opt.") else model

    def _derive(self) -> None:
        """Recompute the constants of all worlds, and restore those of the worlds without a key."""
        rows = [rows_of(getattr(self._m, name)) for name in DERIVED]
        for before, now in zip(self._before, rows, strict=True):
            wp.copy(before, now)
        # Warp has no mask for it: it recomputes every world, and those without a key must not change.
        mjw.set_const(self._m, self._d, mjw.SetConstGroup.FIXED | mjw.SetConstGroup.INERT0)
        for before, now in zip(self._before, rows, strict=True):
            wp.launch(keep_others, now.shape, [self._key, before], [now])

    def _stand(self) -> None:
        """Reset the worlds with a key to keyframe 0; derived fields stay unchanged."""
        mjw.reset_data_keyframe(self._m, self._d, self._key)

    def _advance(self, nstep: int) -> None:
        """Take physics steps, then reset the clocks to zero."""
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

    def _check_room(self, overflow: np.ndarray) -> None:
        """Raise `StictionError` where a robot had more contacts than the room for them; `overflow`: flags, (num,)."""
        lacking = overflow & ~int(ITERATED)
        if lacking.any():
            names = mjw.OverflowType(int(np.bitwise_or.reduce(lacking))).name
            raise EngineError(
                f"the GPU backend has room for {self.contacts} contacts a robot, and {np.count_nonzero(lacking)} of "
                f"{self.num} robots needed more ({names}); raise --set contacts"
            )
