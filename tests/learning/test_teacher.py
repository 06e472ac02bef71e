"""The teacher: who trains what, the ratio before the first step, the alternating latent."""

from dataclasses import replace

import pytest
import torch

from rollouts import phase_runner, rollout
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.learning.models import StudentPolicy
from stiction.learning.phase import PhaseRunner
from stiction.task.config import TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg

CFG = TrainCfg(
    task=TaskCfg(robot="go1", friction=FrictionCfg("deception", level=0.2)),
    network=NetworkCfg(actor=(16,), critic=(16,), privileged=(8,), history_frame=4, history=(8,), latent=3),
    teacher=TeacherCfg(iterations=4, steps=4, epochs=2, mini_batches=2, alternate=2),
    student=StudentCfg(iterations=2, steps=4, epochs=1, mini_batches=2),
    num_envs=8,
)


@pytest.fixture
def env() -> LocomotionEnv:
    """Eight small robots."""
    torch.manual_seed(0)
    return LocomotionEnv(CFG.task, CFG.num_envs, seed=0)


def phase(env: LocomotionEnv, tmp_path, name: str = "teacher", cfg: TrainCfg = CFG) -> PhaseRunner:
    """A runner of one phase."""
    return phase_runner(cfg, tmp_path, name, env)


def test_ppo_and_the_supervised_losses_train_different_parameters(env: LocomotionEnv, tmp_path, monkeypatch) -> None:
    """PPO must not reach f_est and f_ada_stu, nor L_ada and L_est the policy and z."""
    runner = phase(env, tmp_path)
    actor = runner.alg.actor
    supervised, policy = actor.supervised_parameters(), actor.policy_parameters()
    assert len(supervised) + len(policy) == len(list(actor.parameters()))

    def copies(parameters: list) -> list:
        return [p.detach().clone() for p in parameters]

    rollout(runner)
    before, before_policy = copies(supervised), copies(policy)
    monkeypatch.setattr(type(runner.alg), "_supervise", lambda self: {})
    runner.alg.update()
    assert all(torch.equal(a, b) for a, b in zip(before, supervised, strict=True))
    assert not all(torch.equal(a, b) for a, b in zip(before_policy, policy, strict=True))
    monkeypatch.undo()
    before_policy = copies(policy)
    runner.alg._supervise()
    assert all(torch.equal(a, b) for a, b in zip(before_policy, policy, strict=True))
    assert not all(torch.equal(a, b) for a, b in zip(before, supervised, strict=True))


def test_supervised_losses_by_hand(env: LocomotionEnv, tmp_path) -> None:
    """L_ada = MSE(z, z*), L_est = MSE(o_exp, o_exp*), means over robots and entries."""
    actor, obs = phase(env, tmp_path).alg.actor, env.get_observations()
    z, star = actor.privileged_encoder(obs["privileged"]), actor.adaptation(obs["history"])
    torch.testing.assert_close(actor.supervised_losses(obs)["adaptation"], ((z - star) ** 2).sum() / z.numel())
    guess = actor.estimator(obs["history"])
    torch.testing.assert_close(
        actor.supervised_losses(obs)["estimator"], ((guess - obs["explicit"]) ** 2).sum() / guess.numel()
    )


def test_the_adaptation_loss_both_ways_by_hand(env: LocomotionEnv, tmp_path) -> None:
    """L_ada of z = 1 and z* = 3, three entries, is 4; its gradient is 4/3 at each z*, and -4/3 or none at each z."""
    actor, obs = phase(env, tmp_path).alg.actor, env.get_observations()
    encoders = {1.0: actor.privileged_encoder, 3.0: actor.adaptation}
    for value, encoder in encoders.items():
        for parameter in encoder.parameters():
            parameter.data.zero_()
        [*encoder.parameters()][-1].data.fill_(value)
    for both_ways in (False, True):
        actor.zero_grad()
        loss = actor.supervised_losses(obs, both_ways=both_ways)["adaptation"]
        loss.backward()
        at_z, at_star = ([*encoder.parameters()][-1].grad for encoder in encoders.values())
        assert loss.item() == pytest.approx(4.0) and at_star.tolist() == pytest.approx([4 / 3] * 3)
        assert at_z.tolist() == pytest.approx([-4 / 3] * 3) if both_ways else at_z is None


