"""Checks of vectorised environments: randomised values cover their declared range, and dry friction holds joints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from stiction.core.errors import ConfigurationError, unknown_name

Range = tuple[float, float]
"""Lowest and highest value."""

LEAST_SHARE = 0.05
"""Minimum share of its range that an acting value covers, linear or logarithmic [1]."""
LEAST_DRAWS = 6
"""Minimum draws to judge the covered share: with six uniform ones it is below 5 % twice in a million."""

HOLDING = 0.8
"""Torque over dry friction under which a joint must hold [1]."""
CREEP = 1e-2
"""Maximum motion of a holding joint [rad] or [m]: in 1 s MuJoCo's stiffest rows of friction creep 1 to 6 mrad on Go1
and G1, by the torque over the inertia (`FRICTION_D0`), and its default rows more than 20."""


@dataclass(frozen=True)
class Draw:
    """Observations of one randomised value."""

    name: str
    declared: Range | None
    """Declared range; None where unknown."""
    seen: Range | None
    """Lowest and highest value over worlds, resets and entries; None without any number."""
    still: tuple[int, ...]
    """Entries (joints, geometries) that never changed, or by less than 5 % of the range: their numbers in an array
    without its first dimension."""
    verdict: str
    """`acts`, `constant, as declared`, or the fault."""
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
    where all of it is in its range and, from six draws on, covers 5 % of that or more. One that is drawn once, as the
    environment is made, acts as well.

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
    >>> draws = check_draws(reset, lambda: model, {"friction": (0.0, 0.2), "mass": (0.9, 1.1)})
    >>> print(*(draw.verdict for draw in draws), sep="; ")
    does not act: one value for all worlds; acts

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
    elif (covered := _covered(values, low, high)).min() < LEAST_SHARE:
        still = tuple(np.flatnonzero(covered < LEAST_SHARE).tolist())
        some = f" in {len(still)} of {values.shape[2]}" if len(still) < values.shape[2] else ""
        verdict = f"does not act{some}: covers {100 * covered.min():.2g} % of its range"
    else:
        verdict, ok = "acts", True
    return Draw(name, declared, seen, still, verdict, ok)


def _covered(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return the share of a range that each entry covers [1], 1 where there are too few draws or no range.

    values: of shape (resets, worlds, entries). The larger of the linear and the logarithmic share, since a value that
    is uniform in its logarithm stays near the low end of a wide range.
    """
    draws = len(np.unique(values.reshape(-1, values.shape[2]), axis=0))
    if draws < LEAST_DRAWS or not np.isfinite(high - low) or low == high:
        return np.ones(values.shape[2])
    least, most = values.min(axis=(0, 1)), values.max(axis=(0, 1))
    covered = (most - least) / (high - low)
    if low > 0:
        covered = np.maximum(covered, np.log(most / np.maximum(least, low)) / np.log(high / low))
    return covered


@dataclass(frozen=True)
class Hold:
    """Motion of one joint under less torque than its dry friction."""

    name: str
    friction: float
    """Dry friction, maximum over worlds [N m]."""
    moved: float
    """Largest distance from the first position, over worlds and steps [rad]; infinite where it is not-a-number."""
    ok: bool
    """True if the joint holds: it moved 10 mrad or less."""

    @property
    def verdict(self) -> str:
        """`ok` in words."""
        return "holds" if self.ok else "does not hold"


def check_hold(
    step: Callable[[np.ndarray], object],
    read: Callable[[], Any],
    friction: Mapping[str, Any],
    *,
    steps: int,
    share: float = HOLDING,
) -> list[Hold]:
    """Put joints of a vectorised environment under a share of their dry friction, and measure that they hold.

    Nothing but friction must act on the joints: no gravity, contacts, motors or springs. With a share above 1 the
    joints must move, which shows that the torque acts.

    Args:
        step: applies torques of shape (worlds, joints) [N m] for one physics step.
        read: returns the positions of the joints, of shape (worlds, joints) [rad].
        friction: joint -> dry friction [N m], a number or one for each world, in the order of the joints; 0 leaves
            the joint without torque.
        steps: physics steps; a second's worth shows creep.
        share: torque over friction [1].

    Returns one `Hold` for each joint, in their order.

    Raises `ConfigurationError` for friction that is negative, positions of another shape, and no steps.

    >>> import numpy as np
    >>> from stiction import check_hold
    >>> friction, angle, speed = np.array([2.0, 2.0]), np.zeros((4, 2)), np.zeros((4, 2))
    >>> def step(torque):  # of 0.1 kg m², for 5 ms; the second joint has a tenth of its friction
    ...     brake = friction * [1.0, 0.1]
    ...     speed[:] += 0.005 / 0.1 * np.sign(torque) * np.maximum(np.abs(torque) - brake, 0.0)
    ...     angle[:] += 0.005 * speed
    >>> joints = check_hold(step, lambda: angle, {"hip": 2.0, "knee": 2.0}, steps=200)
    >>> print(*(joint.verdict for joint in joints), sep="; ")
    holds; does not hold

    """
    if steps < 1:
        raise ConfigurationError(f"check_hold: got {steps} steps, expected 1 or more")
    # A copy: environments hand out views of what they overwrite.
    first = np.array(read(), dtype=float)
    if first.ndim != 2 or first.shape[1] != len(friction) or not first.size:
        raise ConfigurationError(
            f"check_hold: got positions of shape {first.shape}, expected (worlds, {len(friction)}), one for each joint "
            "of friction"
        )
    bound = np.empty(first.shape)
    for number, (name, of_joint) in enumerate(friction.items()):
        values = np.asarray(of_joint, dtype=float)
        if values.shape not in ((), first.shape[:1]) or not (values >= 0).all():
            raise ConfigurationError(
                f"check_hold: got friction of {name!r} of shape {values.shape}, lowest {values.min(initial=np.inf):g}, "
                f"expected a number or {len(first)}, 0 or more"
            )
        bound[:, number] = values
    moved = np.zeros(len(friction))
    for _ in range(steps):
        step(share * bound)
        distance = np.abs(np.asarray(read(), dtype=float) - first)
        moved = np.maximum(moved, np.nan_to_num(distance, nan=np.inf).max(axis=0))
    most = bound.max(axis=0)
    return [
        Hold(name, float(most[number]), float(moved[number]), bool(moved[number] <= CREEP))
        for number, name in enumerate(friction)
    ]
