"""How much friction, does it matter, what to run: three lines, and behind them the numbers that they rest on.

Where the fit is not valid the three lines say what to do first, why, and that there is no level. Of walking is spoken
where the joint is a leg's. From which friction on a policy suffers: see `thresholds`; which training to choose, and
what it covers: see `advice`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from stiction.core.names import kind_of
from stiction.files.advice import Source
from stiction.files.joints import FRICTION_REACHES_ZERO, LOAD_REGRESSORS, Estimate, JointRecord
from stiction.identification.advice import GROUND_AND_LAW, PLACES, TRAINED_IN, TRAINED_UNDER, Advice, advise
from stiction.identification.assumption import assumption
from stiction.identification.objections import no_friction_shown
from stiction.identification.reference import CONDITIONS, Placement, Quantity, place
from stiction.identification.rise import Rise, rise_of
from stiction.identification.thresholds import Thresholds

MARGIN = 2.0
"""Factor on friction measured without load. Friction grows with load, by how much is not known here: a choice."""

BUDGET = (
    "Straight walks up to which friction, engine by engine: the friction budget, results/replication/README.md in "
    "stiction's repository, whose policies are not those that are advised; `stiction replicate` makes it anew."
)
"""Where a robot builder looks next."""

TRAINABLE = 0.8
"""Levels from here on leave the motor too little to walk with; training refuses them."""

STATIC_ERROR = (
    "Friction at rest is less certain than its interval says: of simulated joints it came out 2 to 25 % too low, most "
    "so where there was little of it."
)
"""Warning with every friction at rest."""

WHAT_IF = (
    ("seals removed", 0.3, "the paper saw 70 % less without the seals of its own motor"),
    ("worn, x 1.5", 1.5, "a factor chosen, not measured"),
    ("worn, x 2", 2.0, "a factor chosen, not measured"),
    ("worn, x 3", 3.0, "a factor chosen, not measured"),
)
"""Case, factor on the friction, where the factor comes from."""

WITHOUT_FRICTION: dict[str, Any] = {"method": "none", "level": 0.0, "law": TRAINED_UNDER, "per": "robot"}
"""The fields of `FrictionCfg` where there is no friction to train for."""


def friction_level(ratio: Estimate, condition: str | None) -> float:
    """Return the level that covers a ratio: the upper end, times `MARGIN` unless it was loaded, up to a whole per cent.

    May be `TRAINABLE` or more; who proposes it has to check.
    """
    high = max(ratio.interval95[1], 0.0)
    # 100 times 0.07 is a hair over 7 in floating point, which is no reason for one per cent more.
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


def what_if(
    record: JointRecord, thresholds: Thresholds, legs: bool = True, sources: Mapping[str, Source] | None = None
) -> tuple[WhatIf, ...]:
    """Return every case of `WHAT_IF` for a joint; nothing where neither its ratio nor its dead band is known.

    sources: as of `advise`.
    """
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
            text += f". {thresholds.effect(max(ratio.interval95[1], 0.0))}" if legs else ""
            if level >= TRAINABLE:
                text += f"; to cover {level:.2f} is beyond training, mend the joint"
                level = None
            else:
                known = not legs or not level or advise(max(ratio.interval95[0], 0.0), level, sources).covered
                text += f"; to cover: {level:.2f}{'' if known else ', which no training is known to'}"
        found.append(WhatIf(case, factor, ratio, dead_band, level, text + "."))
    return tuple(found)


@dataclass(frozen=True)
class TrainingNeed:
    """What the friction of one joint asks of a training."""

    level: float | None
    """Friction that a training has to cover, as a share of the torque limit: the upper end, with the margin; None
    without a torque limit, beyond what can be trained, and where the fit is not valid."""
    lines: tuple[str, ...]
    """How much friction there is, whether it matters, and what to run; or what to do first, why, and what not to do."""
    details: tuple[str, ...] = ()
    """What the lines rest on, a sentence or more each."""
    placement: tuple[Placement, ...] = ()
    """Rank of ratio and dead band among public joints of the same condition."""
    what_if: tuple[WhatIf, ...] = ()
    """Seals removed, and wear."""
    advice: Advice | None = None
    """What to train with; None where there is nothing to cover."""
    uncovered: str = ""
    """What of this joint's friction no policy that is counted has met, in words; empty where there is nothing."""
    rise: Rise | None = None
    """Friction at rest over that in motion, as the training draws it; None where it draws none."""
    robot: str | None = None
    """Whose joint it is; None where nobody said."""
    assumes: tuple[str, ...] = ()
    """Flags whose numbers the friction rests on and nothing in the log shows; the first line says so."""

    @property
    def text(self) -> str:
        """All of it in words."""
        return " ".join((*self.lines, *self.details))

    @property
    def range(self) -> list[float] | None:
        """Friction at rest that training draws at the estimated rise, over the torque limit, lowest and highest."""
        if self.advice is None:
            return None if self.level is None else [0.0, 0.0]
        return self.advice.range

    @property
    def training(self) -> dict[str, Any] | None:
        """The fields of `task.friction` in a run's configuration; None where no level can be proposed."""
        if self.advice is None:
            return None if self.level is None else WITHOUT_FRICTION
        return self.advice.settings if self.rise is None else self.rise.settings(self.advice.settings)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for the diagnostics of `joints.json`."""
        return {
            "friction_level": self.level,
            "range": self.range,
            "training": self.training,
            "advice": self.advice and self.advice.to_dict(),
            "uncovered": self.uncovered,
            "robot": self.robot,
            "lines": list(self.lines),
            "details": list(self.details),
            "text": self.text,
            "placement": [asdict(item) for item in self.placement],
            "what_if": [asdict(item) for item in self.what_if],
            "assumes": list(self.assumes),
        }


LEG_WORDS = frozenset(
    (
        "hip",
        "thigh",
        "calf",
        "shank",
        "knee",
        "ankle",
        "coxa",
        "femur",
        "tibia",
        "haa",
        "hfe",
        "kfe",
        "hx",
        "hy",
        "kn",
        "foot",
    )
)
"""Words in a joint's name that only a leg's has."""


def is_leg(name: str) -> bool:
    """Return whether a joint is a leg's, by its name: `FL_calf_joint` is; of `joint_3` it is not known."""
    return not LEG_WORDS.isdisjoint(kind_of(name).split("_"))


