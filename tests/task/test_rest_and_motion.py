"""Friction at rest and in motion, drawn for every robot: bounds by hand, ranges, checkpoints, and joints that hold."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from stiction.core.decode import from_plain
from stiction.core.errors import StictionError
from stiction.joints.friction import Law
from stiction.learning.run import load_checkpoint, save_checkpoint
from stiction.robots.catalog import find_robot
from stiction.sim.fleet import BASE_DOFS, Fleet, JointFriction
from stiction.task.config import TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg
from task.test_env import make

BOTH = FrictionCfg("deception", level=0.1, law="stribeck", static_ratio=(1.2, 1.8), stribeck_velocity=(0.05, 0.3))


def test_each_robot_has_its_own_bound_by_hand() -> None:
    """2 N m: of ratio 1.5 and 0.1 rad/s 3 at rest, 2 + 1/e at v_s, 2 far above; of 2 and 0.2 rad/s 4, 2 + 2/e, 2."""
    fleet = Fleet(find_robot("go1"), 2)
    friction = JointFriction(fleet, Law("stribeck"))
    numbers = {"static_ratio": np.array([[1.5], [2.0]]), "stribeck_velocity": np.array([[0.1], [0.2]])}
    friction.set_level(np.full((2, 12), 2.0), numbers=numbers)
    fleet.joint_velocity[:] = 0.0
    fleet.joint_velocity[:, 1] = [0.1, -0.2]
    fleet.joint_velocity[:, 2] = 5.0
    friction.act(fleet)
    expected = [[3.0, 2.0 + np.exp(-1.0), 2.0], [4.0, 2.0 + 2.0 * np.exp(-1.0), 2.0]]
    np.testing.assert_allclose(fleet.friction[:, :3], expected, rtol=1e-12)
    # Another robot's numbers stay where one is drawn anew.
    friction.set_level(np.full((1, 12), 2.0), ids=np.array([1]), numbers={"static_ratio": np.array([[1.0]])})
    assert fleet.friction[0, 0] == pytest.approx(3.0) and fleet.friction[1, 0] == pytest.approx(2.0)


def test_both_are_drawn_once_for_a_robot() -> None:
    """At rest a robot's joints hold its level times its ratio; ratios fill 1.2 to 1.8, and follow no level."""
    env = make(num_envs=256, friction=BOTH)
    law = env.host.law
    level, numbers = law.levels[0], law.numbers[0]
    for name, (low, high) in {"static_ratio": (1.2, 1.8), "stribeck_velocity": (0.05, 0.3)}.items():
        drawn = numbers[name]
        assert np.ptp(drawn, axis=1).max() == 0.0 and low - 1e-6 <= drawn.min() and drawn.max() <= high + 1e-6
        assert np.ptp(drawn[:, 0]) > 0.9 * (high - low)
        assert abs(np.corrcoef(drawn[:, 0], level[:, 0])[0, 1]) < 0.2
    env.fleet.joint_velocity[:] = 0.0
    law.act(env.fleet)
    np.testing.assert_allclose(env.fleet.friction, level * numbers["static_ratio"])
    env.fleet.joint_velocity[:] = 10.0
    law.act(env.fleet)
    np.testing.assert_allclose(env.fleet.friction, level)


def test_joints_differ_only_where_their_friction_does() -> None:
    """`per` joint: each joint has its own ratio; a spread is of the level alone."""
    by_joint = make(num_envs=16, friction=replace(BOTH, per="joint")).host.law.numbers[0]["static_ratio"]
    assert np.ptp(by_joint, axis=1).min() > 0.1
    spread = make(num_envs=16, friction=replace(BOTH, spread=(0.5, 1.5))).host.law
    assert np.ptp(spread.numbers[0]["static_ratio"], axis=1).max() == 0.0
    assert np.ptp(spread.levels[0], axis=1).min() > 0.0


