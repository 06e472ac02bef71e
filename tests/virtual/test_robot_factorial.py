"""Robots drawn from seeds, in cells, at levels."""

from dataclasses import fields, replace

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.robots.catalog import find_robot
from stiction.virtual import hidden as ranges
from stiction.virtual.cases import CELLS, LEVELS, Case, Level, parse_level
from stiction.virtual.hidden import GROUPS, Hidden, Masses, draw

SPEC = find_robot("saturn_lite")


def flat(record: object) -> np.ndarray:
    """Return every number of a record of numbers, arrays and records."""
    parts = [getattr(record, item.name) for item in fields(record)]  # type: ignore[arg-type]
    return np.concatenate([flat(part) if hasattr(part, "__dataclass_fields__") else np.ravel(part) for part in parts])


def test_a_robot_is_within_what_the_ranges_say_and_no_joint_is_like_another() -> None:
    """Friction shares have a mean of one: then a level of 10 % is 10 %."""
    hidden = draw(SPEC, 0)
    for name in ("static_ratio", "stribeck_velocity"):
        values, (low, high) = getattr(hidden.friction, name), ranges.FRICTION[name]
        assert low <= values.min() and values.max() <= high and len(set(values)) == 18
    for name in ("share", "load_share"):
        values, (low, high) = getattr(hidden.friction, name), ranges.FRICTION[name]
        assert values.mean() == pytest.approx(1.0) and values.max() / values.min() < high / low
    for name, (low, high) in ranges.MOTORS.items():
        values = getattr(hidden.motors, name)
        assert low <= values.min() and values.max() <= high and len(set(values)) == 18
    assert ranges.GAP[0] <= hidden.gears.min() and hidden.gears.max() <= ranges.GAP[1]
    assert np.abs(hidden.sensors.encoder_offset).max() <= ranges.ENCODER_OFFSET


def test_groups_are_real_or_perfect_and_nothing_between() -> None:
    """Otherwise a cell would say that it is about friction and differ in the delay."""
    hidden, perfect = draw(SPEC, 1), Hidden.perfect(18)
    for cell, groups in CELLS.items():
        robot = Case(1, cell, Level(0.0)).robot(hidden)
        for group in GROUPS:
            assert getattr(robot, group) is getattr(hidden, group) or group not in groups
            if group not in groups:
                mine, theirs = getattr(robot, group), getattr(perfect, group)
                np.testing.assert_array_equal(
                    *(np.ravel(part) if group == "gears" else flat(part) for part in (mine, theirs))
                )
    assert {name for name in GROUPS} == {item.name for item in fields(Hidden)}
    with pytest.raises(StictionError, match="unknown group 'paint'"):
        hidden.only(("paint",))


def test_a_body_has_the_true_masses_inertias_and_viscous_friction() -> None:
    """And the data sheet's everything else."""
    hidden = replace(Hidden.perfect(18), masses=Masses(1.1, {"thigh": 1.2, "shank": 0.9}, (0.01, 0.0, 0.0)))
    hidden = replace(hidden, motors=replace(hidden.motors, armature=np.full(18, 1.5), damping=np.full(18, 0.5)))
    body = hidden.body(SPEC, fixed=True)
    assert body.spec.mass == pytest.approx(1.1 * 16.4 + 6 * (0.9 + 1.2 * 1.3 + 0.9 * 0.4))
    np.testing.assert_allclose(body.armature, 1.5 * 0.0145)
    np.testing.assert_allclose(body.damping, 0.5 * 0.0704)
    assert body.base_com.tolist() == [0.01, 0.0, 0.0] and body.fixed and body.spec.joints == SPEC.joints
    np.testing.assert_allclose(body.spec.links[1].inertia, 1.2 * np.array(SPEC.links[1].inertia))


def test_levels_are_fractions_of_the_limit_or_what_the_bench_measured() -> None:
    """The paper's 1 % and its 0.442 N m are two levels, and the load term stands beside the second."""
    assert {"0.01", "bench", "bench+0.02"} < set(LEVELS)
    shank = {text: parse_level(text).coulomb(SPEC)[2] for text in LEVELS}
    assert shank["0.01"] == pytest.approx(0.45) and shank["bench"] == shank["bench+0.02"] == 0.442
    assert parse_level("bench").coulomb(SPEC)[0] == 0.25
    assert parse_level(" 0.10+0.05") == Level(0.1, 0.05)
    assert [parse_level(text).label for text in LEVELS] == list(LEVELS)
    for text in ("1.5", "-0.1", "bank", "0.1+", "0.1+nan", ""):
        with pytest.raises(StictionError, match="friction level"):
            parse_level(text)
