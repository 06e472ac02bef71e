"""The task with an Actuator Net: what is still randomised, and what the joints of the simulation keep."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed for the task")

import torch

from actuators import pd_net
from stiction.task.config import TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg

JOINTS = 12


def task(side: str, method: str) -> LocomotionEnv:
    """Return eight robots whose torque a net of the given side gives."""
    cfg = TaskCfg(robot="go1", friction=FrictionCfg(method=method, level=0.1))  # type: ignore[arg-type]
    return LocomotionEnv(cfg, 8, 0, actuator=pd_net("go1", torque_source=side))


@pytest.mark.parametrize(("side", "method"), [("motor_side", "direct"), ("output_side", "none")])
def test_what_is_in_the_net_is_not_randomised(side: str, method: str) -> None:
    """Gains and delay are in the net, motor strength is not; friction and damping only in one of output-side torque.
    The privileged observation tells of nothing that is not there.
    """
    env = task(side, method)
    draws, fleet = env.randomizer.draws, env.fleet
    assert (draws.stiffness == 1).all() and (draws.action_delay == 0).all() and not fleet.delay.any()
    assert draws.motor_strength.std() > 0.05
    np.testing.assert_allclose(env.motors.strength, draws.motor_strength.double().numpy())
    kept = side == "motor_side"
    assert bool((fleet.friction > 0).all()) is bool((fleet.damping > 0).all()) is kept
    parts = env.get_observations()["privileged"][:, 2:].reshape(8, 3, JOINTS)
    assert parts[:, 0].any() and bool(parts[:, 1].any()) is bool(parts[:, 2].any()) is kept
    for _ in range(5):
        env.step(torch.zeros(8, JOINTS))
    assert not fleet.delay.any() and fleet.blown_up.sum() == 0
