"""The maker's numbers of joints: order, sign and zero by hand, and back again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bundles import make_bundle, make_contract, make_golden, make_network
from stiction.core.errors import StictionError
from stiction.deploy.vendor import VendorMap, write_maker_targets
from stiction.files.bundle import read_bundle
from stiction.robots.catalog import find_robot
from stiction.robots.model import Vendor


def test_a_reversed_order_with_signs_and_zeros_by_hand() -> None:
    """The first joint is the maker's last, turned round and 0.5 rad off: 0.2 rad is -0.2 + 0.5 there."""
    robot = find_robot("go1")
    names = tuple(reversed(robot.joint_names))
    vendor = Vendor(names, (1.0,) * 11 + (-1.0,), (0.0,) * 11 + (0.5,))
    maker = VendorMap(make_contract("go1", anatomy=replace(robot, vendor=vendor)))
    angles = np.arange(12) / 10 + 0.2
    maker_angles = maker.to_maker(angles)
    assert maker.order[-1] == "FR_hip_joint" and maker_angles[-1] == pytest.approx(0.3)
    np.testing.assert_allclose(maker_angles[:-1], angles[:0:-1])
    np.testing.assert_allclose(maker.from_maker(maker_angles), angles)
    np.testing.assert_allclose(maker.from_maker(maker.to_maker(np.tile(angles, (3, 1)))), np.tile(angles, (3, 1)))


def test_without_a_protocol_it_is_refused() -> None:
    """Our own order would be believed to be the maker's."""
    with pytest.raises(StictionError, match="not in the contract; say vendor in"):
        VendorMap(make_contract())


def test_what_was_not_walked_is_not_played(tmp_path: Path) -> None:
    """Readings that drive the policy to its clips are answered with targets that throw the legs about."""
    contract = make_contract("go1", anatomy=find_robot("go1"))
    golden = make_golden(contract, make_network(contract))
    bundle = read_bundle(make_bundle(tmp_path / "toy", contract))
    walked = np.arange(len(golden)) < 480
    golden.target[480:] = 99.0
    write_maker_targets(replace(bundle, vectors=replace(golden, walked=walked)), tmp_path / "targets.csv")
    lines = (tmp_path / "targets.csv").read_text().splitlines()
    assert len(lines) == 481 and "99.0" not in lines[-1] and lines[-1].startswith("9.58")
