"""A load coefficient is of one law: into another it goes by the robot's loads, or not at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stiction.core.errors import ConfigurationError
from stiction.files.joints import LOAD_REGRESSORS, Estimate, JointRecord, JointsFile
from stiction.joints.friction import Law
from stiction.learning.begin import nominal_of
from stiction.learning.run import identified_values
from stiction.robots.catalog import find_robot
from stiction.robots.statics import HingeLoad
from stiction.sim.fleet import Fleet
from stiction.task.friction import FrictionCfg
from stiction.task.load_law import converted, load_warnings, take_coefficients
from stiction.task.randomization import nominal_joints

GO2 = find_robot("go2")
C = Estimate(0.1, 0.002, (0.096, 0.104))
ROD = HingeLoad(np.array([80.38]), np.array([20.0]), np.array([44.114]))
"""The rod of tests/robots/test_statics.py on its tip: 80.38 N, 20 N m about its centre, 44.114 N m about its axis."""


def record(value: float = 0.063, regressor: str = "gravity", **changes) -> JointRecord:
    """A joint whose friction grows with its load."""
    law = {
        "law": "load",
        "regressor": regressor,
        "parameters": {"coulomb_friction": Estimate(0.2, 0.0, (0.2, 0.2)).to_dict()},
    }
    estimate = Estimate(value, 0.001, (value - 0.002, value + 0.002))
    whole = Estimate(0.4, 0.01, (0.38, 0.42))
    return JointRecord(**({"coulomb_friction": whole, "load_coefficient": estimate, "friction_law": law} | changes))


def every(kind: JointRecord) -> JointsFile:
    """The same record for every joint of the Go2."""
    return JointsFile(dict.fromkeys(GO2.joint_kinds, kind))


@pytest.mark.parametrize("regressor", LOAD_REGRESSORS)
def test_a_coefficient_gives_the_same_torque_in_the_other_law(regressor: str) -> None:
    """0.1 of 44.114 N m is 4.4114 N m; so is 0.1 * 44.114 / 100.38 = 0.043947 of |F| + |T|."""
    conversion = converted(C, regressor, "load", ROD)
    assert conversion is not None and conversion.stable and conversion.spread == 0.0
    assert conversion.coefficient.value == pytest.approx(0.0439470, rel=1e-5)
    assert conversion.coefficient.interval95 == pytest.approx((0.0421891, 0.0457049), rel=1e-5)
    friction = conversion.coefficient.value * Law("load").factor(velocity=0.0, load=ROD.size[0], torque=0.0)
    assert friction == pytest.approx(0.1 * 44.114)


def test_a_pendulum_in_the_air_has_no_one_coefficient() -> None:
    """It hangs on m g at every angle, and the motor holds m g l sin θ: from 0.1 to 1 rad the ratio is 0.03 to 0.25."""
    angle = np.linspace(0.1, 1.0, 101)
    weight = np.full(101, 2 * 9.81)
    conversion = converted(C, "gravity", "load", HingeLoad(weight, np.zeros(101), weight * 0.3 * np.sin(angle)))
    assert conversion is not None and not conversion.stable
    mean = 0.3 * np.sin(angle).mean()
    low, high = 0.3 * np.sin(0.1 + 0.9 * 0.05), 0.3 * np.sin(0.1 + 0.9 * 0.95)
    assert conversion.coefficient.value == pytest.approx(0.1 * mean)
    assert conversion.coefficient.interval95 == pytest.approx((0.096 * low, 0.104 * high))
    assert conversion.spread == pytest.approx((high - low) / 2 / mean)


@pytest.mark.parametrize("regressor", LOAD_REGRESSORS)
def test_effort_takes_it_as_it_is_joint_by_joint(regressor: str) -> None:
    """At rest the motor's torque is the load: each kind keeps its own coefficient, and what is left out is said."""
    file = JointsFile(
        {"hip": record(0.05, regressor), "thigh": record(0.063, regressor), "calf": record(0.09, regressor)}
    )
    values, how = take_coefficients(file, GO2, "effort")
    assert values == pytest.approx((0.05, 0.063, 0.09) * 4)
    assert len(how) == 3 and all(LOAD_REGRESSORS[regressor] in text for text in how)
    assert "friction without load, 0.2 N m, is" in how[0] and "--friction-law coulomb" in how[0]


def test_load_is_refused_where_its_ratio_changes_with_the_pose() -> None:
    """A Go2's thigh has 0.009 to 0.15 of its |F| + |T| about its axis as it stands: a range, and no level."""
    with pytest.raises(
        ConfigurationError, match=r"not one coefficient of the law load on go2, but .* poses.*at most 25%"
    ):
        take_coefficients(every(record()), GO2, "load")


@pytest.mark.parametrize(
    ("regressor", "law", "level", "message"),
    [
        ("motor_torque", "effort", 0.2, "is of the law effort: --friction-level 0.063 trains with it"),
        ("gravity", "effort", 0.2, "is of the law effort: --friction-level 0.063 trains with it"),
        ("motor_torque", "coulomb", 0.2, "is not used: the law coulomb does not depend on load; --friction-law effort"),
        ("gravity", "load", 0.2, "on go2 it would be 0.00"),
        ("gravity", "load", 0.063, None),
        ("motor_torque", "load", 0.064, None),
    ],
)
def test_a_load_coefficient_is_of_one_law(regressor: str, law: str, level: float, message: str | None) -> None:
    """0.063 of the motor's torque is not 0.063 of |F| + |T|: passed on as a level, it trains another law."""
    friction = FrictionCfg(method="direct", level=level, law=law)
    file = JointsFile({"calf": record(0.063, regressor)})
    if message is None:
        with pytest.raises(
            ConfigurationError, match=r"looks like the load_coefficient of 'calf', 0.063 of .*another law"
        ):
            load_warnings(file, GO2, friction)
    else:
        (warning,) = load_warnings(file, GO2, friction)
        assert message in warning and LOAD_REGRESSORS[regressor] in warning


def test_training_has_each_joints_own_coefficient(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """No --friction-level: the file's go into the run's record with a line a kind on how, and into every robot."""
    JointsFile({"hip": record(0.05), "thigh": record(0.063), "calf": record(0.09)}).write(tmp_path / "joints.json")
    friction = FrictionCfg(method="direct", law="effort")
    lines: list[str] = []
    header = nominal_of(str(tmp_path / "joints.json"), "go2", (), friction, lines.append)
    assert header is not None and header["values"]["load_coefficient"] == pytest.approx([0.05, 0.063, 0.09] * 4)
    assert len(header["load_coefficient"]) == 3 and "at rest the motor's torque is the load" in lines[0]
    nominal = nominal_joints(Fleet(GO2, 1), friction, identified_values({"identified": header}))
    assert nominal.frictionloss == pytest.approx([0.05, 0.063, 0.09] * 4)
    with pytest.raises(ConfigurationError, match="say --friction-level"):
        nominal_joints(Fleet(GO2, 1), friction)
