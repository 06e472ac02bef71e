"""The task on the device, on Warp's processor device: held against the same task on the host, with the same draws."""

from copy import deepcopy
from functools import cache

import pytest
import torch

pytest.importorskip("mujoco_warp", reason="mujoco_warp, of the extra 'gpu', is not installed")
import warp

from stiction.sim.torch_fleet import TorchFleet
from stiction.sim.warp import WarpSimulation
from stiction.task.config import CommandCfg, RandomizationCfg, TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg
from stiction.task.task_fleet import find_device

pytestmark = pytest.mark.slow

warp.config.optimization_level = 0  # Compiling takes longer than all that is computed here.

NUM = 2
TASK = TaskCfg(
    robot="go1",
    timestep=0.01,
    decimation=2,
    episode=0.9,
    friction=FrictionCfg(level=0.15, mixture=((0.3, 0.0, 0.0), (0.7, 0.2, 1.2))),
    randomization=RandomizationCfg(push_interval=0.3, contact_time=(0.02, 0.04)),
    commands=CommandCfg(interval=0.4),
    estimated_friction=True,
    known_friction=True,
    slow_means=1.0,
)
"""Everything that is drawn, pushed, commanded and observed on flat ground, often."""


@cache
def pair(by_mask: bool) -> tuple[LocomotionEnv, LocomotionEnv]:
    """Return the task on the host and on the device, from one seed."""
    envs = [
        LocomotionEnv(TASK, NUM, seed=5, device=find_device("warp-cpu", 32, on_host=on_host))
        for on_host in (True, False)
    ]
    for env in envs:
        env.by_mask = by_mask
    host, device = envs
    assert isinstance(host.fleet.simulation, WarpSimulation) and isinstance(device.robots, TorchFleet)
    return host, device


def largest(one: dict[str, torch.Tensor], other: dict[str, torch.Tensor]) -> float:
    """Return the largest difference of the same tensors."""
    assert set(one) == set(other)
    return max(float((one[name].float() - other[name].float()).abs().max()) for name in one)


@pytest.mark.parametrize(("by_mask", "steps"), [(True, 80), (False, 50)], ids=["masks", "numbers"])
def test_the_task_on_the_device_is_that_on_the_host(by_mask: bool, steps: int) -> None:
    """Every group, reward, figure and reset: a policy must not learn another task on a GPU."""
    host, device = pair(by_mask)
    generator = torch.Generator().manual_seed(1)
    worst, ended = largest(dict(host.get_observations()), dict(device.get_observations())), 0
    for step in range(steps):
        # Now and then a robot thrashes, and falls.
        wild = 4.0 if step % 40 > 20 else 0.4
        actions = wild * torch.randn(NUM, host.num_actions, generator=generator)
        one, other = (env.step(actions) for env in (host, device))
        assert torch.equal(one[2], other[2]), f"resets differ in step {step}"
        assert torch.equal(one[3]["time_outs"], other[3]["time_outs"])
        worst = max(worst, largest(dict(one[0]), dict(other[0])), largest({"": one[1]}, {"": other[1]}))
        worst = max(worst, largest(one[3]["log"], other[3]["log"]))
        ended += int(one[2].sum())
    assert worst <= 1e-4
    assert ended >= NUM * steps // 50
    assert largest(vars(host.randomizer.draws), vars(device.randomizer.draws)) == 0.0


def test_a_checkpoint_of_the_device_goes_on_bit_by_bit() -> None:
    """Restores the complete state of the next step."""
    env = pair(False)[1]
    actions = 0.5 * torch.randn(12, NUM, env.num_actions, generator=torch.Generator().manual_seed(2))
    state = deepcopy(env.state())
    first = [env.step(action)[0].clone() for action in actions]
    env.load_state(state)
    again = [env.step(action)[0].clone() for action in actions]
    assert all(largest(dict(one), dict(other)) == 0.0 for one, other in zip(first, again, strict=True))


def test_a_robot_that_blows_up_is_counted_stood_up_and_touches_no_other() -> None:
    """NaN must reach neither an observation, nor a reward, nor another robot."""
    env = pair(False)[1]
    robots = env.robots
    assert isinstance(robots, TorchFleet)
    before = robots.blown_up.clone()
    robots._qvel[1, 8] = torch.nan
    observation, reward, dones, extras = env.step(torch.zeros(NUM, env.num_actions))
    assert dones[1] and float(extras["log"]["walk/blown_up"]) == 1.0 and reward[1] == 0.0
    assert (robots.blown_up - before).tolist() == [0, 1]
    assert all(value.isfinite().all() for value in (*observation.values(), reward, *extras["log"].values()))
