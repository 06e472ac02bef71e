"""A walking log from start to records that training can take."""

from dataclasses import replace

import numpy as np
import pytest

import walks
from estimates import holds
from stiction.core.errors import StictionError
from stiction.files.joints import JointsFile
from stiction.files.walk import SIGNALS, WalkLog
from stiction.identification.walking.pipeline import identify_walk, standing_inertia
from stiction.identification.walking.setup import WalkSetup
from stiction.identification.walking.walk import Walk

FRICTION = 0.1 * walks.LIMITS


@pytest.fixture(scope="module")
def log() -> WalkLog:
    """A walk with friction of a tenth of the torque limit."""
    return walks.walk(FRICTION[None], [walks.FORWARD], seed=7)[0]


@pytest.fixture(scope="module")
def file(log: WalkLog) -> JointsFile:
    """Return the joints.json of a walk."""
    return identify_walk(Walk(log, walks.SPEC)).joints


def test_every_joint_has_a_record_by_name_or_by_kind(file: JointsFile) -> None:
    """`train --joints` asks for each joint by name: the truth is in most intervals (see test_swing.py)."""
    inside = []
    for name, friction, limit in zip(walks.SPEC.joint_names, FRICTION, walks.LIMITS, strict=True):
        record = file.record(name)
        inside += [holds(record.coulomb_friction, friction), holds(record.friction_ratio, friction / limit)]
        inside += [holds(record.dead_band, friction / 100.0)]
        assert (record.test_condition, record.torque_source, record.kp) == ("in_air", "motor_side", 100.0)
        assert record.diagnostics["verdict"]["friction_level"] is not None
        assert record.load_coefficient is None
    assert np.mean(inside) >= 0.8
    nominal = file.nominal(walks.SPEC.joint_names, "coulomb_friction")
    np.testing.assert_allclose(nominal, FRICTION, rtol=0.2)


def test_inertia_is_that_of_a_leg_in_the_air(file: JointsFile) -> None:
    """Whoever reads `in_air` takes the links' standing inertia off and must be left with the rotor's."""
    from stiction.sim.fleet import Fleet
    from stiction.task.randomization import identified_joints

    links = standing_inertia(walks.SPEC)
    np.testing.assert_allclose(links, Fleet(walks.SPEC, 1).link_inertia(), rtol=1e-9)
    armature = identified_joints(file, walks.SPEC.joint_names, links, walks.LIMITS).armature
    np.testing.assert_allclose(np.array(armature, float), walks.ARMATURE, rtol=0.25)


def test_known_masses_add_what_load_does(log: WalkLog) -> None:
    """The law stands beside the symmetric fit; here friction does not grow with load, and the interval says so."""
    setup = WalkSetup(mass_known=True, centre_of_mass=walks.centre_of_mass())
    record = identify_walk(Walk(log, walks.SPEC, setup)).joints.record("FL_shank")
    assert holds(record.load_coefficient, 0.0)
    assert record.friction_law is not None
    assert record.friction_law["law"] == "load"
    name, friction = next(iter(record.combinations.items()))
    assert name.startswith("coulomb_friction + ")
    assert holds(friction, FRICTION[2])


def test_without_torque_newton_metres_are_null(log: WalkLog) -> None:
    """The controller's torque is a command: ratio and dead band stay, wide, and the truth is in them."""
    file = identify_walk(Walk(replace(log, joint_torque=None), walks.SPEC)).joints
    inside = []
    for name, friction, limit in zip(walks.SPEC.joint_names, FRICTION, walks.LIMITS, strict=True):
        record = file.record(name)
        assert record.coulomb_friction is record.inertia is record.torque_source is None
        inside.append(holds(record.friction_ratio, friction / limit))
        assert any("torque was not logged" in text for text in record.warnings)
    assert np.mean(inside) >= 0.85


@pytest.mark.parametrize(
    ("missing", "warning"), [("specific_force", "accelerometer"), ("foot_contact", "contact was not logged")]
)
def test_what_the_log_lacks_widens_and_is_said(log: WalkLog, missing: str, warning: str) -> None:
    """The truth is in the intervals all the same."""
    file = identify_walk(Walk(replace(log, **{missing: None}), walks.SPEC)).joints
    inside = [
        holds(file.record(name).coulomb_friction, friction)
        for name, friction in zip(walks.SPEC.joint_names, FRICTION, strict=True)
        if file.record(name).coulomb_friction is not None
    ]
    assert len(inside) >= 12 and np.mean(inside) >= 0.9
    assert all(any(warning in text for text in record.warnings) for record in file.joints.values())


def cut(log: WalkLog, part: slice, period: float = 0.005) -> WalkLog:
    """Return a part of a log, its samples `period` apart [s]."""
    signals = {name: array[part] for name in SIGNALS if (array := getattr(log, name)) is not None}
    return WalkLog(replace(log.header, period=period), **signals)


def test_a_walk_that_tells_nothing_is_refused(log: WalkLog) -> None:
    """One line, and what to do."""
    with pytest.raises(StictionError, match="log for longer"):
        identify_walk(Walk(cut(log, slice(80)), walks.SPEC))
    assert log.foot_contact is not None
    with pytest.raises(StictionError, match=r"does not excite any joint.*log for longer"):
        identify_walk(Walk(replace(log, foot_contact=np.ones_like(log.foot_contact)), walks.SPEC))


def test_the_control_rate_is_too_slow(log: WalkLog) -> None:
    """At 50 Hz a swing has eight samples: refused, not guessed at."""
    with pytest.raises(StictionError, match="Hz or more"):
        identify_walk(Walk(cut(log, slice(None, None, 4), 0.02), walks.SPEC))


@pytest.mark.parametrize(
    "change",
    [
        {"joint_torque": np.zeros((2000, 18))},
        {"joint_position": np.zeros((2000, 18))},
        {"joint_position": np.random.default_rng(0).normal(size=(2000, 18))},
        {"joint_torque": 1e6 * np.random.default_rng(0).normal(size=(2000, 18)).clip(-1, 1)},
        {"angular_velocity": 1e6 * np.random.default_rng(0).uniform(-1, 1, (2000, 3))},
        {"foot_contact": np.zeros((2000, 6), bool)},
        {"foot_contact": np.random.default_rng(0).random((2000, 6)) < 0.5},
    ],
)
@pytest.mark.filterwarnings("error")
def test_nonsense_is_refused_in_one_line(log: WalkLog, change: dict) -> None:
    """Whatever stands in a log: an answer or a refusal, no traceback and no warning of NumPy's."""
    with pytest.raises(StictionError) as caught:
        identify_walk(Walk(replace(log, **change), walks.SPEC, WalkSetup(mass_known=True)))
    assert "\n" not in str(caught.value)
