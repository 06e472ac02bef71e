"""`fit.npz` of a walking log: what its page draws beside `joints.json`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stiction.formats.errors import StictionError
from stiction.formats.tables import read_npz_arrays


@dataclass(frozen=True)
class WalkFit:
    """Clouds and gait of one walk."""

    swing: dict[str, tuple[np.ndarray, np.ndarray]]
    """Joint -> velocity [rad/s] and torque without links and rotor inertia [N m] in swing, each shape (R,)."""
    gait_time: np.ndarray
    """Times of the first steps [s], shape (T,)."""
    gait: dict[str, np.ndarray]
    """Foot -> whether it was taken to bear load at those times, bool, shape (T,)."""
    load: dict[str, tuple[np.ndarray, np.ndarray]]
    """Kind of joint -> load and friction as forces on the body, the rest taken off [N], each shape (R,)."""


PAIRS = ("swing", "load")
"""Fields that hold two arrays a name: `swing.x.<joint>` and `swing.y.<joint>`."""


def write_walk_fit(path: Path, fit: WalkFit) -> None:
    """Write the arrays in single precision."""
    arrays: dict[str, np.ndarray] = {"gait.time": fit.gait_time}
    arrays |= {f"gait.{foot}": down for foot, down in fit.gait.items()}
    for group in PAIRS:
        for name, pair in getattr(fit, group).items():
            for axis, values in zip("xy", pair, strict=True):
                arrays[f"{group}.{axis}.{name}"] = values.astype(np.float32)
    np.savez_compressed(path, allow_pickle=False, **arrays)


def read_walk_fit(path: Path) -> WalkFit:
    """Read what `write_walk_fit` wrote; raise `StictionError` if something is missing or of the wrong length."""
    arrays = read_npz_arrays(path)
    if "gait.time" not in arrays:
        raise StictionError(f"{path.name}: no gait.time; expected the fit.npz of a walking log: run identify again")
    time = arrays.pop("gait.time")
    gait = {name.removeprefix("gait."): array for name, array in arrays.items() if name.startswith("gait.")}
    pairs: dict[str, dict[str, tuple[np.ndarray, np.ndarray]]] = {group: {} for group in PAIRS}
    for group, found in pairs.items():
        for name in [key.removeprefix(f"{group}.x.") for key in arrays if key.startswith(f"{group}.x.")]:
            first, second = arrays[f"{group}.x.{name}"], arrays.get(f"{group}.y.{name}", np.zeros(0))
            if first.shape != second.shape or first.ndim != 1:
                raise StictionError(f"{path.name}: {group} of {name!r} is not complete; run identify again")
            found[name] = (first, second)
    if any(array.shape != time.shape for array in gait.values()):
        raise StictionError(f"{path.name}: the gait's arrays differ in length; run identify again")
    return WalkFit(pairs["swing"], time, gait, pairs["load"])
