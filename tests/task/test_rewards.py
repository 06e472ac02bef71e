"""Reward terms against numbers worked out by hand."""

import dataclasses
import math

import pytest
import torch

from stiction.core.errors import StictionError
from stiction.robots.catalog import find_robot
from stiction.task import rewards

JOINTS = 6


def snapshot(**changes: torch.Tensor) -> rewards.Snapshot:
    """Two robots at rest that are told to walk at 0.5 m/s."""
    rest = rewards.Snapshot(
        command=torch.tensor([[0.5, 0.0, 0.0]] * 2),
        moving=torch.tensor([True, True]),
        linear_velocity=torch.zeros(2, 3),
        angular_velocity=torch.zeros(2, 3),
        up=torch.tensor([[0.0, 0.0, 1.0]] * 2),
        height_error=torch.zeros(2),
        torque_share=torch.zeros(2, JOINTS),
        joint_deviation=torch.zeros(2, JOINTS),
        sideways_deviation=torch.zeros(2, 2),
        contact=torch.zeros(2, 2, dtype=torch.bool),
        joint_acceleration=torch.zeros(2, JOINTS),
        action_change=torch.zeros(2, JOINTS),
        one_group=torch.tensor([False, False]),
        unsync=torch.zeros(2),
        in_stance=torch.tensor([[True, False]] * 2),
        landed_air_time=torch.zeros(2, 2),
        fallen=torch.tensor([False, False]),
        blown_up=torch.tensor([False, False]),
    )
    return dataclasses.replace(rest, **changes)


def test_every_weight_is_of_the_function_of_its_name() -> None:
    """A weight without a function would be a reward that nobody pays; a weight of zero costs no time."""
    cfg, robot = rewards.RewardCfg(), find_robot("saturn_lite")
    terms = cfg.terms_for(robot)
    weights = {field.name: getattr(cfg, field.name) for field in dataclasses.fields(cfg) if field.name != "own"}
    assert {name: weight for name, (_, weight) in terms.items()} == {name: by for name, by in weights.items() if by}
    assert all(term is getattr(rewards, name) for name, (term, _) in terms.items())
    assert "trot" not in rewards.RewardCfg(trot=0.0).terms_for(robot)


def test_tracking_pays_by_the_error() -> None:
    """exp(-0.25/0.1) at rest, exp(-0.01/0.1) at 0.1 m/s short, sideways drift counts alike."""
    moving = torch.tensor([[0.4, 0.0, 0.0], [0.5, 0.1, 0.0]])
    assert rewards.track_linear(snapshot())[0].item() == pytest.approx(math.exp(-2.5))
    assert rewards.track_linear(snapshot(linear_velocity=moving)).tolist() == pytest.approx([math.exp(-0.1)] * 2)
    turning = torch.tensor([[0.0, 0.0, 0.5], [9.0, 9.0, 0.0]])
    assert rewards.track_angular(snapshot(angular_velocity=turning)).tolist() == pytest.approx([math.exp(-1.0), 1.0])


def test_the_clock_pays_feet_that_are_all_where_it_has_them() -> None:
    """Left down and right up is paid; both down, as in standing, is not; told to stand nothing is."""
    s = snapshot(contact=torch.tensor([[True, False], [True, True]]))
    assert rewards.clock(s).tolist() == [1.0, 0.0]
    assert rewards.clock(dataclasses.replace(s, moving=torch.tensor([False, False]))).tolist() == [0.0, 0.0]


def test_a_robot_with_two_feet_is_paid_by_its_clock() -> None:
    """With a gait_period by the clock, without by single stance; the clock of a robot without one is refused."""
    biped = find_robot("g1")
    clocked = dataclasses.replace(biped, gait_period=0.8)
    plain = dataclasses.replace(biped, gait_period=None)
    for robot, clock, single in ((clocked, 1.0, 0.0), (plain, 0.0, 1.0)):
        cfg = rewards.RewardCfg().for_robot(robot)
        assert (cfg.trot, cfg.unsync, cfg.clock, cfg.single_stance) == (0.0, 0.0, clock, single)
        assert ("clock" in cfg.terms_for(robot)) == (clock > 0)
    with pytest.raises(StictionError, match=r"give its robot\.yaml a gait_period"):
        rewards.RewardCfg(trot=0.0, unsync=0.0, clock=1.0).terms_for(plain)


def test_gait_is_paid_only_while_moving() -> None:
    """A robot that is told to stand is not paid for stepping in place."""
    s = snapshot(
        one_group=torch.tensor([True, True]), unsync=torch.tensor([0.5, 0.5]), moving=torch.tensor([True, False])
    )
    assert rewards.trot(s).tolist() == [1.0, 0.0]
    assert rewards.unsync(s).tolist() == [0.5, 0.0]


def test_air_time_is_credited_at_touch_down_and_capped() -> None:
    """0.25 s earns 0.10, 0.9 s earns the cap 0.20, 0.05 s costs 0.10, a foot that did not land nothing."""
    s = snapshot(landed_air_time=torch.tensor([[0.25, 0.0], [0.9, 0.05]]))
    assert rewards.air_time(s).tolist() == pytest.approx([0.10, 0.20 - 0.10])


def test_penalties_by_hand() -> None:
    """Sums of squares over the right entries."""
    s = snapshot(
        linear_velocity=torch.tensor([[9.0, 9.0, 2.0]] * 2),
        angular_velocity=torch.tensor([[1.0, 2.0, 9.0]] * 2),
        up=torch.tensor([[0.3, 0.4, 0.866]] * 2),
        height_error=torch.tensor([-0.1, 0.1]),
        joint_deviation=torch.tensor([[1.0, 5.0, 5.0, 2.0, 5.0, 5.0]] * 2),
        sideways_deviation=torch.tensor([[1.0, 2.0]] * 2),
        torque_share=torch.full((2, JOINTS), 0.5),
        action_change=torch.full((2, JOINTS), 2.0),
        joint_acceleration=torch.full((2, JOINTS), 10.0),
        fallen=torch.tensor([True, False]),
        moving=torch.tensor([True, False]),
    )
    expected = {
        "vertical_velocity": 4.0,
        "roll_pitch_rate": 5.0,
        "orientation": 0.25,
        "base_height": 0.01,
        "torque": 1.5,
        "action_rate": 24.0,
        "joint_acceleration": 600.0,
        "hip_deviation": 5.0,
        "fall": 1.0,
        "stand_still": 0.0,
    }
    for name, value in expected.items():
        assert getattr(rewards, name)(s)[0].item() == pytest.approx(value), name
    assert rewards.stand_still(s)[1].item() == pytest.approx(23.0)
