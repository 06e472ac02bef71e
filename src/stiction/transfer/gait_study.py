"""Drives policies and measures their gaits, and reads off which of the gait rewards they were trained with."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from stiction.formats.bundle import Bundle
from stiction.formats.errors import StictionError
from stiction.formats.gait import BOTH, NEITHER, NO_TROT, NO_UNSYNC, FootRow, GaitRow
from stiction.locomotion.config import RewardCfg
from stiction.robots.spec import RobotSpec
from stiction.transfer.command import Command
from stiction.transfer.evaluate import EvaluationCfg, drive_bundle
from stiction.transfer.gait import measure_gait
from stiction.transfer.metrics import Recording, moving_steps, speed_ratio

REWARDS = "--task.rewards."
"""How the flags of reward weights begin."""


def variant_of(trot: float, unsync: float) -> str:
    """Return the variant that the weights of the two gait rewards make."""
    return {(True, True): BOTH, (False, True): NO_TROT, (True, False): NO_UNSYNC, (False, False): NEITHER}[
        bool(trot), bool(unsync)
    ]


def trained_variant(command: str) -> str:
    """Return the variant that a training command made; weights that it does not name have their defaults.

    Raises:
        StictionError: it is not a command that starts a training, or a weight in it is not a number.

    """
    words = shlex.split(command)
    if words[:2] != ["stiction", "train"] or "--resume" in words:
        raise StictionError(
            f"a policy made by {command!r}: that does not tell its gait rewards; name the variant of each bundle with "
            "--variants"
        )
    flags = [word for argument in words for word in argument.split("=", 1)]
    weights = {name: float(getattr(RewardCfg(), name)) for name in ("trot", "unsync")}
    for word, value in zip(flags, [*flags[1:], ""], strict=True):
        if (name := word.removeprefix(REWARDS)) in weights and word.startswith(REWARDS):
            try:
                weights[name] = float(value)
            except ValueError as error:
                raise StictionError(f"{word} {value!r} in {command!r}: expected a number") from error
    return variant_of(weights["trot"], weights["unsync"])


def trained_alike(bundles: Sequence[Bundle]) -> bool:
    """Return whether policies have the same robot, ground and friction in training, as far as contracts tell."""
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
    first = bundles[0].contract
    return all(getattr(bundle.contract, name) == getattr(first, name) for bundle in bundles for name in names)


@dataclass(frozen=True)
class Walked:
    """One policy under one command."""

    row: GaitRow
    """Its gait."""
    feet: tuple[FootRow, ...]
    """Its feet, left ones from front to rear, then right ones."""
    contact: np.ndarray
    """Contacts of its first episode, in the order of `feet`, bool, shape (T, L)."""
    period: float
    """Control period [s]."""


def foot_order(spec: RobotSpec) -> list[int]:
    """Return the legs left before right, each side from front to rear."""
    return sorted(range(len(spec.legs)), key=lambda leg: (-spec.legs[leg].side, -spec.legs[leg].mount[0]))


def walk_gaits(
    bundle: Bundle,
    variant: str,
    cfg: EvaluationCfg,
    robot: str | None = None,
    threads: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> list[Walked]:
    """Drive a policy over the commands, and measure its gait under each; arguments as in `evaluate_bundle`.

    Raises:
        StictionError: the bundle does not fit the robot, more than one friction level is asked for, or a command to
            stand.

    """
    if len(cfg.friction_levels) != 1:
        raise StictionError(f"friction levels {cfg.friction_levels}: expected one, a gait is shown at one at a time")
    if still := [command.label for command in cfg.parsed_commands if command.direction is None]:
        raise StictionError(f"command {still[0]!r} asks for no motion, and there is no gait in it")
    driven = drive_bundle(bundle, cfg, robot, threads, progress)
    return [_measure(bundle, variant, driven.spec, command, part) for _, command, part in driven.parts]


def _measure(bundle: Bundle, variant: str, spec: RobotSpec, command: Command, part: Recording) -> Walked:
    """Return the gait of one command that asks for motion."""
    moving = moving_steps(part, command)
    assert moving is not None
    order, groups = foot_order(spec), spec.groups()
    gait = measure_gait(part.contact, moving, groups, part.period)
    first, second = gait.group_share or (None, None)
    row = GaitRow(
        policy=bundle.name,
        variant=variant,
        seed=bundle.contract.seed,
        command=command.label,
        gait=gait.name,
        speed_ratio=speed_ratio(part, command),
        fall_rate=float(1.0 - part.upright[-1].mean()),
        moving_share=gait.moving_share,
        tripod_share=gait.tripod_share,
        first_group_share=first,
        second_group_share=second,
        flight_share=gait.flight_share,
        all_feet_share=gait.all_feet_share,
        together_share=gait.together_share,
        within_groups=gait.within_groups,
        across_groups=gait.across_groups,
        one_sidedness=gait.one_sidedness,
    )
    feet = tuple(
        FootRow(
            bundle.name,
            command.label,
            spec.legs[leg].name,
            spec.legs[leg].group,
            gait.duty_factor[leg] if gait.duty_factor else None,
            gait.stride_frequency[leg] if gait.stride_frequency else None,
        )
        for leg in order
    )
    return Walked(row, feet, part.contact[:, 0, order], part.period)
