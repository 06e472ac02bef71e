"""Boxes against height fields: both are the same stairs, or their speeds could not be compared."""

import json

import mujoco
import numpy as np
import pytest

from stiction.cli.main import main
from stiction.robots.catalog import find_robot
from stiction.robots.terrain import LANDING, REACH, TREAD
from stiction_experiments.throughput.measure import GROUNDS, STEP, ground_model


def height(model: mujoco.MjModel, x: float) -> float:
    """Return where a ray from above meets the ground, beside the robot."""
    data = mujoco.MjData(model)
    data.qpos[2] = -5.0
    mujoco.mj_forward(model, data)
    hit = np.array([-1], np.int32)
    return 3.0 - mujoco.mj_ray(model, data, np.array([x, 0.8, 3.0]), np.array([0.0, 0.0, -1.0]), None, 1, -1, hit, None)


@pytest.mark.parametrize("ground", GROUNDS[1:])
def test_all_are_the_same_stairs(ground: str) -> None:
    """On the middle of the first, the third and the sixth tread, and on the landing."""
    model = ground_model(find_robot("go1"), ground)
    treads = [-REACH + 0.5 * TREAD, REACH - 2.5 * TREAD, -LANDING - 0.5 * TREAD, 0.0]
    assert [height(model, x) for x in treads] == pytest.approx([STEP, 3 * STEP, 6 * STEP, 6 * STEP], abs=1e-6)


def test_the_command_prints_ratios(capsys: pytest.CaptureFixture) -> None:
    """The choice of boxes could not be checked on another machine."""
    assert main(["bench", "--ground", "--robot", "go1", "--num-envs", "2", "--blocks", "1", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["over_plane"]["plane"] == 1.0 and set(printed["over_plane"]) == set(GROUNDS)
