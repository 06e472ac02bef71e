"""Which robots there are: drawn from seeds, in cells, at levels."""

from dataclasses import fields, replace

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.engines.engine import Motion
from stiction.robots.catalog import find_robot
from stiction.virtual import hidden as ranges
from stiction.virtual.cases import CELLS, LEVELS, Case, Level, factorial, parse_level
from stiction.virtual.hidden import GROUPS, Hidden, Masses, draw

SPEC = find_robot("saturn_lite")


def flat(record: object) -> np.ndarray:
    """Return every number of a record of numbers, arrays and records."""
    parts = [getattr(record, item.name) for item in fields(record)]  # type: ignore[arg-type]
    return np.concatenate([flat(part) if hasattr(part, "__dataclass_fields__") else np.ravel(part) for part in parts])


def test_a_seed_is_a_robot() -> None:
    """The same one every time, another one for another seed."""
    np.testing.assert_array_equal(flat(draw(SPEC, 3)), flat(draw(SPEC, 3)))
    assert (flat(draw(SPEC, 3)) != flat(draw(SPEC, 4))).sum() > 100


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


def test_every_robot_of_the_experiment_is_there_once() -> None:
    """Two robots without friction and two at each level above zero; none of them twice under different names."""
    cases = factorial([7, 8])
    assert len(cases) == 2 * (2 + 2 * (len(LEVELS) - 1))
    assert len({case.label for case in cases}) == len(cases)
    assert [case.label for case in factorial([7], ("0", "0.1"))] == [
        "nominal--0--7",
        "friction--0.1--7",
        "rest--0--7",
        "all--0.1--7",
    ]
    alone = [case.label for case in factorial([7], ("0", "0.1"), ("all",))]
    assert alone == ["all--0--7", "all--0.1--7"]
    parts = [case.label for case in factorial([7], ("0", "0.1"), ("nominal", "delays", "friction+delays"))]
    assert parts == ["nominal--0--7", "delays--0--7", "friction+delays--0.1--7"]


def test_a_cell_without_friction_takes_no_level() -> None:
    """A row that says 20 % and has none would spoil every table."""
    with pytest.raises(StictionError, match="cell 'rest' has no friction"):
        Case(0, "rest", Level(0.2))
    with pytest.raises(StictionError, match="unknown group 'everything'"):
        Case(0, "everything", Level(0.2))


def test_a_level_scales_friction_and_nothing_else() -> None:
    """Ratios and speeds of the Stribeck curve are the robot's, the same at every level."""
    hidden, none = draw(SPEC, 2), np.zeros(18)
    still = Motion(**{part.name: none for part in fields(Motion)})
    bounds = [Case(2, "all", Level(share)).friction(hidden, SPEC, 0.001).bound(still, none) for share in (0.1, 0.2)]
    np.testing.assert_allclose(bounds[1], 2 * bounds[0])
    limit = SPEC.joint_values("torque_limit")
    sliding = (
        Case(2, "all", Level(0.1)).friction(hidden, SPEC, 0.001).bound(replace(still, joint_velocity=none + 9.0), none)
    )
    assert (sliding / limit).mean() == pytest.approx(0.1)
    np.testing.assert_allclose(bounds[0] / sliding, hidden.friction.static_ratio)
