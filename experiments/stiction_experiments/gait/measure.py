"""Gait from the feet's contacts: pure functions of (T, N, L) arrays, and the criteria that name it.

The paper: in a *pronk* all feet touch the ground or lift off simultaneously; in its *trot* of a hexapod, a tripod, one
contact group stands while the other is lifted; in *three-legged hopping* one contact group does all the work.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np

from stiction.core.errors import ConfigurationError, RobotError
from stiction.core.records import column, part_of
from stiction.evaluation.evaluate import EvaluationCfg, drive_bundle
from stiction.evaluation.metrics import moving_steps, set_share, speed_ratio
from stiction.files.bundle import Bundle
from stiction.files.velocity import Command
from stiction.files.walk import Recording
from stiction.robots.model import Robot, foot_places
from stiction.task.rewards import RewardCfg

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

NO_GAIT = "none of these"
"""Name of a walk without a named gait."""

TRIPOD = 0.5
"""A gait is a tripod where exactly one group is on the ground in at least this share of moving steps [-]."""

STANDS = 0.5
"""A robot that moves in less than this share of its steps has no gait [-]."""


@dataclass(frozen=True)
class Gait:
    """The numbers of one policy under one command, as in `GaitRow`; None where they do not exist."""

    moving_share: float
    tripod_share: float | None = None
    first_group_share: float | None = None
    second_group_share: float | None = None
    flight_share: float | None = None
    all_feet_share: float | None = None
    together_share: float | None = None
    within_groups: float | None = None
    across_groups: float | None = None
    one_sidedness: float | None = None
    duty_factor: tuple[float, ...] | None = None
    """By foot."""
    stride_frequency: tuple[float, ...] | None = None
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
        return NO_GAIT


def measure_gait(contact: np.ndarray, moving: np.ndarray, groups: np.ndarray, period: float) -> Gait:
    """Measure a gait.

    contact: feet on the ground, bool, shape (T, N, L); moving: steps that count, bool, shape (T, N); groups: contact
    group (0 or 1) of each foot, shape (L,); period: control period [s].
    """
    if not moving.any():
        return Gait(0.0)
    steps = contact[moving]
    first, second = set_share(steps, groups == 0), set_share(steps, groups == 1)
    shortest, window = round(SHORTEST / period), round(SIMULTANEOUS / period)
    landings, lifts = events(contact, shortest), events(~contact, shortest)
    within, across = correlations(contact, moving, groups)
    return Gait(
        moving_share=float(moving.mean()),
        tripod_share=first + second,
        first_group_share=first,
        second_group_share=second,
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
    changes = np.zeros_like(contact)
    away = np.zeros(contact.shape[1:], int)
    for step, down in enumerate(contact):
        changes[step] = down & (away >= max(shortest, 1))
        away = np.where(down, 0, away + 1)
    return changes


def together_share(per_kind: list[np.ndarray], moving: np.ndarray, window: int) -> float | None:
    """Return the share of events in moving steps that all feet take part in, within `window` steps; None without any.

    per_kind: touch-downs and lift-offs, each bool of shape (T, N, L), each compared with themselves only.
    """
    total = shared = 0
    for touches in per_kind:
        near = touches.copy()
        for shift in range(1, window + 1):
            near[shift:] |= touches[:-shift]
            near[:-shift] |= touches[shift:]
        # Partners are looked for in all steps, events counted in moving ones: one at the edge of a stop has its
        # partners too.
        counted = touches & moving[..., None]
        total += int(counted.sum())
        shared += int((counted & near.all(axis=-1, keepdims=True)).sum())
    return shared / total if total else None


def correlations(contact: np.ndarray, moving: np.ndarray, groups: np.ndarray) -> tuple[float | None, float | None]:
    """Return the mean correlation of two feet's contacts, of one group and of two; shapes as in `measure_gait`.

    Robot by robot; feet that never change have none. None where no pair has one.
    """
    pairs: dict[bool, list[float]] = {True: [], False: []}
    for robot in range(contact.shape[1]):
        steps = contact[moving[:, robot], robot].astype(float)
        if len(steps) < 2:
            continue
        apart = steps - steps.mean(axis=0)
        size = np.sqrt((apart**2).sum(axis=0))
        for one, other in combinations(np.flatnonzero(size > 0), 2):
            value = float(apart[:, one] @ apart[:, other] / (size[one] * size[other]))
            pairs[bool(groups[one] == groups[other])].append(value)
    within, across = (float(np.mean(values)) if values else None for values in pairs.values())
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


BOTH, NO_TROT, NO_UNSYNC, NEITHER = "both", "no-trot", "no-unsync", "neither"
"""Sets of the paper's gait rewards in training."""

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

    policy: str = field(metadata=column("policy"))
    variant: str = field(metadata=column("rewards"))
    """One of `VARIANTS`."""
    seed: int
    command: str = field(metadata=column("command"))
    gait: str = field(metadata=column("gait"))
    """Name by the criteria of `Gait.name`."""
    speed_ratio: float | None = field(metadata=column("speed ratio", "1", form=".2f"))
    """Speed reached along the command over the commanded speed [-]."""
    fall_rate: float = field(metadata=column("falls", "%", form=".0%"))
    """Share of episodes with a fall [-]."""
    moving_share: float = field(metadata=column("moving", "%", form=".0%"))
    """Share of all steps that are moving ones [-]."""
    tripod_share: float | None = field(metadata=column("tripod", "%", form=".0%"))
    """Exactly one contact group on the ground [-]."""
    first_group_share: float | None = field(metadata=column("group 0", "%", form=".0%"))
    """Exactly contact group 0 on the ground [-]."""
    second_group_share: float | None = field(metadata=column("group 1", "%", form=".0%"))
    """Exactly contact group 1 on the ground [-]."""
    flight_share: float | None = field(metadata=column("flight", "%", form=".0%"))
    """No foot on the ground [-]."""
    all_feet_share: float | None = field(metadata=column("all feet", "%", form=".0%"))
    """All feet on the ground [-]."""
    together_share: float | None = field(metadata=column("together", "%", form=".0%"))
    """Touch-downs and lift-offs in which every foot takes part: 1 is a pronk, 0 a tripod [-]."""
    within_groups: float | None = field(metadata=column("within", "1", form=".2f"))
    """Mean correlation of the contacts of two feet of one group: 1 where they move as one [-]."""
    across_groups: float | None = field(metadata=column("across", "1", form=".2f"))
    """Mean correlation of the contacts of two feet of different groups: -1 is a tripod, 1 a pronk [-]."""
    one_sidedness: float | None = field(metadata=column("one-sidedness", "1", form=".2f"))
    """Difference of the two groups' use over their sum, in windows of 2 s: 0 is even, 1 is one group alone [-]."""


