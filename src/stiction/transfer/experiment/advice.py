"""What the experiment says on which training to choose, for `stiction identify`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from stiction.formats.advice import Source, Way
from stiction.formats.experiment import Experiment
from stiction.formats.following import Following, following
from stiction.formats.results import ResultRow
from stiction.locomotion.friction import FRICTION_RANGES
from stiction.transfer.experiment.criteria import DECEPTION, DIRECT, NONE
from stiction.transfer.experiment.manifest import condition_of
from stiction.transfer.experiment.table import STUDENT

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
    ways = {
        method: Way(method, 0.0 if method == "none" else nominal[condition], *FRICTION_RANGES[method])
        for method, condition in ASKED.items()
        if condition in nominal
    }
    policies = sorted({row.policy for row in experiment.rows if _way_of(row) in names})
    return Source(experiment.summary["command"], experiment.summary["revision"], tuple(policies), ways, tuple(cells))
