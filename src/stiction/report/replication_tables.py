"""Tables of the paper's comparison."""

from __future__ import annotations

from collections.abc import Sequence

from stiction.formats.experiment import LIMITS, Verdict
from stiction.formats.following import LEAST, MOST
from stiction.formats.friction import level_text
from stiction.formats.grid import FED
from stiction.formats.replication import Behind, BudgetPoint, ForwardPoint, Onset
from stiction.report.replication_methods import friction_text
from stiction.report.sheet import Sheet

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
        f"interval straddles the criterion. {LIMITS} Shares of the torque limit and of the load are axes of their own: "
        "the evidence says on which one x is, and on the others the sentence holds throughout, or nowhere. A rate "
        "(falls, crossings) also has Wilson's interval, over trials, and is decided where both agree: the one knows "
        "how trainings differ, the other how many walks there were. A trial is a walk; of virtual robots it is a pair "
        "of policy and robot, since the walks of one robot are not independent. All policies walk on the same virtual "
        "robots: there, rates and speeds have one more interval with the robots as the sample, which must agree; joint "
        "accelerations are compared over seeds alone, of those that walk. One seed carries no verdict: `not tested`, "
        "with its number. Each sentence is judged by itself; their number is not corrected for. E: the paper's "
        "comparison; V: its section on training with friction; T: what it concludes from its motors; X: explanations "
        "for what it saw."
    )
    return Sheet("The paper's sentences", ("", "outcome", "sentence", "criterion", "evidence"), rows, note)


def evidence_sheet(claim: str, behind: Sequence[Behind]) -> Sheet:
    """Return the rows that one sentence was judged by."""
    rows = []
    for row in behind:
        if row.claim == claim:
            friction = friction_text(row.friction_law, row.friction_level)
            where = row.method, row.engine, friction, row.terrain, row.command
            rows.append((*where, row.column, row.seeds, row.each))
    header = ("method", "engine", "friction", "ground", "command", "column", "seeds", "each seed")
    return Sheet(f"What {claim} was judged by", header, tuple(rows))


def onset_sheet(onsets: Sequence[Onset]) -> Sheet:
    """Return where each way slows under 80 %, in every engine, with every seed."""
    rows = []
    for one in onsets:
        if one.level is None:
            text = f"not up to {level_text(one.friction_law, one.tested)}"
        else:
            text = "from the start" if one.level == 0 else level_text(one.friction_law, round(one.level, 4))
        interval = "–" if one.low is None or one.high is None else f"{max(0.0, one.low):.3g} to {one.high:.3g}"
        band = "–" if one.dead_band is None else f"{1000 * one.dead_band:.0f}"
        rows.append((one.method, one.engine, one.friction_law, text, interval, band, one.each))
    header = ("method", "engine", "law", f"slows under {LEAST}", "95 % over seeds", "dead band [mrad]", "each seed")
    note = f"The slower of forward and backward. What is above {LEAST} may be over {MOST}, and then follows no more."
    return Sheet(f"Where each way of training slows under {LEAST} of the command", header, tuple(rows), note)


def forward_sheet(points: Sequence[ForwardPoint], virtual: bool) -> Sheet | None:
    """Return the conventional policy alone, with friction fed forward, and friction-aware training beside it.

    virtual: on virtual robots, or on the robot of the data sheet. None where no friction was fed forward there.
    """
    cells = {(p.method, p.engine, p.friction_law, p.friction_level): p for p in points}
    rows = []
    for one in points:
        if one.method == FED and ("+" in one.engine) == virtual:
            where = one.engine, one.friction_law, one.friction_level
            three = (cells.get((way, *where)) for way in ("none", FED, "deception"))
            counts = (f"{one.robots} of {one.robots + one.left_out}",) if virtual else ()
            rows.append((one.engine, friction_text(*where[1:]), *counts, *map(_ratio_text, three)))
    header = ("engine", "friction", *(("robots",) if virtual else ()), "none", FED, "deception")
    where_text = "on the virtual robot" if virtual else "on the robot of the data sheet"
    source = "what was identified from the log of each robot's own bench" if virtual else "the friction itself"
    left_out = " Robots whose bench does not tell it are left out, of the ways beside it too." if virtual else ""
    note = (
        "Speed reached over commanded in the slower direction, mean ± 95 % t-interval over training seeds, in brackets "
        f"their number. Fed forward: f sat((a − θ)/0.05 rad) in the joint controllers. f is {source}.{left_out}"
    )
    return Sheet(f"Friction fed forward, {where_text}", header, tuple(rows), note) if rows else None


def _ratio_text(point: BudgetPoint | None) -> str:
    """Return a speed ratio with its interval and number of seeds."""
    if point is None:
        return "–"
    spread = "" if point.high is None else f" ± {point.high - point.ratio:.2f}"
    return f"{point.ratio:.2f}{spread} ({point.seeds})"


def counterpart_sheet() -> Sheet:
    """Return where each of the paper's figures and tables has its counterpart."""
    return Sheet("The paper's figures and tables, and ours", ("in the paper", "here"), COUNTERPARTS)
