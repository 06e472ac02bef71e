"""The wear monitor: its features against numbers worked out by hand, its windows, file, and place in a bundle."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from bundles import make_bundle, make_calibration, make_contract, make_golden, make_network, make_wear, repair_sums
from stiction.core.errors import BundleError, StictionError
from stiction.deploy.check import check_bundle
from stiction.deploy.wear import BODY_MOMENTS, JOINT_MOMENTS, Moments, WearMonitor, estimate
from stiction.files.bundle import read_bundle, write_bundle
from stiction.files.contract import Contract
from stiction.files.observation import proprioception
from stiction.files.wear import WearModel


def frame_of(joints: int, angle: float, velocity: float, action: float) -> np.ndarray:
    """A frame of a robot that stands level under no command, all joints alike."""
    parts = [np.zeros(3), np.zeros(2), [0.0], np.zeros(3), [0.0], np.full(joints, angle)]
    return np.concatenate([*parts, np.full(joints, 0.05 * velocity), np.full(joints, action), [0.0]])


def test_moments_of_one_joint_by_hand() -> None:
    """Target 0.25·0.8 = 0.2 rad, angle 0.05, from 1 to 0.5 rad/s: e = 0.15, sign = tanh(1), change -0.5."""
    moments = Moments(proprioception(1), 0.25)
    values = moments(frame_of(1, 0.0, 1.0, 0.0), frame_of(1, 0.05, 0.5, 0.8))
    sign = np.tanh(1.0)
    joint = [0.15, 0.05, 0.5, 0.15 * sign, 0.5 * sign, 0.15, 0.0225, 0.075, -0.5 * sign, 0.5, sign**2]
    np.testing.assert_allclose(values, [*joint, *[0.0] * 13], atol=1e-12)
    assert len(values) == JOINT_MOMENTS + BODY_MOMENTS


def test_an_estimate_comes_at_the_end_of_each_window(contract: Contract) -> None:
    """Three pairs of frames make a window: an estimate after four steps, the next three later; a reset empties."""
    monitor = WearMonitor(contract, make_wear(contract))
    frame = frame_of(18, 0.0, 50.0, 0.4)
    observation = np.concatenate([np.full(650, 9.0), frame]).astype(np.float32)
    estimates = [monitor.step(observation) for _ in range(7)]
    assert [one is not None for one in estimates] == [False, False, False, True, False, False, True]
    assert estimates[3] is not None
    assert estimates[3].friction == pytest.approx([0.11] * 18, abs=1e-6)
    assert estimates[3].interval95[:, 0] == pytest.approx([0.09, 0.13], abs=1e-6)
    assert estimates[3].level_interval95 == pytest.approx((0.09, 0.13), abs=1e-6)
    monitor.step(observation)
    monitor.reset()
    assert [monitor.step(observation) is not None for _ in range(4)] == [False, False, False, True]


def test_a_window_unlike_all_others_is_marked(contract: Contract) -> None:
    """Mean square of the features 0.81 and 1.21 about a bound of 1."""
    model = make_wear(contract)
    features = np.ones(len(model.center))
    assert estimate(model, 100.0 * features).friction[0] == pytest.approx(3.01)
    assert not estimate(model, 0.9 * features).unusual
    assert estimate(model, 1.1 * features).unusual


def test_a_calibrated_reading_is_moved_and_as_wide_as_virtual_robots_say(contract: Contract) -> None:
    """0.01 from the map, 0.01 more, from 0 (0.01 − 0.03 is none) to 0.06; of other robots 94 % of windows held."""
    model = make_wear(contract, calibration=make_calibration(contract))
    reading = estimate(model, np.zeros(len(model.center)))
    assert reading.calibrated and reading.level == pytest.approx(0.02)
    assert reading.level_interval95 == pytest.approx((0.0, 0.06)) and reading.level_held == 0.94
    assert reading.friction[0] == pytest.approx(0.02) and reading.interval95[:, 0] == pytest.approx([0.0, 0.06])
    assert reading.untold[0] is None and "as wide as all" in (reading.untold[1] or "")


def test_a_map_that_was_not_calibrated_says_how_little_its_intervals_held(contract: Contract) -> None:
    """A map without calibration states the coverage of its intervals."""
    reading = estimate(make_wear(contract), np.zeros(len(make_wear(contract).center)))
    assert not reading.calibrated and reading.level_held == 0.07 and np.isnan(reading.held).all()


def test_an_estimate_says_what_it_cannot_tell_and_why(contract: Contract) -> None:
    """The estimate names its limits: outside the map, where the map is blind, and in a strange window."""
    estimated = (False,) + (True,) * 18
    monitor = WearMonitor(contract, make_wear(contract, estimated=estimated, intercept=(0.01, 0.3) + (0.01,) * 17))
    estimates = [monitor.step(np.zeros(726, np.float32)) for _ in range(5)]
    (seen,) = [one for one in estimates if one is not None]
    first, second, third, *_ = seen.untold
    assert np.isnan(seen.friction[0]) and "hardly depends" in (first or "")
    assert seen.friction[1] == pytest.approx(0.3) and "above 0.24" in (second or "")
    assert third is None and seen.interval95[:, 2] == pytest.approx([0.0, 0.03])
    estimates = [monitor.step(np.full(726, 9.0, np.float32)) for _ in range(3)]
    (strange,) = [one for one in estimates if one is not None]
    assert strange.unusual and "unlike" in (strange.untold[-1] or "")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"shift": (0.0,)}, "several lengths"),
        ({"lower": (0.2,) * 19}, "without its estimate"),
        ({"held": (1.2,) * 19}, "share above 1"),
        ({"tested": (500,)}, "each once"),
        ({"robots": ()}, "needs robots"),
        ({"engine": " "}, "has no engine"),
        ({"upper": (float("inf"),) * 19}, "numbers that are none"),
    ],
)
def test_a_calibration_that_is_none_is_refused(contract: Contract, change: dict, message: str) -> None:
    """Rejects a calibration on the robots of the test."""
    with pytest.raises(StictionError, match=message):
        make_calibration(contract, **change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"reach": (0.1,)}, "reach"),
        ({"weights": ((0.0,),)}, "weights"),
        ({"unusual": float("inf")}, "not finite"),
        ({"window": 0}, "window"),
    ],
)
def test_a_map_that_fits_nothing_is_refused(contract: Contract, change: dict, message: str) -> None:
    """Rejects a vector of the wrong length."""
    with pytest.raises(StictionError, match=message):
        replace(make_wear(contract), **change)


def test_a_map_for_another_robot_is_refused(contract: Contract) -> None:
    """Rejects the map of a robot with other joints."""
    with pytest.raises(StictionError, match="joints"):
        WearMonitor(make_contract("go1"), make_wear(contract))


def test_a_bundle_carries_the_map_under_its_checksums(tmp_path: Path, contract: Contract) -> None:
    """Altered, it is found; left out or added without a checksum, too; and a bundle without one stays valid."""
    network = make_network(contract)
    folder = write_bundle(
        tmp_path / "watching", contract, network, make_golden(contract, network), "# Toy\n", make_wear(contract)
    )
    check = check_bundle(folder)
    assert check.bundle.wear == make_wear(contract)
    assert check.summary()["wear"][-2:] == [contract.joint_names[-1], "level"]
    (folder / "wear.json").write_text((folder / "wear.json").read_text().replace("0.01", "0.02", 1))
    with pytest.raises(BundleError, match=r"wear\.json does not match"):
        read_bundle(folder)
    (folder / "wear.json").unlink()
    with pytest.raises(BundleError, match="SHA256SUMS was altered"):
        read_bundle(folder)
    plain = make_bundle(tmp_path / "plain", contract, network)
    assert check_bundle(plain).summary()["wear"] == []
    (plain / "wear.json").write_text(make_wear(contract).to_json())
    repair_sums(plain)
    with pytest.raises(BundleError, match=r"golden\.npz binds"):
        read_bundle(plain)


def test_a_map_for_other_joints_does_not_get_into_a_bundle(tmp_path: Path, contract: Contract) -> None:
    """Found when the bundle is read, before the robot moves."""
    network, names = make_network(contract), tuple(f"other_{name}" for name in contract.joint_names)
    model = WearModel(**(asdict(make_wear(contract)) | {"joint_names": names}))
    folder = write_bundle(tmp_path / "b", contract, network, make_golden(contract, network), "# Toy\n", model)
    with pytest.raises(BundleError, match="other joints"):
        read_bundle(folder)
