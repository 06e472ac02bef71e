"""Filtering, differentiation, and the choice of samples."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.identification.checks import Uniform
from stiction.identification.example import LEG, example_log
from stiction.identification.model import Model
from stiction.identification.prepare import choose_cutoff, low_pass, make_rows, position_noise, prepare
from stiction.identification.regression import fit_rows
from stiction.identification.runs import make_run
from stiction.identification.setup import IdentifySetup

STEP = 0.002
TIME = np.arange(5000) * STEP
RATE = 2 * np.pi * 1.5


def signals(noise: float = 0.0) -> Uniform:
    """Return a sine of 1.5 Hz, with torque equal to its exact acceleration."""
    angle = np.sin(RATE * TIME) + noise * np.random.default_rng(0).standard_normal(len(TIME))
    return Uniform(TIME, STEP, angle, -(RATE**2) * np.sin(RATE * TIME), None, None)


def test_derivatives_have_no_delay_and_the_right_size() -> None:
    """A delay of one sample would turn 2 % of the inertia's torque into viscous friction."""
    prepared = prepare(signals(), np.asarray(signals().torque), cutoff=40.0)
    inner = slice(100, -100)
    np.testing.assert_allclose(prepared.velocity[inner], RATE * np.cos(RATE * TIME)[inner], atol=3e-3 * RATE)
    np.testing.assert_allclose(prepared.acceleration[inner], prepared.torque[inner], atol=3e-3 * RATE**2)


def test_samples_near_reversals_are_left_out() -> None:
    """Within one period of the corner around each reversal nothing enters: 25 ms at 40 Hz."""
    prepared = prepare(signals(), np.asarray(signals().torque), cutoff=40.0)
    turns = (np.arange(30) + 0.5) / 3.0
    distance = np.abs(TIME[prepared.used, None] - turns[None]).min(axis=1)
    assert distance.min() > 0.024
    assert np.abs(prepared.velocity[prepared.used]).min() > prepared.threshold
    assert len(prepared.used) > 500
    np.testing.assert_allclose(np.abs(prepared.direction[prepared.used]), 1.0, atol=0.05)


def test_the_size_of_white_noise_is_found() -> None:
    """The corner and the speed threshold rest on it."""
    assert position_noise(signals(2e-4).position) == pytest.approx(2e-4, rel=0.1)


def test_more_noise_lowers_the_corner() -> None:
    """Clean signals keep a quarter of the rate; at 1e-3 rad the acceleration would drown there."""
    assert choose_cutoff(signals().position, STEP, 0.0) == pytest.approx(125.0)
    corners = [choose_cutoff(signals(noise).position, STEP, noise) for noise in (1e-4, 1e-3, 1e-2)]
    assert 125 > corners[0] > corners[1] > corners[2] > 5


def test_an_impossible_corner_is_refused() -> None:
    """Half the rate is the end of what a log holds."""
    with pytest.raises(StictionError, match="half the sampling rate, 250 Hz"):
        prepare(signals(), np.asarray(signals().torque), cutoff=300.0)


@pytest.mark.parametrize(
    ("law", "largest"),
    [("coulomb", 0.001), ("position", 0.03), ("load", 0.03), ("stribeck", 0.06), ("asymmetric", 0.2)],
)
def test_products_of_filtered_signals_do_for_filtered_products(law: str, largest: float) -> None:
    """What the equation makes of filtered signals is not filtered itself; that may move no answer within its interval.

    The leg in the air with the noise of real ones, seeds 0 to 2; largest: shift of a parameter in its standard
    deviations, if its column is filtered as a whole in place of what it is made of.
    """
    shifts = []
    for seed in range(3):
        run = make_run(example_log(LEG, seed=seed), None, IdentifySetup())
        prepared, angle = run.prepared, run.signals.position
        speed, sign = prepared.velocity, np.sign(prepared.velocity)
        fit = fit_rows(make_rows([prepared], [None]), Model(law, gravity=True))
        found = fit.by_name
        rise = np.exp(-((speed / found.get("stribeck_velocity", np.inf)) ** 2))
        weight = found["gravity_sin"] * np.sin(angle) + found["gravity_cos"] * np.cos(angle)
        whole = {
            "gravity_sin": np.sin(angle),
            "gravity_cos": np.cos(angle),
            "coulomb_friction": sign * (1 - rise if law == "stribeck" else 1),
            "static_friction": sign * rise,
            "load_coefficient": np.abs(weight) * sign,
            "position_slope": sign * angle,
            "position_curvature": sign * angle**2,
            "viscous_friction_forward": np.clip(speed, 0.0, None),
            "viscous_friction_backward": np.clip(speed, None, 0.0),
            "coulomb_friction_forward": np.clip(sign, 0.0, None),
            "coulomb_friction_backward": np.clip(sign, None, 0.0),
        }
        names = [name for name in fit.names if name != "stribeck_velocity"]
        columns = dict(zip(fit.names, fit.jacobian.T, strict=True)) | {
            name: low_pass(values, prepared.cutoff, prepared.step)[prepared.used] for name, values in whole.items()
        }
        again = np.linalg.lstsq(np.stack([columns[name] for name in names], 1), fit.rows.torque, rcond=None)[0]
        shifts += [(value - found[name]) / fit.scatter()[name].std for name, value in zip(names, again, strict=True)]
    assert 0 < np.abs(shifts).max() < largest
