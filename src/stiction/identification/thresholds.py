"""From which friction on a policy that was trained without it suffers, and what that rests on.

It is read from the part of `advice.json` that `stiction replicate` writes from its rows; its policies are of trainings
of its own, and say nothing about those that are advised.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from stiction.core.errors import StictionError
from stiction.files.advice import TRANSFER, FrictionEffect, Source
from stiction.files.results import DIRECTIONS, FOLLOWS
from stiction.identification.advice import GROUND_AND_LAW, TRAINED_IN, place_text, shipped

COUNTS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")
"""Small numbers in words."""


@dataclass(frozen=True)
class Thresholds:
    """From which friction on a policy that was trained without it suffers, over the torque limit [-]."""

    noticeable: float
    """Lowest level that cost speed, in any engine."""
    cost: str
    """What share of their speed it cost policies there [%], `1` or `1 to 2`."""
    severe: float
    """Lowest level at which no training seed followed, in any engine."""
    dead_band: float
    """Largest dead band that went with `noticeable` [rad]."""
    text: str
    """What the policies did, in words."""
    robot: str
    """The robot that they walked, in words."""

    @classmethod
    def of(cls, sources: Mapping[str, Source] | None = None) -> Thresholds:
        """Return what the comparison of engines says. sources: as of `advise`.

        Raises:
            StictionError: no friction was noticeable there, or no comparison was made.

        """
        source = (shipped() if sources is None else sources)[TRANSFER]
        effects = source.effects
        noticed = [effect for effect in effects if effect.noticeable is not None]
        severe = [effect.severe for effect in effects if effect.severe is not None]
        if not noticed or not severe:
            raise StictionError(
                "the file that the verdict rests on names no friction that slows policies; expected what "
                "`stiction replicate --advice` writes from several training seeds of the method none"
            )
        first = min(noticed, key=lambda effect: effect.noticeable or 0.0)
        level = first.noticeable or 0.0
        cost = _cost_text(level, source)
        text = _evidence_text(level, cost, source)
        return cls(level, cost, min(severe), first.dead_band or 0.0, text, source.robot_text)

    def effect(self, high: float) -> str:
        """Return what friction of `high` times the torque limit does to a policy that never met it."""
        if high < self.noticeable:
            return "By itself it probably does not trouble a walking policy"
        if high < self.severe:
            return "It may slow down a policy that was trained without friction"
        return "A policy that was trained without friction will probably lose much of its speed"


def _cost_text(noticeable: float, source: Source) -> str:
    """Say what friction of this level cost [%], outside of the training's simulator where it did so there."""
    where = [effect for effect in source.effects if effect.noticeable == noticeable]
    where = [effect for effect in where if effect.engine != TRAINED_IN] or where
    costs = sorted({round(100 * (effect.speed_loss or 0.0)) for effect in where})
    return f"{costs[0]} to {costs[-1]}" if len(costs) > 1 else f"{costs[0]}"


def _evidence_text(noticeable: float, cost: str, source: Source) -> str:
    """Say what friction did to policies that were trained without it, engine by engine."""
    effects = source.effects
    seeds = max(effect.seeds for effect in effects)
    number = COUNTS[seeds] if seeds < len(COUNTS) else str(seeds)
    slowed: dict[int, list[FrictionEffect]] = {}
    for effect in effects:
        if effect.onset is not None:
            slowed.setdefault(round(100 * effect.onset), []).append(effect)
    onsets = [_onset_text(level, same) for level, same in slowed.items()]
    text = (
        f"Provisional: in simulations of one robot, {source.robot_text}, {GROUND_AND_LAW}, {number} training seeds of "
        f"the comparison's own, friction of {100 * noticeable:g} % of the torque limit cost such policies {cost} % of "
        f"{DIRECTIONS[0].removeprefix('vx=')} m/s."
    )
    if not onsets:
        return text
    listed = onsets[0] if len(onsets) == 1 else f"{', '.join(onsets[:-1])}, and {onsets[-1]}"
    return f"{text} Their slower direction slowed under {100 * FOLLOWS[0]:g} % of it {listed}."


def _onset_text(level: int, effects: Sequence[FrictionEffect]) -> str:
    """Say where policies became too slow at a level [%], and whether they were before there was any friction."""
    text = f"with {level} % {' and '.join(place_text(effect.engine) for effect in effects)}"
    speed = max(effect.frictionless_speed for effect in effects)
    return f"{text}, where it was at {round(100 * speed)} % without friction" if speed < FOLLOWS[0] else text
