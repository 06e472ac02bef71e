"""The experiment's page, tables and figures, drawn from records alone."""

import csv
import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import pytest

from stiction.core.errors import StictionError
from stiction.files.results import read_results
from stiction.learning.arguments import parse
from stiction.learning.config import TrainCfg
from stiction_experiments.friction import assemble
from stiction_experiments.friction.answer import lead
from stiction_experiments.friction.evaluation import BASE
from stiction_experiments.friction.manifest import Condition, Run
from stiction_experiments.friction.page import methods_sheet, part_sheet, report, sheets_of
from stiction_experiments.friction.planned import PlannedRun
from stiction_experiments.friction.records import CurvePoint, Experiment
from stiction_experiments.lab.study import write_report
from synthetic import condition_rows, write_run

METHODS = ("none", "direct", "deception")
MADE = {"command": "c", "revision": "abc", "machine": {"cpu": "a processor"}, "warnings": []}


@cache
def configuration(method: str) -> TrainCfg:
    """Return what `stiction train` reads for a short run, once a method."""
    words = ("--method", method, "--friction-level", "0.2", "--teacher.iterations", "1", "--student.iterations", "1")
    return parse(["--preset", "two-phase", *words]).config


def experiment(folder: Path, parts: tuple[str, ...] = ("1",), seeds: int = 3) -> Experiment:
    """Some conditions with made-up results: 0.9, 1.0 and 1.1 without friction, half of that at 20 %."""
    places, rows = [], []
    for part in parts:
        for method in METHODS:
            name = f"coulomb20-{method}" if part == "1" else f"part{part}-{method}"
            options = ("--method", method, "--friction-level", "0.2")
            condition = Condition(name, part, "a purpose", options, tuple(range(seeds)))
            cfg = configuration(method)
            for seed in range(seeds):
                places.append(PlannedRun(Run(condition, seed), cfg, folder / f"{name}-s{seed}"))
                write_run(places[-1])
            ratios = [0.9 + 0.1 * seed for seed in range(seeds)]
            for who in ("student", "teacher"):
                rows += condition_rows(name, {0.0: ratios, 0.2: [r / 2 for r in ratios]}, who, backward=0.5)
    return assemble.assemble(places, rows, BASE, MADE | {"failed": {}})


def test_designs_are_led_by_who_follows(tmp_path: Path) -> None:
    """They test no sentence of the paper: a page that begins with 18 untested ones would say nothing."""
    record = experiment(tmp_path, ("designs",), seeds=1)
    answer, _ = lead(record).splitlines()
    assert answer == "None of 3 ways to train follows with its one seed at any friction up to 30 %."
    assert "with every seed at any friction" in lead(experiment(tmp_path / "two", ("designs",), seeds=2))
    assert {"following", "methods-student"} <= set(sheets_of(record)) and "verdicts" not in sheets_of(record)
    following = [replace(cell, follow=cell.friction_level < 0.1) for cell in record.following]
    assert "the most do at 1 of 2 frictions: a purpose (partdesigns-none); a purpose" in lead(
        replace(record, following=following)
    )
    for seeds, seeds_text in ((1, "its one seed"), (3, "every seed")):
        following = [replace(one, seeds=seeds, follow=seeds * ("none" in one.method)) for one in record.following]
        assert lead(replace(record, following=following)).startswith(
            f"1 of 3 ways to train follows with {seeds_text} up to 30 % friction: a purpose (partdesigns-none)."
        )
    assert "verdicts" in sheets_of(experiment(tmp_path / "first", ("1",)))


def test_methods_are_led_by_where_every_seed_follows(tmp_path: Path) -> None:
    """The title asks which training copes with how much friction: the first sentence says it, without codes."""
    record = experiment(tmp_path)
    following = [
        replace(cell, follow=cell.seeds * ("direct" in cell.method and cell.friction_level > 0.1))
        for cell in record.following
    ]
    answer = lead(replace(record, following=following)).splitlines()[0]
    assert answer == (
        "With this much friction, of each joint's torque limit, every seed follows: trained with 16 to 24 % (direct), "
        "at 20 %; trained without friction (none), nowhere; trained with 0 to 24 % (deception), nowhere."
    )
    alone = [replace(cell, seeds=1, follow=min(cell.follow, 1)) for cell in following]
    answer = lead(replace(record, following=alone)).splitlines()[0]
    assert "the one seed of each follows: trained with 16 to 24 % (direct), at 20 %" in answer
    some = [
        replace(cell, seeds=1, follow=min(cell.follow, 1)) if "direct" in cell.method else cell for cell in following
    ]
    answer = lead(replace(record, following=some)).splitlines()[0]
    assert "every seed follows: trained with 16 to 24 % (direct), its one seed, at 20 %; trained without" in answer
    assert report(record).title == "Which training in two phases copes with how much joint friction?"


