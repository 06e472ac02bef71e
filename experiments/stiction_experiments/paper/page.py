"""The report: how many sentences are decided, the table of them, its figures, and both of its forms."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING

from stiction.core.files import write_bytes
from stiction.files.onset import shipped_onsets
from stiction.report.page import Sheet, legend, line_look, new_figure
from stiction_experiments.lab.study import Report
from stiction_experiments.paper.configurations import Configuration, shares
from stiction_experiments.paper.decide import Decision, decide, joined
from stiction_experiments.paper.estimator import PARAMETERS, ProfileRow
from stiction_experiments.paper.plan import LEVELS, MAIN
from stiction_experiments.paper.results import Results
from stiction_experiments.paper.rows import share_followed
from stiction_experiments.paper.sentences import Sentence, by_family
from stiction_experiments.paper.typeset import drawn, typeset

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Where does joint friction matter? A replication"


@dataclass(frozen=True)
class SentenceRow:
    """One sentence with its outcome; a row of sentences.csv."""

    number: str
    sentence: str
    family: str
    asked: str
    """Question that decides it."""
    outcome: str
    """Outcome over its conditions: `holds: 10 %, 20 %; undecided: 5 %`."""
    evidence: str
    """Numbers of each condition that has walked; the reason where it was not asked here."""


def judge(results: Results) -> list[SentenceRow]:
    """Return every sentence with its outcome, families corrected apart, in the paper's order."""
    rows = []
    for family, pairs in by_family(results).items():
        tests = [test for _, own in pairs for test in own]
        decisions = iter(decide(tests))
        for sentence, own in pairs:
            rows.append(_row(family, sentence, [next(decisions) for _ in own]))
    return sorted(rows, key=lambda row: (int(row.number.rstrip("ab")), row.number))


def _row(family: str, sentence: Sentence, decisions: Sequence[Decision]) -> SentenceRow:
    outcome = joined(decisions) if decisions else sentence.fixed
    walked = [decision for decision in decisions if decision.test.walked] or decisions
    evidence = "; ".join(decision.evidence for decision in walked) or sentence.why
    return SentenceRow(sentence.number, sentence.text, family, sentence.asked, outcome, evidence)


def counts(rows: Sequence[SentenceRow]) -> str:
    """Return how many sentences came out how, as one sentence; in part: under some of the conditions asked."""
    kinds = {"decided": 0, "decided in part": 0, "undecided": 0, "not testable in simulation": 0, "not walked yet": 0}
    for row in rows:
        if row.outcome == "not testable":
            kinds["not testable in simulation"] += 1
        elif "holds" in row.outcome or "does not hold" in row.outcome:
            kinds["decided in part" if "undecided" in row.outcome or "not walked" in row.outcome else "decided"] += 1
        else:
            kinds["not walked yet" if "not walked" in row.outcome else "undecided"] += 1
    return f"Of {len(rows)} sentences " + ", ".join(f"{count} {name}" for name, count in kinds.items() if count) + "."


def report(results: Results, profile: Sequence[ProfileRow] = ()) -> Report:
    """Return tables, figures, page and PDF; profile: of the estimators of sentence 12."""
    rows = judge(results)
    figures = {"followed": followed_figure(results), "profile": profile_figure(profile)}
    table = Sheet(
        "The sentences",
        ("#", "sentence", "asked", "outcome", "evidence"),
        tuple((row.number, row.sentence, row.asked, row.outcome, row.evidence) for row in rows),
    )
    public = [counted(results.configurations)] if results.configurations else []
    lead = counts(rows)
    data = {
        "all": len(rows),
        "counts": lead,
        "walked": figures["followed"] is not None,
        "steps": shares_by_training(results),
        "levels": LEVELS,
        "sentences": [asdict(row) for row in rows],
        "estimates": [asdict(row) for row in results.estimates],
        "onset": asdict(shipped_onsets()),
    }
    files = {f"{name}.svg": drawn(figure) for name, figure in figures.items()}
    files["data.json"] = json.dumps(data, allow_nan=False).encode()
    typed = typeset(Path(__file__).with_name("report.typ").read_bytes(), files)
    return Report(
        TITLE,
        lead,
        {"sentences": rows},
        sections=typed.sections,
        sheets=(*public, table),
        figures=figures,
        files=lambda out: write_bytes(out / "report.pdf", typed.pdf),
        answer=(lead,),
    )


