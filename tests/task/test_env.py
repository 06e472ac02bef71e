"""The task: observation groups, episodes, delays and offsets, and what a checkpoint must hold."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import torch

from stiction.core.errors import ConfigurationError
from stiction.deploy.observation import ObservationBuilder, Sensors
from stiction.learning.run import load_checkpoint, save_checkpoint
from stiction.robots.catalog import find_robot
from stiction.robots.physics import PhysicsCfg
from stiction.task.config import CommandCfg, NoiseCfg, RandomizationCfg, TaskCfg
from stiction.task.env import CommandSampler, LocomotionEnv
from stiction.task.friction import FrictionCfg
from stiction.task.randomization import nominal_joints
from stiction.task.rewards import RewardCfg

QUIET = NoiseCfg(0.0, 0.0, 0.0, 0.0)


def make(robot: str = "go1", num_envs: int = 4, **changes: object) -> LocomotionEnv:
    """A small task."""
    return LocomotionEnv(replace(TaskCfg(robot=robot), **changes), num_envs, seed=1)


@pytest.mark.parametrize(("robot", "joints", "legs"), [("saturn_lite", 18, 6), ("go1", 12, 4)])
def test_observation_groups_are_the_papers(robot: str, joints: int, legs: int) -> None:
    """Sizes for six and for four legs: 11 + 3J a frame, 11 frames, {m, f_g, I, B, f}, {v, contacts}."""
    env = make(robot)
    obs, reward, dones, extras = env.step(torch.zeros(4, joints))
    sizes = {name: value.shape[1] for name, value in obs.items()}
    frame = 11 + 3 * joints
    assert sizes == {"proprioception": frame, "history": 11 * frame, "privileged": 2 + 3 * joints, "explicit": 3 + legs}
    assert all(value.dtype == torch.float32 and value.isfinite().all() for value in obs.values())
    assert reward.shape == dones.shape == extras["time_outs"].shape == (4,)


def test_frame_has_the_papers_order_and_placeholders() -> None:
    """{ω, (φ, ψ), 0, com, 0, θ, θ', a, 0}: the deployed builder, written apart, gives the same numbers."""
    env = make(noise=QUIET)
    builder = ObservationBuilder(env.layout, env.fleet.standing, batch=(4,))
    fleet, action = env.fleet, torch.zeros(4, 12)
    offset = env.randomizer.draws.encoder_offset.numpy()
    generator = torch.Generator().manual_seed(0)
    for _ in range(14):
        sensors = Sensors(
            fleet.base_quaternion.copy(),
            fleet.base_angular_velocity.copy(),
            fleet.joint_position + offset,
            fleet.joint_velocity.copy(),
        )
        built = builder.step(sensors, env.commands.value.numpy(), action.numpy())
        np.testing.assert_allclose(built, env.get_observations()["history"].numpy(), atol=2e-6)
        action = 0.3 * torch.randn(4, 12, generator=generator)
        _, _, dones, _ = env.step(action)
        assert not dones.any()


def test_the_clock_of_the_robot_is_that_of_the_training(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stride of 0.8 s is 40 control steps, feet are half a turn apart, and so is who begins with the other foot."""
    spec = replace(find_robot("g1"), gait_period=0.8)
    monkeypatch.setattr("stiction.task.env.find_robot", lambda name: spec)
    env = make("g1", noise=QUIET, num_envs=16, first_side=True, rewards=RewardCfg().for_robot(spec))
    builder = ObservationBuilder(env.layout, env.fleet.standing, batch=(16,), control_period=0.02)
    still = np.zeros((16, spec.num_joints))
    for step in range(4):
        sensors = Sensors(env.fleet.base_quaternion, env.fleet.base_angular_velocity, still, still)
        deployed = builder.step(sensors, env.commands.value.numpy(), still)[:, -4:]
        trained = env.get_observations()["proprioception"][:, -4:].numpy()
        first = trained[:, :2] * env.first_side.numpy(), trained[:, 2:] * env.first_side.numpy()
        np.testing.assert_allclose(np.hstack(first), deployed, atol=1e-6)
        turned = 2 * np.pi * step / 40
        np.testing.assert_allclose(deployed[0, [0, 2]], [np.sin(turned), np.cos(turned)], atol=1e-6)
        env.step(torch.zeros(16, spec.num_joints))


def test_history_starts_with_eleven_copies_and_ends_with_the_present() -> None:
    """Right after a reset there is no past: all frames are the first one."""
    env = make()
    frames = env.get_observations()["history"].unflatten(1, (11, -1))
    assert (frames == frames[:, :1]).all()
    obs = env.step(torch.zeros(4, 12))[0]
    frames = obs["history"].unflatten(1, (11, -1))
    assert torch.equal(frames[:, -1], obs["proprioception"])
    assert not torch.equal(frames[:, -2], frames[:, -1])


def test_privileged_observation_is_what_was_drawn() -> None:
    """Mass, ground friction, inertia, damping, dry friction of the simulation itself, undone from their scales."""
    env = make(friction=FrictionCfg("direct", level=0.2))
    privileged, fleet = env.get_observations()["privileged"].double().numpy(), env.fleet
    np.testing.assert_allclose(privileged[:, 0] * 3.0 + env.spec.base.mass, fleet.base_mass, atol=1e-5)
    foot = fleet.model.geom("FR_foot").id
    np.testing.assert_allclose(privileged[:, 1] + 1.0, fleet._geom_friction[:, foot, 0], atol=1e-5)
    np.testing.assert_allclose((privileged[:, 2:14] * 0.2 + 1.0) * 0.0121, fleet.armature, atol=1e-7)
    np.testing.assert_allclose((privileged[:, 14:26] * 0.2 + 1.0) * 0.0342, fleet.damping, atol=1e-7)
    np.testing.assert_allclose(privileged[:, 26:] * 0.1 * fleet.torque_limit, fleet.friction, atol=1e-5)


@pytest.mark.parametrize(("unit", "entry"), [(0.1, 0.12), (0.01, 1.2)])
def test_privileged_friction_has_its_unit(unit: float, entry: float) -> None:
    """1.2 times 1 % of the limit is 0.12 in units of 10 %, and 1.2 in units of 1 %; nothing else changes."""
    env = make(friction=FrictionCfg("direct", level=0.01, range=(1.2, 1.2), privileged_unit=unit))
    np.testing.assert_allclose(env.get_observations()["privileged"][:, 26:], entry, rtol=1e-6)
    np.testing.assert_allclose(env.fleet.friction / env.fleet.torque_limit, 0.012, rtol=1e-6)
    with pytest.raises(ConfigurationError, match=r"privileged_unit: got 0, expected 0\.001 to 1"):
        FrictionCfg(privileged_unit=0.0)


@pytest.mark.parametrize(("axes", "shift"), [("all", (0.25, 0.25 * 0.26 / 0.7, 0.05)), ("forward", (0.25, 0.0, 0.0))])
def test_the_centre_of_mass_moves_along_its_axes(axes: Literal["all", "forward"], shift: tuple[float, ...]) -> None:
    """A trunk of 0.7 x 0.26 x 0.14 m: 0.25 m forward, in proportion sideways and up, or forward alone."""
    drawn = RandomizationCfg(center_of_mass=(0.25, 0.25), center_of_mass_axes=axes)
    env = make("saturn_lite", randomization=drawn)
    np.testing.assert_allclose(env.randomizer.draws.center_of_mass, np.tile(shift, (4, 1)), atol=1e-7)


@pytest.mark.parametrize("law", ["load", "effort"])
def test_privileged_friction_of_a_coefficient_is_in_tenths_of_the_limit(law: str) -> None:
    """Equals `load` under a leg's share of the weight, and `effort` at full torque, in the scale of Coulomb's."""
    env = make(friction=FrictionCfg("deception", level=0.1, law=law, per="joint"))
    typical = env.fleet.torque_limit if law == "effort" else env.spec.weight / 4
    coefficient = env.host.law.levels[0]
    assert 0.0 <= coefficient.min() < coefficient.max() <= 0.12 and np.ptp(coefficient, axis=1).min() > 0.01
    expected = coefficient * typical / env.fleet.torque_limit / 0.1
    np.testing.assert_allclose(env.get_observations()["privileged"][:, 26:], expected, atol=1e-5)


@pytest.mark.parametrize(("method", "low", "high"), [("none", 0, 0), ("direct", 0.8, 1.2), ("deception", 0, 1.2)])
def test_friction_in_training_has_the_range_of_its_method(method: str, low: float, high: float) -> None:
    """b_c = multiplier x level x torque limit, one multiplier a robot."""
    env = make(num_envs=200, friction=FrictionCfg(method, level=0.2))
    share = env.fleet.friction / env.fleet.torque_limit / 0.2
    assert share.min() >= low - 1e-6 and share.max() <= high + 1e-6
    assert np.ptp(share, axis=1).max() < 1e-6
    if high > low:
        assert share.min() < low + 0.1 * (high - low) and share.max() > high - 0.1 * (high - low)


def test_identification_sets_the_nominal_joint_and_the_level_overrides_its_friction() -> None:
    """`--joints` without a level trains at the identified friction; what was not identified stays as specified."""
    fleet = make().fleet
    identified = {"armature": np.array([np.nan] * 11 + [0.05]), "frictionloss": np.full(12, 1.5)}
    alone = nominal_joints(fleet, FrictionCfg(), identified)
    assert alone.armature[-1] == 0.05 and alone.armature[0] == 0.0121
    assert (alone.frictionloss == 1.5).all() and (alone.damping == 0.0342).all()
    levelled = nominal_joints(fleet, FrictionCfg(level=0.1), identified)
    np.testing.assert_allclose(levelled.frictionloss, 0.1 * fleet.torque_limit)


def test_episode_ends_by_time_without_counting_as_a_fall() -> None:
    """A robot that stands for the whole episode times out, and starts anew."""
    env = make(episode=0.1, randomization=RandomizationCfg(push_interval=0.0))
    results = [env.step(torch.zeros(4, 12)) for _ in range(5)]
    assert not results[3][2].any()
    _, _, dones, extras = results[4]
    assert dones.all() and (extras["time_outs"] == 1).all()
    assert (env.episode_length_buf == 0).all()


def test_a_fall_ends_the_episode_and_is_no_time_out() -> None:
    """An overturned robot is reset; the value of its end is not bootstrapped."""
    env = make()
    env.fleet.base_quaternion[1] = [0.0, 1.0, 0.0, 0.0]
    _, _, dones, extras = env.step(torch.zeros(4, 12))
    assert dones.tolist() == [False, True, False, False]
    assert extras["time_outs"].sum() == 0


def test_a_blow_up_ends_the_episode_and_is_logged() -> None:
    """NaN reaches neither reward nor observation, and the log says that it happened."""
    env = make()
    env.fleet.joint_velocity[2] = np.nan
    obs, reward, dones, extras = env.step(torch.zeros(4, 12))
    assert dones.tolist() == [False, False, True, False]
    assert extras["log"]["walk/blown_up"] == 1.0
    assert reward.isfinite().all() and all(value.isfinite().all() for value in obs.values())


def test_every_robot_is_pushed_within_bounds() -> None:
    """Pushes come at their interval and change the horizontal velocity only."""
    env = make(num_envs=64, randomization=RandomizationCfg(push_interval=0.04, push_velocity=0.5))
    env.step(torch.zeros(64, 12))
    before = env.fleet.qvel[:, :3].copy()
    env._trigger_events(torch.zeros(64, dtype=torch.bool))
    assert np.array_equal(before, env.fleet.qvel[:, :3])
    env.episode_length_buf[:] = 2
    env._trigger_events(torch.zeros(64, dtype=torch.bool))
    change = env.fleet.qvel[:, :3] - before
    assert 0.4 < np.abs(change[:, :2]).max() <= 0.5 and (change[:, 2] == 0).all()


def test_commands_fill_their_ranges_and_small_ones_are_standing() -> None:
    """A command under the threshold would ask for a crawl that no gait can make."""
    sampler = CommandSampler(CommandCfg(), 4000)
    sampler.draw(torch.arange(4000), torch.Generator().manual_seed(0))
    value = sampler.value
    assert value[:, 0].min() < -0.75 and value[:, 0].max() > 0.75 and value[:, 1].abs().max() <= 0.3
    norm = value.norm(dim=-1)
    assert ((norm == 0) | (norm > 0.1)).all()
    assert 0.09 < (norm == 0).float().mean() < 0.14


def test_a_share_of_episodes_begins_exactly_in_the_standing_pose() -> None:
    """A robot is put down so; a policy that never saw it may find no first step."""
    still = replace(RandomizationCfg(), standing_start=0.25, encoder_offset=(0.0, 0.0))
    env = make(num_envs=400, randomization=still)
    exact = (np.abs(env.fleet.joint_position - env.fleet.standing) < 1e-9).all(1)
    assert 0.18 < exact.mean() < 0.32
    assert not env.fleet.qvel[exact].any() and env.fleet.qvel[~exact, :6].all()
    with pytest.raises(ConfigurationError, match="standing_start"):
        RandomizationCfg(standing_start=1.5)


def test_either_side_begins_as_often_and_keeps_its_turn() -> None:
    """Drawn for an episode; in every frame, last; a task without it draws and tells nothing."""
    env = make(num_envs=400, first_side=True)
    side = env.get_observations()["proprioception"][:, -1]
    assert set(side.tolist()) == {1.0, -1.0} and abs(side.mean()) < 0.2
    obs = env.step(torch.zeros(400, 12))[0]
    assert torch.equal(obs["proprioception"][:, -1], side)
    assert env.layout.frame_size == make().layout.frame_size + 1


@pytest.mark.parametrize(
    ("law", "physics"), [("coulomb", "rows"), ("load", "rows"), ("coulomb", "plastic"), ("load", "plastic")]
)
def test_state_restores_the_task_bit_by_bit(tmp_path: Path, law: str, physics: str) -> None:
    """A resumed run must see the same robots, commands, noise and history as one that was never stopped."""
    task = {"friction": FrictionCfg("deception", level=0.2, law=law), "physics": PhysicsCfg(physics), "episode": 0.3}
    env = make(**task)
    generator = torch.Generator().manual_seed(3)
    actions = torch.randn(30, 4, 12, generator=generator)
    for action in actions[:10]:
        env.step(action)
    save_checkpoint(tmp_path / "env.safetensors", env.state())
    first = [env.step(action)[:2] for action in actions[10:]]

    other = make(**task)
    other.load_state(load_checkpoint(tmp_path / "env.safetensors"))
    for action, (obs, reward) in zip(actions[10:], first, strict=True):
        again, reward_again, *_ = other.step(action)
        assert torch.equal(reward, reward_again)
        assert all(torch.equal(obs[name], again[name]) for name in ("history", "privileged", "explicit"))