def test_every_file_is_written_and_reads_back(tmp_path: Path) -> None:
    """Writes all tables and both figures, and reads back the same rows."""
    out = tmp_path / "out"
    out.mkdir()
    record = experiment(tmp_path, ("1", "5", "6"))
    write_report(out, report(record), MADE)
    page = (out / "report.html").read_text()
    assert read_results(out / "results.csv") == list(record.rows)
    with (out / "intervals.csv").open() as file:
        intervals = list(csv.DictReader(file))
    first = next(r for r in intervals if r["condition"] == "coulomb20-none" and float(r["friction_level"]) == 0.0)
    assert (first["seeds"], first["mean"], first["low"][:7]) == ("3", "0.5", "0.37579")  # backward: 0.45, 0.5, 0.55
    summary = json.loads((out / "summary.json").read_text())
    assert len(summary["runs"]) == 27 and summary["median_seeds"]["coulomb20-none"] == 1
    assert {v["id"] for v in summary["verdicts"]} == {v.id for v in record.verdicts}
    for name in ("budget", "learning"):
        assert (out / f"{name}.png").read_bytes().startswith(b"\x89PNG"), name
    assert page.count('class="drawing"') == 2 and not re.search(r'(src|href)="http', page)
    assert (out / "tables.md").read_text().startswith("**The paper's sentences**")


def test_seeds_that_follow_with_a_walk_that_stalls_are_named(tmp_path: Path) -> None:
    """The table counts means; under it stands which of the counted seeds had a walk under half of the command."""
    record = experiment(tmp_path)
    assert "slowest walk" not in sheets_of(record)["following"].note
    rows = [replace(row, speed_ratio=abs(row.speed_ratio or 0.0)) for row in record.rows]
    walks = {"coulomb20-direct-s1/student": 0.284, "coulomb20-none-s2/teacher": 0.45, "coulomb20-none-s0/student": 0.5}
    rows = [
        replace(row, speed_ratio=1.0, slowest_walk=walks[row.policy]) if row.policy in walks else row for row in rows
    ]
    note = sheets_of(replace(record, rows=rows))["following"].note
    assert note.endswith(
        "Seeds that follow in the mean, a walk of theirs under 0.5: trained with 16 to 24 % (direct), student, slowest "
        "walk of seed 1 at 0 %: 0.28; trained with 16 to 24 % (direct), student, slowest walk of seed 1 at 20 %: 0.28; "
        "trained without friction (none), teacher, slowest walk of seed 2 at 0 %: 0.45; trained without friction "
        "(none), teacher, slowest walk of seed 2 at 20 %: 0.45."
    )
    assert "\n" not in note
    everywhere = [replace(row, speed_ratio=1.0, slowest_walk=0.1) for row in rows]
    assert sheets_of(replace(record, rows=everywhere))["following"].note.endswith("; 24 more in results.csv.")


def test_rows_that_are_kept_say_whence_they_are(tmp_path: Path) -> None:
    """`--add` twice, each by other code: rows keep the revision that walked them."""
    first = experiment(tmp_path / "first", seeds=2)
    out = tmp_path / "out"
    out.mkdir()
    write_report(out, report(first), MADE)
    condition = Condition("coulomb20-none", "1", "a purpose", ("--method", "none", "--friction-level", "0.2"), (2,))
    new = PlannedRun(Run(condition, 2), configuration("none"), tmp_path / "coulomb20-none-s2")
    write_run(new)
    rows = condition_rows("coulomb20-none", {0.0: [1.0, 1.0, 1.0], 0.2: [0.5] * 3}, "student", backward=0.5)
    rows = [row for row in rows if "-s2/" in row.policy]
    made = MADE | {"command": "again", "revision": "def", "machine": {"cpu": "another"}, "failed": {}}
    second = assemble.assemble([new], rows, replace(BASE, episodes=3), made, assemble.read_experiment(out))
    (kept,) = second.summary["kept"]
    assert (kept["command"], kept["revision"], len(kept["runs"])) == ("c", "abc", 6)
    assert second.summary["revision"] == "def" and "coulomb20-none-s2" not in kept["runs"]
    write_report(out, report(second), made | {"warnings": []})
    text = (out / "report.html").read_text()
    assert "by c, revision abc, on a processor, evaluated with episodes 16." in text
    assert "coulomb20-none-s0, coulomb20-none-s1" in text
    third = assemble.assemble([], [], BASE, made | {"revision": "123"}, assemble.read_experiment(out))
    origins = {run: one["revision"] for one in third.summary["kept"] for run in one["runs"]}
    assert origins == dict.fromkeys(kept["runs"], "abc") | {"coulomb20-none-s2": "def"}


