"""Puts together what the experiment came to, from runs and rows, and exports the policies that are shipped."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from stiction.core.decode import from_plain
from stiction.core.errors import ConfigurationError, FileError
from stiction.core.records import part_of, read_rows
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.files.results import ResultRow, read_metrics, read_results, read_summary
from stiction.learning.run import RunDirectory
from stiction_experiments.friction.claims import CLAIMS, DECEPTION, DIRECT, NONE
from stiction_experiments.friction.evaluation import (
    COMMANDS,
    learning_curve,
    training_mean,
)
from stiction_experiments.friction.evidence import TrainingEvidence, median_seed, parse_policy, seed_means
from stiction_experiments.friction.learned import learned_figures
from stiction_experiments.friction.manifest import PARTS, TWO_PHASE
from stiction_experiments.friction.planned import EVALUATED, PlannedRun, State
from stiction_experiments.friction.records import (
    ConditionRecord,
    CurvePoint,
    Experiment,
    LearnedFigure,
    RunRecord,
)
from stiction_experiments.lab.claims import Verdict, rejudged_summary
from stiction_experiments.lab.straight import following


def _condition_and_policy(row: ResultRow) -> str:
    """Return what `following` counts by: `CONDITION/student` or `CONDITION/teacher`."""
    _, condition, _, who = parse_policy(row.policy)
    return f"{condition}/{who}"


LISTS = {
    "conditions": ConditionRecord,
    "runs": RunRecord,
    "verdicts": Verdict,
}
"""Lists of summary.json."""


def read_experiment(out: Path) -> Experiment:
    """Return the experiment from the files of a folder, without its means and without who follows.

    Raises:
        StictionError: the folder has no files of the experiment.

    """
    summary = read_summary(out / "summary.json")
    # There are no curves where all runs came as bundles.
    rows, curves = read_results(out / "results.csv"), read_rows(out / "curves.csv", CurvePoint, optional=True)
    learned = read_rows(out / "learned.csv", LearnedFigure, optional=True)
    try:
        lists: dict[str, Any] = {
            name: [from_plain(kind, entry, f"{out / 'summary.json'}: {name}") for entry in summary[name]]
            for name, kind in LISTS.items()
        }
        return Experiment(rows, curves, parts=summary["parts"], summary=summary, learned=learned, **lists)
    except (KeyError, TypeError) as error:
        raise FileError(
            f"{out / 'summary.json'} is no summary of `stiction study friction` ({error!r}); expected one that it wrote"
        ) from error


def read_earlier(out: Path, preset: str) -> Experiment | None:
    """Return the same, None where a folder has nothing yet.

    Raises:
        StictionError: its files are damaged, or its runs were trained with another preset.

    """
    if not (out / "summary.json").exists():
        return None
    earlier = read_experiment(out)
    if (other := earlier.summary.get("preset", TWO_PHASE)) != preset:
        raise ConfigurationError(f"{out} has runs of the preset {other!r}, not {preset!r}; choose another --out")
    return earlier


def assemble(
    planned: Sequence[PlannedRun],
    rows: Sequence[ResultRow],
    base: EvaluationCfg,
    summary: Mapping[str, Any],
    before: Experiment | None = None,
) -> Experiment:
    """Return the experiment as far as it has come.

    Args:
        planned: the runs of the parts that were asked for.
        rows: results of those that are finished.
        base: how they were evaluated, levels in units of the experiment's own.
        summary: what else belongs into summary.json: the command, what `Origin` says, and what failed.
        before: what was found of runs that are elsewhere now. Learning curve, time and learned figures stay too where
            only the folder of a run is elsewhere, and its policy here.

    """
    metrics = {run.run.name: read_metrics(run.path / "metrics.jsonl") for run in planned if run.state() == "finished"}
    curves = {name: learning_curve(name, metric) for name, metric in metrics.items()}
    learned = [one for name, metric in metrics.items() for one in learned_figures(name, metric)]
    records, kept = {run.run.name: _record(run) for run in planned}, []
    here = {name for name, record in records.items() if record.state in EVALUATED}
    conditions = {run.run.condition.name: _condition(run) for run in planned}
    if before is not None:
        elsewhere = {one.name: one for one in before.runs if one.state in EVALUATED and one.name not in here}
        records |= elsewhere
        used = {one.condition for one in elsewhere.values()} - conditions.keys()
        conditions |= {one.name: one for one in before.conditions if one.name in used}
        rank = {name: number for number, name in enumerate(records)}
        rows = [*(row for row in before.rows if parse_policy(row.policy)[0] in elsewhere), *rows]
        kept = kept_origins(before, list(elsewhere))
        rows = sorted(rows, key=lambda row: rank[parse_policy(row.policy)[0]])
        same = {one.name: one for one in before.runs if one.state in EVALUATED and _same(one, records[one.name])}
        untimed = (name for name in same if records[name].minutes is None)
        records |= {name: replace(records[name], minutes=same[name].minutes) for name in untimed}
        curves = {name: points for name, points in curves_by_run(before.curves).items() if name in same} | curves
        curves = {name: curves[name] for name in records if name in curves}
        learned = [*(one for one in before.learned if one.run in same.keys() - metrics.keys()), *learned]
    experiment = Experiment(
        rows,
        [point for points in curves.values() for point in points],
        conditions=list(conditions.values()),
        runs=list(records.values()),
        parts=PARTS,
        summary={
            **summary,
            **({"kept": kept} if kept else {}),
            "evaluation": asdict(base) | {"commands": COMMANDS},
            "conditions_of_evaluation": base.conditions,
            "median_seeds": {name: median_seed(rows, name) for name in (NONE, DIRECT, DECEPTION)},
        },
        learned=learned,
    )
    return _judged(experiment)


def kept_origins(before: Experiment, runs: Sequence[str]) -> list[dict[str, Any]]:
    """Return from which command, revision and machine, and with which evaluation, kept rows come: `runs` names whose.

    before: what they are kept from, which may have kept some itself.
    """
    own = ("command", "revision", "machine", "evaluation")
    sources = [*before.summary.get("kept", []), {name: before.summary.get(name) for name in own}]
    left, origins = dict.fromkeys(runs), []
    for source in sources:
        taken = [run for run in left if run in source.get("runs", left)]
        origins += [{**source, "runs": taken}] if taken else []
        left = dict.fromkeys(run for run in left if run not in taken)
    return origins


def unwalked(planned: Sequence[PlannedRun], states: Sequence[State], before: Experiment) -> list[PlannedRun]:
    """Return the runs, each without an exported policy of which `before` has the results: they stay.

    A policy of the same name that other code trained is another, and walks. states: where the runs stand.
    """
    walked = {parse_policy(row.policy)[0] for row in before.rows}
    have = {one.name: one.revision for one in before.runs if one.state in EVALUATED and one.name in walked}
    exported = {run.run.name: run for run, state in zip(planned, states, strict=True) if state == "exported"}
    stay = {name for name in have.keys() & exported if exported[name].bundle().contract.revision == have[name]}
    return [replace(run, policy=None) if run.run.name in stay else run for run in planned]


def _same(before: RunRecord, now: RunRecord) -> bool:
    """Tell whether two records of a name are of one training, as far as it is known."""
    return now.state in EVALUATED and before.revision == now.revision


def curves_by_run(points: Iterable[CurvePoint]) -> dict[str, list[CurvePoint]]:
    """Return run -> its learning curve."""
    curves: dict[str, list[CurvePoint]] = {}
    for point in points:
        curves.setdefault(point.run, []).append(point)
    return curves


def _judged(experiment: Experiment) -> Experiment:
    evidence = TrainingEvidence.of_runs(experiment.rows, curves_by_run(experiment.curves))
    return replace(
        experiment,
        means=seed_means(evidence),
        verdicts=[claim.verdict(evidence) for claim in CLAIMS],
        following=following(experiment.rows, _condition_and_policy),
    )


def judge_again(out: Path, provenance: dict[str, Any]) -> Experiment:
    """Return the experiment that a folder has, judged anew; its summary says so, and which verdicts changed.

    provenance: by what it is judged now: the command, and what `Origin` says.

    Raises:
        StictionError: the folder has no files of the experiment.

    """
    before = read_experiment(out)
    judged = _judged(before)
    summary = rejudged_summary(before.summary, before.verdicts, judged.verdicts, provenance, own=LISTS)
    return replace(judged, summary={"warnings": []} | summary)


def _condition(planned: PlannedRun) -> ConditionRecord:
    condition, friction = planned.run.condition, planned.cfg.task.friction
    return part_of(
        ConditionRecord,
        condition,
        arguments=shlex.join(condition.options),
        robot=planned.cfg.task.robot,
        law=friction.law,
        nominal=friction.level or 0.0,
        training_mean=training_mean(friction),
    )


def _record(planned: PlannedRun) -> RunRecord:
    state, run = planned.state(), planned.run
    revision, minutes = "", None
    if state == "exported":
        revision = planned.bundle().contract.revision
    elif state != "missing":
        revision = str(RunDirectory(planned.path).header().get("revision", ""))
    if state == "finished":
        rows = read_metrics(planned.path / "metrics.jsonl")
        minutes = round(sum(row["seconds"] for row in rows) / 60, 1)
    return RunRecord(run.name, run.condition.name, run.seed, state, revision, minutes)
