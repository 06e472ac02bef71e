"""The ground: what the formulas say of its height is what the simulator's boxes have."""

import mujoco
import numpy as np
import pytest

from stiction.robots.catalog import find_robot
from stiction.robots.terrain import (
    CELL,
    KINDS,
    LANDING,
    RAMP,
    REACH,
    SLABS,
    STEPS,
    TREAD,
    WIDTH,
    Terrain,
    slope_height,
    stair_height,
)
from stiction.sim.fleet import Fleet

GO1 = find_robot("go1")


def make(kind: str, difficulty: float, seed: int = 0) -> Fleet:
    """Return a fleet of two robots on courses of one kind, laid out by a seed."""
    fleet = Fleet(GO1, 2, terrain=Terrain(np.full(2, KINDS.index(kind))))
    uniform = np.random.default_rng(seed).random((2, SLABS, 4))
    fleet.place_terrain(np.arange(2), np.array([difficulty, 0.5 * difficulty]), uniform)
    return fleet


def drop(fleet: Fleet, robot: int, point: np.ndarray) -> float:
    """Return the height at which a vertical ray from above meets the ground of one robot's world, the robot aside."""
    fleet.base_position[robot, 2] = -5.0
    model, data = fleet.data(robot)
    world = np.array([model.geom_bodyid[i] == 0 for i in range(model.ngeom)])
    model.geom_group[:] = np.where(world, 0, 5)
    hit = np.array([-1], np.int32)
    groups = np.array([1, 0, 0, 0, 0, 0], np.uint8)
    above = np.array([*point, 5.0])
    return 5.0 - mujoco.mj_ray(model, data, above, np.array([0.0, 0.0, -1.0]), groups, 1, -1, hit, None)


@pytest.mark.parametrize("kind", ["stairs", "slope", "rough"])
def test_the_height_is_that_of_the_boxes(kind: str) -> None:
    """Elevation map, height of the base and curriculum would describe another ground than is walked on."""
    fleet = make(kind, 0.5)
    rng = np.random.default_rng(1)
    points = rng.uniform(-3.0, 3.0, (2, 40, 2))
    if kind == "rough":  # at the middle of its cells the table is exact, but for a slab's edge that crosses the cell
        points = (np.floor(points / CELL) + 0.5) * CELL
    heights = fleet.terrain.height(points)
    missed = [
        abs(drop(fleet, robot, point) - heights[robot, index]) > 1e-6
        for robot in range(2)
        for index, point in enumerate(points[robot])
    ]
    assert np.ptp(heights) > 0.03 and sum(missed) <= (4 if kind == "rough" else 0)


def test_stairs_by_hand() -> None:
    """One tread beyond the foot is one step up, the landing six; the corner counts by its farther coordinate."""
    x = np.array([REACH + 0.01, REACH - 0.01, REACH - TREAD - 0.01, LANDING - 0.01, 0.0])
    points = np.stack((x, np.zeros(5)), -1)[None]
    assert stair_height(points, np.array([[0.1]]))[0] == pytest.approx([0.0, 0.1, 0.2, 0.1 * STEPS, 0.1 * STEPS])
    corner = np.array([[[REACH - 0.01, REACH - TREAD - 0.01]]])
    assert stair_height(corner, np.array([[0.1]]))[0, 0] == pytest.approx(0.1)


def test_slopes_by_hand() -> None:
    """Half way down a slope is half its height, and beyond its side nothing."""
    angle = np.array([[0.3]])
    half_way = LANDING + RAMP / 2 * np.cos(0.3)
    points = np.array([[[half_way, 0.0], [-half_way, 0.0], [0.0, 0.0], [0.0, WIDTH + 0.1]]])
    top = RAMP * np.sin(0.3)
    assert slope_height(points, angle)[0] == pytest.approx([top / 2, top / 2, top, 0.0])


def test_a_robot_stands_on_its_own_step() -> None:
    """A robot would fall through its landing, or stand on the other robot's."""
    fleet = make("stairs", 0.5)
    fleet.base_position[:, 2] += fleet.terrain.height(np.zeros((2, 1, 2)))[:, 0]
    fleet.ground[:] = fleet.terrain.height(np.zeros((2, 1, 2)))[:, 0]
    for _ in range(50):
        fleet.step()
    height = fleet.base_position[:, 2] - GO1.standing_height
    assert height == pytest.approx(STEPS * 0.2 * np.array([0.5, 0.25]), abs=0.05)
    assert not fleet.fallen().any()
