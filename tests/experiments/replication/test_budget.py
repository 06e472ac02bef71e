"""The friction budget: where each seed falls under 80 %, and what is said of several."""

import pytest

from stiction.evaluation.samples import Row
from stiction.robots.catalog import find_robot
from stiction_experiments.lab.evidence import Evidence
from stiction_experiments.replication.budget import beside_forward, budget, onsets

SPEC = find_robot("saturn_lite")


def curve(method: str, seed: int, ratios: dict[float, float], engine: str = "physx", law: str = "coulomb") -> list[Row]:
    """Return rows of both directions; backward is 0.1 slower."""
    return [
        {"method": method, "engine": engine, "friction_law": law, "friction_level": level, "terrain": "flat"}
        | {"seed": seed, "command": command, "speed_ratio": ratio - less}
        for level, ratio in ratios.items()
        for command, less in (("vx=0.5", 0.0), ("vx=-0.5", 0.1))
    ]


def test_the_onset_is_interpolated_for_each_seed() -> None:
    """Backward 1.0, 0.7: it crosses 0.8 at two thirds of 0.1; the other seed 0.9, 0.7 at half: mean 0.0583."""
    rows = curve("none", 0, {0.0: 1.1, 0.1: 0.8, 0.2: 0.4}) + curve("none", 1, {0.0: 1.0, 0.1: 0.8, 0.2: 0.4})
    (onset,) = onsets(Evidence.of(rows), SPEC)
    assert onset.level == pytest.approx((0.2 / 3 + 0.05) / 2)
    assert onset.each == "0.0667 0.05"
    assert onset.dead_band == pytest.approx(onset.level * SPEC.dead_band)
    half = 12.706 * (0.2 / 3 - 0.05) / 2
    assert (onset.low, onset.high) == (
        pytest.approx(onset.level - half, abs=1e-4),
        pytest.approx(onset.level + half, abs=1e-4),
    )


def test_a_seed_that_stays_above_counts_with_what_was_tested() -> None:
    """One good seed of two must not make the way follow to the end: (0.2 + 0.05) / 2, and no interval."""
    rows = curve("none", 0, {0.0: 1.1, 0.1: 1.1, 0.2: 1.1}) + curve("none", 1, {0.0: 1.0, 0.1: 0.8, 0.2: 0.4})
    (onset,) = onsets(Evidence.of(rows), SPEC)
    assert (onset.level, onset.low, onset.each) == (pytest.approx(0.125), None, ">0.2 0.05")
    (alone,) = onsets(Evidence.of(rows[:6]), SPEC)
    assert (alone.level, alone.dead_band, alone.tested) == (None, None, 0.2)


def test_without_friction_nothing_is_fed_forward() -> None:
    """The curve of a policy with friction fed forward begins where the policy itself does."""
    rows = curve("none", 0, {0.0: 1.1}, "physx+rest")
    rows += curve("none+forward", 0, {0.1: 1.1, 0.2: 0.8}, "physx+all", "real")
    results = onsets(Evidence.of(rows), SPEC)
    assert [onset.method for onset in results] == ["none+forward"]
    assert results[0].level == pytest.approx(0.1 + 0.1 * 0.2 / 0.3)


def test_friction_fed_forward_is_held_against_the_same_robots() -> None:
    """`none` reaches 0.9 and 0.3, forward; where friction is fed forward the second robot is missing: 0.8, not 0.5."""

    def on_robots(method: str, *ratios: float) -> list[Row]:
        rows = curve(method, 0, {0.1: sum(ratios) / len(ratios)}, "physx+all", "real")
        for row, less in zip(rows, (0.0, 0.1), strict=True):
            row["robots"] = {str(1000 + number): ratio - less for number, ratio in enumerate(ratios)}
        return rows

    rows = on_robots("none", 0.9, 0.3) + on_robots("none+forward", 1.0) + on_robots("deception", 1.1, 0.8)
    rows += curve("none", 0, {0.1: 0.9}) + curve("none+forward", 0, {0.1: 1.0})
    points = [
        (point.method, round(point.ratio, 6), point.robots, point.left_out)
        for point in beside_forward(Evidence.of(rows))
    ]
    assert points == [
        ("none", 0.8, 1, 1),
        ("none+forward", 0.9, 1, 1),
        ("deception", 1.0, 1, 1),
        ("none", 0.8, 0, 0),
        ("none+forward", 0.9, 0, 0),
    ]
    assert budget(Evidence.of(rows))[0].ratio == pytest.approx(0.5)


def test_a_virtual_robot_begins_with_the_cell_that_has_all_but_friction() -> None:
    """Its levels do not contain zero: without that cell the first one would count as the start."""
    rows = curve("none", 0, {0.0: 1.1}, "physx+rest")
    rows += curve("none", 0, {0.1: 0.9, 0.2: 0.5}, "physx+all", "real")
    by_engine = {onset.engine: onset for onset in onsets(Evidence.of(rows), SPEC)}
    assert list(by_engine) == ["physx+all"]
    assert by_engine["physx+all"].level == pytest.approx(0.1)
