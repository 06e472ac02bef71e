"""Puts together what the experiment came to, from runs and rows, and exports the policies that are shipped."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from stiction.core.errors import ConfigurationError, FileError, TrainingError
from stiction.core.records import read_rows
from stiction.evaluate.evaluate import EvaluationCfg
from stiction.formats.advice import Source, TrainedWith
from stiction.formats.following import Following, following
from stiction.formats.results import ResultRow, read_metrics, read_results, read_summary
from stiction.locomotion.friction import FRICTION_RANGES
from stiction.rma.run import RunDirectory
from stiction.studies.claims import Verdict, changed_verdicts
from stiction.studies.friction.claims import CLAIMS, DECEPTION, DIRECT, NONE
from stiction.studies.friction.evaluation import CANDIDATES, COMMANDS, collapse, learning_curve, onsets, training_mean
from stiction.studies.friction.evidence import STUDENT, TrainingEvidence, median_seed, seed_means
from stiction.studies.friction.manifest import PARTS, PRESETS, Place, condition_of
from stiction.studies.friction.records import (
    Collapse,
    ConditionRecord,
    CurvePoint,
    Experiment,
    Onset,
    RunRecord,
)

ASKED = {"none": NONE, "direct": DIRECT, "deception": DECEPTION}
"""Method -> condition of the manifest that has several seeds of it."""


def who_follows(rows: Sequence[ResultRow]) -> list[Following]:
    """Return who follows of every condition, `CONDITION/student` and `CONDITION/teacher`."""
    return following(rows, _way_of)


def _way_of(row: ResultRow) -> str:
    """Return condition and policy of a row."""
    run, _, who = row.policy.partition("/")
    return f"{condition_of(run)[0]}/{who}"


def source_of(experiment: Experiment) -> Source:
    """Return the students of the three methods: what is deployed."""
    nominal = {condition.name: condition.nominal for condition in experiment.conditions}
    names = {f"{condition}/{STUDENT}": method for method, condition in ASKED.items()}
    cells = [replace(one, method=names[one.method]) for one in experiment.following if one.method in names]
    methods = {
        method: TrainedWith(method, 0.0 if method == "none" else nominal[condition], *FRICTION_RANGES[method])
        for method, condition in ASKED.items()
        if condition in nominal
    }
    policies = sorted({row.policy for row in experiment.rows if _way_of(row) in names})
    return Source(experiment.summary["command"], experiment.summary["revision"], tuple(policies), methods, tuple(cells))


SHIPPED = ("coulomb20-none", "coulomb20-direct", "coulomb20-deception")
"""Conditions whose median seed is shipped."""

FEWEST_SEEDS = 3
"""A median of fewer seeds is none."""


def assemble(
    places: Sequence[Place],
    rows: Sequence[ResultRow],
    base: EvaluationCfg,
    summary: Mapping[str, Any],
    before: Experiment | None = None,
) -> Experiment:
    """Return the experiment as far as it has come.

    Args:
        places: the runs of the parts that were asked for.
        rows: results of those that are finished.
        base: how they were evaluated, levels in units of the experiment's own.
        summary: what else belongs into summary.json: the command, what `Origin` says, and what failed.
        before: what was found of runs that are elsewhere now.

    """
    curves = {place.run.name: _curve(place) for place in places if place.state() == "finished"}
    records = {place.run.name: _record(place) for place in places}
    if before is not None:
        elsewhere = [one for one in before.runs if one.state == "finished" and one.name not in curves]
        names = {one.name for one in elsewhere}
        rows = [*(row for row in before.rows if _run_of(row) in names), *rows]
        rows = sorted(rows, key=lambda row: list(records).index(_run_of(row)))
        curves |= _by_run([point for point in before.curves if point.run in names])
        curves = {name: curves[name] for name in records if name in curves}
        records |= {one.name: one for one in elsewhere}
    evidence = TrainingEvidence.of_runs(rows, curves)
    configured = {place.run.condition.name: place.cfg for place in places}
    found = onsets(evidence, configured)
    conditions = list({place.run.condition.name: _condition(place) for place in places}.values())
    medians = {name: median_seed(rows, name) for name in SHIPPED}
    return Experiment(
        rows=rows,
        conditions=conditions,
        runs=list(records.values()),
        means=seed_means(evidence),
        curves=[point for points in curves.values() for point in points],
        verdicts=[claim.verdict(evidence) for claim in CLAIMS],
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
    from stiction.evaluate.export import export_run

    rows, chosen = list(rows), []
    for condition in SHIPPED:
        finished = [p for p in places if p.run.condition.name == condition and p.state() == "finished"]
        if len(finished) < FEWEST_SEEDS:
            raise TrainingError(
                f"{condition} has {len(finished)} finished seeds, its median needs at least {FEWEST_SEEDS}; train more "
                "with --train, or leave --ship out"
            )
        seed = median_seed(rows, condition)
        place = next((p for p in finished if p.run.seed == seed), None)
        if place is None:
            raise ConfigurationError(
                f"{condition} was not evaluated, so that it has no median seed; see the failures above"
            )
        chosen.append((place, out / bundle_name(place)))
    for _, folder in chosen:
        if folder.exists():
            raise FileError(f"{folder} exists already; remove it first, or name another folder with --ship")
    for place, folder in chosen:
        export_run(place.path, folder)
    return [folder for _, folder in chosen]


LISTS = {"conditions": ConditionRecord, "runs": RunRecord, "onsets": Onset, "collapses": Collapse}
"""Lists of summary.json that are not judged."""


def _run_of(row: ResultRow) -> str:
    """Return the run of a row's policy."""
    return row.policy.partition("/")[0]


