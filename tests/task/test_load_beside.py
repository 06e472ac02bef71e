"""Coulomb friction with friction of the load beside it, and joints that differ about their robot's mean."""

import numpy as np
import pytest
import torch

from stiction.core.errors import StictionError
from stiction.joints.friction import Law
from stiction.task.config import TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg
from task.test_env import make

BOTH = FrictionCfg("deception", level=0.1, range=(0.0, 1.0), load=(0.0, 0.1))


def test_every_robot_has_a_coefficient_of_its_own_beside_its_friction() -> None:
    """Up to 10 % of the limit and a coefficient up to 0.1, drawn apart; all joints of a robot share both."""
    env = make(num_envs=64, friction=BOTH)
    dry, load = env.host.law.levels
    assert env.host.law.laws == (Law(), Law("load"))
    share = dry / env.fleet.torque_limit
    for drawn, most in ((share, 0.1), (load, 0.1)):
        assert np.ptp(drawn, axis=1).max() < 1e-9
        assert 0.0 <= drawn.min() < 0.02 and 0.08 < drawn.max() <= most + 1e-9
    assert abs(np.corrcoef(share[:, 0], load[:, 0])[0, 1]) < 0.4


def test_the_teacher_sees_both_and_a_bench_would_tell_the_first() -> None:
    """o_priv: f + c m g / feet, over the limit, in tenths; what is told of a bench is f alone."""
    env = make(num_envs=8, friction=BOTH)
    dry, load = (torch.from_numpy(level).float() for level in env.host.law.levels)
    limit = torch.from_numpy(env.fleet.torque_limit).float()
    whole = (dry + load * env.spec.weight / 4) / limit
    torch.testing.assert_close(env.randomizer.friction_share(), whole)
    torch.testing.assert_close(env.randomizer.unloaded_share(), dry / limit)
    torch.testing.assert_close(env.get_observations()["privileged"][:, 26:], whole / 0.1, atol=1e-4, rtol=1e-4)


def test_friction_in_the_simulation_grows_with_the_load() -> None:
    """After a step it is above the dry friction wherever a joint transmits something."""
    env = make(num_envs=4, friction=BOTH)
    step = env.step(torch.zeros(4, env.num_actions))
    dry, load = env.host.law.levels
    assert (env.fleet.friction[load > 0.01] > dry[load > 0.01]).all()
    assert step[3]["log"]["friction/share"] > 0.0


@pytest.mark.parametrize(
    ("words", "by_law", "any_at_all"),
    [
        ({}, True, True),
        ({"level": 0.0}, False, False),
        ({"level": 0.0, "load": (0.0, 0.1)}, False, True),
        ({"range": (0.0, 0.0)}, False, False),
        ({"mixture": ((1.0, 0.0, 0.0),)}, False, False),
        ({"spread": (0.0, 2.0)}, True, True),
        ({"method": "none"}, False, False),
        ({"method": "iterative"}, True, True),
        ({"method": "hinf", "range": (0.0, 1.2)}, True, True),
        ({"method": "dreamwaq", "load": (0.0, 0.1)}, False, True),
    ],
)
def test_friction_is_there_where_a_robot_can_draw_some(words: dict, by_law: bool, any_at_all: bool) -> None:
    """By its draws, not by the names of its options: what is counted on is told, disturbed, and shown."""
    cfg = FrictionCfg(**{"level": 0.2} | words)
    assert (cfg.draws_law, cfg.has_friction) == (by_law, any_at_all)
    env = LocomotionEnv(TaskCfg(robot="go1", friction=cfg), 16, 0)
    env.enter_stage(len(cfg.schedule) - 1)
    assert (bool(env.randomizer.unloaded_share().any()), bool(env.randomizer.friction_share().any())) == (
        by_law,
        any_at_all,
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"spread": (0.5, 1.5), "per": "joint"}, "both let joints differ"),
        ({"spread": (0.5, 1.5), "method": "none"}, "has no friction to draw"),
        ({"load": (0.0, 0.1), "law": "effort"}, "is a coefficient itself"),
        ({"load": (0.2, 0.1)}, r"friction load \(0.2, 0.1\)"),
        ({"spread": (0.0, 10.0)}, "friction spread"),
    ],
)
def test_what_cannot_be_is_refused(words: dict, message: str) -> None:
    """One line that says what to leave out."""
    with pytest.raises(StictionError, match=message):
        FrictionCfg(**words)
