"""Which walks a grid consists of, and what it refuses."""

from dataclasses import replace

import pytest

from stiction.core.errors import StictionError
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.grid import BATCH_SECONDS, GridCfg, Simulator, parse_simulator, plan, plan_forward, units

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


def test_a_cell_without_friction_has_level_zero_alone() -> None:
    """The nominal robot walked at every level would be the same robot again."""
    walks = plan(["a"], GridCfg(BASE, ("physx+nominal",), robots=(7,)))
    assert {(walk.law, walk.level) for walk in walks} == {("coulomb", "0")}


def test_stairs_are_walked_by_the_commands_that_lead_over_them() -> None:
    """To stand before stairs tells nothing."""
    walks = plan(["a"], GridCfg(BASE, terrains=("flat", "stairs=0.1")))
    assert {walk.command for walk in walks if walk.terrain == "stairs=0.1"} == {"vx=0.5"}
    assert {walk.command for walk in walks if walk.terrain == "flat"} == {"vx=0.5", "stand"}


def test_a_batch_is_one_cell_of_a_policy_and_the_slow_engine_begins() -> None:
    """Two cores would wait for ODE at the end; a unit in the batch has the two episodes of a level and command."""
    cfg = GridCfg(BASE, ("mujoco", "ode"))
    found = units(plan(["a"], cfg), cfg)
    assert [len(unit.walks) for unit in found] == [1] * 8 + [2] * 4
    assert found[0].simulator == Simulator("ode") and all(
        len({walk.cell for walk in unit.walks}) == 1 for unit in found
    )


def test_an_interruption_loses_seconds_of_a_batch_not_all_of_it() -> None:
    """Of 40 walks of 20 s, 16 make up 320 robot-seconds; stairs at 0.5 m/s last 24.4 s, 13 of them fit."""
    cfg = GridCfg(EvaluationCfg((0.1,), ("vx=0.5",), episodes=40), terrains=("flat", "stairs=0.1"))
    found = {unit.walks: unit.walks[0].terrain for unit in units(plan(["a"], cfg), cfg)}
    sizes = {ground: sorted(len(walks) for walks in found if found[walks] == ground) for ground in cfg.terrains}
    assert sizes == {"flat": [8, 16, 16], "stairs=0.1": [1, 13, 13, 13]} and BATCH_SECONDS == 320.0
    for walks in found:
        assert [walk.episode for walk in walks] == list(range(walks[0].episode, walks[0].episode + len(walks)))
    assert sum(map(len, found)) == 80


def test_single_robots_are_bounded_by_no_memory() -> None:
    """A hundred hours at three levels at once would be a million robot-seconds, one by one they are a long wait."""
    cfg = GridCfg(EvaluationCfg((0.1, 0.2, 0.3), ("vx=0.5",), episodes=100, seconds=3600.0), ("mujoco", "physx"))
    assert {len(unit.walks) for unit in units(plan(["a"], cfg), cfg)} == {1}


def test_how_long_a_walk_lasts_is_its_own_commands_affair() -> None:
    """Beside a slower command a walk over stairs would last longer, and its row be another one."""
    cfg = GridCfg(EvaluationCfg((0.1,), ("vx=0.5", "vx=0.25")), terrains=("stairs=0.1",))
    fast, slow = (cfg.cell("stairs=0.1", command).duration for command in ("vx=0.5", "vx=0.25"))
    assert slow == pytest.approx(2 * fast) and fast == pytest.approx(24.4)


def test_a_grid_of_what_is_fed_forward_alone_leaves_the_plain_walks_to_another() -> None:
    """A part of the comparison would walk again, for hours, what the part before it has; other policies walk plain."""
    cfg = GridCfg(BASE, ("mujoco", "physx"), forward=("a",))
    assert {walk.policy for walk in plan(["a", "b"], cfg)} == {"a", "b"}
    only = replace(cfg, forward_only=True)
    assert {walk.policy for walk in plan(["a", "b"], only)} == {"b"}
    assert plan_forward(only) == plan_forward(cfg)
    assert {(walk.policy, walk.simulator.engine) for walk in plan_forward(only)} == {("a", "mujoco"), ("a", "physx")}
    assert len(plan_forward(only)) == 2 * 2 * 2 * 2


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
    """The message names what there is."""
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
    """An hour later is too late."""
    with pytest.raises(StictionError, match=message):
        GridCfg(**changes)
