"""Walks a grid on all cores, resumable: what its ledger has is not walked again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from stiction.formats.bundle import Bundle
from stiction.formats.errors import StictionError
from stiction.transfer.engines.catalog import what_is_missing
from stiction.transfer.grid.config import ALONE, GridCfg
from stiction.transfer.grid.forward import forwarded
from stiction.transfer.grid.known import informed
from stiction.transfer.grid.ledger import Ledger
from stiction.transfer.grid.plan import Unit, Walk, plan, units
from stiction.transfer.grid.walk import walk_unit
from stiction.transfer.metrics import Metrics
from stiction.transfer.rollout import robot_of
from stiction.transfer.workers import spread

LEDGER = "walks.jsonl"
"""Name of the ledger in the folder of the results."""

BENCHES = "bench"
"""Name of the folder beside it for what was identified of virtual robots, where friction is fed forward or told."""

Progress = Callable[[str, float], None]
"""Called with the name of an engine and the share of its walks that is done."""


def walk_grid(
    bundles: Sequence[Bundle],
    cfg: GridCfg,
    out: Path,
    jobs: int = 1,
    robot: str | None = None,
    progress: Progress = lambda name, share: None,
) -> dict[Walk, Metrics]:
    """Walk what is not in the ledger of `out` yet, and return every walk of the grid, those of one row together.

    Args:
        bundles: checked, each of another name.
        cfg: the grid.
        out: folder of the results; it exists.
        jobs: processes at once. They do not change the result.
        robot: a robot of one's own, see `robot_of`.
        progress: see `Progress`.

    Raises:
        StictionError: a bundle does not fit its robot, an engine is not installed, friction cannot be fed forward, or a
            process was killed. What was walked until then is kept.

    """
    for bundle in bundles:
        spec = robot_of(bundle.contract, robot)
        for place in cfg.places:
            if not place.is_batch and (why := what_is_missing(ALONE[place.engine], spec)):
                raise StictionError(why)
    ledger = Ledger(out / LEDGER, cfg, {bundle.name: bundle.digest for bundle in bundles}, robot)
    walks = plan([bundle.name for bundle in bundles], cfg)
    walks += forwarded(bundles, cfg, out / BENCHES, jobs, robot, progress)
    walks = informed(walks, bundles, cfg, out / BENCHES, jobs, robot, progress)
    done = {walk: found for walk in walks if (found := ledger.find(walk)) is not None}
    tally = _Tally(walks, progress)
    tally.add(list(done))
    new = [unit for unit in units(walks, cfg) if any(walk not in done for walk in unit.walks)]
    by_name = {bundle.name: bundle for bundle in bundles}
    for unit, metrics in _walked(new, by_name, cfg, robot, jobs):
        ledger.add(unit.walks, metrics)
        tally.add([walk for walk in unit.walks if walk not in done])
        done |= dict(zip(unit.walks, metrics, strict=True))
    return {walk: done[walk] for walk in walks}


class _Tally:
    """Counts walks by engine."""

    def __init__(self, walks: Sequence[Walk], progress: Progress) -> None:
        """Begin with nothing done."""
        self._total, self._done, self._progress = Counter(walk.place.label for walk in walks), Counter[str](), progress

    def add(self, walks: Sequence[Walk]) -> None:
        """Count walks as done and report each engine that they are of."""
        self._done.update(walk.place.label for walk in walks)
        for name in dict.fromkeys(walk.place.label for walk in walks):
            self._progress(name, self._done[name] / self._total[name])


def _walked(
    new: Sequence[Unit], bundles: dict[str, Bundle], cfg: GridCfg, robot: str | None, jobs: int
) -> Iterator[tuple[Unit, list[Metrics]]]:
    """Do units and give each as it ends."""
    tasks = [(bundles[unit.policy], unit, cfg, robot) for unit in new]
    for number, metrics in spread(walk_unit, tasks, jobs):
        yield new[number], metrics
