"""Teacher and student of a run in the evaluation: the actions of training, and latents of other robots."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.deploy.observation import Sensors
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.files.results import read_results
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.robots.catalog import find_robot
from stiction.task.config import NoiseCfg, RandomizationCfg, TaskCfg
from stiction.task.friction import FrictionCfg

torch = pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to train")
pytest.importorskip("rsl_rl", reason="the package rsl_rl, of the extra 'train', is needed to train")

from stiction.evaluation.export import TrainedPolicy, contract_of  # noqa: E402
from stiction.evaluation.newest import LatentPolicy, observed_friction, privileged_of  # noqa: E402
from stiction.learning.run import RunDirectory  # noqa: E402
from stiction.learning.runner import load_actor, train  # noqa: E402
from stiction.task.env import LocomotionEnv  # noqa: E402  (needs torch)
from stiction.task.randomization import nominal_privileged  # noqa: E402
from stiction_experiments.adaptation import probes  # noqa: E402
from stiction_experiments.lab.trained import (  # noqa: E402
    latent_sources,
    walk_run,
)

NOMINAL = RandomizationCfg(
    armature=(1.0, 1.0),
    damping=(1.0, 1.0),
    ground_friction=(1.0, 1.0),
    payload=(0.0, 0.0),
    push_interval=0.0,
    encoder_offset=(0.0, 0.0),
)
CFG = TrainCfg(
    task=TaskCfg(
        robot="go1",
        friction=FrictionCfg("deception", level=0.2),
        randomization=NOMINAL,
        noise=NoiseCfg(0.0, 0.0, 0.0, 0.0),
        episode=0.6,
    ),
    network=NetworkCfg(actor=(16,), critic=(16,), privileged=(8,), history_frame=4, history=(8,), latent=3),
    teacher=TeacherCfg(iterations=2, steps=8, epochs=1, mini_batches=2),
    student=StudentCfg(iterations=1, steps=8, epochs=1, mini_batches=2),
    num_envs=16,
)
SHORT = EvaluationCfg(friction_levels=(0.0, 0.2), commands=("vx=0.5",), episodes=2, seconds=1.5, settle=0.5)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunDirectory:
    """Return a run of few steps, with weights far from their initial values."""
    directory = RunDirectory.create(tmp_path_factory.mktemp("runs") / "tiny", CFG, "stiction train", None)
    train(CFG, directory)
    return directory


@pytest.mark.parametrize("who", ["teacher", "student"])
def test_the_driver_acts_as_training_does(run: RunDirectory, who: str) -> None:
    """Over resets of the environment, history, o_priv, estimate and latent are those of the training."""
    env = LocomotionEnv(CFG.task, 6, seed=3)
    actor = load_actor(run, who)
    contract = contract_of(run.config(), run.header())
    share = (env.randomizer.draws.friction * 0.2).numpy()
    module = LatentPolicy(actor, nominal_privileged(share) if who == "teacher" else None)
    driver, resets = TrainedPolicy(module, contract, 6), 0
    for _ in range(30):
        fleet = env.fleet
        sensors = Sensors(
            fleet.base_quaternion, fleet.base_angular_velocity, fleet.joint_position, fleet.joint_velocity
        )
        with torch.no_grad():
            actions = actor(env.get_observations())
        np.testing.assert_allclose(driver.step(sensors, env.commands.value.numpy()).action, actions, atol=1e-5)
        _, _, dones, _ = env.step(actions)
        if dones.any():
            share = (env.randomizer.draws.friction * 0.2).numpy()
            module.constant = None if who == "student" else actor.privileged_encoder(nominal_privileged(share)).detach()
        driver.reset(dones.numpy())
        resets += int(dones.sum())
    assert resets >= 6


@pytest.mark.parametrize(("unit", "entry"), [(0.1, 0.2), (0.01, 2.0)])
def test_a_teacher_is_told_friction_in_the_unit_of_its_training(
    run: RunDirectory, unit: float, entry: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """2 % of the limit is 0.2 in units of 10 %, and 2 in units of 1 %."""
    cfg = run.config()
    friction = replace(cfg.task.friction, privileged_unit=unit)
    monkeypatch.setattr(RunDirectory, "config", lambda _: replace(cfg, task=replace(cfg.task, friction=friction)))
    robot = find_robot(cfg.task.robot)
    contract, present = contract_of(cfg, run.header()), np.full((2, robot.num_joints), 0.02)
    observed = privileged_of(run, load_actor(run, "teacher"), contract, robot, present)
    np.testing.assert_allclose(observed[:, -robot.num_joints :], entry, rtol=1e-6)


def test_a_teacher_is_told_what_its_training_varied() -> None:
    """The friction in o_priv stays at 0 for `none` and at 0.1 for a constant 0.1, and is the true one otherwise."""
    present, nominal = np.array([[0.0, 0.0], [0.3, 0.3]]), np.array([0.1, 0.1])
    assert observed_friction(FrictionCfg("none", 0.1), nominal, present).tolist() == [[0.0, 0.0], [0.0, 0.0]]
    assert (
        observed_friction(FrictionCfg("direct", 0.1, range=(1.0, 1.0)), nominal, present).tolist() == [[0.1, 0.1]] * 2
    )
    for method in ("direct", "finetune"):
        assert observed_friction(FrictionCfg(method, 0.1), nominal, present).tolist() == [[0.0, 0.0], [0.3, 0.3]]


def test_peers_share_the_teachers_latent_and_other_levels_do_not(run: RunDirectory) -> None:
    """The latent z depends on o_priv alone: exchanging it among robots of one level changes nothing."""
    unchanged, peer, swapped = (
        walk_run(run.path, "teacher", SHORT, latent).rows for latent in ("own", "peer", "swapped")
    )
    jitter = [[row.joint_jitter for row in rows] for rows in (unchanged, peer, swapped)]
    assert jitter[1] == pytest.approx(jitter[0], rel=1e-4)
    assert jitter[2] != pytest.approx(jitter[0], rel=1e-3)


def test_latent_sources_by_hand() -> None:
    """Levels a, b, c; commands +, -; episodes 0, 1: a+0 a+1 a-0 a-1 b+0 b+1 b-0 b-1 c+0 c+1 c-0 c-1."""
    assert latent_sources("swapped", 3, 2, 2).tolist() == [4, 5, 6, 7, 8, 9, 10, 11, 0, 1, 2, 3]
    assert latent_sources("peer", 3, 2, 2).tolist() == [1, 0, 3, 2, 5, 4, 7, 6, 9, 8, 11, 10]
    assert latent_sources("swapped", 4, 1, 1).tolist() == [2, 3, 0, 1]
    assert latent_sources("own", 2, 1, 2).tolist() == [0, 1, 2, 3]
    for latent, shape in (("swapped", (1, 2, 3)), ("peer", (3, 2, 1))):
        with pytest.raises(StictionError, match="two"):
            latent_sources(latent, *shape)


def test_latents_are_lent_and_frozen(run: RunDirectory) -> None:
    """The actor acts on another robot's latent with its own observation."""
    actor = load_actor(run, "student")
    observation = torch.randn(2, 11 * actor.adaptation.frame, generator=torch.Generator().manual_seed(0))
    seen: list[torch.Tensor] = []
    with torch.no_grad():
        latent = actor.adaptation(observation)
        lent = LatentPolicy(actor, sources=torch.tensor([1, 0]), watch=seen.append)(observation)
        frozen = LatentPolicy(actor, frozen=latent[1])(observation)
        swapped, expected = lent, LatentPolicy(actor).policy.act(observation, latent.flip(0))
    torch.testing.assert_close(swapped, expected)
    torch.testing.assert_close(seen[0], latent)
    torch.testing.assert_close(frozen[0], lent[0])
    assert not torch.allclose(frozen[1], lent[1])


