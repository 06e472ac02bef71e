"""Identification from end to end on motors whose parameters are known."""

from __future__ import annotations

from dataclasses import replace

import pytest

from shanks import GO1
from stiction.core.errors import StictionError
from stiction.files.joints import PARAMETERS, Estimate
from stiction.files.log import Log, LogSetup
from stiction.identification.example import SATURN_LITE, Excitation, Motor, SensorNoise, example_log
from stiction.identification.pipeline import identify_joint
from stiction.identification.setup import IdentifySetup

QUIET = SensorNoise(position=0.0, resolution=0.0, velocity=0.0, torque=0.0, ripple=0.0)


def truth(motor: Motor) -> list[float]:
    """Return the parameters in the order of `PARAMETERS`."""
    return [motor.joint.inertia, motor.joint.viscous, motor.joint.friction.level, motor.joint.offset]


def scaled(log: Log, **changes) -> Log:
    """Return the log with fields of its only joint's signals replaced."""
    (name, signals), *_ = log.joints.items()
    return replace(log, joints={name: replace(signals, **changes)})


@pytest.mark.parametrize("motor", [GO1, SATURN_LITE], ids=lambda motor: motor.name)
def test_without_noise_both_estimators_find_the_truth(motor: Motor) -> None:
    """Regression is within 1 % (filter blur), output error within 0.1 %."""
    record = identify_joint(example_log(motor, noise=QUIET)).record
    for name, true in zip(PARAMETERS, truth(motor), strict=True):
        assert getattr(record, name).value == pytest.approx(true, rel=0.01)
        assert record.diagnostics["output_error"][name]["value"] == pytest.approx(true, rel=1e-3)


@pytest.mark.parametrize("motor", [GO1, SATURN_LITE], ids=lambda motor: motor.name)
def test_with_noise_the_truth_is_near(motor: Motor) -> None:
    """Within four standard deviations by both, and no warning on a good log with a full setup."""
    record = identify_joint(example_log(motor, seed=3)).record
    for name, true in zip(PARAMETERS, truth(motor), strict=True):
        own = getattr(record, name)
        other = Estimate.from_dict(record.diagnostics["output_error"][name], name)
        assert abs(own.value - true) < 4 * own.std
        assert abs(other.value - true) < 4 * other.std
        assert other.std < own.std
    assert record.warnings == () and record.combinations == {}
    assert record.diagnostics["strength"] == {"source": "measured", "missing": None}


def test_ratio_and_dead_band_follow_from_friction() -> None:
    """f/τ_max with τ_max 45 and f/kp with kp 20, value and interval alike."""
    record = identify_joint(example_log(SATURN_LITE)).record
    assert record.friction_ratio.value == pytest.approx(record.coulomb_friction.value / 45)
    assert record.dead_band.interval95[1] == pytest.approx(record.coulomb_friction.interval95[1] / 20)
    assert record.test_condition == "bare_motor" and record.torque_source == "motor_side"
    assert 0.009 < record.friction_ratio.value < 0.0106


def test_what_is_not_given_is_null_and_warned_of() -> None:
    """No gains, limit, side or condition: the fit stands, the rest is null, and each gap has its warning."""
    log = replace(example_log(), setup=LogSetup())
    record = identify_joint(log).record
    assert record.coulomb_friction is not None
    assert record.friction_ratio is None and record.dead_band is None
    assert record.diagnostics["output_error"] is None
    text = " ".join(record.warnings)
    for word in ("--kp", "--torque-limit", "--torque-source", "--test-condition", "dead band"):
        assert word in text
    untargeted = identify_joint(scaled(example_log(), target=None)).record
    assert any("no target" in warning for warning in untargeted.warnings)
    assert untargeted.diagnostics["output_error"] is None


def test_friction_beyond_the_torque_limit_is_refused() -> None:
    """Rejects friction of 1000 % of the torque limit, as from a torque column in N mm."""
    with pytest.raises(StictionError, match="beyond the torque limit 45"):
        identify_joint(example_log(), setup=IdentifySetup(torque_scale=1000.0))
    text = " ".join(identify_joint(example_log(), setup=IdentifySetup(torque_limit=1.0)).record.warnings)
    assert "beyond the torque limit 1:" in text and "at its torque limit" in text


@pytest.mark.parametrize(
    ("log", "setup", "message"),
    [
        (scaled(example_log(), torque=None, target=None), IdentifySetup(), "no torque"),
        (example_log(), IdentifySetup(torque_source="output_side"), "behind the gear"),
        (example_log(), IdentifySetup(torque_scale=-1.0), r"must be positive.*--torque-scale \(about 1 would fit\)"),
        (example_log(), IdentifySetup(kp=-1.0), "kp -1.0: expected a positive"),
        (example_log(), IdentifySetup(torque_scale=0.0), "torque scale 0.0"),
        (example_log(), IdentifySetup(cutoff=1e4), "cutoff"),
        (example_log(excitation=Excitation((1e-4,), (1.0,))), IdentifySetup(), "excitation too poor|constant"),
        (example_log(excitation=Excitation((0.5,), (0.1,), 10.0)), IdentifySetup(), "too poor: the joint turns"),
    ],
    ids=["no_torque", "output_side", "sign", "kp", "scale", "cutoff", "stuck", "too_few_turns"],
)
def test_what_cannot_be_done_is_refused(log: Log, setup: IdentifySetup, message: str) -> None:
    """Rejects impossible logs."""
    with pytest.raises(StictionError, match=message) as caught:
        identify_joint(log, setup=setup)
    assert "\n" not in str(caught.value)
