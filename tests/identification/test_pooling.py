"""Several runs of one joint in one fit: one set of intervals, and the runs' own disagreement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from counts import count
from stiction.core.errors import ConfigurationError
from stiction.files.joints import Estimate
from stiction.files.log import Log
from stiction.identification.example import SATURN_LITE, Excitation, SensorNoise, example_log
from stiction.identification.pipeline import _pooled, identify_joint
from stiction.identification.pooling import Pooling, compare_runs, share_delay
from stiction.identification.runs import make_run
from stiction.identification.setup import IdentifySetup


def short(seed: int, level: float = 0.442, kp: float = 20.0, duration: float = 6.0) -> Log:
    """Return a run of 6 s with its own friction and gains."""
    joint = replace(SATURN_LITE.joint, friction=replace(SATURN_LITE.joint.friction, level=level))
    motor = replace(SATURN_LITE, joint=joint, gains=replace(SATURN_LITE.gains, kp=kp))
    noise = SensorNoise.white(1e-4, 0.05)
    return replace(example_log(motor, Excitation(duration=duration), noise, seed), source=f"run{seed}")


def estimate(value: float, std: float) -> Estimate:
    """Return an estimate whose interval is 1.96 deviations wide to each side."""
    return Estimate(value, std, (value - 1.959964 * std, value + 1.959964 * std))


def table(*values: float, std: float = 1.0) -> Pooling:
    """Return runs with these values of every parameter."""
    names = ("inertia", "viscous_friction", "coulomb_friction")
    return Pooling(tuple("abcdef"[: len(values)]), tuple({name: estimate(v, std) for name in names} for v in values))


def test_numbers_by_hand() -> None:
    """Values 1, 2, 3: deviation 1, that of the mean 1/√3, Student's point for two degrees 4.3027, Q = 2 for std 1."""
    runs = table(1.0, 2.0, 3.0)
    assert runs.spread("inertia") == pytest.approx(1.0)
    assert runs.probability("inertia") == pytest.approx(np.exp(-1.0), rel=1e-5)  # χ² of two degrees beyond 2
    low, high = runs.admitted({"inertia": estimate(2.0, 0.1)})["inertia"].interval95
    assert (high - 2.0, 2.0 - low) == pytest.approx((4.3027 / np.sqrt(3),) * 2, rel=1e-4)
    wide = runs.admitted({"inertia": estimate(2.0, 5.0)})["inertia"]
    assert wide.interval95 == estimate(2.0, 5.0).interval95 and wide.std == 5.0
    assert runs.sentences() == ("3 runs were fitted together",)
    assert "the runs disagree on the inertia beyond chance: 1 to 3" in table(1.0, 2.0, 3.0, std=0.1).sentences()[1]


def test_the_interval_holds_the_mean_of_joints_that_differ_from_run_to_run() -> None:
    """With friction that varies by 15 % from run to run, the interval contains the mean."""
    rng, held, missed = np.random.default_rng(0), 0, 0
    trials = count(10, 20)
    for trial in range(trials):
        levels = 0.442 * (1 + 0.15 * rng.standard_normal(6))
        runs = [make_run(short(100 * trial + i, level), None, IdentifySetup()) for i, level in enumerate(levels)]
        base = _pooled(runs)
        estimates = base.estimates()
        within = estimates["coulomb_friction"].interval95
        low, high = compare_runs(runs, base).admitted(estimates)["coulomb_friction"].interval95
        held += low <= 0.442 <= high
        missed += not within[0] <= 0.442 <= within[1]
    assert held >= 0.85 * trials and missed > trials - held


def test_what_is_no_run_is_refused() -> None:
    """The same log twice, logs with and without torque, and repeats beside runs."""
    log = short(0)
    with pytest.raises(ConfigurationError, match="give each run once"):
        identify_joint(log, more=[log])
    with pytest.raises(ConfigurationError, match="give either"):
        identify_joint(log, more=[short(1)], repeats=[short(2)])
    blind = replace(short(1), joints={"shank": replace(short(1).joints["shank"], torque=None)})
    with pytest.raises(ConfigurationError, match="runs with and without torque"):
        identify_joint(log, more=[blind])


def _delay(value: float, reach: float) -> Estimate:
    """Return an estimate whose interval reaches so far either way."""
    return Estimate(value, reach / 2, (value - reach, value + reach))


def test_one_delay_of_a_robot_by_hand() -> None:
    """4, 6 and 8 ms, each to 4 ms, are 6 ms together; one told to over 5 ms, or below zero, is silent."""
    told = {"hip": _delay(4e-3, 4e-3), "thigh": _delay(6e-3, 4e-3), "calf": _delay(8e-3, 4e-3)}
    shared = share_delay(told | {"wide": _delay(3e-3, 6e-3), "early": _delay(-5e-4, 1e-3)}, 5e-3)
    assert shared is not None and shared.telling == tuple(told) and shared.silent == ("wide", "early")
    assert shared.estimate.value == pytest.approx(6e-3) and shared.agreed
    # Deviations of 2.04 ms: the mean's is that over the root of three, and Q is 2 (2/2.04)².
    assert shared.estimate.std == pytest.approx(4e-3 / 1.96 / 3**0.5, rel=1e-3)
    assert shared.probability == pytest.approx(np.exp(-((1.96 * 2 / 4) ** 2)), rel=1e-3)
    assert "3 other joints of the log together, 6 ms" in shared.sentence()
    apart = share_delay({name: _delay(one.value, 1e-4) for name, one in told.items()}, 5e-3)
    assert apart is not None and not apart.agreed and "each joint keeps its own" in apart.sentence()
    assert share_delay(dict(list(told.items())[:2]), 5e-3) is None