def judge(
    record: JointRecord, sources: Mapping[str, Source] | None = None, legs: bool = True, robot: str | None = None
) -> TrainingNeed:
    """Judge a joint by its ratio f/τ_max and its dead band f/kp, with their intervals; newton metres may be null.

    Where more friction holds the joint at rest than brakes it in motion, all is decided by that at rest.
    A linear axis is not compared with legs, and no training is proposed for it. sources: what the studies found, as of
    `advise`; by default what comes with the package; legs: whether it is known to be a leg's joint, and a word about
    walking has a place; robot: whose joint it is, by its name.
    """
    thresholds, rotary = Thresholds.of(sources), record.axis == "rotary"
    known = record.coulomb_friction or record.dynamic_ratio or record.friction_ratio or record.dead_band
    # A record of an older file may lack the objection that its friction reaches zero.
    if known is not None and not record.objections:
        record = replace(record, objections=no_friction_shown(record, known))
    ratio, condition = record.friction_ratio, record.test_condition
    level = None if ratio is None or not rotary or record.objections else friction_level(ratio, condition)
    beyond = level is not None and level >= TRAINABLE
    advice = advise(max(ratio.interval95[0], 0.0), level, sources, robot) if level and not beyond and ratio else None
    # Where no friction is drawn at all, there is none to rise.
    rise = rise_of(record) if advice is not None and advice.training.level > 0 else None
    uncovered = "" if advice is None else _uncovered(record, advice, rise)
    if record.objections and record.objections[0].reason != FRICTION_REACHES_ZERO:
        return TrainingNeed(None, _invalid(record))
    placement = _placement(record) if rotary else ()
    details = [*_in_which_unit(record), *(item.text for item in placement)]
    if record.holding_friction is not None:
        details.append(STATIC_ERROR)
    if rotary and legs and ratio is not None:
        details += _simulated_effect(ratio, record.dead_band, condition, thresholds)
    if rotary and condition != "loaded":
        details.append(
            f"This is a lower bound for a {'leg that carries the robot' if legs else 'joint that carries a load'}: "
            "friction grows with load, and only a log under a known load can tell by how much."
        )
    if level is not None and not beyond and legs:
        details.append(_proposal(level, record, advice))
        details += [uncovered] if uncovered else []
    return TrainingNeed(
        None if beyond else level,
        (
            _how_much(record),
            _matters(record, thresholds, legs and rotary, advice),
            _to_run(record, level, advice, legs and rotary, _harmless(record, thresholds), rise),
        ),
        tuple(details),
        placement,
        what_if(record, thresholds, legs, sources) if rotary and not record.objections else (),
        advice,
        uncovered,
        rise,
        robot,
        assumption(record)[0],
    )


def _invalid(record: JointRecord) -> tuple[str, ...]:
    """Say what to do first, why, and what not to do."""
    first, *more = record.objections
    others = f" And {len(more)} more: {'; '.join(one.seen for one in more)}." if more else ""
    return (
        f"Do first: {first.remedy}.",
        f"This fit is not valid: {first.seen}.{others}",
        "Until then no friction is stated, no level is proposed, and none of these numbers should be used.",
    )