PAPER_TO_OURS = ("literal-none", "literal", "none", "deception")
"""Trainings from the paper's to ours, without friction and with it."""


def shares_by_training(results: Results) -> list[dict[str, str]]:
    """Return the share of commands followed in MuJoCo, mean over seeds, of the paper's training and of ours.

    Each row has `training`, `seeds`, and a text for each friction; trainings that have not walked have none.
    """
    rows = []
    for name in PAPER_TO_OURS:
        seeds = {level: results.at(share_followed, name, "mujoco", level) for level in LEVELS}
        if all(seeds.values()):
            shares = {level: f"{100 * fmean(own.values()):.0f} %" for level, own in seeds.items()}
            rows.append({"training": name, "seeds": str(len(seeds[LEVELS[0]])), **shares})
    return rows


def profile_figure(rows: Sequence[ProfileRow]) -> Figure | None:
    """Return the root of each objective along each parameter, a panel a parameter; None without rows."""
    if not rows:
        return None
    estimators = tuple(dict.fromkeys(row.estimator for row in rows))
    figure, axes = new_figure(1, len(PARAMETERS), (3.4 * len(PARAMETERS), 3.0))
    for axis, parameter in zip(axes, PARAMETERS, strict=True):
        for estimator in estimators:
            own = [row for row in rows if (row.estimator, row.parameter) == (estimator, parameter)]
            look = line_look(estimator, estimators)
            axis.plot([row.factor for row in own], [row.rms for row in own], **look, label=estimator)
        axis.set(title=parameter, xlabel="over the true one [1]", xscale="log", yscale="log")
    axes[0].set_ylabel("root mean square [rad]")
    legend(axes[-1])
    return figure


def counted(rows: Sequence[Configuration]) -> Sheet:
    """Return the table of the share of joint friction, by the way to count; the first two decide."""
    titles = ("counted", "yes", "of", "share [%]", "95 % interval [%]")
    cells = [
        (
            *(each.counted, str(each.yes), str(each.repositories), f"{100 * each.yes / each.repositories:.0f}"),
            f"{100 * each.low:.0f} to {100 * each.high:.0f}",
        )
        for each in shares(rows)
    ]
    return Sheet("Public configurations that randomise joint friction", titles, tuple(cells))


PANELS = (("MuJoCo", ("mujoco",)), ("PhysX", ("physx",)), ("Webots' ODE", ("webots",)))


def followed_figure(results: Results) -> Figure | None:
    """Return the share of commands followed over friction, a panel an engine; None without a walk."""
    known = [panel for panel in PANELS if any(results.at(share_followed, "none", panel[1], f) for f in LEVELS)]
    if not known:
        return None
    figure, axes = new_figure(1, len(known), (3.4 * len(known), 3.0))
    for axis, (name, places) in zip(axes, known, strict=True):
        for training in MAIN:
            points = [(float(f), results.at(share_followed, training, places, f)) for f in LEVELS]
            points = [(level, seeds) for level, seeds in points if seeds]
            if points:
                means = [100 * fmean(seeds.values()) for _, seeds in points]
                axis.plot([100 * level for level, _ in points], means, **line_look(training, MAIN), label=training)
        axis.set_title(name)
        axis.set_xlabel("friction [% of the torque limit]")
        axis.set_ylim(0, 105)
    axes[0].set_ylabel("commands followed [%]")
    legend(axes[-1])
    return figure
