"""Contents of a record: unknowns of the loop, the law, and warnings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from carried import late_motion, without_torque
from equation import equation_rows
from stiction.files.log import JointSignals, Log, LogSetup
from stiction.identification.example import LEG, SATURN_LITE, Excitation, Motor, SensorNoise, example_log
from stiction.identification.model import Model
from stiction.identification.pipeline import identify_joint
from stiction.identification.record import hanging_bias
from stiction.identification.regression import fit_rows
from stiction.identification.setup import IdentifySetup
from stiction.joints.simulate import Gravity

STEP = 0.002
PLAIN = {"inertia": 0.02, "viscous_friction": 0.07, "coulomb_friction": 0.4, "offset": -0.05}


def changed(log: Log, **signals: np.ndarray) -> Log:
    """Return the log with signals of its only joint replaced."""
    return replace(log, joints={"shank": replace(log.joints["shank"], **signals)})


def hanging_leg(bias: float, hanging: float) -> Motor:
    """Return a leg of 2.2 N m as its encoder sees it, which is `bias` ahead; it hangs at the true angle `hanging`."""
    phase = bias + hanging
    return replace(LEG, joint=replace(LEG.joint, gravity=Gravity(2.2 * np.cos(phase), -2.2 * np.sin(phase))))


def late_log(delay: float) -> Log:
    """Return a log of Saturn Lite's shank whose controller is late in all that it uses, by steps of 0.1 ms."""
    gains, joint, rng = SATURN_LITE.gains, SATURN_LITE.joint, np.random.default_rng(0)
    time, target = Excitation(duration=8.0).target()
    truth = joint.inertia, joint.viscous, joint.friction.pieces(1)[0].level, joint.offset
    noise = np.array([[2e-5], [0.02]]) * rng.standard_normal((2, len(time)))
    position, torque = late_motion(truth, gains, STEP, target, delay, 20, True) + noise
    setup = LogSetup(kp=gains.kp, kd=gains.kd, torque_limit=45.0, torque_source="motor_side")
    signals = JointSignals(position=position, target=target, torque=torque)
    return Log("late", time, {"shank": signals}, replace(setup, test_condition="bare_motor"))


def freed(log: Log) -> Log:
    """Return the log without gains: only the torque equation applies."""
    return replace(log, setup=replace(log.setup, kp=None, kd=None))


def with_more_friction(share: np.ndarray, seed: int = 0) -> Log:
    """Return a log of Saturn Lite's shank whose friction is up by a share at each sample, shape (num_samples,)."""
    log = freed(example_log(SATURN_LITE, noise=SensorNoise.white(1e-5, 0.05), seed=seed))
    position, torque = log.joints["shank"].position, log.joints["shank"].torque
    assert position is not None and torque is not None
    velocity = np.gradient(position, STEP)
    return changed(log, torque=torque + share * (0.0704 * velocity + 0.442 * np.sign(velocity)))


@pytest.mark.parametrize(("bias", "hanging"), [(0.1, 0.0), (-0.2, 0.5), (0.3, 3.0), (-0.1, -3.1)])
def test_gravity_tells_the_encoders_bias(bias: float, hanging: float) -> None:
    """Gravity's phase in noiseless rows is the sum of bias and hanging angle, also beyond ±π."""
    phase = bias + hanging
    weight = {"gravity_sin": 2.2 * np.cos(phase), "gravity_cos": -2.2 * np.sin(phase)}
    fit = fit_rows(equation_rows(PLAIN | weight), Model(gravity=True))
    estimate = hanging_bias(fit, hanging)
    assert estimate is not None and estimate.value == pytest.approx(bias, abs=1e-9)


def test_the_bias_of_a_leg_is_found_in_noise() -> None:
    """Encoder 0.1 rad ahead of a leg that hangs at 0.5 rad: within three deviations, which are 0.02 rad at most."""
    for seed in range(3):
        log = example_log(hanging_leg(0.1, 0.5), Excitation(duration=10.0), seed=seed)
        log = log if seed else without_torque(log)
        record = identify_joint(log, setup=IdentifySetup(hanging_angle=0.5)).record
        assert record.encoder_bias is not None
        assert abs(record.encoder_bias.value - 0.1) < 3 * record.encoder_bias.std < 0.06
    assert identify_joint(log).record.encoder_bias is None


@pytest.mark.parametrize("bias", [0.003, -0.3])
def test_a_log_whose_angle_is_ahead_of_the_controllers(bias: float) -> None:
    """The controller acts on another zero than the log has: found if asked for, however large."""
    log = example_log(SATURN_LITE)
    moved = changed(log, position=np.asarray(log.joints["shank"].position) + bias)
    record = identify_joint(moved, setup=IdentifySetup(unknowns=("encoder_bias",))).record
    assert record.encoder_bias is not None and record.coulomb_friction is not None
    assert abs(record.encoder_bias.value - bias) < 4 * record.encoder_bias.std
    assert record.coulomb_friction.value == pytest.approx(0.442, rel=0.02)
    assert record.diagnostics["controller_mismatch"] < 0.05
    assert len(record.warnings) == 1 and "against the controller's" in record.warnings[0]
    asked_for_nothing = identify_joint(moved).record
    assert asked_for_nothing.encoder_bias is None
    assert asked_for_nothing.diagnostics["controller_mismatch"] == pytest.approx(abs(bias) * 20 / 0.82, rel=0.4)


@pytest.mark.parametrize("measured", [True, False], ids=["torque", "positions"])
def test_a_late_controller_is_found_and_frees_friction_of_it(measured: bool) -> None:
    """A delay of 4 ms is found within 5 % without a flag."""
    log = late_log(0.004) if measured else without_torque(late_log(0.004))
    record = identify_joint(log).record
    assert record.delay is not None and record.delay.value == pytest.approx(0.004, rel=0.05)
    assert record.friction_law["law"] == "coulomb"
    viscous = record.viscous_friction if measured else record.combinations["(B + k·kd)/k"]
    assert viscous.value == pytest.approx(0.0704 if measured else 0.5704, rel=0.01)


def test_friction_that_drifts_is_a_warning() -> None:
    """10 % under at the start to 10 % over at the end: +20 %, and what to do; a steady log has no such line."""
    late = np.linspace(-0.5, 0.5, 10_000)
    record = identify_joint(with_more_friction(0.2 * late)).record
    change = record.diagnostics["drift"]["change"]
    assert change["interval95"][0] < 0.2 < change["interval95"][1] and change["std"] < 0.02
    warning = next(text for text in record.warnings if "from start to end of the log" in text)
    assert f"{change['value']:+.0%}" in warning and "warm" in warning
    steady = identify_joint(with_more_friction(0.0 * late)).record
    assert not any("from start to end" in text for text in steady.warnings)


def test_halves_that_do_not_agree_are_a_warning_and_widen_the_interval() -> None:
    """30 % more friction in the second half, 0.442 and 0.575 N m: named, and the stated interval admits both."""
    record = identify_joint(with_more_friction(0.3 * (np.arange(10_000) >= 5000))).record
    warning = next(text for text in record.warnings if "first half and second half do not agree" in text)
    assert "coulomb_friction" in warning and "widened" in warning
    level = record.coulomb_friction
    assert level is not None and level.interval95[0] < 0.45 and level.interval95[1] > 0.565
    assert level.std == pytest.approx(0.3 * 0.442 / 2, rel=0.1)
    assert record.friction_ratio is not None
    assert record.friction_ratio.interval95[1] == pytest.approx(level.interval95[1] / 45, rel=1e-12)
