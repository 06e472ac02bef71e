"""H∞ as a method of the trainer: its runs, resumed and exported, its options and what they refuse, its name."""

from __future__ import annotations

import contextlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from stiction.core.errors import ConfigurationError, StictionError
from stiction.deploy.policy import Network
from stiction.evaluation.export import contract_of, export_run
from stiction.evaluation.policies import method_of, method_texts
from stiction.learning.arguments import parse
from stiction.learning.begin import begin_run, why_task_on_host
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.learning.run import Interrupted, RunDirectory, latest_checkpoint, load_checkpoint, save_checkpoint
from stiction.learning.runner import load_student, train
from stiction.task.config import TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg
from stiction.view.simulation import plain_name
from stiction_experiments.methods.hinf import HinfCfg

CFG = TrainCfg(
    task=TaskCfg(
        robot="go1", episode=0.2, friction=FrictionCfg("hinf", level=0.2, range=(0.0, 1.2)), estimated_friction=True
    ),
    network=NetworkCfg(actor=(16, 8), critic=(16,), history_frame=4, history=(8,), estimator_frame=4, estimator=(8,)),
    teacher=TeacherCfg(latent="history", iterations=4, steps=4, epochs=2, mini_batches=2),
    student=StudentCfg(iterations=0),
    method_settings=HinfCfg(disturber="friction", actor=(8,), critic=(8,), curriculum=0.5),
    num_envs=8,
)
HEADER = {"command": "stiction train", "revision": "abc1234", "identified": None}
CLOCKED = ("seconds", "rollout_seconds", "env_steps_per_second")


@pytest.fixture(autouse=True)
def one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bits depend on the number of threads."""
    monkeypatch.setenv("STICTION_THREADS", "1")


def start(folder: Path, cfg: TrainCfg) -> RunDirectory:
    """A new run."""
    return RunDirectory.create(folder, cfg, "stiction train --method hinf", None)


def equal(one: object, other: object) -> bool:
    """Return whether two trees of tensors and numbers are the same, bit for bit."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(equal(value, other[name]) for name, value in one.items())
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(equal, one, other))
    return torch.equal(one, other) if isinstance(one, torch.Tensor) else one == other