def _placement(record: JointRecord) -> tuple[Placement, ...]:
    """Rank ratio and dead band among public joints of the same condition."""
    known: dict[Quantity, Estimate | None] = {"friction_ratio": record.friction_ratio, "dead_band": record.dead_band}
    at_rest = record.holding_friction is not None
    places = (place(value, record.test_condition, name, at_rest) for name, value in known.items() if value is not None)
    return tuple(item for item in places if item is not None)


def _how_much(record: JointRecord) -> str:
    """Say how much dry friction there is, at rest where that is more, of what limit, under which condition."""
    condition = CONDITIONS.get(record.test_condition or "", "under a condition that was not stated")
    ratio, less, limit = record.friction_ratio, record.dynamic_ratio, record.torque_limit
    unit = "N m" if record.axis == "rotary" else "N"
    over = "" if record.coulomb_friction else " over the motor strength k"
    moving, holding = (
        "" if one is None else _span(one, 1, f" {unit}{over}")
        for one in (record.moving_friction, record.holding_friction)
    )
    share = "" if ratio is None else _span(ratio, 100, " %") + " of the torque limit"
    share += f" {limit:.4g} {unit}" if share and limit is not None else ""
    numbers = ", ".join(part for part in (f"{holding} at rest" if holding else moving, share) if part)
    if holding and moving:
        numbers += f", and is {moving} in motion" + ("" if less is None else f", {100 * less.value:.4g} %")
    if record.objections:
        return f"No dry friction can be told from zero in this log: it is {numbers}, measured {condition}."
    missing = "" if ratio is not None else "; of what torque limit is not known (--torque-limit)"
    if not numbers:
        return f"Dry friction is not known, measured {condition}{missing}."
    _, said = assumption(record)
    # Records of older files do not say.
    undeclared = (record.diagnostics.get("torque_unit") or {"side": ""}).get("side", "") is None
    side = "the torque is taken to be the motor's side, as nobody said (--torque-source)" if undeclared else ""
    first = f"Dry friction {'holds' if holding else 'is'} {numbers}, measured {condition}{missing}"
    return "; ".join(filter(None, [first, side, said])) + "."


def _in_which_unit(record: JointRecord) -> list[str]:
    """Say what the joint ignores, and what newton metres rest on."""
    found, band = [], record.dead_band
    if band is not None:
        unit = " rad" if record.axis == "rotary" else " m"
        found.append(f"T{_ignored(band, unit)[1:]}")
    if record.coulomb_friction is None and (band or record.friction_ratio):
        found.append(
            "Newton metres are not known: these are in units of the command, or of the torque column, in which the "
            "motor's strength cancels."
        )
    return found


def _ignored(band: Estimate, unit: str) -> str:
    """Say what a dead band means."""
    return f"the joint ignores position errors up to f/kp, {_span(band, 1, unit)}, at the gains of the log."


def _matters(record: JointRecord, thresholds: Thresholds, legs: bool, advice: Advice | None) -> str:
    """Say whether it matters, with the one number that decides, and where policies that never met it follow still."""
    ratio, band, begin = record.friction_ratio, record.dead_band, "Does it matter?"
    if not legs:
        unit = " rad" if record.axis == "rotary" else " m"
        begin += " Cannot be told without the task"
        if band is None:
            return f"{begin}; the dead band f/kp would tell what position errors the joint ignores (--kp)."
        return f"{begin}: {_ignored(band, unit)}"
    if ratio is None:
        return f"{begin} Cannot be told without the motor's torque limit (--torque-limit)."
    low, high = ratio.interval95
    margin, at_rest = _margin(record), "" if record.holding_friction is None else "at rest "
    noticed = 100 * thresholds.noticeable
    least = (
        f"{noticed:.4g} % of the torque limit is the least that slowed walking policies in simulation, by "
        f"{thresholds.cost} %, of {thresholds.robot} {GROUND_AND_LAW}"
    )
    borne = None if advice is None else advice.borne_at
    probably = "Probably" if borne is None else "A little"
    still = (
        ""
        if borne is None
        else f"; every seed that was trained without friction still follows every command at {100 * borne:g} %"
    )
    decides = f"{least}{still and f'{still}, {PLACES[TRAINED_IN]}'}."
    if low >= thresholds.noticeable:
        return f"{begin} Yes: {at_rest}it is at least {100 * low:.4g} %; {decides}"
    if _harmless(record, thresholds):
        times = "" if margin == 1.0 else f", even times {margin:g} for load too little"
        return f"{begin} No: {at_rest}it is at most {100 * high:.4g} %{times}; {least}."
    if record.objections:
        return f"{begin} Cannot be told: {at_rest}it may be nothing, or up to {100 * high:.4g} %; {least}."
    if high >= thresholds.noticeable:
        return f"{begin} {probably}: {at_rest}it may be up to {100 * high:.4g} %; {decides}"
    if margin * high >= thresholds.noticeable:
        return f"{begin} {probably}: under load {at_rest}it may be {margin:g} times {100 * high:.4g} %; {decides}"
    reached = 0.0 if band is None else band.interval95[1]
    return f"{begin} Probably: at such low gains the dead band is up to {reached:.4g} rad wide."


