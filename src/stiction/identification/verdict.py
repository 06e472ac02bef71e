"""Verdict on a joint in three lines (friction, importance, command to run), and the numbers behind them.

Where the fit is not valid the three lines say what to do first, why, and that there is no level. Of walking is spoken
where the joint is a leg's. From which friction on a policy suffers, which training to choose, and what it covers: see
`advice`. `propose` makes of the worst joint what `stiction train --friction-from` reads.

A log stays the same if all torques in it grow by one factor. What fixes that factor is a controller whose gains are
known, a known weight, links of known mass, or what was declared; the first line says what that was (`assumption`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from stiction.core.names import kind_of
from stiction.files.advice import Source
from stiction.files.joints import (
    FRICTION_REACHES_ZERO,
    LOAD_REGRESSORS,
    Estimate,
    JointRecord,
    JointsFile,
    write_training,
)
from stiction.identification.advice import (
    CONDITIONS,
    TRAINED_UNDER,
    Advice,
    Placement,
    advise,
    draw_rise,
    place,
)
from stiction.identification.remedies import other_ways
from stiction.identification.runs import Run
from stiction.identification.scale import MARGIN, SYMBOLS, Scale, margin_of, scale_of, thresholds

NAMED = {
    "--kt": ("kt", "N m/A"),
    "--resistance": ("R", "ohm"),
    "--duty-voltage": ("supply", "V"),
    "--torque-scale": ("scale", "a unit"),
}
"""Flag -> name and unit of a constant that makes torque of a column."""

WEIGHTS = {
    "pendulum_mass": "--pendulum-mass",
    "pendulum_length": "--pendulum-length",
    "pendulum_angle": "--set pendulum_angle",
    "payload_mass": "--payload-mass",
    "payload_distance": "--payload-distance",
    "payload_angle": "--payload-angle",
}
"""Field of the set-up -> flag, of those that say how much a known weight pulls."""


def torque_unit(run: Run) -> dict[str, Any] | None:
    """Return what the log's torque column holds and what its N m rest on, declared numbers by flag; None without one.

    `calibrated`: whether it is in N m; `side`: where it was said to be measured; `weight`: flags of a known weight.
    """
    if not run.measured:
        return None
    drive, scale = run.setup.drive, run.setup.torque_scale
    flags = {"--kt": drive.kt, "--resistance": drive.resistance, "--duty-voltage": drive.supply}
    motor = {"torque": (), "current": ("--kt",), "voltage": ("--kt", "--resistance"), "duty": tuple(flags)}
    known = {flag: flags[flag] for flag in motor[drive.column]} | {"--torque-scale": scale}
    return {
        "column": drive.column,
        "declared": {flag: value for flag, value in known.items() if value is not None},
        "calibrated": run.setup.calibrated,
        "side": run.setup.torque_source,
        "weight": [flag for name, flag in WEIGHTS.items() if getattr(run.setup, name) is not None],
    }


def assumption(record: JointRecord) -> tuple[tuple[str, ...], str]:
    """Return the flags that friction rests on and nothing in the log shows, and the same in words; empty where none."""
    data, rotary = record.diagnostics, record.axis == "rotary"
    source, torque_data = data.get("strength", {}).get("source"), data.get("torque_unit")
    if source == "declared":
        return ("--set motor_strength", "--kp", "--kd"), "all of it if the motor strength and the gains are as declared"
    if record.torque_source is None and record.kp is not None and record.coulomb_friction is None:
        gain = f"{record.kp:.4g} {'N m/rad' if rotary else 'N/m'}"
        text = f"all of it if kp is {gain} and angles are the joint's, as declared: positions alone do not show it"
        return ("--kp", "--kd", "--position-scale"), text
    if record.torque_source is None or record.coulomb_friction is None:
        return (), ""
    if "torque_by_weight" in data:
        shows = "nothing in so short a walk shows it"
        if data["torque_by_weight"] is not None:
            low, high = data["torque_by_weight"]["interval95"]
            together = f"the robot's weight says so of all joints together, to {low:.2g} to {high:.2g} times"
            shows = f"{together}, and of each nothing"
        return ("--torque-scale",), f"all of it if the torque is in N m, as declared: {shows}"
    # Where there is a mismatch, however small, the torque was held against gains and positions: that shows its scale.
    if torque_data is None or data.get("controller_mismatch") is not None:
        return (), ""
    if source == "known_load":
        # A pendulum beside a torque of known unit was held against it.
        if not torque_data["weight"] or (torque_data["calibrated"] and "--pendulum-mass" in torque_data["weight"]):
            return (), ""
        text = "all of it if the known weight is as declared, which tells the scale of the torque"
        return tuple(torque_data["weight"]), text
    return _of_unit(torque_data, data.get("torque_by_links"), "N m" if rotary else "N")


def _of_unit(torque_data: dict[str, Any], links: dict[str, Any] | None, unit: str) -> tuple[tuple[str, ...], str]:
    """Return the assumptions behind a torque column.

    torque_data: `torque_unit` of the record; links: its scale by the links of a limb, or None.
    """
    declared = torque_data["declared"]
    if torque_data["column"] == "torque":
        flags, what = ("--torque-scale",), f"the torque is in {unit}"
        shows = "without --kp, --kd and a target nothing shows it"
    else:
        numbers = [f"{name} {declared[flag]:.4g} {of}" for flag, (name, of) in NAMED.items() if flag in declared]
        flags, what = ("--torque-column", *declared), f"the column is a {', '.join([torque_data['column'], *numbers])}"
        shows = "nothing in the log shows it, and a known pendulum would (--pendulum-mass, --pendulum-length)"
    if links is not None:
        low, high = links["interval95"]
        shows = f"the links' masses say so to {low:.2g} to {high:.2g} times"
    # A torque scale leaves the speed as it is, and dry friction does not ask how fast.
    speed = "" if links else ", and of inertia and viscous friction if angles are the joint's and stamps seconds"
    return flags, f"all of it if {what}, as declared{speed}: {shows}"


TRAINABLE = 0.8
"""Levels from here on leave the motor too little to walk with; training refuses them."""

LEG_WORDS = (
    *("hip", "thigh", "calf", "shank", "knee", "ankle", "foot", "coxa", "femur", "tibia"),
    *("haa", "hfe", "kfe", "hx", "hy", "kn"),
)
"""Words in a joint's name that only a leg's has."""


def is_leg(name: str) -> bool:
    """Return whether a joint is a leg's, by its name: `FL_calf_joint` is; of `joint_3` it is not known."""
    return any(word in LEG_WORDS for word in kind_of(name).split("_"))


