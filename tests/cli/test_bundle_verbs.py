"""`verify`, `export` and `evaluate` from the command line, with good and with bad input."""

import hashlib
import json
import shutil
from pathlib import Path

import pytest

from bundles import make_bundle, make_contract
from stiction.cli.main import main
from stiction.files.bundle import find_bundle, shipped_bundles
from stiction.files.following import scaled_commands
from stiction.files.results import read_results
from stiction.robots.catalog import find_robot
from without import run_without
from words import but

pytestmark = pytest.mark.usefixtures("undrawn")

SHIPPED = "saturn_lite-flat-none-0.2"
"""A policy that comes along."""


def test_verify_prints_what_was_checked(bundle: Path, capsys: pytest.CaptureFixture) -> None:
    """A person must see what the word `passed` covers."""
    assert main(["verify", str(bundle)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].startswith("Verified: EVERY CHECK PASSED, 5 files, network, ")
    assert "note: whose it is was not checked: it has no signature, or --expect-digest" in lines
    assert any(line.startswith("note: target limits: none in evaluation; ") for line in lines)
    assert lines[-3:-1] == ["Next:", f"  stiction evaluate {bundle}"]
    assert lines[-1] == f"digest {hashlib.sha256((bundle / 'SHA256SUMS').read_bytes()).hexdigest()}"


@pytest.mark.parametrize("verb", ["verify", "evaluate", "deploy"])
def test_a_run_and_a_bare_network_are_told_the_command_that_makes_a_bundle(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, verb: str
) -> None:
    """One line with the exact command; a run with its bundle in it is that bundle."""
    monkeypatch.chdir(tmp_path)
    run, network = Path("my run"), Path("policy.onnx")
    run.mkdir()
    (run / "config.json").write_text("{}")
    network.write_bytes(b"onnx")
    for source, ending in (
        (run, "my run: got a training run that was not exported, expected a bundle; do: stiction export 'my run'"),
        (network, "do: stiction import policy.onnx --robot ROBOT --out policy, then give policy"),
        (Path("no.onnx"), "no.onnx: got no such file, expected the directory of a bundle, or a network in ONNX"),
    ):
        assert main([verb, str(source)]) == 1
        captured = capsys.readouterr()
        assert captured.err.rstrip().endswith(ending) and captured.err.count("\n") == 1 and not captured.out
    shutil.copytree(bundle, run / "bundle")
    assert find_bundle(run) == run / "bundle"
    assert main(["verify", str(run)]) == 0


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["evaluate", SHIPPED, "--friction-levels", "20"], "; is 20 % meant? use 0.2"),
        (
            ["evaluate", SHIPPED, "--engines", "mujoco-alone+all", "--robot-levels", "12.5"],
            "; is 12.5 % meant? use 0.125",
        ),
        (["evaluate", SHIPPED, "--friction-levels", "-1"], ""),
        (["evaluate", SHIPPED, "--friction-law", "load", "--friction-levels", "20"], ""),
        (["export", SHIPPED, "--to", "webots", "--friction-level", "20"], "; is 20 % meant? use 0.2"),
        (["view", SHIPPED, "--friction-level", "20"], "; is 20 % meant? use 0.2"),
        (["train", "--friction-level", "20"], "; is 20 % meant? use 0.2"),
    ],
)
def test_a_level_in_per_cent_is_asked_about(
    words: list[str], meant: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """Levels are shares of the torque limit; what can be no per cent, or is a coefficient, is not asked about."""
    pytest.importorskip("viser" if words[0] == "view" else "torch" if words[0] == "train" else "mujoco")
    monkeypatch.chdir(tmp_path)
    assert main(words) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "level" in error and ("meant?" in error) == bool(meant) and meant in error, error


def test_verify_takes_a_list_of_what_may_run(bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """The digest on it passes and is said to be; another list refuses in one line; and what was exercised is said."""
    digest = hashlib.sha256((bundle / "SHA256SUMS").read_bytes()).hexdigest()
    listed = tmp_path / "allowed.txt"
    listed.write_text(f"{digest}  # toy\n")
    assert main(["verify", str(bundle), "--allow", str(listed)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "as allowed" in out and "whose it is" not in out and "says nothing" in out
    listed.write_text("0" * 64)
    assert main(["verify", str(bundle), "--allow", str(listed)]) == 1
    shown = capsys.readouterr().err
    assert "not among the 1 that are allowed" in shown and shown.count("\n") == 1


def test_verify_takes_the_digest_that_was_published(bundle: Path, capsys: pytest.CaptureFixture) -> None:
    """Another bundle, or half of a digest, is refused in one line; the right one is said to be expected."""
    digest = hashlib.sha256((bundle / "SHA256SUMS").read_bytes()).hexdigest()
    assert main(["verify", str(bundle), "--expect-digest", digest]) == 0
    assert "as expected" in " ".join(capsys.readouterr().out.split())
    for wrong, reason in (("0" * 64, "it is another bundle"), (digest[:32], "64 hexadecimal digits"), ("", "64 hex")):
        assert main(["verify", str(bundle), "--expect-digest", wrong]) == 1
        shown = capsys.readouterr().err
        assert reason in shown and shown.count("\n") == 1


@pytest.mark.parametrize("options", [[], ["--json"]])
def test_verify_rejects_an_altered_bundle_in_one_line(
    bundle: Path, capsys: pytest.CaptureFixture, options: list[str]
) -> None:
    """Status 1, one line that names the file, and no traceback."""
    (bundle / "card.md").write_text("something else")
    assert main(["verify", str(bundle), *options]) == 1
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    assert "card.md" in captured.err
    if options:
        assert json.loads(captured.out)["ok"] is False
    else:
        assert captured.out == ""


def test_evaluate_writes_results_without_torch(bundle: Path, tmp_path: Path) -> None:
    """From the bundle alone; JSON on standard output and progress elsewhere."""
    out = tmp_path / "results"
    arguments = ["--friction-levels", "0", "0.2", "--commands", "vx=0.5", "--episodes", "2", "--seconds", "3"]
    done = run_without({"torch", "onnx", "rsl_rl"}, "evaluate", str(bundle), *arguments, "--out", str(out), "--json")
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    rows = read_results(out / "results.csv")
    assert [row.friction_level for row in rows] == [0.0, 0.2]
    assert summary["rows"][1]["speed_ratio"] == rows[1].speed_ratio
    assert summary["command"].startswith("stiction evaluate")
    assert {path.name for path in out.iterdir()} == {
        "results.csv",
        "summary.json",
        "friction_budget.svg",
        "friction_budget.png",
        "report.html",
        "methods.csv",
        "walks.jsonl",
        "settings.json",
    }


def test_all_commands_are_those_of_the_training(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """The whole set, each axis as far as the policy was trained: here half as fast, and without a turn."""
    ranges = {"forward": (-0.4, 0.4), "sideways": (-0.3, 0.3), "turn": (0.0, 0.0)}
    folder = make_bundle(tmp_path / "slow", make_contract(find_robot("saturn_lite"), command_range=ranges))
    words = ["--commands", "all", "--friction-levels", "0", "--episodes", "1", "--seconds", "3"]
    assert main(["evaluate", str(folder), *words, "--out", str(tmp_path / "out")]) == 0
    rows = read_results(tmp_path / "out" / "results.csv")
    assert tuple(row.command for row in rows) == scaled_commands((0.4, 0.3, 0.0))
    assert "Commands by friction" in (tmp_path / "out" / "report.html").read_text()


def test_a_policy_record_is_evaluated_with_one_line_of_warning(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Walks the policies of the results; `verify`, `deploy`, `sign` and `export` refuse them in one line."""
    (bundle / "golden.npz").unlink()
    walks = ["--friction-levels", "0", "--commands", "vx=0.5", "--episodes", "1", "--seconds", "3"]
    assert main(["evaluate", str(bundle), *walks, "--out", str(tmp_path / "walks")]) == 0
    notes = [line for line in capsys.readouterr().out.splitlines() if "nothing proves" in line]
    assert notes == [
        "note: policy records without golden vectors: nothing proves that the network computes as recorded: "
        f"{bundle.name}"
    ]
    assert len(read_results(tmp_path / "walks" / "results.csv")) == 1
    out = ["--out", str(tmp_path / "out")]
    for verb, *words in (
        ["verify"],
        ["deploy", *out],
        ["sign", "--key", "maker.pem"],
        ["export", "--to", "webots", *out],
    ):
        assert main([verb, str(bundle), *words]) == 1, verb
        error = capsys.readouterr().err
        assert "golden.npz is missing" in error and error.count("\n") == 1, verb


def test_demo_runs_without_torch_and_without_opengl(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The extra `sim` is enough for it; a server without graphics is told so once, and gets its page."""
    monkeypatch.setenv("MUJOCO_GL", "disable")
    monkeypatch.delenv("STICTION_DATA", raising=False)  # What is shown of a measured record is the same with torch.
    arguments = ["--out", str(tmp_path / "demo"), "--bundles", str(bundle), "--episodes", "1", "--seconds", "3.5"]
    done = run_without({"torch", "onnx", "rsl_rl", "tensordict", "safetensors"}, "demo", *arguments)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("OpenGL is not available") == 1
    assert done.stdout.startswith("open this page: ")
    assert "stiction evaluate walks all fifteen commands" in (tmp_path / "demo" / "report.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing"], "unknown policy 'nothing'"),
        (["{bundle}", "--friction-levels", "2"], "friction level"),
        (["{bundle}", "--commands", "forward"], "not understood"),
        (["{bundle}", "{bundle}"], "two bundles"),
        (["{bundle}", "--robot", "go1"], "joints"),
        (["{bundle}", "--robot", "spot"], "unknown"),
        (["{bundle}", "--out", "{bundle}/card.md"], "--out"),
    ],
)
def test_evaluate_refuses_bad_input_in_one_line(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture, arguments: list[str], message: str
) -> None:
    """Status 1 and one line that says what to do."""
    arguments = [argument.replace("{bundle}", str(bundle)) for argument in arguments]
    assert main(["evaluate", *but(("--out", str(tmp_path / "out")), *arguments)]) == 1
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("nothing", "no run in nothing; expected a folder that `stiction train` made"),
        ("mnie", "no run in mnie; did you mean 'mine'? expected"),
        ("log.csv", "no run in log.csv; expected"),
        (SHIPPED, f"{SHIPPED} is a policy bundle already; --to webots"),
    ],
)
def test_export_refuses_what_is_no_run(
    source: str, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """One line that says what it is instead, and nothing is made beside it."""
    pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to export")
    monkeypatch.chdir(tmp_path)
    Path("mine").mkdir()
    Path("log.csv").touch()
    assert main(["export", source]) == 1
    assert reason in capsys.readouterr().err and sorted(path.name for path in tmp_path.iterdir()) == ["log.csv", "mine"]


def test_a_bundle_that_is_not_there_is_one_failure_for_every_verb(capsys: pytest.CaptureFixture) -> None:
    """`sign` asked for a key first, and a script could not tell a name from a missing option."""
    for verb, reason in dict.fromkeys(("verify", "evaluate"), "unknown policy 'nosuch'").items() | {
        ("sign", "nosuch does not exist; expected the directory")
    }:
        assert main([verb, "nosuch"]) == 1
        assert f"stiction {verb}: {reason}" in capsys.readouterr().err


@pytest.mark.parametrize("named", ["name", "path", "link"])
def test_nothing_is_signed_that_came_with_the_package(
    named: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """The installed package got a signature of whoever tried the verb, and every other user of it with it."""
    pytest.importorskip("cryptography", reason="the package cryptography, of the extra 'sign', is needed to sign")
    package, own = tmp_path / "package", tmp_path / "own"
    own.mkdir()
    shutil.copytree(shipped_bundles()[SHIPPED], package / SHIPPED)
    monkeypatch.setattr("stiction.files.bundle.shipped_folder", lambda: package)
    monkeypatch.setattr("stiction.cli.sign.shipped_folder", lambda: package)
    monkeypatch.chdir(own)
    Path("mine").symlink_to(package / SHIPPED)
    assert main(["sign", "--new-key", "maker.pem"]) == 0
    capsys.readouterr()
    typed = {"name": SHIPPED, "path": str(package / SHIPPED), "link": "mine"}[named]
    assert main(["sign", typed, "--key", "maker.pem"]) == 1
    error = capsys.readouterr().err
    assert f"{typed} came with the package" in error and "copy it first" in error and error.count("\n") == 1
    assert not (package / SHIPPED / "SHA256SUMS.sig").exists()
    shutil.copytree(package / SHIPPED, SHIPPED)
    assert main(["sign", SHIPPED, "--key", "maker.pem"]) == 0 and Path(SHIPPED, "SHA256SUMS.sig").is_file()
