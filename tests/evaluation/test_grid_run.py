"""A grid is walked, interrupted, continued, and turned into rows."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from bundles import make_bundle, make_contract, make_network
from stiction.core.errors import StictionError
from stiction.evaluation import grid as plan
from stiction.evaluation import run
from stiction.evaluation.evaluate import EvaluationCfg, evaluate_bundle
from stiction.evaluation.grid import GridCfg
from stiction.evaluation.metrics import Metrics
from stiction.evaluation.run import LEDGER, walk_grid
from stiction.evaluation.samples import samples_of
from stiction.evaluation.table import Sample, methods_of, rows_of
from stiction.files.bundle import Bundle, read_bundle
from stiction.files.observation import proprioception
from stiction.files.results import ResultRow

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

BASE = EvaluationCfg((0.0, 0.2), ("vx=0.5",), episodes=2, seconds=1.5, settle=0.5)
ENGINES = ("mujoco", "mujoco-alone", "mujoco-alone+all")
GRID = GridCfg(BASE, ENGINES, robots=(3,), robot_levels=("0.1",))


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """A bundle whose network hardly moves: the robot stands."""
    contract = make_contract()
    return read_bundle(make_bundle(tmp_path_factory.mktemp("b") / "still", contract, make_network(contract, gain=1e-3)))


@pytest.fixture(scope="module")
def walked(still: Bundle, tmp_path_factory: pytest.TempPathFactory):
    """The whole grid, walked once, and the folder of its ledger."""
    out = tmp_path_factory.mktemp("out")
    return walk_grid([still], GRID, out), out


def test_a_row_for_every_cell(still: Bundle, walked) -> None:
    """Engine, law and level as they are looked for in results.csv."""
    rows, details = rows_of(walked[0], [still])
    labels = [(row.engine, row.friction_law, row.friction_level, row.episodes) for row in rows]
    plain = [(engine, "coulomb", level, 2) for engine in ENGINES[:2] for level in (0.0, 0.2)]
    assert labels == [*plain, ("mujoco-alone+all", "real", 0.1, 2)]
    assert details[0]["fall_interval"] == (0.0, pytest.approx(3.8415 / 5.8415, abs=1e-4))
    assert list(details[-1]["robots"]) == ["3"]


def test_the_batch_is_the_evaluation_as_it_was(still: Bundle, walked) -> None:
    """A grid of one batch gives the rows of `evaluate_bundle`."""
    rows, _ = rows_of(walked[0], [still])
    before = evaluate_bundle(still, BASE).rows
    for row, old in zip(rows, before, strict=False):
        assert row.speed_ratio == pytest.approx(old.speed_ratio, abs=1e-4)
        assert row.joint_jitter == pytest.approx(old.joint_jitter, rel=1e-3)


def test_a_batch_in_parts_is_the_batch(still: Bundle, walked, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An episode has its own start and noise, whichever part of the batch it walks in; on stairs as well."""
    monkeypatch.setattr(plan, "BATCH_SECONDS", 1.0)
    done = walk_grid([still], replace(GRID, engines=("mujoco",)), tmp_path)
    assert len((tmp_path / LEDGER).read_text().splitlines()) == 4
    for walk, metrics in done.items():
        assert metrics.joint_jitter == pytest.approx(walked[0][walk].joint_jitter, rel=1e-3)
        assert metrics.distance == pytest.approx(walked[0][walk].distance, abs=1e-5)
    first, second = (done[walk].joint_jitter for walk in list(done)[:2])
    assert abs(first - second) > 0.01 * first
    base = EvaluationCfg((0.1,), ("vx=2",), episodes=2, terrain="stairs=0.1")
    both = evaluate_bundle(still, base).episodes[0]
    (last,) = evaluate_bundle(still, replace(base, episodes=1, first_episode=1)).episodes[0]
    assert last.joint_jitter == pytest.approx(both[1].joint_jitter, rel=1e-3) != both[0].joint_jitter