def _by_run(curves: Sequence[CurvePoint]) -> dict[str, list[CurvePoint]]:
    """Return run -> its learning curve."""
    return {run: [point for point in curves if point.run == run] for run in dict.fromkeys(p.run for p in curves)}


def read_experiment(out: Path, preset: str) -> Experiment | None:
    """Return the experiment that a folder has, None where it has none yet.

    Raises:
        StictionError: its files are damaged, or its runs were trained with another preset.

    """
    if not (out / "summary.json").exists():
        return None
    found = judge_again(out, {})
    if (other := found.summary.get("preset", PRESETS[0])) != preset:
        raise ConfigurationError(f"{out} has runs of the preset {other!r}, not {preset!r}; choose another --out")
    return found


def judge_again(out: Path, made: dict[str, Any]) -> Experiment:
    """Return the experiment that a folder has, judged anew; its summary says so, and which verdicts changed.

    made: by what it is judged now: the command, and what `Origin` says.

    Raises:
        StictionError: the folder has no files of the experiment.

    """
    before = read_summary(out / "summary.json")
    rows = read_results(out / "results.csv")
    curves = read_rows(out / "curves.csv", CurvePoint)
    try:
        lists = {name: [kind(**one) for one in before[name]] for name, kind in LISTS.items()}
        verdicts = [Verdict(**one) for one in before["verdicts"]]
        parts = before["parts"]
    except (KeyError, TypeError) as error:
        raise FileError(
            f"{out / 'summary.json'} is no summary of `stiction study friction` ({error!r}); expected one that it wrote"
        ) from error
    evidence = TrainingEvidence.of_runs(rows, _by_run(curves))
    now = [claim.verdict(evidence) for claim in CLAIMS]
    own = ("schema_version", "verdicts", "parts", *LISTS)
    kept = {"warnings": [], **{name: value for name, value in before.items() if name not in own}}
    changed = changed_verdicts(verdicts, now, before.get("changed", []))
    return Experiment(
        rows=rows,
        means=seed_means(evidence),
        curves=curves,
        verdicts=now,
        following=who_follows(rows),
        parts=parts,
        summary=kept | {"judged": made, "changed": changed},
        **lists,
    )