def rows_of(run: RunDirectory) -> list[dict]:
    """Every figure that does not depend on the clock."""
    return [{name: value for name, value in row.items() if name not in CLOCKED} for row in run.rows()]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> RunDirectory:
    """A run of the friction adversary that nobody interrupted, in which episodes end."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STICTION_THREADS", "1")
        run = start(tmp_path_factory.mktemp("whole") / "run", CFG)
        train(CFG, run)
    return run


def test_a_run_that_is_stopped_everywhere_is_the_same_run(tmp_path: Path, whole: RunDirectory) -> None:
    """Policy, disturber, its critic, optimizer and draws, λ and η survive a resume: bit for bit."""
    cut = start(tmp_path / "run", CFG)
    while not cut.finished:
        with contextlib.suppress(Interrupted):
            train(CFG, cut, interrupted=lambda: True)
    kept = [load_checkpoint(latest_checkpoint(run.checkpoints, "teacher"))["algorithm"] for run in (whole, cut)]
    assert {"lambda", "eta", "network", "optimizer", "generator"} <= kept[0]["hinf"].keys()
    assert equal(*kept) and rows_of(cut) == rows_of(whole)


@pytest.mark.parametrize("part", ["network", "optimizer", "eta"])
def test_a_checkpoint_without_its_disturber_is_refused(part: str, tmp_path: Path, whole: RunDirectory) -> None:
    """In one line: to begin the disturber anew would be another training."""
    cut = start(tmp_path / "run", CFG)
    with pytest.raises(Interrupted, match="of the policy, nothing is lost"):
        train(CFG, cut, interrupted=lambda: True)
    newest = latest_checkpoint(cut.checkpoints, "teacher")
    tree = load_checkpoint(newest)
    del tree["algorithm"]["hinf"][part]
    save_checkpoint(newest, tree)
    with pytest.raises(StictionError, match="cannot be restored"):
        train(CFG, cut)


def test_what_a_run_says_of_its_disturber(whole: RunDirectory) -> None:
    """λ, η, constraint, cost, intensity, limit: in every row, finite; the curriculum ends at the whole limit."""
    names = {f"hinf/{name}" for name in ("lambda", "eta", "constraint", "cost", "intensity", "limit", "std")}
    names |= {"loss/disturber", "loss/disturber_value"}
    for row in whole.rows():
        assert names <= row.keys() and all(np.isfinite(row[name]) for name in names)
        assert row["hinf/cost"] >= 0.0 and 0.0 < row["hinf/intensity"] <= 1.0
    assert [row["hinf/limit"] for row in whole.rows()] == [0.5, 1.0, 1.0, 1.0]


def test_what_is_exported_is_the_actor_alone(tmp_path: Path, whole: RunDirectory) -> None:
    """The ordinary policy, to 1e-6, and nothing of whom it was trained beside."""
    check = export_run(whole.path, tmp_path / "bundle")
    contract = check.bundle.contract
    assert check.action_error < 1e-6 and (contract.method, contract.phases) == ("hinf", 1)
    student, env = load_student(whole), LocomotionEnv(CFG.task, 16, 3)
    history = env.step(torch.randn(16, 12))[0]["history"]
    acted = Network(check.bundle.policy, contract.observation.size, 12, estimates=True)(history.numpy())
    np.testing.assert_allclose(acted, student(history).detach().numpy(), atol=1e-6, rtol=1e-6)
    assert not any("disturb" in name for name in student.state_dict())


def test_its_name_says_whether_it_met_friction() -> None:
    """And who disturbed: no two trainings that are compared are taken for seeds of one method."""
    frictionless = replace(CFG.task, friction=FrictionCfg("hinf", level=0.2))
    plain = replace(CFG, task=frictionless, method_settings=HinfCfg())
    contracts = [contract_of(cfg, HEADER) for cfg in (plain, CFG)]
    assert [(one.disturber, method_of(one)) for one in contracts] == [("force", "hinf"), ("friction", "hinf-joints")]
    names = {"force": "hinf-friction", "random": "hinf-random-friction", "random-friction": "hinf-random-joints"}
    for kind, name in names.items():
        method = method_of(contract_of(replace(CFG, method_settings=HinfCfg(disturber=kind)), HEADER))
        assert method == name and method in method_texts()
    for hinf in (HinfCfg(disturber="none"), HinfCfg(limit=0.0)):
        nobody = contract_of(replace(plain, method_settings=hinf), HEADER)
        assert nobody.disturber is None and method_of(nobody) == "hinf-nobody"
    deception = replace(CFG.task, friction=FrictionCfg("deception", level=0.2))
    assert contract_of(replace(CFG, task=deception, method_settings=None), HEADER).disturber is None
    with pytest.raises(ConfigurationError, match="got HinfCfg, expected None"):
        replace(CFG, task=deception)
    assert [plain_name(contract) for contract in contracts] == [
        "hinf: trained without friction",
        "hinf: trained at 0 to 24 % friction",
    ]


def test_the_method_alone_makes_a_run(tmp_path: Path) -> None:
    """`--method hinf` is all that has to be said; its own flags are those of the configuration."""
    cfg = parse(["--method", "hinf", "--friction-level", "0.2", "--preset", "quick"]).config
    assert (
        cfg.method.name == "hinf"
        and cfg.method_settings == HinfCfg()
        and cfg.method_settings.share == 0.5
        and cfg.teacher.iterations == 440
    )
    notes: list[str] = []
    begin_run(tmp_path / "run", replace(cfg, num_envs=8), "stiction train", (), notes.append)
    assert notes[0] == "hinf trains without dry friction; with: --task.friction.range 0 1.2"
    assert notes[1].startswith("hinf pushes with half of the weight from the first iteration on") and len(notes) == 2
    for kind, curriculum in (("force", 0.5), ("friction", 0.0), ("none", 0.0)):
        quiet: list[str] = []
        hinf = HinfCfg(disturber=kind, curriculum=curriculum)
        frictional = replace(cfg.task, friction=replace(cfg.task.friction, range=(0.0, 1.2)))
        begin_run(
            tmp_path / kind, replace(cfg, num_envs=8, task=frictional, method_settings=hinf), "train", (), quiet.append
        )
        assert not quiet, kind
    words = (
        "--method hinf --friction-level 0.2 --task.friction.range 0 1.2 --set hinf.disturber=friction --set hinf.eta=0"
    )
    adversary = parse(words.split()).config.method_settings
    assert adversary.learns and adversary.by_torque and adversary.share == 1.0 and adversary.eta == 0.0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--method hinf --preset two-phase", "'hinf' learns in one phase.*--preset full or quick"),
        ("--method hinf --student.iterations 5", "learns in one phase"),
        ("--method hinf --terrain stairs", "on flat ground alone, not on 'stairs'"),
        ("--method deception --set hinf.eta=1", "--set hinf.eta requires --method hinf"),
        ("--method hinf --set hinf.limit=0.6", "of up to 0.6: expected a share of the robot's weight from 0 to 0.5"),
        ("--method hinf --set hinf.disturber=friction", "bounded by the joints' friction, and there is none"),
        (
            "--method hinf --set hinf.disturber=none --set hinf.eta=1",
            "--set hinf.eta requires a --set hinf.disturber with a limit",
        ),
        ("--method hinf --set hinf.disturber=none --set hinf.limit=0.1", "hinf.limit requires a --set hinf.disturber"),
        ("--method hinf --set hinf.limit=0 --set hinf.curriculum=0.5", "hinf.curriculum requires a --set hinf.dist"),
        ("--method hinf --set hinf.disturber=random --set hinf.eta=1", "hinf.eta requires --set hinf.disturber=force"),
        ("--method hinf --set hinf.hold=1", "--set hinf.hold requires --set hinf.disturber=random"),
        ("--method hinf --set hinf.eta=0 --set hinf.tightening=0.9", "hinf.tightening requires --set hinf.eta above"),
        ("--method hinf --set hinf.tightening=0", "hinf.tightening is 0.0; expected more than 0 and at most 1"),
        ("--method hinf --set hinf.eta=-1", "hinf.eta is -1.0; expected 0 to 1000"),
        ("--method hinf --set hinf.actor=[0]", r"hinf.actor\[0\] is 0; expected at least 1"),
    ],
)
def test_options_that_contradict_the_method_are_refused(words: str, message: str) -> None:
    """In one line, before any folder is made."""
    with pytest.raises(ConfigurationError, match=message) as caught:
        parse(words.split())
    assert "\n" not in str(caught.value)


def test_who_disturbs_keeps_the_task_on_the_host() -> None:
    """A fleet on a device has nobody who pushes: the run would be another one, without a word."""
    task = replace(CFG.task, friction=FrictionCfg("hinf", level=0.2, range=(0.0, 1.2)))
    assert why_task_on_host(replace(CFG, task=task, device="warp-cpu")) == "the method 'hinf'"


def test_settings_of_older_runs_are_read(tmp_path: Path) -> None:
    """Reads a config.json from before methods were installed, and checks its values."""
    run = start(tmp_path / "run", CFG)
    file = run.path / "config.json"
    header = json.loads(file.read_text())
    header["config"]["hinf"] = header["config"].pop("method_settings") | {"eta": 1.5}
    file.write_text(json.dumps(header))
    assert run.config().method_settings == replace(CFG.method_settings, eta=1.5)
    header["config"]["method_settings"] = header["config"]["hinf"] | {"eta": "much"}
    file.write_text(json.dumps(header))
    with pytest.raises(StictionError, match=r"config\.json: hinf: eta is much; expected a finite number"):
        run.config()
