"""Judges the experiment anew from the files of its results: the same rows under today's criteria, and no run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stiction.formats.errors import StictionError
from stiction.formats.experiment import (
    Collapse,
    ConditionRecord,
    CurvePoint,
    Experiment,
    Onset,
    RunRecord,
    Verdict,
    changed_verdicts,
)
from stiction.formats.results import read_results, read_summary
from stiction.formats.rows import read_rows
from stiction.transfer.experiment.advice import who_follows
from stiction.transfer.experiment.claims import judge_all
from stiction.transfer.experiment.criteria import Evidence
from stiction.transfer.experiment.table import Table

LISTS = {"conditions": ConditionRecord, "runs": RunRecord, "onsets": Onset, "collapses": Collapse}
"""Lists of summary.json that are not judged."""


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
        raise StictionError(
            f"{out / 'summary.json'} is no summary of `stiction study friction` ({error!r}); expected one that it wrote"
        ) from error
    table = Table.of(rows)
    by_run = {run: [point for point in curves if point.run == run] for run in dict.fromkeys(p.run for p in curves)}
    now = judge_all(Evidence(table, by_run))
    own = ("schema_version", "verdicts", "parts", *LISTS)
    kept = {"warnings": [], **{name: value for name, value in before.items() if name not in own}}
    changed = changed_verdicts(verdicts, now, before.get("changed", []))
    return Experiment(
        rows=rows,
        means=table.means(),
        curves=curves,
        verdicts=now,
        following=who_follows(rows),
        parts=parts,
        summary=kept | {"judged": made, "changed": changed},
        **lists,
    )
