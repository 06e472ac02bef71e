"""Every verb that writes, onto a disk that is full and into a folder that may not be written.

One line and status 1; a file is whole under its name or not there; and what was there before is there after.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stiction.cli.main import main

pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to train")

import walks
from blank_figures import blank_figures
from disks import full, read_only
from excitations import search_little
from foreign import MJLAB, network, written
from stiction.evaluation import export
from stiction.evaluation.export import export_network
from stiction.files.log import write_log
from stiction.files.walk import write_walk
from stiction.identification.example import example_log

POLICY = "saturn_lite-flat-none-0.2"
TRAIN = (
    *("--robot", "go1", "--num-envs", "2", "--checkpoint-every", "1", "--method", "none", "--preset", "two-phase"),
    *("--video-every", "0", "--teacher.iterations", "2", "--teacher.steps", "4", "--teacher.mini-batches", "2"),
    *("--student.iterations", "1", "--student.steps", "4", "--student.mini-batches", "2"),
)
WALK = ("--friction-levels", "0.2", "--commands", "vx=0.5", "--episodes", "1", "--seconds", "3", "--jobs", "1")
WEAR = ("--engine", "mujoco", "--seconds", "3", "--window", "0.5", "--jobs", "1", "--robots", "3", "--levels", "0.3")
DEPLOY = (
    *("--duration", "0.6", "--silence", "5", "--stale", "5", "--gap", "5"),
    *("--stand", "--robot-cell", "sensors", "--set", "safety.losses=1"),
)

VERBS = {
    "robot": ("robot", "show", "go1", "--out", "{out}"),
    "excite": (
        "excite",
        *["--duration", "6", "--rate", "200", "--torque-limit", "45", "--coulomb", "0.44", "--out", "{out}"],
    ),
    "identify": ("identify", "{in}/joint.csv", "--out", "{out}"),
    "sidecar": ("identify", "{out}/bare.csv", "--init"),
    "identify-walk": ("identify", "{in}/walk.npz", "--out", "{out}"),
    "convert": ("convert", "{in}/identified/joints.json", "--to", "mujoco", "--out", "{out}/joints.xml"),
    "train": ("train", *TRAIN, "--out", "{out}"),
    "resume": ("train", "--resume", "{out}"),
    "train-actuator": ("train-actuator", "{in}/logs", "--epochs", "1", "--hidden", "4", "--out", "{out}"),
    "evaluate": ("evaluate", POLICY, *WALK, "--out", "{out}"),
    "evaluate-log": ("evaluate", POLICY, *WALK, "--log", "{out}/logs", "--log-seconds", "1", "--out", "{out}"),
    "study": ("study", "wear", POLICY, *WEAR, "--no-control", "--out", "{out}"),
    "export": ("export", "{in}/run", "--out", "{out}/bundle"),
    "webots": ("export", POLICY, "--to", "webots", "--out", "{out}/project"),
    "rl_sar": ("export", "{in}/toy", "--to", "rl_sar", "--out", "{out}/theirs"),
    "targets": ("export", "{in}/run", "--out", "{out}/bundle", "--maker-targets", "{out}/targets.csv"),
    "import": ("import", "{in}/theirs.onnx", "--robot", "go2", "--settings", "{in}/own.yaml", "--out", "{out}/bundle"),
    "sign": ("sign", "{out}/toy", "--key", "{in}/maker.pem"),
    "key": ("sign", "--new-key", "{out}/other.pem"),
    "deploy": ("deploy", POLICY, *DEPLOY, "--out", "{out}"),
}
"""Each verb, and each kind of file that one writes."""

ROOM = {"sign": 10, "key": 20, "convert": 20}
"""Bytes that there is room for in a file, where 300 were enough."""

SLOW = ("excite", "evaluate-log", "identify-walk", "study", "targets")
"""Verbs that compute for long before they write."""

GROW = (".jsonl", ".log", ".lock")
"""Files that are written line by line, of which readers leave out half a line; beside TensorBoard's."""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write inputs of all verbs: logs, identified joints, a full and a partial run, bundles, an ONNX file, a key."""
    from bundles import make_bundle, make_contract

    folder = tmp_path_factory.mktemp("inputs")
    write_log(folder / "joint.csv", example_log())
    write_walk(folder / "walk.npz", walks.walk(0.1 * walks.LIMITS[None], [walks.CURVE], seconds=6.0)[0])
    assert main(["identify", str(folder / "joint.csv"), "--out", str(folder / "identified")]) == 0
    with pytest.MonkeyPatch.context() as patch, blank_figures():
        patch.setenv("STICTION_THREADS", "1")
        assert main(["train", *TRAIN, "--out", str(folder / "run")]) == 0
        logs = ["--log", str(folder / "logs"), "--log-robots", "2", "--log-seconds", "1", "--out", str(folder / "eva")]
        assert main(["evaluate", POLICY, *WALK, *logs]) == 0
    make_bundle(folder / "toy", make_contract())
    written(folder / "theirs.onnx", network(63, metadata=MJLAB))
    written(folder / "own.yaml", "control_period: 0.02\naction_clip: none\n")
    assert main(["sign", "--new-key", str(folder / "maker.pem")]) == 0
    return folder