@pytest.mark.parametrize("both_ways", [False, True])
def test_the_student_trains_its_copy_of_z_only_both_ways(both_ways: bool, env: LocomotionEnv, tmp_path) -> None:
    """L_ada of the second phase reaches the student's privileged encoder, and never the teacher's."""
    cfg = replace(CFG, student=replace(CFG.student, both_ways=both_ways))
    runner, teacher = phase(env, tmp_path, "student", cfg), phase(env, tmp_path)
    runner.alg.warm_start(teacher.alg.get_policy().state_dict(), {})
    before = [p.detach().clone() for p in runner.alg.teacher.privileged_encoder.parameters()]
    runner.iterate()
    for actor, moves in ((runner.alg.student, both_ways), (runner.alg.teacher, False)):
        now = actor.privileged_encoder.parameters()
        assert any(not torch.equal(a, b) for a, b in zip(before, now, strict=True)) == moves


@pytest.mark.parametrize("critic_history", [False, True])
def test_the_critic_sees_the_history_where_it_is_told(critic_history: bool, env: LocomotionEnv, tmp_path) -> None:
    """Go1: a frame of 47, o_priv of 38, o_exp of 7; with the history eleven frames more."""
    cfg = replace(CFG, network=replace(CFG.network, critic_history=critic_history))
    critic, obs = phase(env, tmp_path, cfg=cfg).alg.critic, env.get_observations()
    assert critic.latent_dim == 47 + 38 + 7 + 11 * 47 * critic_history
    other = obs.clone()
    other["history"] = other["history"] + 1.0
    assert torch.equal(critic(obs), critic(other)) != critic_history


def test_actor_never_sees_the_true_explicit_state(env: LocomotionEnv, tmp_path) -> None:
    """Keeps unmeasured quantities out of the action, and on z* the privileged state too."""
    actor, obs = phase(env, tmp_path).alg.actor, env.get_observations()
    other = obs.clone()
    other["explicit"] = other["explicit"] + 1.0
    assert torch.equal(actor(obs), actor(other))
    other["privileged"] = other["privileged"] + 1.0
    assert not torch.equal(actor(obs), actor(other))
    actor.latent_source = "history"
    assert torch.equal(actor(obs), actor(other))


def test_student_starts_as_the_teacher_on_its_own_latent(env: LocomotionEnv, tmp_path) -> None:
    """Warm start: the student acts as the teacher does with z*, and the deployed module as the student."""
    teacher = phase(env, tmp_path)
    teacher.iterate()
    actor = teacher.alg.get_policy()
    student = phase(env, tmp_path, "student")
    student.alg.warm_start(actor.state_dict(), {})
    obs = env.get_observations()
    actor.latent_source = "history"
    torch.testing.assert_close(student.alg.student(obs), actor(obs))
    torch.testing.assert_close(StudentPolicy(student.alg.student)(obs["history"]), actor(obs))
    actor.latent_source = "privileged"
    torch.testing.assert_close(student.alg.teacher(obs), actor(obs))


def test_distillation_brings_the_student_to_the_teacher(env: LocomotionEnv, tmp_path) -> None:
    """All three losses fall, and the teacher stays as it is."""
    cfg = replace(CFG, student=replace(CFG.student, iterations=40, learning_rate=3e-3))
    teacher = phase(env, tmp_path)
    student = phase(env, tmp_path, "student", cfg)
    with torch.no_grad():
        for parameter in teacher.alg.actor.privileged_encoder.parameters():
            parameter.mul_(3.0)
    student.alg.warm_start(teacher.alg.get_policy().state_dict(), {})
    kept = [p.clone() for p in student.alg.teacher.parameters()]
    losses = [student.iterate() for _ in range(40)]
    for name in ("clone", "adaptation", "estimator"):
        early, late = (sum(row[f"loss/{name}"] for row in part) for part in (losses[:5], losses[-5:]))
        assert late < early, name
    assert all(torch.equal(a, b) for a, b in zip(kept, student.alg.teacher.parameters(), strict=True))
