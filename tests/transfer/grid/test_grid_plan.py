"""Which walks a grid consists of, and what it refuses."""

import pytest

from stiction.formats.errors import StictionError
from stiction.transfer.evaluate import EvaluationCfg
from stiction.transfer.grid.config import GridCfg, Place, parse_place
from stiction.transfer.grid.plan import plan, units

BASE = EvaluationCfg((0.0, 0.2), ("vx=0.5", "stand"), episodes=2, seconds=3.0)


def test_every_combination_is_walked_once() -> None:
    """2 policies, 2 levels, 2 commands, 2 episodes in the batch; with 2 robots in each cell of the virtual one."""
    cfg = GridCfg(BASE, ("mujoco", "physx+all"), robots=(7, 8), robot_levels=("0.1", "bench+0.02"))
    walks = plan(["a", "b"], cfg)
    assert len(walks) == len(set(walks)) == 2 * (2 * 2 * 2 + 2 * 2 * 2 * 2)
    virtual = [walk for walk in walks if walk.place.cell]
    assert {(walk.law, walk.level) for walk in virtual} == {("real", "0.1"), ("real", "bench+0.02")}
    assert {walk.robot for walk in virtual} == {7, 8}
    assert {walk.robot for walk in walks if not walk.place.cell} == {None}


def test_a_cell_without_friction_has_level_zero_alone() -> None:
    """The nominal robot walked at every level would be the same robot again."""
    walks = plan(["a"], GridCfg(BASE, ("physx+nominal",), robots=(7,)))
    assert {(walk.law, walk.level) for walk in walks} == {("coulomb", "0")}


def test_stairs_are_walked_by_the_commands_that_lead_over_them() -> None:
    """To stand before stairs tells nothing."""
    walks = plan(["a"], GridCfg(BASE, terrains=("flat", "stairs=0.1")))
    assert {walk.command for walk in walks if walk.terrain == "stairs=0.1"} == {"vx=0.5"}
    assert {walk.command for walk in walks if walk.terrain == "flat"} == {"vx=0.5", "stand"}


def test_a_batch_is_one_level_of_a_policy_and_the_slow_engine_begins() -> None:
    """Two cores would wait for ODE at the end; a unit in the batch has commands times episodes walks."""
    found = units(plan(["a"], GridCfg(BASE, ("mujoco", "ode"))))
    assert [len(unit.walks) for unit in found] == [1] * 8 + [4] * 2
    assert found[0].place == Place("ode")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gazebo", "expected mujoco"),
        ("physx+everything", "expected some of"),
        ("mujoco+all", "expected mujoco-alone[+]all"),
        ("physx+", "is unknown"),
    ],
)
def test_a_place_that_is_none_is_refused(text: str, message: str) -> None:
    """The message names what there is."""
    with pytest.raises(StictionError, match=message):
        parse_place(text)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"engines": ()}, "at least one"),
        ({"engines": ("physx", "physx")}, "each once"),
        ({"robots": (1, 1)}, "each once"),
        ({"robot_levels": ("2",)}, "up to 0.9"),
        ({"terrains": ("stairs=1",)}, "expected flat"),
        ({"terrains": ("stairs=0.1",), "base": EvaluationCfg((0.0,), ("stand",))}, "leads over it"),
        ({"engines": ("physx",), "base": EvaluationCfg(action_delay=0.01)}, "action delay"),
        ({"engines": ("physx+all",), "base": EvaluationCfg(friction_law="load")}, "robot-levels"),
    ],
)
def test_a_grid_that_cannot_be_walked_is_refused_before_it_begins(changes: dict, message: str) -> None:
    """An hour later is too late."""
    with pytest.raises(StictionError, match=message):
        GridCfg(**changes)