def test_nothing_is_walked_twice(still: Bundle, walked, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same command reads its ledger; a changed setting walks again."""
    monkeypatch.setattr(run, "walk_unit", lambda *arguments: pytest.fail("walked again"))
    assert walk_grid([still], GRID, walked[1]) == walked[0]
    with pytest.raises(pytest.fail.Exception):
        walk_grid([still], replace(GRID, base=replace(BASE, seed=1)), walked[1])


def test_an_interrupted_grid_goes_on(still: Bundle, walked, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Finished walks are kept, a truncated line of the ledger is dropped, and the rest is walked."""
    lines = (walked[1] / LEDGER).read_text().splitlines(keepends=True)
    (tmp_path / LEDGER).write_text("".join(lines[:3]) + lines[3][:40] + "\n")
    count, walk_unit = [], run.walk_unit

    def counted(bundle: Bundle, unit, *rest):
        count.append(len(unit.walks))
        return walk_unit(bundle, unit, *rest)

    monkeypatch.setattr(run, "walk_unit", counted)
    assert walk_grid([still], GRID, tmp_path) == walked[0]
    assert 0 < sum(count) <= len(walked[0]) - 3 + 1


def test_what_is_not_installed_is_said_before_anything_walks(still: Bundle, tmp_path: Path) -> None:
    """A missing engine ends the grid before the first walk."""
    from stiction.engines.catalog import missing_engine
    from stiction.files.contract import robot_of

    if not missing_engine("ode", robot_of(still.contract)):
        pytest.skip("ODE is installed here")
    with pytest.raises(StictionError, match=r"stiction\[engines\]"):
        walk_grid([still], replace(GRID, engines=("mujoco", "ode")), tmp_path)
    assert not (tmp_path / LEDGER).exists()


def means_of(rows: list[ResultRow], bundles: list[Bundle]) -> list[Sample]:
    """Return the speed ratio of every method over its seeds, without other columns."""
    details = [asdict(row) | {"crossed": None} for row in rows]
    return [sample for sample in samples_of(details, methods_of(rows, bundles)) if sample.column == "speed_ratio"]


def test_a_seed_is_one_sample(still: Bundle, walked) -> None:
    """Means over seeds 0.8 and 1.0: 0.9 ± 12.706 · 0.1; one seed has no interval."""
    row = rows_of(walked[0], [still])[0][0]
    bundles = [named(still, f"p{seed}", seed=seed) for seed in (0, 1)]
    rows = [replace(row, policy=f"p{seed}", seed=seed, speed_ratio=0.8 + 0.2 * seed) for seed in (0, 1)]
    (mean,) = means_of(rows, bundles)
    assert (mean.method, mean.seeds, mean.mean, mean.each) == ("none", "0 1", pytest.approx(0.9), "0.8 1")
    assert (mean.low, mean.high) == (pytest.approx(0.9 - 1.2706, abs=1e-3), pytest.approx(0.9 + 1.2706, abs=1e-3))
    assert means_of(rows[:1], bundles)[0].low is None


def named(bundle: Bundle, name: str, **changes: Any) -> Bundle:
    """Return the bundle by another name, with another contract."""
    return replace(bundle, name=name, contract=make_contract(**changes))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"terrain": "stairs"}, ("flat", "stairs")),
        ({"phases": 1}, ("phases not recorded", "one phase")),
        (
            {"friction_law": "stribeck", "stribeck": (1.5, 0.1), "terrain": "stairs"},
            ("flat, coulomb", "stairs, stribeck"),
        ),
        ({"friction_range": (0.0, 0.5)}, ("range 0 to 0", "range 0 to 0.5")),
        ({"observation": proprioception(18, 21)}, ("11 frames", "21 frames")),
        ({"settings": {}}, ("settings not recorded", "")),
    ],
)
def test_policies_of_different_trainings_are_no_seeds_of_each_other(
    still: Bundle, walked, changes: dict, words: tuple[str, str]
) -> None:
    """Policies for stairs and for flat ground have separate means and intervals."""
    row = rows_of(walked[0], [still])[0][0]
    bundles = [named(still, "a"), named(still, "b", seed=1, **changes)]
    rows = [
        replace(row, policy=name, method=f"none{fed}", seed=seed, speed_ratio=float(seed))
        for fed in ("", "+forward")
        for seed, name in enumerate((f"a{fed}", f"b{fed}"))
    ]
    means = means_of(rows, bundles)
    told = [f" ({word})" if word else "" for word in words]
    assert [mean.method for mean in means] == [f"none{fed}{word}" for fed in ("", "+forward") for word in told]
    assert [(mean.seeds, mean.mean) for mean in means] == [("0", 0.0), ("1", 1.0)] * 2


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (({"dreamwaq.beta": 1.0}, {"dreamwaq.beta": 1}), ("", "")),
        (({}, {"dreamwaq.beta": 1.0}), (" (dreamwaq.beta 0.35)", " (dreamwaq.beta 1)")),
        (
            ({"num-envs": 4}, {"num-envs": 4, "a": 1, "b": 2, "c": 3, "d": "$|<b>"}, {"e": 1}),
            (" (num-envs 4)", " (a 1, b 2, c 3, 2 more)", " (e 1)"),
        ),
        ((None, {"a": "$|<b>"}, {}), (" (settings not recorded)", " (a \\u0024\\u007c\\u003cb\\u003e)", " (a null)")),
    ],
)
def test_methods_say_in_which_settings_bundles_differ(
    still: Bundle, walked, settings: tuple[dict, ...], words: tuple[str, ...]
) -> None:
    """Methods name the settings in which bundles differ; seeds of one training share a name."""
    row = rows_of(walked[0], [still])[0][0]
    bundles = [named(still, f"p{seed}", seed=seed, settings=setting) for seed, setting in enumerate(settings)]
    methods = methods_of([replace(row, policy=bundle.name) for bundle in bundles], bundles)
    assert [*methods.values()] == [f"none{word}" for word in words]


