"""Measure whether randomised values act: what they are over worlds and resets, beside their declared range."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from stiction.core.errors import ConfigurationError, unknown_name

Range = tuple[float, float]
"""Lowest and highest value."""


@dataclass(frozen=True)
class Draw:
    """What was seen of one randomised value."""

    name: str
    declared: Range | None
    """Range that was declared; None where none is known."""
    seen: Range | None
    """Lowest and highest value over worlds, resets and entries; None where there was no number."""
    still: tuple[int, ...]
    """Entries (joints, geometries) that never changed, by their number in an array without its first dimension."""
    verdict: str
    """`acts`, `constant, as declared`, or what is wrong."""
    ok: bool


def check_draws(
    reset: Callable[[], object],
    read: Callable[[], Mapping[str, Any]],
    ranges: Mapping[str, Range | None],
    *,
    resets: int = 4,
) -> list[Draw]:
    """Reset a vectorised environment several times, and say of each randomised value whether it acts.

    A value acts where each of its entries differs over worlds and resets, where worlds differ from each other, and
    where all of it is in its range. One that is drawn once, as the environment is made, acts as well.

    Args:
        reset: resets all worlds, and draws.
        read: returns name -> array of shape (worlds, ...), as the physics has it now; not-a-number in an entry that
            cannot change, such as a multiple of 0.
        ranges: name -> lowest and highest value, None where no range is known; names that are read and not declared
            are left out.
        resets: how often.

    Returns one `Draw` for each declared value, in their order.

    Raises `ConfigurationError` for a name that is not read, a range from high to low, and an array of another shape.

    >>> import numpy as np
    >>> from stiction import check_draws
    >>> rng, model = np.random.default_rng(0), {}
    >>> def reset():
    ...     model["friction"] = np.tile(rng.uniform(0.0, 0.2), (8, 12))  # one number for all worlds
    ...     model["mass"] = rng.uniform(0.9, 1.1, (8, 1))
    >>> [draw.verdict for draw in check_draws(reset, lambda: model, {"friction": (0.0, 0.2), "mass": (0.9, 1.1)})]
    ['does not act: one value for all worlds', 'acts']

    """
    if resets < 1:
        raise ConfigurationError(f"check_draws: got {resets} resets, expected 1 or more")
    for name, declared in ranges.items():
        if declared is not None and not declared[0] <= declared[1]:
            raise ConfigurationError(f"check_draws: got {declared} for {name!r}, expected (lowest, highest)")
    seen: dict[str, list[np.ndarray]] = {name: [] for name in ranges}
    for _ in range(resets):
        reset()
        values = read()
        for name, rows in seen.items():
            if name not in values:
                raise ConfigurationError(f"check_draws: {unknown_name('value', name, values)}")
            # A copy: environments hand out views of what they overwrite.
            rows.append(np.array(values[name], dtype=float))
            if rows[-1].ndim < 1 or rows[-1].shape != rows[0].shape or not rows[-1].size:
                raise ConfigurationError(
                    f"check_draws: got {name!r} of shape {rows[-1].shape}, expected (worlds, ...), at each reset"
                )
    return [judge_draw(name, np.stack(rows), ranges[name]) for name, rows in seen.items()]


def judge_draw(name: str, values: np.ndarray, declared: Range | None) -> Draw:
    """Judge one value; values: of shape (resets, worlds, ...)."""
    values = values.reshape(*values.shape[:2], -1)
    numbers = values[np.isfinite(values)]
    seen = (float(numbers.min()), float(numbers.max())) if numbers.size else None
    # Of a not-a-number no difference is 0, nor anything else.
    changes = np.ptp(values, axis=(0, 1)) > 0
    still = tuple(np.flatnonzero(~changes).tolist())
    low, high = declared or (-np.inf, np.inf)
    # Single precision, and a difference or a quotient of it.
    margin = 1e-5 * max(abs(low), abs(high)) if declared else 0.0
    ok = False
    if seen is not None and not (low - margin <= seen[0] and seen[1] <= high + margin):
        verdict = "does not act: outside its range"
    elif low == high and len(numbers) == values.size:
        verdict, ok = "constant, as declared", True
    elif len(still) == values.shape[2]:
        verdict = "does not act: the same in all worlds and resets"
    elif still:
        verdict = f"does not act in {len(still)} of {values.shape[2]}"
    elif values.shape[1] > 1 and not np.ptp(values, axis=1).any():
        verdict = "does not act: one value for all worlds"
    else:
        verdict, ok = "acts", True
    return Draw(name, declared, seen, still, verdict, ok)
