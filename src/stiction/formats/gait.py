"""What was measured of a gait, as records."""

from __future__ import annotations

from dataclasses import dataclass

BOTH, NO_TROT, NO_UNSYNC, NEITHER = "both", "no-trot", "no-unsync", "neither"
"""Which of the paper's gait rewards a policy was trained with."""

VARIANTS = {
    BOTH: "r_trot and r_unsync",
    NO_TROT: "r_unsync alone",
    NO_UNSYNC: "r_trot alone",
    NEITHER: "neither of them",
}
"""Variant -> its gait rewards in words."""


@dataclass(frozen=True)
class GaitRow:
    """How one policy walked under one command; shares are of moving steps, None where there are none."""

    policy: str
    """Name of the bundle."""
    variant: str
    """One of `VARIANTS`."""
    seed: int
    """Seed of the training run."""
    command: str
    """Commanded velocity: `vx=0.5`."""
    gait: str
    """What the criteria of `transfer.gait` call it."""
    speed_ratio: float | None
    """Speed reached along the command over the commanded speed [-]."""
    fall_rate: float
    """Share of episodes with a fall [-]."""
    moving_share: float
    """Share of all steps that are moving ones [-]."""
    tripod_share: float | None
    """Exactly one contact group on the ground [-]."""
    first_group_share: float | None
    """Exactly contact group 0 on the ground [-]."""
    second_group_share: float | None
    """Exactly contact group 1 on the ground [-]."""
    flight_share: float | None
    """No foot on the ground [-]."""
    all_feet_share: float | None
    """All feet on the ground [-]."""
    together_share: float | None
    """Touch-downs and lift-offs in which every foot takes part: 1 is a pronk, 0 a tripod [-]."""
    within_groups: float | None
    """Mean correlation of the contacts of two feet of one group: 1 where they move as one [-]."""
    across_groups: float | None
    """Mean correlation of the contacts of two feet of different groups: -1 is a tripod, 1 a pronk [-]."""
    one_sidedness: float | None
    """Difference of the two groups' use over their sum, in windows of 2 s: 0 is even, 1 is one group alone [-]."""


@dataclass(frozen=True)
class FootRow:
    """One foot of one policy under one command."""

    policy: str
    """Name of the bundle."""
    command: str
    """Commanded velocity."""
    foot: str
    """Name of the leg: `FL`."""
    group: int
    """Its contact group, 0 or 1."""
    duty_factor: float | None
    """Share of moving steps on the ground [-]."""
    stride_frequency: float | None
    """Touch-downs per second of moving [Hz]."""


@dataclass(frozen=True)
class ClaimRow:
    """A sentence of the paper, and what became of it."""

    sentence: str
    """As printed."""
    criterion: str
    """What was asked of the numbers."""
    verdict: str
    """`reproduces`, `does not reproduce`, `not decided` or `not tested`, and why."""
    figures: str
    """The numbers that it rests on, seed by seed."""
