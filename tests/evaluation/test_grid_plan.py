"""Plan of a grid: its walks, and the conditions that it rejects."""

import pytest

from stiction.core.errors import StictionError
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.grid import GridCfg, Simulator, parse_simulator, plan, units

BASE = EvaluationCfg((0.0, 0.2), ("vx=0.5", "stand"), episodes=2, seconds=3.0)


def test_every_combination_is_walked_once() -> None:
    """2 policies, 2 levels, 2 commands, 2 episodes in the batch; with 2 robots in each cell of the virtual one."""
    cfg = GridCfg(BASE, ("mujoco", "physx+all"), robots=(7, 8), robot_levels=("0.1", "bench+0.02"))
    walks = plan(["a", "b"], cfg)
    assert len(walks) == len(set(walks)) == 2 * (2 * 2 * 2 + 2 * 2 * 2 * 2)
    virtual = [walk for walk in walks if walk.simulator.cell]
    assert {(walk.law, walk.level) for walk in virtual} == {("real", "0.1"), ("real", "bench+0.02")}
    assert {walk.robot for walk in virtual} == {7, 8}
    assert {walk.robot for walk in walks if not walk.simulator.cell} == {None}


def test_a_batch_is_one_cell_of_a_policy_and_the_slow_engine_begins() -> None:
    """Units in the batch have the two episodes of a level and command; the slow engine begins."""
    cfg = GridCfg(BASE, ("mujoco", "ode"))
    planned = units(plan(["a"], cfg), cfg)
    assert [len(unit.walks) for unit in planned] == [1] * 8 + [2] * 4
    assert planned[0].simulator == Simulator("ode") and all(
        len({walk.cell for walk in unit.walks}) == 1 for unit in planned
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gazebo", "known: mujoco, mujoco-alone, physx"),
        ("phsyx", "did you mean 'physx'"),
        ("no_such_module:ENGINE", "cannot be imported"),
        ("physx+everything", "unknown group 'everything'"),
        ("mujoco+all", "expected mujoco-alone[+]all"),
        ("physx+", "unknown group ''"),
    ],
)
def test_a_place_that_is_none_is_refused(text: str, message: str) -> None:
    """Rejects unknown places; the message lists the known ones."""
    with pytest.raises(StictionError, match=message):
        parse_simulator(text)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"engines": ()}, "at least one"),
        ({"engines": ("physx", "physx")}, "each once"),
        ({"robots": (1, 1)}, "each once"),
        ({"robot_levels": ("2",)}, "up to 0.9"),
        ({"robot_levels": ("0.1", "0.10")}, "each once"),
        ({"terrains": ("stairs=1",)}, "expected flat"),
        ({"terrains": ("stairs=0.1",), "base": EvaluationCfg((0.0,), ("stand",))}, "leads over it"),
        ({"engines": ("physx",), "base": EvaluationCfg(action_delay=0.01)}, "action delay"),
        ({"engines": ("physx+all",), "base": EvaluationCfg(friction_law="load")}, "robot-levels"),
    ],
)
def test_a_grid_that_cannot_be_walked_is_refused_before_it_begins(changes: dict, message: str) -> None:
    """Rejects impossible grids before the first walk."""
    with pytest.raises(StictionError, match=message):
        GridCfg(**changes)
