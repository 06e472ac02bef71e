"""Parts of the GPU backend: what its arrays must hold, and three kernels that MuJoCo Warp lacks."""

from __future__ import annotations

import mujoco
import numpy as np
import warp as wp

from stiction.formats.errors import StictionError


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
    place: wp.array2d[wp.vec3],
    turn: wp.array2d[wp.mat33],
):
    """Put the geoms of the world itself where the model has them; Warp does so only once, before the first step."""
    world, k = wp.tid()
    geom = still[k]
    q = quaternion[world % quaternion.shape[0], geom]
    # MuJoCo's order is w, x, y, z, Warp's own is x, y, z, w.
    turn[world, geom] = wp.quat_to_matrix(wp.quat(q[1], q[2], q[3], q[0]))
    place[world, geom] = position[world % position.shape[0], geom]


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


def cuda_device() -> str:
    """Return the name of Warp's first CUDA device. Raises `StictionError` where it has none."""
    if not wp.is_cuda_available():
        raise StictionError(
            "MuJoCo Warp finds no CUDA device (no NVIDIA driver, or none that this machine lets it see); "
            "train with --device cpu"
        )
    return "cuda:0"
