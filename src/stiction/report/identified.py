"""Identification at a glance: the friction of the worst joint, whether it matters, what to do next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from markupsafe import Markup

from stiction.files.joints import Estimate, JointRecord, JointsFile
from stiction.identification.findings import repeat_lines
from stiction.identification.scale import Scale, scale_of
from stiction.identification.verdict import AGAIN
from stiction.report.gauge import ANSWERS, gauge, speeds
from stiction.report.glance import Glance, card, plus_minus, two_digits
from stiction.report.joints import alike, gather_warnings, in_degrees, in_folder, remaining_warnings, unit

UNKNOWN = "cannot be told"
"""Answer where there is none."""

RANKS = ("no", "a little", UNKNOWN, "probably", "yes")
"""Answers, the worst last."""

MOST_ROWS = 12
"""Joints in the table of the terminal; the page has them all."""

COUPLED = (
    "each joint was identified as if the others stood still; if they moved at once, --robot FILE takes off what "
    "each does to the others"
)
"""Reservation about a log with several joints and no robot."""


def glance_of(joints: JointsFile, folder: Path, command: str = "", page: bool = True) -> Glance | None:
    """Return an identification at a glance: of several joints the worst, and the worst answer.

    folder: where the files lie that the next step reads; command: that identified; page: whether there is one. None
    for files of older versions, which have no answer.
    """
    ranked = worst_first(joints)
    verdicts = {
        name: record.diagnostics["verdict"] for name, record in ranked.items() if "verdict" in record.diagnostics
    }
    if not verdicts or any("answer" not in verdict for verdict in verdicts.values()):
        return None
    stated = _stated(ranked)
    worst = next(iter(stated or verdicts))
    answers = [str(verdicts[name]["answer"]) for name in stated] or [UNKNOWN]
    answer = max(answers, key=lambda each: RANKS.index(each.partition(" without ")[0]))
    where = f" at {worst}" if len(joints.joints) > 1 else ""
    facts = friction_text(ranked[worst], where) if stated else "Friction not stated: the fit is not valid"
    count = len(gather_warnings(joints))
    many = f" ({count} warning{'s' if count > 1 else ''})" if count else ""
    assumed = list(dict.fromkeys(flag for name in stated for flag in verdicts[name]["assumes"]))
    return Glance(
        facts,
        "Matters",
        answer,
        ANSWERS.get(answer, "unknown"),
        _step(str(verdicts[worst]["step"]), folder, command),
        _errors(joints, ranked, verdicts),
        (
            *_repeats(ranked),
            *((f"rests on {', '.join(assumed)}, which the log does not show",) if assumed else ()),
            *_coupled(joints),
        ),
        f"why, and what is not known{many}: {folder / ('report.html' if page else 'joints.json')}",
    )


def identified_card(joints: JointsFile, folder: Path, command: str) -> Markup | None:
    """Return the card of a page, with the gauge of the worst joint; None for files of older versions."""
    if (glance := glance_of(joints, folder, command)) is None:
        return None
    stated = list(_stated(worst_first(joints)).values())
    plain = stated[0].diagnostics["verdict"].get("scale") if stated else None
    if plain is None:
        return card(replace(glance, why=""))
    scale = Scale(**plain | {"ends": tuple(plain["ends"])})
    shown = stated[0].friction_ratio if scale.axis == "torque_limit" else stated[0].dead_band
    value = 0.0 if shown is None else max(0.0, shown.value)
    return card(replace(glance, why=""), gauge(scale, value), speeds(scale, value))


def _stated(ranked: Mapping[str, JointRecord]) -> dict[str, JointRecord]:
    """Return the joints whose friction is stated."""
    return {
        name: record
        for name, record in ranked.items()
        if "verdict" in record.diagnostics and record.objection_to("inertia") is None
    }


def worst_first(joints: JointsFile) -> dict[str, JointRecord]:
    """Return the joints: those that are not valid, then the others, the most friction for its motor first."""

    def key(record: JointRecord) -> tuple[float, ...]:
        amount, scale = record.holding_friction or record.moving_friction, scale_of(record)
        upper = [-1.0 if each is None else each.interval95[1] for each in (record.friction_ratio, amount)]
        return float(record.objection_to("inertia") is not None), upper[0], scale.most if scale else -1.0, upper[1]

    return dict(sorted(joints.joints.items(), key=lambda item: key(item[1]), reverse=True))


def friction_text(record: JointRecord, where: str = "") -> str:
    """Return how much dry friction there is: `Friction 0.442 ± 0.011 N m, 1.0 % of 45 N m, dead band 1.3°`.

    where: after the amount, ` at shank`.
    """
    unit_of = unit(record, "coulomb_friction")
    holding, moving = record.holding_friction, record.moving_friction
    if (amount := holding or moving) is None:
        return "Friction not known"
    over = "" if record.coulomb_friction or holding else "/k"
    text = f"Friction{over} {plus_minus(amount)} {unit_of}{where}"
    if holding is not None:
        text += " at rest" + ("" if moving is None else f" ({two_digits(moving.value)} in motion)")
    if record.friction_ratio is not None:
        limit = f"{record.torque_limit:.4g} {unit_of}" if record.torque_limit else "the torque limit"
        text += f", {share_text(record.friction_ratio)} of {limit}"
    return text if record.dead_band is None else f"{text}, dead band {dead_band_text(record)}"


def share_text(ratio: Estimate) -> str:
    """Return a ratio in per cent, where there may be none the most that it may be."""
    low, high = ratio.interval95
    return f"{two_digits(100 * (ratio.value if low > 0 else max(high, 0.0)))} %"


def dead_band_text(record: JointRecord) -> str:
    """Return the dead band of a joint in degrees, of a linear axis in millimetres."""
    band = in_degrees(record, "dead_band") or (record.dead_band and record.dead_band.scaled(1000.0))
    if band is None:
        return "–"
    low, high = band.interval95
    text = two_digits(band.value if low > 0 else max(high, 0.0))
    return f"{text}°" if record.axis == "rotary" else f"{text} mm"


def glance_rows(joints: JointsFile) -> list[list[str]]:
    """Return a row a joint for the terminal: name, friction, share of the torque limit, dead band, answer."""
    rows = []
    for name, record in worst_first(joints).items():
        amount = record.holding_friction or record.moving_friction
        answer = "not valid" if record.objections else "not identified"
        answer = str(record.diagnostics.get("verdict", {}).get("answer", "")).partition(" without ")[0] or answer
        if record.objection_to("inertia") is not None or amount is None:
            rows.append([name, "–", "–", "–", "not valid" if record.objections else answer])
            continue
        ratio = "–" if record.friction_ratio is None else share_text(record.friction_ratio)
        rows.append([name, plus_minus(amount), ratio, dead_band_text(record), answer])
    return rows


def _step(step: str, folder: Path, command: str) -> str:
    """Return the next step with the paths of its files, and as the whole command where it is that of before."""
    if command and step.startswith(f"{AGAIN} --"):
        again = "" if " --overwrite" in command else " --overwrite"
        return f"{command}{step.removeprefix(AGAIN)}{again}"
    return in_folder(step, folder)


def _errors(
    joints: JointsFile, ranked: Mapping[str, JointRecord], verdicts: Mapping[str, dict[str, object]]
) -> tuple[str, ...]:
    """Return why joints are not stated, a line for all with the same reason; not of those that matter not at all."""
    bad = [name for name in verdicts if ranked[name].objections and verdicts[name]["answer"] != "no"]
    if len(joints.joints) == 1:
        return tuple(one.seen for name in bad for one in ranked[name].objections)
    refused = {
        text: names
        for text, names in gather_warnings(joints).items()
        if not any(ranked[name].diagnostics for name in names)
    }
    return (
        *(f"{', '.join(names)}: {ranked[names[0]].objections[0].seen}" for names in alike(ranked, bad)),
        *(f"{', '.join(names)}: {text}" for text, names in refused.items()),
    )


def reservations(joints: JointsFile) -> list[str]:
    """Return the warnings of a page: shared ones, and what an identification of several joints rests on."""
    identified = [record for record in joints.joints.values() if record.diagnostics]
    errors = {record.diagnostics["model_error"] for record in identified if record.diagnostics.get("model_error")}
    limb = [
        "inertia is the rotor's (armature), behind the links of the model; each link's mass, inertia and centre were "
        f"admitted to be off by {each:.0%}, one standard deviation (--model-error)"
        for each in errors
    ]
    return [*remaining_warnings(joints), *limb, *_coupled(joints)]


def _repeats(ranked: Mapping[str, JointRecord]) -> list[str]:
    """Return what each repeat says, of several joints behind the name of the joint."""
    lines = [(name, line) for name, record in ranked.items() if record.diagnostics for line in repeat_lines(record)]
    return [f"{name}: {line}" if len(ranked) > 1 else line for name, line in lines]


def _coupled(joints: JointsFile) -> tuple[str, ...]:
    """Return the reservation of several joints of one log that no model of the robot tells apart, or none."""
    records = [record for record in joints.joints.values() if record.diagnostics]
    identified = [record for record in records if record.diagnostics.get("method") != "walking"]
    alone = len(identified) > 1 and not any("model_error" in record.diagnostics for record in identified)
    return (COUPLED,) if alone and any(record.test_condition != "bare_motor" for record in identified) else ()