NETWORKS: dict[int, bytes] = {}
"""Size of the observation -> the network of the one run that is exported here."""


def network_of_the_run(module: Any, observation_size: int, estimates: bool = False) -> bytes:
    """Convert the network of the run once: seconds in which nothing is written; each bundle is checked against it."""
    if observation_size not in NETWORKS:
        NETWORKS[observation_size] = export_network(module, observation_size, estimates)
    return NETWORKS[observation_size]


def prepare(name: str, inputs: Path, out: Path) -> list[str]:
    """Make the folder that a verb goes on in; return the verb's words."""
    if name == "resume":
        shutil.copytree(inputs / "run", out)
        (out / "summary.json").unlink()
        for file in (out / "checkpoints").glob("student_*"):
            file.unlink()
    elif name in ("sign", "sidecar", "convert", "key"):
        out.mkdir()
        shutil.copytree(inputs / "toy", out / "toy")
        np.savetxt(
            out / "bare.csv",
            np.random.default_rng(0).normal(size=(500, 3)),
            header="time,position,velocity",
            comments="",
        )
    return [word.replace("{in}", str(inputs)).replace("{out}", str(out)) for word in VERBS[name]]


def contents(out: Path) -> dict[str, bytes]:
    """Return what is under its final name in a folder."""
    files = (path for path in out.rglob("*") if path.is_file() and not path.is_symlink())
    return {str(file.relative_to(out)): file.read_bytes() for file in files if not file.name.endswith(".lock")}


def ends_in_one_line(words: list[str], capsys: pytest.CaptureFixture) -> None:
    """Run a verb that cannot write."""
    capsys.readouterr()
    assert main(words) == 1, capsys.readouterr()
    error = capsys.readouterr().err
    last = error.splitlines()[-1]
    verb = " ".join(words[:2]) if words[0] == "study" else words[0]
    assert last.startswith(f"stiction {verb}: "), error
    assert "Traceback" not in error and "unforeseen" not in error, error


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else []) for name in VERBS]
)
def test_no_verb_loses_or_halves_a_file(
    name: str, inputs: Path, tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a disk that has room for small files alone, and where nothing may be written at all."""
    monkeypatch.setenv("STICTION_THREADS", "1")
    monkeypatch.setattr(export, "export_network", network_of_the_run)
    search_little(monkeypatch)
    closed = tmp_path / "closed"
    words = prepare(name, inputs, closed if name in READY else closed / "out")
    closed.mkdir(exist_ok=True)
    before = contents(closed)
    with read_only(closed):
        ends_in_one_line(words, capsys)
    assert contents(closed) == before
    out = tmp_path / "full"
    words = prepare(name, inputs, out)
    before = contents(out) if out.exists() else {}
    room = ROOM.get(name, 300)
    with full(room):
        ends_in_one_line(words, capsys)
    after = contents(out) if out.exists() else {}
    settled = {path for path in after if not path.endswith(GROW) and "tfevents" not in path}
    assert {path: after.get(path) for path in before if path in settled} == {
        path: content for path, content in before.items() if path in settled
    }
    assert before.keys() <= after.keys()
    assert [path for path in settled - before.keys() if len(after[path]) >= room or path.endswith(".part")] == []


READY = ("resume", "sign", "sidecar", "convert", "key")
"""Verbs that go on in a folder that is there."""
