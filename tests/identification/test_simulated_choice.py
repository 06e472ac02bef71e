"""The law of friction, chosen by simulating the joint in its loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from held import sampled_log
from stiction.files.joints import Estimate
from stiction.files.log import JointSignals, Log, LogSetup
from stiction.identification.example import SATURN_LITE, Excitation, example_log
from stiction.identification.pipeline import identify_joint
from stiction.joints.friction import Asymmetric, Effort, FrictionLaw, PositionDependent, Stribeck
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Joint, simulate

GAINS = PDGains(20.0, 0.8, 12.0)
TIME = np.arange(10_000) / 500
TARGET = 0.5 * np.sin(2 * np.pi * 0.3 * TIME) + 0.2 * np.sin(2 * np.pi * 0.9 * TIME + 1.0)


def simulated_log(friction: FrictionLaw, viscous: float = 0.05) -> Log:
    """Return 20 s at 500 Hz of a joint with a law, an encoder of 0.1 mrad and 0.01 N m of noise in its torque."""
    made = simulate(Joint(0.05, viscous, friction), GAINS, 1 / 500, TARGET)
    torque = made.torque + 0.01 * np.random.default_rng(0).standard_normal(len(TIME))
    signals = JointSignals(position=np.round(made.position / 1e-4) * 1e-4, target=TARGET, torque=torque)
    setup = LogSetup(kp=20.0, kd=0.8, torque_limit=12.0, torque_source="motor_side", test_condition="bare_motor")
    return Log("simulated", TIME, {"shank": signals}, setup)


@pytest.mark.parametrize(
    ("friction", "law", "parameters"),
    [
        (Stribeck(0.3, 0.6, 0.2), "stribeck", {"static_friction": 0.6, "coulomb_friction": 0.3}),
        (Asymmetric(0.3, 0.3, 0.04, 0.12), "asymmetric", {"viscous_friction_forward": 0.04}),
        (PositionDependent(0.4, 0.3, 0.2, 0.0), "position", {"viscous_friction": 0.05}),
    ],
    ids=["stribeck", "asymmetric", "position"],
)
def test_the_law_that_made_the_log_is_the_answer(friction: FrictionLaw, law: str, parameters: dict[str, float]) -> None:
    """Chosen, its parameters within 3 %, and the symmetric fit stands beside it under its own name."""
    viscous = 0.0 if isinstance(friction, Asymmetric) else 0.05
    record = identify_joint(simulated_log(friction, viscous)).record
    assert record.objections == () and record.friction_law["law"] == law
    for name, true in parameters.items():
        assert record.friction_law["parameters"][name]["value"] == pytest.approx(true, rel=0.03), name
    assert record.inertia is not None and record.inertia.value == pytest.approx(0.05, rel=0.005)
    assert set(record.friction_law["symmetric"]) == {"inertia", "viscous_friction", "coulomb_friction", "offset"}


def test_standard_values_are_the_laws_own_over_the_motion() -> None:
    """Viscous friction of both directions in the mean; Coulomb friction of a joint that depends on the angle, too."""
    both = identify_joint(simulated_log(Asymmetric(0.3, 0.3, 0.04, 0.12), 0.0)).record
    assert both.viscous_friction is not None and both.viscous_friction.value == pytest.approx(0.08, rel=0.03)
    bent = identify_joint(simulated_log(PositionDependent(0.4, 0.0, 0.5, 0.0))).record
    # The angle's mean square is half of the sum of the squared amplitudes, less what the joint lags.
    assert bent.coulomb_friction is not None and bent.coulomb_friction.value == pytest.approx(
        0.4 + 0.5 * 0.14, rel=0.05
    )


def test_plain_friction_needs_no_law() -> None:
    """The simulation follows the log to its noise: nothing is left to explain, and nothing more is tried."""
    record = identify_joint(sampled_log(0.3, 0.3)).record
    assert [one["verdict"] for one in record.friction_law["candidates"]] == ["follows the log to its noise"]
    assert record.friction_law["law"] == "coulomb" and "symmetric" not in record.friction_law


def test_more_friction_at_rest_is_found_at_once() -> None:
    """With 2.4 at rest and 0.1 in motion both are identified, and the proposal follows the one at rest."""
    record = identify_joint(sampled_log(2.4, 0.1)).record
    static, moving = record.static_friction, record.coulomb_friction
    assert isinstance(static, Estimate) and static.interval95[0] <= 2.4 <= static.interval95[1]
    assert isinstance(moving, Estimate) and moving.value == pytest.approx(0.1, rel=0.03)
    assert record.friction_ratio is not None and record.friction_ratio.value == pytest.approx(0.2, rel=0.01)


def test_loss_with_the_motors_torque_is_a_law() -> None:
    """A fifth of the torque is lost, driving and braking, beside 0.3 N m: all three come back within 1 %."""
    record = identify_joint(sampled_log(0.3, 0.3, effort=0.2)).record
    assert record.friction_law["law"] == "effort" and record.load_regressor == "motor_torque"
    assert record.load_coefficient is not None and record.load_coefficient.value == pytest.approx(0.2, rel=0.01)
    assert record.friction_law["parameters"]["coulomb_friction"]["value"] == pytest.approx(0.3, rel=0.01)
    assert record.inertia is not None and record.inertia.value == pytest.approx(0.05, rel=0.01)
    # The standard value is the friction of the motion: 0.3 and a fifth of the mean torque.
    torque = sampled_log(0.3, 0.3, effort=0.2).joints["shank"].torque
    assert record.coulomb_friction is not None and torque is not None
    expected = 0.3 + 0.2 * float(np.abs(torque).mean())
    assert record.coulomb_friction.value == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(
    ("friction", "law", "parameters"),
    [
        (Stribeck(0.442, 0.65, 0.4), "stribeck", {"static_friction": 0.65, "coulomb_friction": 0.442}),
        (Effort(0.3, 0.15), "effort", {"effort_coefficient": 0.15, "coulomb_friction": 0.3}),
    ],
    ids=["stribeck", "effort"],
)
def test_a_law_is_tried_before_the_loop_is_given_up(
    friction: FrictionLaw, law: str, parameters: dict[str, float]
) -> None:
    """Noise in the loop is 4 % of the torque, and the symmetric law leaves over three times the position's noise."""
    motor = replace(SATURN_LITE, joint=replace(SATURN_LITE.joint, friction=friction))
    log = example_log(motor, Excitation((0.35, 0.26), (0.71, 1.59), 12.0), seed=2)
    record = identify_joint(log).record
    assert record.friction_law["law"] == law and record.diagnostics["controller_mismatch"] > 0.03
    assert record.diagnostics["output_error"] is not None and record.diagnostics["closed_loop"] is None
    for name, true in parameters.items():
        low, high = record.friction_law["parameters"][name]["interval95"]
        assert low <= true <= high, name


def test_play_between_motor_and_encoder_is_no_law() -> None:
    """The encoder stands while the motor crosses 4 mrad: no law follows it, and the torque is believed."""
    whole = simulated_log(Stribeck(0.3, 0.3, 0.2))
    signals, link = whole.joints["shank"], []
    for angle in signals.position.tolist():
        before = link[-1] if link else angle
        link.append(min(max(before, angle - 0.002), angle + 0.002))
    loose = replace(whole, joints={"shank": replace(signals, position=np.array(link))})
    record = identify_joint(loose).record
    assert record.diagnostics["output_error"] is None and record.diagnostics["method"] == "torque_regression"
    assert any("by any law: the torque is believed" in text for text in record.warnings)
    assert record.coulomb_friction is not None and record.coulomb_friction.value == pytest.approx(0.3, rel=0.05)