def test_one_number_draws_nothing_and_shifts_no_draw() -> None:
    """Robots of one ratio are those of Coulomb's law, draw for draw; so are all others of a range's."""
    plain, fixed, drawn = (
        make(num_envs=8, friction=cfg).randomizer.draws
        for cfg in (replace(BOTH, law="coulomb"), replace(BOTH, static_ratio=1.5, stribeck_velocity=0.1), BOTH)
    )
    assert (fixed.static_ratio == 1.5).all() and drawn.static_ratio.unique().numel() == 8
    for name, value in vars(plain).items():
        assert name in ("static_ratio", "stribeck_velocity") or torch.equal(value, getattr(drawn, name))
        assert name in ("static_ratio", "stribeck_velocity") or torch.equal(value, getattr(fixed, name))


def test_a_checkpoint_has_every_robots_law(tmp_path: Path) -> None:
    """Restored into other robots, the next steps are the same to the bit."""
    env, other = make(friction=BOTH), LocomotionEnv(TaskCfg("go1", friction=BOTH), 4, seed=2)
    actions = 0.3 * torch.randn(4, 4, 12, generator=torch.Generator().manual_seed(0))
    env.step(actions[0])
    save_checkpoint(tmp_path / "env.safetensors", env.state())
    other.load_state(load_checkpoint(tmp_path / "env.safetensors"))
    for action in actions[1:]:
        first, second = (one.step(action)[0]["proprioception"] for one in (env, other))
        assert torch.equal(first, second)


@pytest.mark.parametrize("speed", [0.01, 0.1])
def test_a_joint_holds_below_its_friction_at_rest_and_slides_above(speed: float) -> None:
    """Level 10 %, ratio 1.5: under 0.9 of that at rest, 1.35 times that in motion, it creeps by 3 mrad in 2 s."""
    spec, joints = find_robot("saturn_lite"), np.arange(find_robot("saturn_lite").num_joints)
    turned = {}
    for share in (0.9, 1.1):
        fleet = Fleet(spec, len(joints))
        level = 0.1 * spec.joint_values("torque_limit")
        numbers = {
            "static_ratio": np.full((len(joints), 1), 1.5),
            "stribeck_velocity": np.full((len(joints), 1), speed),
        }
        JointFriction(fleet, Law("stribeck", 3.0, 1.0)).set_level(np.tile(level, (len(joints), 1)), numbers=numbers)
        fleet.set_gravity((0.0, 0.0, 0.0))
        fleet.base_position[:, 2] += 1.0
        fleet.clamp(~np.eye(len(joints), dtype=bool), base=range(BASE_DOFS))
        fleet.set_gains(np.zeros_like(fleet.friction), np.zeros_like(fleet.friction))
        fleet.simulation.bind("qfrc_applied")[joints, BASE_DOFS + joints] = share * 1.5 * level
        before = fleet.joint_position[joints, joints].copy()
        for _ in range(100):
            fleet.step()
        turned[share] = np.abs(fleet.joint_position[joints, joints] - before)
    assert turned[0.9].max() < 0.004 and turned[1.1].min() > 0.1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"static_ratio": (1.8, 1.2)}, "friction static_ratio: got"),
        ({"static_ratio": (1.2, 11.0)}, "static ratio 11"),
        ({"static_ratio": 0.5}, "static ratio 0.5"),
        ({"stribeck_velocity": (0.0, 0.1)}, "Stribeck velocity 0.0"),
        ({"stribeck_velocity": (0.1,)}, "friction stribeck_velocity: got"),
    ],
)
def test_a_range_that_makes_no_law_is_refused(words: dict, message: str) -> None:
    """In one line that names the number."""
    with pytest.raises(StictionError, match=message):
        replace(BOTH, **words)


def test_a_range_is_read_from_plain_data() -> None:
    """As in a training.json and a run's config.json, of this version and of older ones, which have one number."""
    plain = {"level": 0.1, "law": "stribeck", "static_ratio": [1.2, 1.8], "stribeck_velocity": [0.05, 0.3]}
    assert from_plain(FrictionCfg, plain) == BOTH and BOTH.joint_law == Law("stribeck", 1.5, 0.175)
    assert from_plain(FrictionCfg, plain | {"static_ratio": 2}).static_ratio == 2.0
    assert replace(BOTH, law="coulomb").drawn_numbers == {}
