"""Mirrored samples in training: what is in a mini-batch, its labels, and one worn joint that stays one."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from tensordict import TensorDict

from rollouts import phase_runner
from stiction.core.errors import StictionError
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.learning.phase import PhaseRunner
from stiction.task.config import TaskCfg
from stiction.task.friction import FrictionCfg
from stiction.task.symmetry import task_mirror

CFG = TrainCfg(
    task=TaskCfg(robot="go1", friction=FrictionCfg("deception", level=0.2, per="joint")),
    network=NetworkCfg(actor=(16,), critic=(16,), privileged=(8,), history_frame=4, history=(8,), latent=4),
    teacher=TeacherCfg(iterations=4, steps=4, epochs=2, mini_batches=2, alternate=2),
    student=StudentCfg(iterations=2, steps=4, epochs=1, mini_batches=2),
    num_envs=8,
)


def phase(tmp_path: Path, symmetry: str, name: str = "teacher", cfg: TrainCfg = CFG) -> PhaseRunner:
    """A runner of one phase of a run with a symmetry."""
    return phase_runner(replace(cfg, symmetry=symmetry), tmp_path, name)


def seen_by(runner: PhaseRunner, monkeypatch: pytest.MonkeyPatch, losses: str) -> list[TensorDict]:
    """Collect a rollout and update; return the mini-batches that one of the losses saw."""
    batches: list[TensorDict] = []
    actor = runner.alg.get_policy()
    method = getattr(actor, losses)

    def watch(obs: TensorDict, *args: object, **kwargs: object) -> object:
        if torch.is_grad_enabled():
            batches.append(obs.clone())
        return method(obs, *args, **kwargs)

    monkeypatch.setattr(actor, losses, watch)
    runner.iterate()
    monkeypatch.undo()
    return batches


def same(a: TensorDict, b: TensorDict) -> bool:
    """Say whether two sets of observations are equal but for rounding."""
    return all(torch.allclose(a[name], b[name], atol=1e-6) for name in a.keys())  # noqa: SIM118 (a TensorDict iterates over rows)


@pytest.mark.parametrize(("symmetry", "steps", "originals"), [("none", 4, 16), ("batches", 4, 16), ("half", 4, 8)])
def test_ppo_sees_every_original_and_its_image(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, symmetry: str, steps: int, originals: int
) -> None:
    """32 samples, two passes of two steps: `batches` doubles each step, `half` has as many samples as `none`."""
    runner = phase(tmp_path, symmetry)
    batches = seen_by(runner, monkeypatch, "get_latent")
    assert len(batches) == steps
    mirror = task_mirror(runner.env)
    for batch in batches:
        if symmetry == "none":
            assert len(batch) == originals
        else:
            assert len(batch) == 2 * originals
            task, estimate = batch.select(*runner.env.get_observations().keys()), batch["estimate"]
            assert same(mirror(task[:originals]), task[originals:])
            assert not same(task[:originals], task[originals:])
            assert not torch.allclose(estimate[:originals], estimate[originals:])


@pytest.mark.parametrize("latent", ["alternate", "history", "groups"])
def test_what_a_walk_remembers_is_found_for_the_image(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, latent: str
) -> None:
    """The estimate and z* of an image are those of the mirrored history; who walks blind stays the same robot."""
    cfg = replace(CFG, teacher=replace(CFG.teacher, latent=latent), student=replace(CFG.student, algorithm="ppo"))
    runner = phase(tmp_path, "batches", cfg=cfg)
    actor = runner.alg.actor
    before = {name: copy.deepcopy(getattr(actor, name)) for name in ("estimator", "adaptation")}
    for batch in seen_by(runner, monkeypatch, "get_latent"):
        original, image = batch[:16], batch[16:]
        for name, network in (("estimate", "estimator"), ("guess", "adaptation")):
            if name in batch.keys() and (name, latent) != ("guess", "alternate"):  # noqa: SIM118
                torch.testing.assert_close(image[name], before[network](image["history"]), atol=1e-5, rtol=0)
        if latent == "groups":
            assert torch.equal(image["walks_blind"], original["walks_blind"]) and image["walks_blind"].any()


@pytest.mark.parametrize("name", ["teacher", "student"])
@pytest.mark.parametrize(("symmetry", "size", "images"), [("none", 8, 0), ("batches", 16, 8), ("half", 8, 4)])
def test_supervised_losses_see_images(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, symmetry: str, size: int, images: int
) -> None:
    """Every group of a sample is mirrored together: an image with the original's latent would teach nonsense."""
    cfg = replace(CFG, teacher=replace(CFG.teacher, adaptation_batches=4), student=replace(CFG.student, mini_batches=4))
    runner = phase(tmp_path, symmetry, name, cfg)
    if name == "student":
        runner.alg.warm_start(runner.alg.student.state_dict(), {})
    batches = seen_by(runner, monkeypatch, "supervised_losses")
    assert [len(batch) for batch in batches] == [size] * 4
    mirror = task_mirror(runner.env)
    originals = runner.alg.storage.observations.flatten(0, 1)

    def among(sample: TensorDict) -> bool:
        return any(same(sample, other) for other in originals)

    for batch in batches:
        assert all(among(mirror(sample)) for sample in batch[:images])
        assert not any(among(sample) for sample in batch[:images])
        assert all(among(sample) for sample in batch[images:])


