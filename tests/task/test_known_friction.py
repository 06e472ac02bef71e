"""Observed friction of the robot's joints, with the error of a bench."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from stiction.core.errors import StictionError
from stiction.deploy.observation import ObservationBuilder, Sensors
from stiction.task.config import NoiseCfg, RandomizationCfg, TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg

FRICTION = FrictionCfg("deception", level=0.2, per="joint")


def make(num_envs: int = 64, error: tuple[float, float] = (0.7, 1.3), **changes: object) -> LocomotionEnv:
    """Robots whose joints all have friction of their own, and which are told of it."""
    cfg = TaskCfg(robot="go1", friction=FRICTION, known_friction=True, noise=NoiseCfg(0.0, 0.0, 0.0, 0.0))
    cfg = replace(cfg, randomization=replace(RandomizationCfg(), known_friction=error), **changes)
    return LocomotionEnv(cfg, num_envs, seed=1)


def told(env: LocomotionEnv) -> np.ndarray:
    """Return the friction in each robot's newest frame, f/τ_max of hip, thigh and shank, shape (N, 3)."""
    return env.get_observations()["proprioception"][:, -3:].double().numpy() / 5.0


def present(env: LocomotionEnv) -> np.ndarray:
    """Return the friction of the simulated joints, the mean over four legs, shape (N, 3)."""
    share = env.fleet.friction / env.fleet.torque_limit
    return np.stack([share[:, kind::3].mean(axis=1) for kind in range(3)], axis=-1)


def test_without_an_error_it_is_the_mean_over_the_legs() -> None:
    """Equals the friction in MuJoCo over the joints' torque limits."""
    env = make(error=(1.0, 1.0))
    np.testing.assert_allclose(told(env), present(env), atol=1e-6)
    assert present(env).min() > 0 and present(env).max() < 0.24


def test_the_error_is_drawn_once_for_every_episode_and_kind_of_joint() -> None:
    """Uniform within its ends, other for each kind, the same in all of an episode, another in the next."""
    env = make(num_envs=500)
    error = told(env) / present(env)
    assert 0.7 - 1e-5 <= error.min() < 0.72 and 1.28 < error.max() <= 1.3 + 1e-5
    assert error.mean() == pytest.approx(1.0, abs=4 * 0.6 / 12**0.5 / 1500**0.5)
    assert abs(np.corrcoef(error.T) - np.eye(3)).max() < 4 / 500**0.5
    first = told(env)
    for _ in range(3):
        env.step(torch.zeros(500, 12))
        going = env.episode_length_buf > 0
        np.testing.assert_array_equal(told(env)[going], first[going])
    env.episode_length_buf[:250] = env.max_episode_length
    _, _, dones, _ = env.step(torch.zeros(500, 12))
    changed = ~np.isclose(told(env), first)
    assert dones[:250].all() and changed[:250].all()
    assert not changed[~dones.numpy()].any()
    again = told(env) / present(env)
    assert again.min() >= 0.7 - 1e-5 and again.max() <= 1.3 + 1e-5
    assert (abs(again[:250] - error[:250]) > 1e-4).mean() > 0.98


def test_the_runtime_observes_the_same() -> None:
    """The builder of the deployed policy, told the same, gives the task's observation."""
    env = make(num_envs=4)
    known = present(env) * env.bench_error.numpy()
    builder, fleet = ObservationBuilder(env.layout, env.fleet.standing, (4,), known), env.fleet
    offset = env.randomizer.draws.encoder_offset.numpy()
    for _ in range(13):
        sensors = Sensors(
            fleet.base_quaternion, fleet.base_angular_velocity, fleet.joint_position + offset, fleet.joint_velocity
        )
        built = builder.step(sensors, env.commands.value.numpy(), env.last_action.numpy())
        np.testing.assert_allclose(built, env.get_observations()["history"].numpy(), atol=2e-6)
        assert not env.step(torch.zeros(4, 12))[2].any()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"friction": FrictionCfg("none")}, "no friction in training of which a policy could be told"),
        ({"friction": FrictionCfg("hinf", 0.2, load=(0.0, 0.1))}, "no friction in training of which"),
        ({"friction": FrictionCfg("deception", 0.2, range=(0.0, 0.0))}, "no friction in training of which"),
        ({"error": (1.3, 0.7)}, "known_friction is the range"),
        ({"error": (-0.1, 1.0)}, "known_friction is the range"),
    ],
)
def test_what_cannot_be_told_is_refused(changes: dict, message: str) -> None:
    """Before hours of training."""
    with pytest.raises(StictionError, match=message):
        make(**changes)