def test_a_virtual_robot_is_one_sample_of_a_rate(still: Bundle) -> None:
    """Rate of three robots, one fallen in both walks and one in one of two: 1.5 of 3, in three trials."""
    cfg = GridCfg(BASE, ("mujoco-alone+all",), robots=(3, 4, 5), robot_levels=("0.1",))
    fell = {3: (1.0, 1.0), 4: (0.0, 1.0), 5: (0.0, 0.0)}
    worth = Metrics(0.9, 0.1, 0.0, 4.0, 1.0, 50.0, 0.8, 0.0, (0.4, 0.4), 1.0, 0.45, 0.0, 0.0)
    done = {
        walk: replace(
            worth,
            fall_rate=fell[walk.robot][walk.episode],
            crossed=1.0 - fell[walk.robot][walk.episode],
            tracking_error=0.5 * walk.robot + walk.episode,
            speed_ratio=0.2 * walk.robot + 0.1 * walk.episode,
            mean_vx=0.1 * walk.robot + 0.05 * walk.episode,
        )
        for walk in plan.plan(["still"], cfg)
    }
    (row,), (detail,) = rows_of(done, [still])
    # Wilson by hand, p = 1/2, n = 3: 1/2 -+ z/(1 + z^2/n) sqrt(1/(4 n) + z^2/(4 n^2)) = 1/2 -+ z/(2 sqrt(n + z^2)).
    half = 1.959964 / (2 * (3 + 1.959964**2) ** 0.5)
    assert detail["fall_rate"] == 0.5
    assert detail["fall_interval"] == pytest.approx((0.5 - half, 0.5 + half))
    assert detail["crossed_interval"] == pytest.approx((0.5 - half, 0.5 + half))
    assert list(detail["robots"]) == ["3", "4", "5"]
    # Means over two episodes of 0.6 and 0.7, and of 1.0 and 1.1: the mean of all would follow.
    assert (row.slowest, row.speed_ratio, row.fastest) == pytest.approx((0.65, 0.85, 1.05))
    # Of the six walks, the first of robot 3.
    assert row.slowest_walk == detail["slowest_walk"] == pytest.approx(0.6)
    assert (detail["robot_fall_rates"], detail["robot_crossed"]) == ([1.0, 0.5, 0.0], [0.0, 0.5, 1.0])
    assert detail["robot_tracking_errors"] == [2.0, 2.5, 3.0]
