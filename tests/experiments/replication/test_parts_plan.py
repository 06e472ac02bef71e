"""The parts of the comparison: whether what they walk is what the sentences ask about."""

from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest

from bundles import make_bundle, make_contract
from stiction.core.statistics import wilson
from stiction.evaluation.grid import Walk, plan
from stiction.evaluation.metrics import Metrics
from stiction.evaluation.policies import FED_BY
from stiction.evaluation.table import rows_of
from stiction.files.bundle import Bundle, read_bundle
from stiction_experiments.friction.claims import STATIONARY
from stiction_experiments.friction.manifest import Run
from stiction_experiments.lab.claims import STABLE
from stiction_experiments.lab.evidence import Evidence
from stiction_experiments.replication.claims import judge_all
from stiction_experiments.replication.criteria import HALF
from stiction_experiments.replication.plan import (
    ACTUATOR_RUNS,
    LOOP_SEEDS,
    SEEDS,
    Part,
    Size,
    actuator_run,
    comparison_runs,
    conventional,
    parts_of,
)
from stiction_experiments.replication.run import check_methods
from stiction_experiments.stairs.climb import ENOUGH

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

SIZES: tuple[Size, ...] = ("quick", "full")
"""The presets."""

NET = {"name": "net", "sha256": "0" * 64}
"""An Actuator Net as a contract names it."""

JOINTS = {"name": "joints.json", "sha256": "0" * 64}
"""A file of identified joints."""


@pytest.fixture(scope="module")
def bundles(tmp_path_factory: pytest.TempPathFactory) -> list[Bundle]:
    """The policies that the preset `full` trains, and those of the Actuator Net's loop."""
    still = read_bundle(make_bundle(tmp_path_factory.mktemp("b") / "still", make_contract()))
    loops = [actuator_run(Path("net"), *which) for which in product(LOOP_SEEDS, ACTUATOR_RUNS)]
    runs = [*comparison_runs(Path("joints.json")), *loops]
    return [
        replace(still, name=run.name, contract=replace(still.contract, seed=run.seed, **trained_as(run)))
        for run in runs
    ]


def trained_as(run: Run) -> dict:
    """Return what the contract of a run's policy says of its training."""
    words = run.condition.options

    def after(flag: str, default: str) -> str:
        return words[words.index(flag) + 1] if flag in words else default

    method = after("--method", "none")
    low, high = (0.0, 0.0) if method == "none" else (0.2, 0.2) if "--task.friction.range" in words else (0.0, 0.24)
    joints = {"joints_file": JOINTS} if "--joints" in words else {}
    side = {name: side for side, name in ACTUATOR_RUNS.items()}.get(run.condition.name)
    net = {"actuator": NET, "torque_source": side} if side else {}
    trained = {"method": method, "terrain": after("--terrain", "flat"), "friction_range": (low, high)}
    return {**trained, **joints, **net}


def worth(walk: Walk) -> Metrics:
    """Return what any walk is worth: on a course it is crossed."""
    crossed = None if walk.terrain == "flat" else 1.0
    speed = None if walk.command == "stand" else 0.9
    numbers = (0.1, 0.0, 4.0, 1.0, 50.0, 0.8, 0.0, (0.4, 0.4), 1.0, 0.45, 0.0, 0.0)
    return Metrics(speed, *numbers, steps_climbed=crossed, crossed=crossed)


def walked(part: Part, bundles: list[Bundle]) -> list[dict]:
    """Return the rows of a part of which every walk went the same."""
    taken = [bundle for bundle in bundles if part.takes(bundle.contract)]
    walks = plan([bundle.name for bundle in taken], part.grid)
    if part.forward:
        fed = [walk for walk in plan([b.name for b in taken if conventional(b.contract)], part.grid)]
        walks += [replace(walk, forward=(1.0,) * 18, forward_by=by) for by in FED_BY for walk in fed]
    return rows_of({walk: worth(walk) for walk in walks}, taken)[1]


@pytest.mark.parametrize("size", SIZES)
def test_every_sentence_is_asked_of_walks_that_are_planned(size: Size, bundles: list[Bundle]) -> None:
    """A part that is trimmed, or a method with one seed, would leave a sentence `not tested`, whatever is walked."""
    check_methods(bundles)
    evidence = Evidence.of(row for part in parts_of(size, 2) for row in walked(part, bundles))
    verdicts, read = judge_all(evidence)
    left = [verdict.id for verdict in verdicts if verdict.outcome == "not tested"]
    assert len(verdicts) == 32 and left == ["E9"], "E9 is of an Actuator Net's policy for stairs, which no preset has"
    assert {row.claim for row in read if len(row.seeds.split()) < 2} == set()


def test_parts_can_show_what_the_sentences_ask() -> None:
    """Walks and robots that all go well are enough: for 80 % of crossings, under 20 %, and under a third of falls."""
    parts, policies = {part.name: part.grid for part in parts_of("full")}, len(SEEDS)
    for crossings in (policies * parts["stairs"].base.episodes, len(parts["stairs-robot"].robots)):
        assert wilson(crossings, crossings)[0] > ENOUGH
        assert wilson(0, crossings)[1] < STATIONARY
    assert wilson(0, len(parts["robot"].robots))[1] < STABLE
    for size in SIZES:
        engines = next(part.grid.base for part in parts_of(size) if part.name == "engines")
        walks = policies * engines.episodes
        assert wilson(0, walks)[1] < HALF
        assert wilson(0, walks * len(engines.commands))[1] < STABLE
