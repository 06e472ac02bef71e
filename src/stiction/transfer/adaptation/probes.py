"""Linear probes of a walk: what z*, and what it is made from, tell of the joints' friction.

Inputs are compared on the same walks, robots and split. A row is one step, or the mean over a window. There is no
torque in o_H; `moments` are products of what is in it, the control for what a linear probe of o_H cannot see.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from stiction.deploy.wear import Moments
from stiction.transfer.adaptation.friction_walk import FrictionWalk, Per
from stiction.transfer.adaptation.ridge import determination, fit_ridge

HISTORIES = (11, 21, 51)
"""Lengths of the raw history [frames]: H of 10, 20 and 50, the present frame included as in the paper's set."""

EVERY = 50
"""Control steps between the single steps that are probed: 1 s, so that neighbours differ."""

WINDOWS = (50, 250)
"""Lengths of the windows over which features are averaged [control steps], beside the whole walk: 1 s and 5 s."""

TEST_OF = 4
"""One robot in this many is a test robot. Robots are drawn independently, so any split by number will do."""


def held_out(count: int) -> np.ndarray:
    """Return which robots no probe is fitted on, bool, shape (count,)."""
    return np.arange(count) % TEST_OF == TEST_OF - 1


def windows(features: np.ndarray, length: int) -> np.ndarray:
    """Return the means over consecutive windows, shape (T // length, N, ...), of features, shape (T, N, ...)."""
    count = len(features) // length
    cut = features[: count * length].reshape(count, length, *features.shape[1:])
    return cut.mean(axis=1, dtype=np.float64)


def histories(frames: np.ndarray, length: int) -> np.ndarray:
    """Return o_H of `length` frames, oldest first, every `EVERY` steps, shape (K, N, length * frame).

    All lengths are taken at the same steps, the first at which the longest is full.
    """
    ends = range(max(HISTORIES), len(frames) + 1, EVERY)
    return np.stack([np.concatenate(frames[end - length : end], axis=-1) for end in ends])


def pick(signal: np.ndarray, steps: slice | None) -> np.ndarray:
    """Return some steps of a signal; with None, a signal without time as one step."""
    return signal[steps]


def inputs(walk: FrictionWalk, moments: Moments) -> Iterator[tuple[str, str, Callable[[], np.ndarray]]]:
    """Yield every input: its name, what a row is, and what makes it, shape (rows per robot, N, features)."""
    steps, frames = slice(max(HISTORIES) - 1, None, EVERY), walk.frames
    products = moments(frames[:-1], frames[1:])
    signals = {"latent": walk.latent, "explicit": walk.explicit, "frame": frames, "moments": products}
    for name, signal in signals.items():
        if name in ("latent", "explicit"):
            yield name, "step", partial(pick, signal, steps)
        for length in (*(length for length in WINDOWS if length < len(signal)), len(signal)):
            span = "walk" if length == len(signal) else f"mean of {length} steps"
            yield name, span, partial(windows, signal, length)
    for length in HISTORIES:
        yield f"history {length}", "step", partial(histories, frames, length)
    yield "teacher", "walk", partial(pick, walk.teacher, None)


def probe(features: np.ndarray, targets: np.ndarray) -> dict[str, Any]:
    """Fit a probe on the training robots and return its R² on the others, as plain data.

    `features`: shape (rows per robot, N, features); `targets`: shape (N, targets).
    """
    rows, count = features.shape[:2]
    test, robot = held_out(count), np.tile(np.arange(count), (rows, 1))
    train_x, test_x = (features[:, part].reshape(-1, features.shape[2]).astype(float) for part in (~test, test))
    train, held = (robot[:, part].ravel() for part in (~test, test))
    fitted = fit_ridge(train_x, targets[train], train)
    found = determination(targets[held], fitted.predict(test_x), held, fitted.guess)
    return found.to_dict() | {"penalty": fitted.penalty, "features": features.shape[2], "rows": len(train)}


def probe_walk(
    walk: FrictionWalk, moments: Moments, per: Per, progress: Callable[[float], None] = lambda share: None
) -> list[dict[str, Any]]:
    """Probe every input of a walk; return R² of each, as plain data, with `input`, `row`, `per` and `shuffled`.

    Targets are the joints' f/τ_max; where friction is drawn per robot, its one level. The control beside them is z*
    over the whole walk with the friction of the robots shuffled: what a probe finds by chance.
    """
    targets = walk.friction if per == "joint" else walk.friction[:, :1]
    made = list(inputs(walk, moments))
    found = []
    for number, (name, row, make) in enumerate(made):
        found.append({"input": name, "row": row, "per": per, "shuffled": False} | probe(make(), targets))
        progress((number + 1) / (len(made) + 1))
    mixed = targets[np.random.default_rng(0).permutation(len(targets))]
    control = {"input": "latent", "row": "walk", "per": per, "shuffled": True}
    found.append(control | probe(windows(walk.latent, len(walk.latent)), mixed))
    progress(1.0)
    return found
