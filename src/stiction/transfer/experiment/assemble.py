"""Puts together what the experiment came to, from runs and rows, and exports the policies that are shipped."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from stiction.formats.errors import StictionError
from stiction.formats.experiment import ConditionRecord, CurvePoint, Experiment, RunRecord
from stiction.formats.metrics import read_metrics
from stiction.formats.results import ResultRow
from stiction.rma.run import RunDirectory
from stiction.transfer.evaluate import EvaluationCfg
from stiction.transfer.experiment.advice import who_follows
from stiction.transfer.experiment.claims import judge_all
from stiction.transfer.experiment.criteria import Evidence
from stiction.transfer.experiment.evaluation import COMMANDS, training_mean
from stiction.transfer.experiment.learning import learning_curve
from stiction.transfer.experiment.manifest import PARTS
from stiction.transfer.experiment.onset import CANDIDATES, collapse, onsets
from stiction.transfer.experiment.places import Place
from stiction.transfer.experiment.table import Table, median_seed

SHIPPED = ("coulomb20-none", "coulomb20-direct", "coulomb20-deception")
"""Conditions whose median seed is shipped."""

FEWEST_SEEDS = 3
"""A median of fewer seeds is none."""


def assemble(
    places: Sequence[Place], rows: Sequence[ResultRow], base: EvaluationCfg, summary: Mapping[str, Any]
) -> Experiment:
    """Return the experiment as far as it has come.

    Args:
        places: the runs of the parts that were asked for.
        rows: results of those that are finished.
        base: how they were evaluated, levels in units of the experiment's own.
        summary: what else belongs into summary.json: the command, what `Origin` says, and what failed.

    """
    table = Table.of(rows)
    curves = {place.run.name: _curve(place) for place in places if place.state() == "finished"}
    configured = {place.run.condition.name: place.cfg for place in places}
    found = onsets(table, configured)
    conditions = list({place.run.condition.name: _condition(place) for place in places}.values())
    medians = {name: median_seed(rows, name) for name in SHIPPED}
    return Experiment(
        rows=rows,
        conditions=conditions,
        runs=[_record(place) for place in places],
        means=table.means(),
        curves=[point for points in curves.values() for point in points],
        verdicts=judge_all(Evidence(table, curves)),
        following=who_follows(rows),
        onsets=found,
        collapses=[collapse(method, found) for method in CANDIDATES],
        parts=PARTS,
        summary={
            **summary,
            "evaluation": asdict(base) | {"commands": COMMANDS},
            "conditions_of_evaluation": base.conditions,
            "median_seeds": medians,
        },
    )


def _curve(place: Place) -> list[CurvePoint]:
    """Return the learning curve of a run."""
    return learning_curve(place.run.name, read_metrics(place.path / "metrics.jsonl"))


def _condition(place: Place) -> ConditionRecord:
    """Return the record of the condition that a run belongs to."""
    condition, friction = place.run.condition, place.cfg.task.friction
    return ConditionRecord(
        name=condition.name,
        part=condition.part,
        purpose=condition.purpose,
        arguments=shlex.join(condition.options),
        robot=place.cfg.task.robot,
        law=friction.law,
        nominal=friction.level or 0.0,
        training_mean=training_mean(friction),
    )


def _record(place: Place) -> RunRecord:
    """Return the record of one run."""
    state = place.state()
    header = RunDirectory(place.path).header() if state != "missing" else {}
    minutes = None
    if state == "finished":
        rows = read_metrics(place.path / "metrics.jsonl")
        minutes = round(sum(row["seconds"] for row in rows) / 60, 1)
    run = place.run
    return RunRecord(run.name, run.condition.name, run.seed, state, str(header.get("revision", "")), minutes)


def bundle_name(place: Place) -> str:
    """Return the name of a shipped bundle: robot, terrain, method, level."""
    friction = place.cfg.task.friction
    return f"{place.cfg.task.robot}-flat-{friction.method}-{friction.level:g}"


def ship(places: Sequence[Place], rows: Iterable[ResultRow], out: Path) -> list[Path]:
    """Export the median seed of every shipped condition as a policy bundle into `out`; return their folders.

    Raises:
        StictionError: a condition has too few finished seeds, or its folder exists; nothing was exported then.

    """
    from stiction.transfer.export import export_run

    rows, chosen = list(rows), []
    for condition in SHIPPED:
        finished = [p for p in places if p.run.condition.name == condition and p.state() == "finished"]
        if len(finished) < FEWEST_SEEDS:
            raise StictionError(
                f"{condition} has {len(finished)} finished seeds, its median needs at least {FEWEST_SEEDS}; train more "
                "with --train, or leave --ship out"
            )
        seed = median_seed(rows, condition)
        place = next((p for p in finished if p.run.seed == seed), None)
        if place is None:
            raise StictionError(f"{condition} was not evaluated, so that it has no median seed; see the failures above")
        chosen.append((place, out / bundle_name(place)))
    for _, folder in chosen:
        if folder.exists():
            raise StictionError(f"{folder} exists already; remove it first, or name another folder with --ship")
    for place, folder in chosen:
        export_run(place.path, folder)
    return [folder for _, folder in chosen]
