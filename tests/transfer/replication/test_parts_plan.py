"""The parts of the comparison: whether what they walk is what the sentences ask about."""

from dataclasses import replace
from itertools import product

import pytest

from bundles import make_bundle, make_contract
from stiction.formats.bundle import Bundle, read_bundle
from stiction.transfer.grid.plan import Walk, plan
from stiction.transfer.grid.table import rows_of
from stiction.transfer.metrics import Metrics
from stiction.transfer.replication.claims import judge_all
from stiction.transfer.replication.evidence import Evidence
from stiction.transfer.replication.plan import Part, Size, conventional, parts_of

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

FLAT = ("none", "direct", "deception", "finetune", "iterative", "compensation")
NET = {"name": "net", "sha256": "0" * 64}
"""An Actuator Net as a contract names it."""


@pytest.fixture(scope="module")
def bundles(tmp_path_factory: pytest.TempPathFactory) -> list[Bundle]:
    """Three seeds of every way that a sentence names, on flat ground and, of those that it has there, on stairs."""
    still = read_bundle(make_bundle(tmp_path_factory.mktemp("b") / "still", make_contract()))
    made = [(way, {"method": way}, "flat") for way in FLAT]
    made += [("actuator", {"actuator": NET}, ground) for ground in ("flat", "stairs")]
    made += [("deception", {"method": "deception"}, "stairs")]
    return [
        replace(
            still, name=f"{way}-{ground}-{seed}", contract=replace(still.contract, seed=seed, terrain=ground, **more)
        )
        for (way, more, ground), seed in product(made, (0, 1, 2))
    ]


def worth(walk: Walk) -> Metrics:
    """Return what any walk is worth: on a course it is crossed."""
    crossed = None if walk.terrain == "flat" else 1.0
    speed = None if walk.command == "stand" else 0.9
    return Metrics(speed, 0.1, 0.0, 4.0, 1.0, 50.0, 0.8, 0.0, (0.4, 0.4), 1.0, steps_climbed=crossed, crossed=crossed)


def walked(part: Part, bundles: list[Bundle]) -> list[dict]:
    """Return the rows of a part of which every walk went the same."""
    taken = [bundle for bundle in bundles if part.takes(bundle.contract)]
    walks = plan([bundle.name for bundle in taken], part.grid)
    if part.forward:
        fed = [walk for walk in plan([b.name for b in taken if conventional(b.contract)], part.grid)]
        walks += [replace(walk, forward=(1.0,) * 18) for walk in fed if not walk.place.is_batch]
    return rows_of({walk: worth(walk) for walk in walks}, taken)[1]


@pytest.mark.parametrize("size", ["quick", "full"])
def test_every_sentence_is_asked_of_walks_that_are_planned(size: Size, bundles: list[Bundle]) -> None:
    """A part that is trimmed would leave a sentence `not tested`, whatever is walked."""
    evidence = Evidence.of(row for part in parts_of(size, 2) for row in walked(part, bundles))
    verdicts, _ = judge_all(evidence)
    left = [verdict.id for verdict in verdicts if verdict.outcome == "not tested"]
    assert len(verdicts) == 29 and left == ([] if size == "full" else ["X4"])


def test_causes_are_told_apart_on_the_same_robots() -> None:
    """Friction alone on other robots than all the rest alone would be a difference between robots."""
    parts = {part.name: part for part in parts_of("full")}
    assert parts["causes"].grid.robots == parts["robot"].grid.robots
    assert {*parts["causes"].grid.levels_of_robots} <= {*parts["robot"].grid.levels_of_robots}
