"""Parts that are not asked for: what was walked of them stands, and is never replaced by less."""

from dataclasses import replace
from pathlib import Path

import pytest

from bundles import make_bundle, make_contract, make_network
from stiction.core.errors import StictionError
from stiction.evaluation import benches
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.grid import GridCfg, plan, plan_forward
from stiction.evaluation.metrics import Metrics
from stiction.evaluation.run import WalkLedger
from stiction.evaluation.samples import samples
from stiction.evaluation.table import rows_of
from stiction.files.bundle import Bundle, read_bundle
from stiction.files.joints import Estimate, JointRecord, JointsFile
from stiction.files.observation import proprioception
from stiction.files.results import write_summary
from stiction.robots.catalog import find_robot
from stiction.virtual.bench import Bench
from stiction_experiments.lab.evidence import Evidence
from stiction_experiments.replication import run as walked
from stiction_experiments.replication.page import run_blocks, warnings
from stiction_experiments.replication.plan import Part, Size, parts_of
from stiction_experiments.replication.run import TOLD, part_from_ledger, planned_rows, replicate, rows_in, walk_part

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

FLAT = GridCfg(EvaluationCfg((0.0, 0.1), ("vx=0.5",), episodes=2, seconds=1.0, settle=0.0), ("mujoco",))
METRICS = Metrics(0.9, 0.1, 0.0, 4.0, 1.0, 50.0, 0.8, 0.0, (0.4, 0.4), 1.0, 0.45, 0.0, 0.0)
"""What a walk may be worth."""

FIRST, SECOND = (Part(name, f"The {name} part", FLAT) for name in ("first", "second"))


@pytest.fixture
def still(tmp_path: Path) -> Bundle:
    """A bundle that walks nowhere in particular."""
    return read_bundle(make_bundle(tmp_path / "still", make_contract()))


def no_walk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make every walk an error."""
    monkeypatch.setattr("stiction.evaluation.run.walk_unit", lambda *rest: pytest.fail("walked"))


def test_what_was_walked_is_kept_without_walking(
    still: Bundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same rows, and the reader is told; where nothing was walked there is nothing."""
    walked = walk_part(FIRST, [still], tmp_path / "first", 1, lambda *rest: None)
    no_walk(monkeypatch)
    kept = part_from_ledger(FIRST, [still], tmp_path / "first")
    assert kept is not None
    assert (kept.rows, kept.details) == (walked.rows, walked.details)
    assert kept.earlier.startswith("not asked for: 2 of 2 rows")
    assert part_from_ledger(SECOND, [still], tmp_path / "second") is None


def test_a_row_that_lacks_a_walk_is_not_kept(still: Bundle, tmp_path: Path) -> None:
    """Half of its episodes would count as all; a third episode, or another length of them, makes none whole."""
    walk_part(FIRST, [still], tmp_path / "first", 1, lambda *rest: None)
    ledger = tmp_path / "first" / "walks.jsonl"
    lines = ledger.read_text().splitlines(keepends=True)
    ledger.write_text("".join(lines[:-1]))
    kept = part_from_ledger(FIRST, [still], tmp_path / "first")
    assert kept is not None
    assert len(kept.rows) == 1
    assert kept.earlier.startswith("not asked for: 1 of 2 rows")
    longer = replace(FIRST, grid=replace(FLAT, base=replace(FLAT.base, seconds=1.5)))
    assert part_from_ledger(longer, [still], tmp_path / "first") is None


