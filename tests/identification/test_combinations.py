"""Combinations of parameters for a motor of unknown strength, and experiments that separate them; truth simulated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from carried import QUIET, carrying_log, weak_log, without_torque
from stiction.files.joints import PARAMETERS, Estimate, JointRecord
from stiction.identification.combinations import DAMPED, exact, product
from stiction.identification.example import LEG, SATURN_LITE, Excitation, Motor, SensorNoise, example_log
from stiction.identification.pipeline import identify_joint
from stiction.identification.setup import IdentifySetup
from stiction.joints.friction import Coulomb
from stiction.joints.simulate import Gravity, Joint

K = 0.8
LOAD = (0.5, 0.2, 0.3)
"""0.5 kg at 0.2 m, hanging straight down at 0.3 rad: 0.98 N m."""

OVER_K = {"I/k": 0.0145 / K, DAMPED: (0.0704 + K * 0.5) / K, "f/k": 0.442 / K, "offset/k": -0.05 / K}
"""Truth of Saturn Lite's shank at kd 0.5 under a motor that gives 80 %."""


def values(record: JointRecord) -> list[float]:
    """Return inertia, viscous and Coulomb friction."""
    estimates = [getattr(record, name) for name in PARAMETERS[:3]]
    assert all(estimates), estimates
    return [estimate.value for estimate in estimates]


def test_positions_alone_tell_what_is_over_k() -> None:
    """At k = 0.8 each combination holds its truth in 5 or more of 6 logs; parameters are null."""
    inside = dict.fromkeys(OVER_K, 0)
    for seed in range(6):
        record = identify_joint(weak_log(SATURN_LITE, K, seed)).record
        assert [getattr(record, name) for name in PARAMETERS] == [None] * 4 and record.motor_strength is None
        assert set(record.combinations) == set(OVER_K)
        for name, truth in OVER_K.items():
            low, high = record.combinations[name].interval95
            inside[name] += low <= truth <= high
            assert record.combinations[name].value == pytest.approx(truth, rel=0.03), name
        # What stays in units of the command: f/k over the limit asked for, and over kp.
        assert record.friction_ratio is not None and record.dead_band is not None
        assert record.friction_ratio.value == pytest.approx(0.442 / K / 45, rel=0.01)
        assert record.dead_band.value == pytest.approx(0.442 / K / 20, rel=0.01)
    assert min(inside.values()) >= 5, inside
    assert any("known mass" in text and "commanded torque at its word" in text for text in record.warnings)


@pytest.mark.parametrize("factor", [0.5, 3.0])
def test_a_joint_and_its_motor_may_grow_together_unseen(factor: float) -> None:
    """I, B, f, offset, gravity and k times any number: the same log, and so the same result to the last digits."""
    joint = Joint(0.06, 0.07, Coulomb(0.44), -0.05, Gravity(2.2, 0.4))
    inertia, viscous, level, offset, sine, cosine = factor * np.array([0.06, 0.07, 0.44, -0.05, 2.2, 0.4])
    grown = Joint(inertia, viscous, Coulomb(level), offset, Gravity(sine, cosine))
    gains = LEG.gains
    one, other = (
        identify_joint(weak_log(Motor("leg", which, gains), strength, noise=QUIET)).record
        for which, strength in ((joint, 1.0), (grown, factor))
    )
    assert set(one.combinations) == set(other.combinations) and len(one.combinations) == 7
    for name, estimate in one.combinations.items():
        assert other.combinations[name].value == pytest.approx(estimate.value, rel=1e-6), name
    assert one.friction_ratio is not None and other.friction_ratio is not None
    assert other.friction_ratio.value == pytest.approx(one.friction_ratio.value, rel=1e-6)


def test_a_payload_in_one_log_of_two_tells_the_strength() -> None:
    """A log with 0.5 kg and one without: k = 0.8 and the parameters in N m, in either order of the two logs."""
    heavy, bare = carrying_log(SATURN_LITE, K, *LOAD, noise=QUIET), weak_log(SATURN_LITE, K, 1, QUIET)
    for first, second in ((heavy, bare), (bare, heavy)):
        record = identify_joint(first, repeats=(second,)).record
        assert record.motor_strength is not None
        assert record.motor_strength.value == pytest.approx(K, rel=1e-3)
        assert values(record) == pytest.approx([0.0145, 0.0704, 0.442], rel=0.01)
        assert record.combinations == {} and record.diagnostics["strength"]["source"] == "known_load"
        assert record.friction_ratio is not None and record.dead_band is not None


