"""Early stop: only on a mean, only without falls, only in the last stage."""

import pytest

from stiction.core.errors import StictionError
from stiction.learning.config import StopCfg, TrainCfg
from stiction.learning.health import EarlyStop
from stiction.task.config import TaskCfg
from stiction.task.terrain import TerrainCfg


def row(error: float, falls: float = 0.0, stage: int = 0, **more: float) -> dict[str, float]:
    """Figures of an iteration."""
    return {"walk/tracking_error": error, "walk/falls": falls, "friction/stage": float(stage)} | more


def stops(cfg: StopCfg, rows: list[dict], last_stage: int = 0) -> list[bool]:
    """Say for each iteration whether the phase would end with it."""
    rule = EarlyStop(cfg, last_stage)
    return [rule.check(figures) is not None for figures in rows]


def test_the_mean_of_the_last_iterations_counts() -> None:
    """Means over three: 0.13, 0.11, 0.09. One good iteration is luck."""
    cfg = StopCfg(tracking_error=0.1, iterations=3)
    rows = [row(e) for e in (0.15, 0.13, 0.11, 0.09, 0.07)]
    assert stops(cfg, rows) == [False, False, False, False, True]
    rule = EarlyStop(cfg, 0)
    means = [rule.check(r) for r in rows][-1]
    assert means is not None and means["walk/tracking_error"] == pytest.approx(0.09)


def test_robots_that_fall_have_not_arrived() -> None:
    """A fast, falling policy has a small error while it stands."""
    cfg = StopCfg(tracking_error=0.1, iterations=2, falls=0.01)
    assert stops(cfg, [row(0.05, 0.03), row(0.05, 0.0), row(0.05, 0.02), row(0.05, 0.0)]) == [False, False, True, True]


def test_the_schedule_of_friction_is_gone_through() -> None:
    """A teacher that walks well without friction must still meet it, and be judged with it alone."""
    cfg = StopCfg(tracking_error=0.1, iterations=2)
    rows = [row(0.05, stage=0)] * 3 + [row(0.05, stage=1)] * 3
    assert stops(cfg, rows, last_stage=1) == [False] * 4 + [True] * 2


def test_a_terrain_level_can_be_asked_for() -> None:
    """Else a run on stairs ends on its lowest step. Without levels it is refused before there is a folder."""
    cfg = StopCfg(tracking_error=0.1, iterations=1, terrain_level=2.0)
    levels = [{"terrain/level": value} for value in (1.0, 2.0)]
    assert stops(cfg, [row(0.05, **level) for level in levels]) == [False, True]
    with pytest.raises(StictionError, match="no terrain levels"):
        TrainCfg(stop=cfg)
    assert TrainCfg(stop=cfg, task=TaskCfg(terrain=TerrainCfg(kind="stairs"))).stop is cfg


@pytest.mark.parametrize("bad", [{"tracking_error": 0.0}, {"iterations": 0}, {"falls": -1.0}, {"terrain_level": 2.0}])
def test_targets_that_mean_nothing_are_refused(bad: dict) -> None:
    """A level alone would never stop anything."""
    with pytest.raises(StictionError, match="stop"):
        StopCfg(**bad)


def test_a_loud_walk_does_not_end_a_phase() -> None:
    """Does not count a target that was met with noise: the deployed policy walks without."""
    rule = EarlyStop(StopCfg(tracking_error=0.1, iterations=2), 0, not_before=3)
    assert [rule.check(row(0.05), number) is not None for number in range(6)] == [
        False,
        False,
        False,
        False,
        True,
        True,
    ]
