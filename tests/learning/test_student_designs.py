"""Each design of a student: where its latent comes from, what trains it, and how much noise it explores with."""

from dataclasses import replace

import pytest
import torch

from rollouts import check_ratio, phase_runner, rollout
from stiction.core.errors import ConfigurationError, StictionError
from stiction.learning.arguments import parse
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.learning.phase import PhaseRunner
from stiction.task.config import TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg
from stiction.task.terrain import TerrainCfg

TASK = TaskCfg(friction=FrictionCfg(method="deception", level=0.2))
ONE_PHASE = TrainCfg(
    task=TASK,
    num_envs=8,
    teacher=TeacherCfg(latent="history", iterations=2, steps=4, final_std=0.4),
    student=StudentCfg(iterations=0),
)
GROUPS = replace(ONE_PHASE, teacher=TeacherCfg(latent="groups", iterations=2, steps=4))
IN_TURN = replace(ONE_PHASE, teacher=TeacherCfg(alternate=2, iterations=2, steps=4), student=StudentCfg(iterations=1))


@pytest.fixture(scope="module")
def env() -> LocomotionEnv:
    """Eight robots."""
    return LocomotionEnv(TASK, 8, 0)


def runner_of(cfg: TrainCfg, env: LocomotionEnv, tmp_path, name: str = "teacher") -> PhaseRunner:
    """A runner of one phase."""
    return phase_runner(cfg, tmp_path, name, env)


@pytest.mark.parametrize("cfg", [ONE_PHASE, GROUPS, IN_TURN], ids=["history", "groups", "alternate"])
def test_the_ratio_is_one_before_the_first_step(cfg: TrainCfg, env: LocomotionEnv, tmp_path) -> None:
    """In later iterations too, after the networks that PPO holds fixed and the noise's bound have changed."""
    runner = runner_of(cfg, env, tmp_path)
    for _ in range(2):
        rollout(runner)
        check_ratio(runner)
        runner.alg.update()


def test_in_groups_only_the_marked_robots_walk_blind(env: LocomotionEnv, tmp_path) -> None:
    """A changed privileged observation changes what the teachers do, and nothing that a student does."""
    runner, obs = runner_of(GROUPS, env, tmp_path), env.get_observations()
    obs = obs.clone().update(runner.alg.fixed)
    blind = obs["walks_blind"].flatten() > 0
    other = obs.clone()
    other["privileged"] = other["privileged"] + 1.0
    changed = (runner.alg.actor(obs) != runner.alg.actor(other)).any(-1)
    assert blind.sum() == 2
    assert torch.equal(changed, ~blind)


def test_one_phase_trains_the_adaptation_by_reward_and_the_estimator_by_supervision(
    env: LocomotionEnv, tmp_path, monkeypatch
) -> None:
    """PPO reaches f_ada and never f_est; the supervised pass f_est alone; nobody the privileged encoder."""
    runner = runner_of(ONE_PHASE, env, tmp_path)
    actor = runner.alg.actor
    parts = {name: getattr(actor, name) for name in ("adaptation", "estimator", "privileged_encoder", "mlp")}

    def copies() -> dict[str, list[torch.Tensor]]:
        return {name: [p.detach().clone() for p in part.parameters()] for name, part in parts.items()}

    def moved(before: dict[str, list[torch.Tensor]]) -> set[str]:
        now = copies()
        return {name for name in parts if any(not torch.equal(a, b) for a, b in zip(before[name], now[name]))}

    rollout(runner)
    before = copies()
    monkeypatch.setattr(type(runner.alg), "_supervise", lambda self: {})
    runner.alg.update()
    assert moved(before) == {"adaptation", "mlp"}
    monkeypatch.undo()
    before = copies()
    runner.alg._supervise()
    assert moved(before) == {"estimator"}


@pytest.mark.parametrize("both_ways", [True, False])
def test_the_adaptation_loss_reaches_z_only_both_ways(both_ways: bool, env: LocomotionEnv, tmp_path) -> None:
    """The paper trains both networks by L_ada; z held fixed is what public code does."""
    runner = runner_of(replace(IN_TURN, teacher=replace(IN_TURN.teacher, both_ways=both_ways)), env, tmp_path)
    rollout(runner)
    before = [p.detach().clone() for p in runner.alg.actor.privileged_encoder.parameters()]
    runner.alg._supervise()
    after = runner.alg.actor.privileged_encoder.parameters()
    assert any(not torch.equal(a, b) for a, b in zip(before, after)) == both_ways