def _margin(record: JointRecord) -> float:
    """Return the factor on friction that load may add."""
    return 1.0 if record.test_condition == "loaded" else MARGIN


def _harmless(record: JointRecord, thresholds: Thresholds) -> bool:
    """Return whether friction is too little to be noticed by a policy, even with the margin."""
    ratio, band = record.friction_ratio, record.dead_band
    wide = band is not None and band.interval95[1] > thresholds.dead_band
    return ratio is not None and _margin(record) * ratio.interval95[1] < thresholds.noticeable and not wide


def _to_run(
    record: JointRecord, level: float | None, advice: Advice | None, legs: bool, harmless: bool, rise: Rise | None
) -> str:
    """Say what to run; harmless: whether friction, if there is any, is too little to be noticed by a policy."""
    if record.objections and legs and harmless:
        return (
            "Nothing has to be done: there is no friction to train for (--method none). To tell how little there is, "
            f"{record.objections[0].remedy}. No level is proposed."
        )
    if record.objections:
        return f"Do first: {record.objections[0].remedy}. No level is proposed."
    if level is not None and level >= TRAINABLE:
        return f"To cover it would take level {level:.2f}, and no training goes beyond {TRAINABLE:g}: mend the joint."
    if not legs:
        what = "it" if record.holding_friction is None else "friction in motion, not at rest,"
        return (
            f"Run: stiction convert joints.json --to mujoco --model ROBOT.xml, which puts {what} into a simulator's "
            "model."
        )
    if level is None:
        return "Run: this again with --torque-limit; a training takes friction as a share of it."
    if advice is None:
        return "Run: stiction train --friction-from training.json; there is no friction to train for: --method none."
    words = " ".join(filter(None, ["stiction train --friction-from training.json", advice.budget]))
    law = _other_law(record, rise)
    more = f" {law[0].upper()}{law[1:]} is not covered." if law else ""
    if rise is None:
        return f"Run: {words}, which is {advice.flags}. {advice.coverage}{more}"
    counted = f"Counted is Coulomb's law, {advice.flags}: {advice.coverage[0].lower()}{advice.coverage[1:]}"
    return f"Run: {words}, which draws {rise.text}. {counted}{more}"


def _other_law(record: JointRecord, rise: Rise | None) -> str:
    """Return what of a joint's friction is neither Coulomb's nor drawn at rest; empty where all of it is."""
    if record.load_coefficient is not None:
        return "what load adds to this joint's friction"
    if record.holding_friction is not None:
        return "" if rise else "the fall of this joint's friction from rest to motion"
    law = (record.friction_law or {}).get("law")
    return "" if law in (None, TRAINED_UNDER) else f"what the {law} law of this joint has beyond Coulomb's"


def _uncovered(record: JointRecord, advice: Advice, rise: Rise | None) -> str:
    """Say what of a joint's friction no policy that is counted has met; empty where there is nothing."""
    drawn = ""
    if rise is not None:
        drawn = (
            f"The proposed training draws {rise.text} ({rise.flags(advice.settings)}): as much at rest as the one that "
            "is counted, and less in motion; the policies that are counted here met no fall from rest to motion."
        )
    if not (law := _other_law(record, rise)):
        return drawn
    size = ""
    if record.load_coefficient is not None and record.load_regressor is not None:
        size = f", {_span(record.load_coefficient, 1, '')} times {LOAD_REGRESSORS[record.load_regressor]},"
    return f"{drawn} ".lstrip() + (
        f"{law[0].upper()}{law[1:]}{size} is not covered by a training under Coulomb's law: the policies that are "
        "counted here were trained and walked under that alone."
    )


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


def _proposal(level: float, record: JointRecord, advice: Advice | None) -> str:
    """Say what to train with."""
    by = "" if record.holding_friction is None else ", by what holds the joint at rest"
    if advice is None:
        return "There is no friction to train for: --method none."
    if record.test_condition != "loaded":
        by += f", the upper end times {MARGIN:g}, a margin chosen, not measured"
    return f"A training has to cover {100 * level:.3g} % of the torque limit{by}. {advice.text}"


def _span(estimate: Estimate, factor: float, unit: str) -> str:
    """Return `value unit (low to high)` with four digits; where there may be nothing, the most that it may be."""
    low, high = estimate.interval95
    value = f"{estimate.value * factor:.4g}" if low > 0 else f"at most {max(high, 0.0) * factor:.4g}"
    return f"{value}{unit} (95 %: {low * factor:.4g} to {high * factor:.4g})"
