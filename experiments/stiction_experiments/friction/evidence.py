"""The results of the experiment as evidence: rows by training condition, with learning curves."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Self

import numpy as np

from stiction.core.statistics import t_interval
from stiction.evaluation.grid import BATCH
from stiction.evaluation.samples import Condition
from stiction.files.results import ResultRow
from stiction_experiments.friction.manifest import condition_of
from stiction_experiments.friction.records import HIGHEST, STUDENT, CurvePoint, SeedMean
from stiction_experiments.lab.evidence import Evidence, Measurement


def parse_policy(policy: str) -> tuple[str, str, int, str]:
    """Return run, condition, seed and which policy: `a-s3/student` -> (`a-s3`, `a`, 3, `student`)."""
    run, _, who = policy.partition("/")
    return run, *condition_of(run), who


@dataclass(frozen=True)
class TrainingEvidence(Evidence):
    """Rows by cell, and learning curves. The method is the condition for students, `CONDITION/teacher` for teachers."""

    curves: Mapping[str, Sequence[CurvePoint]] = field(default_factory=dict)

    @classmethod
    def of_runs(cls, rows: Iterable[ResultRow], curves: Mapping[str, Sequence[CurvePoint]] | None = None) -> Self:
        """Sort rows by their cells. curves: run -> its learning curve."""
        named = []
        for row in rows:
            _, condition, seed, who = parse_policy(row.policy)
            method = condition if who == STUDENT else f"{condition}/{who}"
            named.append(asdict(row) | {"method": method, "seed": seed})
        return replace(cls.of(named), curves=curves or {})

    def mean_error(self, method: str) -> Measurement:
        """Return the mean of |speed ratio - 1| over both directions and the levels up to `HIGHEST`, of every seed."""
        return self.error(method, *(at(level) for level in self.levels(method, BATCH) if level <= HIGHEST))


def at(level: float, law: str = "coulomb") -> Condition:
    """Return a friction in the engine of training."""
    return Condition(BATCH, level, law)


def seed_means(evidence: Evidence) -> list[SeedMean]:
    """Return the mean speed ratio over seeds of every cell that has one, with its t-interval."""
    means = []
    for cell in evidence.cells:
        method, _, law, level, _, command = cell
        if values := list(evidence.column(cell, "speed_ratio").values()):
            condition, _, who = method.partition("/")
            low, high = t_interval(values) or (None, None)
            mean = float(np.mean(values))
            means.append(SeedMean(condition, who or STUDENT, law, level, command, len(values), mean, low, high))
    return sorted(means, key=lambda one: (one.condition, one.who, one.friction_level, one.command))


def median_seed(rows: Iterable[ResultRow], condition: str) -> int | None:
    """Return the median seed by the student's speed error over levels up to `HIGHEST`.

    Of an even number of seeds the better of the two in the middle; None where no student was evaluated.
    """
    errors = TrainingEvidence.of_runs(rows).mean_error(condition).seeds
    ranked = sorted(errors, key=lambda seed: (errors[seed], seed))
    return ranked[(len(ranked) - 1) // 2] if ranked else None
