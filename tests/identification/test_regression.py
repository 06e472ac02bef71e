"""Torque regression on rows made from the torque equation itself: what went in must come out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from equation import equation_rows
from stiction.core.errors import LogError
from stiction.identification.choice import SIMULATED
from stiction.identification.model import LAWS, Law, Model
from stiction.identification.regression import (
    check_fit,
    fit_rows,
    predict_torque,
    rigid_torque,
)
from stiction.identification.setup import Payload

COMMON = {"inertia": 0.02, "viscous_friction": 0.07, "coulomb_friction": 0.4, "offset": -0.05}
TRUTHS: dict[Law, dict[str, float]] = {
    "coulomb": COMMON,
    "asymmetric": dict(zip(Model("asymmetric").names, (0.02, 0.06, 0.09, 0.5, 0.3))),
    "load": COMMON | {"load_coefficient": 0.08},
    "stribeck": COMMON | {"static_friction": 0.65, "stribeck_velocity": 0.8},
    "position": COMMON | {"position_slope": 0.15, "position_curvature": -0.1},
}
WEIGHT = {"gravity_sin": 2.0, "gravity_cos": -0.6}
MIDDLE = 0.3
PAYLOAD = Payload(1.5, 0.2, -0.4)


def truth(law: Law, gravity: bool) -> dict[str, float]:
    """Return the parameters of a law, with the link's weight or without."""
    return TRUTHS[law] | (WEIGHT if gravity else {})


FITTED = [law for law in LAWS if law not in SIMULATED]
"""Laws that regression can fit."""


@pytest.mark.parametrize("gravity", [False, True], ids=["upright", "in_air"])
@pytest.mark.parametrize("law", FITTED)
def test_every_law_gives_its_parameters_back(law: Law, gravity: bool) -> None:
    """Rows without noise: all parameters within 1e-5, with the Stribeck velocity to what its search resolves."""
    values = truth(law, gravity)
    rows = equation_rows(values, load=0.8, middle=MIDDLE)
    fit = fit_rows(rows, Model(law, gravity, MIDDLE))
    assert set(fit.names) == set(values)
    for name, value in zip(fit.names, fit.values, strict=True):
        assert value == pytest.approx(values[name], rel=1e-3 if law == "stribeck" else 1e-5), name
    assert np.abs(fit.residual).max() < (1e-3 if law == "stribeck" else 1e-5)


@pytest.mark.parametrize("law", FITTED)
def test_the_jacobian_is_the_derivative_of_the_torque(law: Law) -> None:
    """Each column against a difference of the equation itself; intervals rest on the columns.

    The load law's load is taken as known, so its gravity columns lack what gravity adds by friction: they are apart.
    """
    values = truth(law, True)
    rows = equation_rows(values, load=0.8, middle=MIDDLE)
    fit = fit_rows(rows, Model(law, True, MIDDLE))
    for name, column in zip(fit.names, fit.jacobian.T, strict=True):
        if law == "load" and name in WEIGHT:
            continue
        step = 1e-5
        more, less = (
            equation_rows(values | {name: values[name] + change}, load=0.8, middle=MIDDLE).torque
            for change in (step, -step)
        )
        np.testing.assert_allclose(column, (more - less) / (2 * step), atol=2e-3, err_msg=name)


def test_a_payload_of_a_calibrated_log_is_taken_off() -> None:
    """With torque in N m the payload's share is known, and the inertia is the joint's own."""
    fit = fit_rows(equation_rows(COMMON, payload=PAYLOAD), Model())
    assert fit.values == pytest.approx(list(COMMON.values()), rel=1e-6)


@pytest.mark.parametrize("unknown", [False, True], ids=["known", "unknown"])
@pytest.mark.parametrize("law", FITTED)
def test_unseen_rows_are_predicted(law: Law, unknown: bool) -> None:
    """A fit of the first half, payload included, predicts the torque of the second half."""
    rows = equation_rows(truth(law, False), strength=0.8 if unknown else 1.0, payload=PAYLOAD, middle=MIDDLE)
    seen, unseen = rows.take(rows.time < 10), rows.take(rows.time >= 10)
    fit = fit_rows(seen, Model(law, False, MIDDLE), unknown)
    np.testing.assert_allclose(predict_torque(fit, unseen), unseen.torque, atol=2e-3)


