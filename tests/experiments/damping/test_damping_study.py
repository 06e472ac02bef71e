"""The study of damping: its cases show what theory says, on joints, nets, draws and whole robots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bundles import make_bundle, make_contract, make_network, with_limits
from stiction.core.errors import StictionError
from stiction.deploy.check import check_bundle
from stiction.robots.catalog import find_robot
from stiction_experiments.damping.joint import (
    FRICTION,
    LATE,
    LIMIT,
    SHARP,
    DampingCfg,
    SwapRow,
    draw_rows,
    net_rows,
    swap_rows,
)

SHORT = DampingCfg(
    seconds=0.6,
    friction_levels=(0.1,),
    efforts=(0.0, 0.2),
    limits=(1.0, 0.5),
    periods=(0.001, 0.002, 0.01),
    draws=4,
)


@pytest.fixture(scope="module")
def rows() -> list[SwapRow]:
    """Every case of Saturn Lite's shank."""
    return list(swap_rows("saturn_lite", SHORT))


def pick(rows: list[SwapRow], case: str, swap: str = "half of k·kd to B") -> dict[float, SwapRow]:
    """Return level -> row of one case and swap."""
    return {row.level: row for row in rows if (row.case, row.swap) == (case, swap)}


def test_dry_friction_keeps_the_motion_and_a_torque_limit_does_not(rows: list[SwapRow]) -> None:
    """The paper's sentence, and its first limit."""
    assert pick(rows, FRICTION)[0.1].position_difference < 1e-12
    assert pick(rows, FRICTION)[0.1].amplitude > 0.1
    assert pick(rows, LIMIT)[0.5].position_difference > 0.01
    assert pick(rows, LIMIT, "B × 1.2")[0.5].position_difference < 1e-3


def test_a_sampled_controllers_difference_is_in_proportion_to_its_period(rows: list[SwapRow]) -> None:
    """Half a period of lateness takes k kd T/2 off the inertia: twice the period is twice the difference."""
    sharp = pick(rows, SHARP)
    assert sharp[0.002].position_difference == pytest.approx(2 * sharp[0.001].position_difference, rel=0.1)
    late = pick(rows, LATE)
    assert late[0.001].position_difference == pytest.approx(3 * sharp[0.001].position_difference, rel=0.15)


def test_a_net_needs_the_viscous_friction_of_its_side() -> None:
    """Motor side beside the joint's own B, output side beside none: these two move like the joint, no other does."""
    rows = {(row.log, row.simulated): row for row in net_rows("saturn_lite", SHORT) if row.friction_level == 0.0}
    right = {("motor_side", "own"), ("output_side", "dropped")}
    assert {key for key, row in rows.items() if row.position_difference < 1e-9} == right
    assert {key for key, row in rows.items() if abs(row.total - row.true_total) < 1e-9} == right
    assert rows["output_side", "own"].total == pytest.approx(2.5 + 2 * 0.0704)


def test_drawing_both_is_drawing_one() -> None:
    """The same sums make the same joints, where the equation holds; B alone makes hardly any difference."""
    rows = {(row.situation, row.drawn): row for row in draw_rows("saturn_lite", SHORT)}
    alone = rows["free", "kd alone, same sums"]
    assert alone.pair_difference is not None and alone.pair_difference < 1e-12
    assert alone.spread == pytest.approx(rows["free", "B and kd"].spread)
    assert rows["free", "B alone"].pair_difference is None
    assert rows["free", "B alone"].spread < 0.1 * alone.spread
    assert rows["torque limit", "kd alone, same sums"].pair_difference > 1e-6


@pytest.mark.parametrize("change", [{"step": 0.0}, {"draws": 1}, {"seconds": 0.1}])
def test_what_cannot_be_studied_is_refused(change: dict) -> None:
    """One clear line before anything is computed."""
    with pytest.raises(StictionError, match=r"expected|known"):
        DampingCfg(**change)
    with pytest.raises(StictionError, match="unknown kind of joint 'knee'; known: hip, thigh, shank"):
        next(swap_rows("saturn_lite", DampingCfg(joint="knee")))


def test_walks_that_end_before_anything_counts_are_refused() -> None:
    """The first 2 s do not count."""
    pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")
    from stiction_experiments.damping.robot import WalkCfg

    with pytest.raises(StictionError, match="over 2 s"):
        WalkCfg(seconds=2.0)


def test_the_training_simulator_sees_one_number_in_the_air() -> None:
    """MuJoCo has joint damping and controller damping apart; the hanging robot moves alike all the same."""
    pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")
    from stiction_experiments.damping.robot import air_row

    row = air_row("go1", 0.05, DampingCfg(seconds=0.4))
    assert (row.free_robots, row.limited_robots, row.saturated_share) == (1, 0, 0.0)
    assert row.free_difference is not None and row.free_difference < 1e-12
    assert 1e-12 < row.twin_difference < 1e-7


@pytest.mark.parametrize(("gain", "limited"), [(0.001, False), (1.0, True)])
def test_walking_robots_part_only_at_their_limits(tmp_path: Path, gain: float, limited: bool) -> None:
    """A nearly silent network keeps its motors under their limits, a loud one does not, unless they are lifted."""
    pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")
    from stiction_experiments.damping.robot import WalkCfg, walk_rows

    # A loud network's targets are within these limits.
    contract = make_contract(with_limits(find_robot("saturn_lite"), "wide", -9.0, 9.0))
    bundle = check_bundle(make_bundle(tmp_path / "toy", contract, make_network(contract, gain=gain))).bundle
    cfg = WalkCfg(friction_levels=(0.1,), commands=("vx=0.5",), episodes=2, seconds=2.1)
    (row,) = walk_rows(bundle, cfg, lift=False)
    assert (row.limited_robots, row.free_robots) == ((2, 0) if limited else (0, 2))
    if limited:
        assert row.limited_difference is not None and row.limited_difference > 1e-3
        (lifted,) = walk_rows(bundle, cfg, lift=True)
        assert (lifted.limits, lifted.limited_robots) == ("lifted", 0)
        assert lifted.free_difference is not None and lifted.free_difference < 1e-9
    else:
        assert row.free_difference is not None and row.free_difference < 1e-9
    assert np.isfinite([row.speed, row.speed_swapped]).all()
