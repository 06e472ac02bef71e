"""Which virtual robots are evidence is said once, and all that chooses some by itself chooses those."""

from __future__ import annotations

from dataclasses import MISSING, fields

from stiction.cli.evaluate import EvaluateCfg
from stiction.evaluation.grid import GridCfg
from stiction.virtual.cases import reported, warnings_on
from stiction_experiments.bench.study import BenchOptions
from stiction_experiments.wear.run import WearCfg
from stiction_experiments.wear.study import WearOptions


def test_robots_for_results_begin_at_a_thousand() -> None:
    """Smaller seeds were there to make and tune methods on, and results on them say so, in a sentence."""
    assert reported(3) == (1000, 1001, 1002)
    assert warnings_on(reported(3)) == []
    (said,) = warnings_on([3, 1000, 999])
    assert "(3, 999)" in said and "no evidence" in said


def test_what_walks_by_default_is_kept_for_results() -> None:
    """A default that was tuned on would be reported by whoever does not ask."""
    for kind in (EvaluateCfg, BenchOptions, WearOptions, GridCfg, WearCfg):
        (robots,) = [field.default for field in fields(kind) if field.name == "robots"]
        assert robots is not MISSING and robots == reported(len(robots)), kind
