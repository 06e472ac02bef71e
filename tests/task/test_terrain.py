"""Walking on terrain: the curriculum, what is seen of the ground, and that the student sees nothing of it."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch

from stiction.core.errors import StictionError
from stiction.learning.run import load_checkpoint, save_checkpoint
from stiction.robots.terrain import KINDS, REACH
from stiction.task.config import TaskCfg
from stiction.task.env import ELEVATION_SCALE, LocomotionEnv
from stiction.task.terrain import FINISH_MARGIN, LENGTH, SCAN_POINTS, START, Curriculum, TerrainCfg

UNSOUND = [{"speed": (0.3, float("inf"))}, {"elevation_noise": -0.1}, {"heading_gain": float("nan")}]

STAIRS = TerrainCfg(kind="stairs", elevation_noise=0.0)


def make_env(num: int = 8, **changes: object) -> LocomotionEnv:
    """Return a small task on stairs."""
    return LocomotionEnv(TaskCfg(robot="go1", terrain=replace(STAIRS, **changes)), num, 0)


def make_curriculum(**changes: object) -> Curriculum:
    """Return a curriculum of four robots, the first on flat ground, the others on level 5."""
    curriculum = Curriculum(replace(STAIRS, **changes), 4, np.random.default_rng(0))
    curriculum.level[:] = (0, 5, 5, 5)
    return curriculum


def test_levels_follow_the_way_that_was_covered() -> None:
    """Robots would be promoted for standing still, or demoted for walking."""
    curriculum = make_curriculum()
    curriculum.asked[:] = 4.0
    curriculum.covered[:] = (4.0, 3.2, 2.0, 1.5)  # 80 %, 50 %, 37 %
    curriculum.begin(np.arange(4))
    assert curriculum.level.tolist() == [0, 6, 5, 4]
    assert not curriculum.asked.any() and not curriculum.covered.any()


def test_who_falls_is_asked_for_the_rest_of_the_way() -> None:
    """A robot that walks well up to its first step and falls there would be sent to higher ones, again and again.

    All have covered 80 % of what was asked so far. Robot 1 fell with 4 s to go: 1 m of 1 + 0.5 x 4 m is 27 %. Robot 2
    with 1 s to go: 53 %. Robot 3 stands. Of a fall with time for more than the course, the course is asked for.
    """
    curriculum = make_curriculum()
    curriculum.begin(np.arange(4))
    curriculum.asked[:], curriculum.covered[:], curriculum.speed[:] = 1.0, 0.8, 0.5
    curriculum.fall(np.array([False, True, True, False]), np.array([9.0, 4.0, 1.0, 9.0]))
    assert curriculum.asked == pytest.approx([1.0, 3.0, 1.5, 1.0])
    curriculum.begin(np.arange(4))
    assert curriculum.level.tolist() == [0, 4, 5, 6]
    curriculum.speed[:] = 0.5
    curriculum.fall(np.full(4, True), np.full(4, 100.0))
    assert curriculum.asked == pytest.approx(LENGTH)


def test_the_task_tells_the_curriculum_of_falls() -> None:
    """The curriculum would never hear of them. A robot on its side, 20 s before its end, is asked for the course."""
    env = make_env()
    level = env.course.level.copy()
    env.course.covered[:], env.course.asked[:] = 0.5, 0.5
    env.fleet.base_quaternion[-1] = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)
    env.fleet.base_position[-1, 2] = 0.2
    env.course.level[:] = 5 * env.course.on_course
    _, _, dones, extras = env.step(torch.zeros(8, env.num_actions))
    assert dones.tolist() == [False] * 7 + [True] and not extras["time_outs"].any()
    assert env.course.level.tolist() == [0, 0, 5, 5, 5, 5, 5, 4] and level[-1] <= 2


def test_who_has_crossed_is_out_of_time_and_not_fallen() -> None:
    """The value of what would come next would be lost: robots would learn to linger on the last step."""
    env = make_env()
    env.fleet.base_position[-1, :2] = (REACH + FINISH_MARGIN + 0.1) * np.array(
        [np.cos(env.course.heading[-1]), np.sin(env.course.heading[-1])]
    )
    env.fleet.base_position[0, :2] = 5.0  # on flat ground nothing is crossed
    _, _, dones, extras = env.step(torch.zeros(8, env.num_actions))
    assert dones.tolist() == [False] * 7 + [True] and extras["time_outs"].tolist() == [0.0] * 7 + [1.0]
    assert not extras["log"]["walk/falls"]


@pytest.mark.parametrize("kind", ["slopes", "rough", "stairs"])
def test_a_course_begins_beyond_the_start(kind: str) -> None:
    """Robots would start with their feet in the ground, or be told that they had crossed before they were down."""
    env = make_env(kind=kind, first_level=9, num=64)
    course = env.course
    for side in (-1.0, 1.0):
        x = side * (REACH + 1e-6 + np.linspace(0.0, START, 15))
        points = np.stack(np.meshgrid(x, np.linspace(-2.0, 2.0, 41)), -1).reshape(1, -1, 2)
        assert np.abs(course.terrain.height(np.repeat(points, 64, 0))).max() < 1e-9
    for robot in range(64):
        model, data = env.fleet.simulation.materialize(robot)
        mujoco.mj_forward(model, data)
        touched = {model.geom(geom).name for contact in data.contact[: data.ncon] for geom in contact.geom}
        assert not any(name.startswith("obstacle") for name in touched)


def test_the_map_shows_the_ground_ahead() -> None:
    """The teacher would see its stairs in the wrong place, or with the wrong sign."""
    env = make_env()
    env.fleet.place_terrain(np.arange(8), np.full(8, 0.5), np.zeros((8, 24, 4)))
    env.course.heading[:] = 0.0
    env.fleet.reset(np.arange(8), position=np.tile([-(REACH + 0.3), 0.0], (8, 1)))
    seen = env._elevation_group()["elevation"][-1]  # the last robot is on stairs
    ahead = torch.from_numpy(SCAN_POINTS[:, 0]) > 0.3
    step = 0.5 * 0.2
    assert env.course.terrain.kind[-1] == KINDS.index("stairs")
    assert torch.allclose(seen[~ahead], torch.zeros(1), atol=1e-6)
    first_tread = torch.from_numpy((SCAN_POINTS[:, 0] > 0.31) & (SCAN_POINTS[:, 0] < 0.59))
    assert torch.allclose(seen[first_tread], torch.tensor(-step / ELEVATION_SCALE), atol=1e-6)


def test_a_checkpoint_holds_the_ground(tmp_path: Path) -> None:
    """A resumed run would walk on other stairs than it was stopped on."""
    one, other = make_env(kind="mixed", num=12), make_env(kind="mixed", num=12)
    actions = torch.randn(40, 12, one.num_actions, generator=torch.Generator().manual_seed(1))
    for action in actions[:20]:
        one.step(action)
    save_checkpoint(tmp_path / "teacher_000001.safetensors", {"environment": one.state()})
    other.load_state(load_checkpoint(tmp_path / "teacher_000001.safetensors")["environment"])
    for action in actions[20:]:
        left, right = one.step(action), other.step(action)
        assert all(torch.equal(value, right[0][name]) for name, value in left[0].items())
        assert torch.equal(left[1], right[1])


@pytest.mark.parametrize(
    "changes", [{"kind": "lava"}, {"first_level": 30}, {"demote_below": 0.9}, {"speed": (0.5, 0.3)}, *UNSOUND]
)
def test_a_curriculum_that_is_none_is_refused(changes: dict) -> None:
    """The mistake would show after an hour of training."""
    with pytest.raises(StictionError):
        TerrainCfg(**changes)
