"""What a gait is, from the feet's contacts: pure functions of (T, N, L) arrays, and the criteria that name it.

The paper: in a *pronk* all feet touch the ground or lift off simultaneously; in its *trot* of a hexapod, a tripod, one
contact group stands while the other is lifted; in *three-legged hopping* one contact group does all the work.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from stiction.transfer.metrics import set_share

SHORTEST = 0.06
"""A foot that leaves the ground, or touches it, for less than this has bounced or scuffed: no lift-off, no touch-down
[s]."""

SIMULTANEOUS = 0.06
"""Events of two feet that are no further apart than this happen together [s]: a quarter of a tripod's half stride."""

UNSYNC_WINDOW = 2.0
"""Windows over which the use of the two groups is compared [s], the H of r_unsync in training."""

PRONK = 0.5
"""A gait is a pronk where at least this share of touch-downs and lift-offs is of all feet together [-]."""

HOP = 0.5
"""A gait is a hop where one-sidedness is at least this: one group's feet are down three times as often [-]."""

TRIPOD = 0.5
"""A gait is a tripod where exactly one group is on the ground in at least this share of moving steps [-]."""

STANDS = 0.5
"""A robot that moves in less than this share of its steps has no gait to speak of [-]."""


@dataclass(frozen=True)
class Gait:
    """The numbers of one policy under one command; None where they do not exist."""

    moving_share: float
    tripod_share: float | None
    group_share: tuple[float, float] | None
    flight_share: float | None
    all_feet_share: float | None
    together_share: float | None
    within_groups: float | None
    across_groups: float | None
    one_sidedness: float | None
    duty_factor: tuple[float, ...] | None
    """By foot."""
    stride_frequency: tuple[float, ...] | None
    """By foot [Hz]."""

    @property
    def name(self) -> str:
        """Return what the criteria above call it."""
        if self.moving_share < STANDS:
            return "stands"
        if self.together_share is not None and self.together_share >= PRONK:
            return "pronk"
        if self.one_sidedness is not None and self.one_sidedness >= HOP:
            return "hop on one group"
        if self.tripod_share is not None and self.tripod_share >= TRIPOD:
            return "tripod"
        return "none of these"


def measure_gait(contact: np.ndarray, moving: np.ndarray, groups: np.ndarray, period: float) -> Gait:
    """Measure a gait.

    contact: feet on the ground, bool, shape (T, N, L); moving: steps that count, bool, shape (T, N); groups: contact
    group (0 or 1) of each foot, shape (L,); period: control period [s].
    """
    if not moving.any():
        return Gait(0.0, *[None] * 10)
    steps = contact[moving]
    first, second = set_share(steps, groups == 0), set_share(steps, groups == 1)
    shortest, window = round(SHORTEST / period), round(SIMULTANEOUS / period)
    landings, lifts = events(contact, shortest), events(~contact, shortest)
    within, across = correlations(contact, moving, groups)
    return Gait(
        moving_share=float(moving.mean()),
        tripod_share=first + second,
        group_share=(first, second),
        flight_share=set_share(steps, np.zeros(len(groups), bool)),
        all_feet_share=set_share(steps, np.ones(len(groups), bool)),
        together_share=together_share([landings, lifts], moving, window),
        within_groups=within,
        across_groups=across,
        one_sidedness=one_sidedness(contact, moving, groups, round(UNSYNC_WINDOW / period)),
        duty_factor=tuple(steps.mean(axis=0).tolist()),
        stride_frequency=tuple((landings[moving].sum(axis=0) / (moving.sum() * period)).tolist()),
    )


def events(contact: np.ndarray, shortest: int) -> np.ndarray:
    """Return where feet touch down after at least `shortest` steps off the ground, bool, shape (T, N, L).

    With contacts negated these are the lift-offs. How long a foot was up before the first step is not known, so it
    counts from there.
    """
    found = np.zeros_like(contact)
    away = np.zeros(contact.shape[1:], int)
    for step, down in enumerate(contact):
        found[step] = down & (away >= max(shortest, 1))
        away = np.where(down, 0, away + 1)
    return found


def together_share(kinds: list[np.ndarray], moving: np.ndarray, window: int) -> float | None:
    """Return the share of events in moving steps that all feet take part in, within `window` steps; None without any.

    kinds: touch-downs and lift-offs, each bool of shape (T, N, L), each compared with its own kind only.
    """
    total = shared = 0
    for found in kinds:
        near = found.copy()
        for shift in range(1, window + 1):
            near[shift:] |= found[:-shift]
            near[:-shift] |= found[shift:]
        counted = found & moving[..., None]
        total += int(counted.sum())
        shared += int((counted & near.all(axis=-1, keepdims=True)).sum())
    return shared / total if total else None


def correlations(contact: np.ndarray, moving: np.ndarray, groups: np.ndarray) -> tuple[float | None, float | None]:
    """Return the mean correlation of two feet's contacts, of one group and of two; shapes as in `measure_gait`.

    Robot by robot; feet that never change have none. None where no pair has one.
    """
    sums = {True: [], False: []}  # type: dict[bool, list[float]]
    for robot in range(contact.shape[1]):
        steps = contact[moving[:, robot], robot].astype(float)
        if len(steps) < 2:
            continue
        apart = steps - steps.mean(axis=0)
        size = np.sqrt((apart**2).sum(axis=0))
        for one, other in combinations(np.flatnonzero(size > 0), 2):
            value = float(apart[:, one] @ apart[:, other] / (size[one] * size[other]))
            sums[bool(groups[one] == groups[other])].append(value)
    within, across = (float(np.mean(values)) if values else None for values in (sums[True], sums[False]))
    return within, across


def one_sidedness(contact: np.ndarray, moving: np.ndarray, groups: np.ndarray, window: int) -> float | None:
    """Return the mean of |n_0 − n_1| / (n_0 + n_1) over robots and windows of `window` steps; None without contacts.

    n_g: contacts of group g's feet in the moving steps of a window, over the number of its feet.
    """
    used = contact & moving[..., None]
    mean = [used[..., groups == group].mean(axis=-1) for group in (0, 1)]
    values = []
    for start in range(0, len(contact), window):
        first, second = (part[start : start + window].sum(axis=0) for part in mean)
        touched = first + second > 0
        values += (np.abs(first - second)[touched] / (first + second)[touched]).tolist()
    return float(np.mean(values)) if values else None
