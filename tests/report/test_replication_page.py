"""The page of the comparison: every file, and sentences that the numbers bear."""

import json
from dataclasses import replace
from pathlib import Path

from stiction.formats.experiment import Verdict
from stiction.formats.replication import BudgetPoint, Onset, PartRecord, Replication
from stiction.formats.results import ResultRow, read_results
from stiction.report.replication import lead, warnings, write_replication
from stiction.report.replication_tables import needs_sheet, stairs_sheet

ROWS = [
    ResultRow("p", "none", 0, "physx", "coulomb", level, "flat", command, 1.0 - level, 0.1, 0.0, 4.0, None, 1.0, *rest)
    for level in (0.0, 0.1, 0.2)
    for command, rest in (("vx=0.5", (20.0, 0.8, 0.0, 8)), ("vx=-0.5", (20.0, 0.8, 0.0, 8)))
]


def details(rows: list[ResultRow]) -> list[dict]:
    """Return rows as summary.json has them."""
    return [vars(row) | {"crossed": None, "crossed_interval": None} for row in rows]


def onset(way: str, engine: str, level: float | None) -> Onset:
    """Return where a way falls in an engine, tested up to 30 %."""
    return Onset(way, engine, "coulomb", 1, level, None, None, 0.3, "", None)


RESULT = Replication(
    parts=[PartRecord("engines", "Sim2Sim", ROWS, details(ROWS))],
    means=[],
    budget=[BudgetPoint("none", "physx", "coulomb", lv, 1, 1 - lv, None, None, f"{1 - lv}") for lv in (0.0, 0.1, 0.2)],
    onsets=[onset("none", "physx", 0.12), onset("none", "ode", 0.08)],
    verdicts=[Verdict("E1", "a <sentence>", "a criterion", "not tested", "none 0.90 (one seed)")],
    ways={"none": "without friction"},
    summary={
        "command": "stiction replicate",
        "dead_band": 0.45,
        "grids": {"engines": {"title": "Sim2Sim"}},
        "policies": {"p": {"way": "none", "seed": 0, "revision": "abc", "digest": "0" * 64, "command": "train"}},
        "revision": "abc",
        "seconds": 1.0,
        "machine": {"cpu": "a processor"},
    },
)


def test_every_file_is_written(tmp_path: Path) -> None:
    """A page without its numbers beside it could not be checked."""
    page = write_replication(tmp_path, RESULT, {})
    names = {path.name for path in tmp_path.iterdir()}
    assert names >= {"results.csv", "budget.csv", "onsets.csv", "verdicts.csv", "summary.json", "tables.md"}
    assert {"budget.png", "needs.png"} <= names
    assert read_results(tmp_path / "results.csv") == ROWS
    assert json.loads((tmp_path / "summary.json").read_text())["verdicts"][0]["outcome"] == "not tested"
    html = page.read_text()
    assert "a &lt;sentence&gt;" in html
    assert "<script" not in html and 'src="http' not in html


def test_a_way_follows_only_if_it_does_in_every_engine() -> None:
    """At 10 % it is above its onset in ODE, and below in PhysX."""
    rows = dict(needs_sheet(RESULT.onsets).rows)
    assert rows["5 %"] == "none"
    assert rows["10 %"] == "none of them"


def test_what_was_not_tested_is_not_said_to_fail() -> None:
    """Nobody was walked at 30 % where levels end at 20 %."""
    short = [replace(onset("none", "physx", None), tested=0.2)]
    rows = dict(needs_sheet(short).rows)
    assert rows["20 %"] == "none"
    assert rows["25 %"] == "not tested"


def test_a_missing_method_and_a_single_seed_are_said() -> None:
    """The paper compares three methods."""
    assert any("actuator, deception" in text for text in warnings(RESULT))
    assert "1 not tested" in lead(RESULT)


def test_no_stairs_no_table() -> None:
    """A table of dashes would read as failures."""
    assert stairs_sheet(RESULT) is None
