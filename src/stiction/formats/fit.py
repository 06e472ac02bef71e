"""`fit.npz`: the signals, the fit and the residuals behind a `joints.json`, from which its page is drawn."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from stiction.formats.errors import StictionError
from stiction.formats.tables import read_npz_arrays


@dataclass(frozen=True)
class FitSignals:
    """Signals of one joint on an even grid; arrays of shape (num_samples,).

    Torques are in N m, or in the unit of the torque column where that is not N m; on a linear axis read N and m.
    """

    time: np.ndarray
    """From zero [s]."""
    position: np.ndarray
    """As measured [rad]."""
    velocity: np.ndarray
    """Filtered [rad/s]."""
    acceleration: np.ndarray
    """Filtered [rad/s²]."""
    torque: np.ndarray
    """Filtered [N m]."""
    fitted_torque: np.ndarray
    """By viscous and Coulomb friction [N m]."""
    law_torque: np.ndarray
    """By the law that was chosen [N m]; the same where that is the regression's."""
    rigid_torque: np.ndarray
    """The part of it that is not friction: inertia, offset, gravity, payload [N m]."""
    used: np.ndarray
    """1 where the sample entered the regression, else 0."""
    target: np.ndarray | None = None
    """Position asked for [rad]."""
    simulated_position: np.ndarray | None = None
    """By the closed-loop simulation [rad]."""
    simulated_torque: np.ndarray | None = None
    """By the closed-loop simulation [N m]."""


def write_fit(path: Path, joints: dict[str, FitSignals]) -> None:
    """Write `<signal>.<joint>` arrays; signals that are None are left out."""
    arrays = {
        f"{item.name}.{joint}": values.astype(np.float32 if item.name != "time" else float)
        for joint, signals in joints.items()
        for item in fields(FitSignals)
        if (values := getattr(signals, item.name)) is not None
    }
    np.savez_compressed(path, allow_pickle=False, **arrays)


def read_fit(path: Path, joint: str) -> FitSignals:
    """Read one joint's signals; raise `StictionError` if they are not there or not of one length."""
    arrays = read_npz_arrays(path)
    found = {item.name: arrays[key] for item in fields(FitSignals) if (key := f"{item.name}.{joint}") in arrays}
    needed = {item.name for item in fields(FitSignals)[:9]}
    if needed - set(found):
        raise StictionError(f"{path.name}: no {sorted(needed - set(found))[0]} of joint {joint!r}; run identify again")
    if any(values.ndim != 1 or values.dtype.kind != "f" for values in found.values()):
        raise StictionError(f"{path.name}: a signal of joint {joint!r} is no vector of numbers; run identify again")
    if len({len(values) for values in found.values()}) != 1:
        raise StictionError(f"{path.name}: the signals of joint {joint!r} differ in length; run identify again")
    return FitSignals(**{name: values.astype(float) for name, values in found.items()})