def test_a_known_torque_from_outside_tells_the_strength() -> None:
    """A sine of 2 N m on the joint: k = 0.8 and parameters in N m, and the same where 0.8 was declared."""
    time, _ = Excitation().target()
    weak = replace(SATURN_LITE, gains=replace(SATURN_LITE.gains, strength=K))
    pulled = without_torque(example_log(weak, load=2.0 * np.sin(7.0 * time), noise=QUIET))
    record = identify_joint(pulled).record
    assert record.motor_strength is not None and record.motor_strength.value == pytest.approx(K, rel=2e-3)
    assert values(record) == pytest.approx([0.0145, 0.0704, 0.442], rel=0.01)
    declared = identify_joint(pulled, setup=IdentifySetup(motor_strength=K)).record
    assert values(declared) == pytest.approx([0.0145, 0.0704, 0.442], rel=0.01)
    assert declared.diagnostics["method"] == "output_error"


def test_torque_without_a_unit_gives_what_is_over_its_scale() -> None:
    """A current of 0.137 N m a unit, not declared: I, B and f over 0.137, kd in none of them, and no parameter."""
    log = example_log(SATURN_LITE, seed=2)
    signals = log.joints["shank"]
    log = replace(log, joints={"shank": replace(signals, torque=np.asarray(signals.torque) / 0.137)})
    record = identify_joint(log, setup=IdentifySetup(torque_calibrated=False)).record
    assert [getattr(record, name) for name in PARAMETERS] == [None] * 4
    expected = {"I/k": 0.0145, "B/k": 0.0704, "f/k": 0.442, "offset/k": -0.05}
    assert set(record.combinations) == set(expected)
    for name, truth in expected.items():
        estimate = record.combinations[name]
        assert abs(estimate.value - truth / 0.137) < 4 * estimate.std, name
    # In the unit of the current the limit may be given too; kp is in N m/rad, so there is no f/kp.
    assert record.friction_ratio is not None and record.dead_band is None
    text = " ".join(record.warnings)
    assert "--torque-scale" in text and "unit of the torque column" in text


def test_an_offset_that_gravity_hides_is_null_and_the_holding_torque_is_known() -> None:
    """Within 0.1 rad offset and cosine are one: null, while what holds the link in mid-range, −0.05 + 0.4, is known."""
    small = Excitation((0.06, 0.05), (0.5, 2.0))
    log = example_log(LEG, small, SensorNoise.white(1e-5, 0.05))
    position = log.joints["shank"].position
    assert position is not None and 0.05 < abs(position).max() < 0.12
    record = identify_joint(log).record
    assert record.offset is None and record.gravity_cos is None
    assert any("cannot be told from gravity: it is null" in text for text in record.warnings)
    held = record.combinations["holding torque at mid-range"]
    middle = float(position.min() + position.max()) / 2
    truth = -0.05 + 2.2 * np.sin(middle) + 0.4 * np.cos(middle)
    assert abs(held.value - truth) < 4 * held.std and held.std < 0.01


def test_a_product_by_hand() -> None:
    """2 (1.8 to 2.2) times 0.5 (0.4 to 0.65): 1, down by √(0.1² + 0.2²) and up by √(0.1² + 0.3²).

    Of −2 the ends change places: a larger factor makes it more negative.
    """
    factor = Estimate(0.5, 0.05, (0.4, 0.65))
    result = product(Estimate(2.0, 0.1, (1.8, 2.2)), factor)
    assert result.value == 1.0 and result.std == pytest.approx((0.05**2 + 0.1**2) ** 0.5)
    assert result.interval95 == pytest.approx((1 - 0.05**0.5, 1 + 0.1**0.5))
    negative = product(Estimate(-2.0, 0.1, (-2.2, -1.8)), factor)
    assert negative.interval95 == pytest.approx((-1 - 0.1**0.5, -1 + 0.05**0.5))
    assert product(result, exact(1.0)) == result