@pytest.mark.parametrize("symmetry", ["batches", "half"])
def test_the_students_labels_are_mirrored(tmp_path: Path, symmetry: str) -> None:
    """A mirrored observation with the original's action would teach the left leg what the right one did."""
    runner = phase(tmp_path, symmetry, "student")
    obs = runner.env.get_observations()
    labels = torch.randn(len(obs), 12)
    batch, wanted = runner.alg.symmetry.supervised(obs, labels)
    images = {"batches": 8, "half": 4}[symmetry]
    mirror = task_mirror(runner.env)
    assert same(batch[:images], mirror(obs[:images]))
    assert torch.equal(wanted[:images], mirror.action(labels[:images]))
    rest = slice(4 if symmetry == "half" else 0, None)
    assert same(batch[images:], obs[rest]) and torch.equal(wanted[images:], labels[rest])


def test_the_log_tells_how_far_from_symmetric_the_policy_is(tmp_path: Path) -> None:
    """MSE(π(M o), M π(o)): of constant actions 1 on left legs and 0 on right ones it is 1 by hand."""
    runner = phase(tmp_path, "batches")
    last = runner.alg.actor.mlp[-1]
    with torch.no_grad():
        last.weight.zero_()
        last.bias.copy_(torch.tensor([1.0, 1, 1, 0, 0, 0, 1, 1, 1, 0, 0, 0]))
        obs = runner.env.get_observations()
        both = torch.cat([obs, runner.alg.symmetry.mirror(obs)])
        runner.alg.actor(both, stochastic_output=True)
        loss = runner.alg.symmetry.compute_loss(runner.alg.actor, None, 8)
    assert float(loss) == pytest.approx(1.0)


@pytest.mark.parametrize("symmetry", ["batches", "half"])
def test_training_makes_the_policy_symmetric(tmp_path: Path, symmetry: str) -> None:
    """A student that is taught by a symmetric teacher becomes symmetric itself, a lopsided one though it was."""
    cfg = replace(CFG, student=replace(CFG.student, learning_rate=5e-3), num_envs=32)
    runner = phase(tmp_path, symmetry, "student", cfg)
    student = runner.alg.student
    with torch.no_grad():
        student.mlp[-1].bias.copy_(torch.tensor([1.0, 1, 1, -1, -1, -1, 1, 1, 1, -1, -1, -1]))
        for parameter in runner.alg.teacher.mlp[-1].parameters():
            parameter.zero_()
    runner.alg.teacher_loaded = True

    def asymmetry() -> float:
        obs, mirror = runner.env.get_observations(), task_mirror(runner.env)
        with torch.no_grad():
            return float((student(mirror(obs)) - mirror.action(student(obs))).square().mean())

    before = asymmetry()
    for _ in range(15):
        runner.iterate()
    assert asymmetry() < 0.05 * before


def test_half_needs_passes_to_halve() -> None:
    """One and a half passes are none."""
    with pytest.raises(StictionError, match="half of 3 passes"):
        replace(CFG, symmetry="half", teacher=replace(CFG.teacher, epochs=3))
    with pytest.raises(StictionError, match="unknown symmetry 'both'; known: none, batches, half, network"):
        replace(CFG, symmetry="both")