@pytest.mark.parametrize("law", FITTED)
@pytest.mark.parametrize("unknown", [False, True], ids=["known", "unknown"])
def test_the_rigid_part_is_what_is_not_friction(law: Law, unknown: bool) -> None:
    """Inertia, gravity and payload by hand, and the offset where it is not friction that differs by direction."""
    values, strength = truth(law, law != "stribeck"), 0.8 if unknown else 1.0
    rows = equation_rows(values, strength=strength, payload=None if law == "load" else PAYLOAD, middle=MIDDLE)
    fit = fit_rows(rows, Model(law, law != "stribeck", MIDDLE), unknown and law != "load")
    expected = values["inertia"] * rows.acceleration + values.get("offset", 0.0) + rows.payload
    expected = expected + values.get("gravity_sin", 0.0) * np.sin(rows.position)
    expected = expected + values.get("gravity_cos", 0.0) * np.cos(rows.position)
    np.testing.assert_allclose(rigid_torque(fit, rows), expected / strength, atol=3e-3)
    friction = predict_torque(fit, rows) - rigid_torque(fit, rows)
    assert np.all(friction * rows.velocity > 0)


def test_inflation_of_two_nearly_equal_columns() -> None:
    """Two columns that differ by 1 %: each is 100 times longer than what the other leaves of it.

    With e and o of the same length at right angles, columns e and e + 0.01 o leave of each other 0.01 o and less.
    """
    rows = equation_rows(COMMON)
    fit = fit_rows(rows, Model())
    angle = np.linspace(0, 2 * np.pi, 1000, endpoint=False)
    one, other, third = np.sin(angle), np.cos(angle), np.sin(3 * angle)
    jacobian = np.column_stack([one, one + 0.01 * other, third, np.cos(5 * angle)])
    inflation = replace(fit, jacobian=jacobian).inflation
    assert inflation["inertia"] == pytest.approx(np.sqrt(1 + 0.01**-2), rel=1e-6)
    assert inflation["viscous_friction"] == pytest.approx(np.sqrt(1 + 0.01**-2), rel=1e-6)
    assert inflation["coulomb_friction"] == pytest.approx(1.0) and inflation["offset"] == pytest.approx(1.0)
    # Unit columns at a cosine of 1/√1.0001: eigenvalues 1 ± cosine, condition √((1 + c)/(1 − c)).
    cosine = 1 / np.sqrt(1.0001)
    assert replace(fit, jacobian=jacobian).scaled_condition == pytest.approx(np.sqrt((1 + cosine) / (1 - cosine)))


def test_good_motion_passes_and_one_speed_does_not() -> None:
    """At one speed B θ' and b_c sign(θ') are one signal; the message names what is not told, and the log."""
    rows = equation_rows(COMMON)
    check_fit("good.csv", fit_rows(rows, Model()))
    steady = replace(rows, velocity=2.0 * rows.direction + 1e-4 * np.sin(rows.time))
    with pytest.raises(LogError, match=r"bad\.csv: excitation too poor: (viscous|coulomb)_friction cannot be told"):
        check_fit("bad.csv", fit_rows(steady, Model()))


@pytest.mark.parametrize("apart", [0.0, 1e-9, 1e-6, 1e-3])
def test_two_columns_that_are_nearly_or_quite_the_same_are_refused(apart: float) -> None:
    """An acceleration that is the velocity: inertia is not told from viscous friction, least of all at a gap of 0."""
    rows = equation_rows(COMMON)
    same = replace(rows, acceleration=3.0 * rows.velocity + apart * np.sin(7 * rows.time))
    fit = fit_rows(same, Model())
    assert min(fit.inflation["inertia"], fit.inflation["viscous_friction"]) > 1e3
    with pytest.raises(LogError, match=r"(inertia|viscous_friction) cannot be told"):
        check_fit("log", fit)


def test_a_payload_that_the_links_own_weight_hides_is_refused() -> None:
    """Payload and link pull alike at every angle, and their inertias are one: the message says which log is missing."""
    rows = equation_rows(COMMON | WEIGHT, strength=0.8, payload=PAYLOAD)
    with pytest.raises(LogError, match=r"leg\.csv: the payload's weight cannot be told from the link's own.*--repeat"):
        check_fit("leg.csv", fit_rows(rows, Model(gravity=True), strength_unknown=True))
    check_fit("bare.csv", fit_rows(equation_rows(COMMON, payload=PAYLOAD), Model(), strength_unknown=True))