def test_a_part_alone_does_not_replace_the_others(
    still: Bundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both are in the report, in their order; where the other was walked otherwise, the command refuses."""
    parts = (FIRST, SECOND)
    write_summary(tmp_path / "summary.json", replicate([still], parts, tmp_path).plain)
    no_walk(monkeypatch)
    again = replicate([still], parts, tmp_path, asked=["second"])
    assert [(part.name, bool(part.earlier)) for part in again.parts] == [("first", True), ("second", False)]
    assert [len(part.rows) for part in again.parts] == [2, 0]  # the second has the same cells: one row each
    assert again.summary["grids"]["first"]["kept"] == again.parts[0].earlier
    assert again.samples == samples(Evidence.of(again.parts[0].details))
    monkeypatch.undo()
    more = replace(FLAT, base=replace(FLAT.base, episodes=3))
    other = replace(SECOND, grid=replace(FLAT, base=replace(FLAT.base, friction_levels=(0.2,))))
    with pytest.raises(StictionError, match=r"2 rows of the part 'first' .* add first to --parts"):
        replicate([still], (replace(FIRST, grid=more), other), tmp_path, asked=["second"])


def test_no_robot_is_put_on_its_bench_for_a_part_that_is_not_asked_for(
    still: Bundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That takes minutes a robot: its walks with friction fed forward are not there, and the others are."""
    grid = replace(FLAT, engines=("mujoco-alone+all",), robots=(1000,), robot_levels=("0.1",))
    part = replace(FIRST, grid=grid, forward=True)
    ledger = WalkLedger(tmp_path / "walks.jsonl", replace(grid, forward=("still",)), {"still": still.digest})
    walks = plan(["still"], grid)
    ledger.add(tuple(walks), [METRICS] * len(walks))
    monkeypatch.setattr("stiction.virtual.bench.identify_on_bench", lambda *rest: pytest.fail("put on its bench"))
    kept = part_from_ledger(part, [still], tmp_path)
    assert kept is not None
    assert [(row.method, row.episodes) for row in kept.rows] == [("none", 2)]


def test_a_policy_that_is_told_friction_is_told_what_the_bench_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """2.5 N m on a bench is 10 % of the limit of hip and thigh; the nominal friction of its training is 20 %.

    If this failed, it would be told of every virtual robot what its contract says, and the page would not say what.
    """
    kinds = {"hip": 0.2, "thigh": 0.2, "shank": 0.2}
    contract = make_contract(observation=proprioception(18, known_kinds=3), known_friction=kinds)
    told = read_bundle(make_bundle(tmp_path / "told", contract, make_network(contract, gain=1e-3)))

    def make(bench: Bench, folder: Path, workers: int) -> None:
        folder.mkdir(parents=True)
        found = JointRecord(coulomb_friction=Estimate(2.5, 0.1, (2.0, 3.0)))
        JointsFile(dict.fromkeys(bench.spec.joint_names, found)).write(folder / "joints.json")

    monkeypatch.setattr("stiction.virtual.bench.identify_on_bench", make)
    monkeypatch.setattr(benches, "has_entry", lambda folder, key: (folder / "joints.json").is_file())
    grid = replace(FLAT, engines=("mujoco", "mujoco-alone+all"), robots=(3,), robot_levels=("0.3",))
    found = replicate([told], [replace(FIRST, grid=grid)], tmp_path)
    given = {(row["engine"], row["friction_level"]): row["known_friction"] for row in found.parts[0].details}
    assert given["mujoco", 0.1]["data sheet"] == pytest.approx((0.1, 0.1, 0.1))
    ((robot, share),) = next(known for (engine, _), known in given.items() if engine == "mujoco-alone+all").items()
    limits = find_robot("saturn_lite").joint_values("torque_limit")[:3]
    assert robot == "3" and share == pytest.approx(2.5 / limits)
    assert found.summary["told"] == TOLD and TOLD.partition("`")[0] in "".join(run_blocks(found))
    assert part_from_ledger(replace(FIRST, grid=grid), [told], tmp_path / "first") is not None


def test_what_could_not_be_walked_is_said_before_the_numbers(
    still: Bundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A robot that is left out would be missing from one way alone, and nobody would see it; kept or walked now."""
    said = ["Robot 4 is left out"]
    monkeypatch.setattr(
        walked, "forward_notes", lambda bundles, grid, benches: said if benches.parent.name == "first" else []
    )
    for asked in (None, ["second"]):
        result = replicate([still], (FIRST, SECOND), tmp_path, asked=asked)
        assert [part.warnings for part in result.parts] == [said, []]
        assert "The first part. Robot 4 is left out" in warnings(result)


def test_policies_that_fit_no_part_are_refused(still: Bundle, tmp_path: Path) -> None:
    """A page without a row would look like a comparison."""
    with pytest.raises(StictionError, match="no policy fits any part"):
        replicate([still], (replace(FIRST, stairs=True), SECOND), tmp_path, asked=["first"])


def test_what_is_no_report_is_not_replaced(still: Bundle, tmp_path: Path) -> None:
    """A summary of something else is in the way."""
    (tmp_path / "summary.json").write_text("[]")
    with pytest.raises(StictionError, match="is no summary of `stiction replicate`"):
        replicate([still], (FIRST, SECOND), tmp_path, asked=["second"])


def test_a_report_is_not_replaced_by_less(still: Bundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another preset, or fewer policies, in the folder of a full comparison would leave its verdicts without rows."""
    write_summary(tmp_path / "summary.json", replicate([still], (FIRST, SECOND), tmp_path).plain)
    no_walk(monkeypatch)
    levels, episodes = (
        replace(FIRST, grid=replace(FLAT, base=replace(FLAT.base, **change)))
        for change in ({"friction_levels": (0.0,)}, {"episodes": 1})
    )
    stairs = replace(FIRST, stairs=True)
    renamed = replace(still, name="other")
    for bundle, parts, lost in (
        (still, (levels,), 1),
        (still, (episodes,), 2),
        (renamed, (FIRST,), 2),
        (still, (stairs, replace(SECOND, grid=levels.grid)), 1),
    ):
        with pytest.raises(StictionError, match=rf"has {lost} rows of the part 'first' .*; give another --out"):
            replicate([bundle], parts, tmp_path)
    assert len(replicate([still], (stairs, SECOND), tmp_path).parts) == 1  # the same rows, in the other part


def test_rows_are_planned_as_they_will_be_written(still: Bundle, tmp_path: Path) -> None:
    """A planned row with another key would count as lost, or lost rows as planned."""
    levels = ("0.1", "bench", "bench+0.02")
    grid = replace(FLAT, engines=("mujoco", "mujoco-alone+all"), robots=(1000, 1001), robot_levels=levels)
    part = replace(FIRST, grid=grid)
    walks = plan([still.name], grid)
    assert planned_rows(part, [still]) == rows_in(rows_of(dict.fromkeys(walks, METRICS), [still])[1])
    only = replace(part, forward=True, grid=replace(grid, forward_only=True))
    assert {key[:3] for key in planned_rows(only, [still])} == {
        *(
            (f"still+{way}", "mujoco-alone+all", law)
            for way in ("forward", "reference", "measured")
            for law in ("real", "real-bench", "real-bench+load0.02")
        ),
        *((f"still+{way}", "mujoco", "coulomb") for way in ("forward", "reference", "measured")),
    }


@pytest.mark.parametrize("size", ["quick", "full"])
def test_what_is_fed_forward_is_walked_plain_in_another_part(size: Size) -> None:
    """Walked plain twice it costs hours on a core; walked plain nowhere it has nothing to stand beside."""
    parts = {part.name: part for part in parts_of(size)}
    # Plain walks know no way to feed, and go by the first name of those.
    grid = replace(parts["forward"].grid, forward=("a",), forward_by=("error",))
    beside = set(plan(["a"], parts["robot"].grid))
    assert plan(["a"], grid) == []
    assert plan_forward(grid) and set(plan_forward(grid)) <= beside
