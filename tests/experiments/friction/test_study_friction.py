"""`stiction study friction` as a user runs it, on an experiment of one small run."""

import json
import re
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from stiction.cli.main import main
from stiction.files.bundle import find_bundle, read_bundle
from stiction.files.results import read_results
from stiction_experiments.friction import evaluation, manifest, planned, training

pytestmark = pytest.mark.usefixtures("undrawn")

SMALL = (
    *("--robot", "go1", "--num-envs", "4", "--method", "deception", "--friction-level", "0.2"),
    *("--teacher.iterations", "1", "--teacher.steps", "4", "--teacher.mini-batches", "2"),
    *("--student.iterations", "1", "--student.steps", "4", "--student.mini-batches", "2"),
)


class Ended:
    """A process that has ended."""

    def poll(self) -> int:
        """Say so."""
        return 0


@pytest.fixture
def trained_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Train in this process: that runs have one of their own is tested by the others, and takes seconds to start."""

    def start(run: planned.PlannedRun, command: object) -> training.Job:
        assert main(["train", *run.run.arguments, "--out", str(run.path)]) == 0
        return training.Job(run, Ended())  # type: ignore[arg-type]

    monkeypatch.setenv("STICTION_THREADS", "1")
    monkeypatch.setattr(training, "start", start)
    monkeypatch.setattr(training, "train_missing", partial(training.train_missing, poll=0.0))


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """One condition of one seed, and fewer levels."""
    monkeypatch.setattr(manifest, "MANIFEST", (manifest.Condition("coulomb20-deception", "1", "a test", SMALL),))
    monkeypatch.setattr(evaluation, "BASE", replace(evaluation.BASE, friction_levels=(0.0, 0.2)))


def test_one_command_trains_evaluates_and_judges(
    small: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """One command trains, evaluates and judges; a second call reads the cache."""
    monkeypatch.chdir(tmp_path)
    options = ["--jobs", "1", "--episodes", "2", "--seconds", "3.1", "--json"]
    assert main(["study", "friction", "--train", *options]) == 0
    assert set(json.loads(capsys.readouterr().out).values()) == {"not tested"}
    out = tmp_path / "results/friction-training"
    rows = read_results(out / "results.csv")
    assert {row.policy for row in rows} == {"coulomb20-deception-s0/teacher", "coulomb20-deception-s0/student"}
    assert {row.method for row in rows} == {"deception"} and {row.episodes for row in rows} == {2}
    assert sorted({row.friction_level for row in rows}) == [0.0, 0.12, 0.2]
    cached = {file: file.stat().st_mtime_ns for file in tmp_path.glob("runs/*/evaluation/*.json")}
    assert len(cached) == 2
    assert main(["study", "friction", "--train", *options]) == 0
    capsys.readouterr()
    assert cached == {file: file.stat().st_mtime_ns for file in tmp_path.glob("runs/*/evaluation/*.json")}
    header = json.loads((tmp_path / "runs/coulomb20-deception-s0/config.json").read_text())
    header["config"]["seed"] = 5
    (tmp_path / "runs/coulomb20-deception-s0/config.json").write_text(json.dumps(header))
    assert main(["study", "friction"]) == 1
    error = capsys.readouterr().err
    assert "seed is 5, expected 0" in error and error.count("\n") == 1


def test_runs_of_several_machines_make_one_experiment(
    trained_here: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Keeps results of runs that are elsewhere now; rejects another preset."""
    words = (*SMALL[: SMALL.index("--student.iterations")],)
    monkeypatch.setattr(
        manifest, "MANIFEST", (manifest.Condition("coulomb20-deception", "cohort", "a test", words, (0, 1)),)
    )
    monkeypatch.setattr(evaluation, "WINDOW", 1)
    monkeypatch.setattr(evaluation, "BASE", replace(evaluation.BASE, friction_levels=(0.0, 0.2)))
    monkeypatch.chdir(tmp_path)
    options = ["study", "friction", "--preset", "quick", "--jobs", "1", "--episodes", "2", "--seconds", "3.1"]
    assert main([*options, "--train"]) == 0
    out = tmp_path / "results/friction-training"
    tables = {name: (out / name).read_text() for name in ("results.csv", "curves.csv", "intervals.csv")}
    assert {row.policy for row in read_results(out / "results.csv")} == {
        f"coulomb20-deception-s{s}/student" for s in (0, 1)
    }
    runs = json.loads((out / "summary.json").read_text())["runs"]
    (tmp_path / "runs/coulomb20-deception-s0").rename(tmp_path / "elsewhere")
    assert main([*options, "--add"]) == 0
    assert tables == {name: (out / name).read_text() for name in tables}
    assert json.loads((out / "summary.json").read_text())["runs"] == runs
    assert main(options) == 0
    assert {row.policy for row in read_results(out / "results.csv")} == {"coulomb20-deception-s1/student"}
    (out / "curves.csv").unlink()
    assert main([*options, "--add"]) == 0, "a folder whose policies came as bundles has no curves"
    capsys.readouterr()
    assert main(["study", "friction", "--add", "--train", "--runs", "other"]) == 1
    assert "has runs of the preset 'quick', not 'two-phase'" in capsys.readouterr().err