@dataclass(frozen=True)
class FootRow:
    """One foot of one policy under one command."""

    policy: str
    command: str
    foot: str
    """Name of the leg: `FL`."""
    group: int
    """Its contact group, 0 or 1."""
    duty_factor: float | None
    """Share of moving steps on the ground [-]."""
    stride_frequency: float | None
    """Touch-downs per second of moving [Hz]."""


REWARDS = "task.rewards."
"""How the settings of reward weights begin; they were flags once."""


def trained_variant(command: str) -> str:
    """Return the variant that a training command trains; weights that it does not name have their defaults.

    Raises:
        StictionError: it is not a command that starts a training, or a weight in it is not a number.

    """
    words = shlex.split(command)
    if words[:2] != ["stiction", "train"] or "--resume" in words:
        raise ConfigurationError(
            f"a policy made by {command!r}: that does not name its gait rewards; name the variant of each bundle with "
            "--variants"
        )
    flags = [word for argument in words for word in argument.split("=", 1)]
    weights = {name: float(getattr(RewardCfg(), name)) for name in ("trot", "unsync")}
    for word, value in zip(flags, [*flags[1:], ""], strict=True):
        setting = word.removeprefix("--")
        if (name := setting.removeprefix(REWARDS)) in weights and setting != name:
            try:
                weights[name] = float(value)
            except ValueError as error:
                raise ConfigurationError(f"{word} {value!r} in {command!r}: expected a number") from error
    trot, unsync = map(bool, weights.values())
    return (BOTH if unsync else NO_UNSYNC) if trot else (NO_TROT if unsync else NEITHER)


def trained_alike(policies: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether policies have the same robot, ground and friction in training, by what contracts say of them."""
    names = (
        "robot",
        "terrain",
        "method",
        "friction_law",
        "friction_level",
        "friction_range",
        "joints_file",
        "actuator",
    )
    return all(policy.get(name) == policies[0].get(name) for policy in policies for name in names)


@dataclass(frozen=True)
class Walked:
    """One policy under one command."""

    row: GaitRow
    feet: tuple[FootRow, ...]
    """Its feet, left ones from front to rear, then right ones."""
    contact: np.ndarray
    """Contacts of its first episode, in the order of `feet`, bool, shape (T, L)."""
    period: float
    """Control period [s]."""


def walk_gaits(
    bundle: Bundle,
    variant: str,
    cfg: EvaluationCfg,
    robot: str | None = None,
    threads: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> list[Walked]:
    """Drive a policy over the commands at the one friction level of `cfg`, and measure its gait under each.

    Arguments as of `evaluate_bundle`.

    Raises:
        StictionError: the bundle does not fit the robot, or a command asks for no motion.

    """
    if still := [command.label for command in cfg.parsed_commands if command.direction is None]:
        raise ConfigurationError(f"command {still[0]!r} asks for no motion, and there is no gait in it")
    driven = drive_bundle(bundle, cfg, robot, threads, progress)
    return [_measure(bundle, variant, driven.spec, command, part) for _, command, part in driven.parts]


def _measure(bundle: Bundle, variant: str, spec: Robot, command: Command, part: Recording) -> Walked:
    moving = moving_steps(part, command)
    assert moving is not None
    # Left legs before right ones, each side from front to rear.
    places = foot_places(spec, spec.joint_values("default_position"))
    order = sorted(range(len(spec.feet)), key=lambda foot: (places[foot, 1] < 0, -places[foot, 0]))
    groups = spec.groups()
    if groups is None:
        raise RobotError(
            f"robot {spec.name!r} has no contact groups, which the study of gaits is about; give it groups"
        )
    gait = measure_gait(part.contact, moving, groups, part.period)
    row = part_of(
        GaitRow,
        gait,
        policy=bundle.name,
        variant=variant,
        seed=bundle.contract.seed,
        command=command.label,
        gait=gait.name,
        speed_ratio=speed_ratio(part, command),
        fall_rate=float(1.0 - part.upright[-1].mean()),
    )
    feet = tuple(
        FootRow(
            bundle.name,
            command.label,
            spec.feet[leg].name.removesuffix("_foot"),
            int(groups[leg]),
            gait.duty_factor[leg] if gait.duty_factor else None,
            gait.stride_frequency[leg] if gait.stride_frequency else None,
        )
        for leg in order
    )
    return Walked(row, feet, part.contact[:, 0, order], part.period)
