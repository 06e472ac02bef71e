"""What MuJoCo Warp lacks for a fleet, as kernels: one thread a world and entry. Arrays are the device's."""

from __future__ import annotations

import warp as wp


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
