"""An array on a device as a live array of the host: what the caller wrote goes up, what the device wrote comes down.

The task reads and writes NumPy; the physics runs in float32 elsewhere. A control step of a robot moves two or three
kilobytes each way, half of them its delay lines.
"""

from __future__ import annotations

import numpy as np
import warp as wp


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
        """The host twin for who may only read it."""
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
