"""`fit.npz` of `stiction train-actuator`: what its page draws beside `summary.json`."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from stiction.formats.errors import StictionError
from stiction.formats.tables import read_npz_arrays


@dataclass(frozen=True)
class ActuatorFit:
    """A piece of a run that was kept out, and how the errors fell."""

    time: np.ndarray
    """Since the start of the run [s], shape (T,)."""
    measured: np.ndarray
    """Torque in the log [N m], shape (T, J)."""
    net: np.ndarray
    """Torque that the net gives [N m], shape (T, J)."""
    baseline: np.ndarray
    """Torque of the PD law with fitted friction [N m], shape (T, J)."""
    loss_training: np.ndarray
    """Mean squared error of torque over limit by group of joints and epoch [-], shape (G, epochs)."""
    loss_validation: np.ndarray
    """... of the runs that were kept out, shape (G, epochs)."""


def write_actuator_fit(path: Path, fit: ActuatorFit) -> None:
    """Write the arrays in single precision."""
    arrays = {item.name: np.asarray(getattr(fit, item.name), np.float32) for item in fields(ActuatorFit)}
    np.savez_compressed(path, allow_pickle=False, **arrays)


def read_actuator_fit(path: Path) -> ActuatorFit:
    """Read what `write_actuator_fit` wrote; raise `StictionError` if something is missing or of another shape."""
    arrays = read_npz_arrays(path)
    names = {item.name for item in fields(ActuatorFit)}
    if arrays.keys() != names:
        raise StictionError(f"{path.name}: expected the arrays {', '.join(sorted(names))}; run train-actuator again")
    fit = ActuatorFit(**arrays)
    signals = {fit.measured.shape, fit.net.shape, fit.baseline.shape}
    right = len(signals) == 1 and fit.measured.ndim == 2 and fit.time.shape == fit.measured.shape[:1]
    if not right or fit.loss_training.shape != fit.loss_validation.shape or fit.loss_training.ndim != 2:
        raise StictionError(f"{path.name}: its arrays do not fit each other; run train-actuator again")
    return fit
