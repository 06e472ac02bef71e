"""From a model's values to the joint that has them."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.identification.model import LAWS, Model, nearest_joint
from stiction.joints.friction import Asymmetric, Coulomb, LoadDependent, Stribeck
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Gravity, Joint, simulate


def test_each_law_becomes_its_joint() -> None:
    """Every value must land in its own field, gravity's included."""
    weight = Gravity(2.0, 0.5)
    assert Model().joint([0.01, 0.1, 0.3, -0.05]) == Joint(0.01, 0.1, Coulomb(0.3), -0.05)
    assert Model("stribeck").joint([0.01, 0.1, 0.3, -0.05, 0.5, 0.2]) == Joint(
        0.01, 0.1, Stribeck(0.3, 0.5, 0.2), -0.05
    )
    assert Model("load", True).joint([0.01, 0.1, 0.3, -0.05, 0.1, 2.0, 0.5]) == Joint(
        0.01, 0.1, LoadDependent(0.3, 0.1), -0.05, weight
    )
    made = Model("asymmetric").joint([0.01, 0.1, 0.2, 0.5, 0.3])
    assert made.viscous == 0.0 and made.offset == pytest.approx(0.1)
    assert made.friction == Asymmetric(0.4, 0.4, 0.1, 0.2)
    # An offset of 0.5 over friction of 0.2 gives −0.3 backward, and is a joint all the same.
    assert Model("asymmetric").joint([0.01, 0.1, 0.1, 0.7, -0.3]).offset == pytest.approx(0.5)


def test_an_offset_and_friction_that_differs_by_direction_are_the_same() -> None:
    """0.5 forward and 0.3 backward move a joint as 0.4 with an offset of 0.1 does: the law holds either."""
    target, gains = 0.3 * np.sin(0.02 * np.arange(1000)), PDGains(20.0, 0.5)
    by_model = simulate(Model("asymmetric").joint([0.01, 0.1, 0.1, 0.5, 0.3]), gains, 0.002, target)
    by_law = simulate(Joint(0.01, 0.0, Asymmetric(0.5, 0.3, 0.1, 0.1)), gains, 0.002, target)
    np.testing.assert_allclose(by_model.position, by_law.position, atol=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_values_that_no_joint_has_are_refused(law: str) -> None:
    """A value too few, or no inertia, must not become a joint."""
    model = Model(law)  # type: ignore[arg-type]
    with pytest.raises(StictionError, match=f"expected {len(model.names)}"):
        model.joint([0.1])
    with pytest.raises(StictionError, match="positive inertia"):
        model.joint([0.0, *[0.1] * (len(model.names) - 1)])


def test_the_nearest_joint_of_an_estimate_has_no_friction_below_zero() -> None:
    """An offset, or what differs by direction, may be negative; dry friction may be so in an estimate alone."""
    values = {"inertia": 0.01, "viscous_friction": -0.1, "coulomb_friction": -0.02, "offset": -0.3}
    assert nearest_joint(values) == values | {"coulomb_friction": 0.0}
    values = {"static_friction": -1.0, "load_coefficient": 0.1}
    assert nearest_joint(values) == values | {"static_friction": 0.0}