def test_a_history_of_another_length_reaches_networks_contract_and_driver(tmp_path: Path) -> None:
    """Networks, contract and driver use the history length of the run's configuration."""
    cfg = replace(CFG, task=replace(CFG.task, history=4))
    directory = RunDirectory.create(tmp_path / "short", cfg, "stiction train", None)
    train(cfg, directory)
    contract = contract_of(directory.config(), directory.header())
    assert contract.observation.history_length == 4
    assert load_actor(directory, "student").adaptation.mlp[0].in_features == 4 * 4
    assert len(walk_run(directory.path, "student", SHORT).rows) == 2
    with pytest.raises(StictionError, match="history of 0 frames"):
        TaskCfg(history=0)


@pytest.mark.usefixtures("undrawn")
def test_one_command_studies_what_adaptation_does(run: RunDirectory, tmp_path: Path, monkeypatch, capsys) -> None:
    """The whole command: walks on lent latents, probes, page. Rejects two runs of one name."""
    monkeypatch.setattr(probes, "HISTORIES", (11,))  # A probe of two thousand features takes seconds.
    out = tmp_path / "study"
    walks = ["--friction-levels", "0", "0.2", "--commands", "vx=0.5", "--episodes", "4", "--seconds", "4"]
    arguments = ["study", "adaptation", str(run.path), "--out", str(out)]
    assert main([*arguments, *walks, "--robots", "32", "--walk-seconds", "12.5", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary == json.loads((out / "summary.json").read_text()) and set(summary["runs"]) == {"tiny"}
    rows = read_results(out / "results.csv")
    assert {row.friction_level for row in rows} == {0.0, 0.2} and len({row.policy for row in rows}) >= 3
    assert (out / "report.html").read_text().count("<figure") == 2
    assert main([*arguments[:2], str(tmp_path / "tiny"), *arguments[2:], "--overwrite"]) == 1
    assert "two runs are called 'tiny'" in capsys.readouterr().err


def test_a_student_is_told_the_friction_of_each_robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the option of the task through networks and driver: robots at 0 and 20 % observe 0 and 20 %."""
    cfg = replace(CFG, task=replace(CFG.task, known_friction=True))
    directory = RunDirectory.create(tmp_path / "told", cfg, "stiction train", None)
    train(cfg, directory)
    seen: dict[str, list[np.ndarray]] = {"true": [], "contract": []}
    for text, frames in seen.items():

        def watch(policy: LatentPolicy, observation: torch.Tensor, frames=frames) -> tuple[torch.Tensor, torch.Tensor]:
            frames.append(observation[:, -3:].numpy())
            return policy.policy.with_velocity(observation)

        monkeypatch.setattr(LatentPolicy, "with_velocity", watch)
        rows = list(walk_run(directory.path, "student", replace(SHORT, known_friction=text)).rows)
        assert {row.method for row in rows} == {"told"}
    np.testing.assert_allclose(seen["true"][-1], [[0.0] * 3] * 2 + [[1.0] * 3] * 2, atol=1e-6)
    np.testing.assert_allclose(seen["contract"][-1], [[1.0] * 3] * 4, atol=1e-6)