def test_the_noise_falls_on_a_straight_line(env: LocomotionEnv, tmp_path) -> None:
    """From 0.8 to 0.4 in three iterations of four: 0.8, 0.6, 0.4, and no less in the last."""
    cfg = replace(ONE_PHASE, teacher=replace(ONE_PHASE.teacher, iterations=4))
    runner, seen = runner_of(cfg, env, tmp_path), []
    for _ in range(4):
        rollout(runner)
        seen.append(float(runner.alg.storage.distribution_params[1].max()))
        runner.alg.update()
    assert seen[0] == pytest.approx(0.8)
    assert all(a <= b + 1e-6 for a, b in zip(seen, [0.8, 0.6, 0.4, 0.4]))
    assert runner.alg.actor.distribution.std_range[1] == pytest.approx(0.4)


def test_ppo_goes_on_from_the_teacher_on_the_students_own_latent(env: LocomotionEnv, tmp_path) -> None:
    """Warm start of actor and critic; what is walked on is z*, and PPO trains its encoder."""
    cfg = replace(IN_TURN, student=StudentCfg(algorithm="ppo", iterations=1, steps=4))
    teacher, student = runner_of(cfg, env, tmp_path), runner_of(cfg, env, tmp_path, "student")
    student.alg.warm_start(teacher.alg.actor.state_dict(), teacher.alg.critic.state_dict())
    obs = env.get_observations()
    teacher.alg.actor.latent_source = "history"
    torch.testing.assert_close(student.alg.actor(obs), teacher.alg.actor(obs))
    torch.testing.assert_close(student.alg.critic(obs), teacher.alg.critic(obs))
    before = [p.detach().clone() for p in student.alg.actor.adaptation.parameters()]
    rollout(student)
    student.alg.update()
    assert any(not torch.equal(a, b) for a, b in zip(before, student.alg.actor.adaptation.parameters()))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"student": StudentCfg(iterations=5)}, "no teacher to distil"),
        ({"teacher": TeacherCfg(latent="history", both_ways=True)}, "both_ways"),
        ({"teacher": TeacherCfg(latent="groups", student_share=1.0)}, "student_share"),
        ({"teacher": TeacherCfg(latent="history", final_std=0.0)}, "final_std"),
        ({"teacher": TeacherCfg(latent="history", velocity_weight=0.0)}, "velocity_weight"),
        ({"student": StudentCfg(iterations=-1)}, "student.iterations"),
        ({"teacher": TeacherCfg(latent="history", final_std=1.0)}, "noise"),
        ({"teacher": TeacherCfg(), "network": NetworkCfg(latent=0)}, "network.latent is 0"),
        ({"task": replace(TASK, terrain=TerrainCfg(kind="stairs"))}, "encoder of the ground"),
    ],
)
def test_phases_that_nobody_could_mean_are_refused(change: dict, named: str) -> None:
    """Before any folder is made."""
    with pytest.raises(StictionError, match=named):
        replace(ONE_PHASE, **change)


@pytest.mark.parametrize(
    ("words", "option"),
    [
        ("--student.algorithm ppo --student.noise half", "--student.noise"),
        ("--student.algorithm ppo --set student.epochs=3", "--set student.epochs"),
        ("--set teacher.student_share=0.5", "--set teacher.student_share"),
        ("--teacher.latent groups --set teacher.student_share=0.5", ""),
        ("--student.noise half --set student.epochs=3", ""),
        ("--student.algorithm ppo --student.noise all --set student.epochs=2 --set teacher.student_share=0.25", ""),
    ],
)
def test_a_setting_without_effect_is_refused(words: str, option: str) -> None:
    """Two runs that differ in it would be compared, and are the same run."""
    arguments = ["--preset", "two-phase", *words.split()]
    if not option:
        parse(arguments)
        return
    with pytest.raises(ConfigurationError, match=f"^{option} requires "):
        parse(arguments)


def test_friction_is_estimated_beside_velocity_and_contacts() -> None:
    """Means over hips, thighs and shanks of f/tau_max, in tenths, behind the nine entries of old."""
    task = replace(TASK, estimated_friction=True)
    env = LocomotionEnv(task, 4, 0)
    explicit = env.get_observations()["explicit"]
    share = env.randomizer.friction_share().view(4, 6, 3).mean(1)
    torch.testing.assert_close(explicit[:, 9:], share / 0.1)