def friction_level(record: JointRecord) -> float | None:
    """Return the level that covers a joint's ratio: the upper end, with the margin, up to a whole per cent.

    None for a linear axis, without a ratio, and where the fit is not valid, which a record of an older file may not say
    itself. May be `TRAINABLE` or more; who proposes it has to check.
    """
    ratio = record.friction_ratio
    if ratio is None or record.axis != "rotary" or record.objections or ratio.interval95[0] <= 0:
        return None
    # 100 times 0.07 is a hair over 7 in floating point, which is no reason for one per cent more.
    return math.ceil(100 * margin_of(record) * ratio.interval95[1] - 1e-9) / 100


AGAIN = "identify again"
"""Begin of a next step that is the command of before, with further flags where one follows."""

WITHOUT_TASK = "cannot be told without the task"
"""Answer for a joint that is not known to be a leg's."""


@dataclass(frozen=True)
class TrainingNeed:
    """Requirements that the friction of one joint sets for training."""

    level: float | None
    """Friction that a training has to cover, as a share of the torque limit: the upper end, with the margin; None
    without a torque limit, beyond what can be trained, and where the fit is not valid."""
    lines: tuple[str, ...]
    """Amount of friction, its importance, and the command to run; or the first step, its reason, and steps to avoid."""
    details: tuple[str, ...] = ()
    """Evidence for the lines, one or more sentences each."""
    placement: tuple[Placement, ...] = ()
    """Rank of ratio and dead band among public joints of the same condition."""
    advice: Advice | None = None
    """Training method and settings; None without a level."""
    training: dict[str, Any] | None = None
    """Fields of `task.friction` in a run's configuration; None without a level."""
    proposal: str = ""
    """Description of that training and the friction that it covers; begins with a verb."""
    assumes: tuple[str, ...] = ()
    """Flags whose numbers the friction rests on and nothing in the log shows; the first line says so."""
    answer: str = "cannot be told"
    """Answer to whether the friction matters, in a word: `no`, `a little`, `probably`, `yes`, or `cannot be told`."""
    step: str = ""
    """Next step: a command, `AGAIN` with further flags or words, or an instruction."""
    scale: Scale | None = None
    """Place among the answers; None where there is no friction, torque limit or gain to compare."""

    @property
    def text(self) -> str:
        """All of it in words."""
        return " ".join((*self.lines, *self.details))

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for the diagnostics of `joints.json`."""
        return {
            "friction_level": self.level,
            "range": self.advice and self.advice.range,
            "training": self.training,
            "advice": self.advice and self.advice.to_dict(),
            "robot": self.advice and self.advice.robot,
            "lines": list(self.lines),
            "details": list(self.details),
            "text": self.text,
            "placement": [asdict(item) for item in self.placement],
            "assumes": list(self.assumes),
            "answer": self.answer,
            "step": self.step,
            "scale": self.scale and asdict(self.scale) | {"ends": list(self.scale.ends)},
        }


def judge(
    record: JointRecord,
    sources: Mapping[str, Source] | None = None,
    legs: bool = True,
    robot: str | None = None,
    least: float = math.inf,
) -> TrainingNeed:
    """Judge a joint by its ratio f/τ_max and its dead band f/kp, with their intervals; newton metres may be null.

    Where more friction holds the joint at rest than brakes it in motion, all is decided by that at rest.
    A linear axis is not compared with legs, and no training is proposed for it. sources: what the studies found, as of
    `advise`; by default what comes with the package; legs: whether it is known to be a leg's joint, and a word about
    walking has a place; robot: whose joint it is, by its name; least: friction of the robot's other joints, over their
    torque limits, which one training has to cover too [-].
    """
    if record.objections and record.objections[0].reason != FRICTION_REACHES_ZERO:
        return TrainingNeed(None, _invalid(record), step=record.objections[0].remedy)
    ratio, level = record.friction_ratio, friction_level(record)
    legs = legs and record.axis == "rotary"
    advice, training, proposal = None, None, ""
    if ratio is not None and level is not None and level < TRAINABLE:
        advice = advise(min(ratio.interval95[0], least), level, sources, robot)
        # Where no friction is drawn at all, none is more at rest.
        drawn = draw_rise(record, advice.settings) if advice.training.level > 0 else None
        training, words = (advice.settings, "") if drawn is None else drawn
        proposal = _proposal(record, advice, words)
    scale = scale_of(record, robot) if legs else None
    answer, matters = WITHOUT_TASK, f" without the task. {_ignored(record)}"
    if legs:
        answer, matters = _matters(record, robot, scale)
    step, run = _to_do(record, level, legs, answer, advice, proposal)
    placement = tuple(filter(None, (place(record, "friction_ratio"), place(record, "dead_band"))))
    return TrainingNeed(
        level=None if advice is None else level,
        lines=(_how_much(record), f"Does it matter? {answer.partition(' without ')[0].capitalize()}{matters}", run),
        details=_details(record, legs, placement, None if answer == "no" else advice),
        placement=placement,
        advice=advice,
        training=training,
        proposal=proposal,
        assumes=assumption(record)[0],
        answer=answer,
        step=step,
        scale=scale,
    )


def _invalid(record: JointRecord) -> tuple[str, ...]:
    """Return the first step, its reason, and steps to avoid."""
    first, *more = record.objections
    others = f" And {len(more)} more: {'; '.join(one.seen for one in more)}." if more else ""
    return (
        f"Do first: {first.remedy}.",
        f"This fit is not valid: {first.seen}.{others}",
        "Until then no friction is stated, no level is proposed, and none of these numbers should be used.",
    )


def _how_much(record: JointRecord) -> str:
    """Return the amount of dry friction (at rest if larger), as a share of the limit, and the condition of the test."""
    measured = "measured " + CONDITIONS.get(record.test_condition or "", "under a condition that was not stated")
    ratio, less, limit = record.friction_ratio, record.dynamic_ratio, record.torque_limit
    moving, holding = record.moving_friction, record.holding_friction
    unit = " N m" if record.axis == "rotary" else " N"
    over = unit if record.coulomb_friction else f"{unit} over the motor strength k"
    numbers = [] if moving is None else [_span(moving, 1, over)]
    if holding is not None:
        numbers = [f"{_span(holding, 1, over)} at rest"]
    if ratio is not None:
        numbers.append(_span(ratio, 100, " %") + " of the torque limit" + (f" {limit:.4g}{unit}" if limit else ""))
    if holding is not None and moving is not None:
        numbers.append(f"and is {_span(moving, 1, over)} in motion" + (f", {100 * less.value:.4g} %" if less else ""))
    known = ", ".join(numbers)
    if record.objections:
        return f"No dry friction can be told from zero in this log: it is {known}, {measured}."
    parts = [f"Dry friction {'is' if holding is None else 'holds'} {known or 'not known'}, {measured}"]
    parts += ["of what torque limit is not known (--torque-limit)"] if ratio is None else []
    # Records of older files do not say.
    if numbers and (record.diagnostics.get("torque_unit") or {"side": ""}).get("side", "") is None:
        parts.append("the torque is assumed to be the motor's side (--torque-source)")
    parts += [assumption(record)[1]] if numbers else []
    return "; ".join(filter(None, parts)) + "."


def _ignored(record: JointRecord) -> str:
    """Return the position errors that the joint ignores."""
    if record.dead_band is None:
        return "The dead band f/kp would tell what position errors the joint ignores (--kp)."
    low, high = record.dead_band.interval95
    span = _span(record.dead_band, 1, " rad" if record.axis == "rotary" else " m")
    if record.axis == "rotary":
        span += f", {math.degrees(record.dead_band.value if low > 0 else max(high, 0.0)):.4g}°"
    gain = "at the gains of the log"
    if record.used_kp != record.kp:
        gain = f"where the robot walks with a kp of {record.used_kp:.4g} N m/rad"
    return f"The joint ignores position errors up to f/kp, {span}, {gain}."


def _matters(record: JointRecord, robot: str | None, scale: Scale | None) -> tuple[str, str]:
    """Return whether it matters to a walking policy, and the number that tells."""
    if scale is None:
        return (
            "cannot be told without --torque-limit or --kp",
            " without the motor's torque limit or its gain (--torque-limit, --kp).",
        )
    symbol, factor, unit = SYMBOLS[scale.axis]
    most = f"{scale.high * factor:.4g}{unit}"
    most += "" if scale.margin == 1.0 else f", and under load perhaps {scale.margin:g} times that"
    where = symbol if record.holding_friction is None else f"{symbol} at rest"
    answer = scale.answer if scale.answer == "no" or not record.objections else "cannot be told"
    reached = {
        "no": f"{where} is at most {most}",
        "cannot be told": f"{where} is not told from zero, and at most {most}",
        "yes": f"{where} is at least {scale.low * factor:.4g}{unit}",
    }
    return answer, f": {reached.get(answer, f'{where} is up to {most}')}; {thresholds(record, robot, scale.axis).text}."


NOTHING = "stiction train --method none"
"""Next step where friction does not matter."""


def _to_do(
    record: JointRecord, level: float | None, legs: bool, answer: str, advice: Advice | None, proposal: str
) -> tuple[str, str]:
    """Return the next step, and the line about it; answer: to whether the friction matters."""
    if record.objections:
        remedy = record.objections[0].remedy
        if legs and answer == "no":
            begin = "Nothing has to be done, train with --method none. To tell how little friction there is, "
            return NOTHING, f"{begin}{remedy}. No level is proposed."
        return remedy, f"Do first: {remedy}. No level is proposed."
    if level is not None and level >= TRAINABLE:
        why = f"to cover it would take level {level:.2f}, and no training goes beyond {TRAINABLE:g}"
        return f"repair the joint: {why}", f"{why[0].upper()}{why[1:]}: repair the joint."
    if legs and answer == "no" and advice:
        return NOTHING, f"Run: {NOTHING}; no training with friction is needed."
    if legs and advice:
        run = f"Run: {advice.command}, which {proposal}"
        if not advice.fails:
            return advice.command, run
        step = f"repair the joint, or feed its friction forward: no training that walked covers {_share(advice.asked)}"
        told = f"{step[0].upper()}{step[1:]}. The nearest is {advice.command}, which {proposal}"
        return f"{step}; the nearest is {advice.command}", told
    if legs:
        step = f"{AGAIN} --torque-limit LIMIT"
        return step, "Run: this again with --torque-limit; a training takes friction as a share of it."
    if record.coulomb_friction is None:
        gains = "with the gains in N m/rad and --set motor_strength=1, or with a known load"
        why = "a simulator takes friction in N m, not over the motor strength k"
        return f"{AGAIN} {gains}", f"Run: this again {gains}; {why}."
    what = "it" if record.holding_friction is None else "friction in motion, not at rest,"
    step = "stiction convert joints.json --to mujoco --model ROBOT.xml"
    return step, f"Run: {step}, which puts {what} into the model."


def _share(level: float) -> str:
    """Return a share of the torque limit in words."""
    return f"{100 * level:.3g} % of the torque limit"


def _proposal(record: JointRecord, advice: Advice, drawn: str) -> str:
    """Return the advised training, and the friction of the joint that it covers and omits.

    drawn: what it draws of friction at rest, in words; empty where it draws none.
    """
    text = f"is {advice.flags}."
    if drawn:
        text = f"draws {drawn}. Counted is Coulomb's law, {advice.flags}: as much friction at rest, no fall from it."
    text += f" {advice.coverage}"
    law, regressor = (record.friction_law or {}).get("law"), record.load_regressor
    if record.load_coefficient is not None and regressor is not None:
        size = f"{_span(record.load_coefficient, 1, '')} times {LOAD_REGRESSORS[regressor]}"
        return f"{text} What load adds to this joint's friction, {size}, is not covered."
    if record.holding_friction is not None:
        return text if drawn else f"{text} The fall of this joint's friction from rest to motion is not covered."
    if law in (None, TRAINED_UNDER):
        return text
    return f"{text} What the {law} law of this joint has beyond Coulomb's is not covered."


def _details(record: JointRecord, legs: bool, ranks: Sequence[Placement], advice: Advice | None) -> tuple[str, ...]:
    """Return the evidence behind the lines, and questions that the log leaves open."""
    details = [_ignored(record)] if legs else []
    details += [rank.text for rank in ranks]
    if record.axis == "rotary" and record.test_condition != "loaded":
        details.append(
            f"This is a lower bound for a {'leg that carries the robot' if legs else 'joint that carries a load'}: "
            "friction grows with load, and only a log under a known load can tell by how much."
        )
    if legs and advice is not None:
        by = "" if record.holding_friction is None else ", by what holds the joint at rest"
        if record.test_condition != "loaded":
            by += f", the upper end times {MARGIN:g}, a margin chosen, not measured"
        details += [f"A training has to cover {_share(advice.asked)}{by}.", advice.comparison]
        details += [other_ways(record.torque_limit, record.used_kp)]
    return tuple(details)


def _span(estimate: Estimate, factor: float, unit: str) -> str:
    """Return `value unit (low to high)` with four digits; where there may be nothing, the most that it may be."""
    low, high = estimate.interval95
    value = f"{estimate.value * factor:.4g}" if low > 0 else f"at most {max(high, 0.0) * factor:.4g}"
    return f"{value}{unit} (95 %: {low * factor:.4g} to {high * factor:.4g})"


def propose(file: JointsFile) -> dict[str, Any]:
    """Return what `stiction train --friction-from` reads, as plain data.

    One training for all joints, from the friction of the least to that of the worst: what `train` draws is a share of
    each joint's own limit.
    `joints` has each joint's ratio, at rest where that is more, and the level that would cover it, `advice` what the
    choice rests on. `friction` is null, and `text` says why, where no joint has a ratio, or where one is beyond what
    can be trained. A joint whose fit is not valid has no level.
    """
    levels = {name: level for name, one in file.joints.items() if (level := friction_level(one)) is not None}
    beyond = [name for name, level in levels.items() if level >= TRAINABLE]
    objections = [f"{name} is not valid: {each.text}" for name, one in file.joints.items() for each in one.objections]
    need = TrainingNeed(None, ())
    if not levels and objections:
        text = f"the fit of {objections[0]}"
    elif not levels:
        text = "no rotary joint has a ratio of friction to torque limit: identify with --torque-limit"
    elif beyond:
        text = f"{', '.join(beyond)} would need level {TRAINABLE:g} or more, which leaves nothing to walk with: mend it"
    else:
        worst = max(levels, key=lambda name: levels[name])
        verdict = file.joints[worst].diagnostics.get("verdict")
        robot = verdict.get("robot") if isinstance(verdict, dict) else None
        least = min(one.interval95[0] for record in file.joints.values() if (one := record.friction_ratio) is not None)
        need = judge(file.joints[worst], robot=robot if isinstance(robot, str) else None, least=least)
        text = f"{_reason(file, levels, worst)}. The training {need.proposal}"
        text += f" {need.advice.comparison}" if need.advice else ""
    return {
        "friction": need.training,
        "range": need.advice and need.advice.range,
        "text": text,
        "advice": need.advice and need.advice.to_dict(),
        "joints": {
            name: {
                "friction_ratio": record.friction_ratio and record.friction_ratio.to_dict(),
                "dynamic_ratio": record.dynamic_ratio and record.dynamic_ratio.to_dict(),
                "dead_band": record.dead_band and record.dead_band.to_dict(),
                "test_condition": record.test_condition,
                "friction_level": levels.get(name),
            }
            for name, record in file.joints.items()
        },
    }


def _reason(file: JointsFile, levels: dict[str, float], worst: str) -> str:
    """Return the joint that sets the level, and the joints left out."""
    record = file.joints[worst]
    measured = CONDITIONS.get(record.test_condition or "", "under no stated condition")
    text = f"provisional; level {levels[worst]:g} of {worst}, the worst of {len(levels)}, measured {measured}"
    text += ", by what holds it at rest" if record.holding_friction is not None else ""
    if record.test_condition != "loaded":
        text += ", with a margin chosen, not measured, for the load that was not on it"
    left = [name for name in file.joints if name not in levels]
    return text + (f"; not valid or without a ratio, and so not asked: {', '.join(left)}" if left else "")


def write_proposal(folder: Path, file: JointsFile) -> None:
    """Write `training.json` beside a `joints.json`; none, and none of before, where no joint's fit is valid.

    May raise `OSError`.
    """
    path, known = folder / "training.json", [record for record in file.joints.values() if record.diagnostics]
    if known and all(record.objections for record in known):
        path.unlink(missing_ok=True)
    else:
        write_training(path, propose(file))
