"""Probes of policies without z*: DreamWaQ's code, and the estimates of one without a latent."""

from dataclasses import replace
from pathlib import Path

from rollouts import phase_runner
from stiction.deploy.wear import Moments
from stiction.evaluation.export import contract_of
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.task.config import TaskCfg
from stiction.task.friction import FrictionCfg
from stiction_experiments.adaptation.probes import WalkCfg, inputs, walk_with_friction
from stiction_experiments.methods.dreamwaq import DreamWaQCfg

CFG = TrainCfg(
    task=TaskCfg(robot="go1", friction=FrictionCfg("dreamwaq", level=0.2)),
    network=NetworkCfg(actor=(8,), critic=(8,), history_frame=4, history=(8,)),
    method_settings=DreamWaQCfg(code=4, frame=4, encoder=(8,), decoder=(8,)),
    teacher=TeacherCfg(latent="history", iterations=1, steps=4, mini_batches=2),
    student=StudentCfg(iterations=0),
    num_envs=2,
)


def test_the_code_is_probed_and_no_teacher_is(tmp_path: Path) -> None:
    """A run without friction walks with some: its code and velocity are probed, and no z beside them."""
    actor = phase_runner(CFG, tmp_path).alg.actor
    walk = walk_with_friction(CFG, None, actor, "joint", WalkCfg(robots=4, seconds=1.2, settle=0.1))
    kept = 4 - walk.fallen
    assert walk.latent.shape[1:] == (kept, 4) and walk.explicit.shape[1:] == (kept, 3)
    assert walk.friction.max() > 0 and walk.teacher.shape == (kept, 0)
    contract = contract_of(CFG, {"command": "c", "revision": "r", "identified": None})
    names = [name for name, _, _ in inputs(walk, Moments(contract.observation, contract.scale))]
    assert "latent" in names and "teacher" not in names


def test_a_policy_without_a_latent_is_probed_by_its_estimates(tmp_path: Path) -> None:
    """As the presets of one phase train since: the first input is the estimate, and shuffled it is the control."""
    task = replace(CFG.task, friction=FrictionCfg("deception", level=0.2))
    cfg = replace(CFG, task=task, network=replace(CFG.network, latent=0), method_settings=None)
    actor = phase_runner(cfg, tmp_path).alg.actor
    walk = walk_with_friction(cfg, None, actor, "robot", WalkCfg(robots=4, seconds=1.2, settle=0.1))
    assert walk.latent.shape[-1] == walk.teacher.shape[-1] == 0 < walk.explicit.shape[-1]
    contract = contract_of(cfg, {"command": "c", "revision": "r", "identified": None})
    names = [name for name, _, _ in inputs(walk, Moments(contract.observation, contract.scale))]
    assert names[0] == "explicit" and not {"latent", "teacher"} & {*names}