def test_a_run_whose_folder_has_gone_keeps_its_curve(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Trainings move from machine to machine, their policies stay: the page lost the curve with the folder."""
    curve = [CurvePoint(f"coulomb20-{method}-s0", "teacher", 10, 0.9, 0.8) for method in METHODS]
    before = replace(experiment(tmp_path, seeds=1), curves=curve)
    condition = Condition("coulomb20-none", "1", "a purpose", ("--method", "none", "--friction-level", "0.2"), (0,))
    at = PlannedRun(Run(condition, 0), configuration("none"), tmp_path / "elsewhere", tmp_path)
    assert at.state() == "exported" and before.runs[0].minutes is not None

    def again(revision: str) -> Experiment:
        bundle = SimpleNamespace(contract=SimpleNamespace(revision=revision))
        monkeypatch.setattr(PlannedRun, "bundle", lambda self: bundle)
        return assemble.assemble([at], [], BASE, MADE | {"failed": {}}, before)

    later = again(before.runs[0].revision)
    assert later.runs[0].state == "exported" and later.runs[0].minutes == before.runs[0].minutes
    assert sorted(later.curves, key=str) == sorted(curve, key=str)
    # A folder that is here tells its own time.
    earlier = replace(before, runs=[replace(before.runs[0], minutes=99.0)])
    here = PlannedRun(at.run, at.cfg, tmp_path / "coulomb20-none-s0")
    assert assemble.assemble([here], [], BASE, MADE | {"failed": {}}, earlier).runs[0] == before.runs[0]
    # Another training of the same name has a curve of its own, which is not known.
    other = again("another")
    assert other.runs[0].minutes is None and "coulomb20-none-s0" not in {point.run for point in other.curves}


def test_a_policy_that_was_trained_anew_walks_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By its name alone a policy of other code would bear what the one before it walked."""
    before = experiment(tmp_path, seeds=1)
    condition = Condition("coulomb20-none", "1", "a purpose", ("--method", "none", "--friction-level", "0.2"), (0,))
    planned = PlannedRun(Run(condition, 0), configuration("none"), tmp_path / "elsewhere", tmp_path)

    def walks(revision: str, earlier: Experiment = before) -> bool:
        bundle = SimpleNamespace(contract=SimpleNamespace(revision=revision))
        monkeypatch.setattr(PlannedRun, "bundle", lambda self: bundle)
        (run,) = assemble.unwalked([planned], [planned.state()], earlier)
        return run.policy is not None

    assert before.runs[0].name == "coulomb20-none-s0"
    assert not walks(before.runs[0].revision) and walks("another")
    # Finished, but its evaluation failed.
    assert walks(before.runs[0].revision, replace(before, rows=[]))


def test_nothing_yet_is_a_page_too(tmp_path: Path) -> None:
    """Writes a page before the first run ends."""
    out = tmp_path / "out"
    out.mkdir()
    empty = assemble.assemble([], [], BASE, MADE | {"failed": {"coulomb20-none-s0": "it diverged"}})
    write_report(out, report(empty), MADE)
    assert "coulomb20-none-s0 failed: it diverged" in (out / "report.html").read_text()
    assert lead(empty).endswith("0 of 0 trainings are finished.") and "18 were not tested" in lead(empty)
    with pytest.raises(StictionError, match="choose another --out"):
        write_report(out / "report.html" / "below", report(empty), MADE)


def test_tables_show_means_with_intervals_and_single_seeds_without(tmp_path: Path) -> None:
    """0.9, 1.0, 1.1: 1.00 ± 4.3027 * 0.1 / √3 = 0.25. One seed has no interval."""
    several = methods_sheet(experiment(tmp_path / "a"), ["coulomb20-none"], "student")
    assert several.header[1:] == ("0 %", "20 %") and several.rows[0] == (
        "none, forward",
        "1.00 ± 0.25",
        "0.50 ± 0.12",
    )
    one = part_sheet(experiment(tmp_path / "b", seeds=1), "1")
    assert one.rows[0][:6] == ("coulomb20-none: a purpose", "student", "1", "0.90 / 0.45", "0.90 / 0.45", "0.45 / 0.23")
    assert one.rows[-2][4] == "– / –"  # nothing was evaluated at the mean of deception, 0.12
