"""Training methods: stages worked out by hand, what is drawn in them, and friction added to the command."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from stiction.core.errors import StictionError
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import Policy
from stiction.evaluation.export import contract_of
from stiction.joints.compensation import BY_SPEED
from stiction.learning.config import TrainCfg
from stiction.learning.stored import config_from
from stiction.task.config import TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg


def test_iterative_comes_in_equal_steps() -> None:
    """4 steps in the second half of 80 iterations: from 40, 50, 60 and 70 on, a quarter of 0.8 to 1.2 more each."""
    cfg = FrictionCfg("iterative", level=0.2)
    assert [cfg.stage(iteration, 80) for iteration in (0, 39, 40, 49, 50, 60, 69, 70, 79)] == [
        0,
        0,
        1,
        1,
        2,
        3,
        3,
        4,
        4,
    ]
    lows, highs = zip(*(stage.range for stage in cfg.schedule), strict=True)
    assert lows == pytest.approx((0.0, 0.2, 0.4, 0.6, 0.8)) and highs == pytest.approx((0.0, 0.3, 0.6, 0.9, 1.2))


def test_any_method_can_begin_without_friction() -> None:
    """0 to 1.2 from the 40th of 100 iterations on; in two stages half of it from the 40th and all from the 70th."""
    cfg = FrictionCfg("deception", level=0.2, begin=0.4)
    assert [(stage.begin, stage.mixture) for stage in cfg.schedule] == [(0, ((1, 0, 0),)), (0.4, ((1, 0, 1.2),))]
    assert [cfg.stage(iteration, 100) for iteration in (0, 39, 40, 99)] == [0, 0, 1, 1]
    cfg = FrictionCfg("deception", level=0.2, begin=0.4, stages=2)
    assert [stage.begin for stage in cfg.schedule] == pytest.approx([0, 0.4, 0.7])
    assert [stage.range for stage in cfg.schedule] == [(0, 0), (0, 0.6), (0, 1.2)]
    assert FrictionCfg("iterative", level=0.2, begin=0.0, stages=1).schedule == FrictionCfg("direct", 0.2).schedule


def test_an_older_run_has_the_schedule_that_it_had() -> None:
    """Every run wrote both settings, and those of two methods used them: a `deception` of before had no begin."""
    for method, expected in (("deception", (None, None)), ("finetune", (0.3, None)), ("iterative", (0.3, 8))):
        old = {"task": {"friction": {"method": method, "level": 0.2, "pretraining": 0.3, "steps": 8}}}
        cfg = config_from(old, "config.json").task.friction
        assert (cfg.begin, cfg.stages) == expected


def test_a_new_stage_draws_friction_and_nothing_else() -> None:
    """Robots would become others in the middle of their episodes, or keep the friction of the stage before."""
    env = LocomotionEnv(TaskCfg(robot="go1", friction=FrictionCfg("iterative", level=0.2, stages=2)), 8, 0)
    before = {name: value.clone() for name, value in vars(env.randomizer.draws).items()}
    assert not env.fleet.friction.any()
    env.enter_stage(1)
    after = vars(env.randomizer.draws)
    assert all(torch.equal(value, after[name]) for name, value in before.items() if name != "friction")
    share = env.fleet.friction / (0.2 * env.fleet.torque_limit)
    assert share.min() >= 0.4 and share.max() <= 0.6 and np.unique(share[:, 0]).size == 8
    env._reset(torch.arange(8))
    share = env.fleet.friction / (0.2 * env.fleet.torque_limit)
    assert share.min() >= 0.4 and share.max() <= 0.6


def test_the_task_compensates_as_the_robot_does() -> None:
    """From the angle and speed that both measure, noise and offset of the encoder in them, by 0.75 · 0.2 τ_max / kp."""
    cfg = TaskCfg(robot="go1", friction=FrictionCfg("compensation", level=0.2))
    env = LocomotionEnv(cfg, 4, 0)
    contract = contract_of(TrainCfg(task=cfg), {"identified": None, "revision": "r", "command": "c"})
    np.testing.assert_allclose(contract.array("compensation"), 0.15 * env.fleet.torque_limit / contract.array("kp"))
    assert contract.push == BY_SPEED.push and contract.compensation_speeds == (0.2, 0.3)
    generator = np.random.default_rng(0)
    action = generator.uniform(-1.0, 1.0, (4, 12)).astype(np.float32)
    network, rates = SimpleNamespace(run=lambda observation: (action, None)), np.zeros((4, 3))
    policy = Policy(contract, network, (4,))  # type: ignore[arg-type]
    for _ in range(5):
        upright = np.tile([1.0, 0.0, 0.0, 0.0], (4, 1))
        measured = env.measured_position.double().numpy(), env.measured_velocity.double().numpy()
        # The newest frame ends with angles, speeds, last action, and 1 for padding; 0.05 is the scale of speeds.
        seen = env.get_observations()["proprioception"].double().numpy()[:, 22:34]
        np.testing.assert_allclose(seen, 0.05 * measured[1], atol=1e-6)
        target = policy.step(Sensors(upright, rates, *measured), rates).target
        env.step(torch.from_numpy(action))
        sent = env.fleet.targets + env.randomizer.draws.encoder_offset.numpy()
        np.testing.assert_allclose(sent, target, atol=1e-6)
        assert np.abs(target - contract.array("standing") - contract.action_scale * action).max() > 0.05


@pytest.mark.parametrize(
    "changes",
    [
        {"mixture": ((float("inf"), 0.0, 1.0),)},
        {"mixture": ((1.0, 0.0),)},
        {"stages": 10**9},
        {"begin": 1.0},
        {"begin": -0.1},
    ],
)
def test_what_cannot_be_drawn_is_refused(changes: dict) -> None:
    """The mistake would show when the stage begins, after hours."""
    with pytest.raises(StictionError):
        FrictionCfg("iterative", level=0.2, **changes)