def test_listing_begins_nothing(small: None, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Lists all runs with their cost, and writes nothing."""
    of_two = ["--preset", "two-phase", "--runs", str(tmp_path)]
    assert main(["study", "friction", "--plan", *of_two]) == 0
    listed = capsys.readouterr().out
    assert listed.startswith("missing        0%        0 min  stiction train --preset two-phase --robot go1")
    assert re.search(r"(\d+) runs, of up to \d+ seeds; \1 are missing, some 0.0 hours of one core", listed)
    assert re.search(
        r"\d+ more are those of --preset quick: parts designs, methods, cohort\n.* replicate .*\n$", listed
    )
    for name in ("friction", "training"):
        assert main(["study", name, "--plan", *of_two]) == 0
        assert capsys.readouterr().out == listed
    assert main(["study", "friction", "--runs", str(tmp_path / "nosuch"), "--out", str(tmp_path / "out")]) == 1
    assert "is finished; train them with --train" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    assert main(["study", "friction", "--parts", "7"]) == 1
    assert "unknown part '7'" in capsys.readouterr().err
    # By either name it is one study, which reads the folders of the other.
    assert main(["study", "training", "--parts", "7"]) == 1
    assert capsys.readouterr().err.startswith("stiction study training: unknown part '7'")
    assert main(["study", "friction", "--jobs", "0"]) == 1


@pytest.mark.parametrize("words", [["--train"], ["--episodes", "3"], ["--json"], ["--add"], ["--out", "elsewhere"]])
def test_a_plan_makes_no_use_of_what_is_done_with_runs(words: list[str], capsys: pytest.CaptureFixture) -> None:
    """Rejects options of training and evaluation with --plan."""
    assert main(["study", "training", "--plan", *words]) == 1
    assert capsys.readouterr().err.startswith(f"stiction study training: --plan and {words[0]} exclude")


def test_a_plan_counts_the_policies_that_are_there_and_no_others(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder that is mistyped would say that everything is missing, and another's policy that a run is done."""
    shipped = find_bundle(Path("saturn_lite-flat-deception-0.2"))
    seed, words = read_bundle(shipped).contract.seed, ("--method", "deception", "--friction-level", "0.2")
    condition = manifest.Condition("coulomb20-deception", "cohort", "a test", words, (seed,))
    monkeypatch.setattr(manifest, "MANIFEST", (condition,))
    shutil.copytree(shipped, tmp_path / "policies" / f"coulomb20-deception-s{seed}")
    plan = ["study", "training", "--plan", "--runs", str(tmp_path / "runs"), "--policies"]
    (tmp_path / "others").mkdir()
    assert main([*plan, str(tmp_path / "others"), str(tmp_path / "policies")]) == 0
    quick, total, _ = capsys.readouterr().out.splitlines()
    assert quick.startswith("exported     100%") and total.startswith("1 runs, of up to 1 seeds; 0 are missing")
    assert main([*plan, str(tmp_path / "none"), "--preset", "quick"]) == 1
    assert f"there is no folder {tmp_path / 'none'}" in capsys.readouterr().err
    assert main([*plan, str(tmp_path / "policies"), "--preset", "quick"]) == 0
    assert re.match(r"exported +100% +\d+ min +stiction train --preset quick", capsys.readouterr().out)
    assert main([*plan, str(tmp_path / "policies"), "--preset", "full"]) == 1
    assert "is another policy than the manifest's: it was trained with" in capsys.readouterr().err
