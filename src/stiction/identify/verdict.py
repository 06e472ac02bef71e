"""Does this friction matter for a walking policy? A provisional answer in words, with the numbers it rests on.

From which friction on a policy suffers is read from `advice.json` beside this module, which `stiction replicate`
writes from its rows. Which training to choose: see `advice`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from stiction.core.errors import StictionError
from stiction.formats.advice import TRANSFER, FrictionEffect, Source
from stiction.formats.following import LEAST
from stiction.formats.joints import Estimate, JointRecord, JointsFile
from stiction.formats.results import DIRECTIONS, FOLLOWS
from stiction.identify.advice import TRAINED_IN, Advice, advise, shipped
from stiction.identify.reference import CONDITIONS, Placement, Quantity, place

MARGIN = 2.0
"""Factor on friction measured without load. Friction grows with load, by how much is not known here: a choice."""

BUDGET = (
    "Which training follows up to which friction, engine by engine: the friction budget, results/replication/README.md "
    "in stiction's repository; `stiction replicate` makes it anew."
)
"""Where a robot builder looks next."""

TRAINABLE = 0.8
"""Levels from here on leave the motor too little to walk with; training refuses them."""

WHAT_IF = (
    ("seals removed", 0.3, "the paper saw 70 % less without the seals of its own motor"),
    ("worn, x 1.5", 1.5, "a factor chosen, not measured"),
    ("worn, x 2", 2.0, "a factor chosen, not measured"),
    ("worn, x 3", 3.0, "a factor chosen, not measured"),
)
"""Case, factor on the friction, where the factor comes from."""

WITHOUT_FRICTION: dict[str, Any] = {"method": "none", "level": 0.0, "law": "coulomb", "per": "robot"}
"""The fields of `FrictionCfg` where there is no friction to train for."""

PLACES = {"mujoco": "in the simulator that trained them", "physx": "in PhysX", "ode-webots": "in ODE"}
"""Engine -> how people call it; a plus in its name means a virtual robot."""

COUNTS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")
"""Small numbers in words."""


@dataclass(frozen=True)
class Thresholds:
    """From which friction on a policy that was trained without it suffers, over the torque limit [-]."""

    noticeable: float
    """Lowest level that cost speed, in any engine."""
    severe: float
    """Lowest level at which no training seed followed, in any engine."""
    dead_band: float
    """Largest dead band that went with `noticeable` [rad]."""
    text: str
    """What the policies did, in words."""

    @classmethod
    def of(cls, sources: Mapping[str, Source] | None = None) -> Thresholds:
        """Return what the comparison of engines says. sources: as of `advise`.

        Raises:
            StictionError: no friction was noticeable there, or no comparison was made.

        """
        effects = (shipped() if sources is None else sources)[TRANSFER].effects
        noticed = [effect for effect in effects if effect.noticeable is not None]
        severe = [effect.severe for effect in effects if effect.severe is not None]
        if not noticed or not severe:
            raise StictionError(
                "the file that the verdict rests on names no friction that slows policies; expected what "
                "`stiction replicate --advice` writes from several training seeds of the method none"
            )
        first = min(noticed, key=lambda effect: effect.noticeable or 0.0)
        level = first.noticeable or 0.0
        return cls(level, min(severe), first.dead_band or 0.0, _evidence_text(level, effects))

    def effect(self, high: float) -> str:
        """Return what friction of `high` times the torque limit does to a policy that never met it."""
        if high < self.noticeable:
            return "By itself it probably does not trouble a walking policy"
        if high < self.severe:
            return "It may slow down a policy that was trained without friction"
        return "A policy that was trained without friction will probably lose much of its speed"


def _evidence_text(noticeable: float, effects: Sequence[FrictionEffect]) -> str:
    """Say what friction did to policies that were trained without it, engine by engine."""
    seeds = max(effect.seeds for effect in effects)
    number = COUNTS[seeds] if seeds < len(COUNTS) else str(seeds)
    elsewhere = [
        effect for effect in effects if effect.engine != TRAINED_IN and effect.noticeable == noticeable
    ] or effects
    costs = sorted({round(100 * (effect.speed_loss or 0.0)) for effect in elsewhere if effect.noticeable == noticeable})
    cost = f"{costs[0]} to {costs[-1]}" if len(costs) > 1 else f"{costs[0]}"
    slowed: dict[int, list[FrictionEffect]] = {}
    for effect in effects:
        if effect.onset is not None:
            slowed.setdefault(round(100 * effect.onset), []).append(effect)
    onsets = [_onset_text(level, same) for level, same in slowed.items()]
    text = (
        f"Provisional: in simulations of one robot, {number} training seeds, friction of {100 * noticeable:g} % of the "
        f"torque limit cost such policies {cost} % of {DIRECTIONS[0].removeprefix('vx=')} m/s."
    )
    if not onsets:
        return text
    listed = onsets[0] if len(onsets) == 1 else f"{', '.join(onsets[:-1])}, and {onsets[-1]}"
    return f"{text} Their slower direction slowed under {LEAST} of it {listed}."


def _onset_text(level: int, effects: Sequence[FrictionEffect]) -> str:
    """Say where policies became too slow at a level [%], and whether they were before there was any friction."""
    text = f"with {level} % {' and '.join(_place(effect) for effect in effects)}"
    speed = max(effect.frictionless_speed for effect in effects)
    return f"{text}, where it was at {round(100 * speed)} % without friction" if speed < FOLLOWS[0] else text


def _place(effect: FrictionEffect) -> str:
    """Return where an effect was seen."""
    return "on virtual robots" if "+" in effect.engine else PLACES.get(effect.engine, f"in {effect.engine}")


def friction_level(ratio: Estimate, condition: str | None) -> float:
    """Return the level that covers a ratio: the upper end, times `MARGIN` unless it was loaded, up to a whole per cent.

    May be `TRAINABLE` or more; who proposes it has to check.
    """
    high = max(ratio.interval95[1], 0.0)
    return math.ceil(100 * high * (1.0 if condition == "loaded" else MARGIN) - 1e-9) / 100


@dataclass(frozen=True)
class WhatIf:
    """The same joint with its friction multiplied."""

    case: str
    """What would have happened to the joint."""
    factor: float
    """On its friction."""
    friction_ratio: Estimate | None
    """f/τ_max then [1]."""
    dead_band: Estimate | None
    """f/kp then [rad]."""
    friction_level: float | None
    """Friction that a training has to cover then [-]; None where there is none."""
    text: str
    """The same in one sentence."""


def what_if(record: JointRecord, thresholds: Thresholds) -> tuple[WhatIf, ...]:
    """Return every case of `WHAT_IF` for a joint; nothing where neither its ratio nor its dead band is known."""
    if record.friction_ratio is None and record.dead_band is None:
        return ()
    found = []
    for case, factor, origin in WHAT_IF:
        ratio = record.friction_ratio and record.friction_ratio.scaled(factor)
        dead_band = record.dead_band and record.dead_band.scaled(factor)
        level = friction_level(ratio, record.test_condition) if ratio else None
        numbers = [f"{100 * ratio.value:.3g} % of the torque limit"] if ratio else []
        numbers += [f"dead band {dead_band.value:.3g} rad"] if dead_band else []
        text = f"What if {case} ({origin}): {', '.join(numbers)}"
        if ratio and level is not None:
            trainable = level < TRAINABLE
            text += f". {thresholds.effect(max(ratio.interval95[1], 0.0))}; to cover" + (
                f": {level:.2f}" if trainable else f" {level:.2f} is beyond training, mend the joint"
            )
            level = level if trainable else None
        found.append(WhatIf(case, factor, ratio, dead_band, level, text + "."))
    return tuple(found)


@dataclass(frozen=True)
class Verdict:
    """What the friction of one joint means for training."""

    level: float | None
    """Friction that a training has to cover, as a share of the torque limit: the upper end, with the margin; None
    without a torque limit, and beyond what can be trained."""
    text: str
    """The same in words, with the comparison."""
    placement: tuple[Placement, ...] = ()
    """Rank of ratio and dead band among public joints of the same condition."""
    what_if: tuple[WhatIf, ...] = ()
    """Seals removed, and wear."""
    advice: Advice | None = None
    """What to train with; None where there is nothing to cover."""

    @property
    def range(self) -> list[float] | None:
        """Friction that training then draws, as shares of the torque limit, lowest and highest."""
        if self.advice is None:
            return None if self.level is None else [0.0, 0.0]
        return self.advice.range

    @property
    def training(self) -> dict[str, Any] | None:
        """The fields of `task.friction` in a run's configuration; None where no level can be proposed."""
        if self.advice is None:
            return None if self.level is None else WITHOUT_FRICTION
        return self.advice.settings

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for the diagnostics of `joints.json`."""
        return {
            "friction_level": self.level,
            "range": self.range,
            "training": self.training,
            "advice": self.advice and self.advice.to_dict(),
            "text": self.text,
            "placement": [asdict(item) for item in self.placement],
            "what_if": [asdict(item) for item in self.what_if],
        }


def judge(record: JointRecord, sources: Mapping[str, Source] | None = None) -> Verdict:
    """Judge a joint by its ratio f/τ_max and its dead band f/kp, with their intervals; newton metres may be null.

    A linear axis is not compared with legs, and no training is proposed for it. sources: what the studies found, as of
    `advise`; by default what comes with the package.
    """
    thresholds, leg = Thresholds.of(sources), record.axis == "rotary"
    ratio, condition = record.friction_ratio, record.test_condition
    parts, level = _measured(record), None
    placement: tuple[Placement, ...] = ()
    if leg:
        known: dict[Quantity, Estimate | None] = {"friction_ratio": ratio, "dead_band": record.dead_band}
        places = (place(value, condition, name) for name, value in known.items() if value is not None)
        placement = tuple(item for item in places if item is not None)
        parts += [item.text for item in placement]
        if ratio is not None:
            level = friction_level(ratio, condition)
            parts += _simulated_effect(ratio, record.dead_band, condition, thresholds)
        if condition != "loaded":
            parts.append(
                "This is a lower bound for a leg that carries the robot: friction grows with load, and only a log "
                "under a known load can tell by how much."
            )
    if level is not None and level >= TRAINABLE:
        parts.append(
            f"To cover it would take level {level:.2f}, and no training goes beyond {TRAINABLE:g}: mend the joint."
        )
        level = None
    advice = advise(max(ratio.interval95[0], 0.0), level, sources) if level and ratio is not None else None
    if level is not None:
        parts.append(_proposal(level, condition, advice))
    return Verdict(level, " ".join(parts), placement, what_if(record, thresholds) if leg else (), advice)


def _measured(record: JointRecord) -> list[str]:
    """Say what was found, under which condition, and what is not known."""
    coulomb, ratio, dead_band = record.coulomb_friction, record.friction_ratio, record.dead_band
    condition = CONDITIONS.get(record.test_condition or "", "under a condition that was not stated")
    parts, known = [], coulomb or ratio or dead_band
    if known is not None and known.interval95[0] <= 0:
        parts.append("No dry friction can be told from zero in this log.")
    if ratio is None:
        parts.append(
            "Without the motor's torque limit it cannot be said whether this friction matters: --torque-limit."
        )
    else:
        parts.append(f"Dry friction takes {_span(ratio, 100, ' %')} of the torque limit, measured {condition}.")
    if dead_band is not None:
        band = _span(dead_band, 1, " rad" if record.axis == "rotary" else " m")
        parts.append(f"The joint ignores position errors up to f/kp, {band}, at the gains of the log.")
    if coulomb is None and known is not None:
        parts.append(
            "Newton metres are not known: these are in units of the command, or of the torque column, in which the "
            "motor's strength cancels."
        )
    return parts


def _simulated_effect(
    ratio: Estimate, dead_band: Estimate | None, condition: str | None, thresholds: Thresholds
) -> list[str]:
    """Say what friction of at most the interval's upper end did to policies in simulation."""
    high, effect = max(ratio.interval95[1], 0.0), thresholds.effect
    parts = [f"{effect(high)}. {thresholds.text}"]
    if condition != "loaded" and effect(MARGIN * high) != effect(high):
        parts.append(f"At {MARGIN:g} times that, which a loaded leg may have: {effect(MARGIN * high).lower()}.")
    if dead_band is not None and high < thresholds.noticeable and dead_band.interval95[1] > thresholds.dead_band:
        parts.append(
            f"But the dead band is wider than the {thresholds.dead_band:g} rad that went with "
            f"{100 * thresholds.noticeable:g} % in those simulations: at such low gains the same friction is felt more."
        )
    return [*parts, BUDGET]


