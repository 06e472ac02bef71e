"""The table of friction laws, the two numbers that say how large friction is, and what friction cannot have."""

from __future__ import annotations

import pytest

from stiction.core.errors import StictionError
from stiction.joints.friction import (
    LAWS,
    Coulomb,
    Law,
    LawSpec,
    dead_band,
    friction_ratio,
    register_law,
    simulated_laws,
)


def test_dead_band_and_ratio_are_the_papers() -> None:
    """Saturn Lite's shank: 0.442 / 45 = 0.98 % of its torque, and 0.442 / 40 = 0.011 rad at kp 40."""
    assert friction_ratio(0.442, 45.0) == pytest.approx(0.0098, abs=5e-5)
    assert dead_band(0.442, 40.0) == pytest.approx(0.01105)


def test_impossible_values_are_refused() -> None:
    """Negative friction would drive the joint; NaN would spread."""
    for level in (-0.1, float("nan")):
        with pytest.raises(StictionError, match="not negative"):
            Coulomb(level)
    with pytest.raises(StictionError, match="positive limit"):
        friction_ratio(0.1, 0.0)
    with pytest.raises(StictionError, match="positive gain"):
        dead_band(0.1, 0.0)


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (LawSpec("coulomb", "again", factor=lambda: 1.0), "exists already"),
        (LawSpec("nothing", "has no form"), "neither a factor nor exact pieces"),
        (LawSpec("odd", "estimates what nobody knows", factor=lambda: 1.0, parameters=("rust",)), "'rust' has no unit"),
    ],
)
def test_a_law_that_cannot_be_is_not_registered(law: LawSpec, message: str) -> None:
    """It would be offered by every command, and fail in the middle of a walk."""
    before = dict(LAWS)
    with pytest.raises(StictionError, match=message):
        register_law(law)
    assert before == LAWS


def test_factors_by_hand() -> None:
    """1; half more at rest; 7 N and N m transmitted; 3 N m of the motor, whichever way."""
    signals = {"velocity": 0.0, "load": 7.0, "torque": -3.0}
    assert [float(Law(name).factor(**signals)) for name in simulated_laws()] == [1.0, 1.5, 7.0, 3.0]
