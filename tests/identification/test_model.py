"""From a model's values to the joint that has them."""

from __future__ import annotations

import pytest

from stiction.core.errors import StictionError
from stiction.identification.model import LAWS, Model
from stiction.joints.friction import Asymmetric, Coulomb, Stribeck
from stiction.joints.simulate import Gravity, Joint


def test_each_law_becomes_its_joint() -> None:
    """Every value must land in its own field, gravity's included."""
    weight = Gravity(2.0, 0.5)
    assert Model().joint([0.01, 0.1, 0.3, -0.05]) == Joint(0.01, 0.1, Coulomb(0.3), -0.05)
    assert Model("stribeck").joint([0.01, 0.1, 0.3, -0.05, 0.5, 0.2]) == Joint(
        0.01, 0.1, Stribeck(0.3, 0.5, 0.2), -0.05
    )
    assert Model("load", True).joint([0.01, 0.1, 0.3, -0.05, 0.1, 2.0, 0.5]) == Joint(
        0.01, 0.1, Coulomb(0.3, 0.1), -0.05, weight
    )
    made = Model("asymmetric").joint([0.01, 0.1, 0.2, 0.5, 0.3])
    assert made.viscous == 0.0 and made.offset == pytest.approx(0.1)
    assert made.friction == Asymmetric(0.4, 0.4, 0.1, 0.2)
    # An offset of 0.5 over friction of 0.2 gives −0.3 backward, and is a joint all the same.
    assert Model("asymmetric").joint([0.01, 0.1, 0.1, 0.7, -0.3]).offset == pytest.approx(0.5)


@pytest.mark.parametrize("law", LAWS)
def test_values_that_no_joint_has_are_refused(law: str) -> None:
    """A value too few, or no inertia, must not become a joint."""
    model = Model(law)  # type: ignore[arg-type]
    with pytest.raises(StictionError, match=f"expected {len(model.names)}"):
        model.joint([0.1])
    with pytest.raises(StictionError, match="positive inertia"):
        model.joint([0.0, *[0.1] * (len(model.names) - 1)])
