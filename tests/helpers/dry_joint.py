"""A joint with dry friction under a sampled PD controller, whose truth is exact, as logs of odd loggers."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

TITLES = "time,position.j,target.j,torque.j"

FRICTION, INERTIA = 0.3, 0.05
"""Truth [N m], [kg m²]."""

DECLARED = {"kp": 20.0, "kd": 0.8, "torque_limit": 12.0, "torque_source": "motor_side", "test_condition": "bare_motor"}


@lru_cache(maxsize=4)
def simulate(duration: float = 15.0, step: float = 2e-4, update: float = 1e-3) -> np.ndarray:
    """Return time, position, target, torque, shape (N, 4).

    Held by up to FRICTION at rest, braked by it and by 0.05 N m s/rad in motion; update: period of the controller [s].
    """
    position = velocity = torque = 0.0
    rows = []
    for index in range(int(duration / step)):
        time = index * step
        target = 0.5 * np.sin(2 * np.pi * 0.4 * time) + 0.2 * np.sin(2 * np.pi * 1.3 * time + 1)
        if index % round(update / step) == 0:
            torque = 20.0 * (target - position) - 0.8 * velocity
        rows.append((time, position, target, torque))
        free = torque - 0.05 * velocity
        if velocity == 0.0 and abs(free) <= FRICTION:
            continue
        after = velocity + (free - FRICTION * np.sign(velocity or free)) / INERTIA * step
        if velocity != 0.0 and after * velocity <= 0 and abs(free) <= FRICTION:
            after = 0.0
        position, velocity = position + after * step, after
    return np.array(rows)


def measured(rows: np.ndarray, encoder: float = 1e-4, noise: float = 0.01) -> np.ndarray:
    """Return rows with an encoder's steps [rad] and white noise of the torque [N m]."""
    samples = np.array(rows)
    samples[:, 1] = np.round(samples[:, 1] / encoder) * encoder
    samples[:, 3] += noise * np.random.default_rng(1).standard_normal(len(samples))
    return samples


def log_rows() -> np.ndarray:
    """Return a log at 500 Hz, shape (7500, 4)."""
    return measured(simulate()[::10])


def table(path: Path, rows: np.ndarray, header: str = TITLES, mark: str = ",", form: str = "%.10g") -> Path:
    """Write rows as text."""
    lines = [mark.join(form % value for value in row) for row in rows]
    path.write_text("\n".join([header, *lines, ""]))
    return path
