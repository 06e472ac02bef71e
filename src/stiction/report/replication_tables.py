"""Tables of the paper's comparison."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from stiction.formats.experiment import Verdict
from stiction.formats.friction import has_coefficient, level_text
from stiction.formats.replication import Onset, Replication
from stiction.report.sheet import Sheet

NEEDS = (0.01, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3)
"""Friction over the torque limit for which it is said which training follows."""

COUNTERPARTS = (
    ("Fig. 1, the robot on stairs", "clips of `stiction study stairs`; the table of stairs on this page"),
    ("Figs. teacher and student", "ARCHITECTURE.md of the project; curves in every run of `stiction train`"),
    ("Fig. Actuator Net", "`stiction study actuator`, which runs f0, log, net, f1"),
    ("Fig. Sim2Sim and Sim2Real", "the tables of methods on this page: other engines, and the virtual robot"),
    ("Table robot parameters", "`saturn_lite` and `go1` in the package's robots"),
    (
        "Table of randomisation",
        "`stiction train --help`, and `stiction doctor --randomization`, which measures each",
    ),
    ("Table shank motors", "`stiction identify`, and its table of references"),
    ("Section V, B and k_d", "`stiction study damping`"),
    ("Gait rewards", "`stiction study gait`"),
)
"""What the paper shows, and where its counterpart is."""


def verdict_sheet(verdicts: Sequence[Verdict]) -> Sheet:
    """Return what became of each sentence and explanation."""
    rows = tuple((v.id, v.outcome, f"“{v.sentence}”", v.criterion, v.evidence) for v in verdicts)
    note = (
        "Means over training seeds with 95 % t-intervals in brackets and every seed in parentheses. `undecided`: the "
        "interval straddles the criterion. One seed carries no verdict: `not tested`, with its number. Each sentence "
        "is judged by itself; their number is not corrected for. E: the paper's comparison; V: its section on training "
        "with friction; T: what it concludes from its motors; X: explanations for what it saw."
    )
    return Sheet("The paper's sentences", ("", "outcome", "sentence", "criterion", "evidence"), rows, note)


def needs_sheet(onsets: Sequence[Onset]) -> Sheet:
    """Return, for a joint of some friction, the ways of training that follow in every engine in which they walked."""
    known = [onset for onset in onsets if not has_coefficient(onset.friction_law)]
    rows = []
    for level in NEEDS:
        good = []
        for way in dict.fromkeys(onset.method for onset in known):
            own = [onset for onset in known if onset.method == way]
            if all(onset.level is None or onset.level > level for onset in own) and level <= _tested(own):
                good.append(way)
        tested = level <= max((onset.tested for onset in known), default=0.0)
        rows.append((f"{100 * level:g} %", ", ".join(good) if good else "none of them" if tested else "not tested"))
    note = (
        "Following: the slower direction falls under 80 % of the command beyond that friction, mean over training "
        "seeds, in every engine and on the virtual robot as far as it walked there. It may be faster than commanded."
    )
    return Sheet("My joint has this much friction: which training follows?", ("friction", "follows"), tuple(rows), note)


def _tested(own: Sequence[Onset]) -> float:
    """Return the friction up to which a way was tested everywhere."""
    return min(onset.tested for onset in own)


def onset_sheet(onsets: Sequence[Onset]) -> Sheet:
    """Return where each way falls under 80 %, in every engine, with every seed."""
    rows = []
    for one in onsets:
        if one.level is None:
            text = f"not up to {level_text(one.friction_law, one.tested)}"
        else:
            text = "from the start" if one.level == 0 else level_text(one.friction_law, round(one.level, 4))
        interval = "–" if one.low is None or one.high is None else f"{max(0.0, one.low):.3g} to {one.high:.3g}"
        band = "–" if one.dead_band is None else f"{1000 * one.dead_band:.0f}"
        rows.append((one.method, one.engine, one.friction_law, text, interval, band, one.each))
    header = ("method", "engine", "law", "falls under 80 %", "95 % over seeds", "dead band [mrad]", "each seed")
    return Sheet("Where each way of training falls under 80 % of the command", header, tuple(rows))


COLUMNS = (
    ("vx=0.5", "speed_ratio", "forward", ".2f"),
    ("vx=-0.5", "speed_ratio", "backward", ".2f"),
    ("both", "fall_rate", "falls", ".0%"),
    ("both", "joint_jitter", "jitter [rad/s²]", ".0f"),
    ("both", "flight_share", "flight", ".0%"),
    ("both", "tripod_share", "tripod", ".0%"),
    ("stand", "tracking_error", "standing [m/s]", ".3f"),
)
"""Command (`both`: mean of forward and backward), column, heading, format."""


def methods_sheet(result: Replication, engine: str, level: float, law: str, title: str) -> Sheet:
    """Return every way of training at one spot: speed both ways, falls, jitter (joint acceleration), gait, standing."""
    details = [row for part in result.parts for row in part.details]
    spot = [r for r in details if (r["engine"], r["friction_law"], r["terrain"]) == (engine, law, "flat")]
    spot = [r for r in spot if abs(r["friction_level"] - level) < 1e-6]
    rows = []
    for way in result.ways:
        own = [r for r in spot if r["method"] == way]
        if own:
            seeds = len({r["seed"] for r in own})
            rows.append((way, str(seeds), *(_figure(own, *column) for column in COLUMNS)))
    header = ("method", "seeds", *(heading for *_, heading, _ in COLUMNS))
    return Sheet(title, header, tuple(rows))


def _figure(own: Sequence[dict[str, Any]], command: str, column: str, heading: str, form: str) -> str:
    """Return the mean of a column over the policies of a way, a dash where there is none."""
    commands = ("vx=0.5", "vx=-0.5") if command == "both" else (command,)
    values = [r[column] for r in own if r["command"] in commands and r[column] is not None]
    return format(sum(values) / len(values), form) if values else "–"


def stairs_sheet(result: Replication) -> Sheet | None:
    """Return the crossings of every policy for stairs, with Wilson's intervals; None where none was walked."""
    rows = []
    for part in result.parts:
        for r in part.details:
            if r["crossed"] is not None:
                low, high = r["crossed_interval"]
                level = level_text(r["friction_law"], r["friction_level"])
                share = f"{r['crossed']:.0%} ({low:.0%} to {high:.0%})"
                cells = (r["policy"], r["method"], r["engine"], level, r["terrain"], str(r["episodes"]), share)
                rows.append((*cells, f"{r['steps_climbed']:.1f}" if r["steps_climbed"] is not None else "–"))
    header = ("policy", "method", "engine", "friction", "ground", "walks", "crossed", "steps passed")
    note = "Blind, 0.30 m treads, six up, landing, six down, 0.4 m/s. In brackets: Wilson's 95 % interval over walks."
    return Sheet("Stairs", header, tuple(rows), note) if rows else None


def counterpart_sheet() -> Sheet:
    """Return where each of the paper's figures and tables has its counterpart."""
    return Sheet("The paper's figures and tables, and ours", ("in the paper", "here"), COUNTERPARTS)
