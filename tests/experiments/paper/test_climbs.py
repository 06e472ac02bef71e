"""Stairs of the report: which walks, and which rows they become."""

from pathlib import Path
from types import SimpleNamespace

from stiction_experiments.paper import climbs
from stiction_experiments.paper.climbs import STAIRS, Climbed, climb
from stiction_experiments.paper.plan import TRAININGS


def test_ten_walks_of_every_height_by_trainings_on_stairs():
    """Criteria ask for 8 of 10 walks: ten in ODE without friction, five on each of two robots under their own."""
    webots, robots = STAIRS
    known = {training.name for training in TRAININGS if not training.walks_flat}
    assert {*webots.trainings, *robots.trainings} == known
    cfg = webots.grid("0")
    assert (cfg.engines, cfg.base.friction_levels, cfg.base.episodes) == (("ode-webots",), (0.0,), 10)
    assert cfg.terrains == ("stairs=0.04", "stairs=0.08", "stairs=0.12", "stairs=0.16")
    cfg = robots.grid("bench")
    assert (cfg.robots, cfg.robot_levels, cfg.base.episodes) == ((3000, 3001), ("bench",), 5)


def test_rows_of_walks_become_rows_of_stairs(tmp_path: Path, monkeypatch):
    """Each policy, level and height is a row, with the share of its walks that crossed."""
    walked = []
    monkeypatch.setattr(climbs, "walk_grid", lambda bundles, cfg, folder, jobs, progress: walked.append(folder))
    details = [{"policy": "p", "terrain": "stairs=0.08", "crossed": 0.9}]
    monkeypatch.setattr(climbs, "rows_of", lambda done, bundles: ([], details))
    bundle = SimpleNamespace(name="p", contract=SimpleNamespace(seed=11))
    rows = climb("stairs-net", [bundle], STAIRS[1], tmp_path, 1, lambda name, share: None)
    assert rows == [Climbed("stairs-net", 11, "robots", level, 0.08, 0.9) for level in ("bench", "0.2")]
    assert walked == [tmp_path / "bench", tmp_path / "0.2"]