def _proposal(level: float, condition: str | None, advice: Advice | None) -> str:
    """Say what to train with."""
    if advice is None:
        return "There is no friction to train for: --method none."
    margin = "" if condition == "loaded" else f", the upper end times {MARGIN:g}, a margin chosen, not measured"
    return f"A training has to cover {100 * level:.3g} % of the torque limit{margin}. {advice.text}"


def _span(estimate: Estimate, factor: float, unit: str) -> str:
    """Return `value unit (low to high)` with three digits; where there may be nothing, the most that it may be."""
    low, high = estimate.interval95
    value = f"{estimate.value * factor:.3g}" if low > 0 else f"at most {max(high, 0.0) * factor:.3g}"
    return f"{value}{unit} (95 %: {low * factor:.3g} to {high * factor:.3g})"


def propose(file: JointsFile) -> dict[str, Any]:
    """Return what `stiction train --friction-from` reads, as plain data.

    One training for all joints, by the friction of the worst: what `train` draws is a share of each joint's own limit.
    `joints` has each joint's ratio and the level that would cover it, `advice` what the choice rests on. `friction` is
    null, and `text` says why, where no joint has a ratio, or where one is beyond what can be trained.
    """
    levels = {
        name: friction_level(record.friction_ratio, record.test_condition)
        for name, record in file.joints.items()
        if record.friction_ratio is not None and record.axis == "rotary"
    }
    beyond = [name for name, level in levels.items() if level >= TRAINABLE]
    proposed = Verdict(None, "")
    if not levels:
        text = "no rotary joint has a ratio of friction to torque limit: identify with --torque-limit"
    elif beyond:
        text = f"{', '.join(beyond)} would need level {TRAINABLE:g} or more, which leaves nothing to walk with: mend it"
    else:
        worst = max(levels, key=lambda name: levels[name])
        proposed = judge(file.joints[worst])
        text = _reason(file, levels, worst) + (f". {proposed.advice.text}" if proposed.advice else "")
    return {
        "friction": proposed.training,
        "range": proposed.range,
        "text": text,
        "advice": proposed.advice and proposed.advice.to_dict(),
        "joints": {
            name: {
                "friction_ratio": record.friction_ratio and record.friction_ratio.to_dict(),
                "dead_band": record.dead_band and record.dead_band.to_dict(),
                "test_condition": record.test_condition,
                "friction_level": levels.get(name),
            }
            for name, record in file.joints.items()
        },
    }


def _reason(file: JointsFile, levels: dict[str, float], worst: str) -> str:
    """Say which joint sets the level, and which joints were not asked."""
    condition = file.joints[worst].test_condition
    stated = CONDITIONS.get(condition or "", "under no stated condition")
    text = f"provisional; level of {worst}, the worst of {len(levels)}, measured {stated}"
    if condition != "loaded":
        text += ", with a margin chosen, not measured, for the load that was not on it"
    left = [name for name in file.joints if name not in levels]
    return text + (f"; without a ratio, and so not asked: {', '.join(left)}" if left else "")
