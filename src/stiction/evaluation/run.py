"""Walks of a grid on all cores, resumable: walks in its ledger made by the same code are not repeated."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from pathlib import Path

from stiction.core.cache import Ledger, key_of
from stiction.core.decode import from_plain
from stiction.core.errors import EngineError
from stiction.core.lock import output_folder
from stiction.core.parallel import spread
from stiction.engines.catalog import binaries, missing_engine
from stiction.evaluation.benches import forward_walks, with_known_friction
from stiction.evaluation.evaluate import WALK_CODE
from stiction.evaluation.grid import GridCfg, Walk, plan, units, walk_unit
from stiction.evaluation.metrics import Metrics
from stiction.files.bundle import Bundle
from stiction.files.contract import robot_of
from stiction.joints.friction import law_source
from stiction.robots.catalog import find_robot


class WalkLedger(Ledger):
    """Ledger of the finished walks of one grid."""

    def __init__(self, path: Path, cfg: GridCfg, digests: dict[str, str], robot: str | None = None) -> None:
        """Read the ledger; digests: policy -> digest of its bundle. Raises `StictionError` for an unreadable file."""
        super().__init__(path)
        self._digests = digests
        spec = None if robot is None else find_robot(robot)
        self._common = key_of([cfg.settings(), law_source(cfg.base.friction_law), robot, spec], *WALK_CODE)

    def key(self, walk: Walk) -> str:
        """Return the key of a walk: bundle, cell, settings, code that measures, engine."""
        engine = binaries(walk.simulator.spec.name)
        return key_of([self._common, asdict(walk), self._digests[walk.policy], engine])[:24]

    def find(self, walk: Walk) -> Metrics | None:
        """Return the metrics of a walk; None where it is not in the ledger."""
        entry = self.get(self.key(walk))
        return None if entry is None else from_plain(Metrics, entry.get("metrics"), f"{LEDGER}, {entry['key']}")

    def add(self, walks: tuple[Walk, ...], metrics: list[Metrics]) -> None:
        """Add walks, which are on the disk when this returns. Raises `FileError` where the file cannot be written."""
        entries = zip(walks, metrics, strict=True)
        self.extend(
            [{"key": self.key(walk), "walk": asdict(walk), "metrics": asdict(result)} for walk, result in entries]
        )


LEDGER = "walks.jsonl"

BENCHES = "bench"
"""Name of the folder next to the ledger for the identification of virtual robots."""

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
    """Run the walks missing from the ledger in `out`; return all walks of the grid, grouped by row.

    bundles: checked, with distinct names; jobs: processes at once, which do not change the result; robot: see
    `robot_of`. Raises `StictionError` for an unfit bundle, a missing engine and killed processes; the ledger keeps the
    finished walks.
    """
    for bundle in bundles:
        spec = robot_of(bundle.contract, robot)
        for simulator in cfg.simulators:
            if not simulator.is_batch and (why := missing_engine(simulator.spec.name, spec)):
                raise EngineError(why)
    with output_folder(out):
        ledger = WalkLedger(out / LEDGER, cfg, {bundle.name: bundle.digest for bundle in bundles}, robot)
        walks = plan([bundle.name for bundle in bundles], cfg)
        walks += forward_walks(bundles, cfg, out / BENCHES, jobs, robot, progress)
        walks = with_known_friction(walks, bundles, cfg, out / BENCHES, jobs, robot, progress)
        done = {walk: result for walk in walks if (result := ledger.find(walk)) is not None}
        total, finished = Counter(walk.simulator.label for walk in walks), Counter[str]()

        def report(new: Iterable[Walk]) -> None:
            count = Counter(walk.simulator.label for walk in new)
            finished.update(count)
            for name in count:
                progress(name, finished[name] / total[name])

        report(done)
        new = [unit for unit in units(walks, cfg) if any(walk not in done for walk in unit.walks)]
        by_name = {bundle.name: bundle for bundle in bundles}
        for number, metrics in spread(walk_unit, [(by_name[unit.policy], unit, cfg, robot) for unit in new], jobs):
            ledger.add(new[number].walks, metrics)
            report(walk for walk in new[number].walks if walk not in done)
            done |= dict(zip(new[number].walks, metrics, strict=True))
    return {walk: done[walk] for walk in walks}
