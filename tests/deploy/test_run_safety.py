"""Each rule of safety at its limit, with numbers worked out by hand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from deployed import CONTRACT, JOINTS, PERIOD, state
from stiction.core.errors import ConfigurationError
from stiction.deploy.control import JointCommand
from stiction.deploy.runtime.config import SafetyCfg
from stiction.deploy.runtime.safety import OTHER_FIELDS, Safety, tilt

CFG = SafetyCfg()


def leaning(angle: float) -> np.ndarray:
    """Return the orientation of a base that leans about its y axis [rad]."""
    return np.array([np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0])


def test_the_tilt_and_where_it_leads() -> None:
    """A robot that tips over is called level: the sign of −ω × g, or the frame of ω, is wrong."""
    now, ahead = tilt(leaning(0.3), np.zeros(3), 0.3)
    assert (now, ahead) == (pytest.approx(0.3), pytest.approx(0.3))
    # From 0.3 rad at 1 rad/s further: gravity moves by 0.3 across itself, so the angle grows by atan(0.3).
    assert tilt(leaning(0.3), np.array([0.0, 1.0, 0.0]), 0.3)[1] == pytest.approx(0.3 + np.arctan(0.3))
    assert tilt(leaning(0.3), np.array([0.0, -1.0, 0.0]), 0.3)[1] == pytest.approx(abs(0.3 - np.arctan(0.3)))
    # Turning about the vertical tilts nothing.
    up_in_base = np.array([-np.sin(0.3), 0.0, np.cos(0.3)])
    assert tilt(leaning(0.3), 5.0 * up_in_base, 0.3)[1] == pytest.approx(0.3)


ONE = np.eye(JOINTS)[3]


@pytest.mark.parametrize(
    ("rule", "limit", "reading"),
    [
        ("tilt", CFG.tilt, lambda x: {"quaternion": leaning(x)}),
        ("predicted tilt", CFG.predicted_tilt, lambda x: {"angular_velocity": [0.0, np.tan(x) / CFG.horizon, 0.0]}),
        ("joint speed", CFG.joint_speed, lambda x: {"joint_velocity": -x * ONE}),
        ("temperature", CFG.temperature, lambda x: {"temperature": x * ONE}),
        ("torque", CFG.torque, lambda x: {"joint_torque": -x * CONTRACT.torque_limit[3] * ONE}),
        ("flailing", CFG.flailing, lambda x: {"joint_velocity": np.full(JOINTS, x)}),
    ],
)
def test_each_rule_at_its_limit(rule: str, limit: float, reading: Callable[[float], dict]) -> None:
    """A rule is never broken, broken too soon, or names another joint."""
    within, beyond = (
        {name: np.asarray(values) for name, values in reading(limit + more).items()} for more in (-1e-3, 1e-3)
    )
    safety = Safety(CONTRACT, CFG, PERIOD)
    assert all(safety.check(state(n, n * PERIOD, **within)) is None for n in range(400))
    safety = Safety(CONTRACT, CFG, PERIOD)
    violations = [safety.check(state(n, n * PERIOD, **beyond)) for n in range(400)]
    first = next(n for n, broken in enumerate(violations) if broken is not None)
    window = {"torque": CFG.torque_seconds, "flailing": CFG.flailing_seconds}.get(rule, PERIOD)
    assert first + 1 == round(window / PERIOD)
    broken = violations[first]
    assert broken is not None and broken.rule == rule
    of_joint = rule in ("joint speed", "temperature", "torque")
    assert broken.joint == (CONTRACT.joint_names[3] if of_joint else None)
    assert broken.value == pytest.approx(broken.limit, rel=0.01) and broken.value > broken.limit


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", OTHER_FIELDS)
def test_a_number_that_is_none_is_found_wherever_it_is(name: str, value: float) -> None:
    """A value that is no number is found in one motor, foot or axis."""
    vector = np.atleast_1d(getattr(state(1, 0.0), name)).astype(float)
    good = np.where(np.isnan(vector), 1.0, vector)
    wrong = good.copy()
    wrong[-1] = value
    safety = Safety(CONTRACT, CFG, PERIOD)
    single = name == "battery"
    assert single or safety.finite(state(1, 0.0, **{name: good})) is None
    violation = safety.finite(state(2, PERIOD, **{name: float(wrong[0]) if single else wrong}))
    if single and np.isnan(value):
        # It never said its voltage until now.
        assert violation is None and safety.finite(state(3, 2 * PERIOD)) is None
        violation = safety.finite(state(4, 3 * PERIOD, battery=value))
    assert violation is not None and violation.rule == "not finite"
    assert violation.joint == (CONTRACT.joint_names[-1] if len(good) == JOINTS else None)


def test_what_a_robot_never_says_is_not_judged_and_what_it_said_must_go_on() -> None:
    """A robot without sensors of torque walks; one whose torques end all at once is stopped."""
    unknown = {"joint_torque": np.full(JOINTS, np.nan), "foot_contact": np.full(6, np.nan), "battery": np.nan}
    safety = Safety(CONTRACT, CFG, PERIOD)
    assert all(safety.finite(state(n, n * PERIOD, **unknown)) is None for n in range(5))
    assert safety.finite(state(5, 5 * PERIOD)) is None
    violation = safety.finite(state(6, 6 * PERIOD, joint_torque=np.full(JOINTS, np.nan)))
    assert violation is not None and violation.rule == "not finite"
    assert safety.finite(state(7, 7 * PERIOD, command=np.nan)) is None
    broken = safety.finite(state(8, 8 * PERIOD, command=np.inf))
    assert broken is not None and broken.rule == "not finite"


def test_lost_states_are_judged_by_their_share_of_a_second() -> None:
    """Three of ten in the mean over a second pass, more do not; a burst that is shorter does not; 500 a second."""

    def first(share: float, lasting: float = 3.0) -> float | None:
        """Return when, after the first second without losses, a share of losses is found [s]."""
        safety, bad = Safety(CONTRACT, CFG, PERIOD), 0.0
        for n in range(2000):
            at = n * PERIOD
            bad += share if 1.0 < at <= 1.0 + lasting else 0.0
            if (broken := safety.losses(bad, n, at)) is not None:
                assert (broken.rule, broken.limit) == ("lossy link", 0.3) and broken.value > 0.3
                return at - 1.0
        return None

    assert first(0.29) is None and first(1.0, lasting=0.29) is None
    # 0.3 of a second's states are lost after 0.3 s, or 0.6 s; looked at ten times a second.
    assert first(1.0) == pytest.approx(0.35, abs=0.06) and first(0.5) == pytest.approx(0.65, abs=0.06)


def test_what_is_lost_while_the_supervisor_itself_halts_is_no_fault_of_the_link() -> None:
    """A busy computer that does not read for 0.4 s, and so loses 0.3 s of states, is told that its cable is bad."""
    safety, halted, times = Safety(CONTRACT, CFG, PERIOD), (1.5, 1.9), []
    for n in range(2000):
        at = n * PERIOD
        if not halted[0] < at < halted[1]:
            bad = 0.3 / PERIOD if at > halted[1] + PERIOD else 0.0
            times += [at] if safety.losses(bad + max(0.0, 0.5 * (n - 1500)), n, at) is not None else []
    # The link that loses half from 3 s on is still found.
    assert times[0] == pytest.approx(3.65, abs=0.06)
    # Nor is what the queue did not take while the run was prepared, found missing at the second look.
    safety = Safety(CONTRACT, CFG, PERIOD)
    assert all(safety.losses(0.4 / PERIOD * (n > 0), n, n * PERIOD) is None for n in range(2000))


def test_limits_that_are_none_are_refused() -> None:
    """A limit of NaN is never broken."""
    for wrong in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ConfigurationError, match="tilt"):
            SafetyCfg(tilt=wrong)


def test_a_torque_that_nobody_asked_for_is_another_joint_s() -> None:
    """Two motors are taken for each other, and the robot walks on; or a motor at its speed limit is called wrong."""
    kp, kd, limit = (CONTRACT.array(name) for name in ("kp", "kd", "torque_limit"))
    target = np.full(JOINTS, 0.1)
    asked = kp * target

    def broken_rule(torque: np.ndarray, speed: float = 0.0, steps: int = 100, every: int = 1) -> str | None:
        safety = Safety(CONTRACT, CFG, PERIOD)
        safety.commanded(JointCommand.position(target, kp, kd))
        for number in range(steps):
            moving = np.full(JOINTS, speed)
            here = np.full(JOINTS, -kd[0] * speed / kp[0])  # So that the gains ask for the same torque.
            robot_state = state(
                number, PERIOD * number * every, joint_position=here, joint_velocity=moving, joint_torque=torque
            )
            if (violation := safety.check(robot_state)) is not None:
                assert violation.joint == CONTRACT.joint_names[3] and violation.unit == "N m"
                assert violation.limit == pytest.approx(CFG.torque_error * limit[3])
                return violation.rule
        return None

    assert broken_rule(asked) is None
    off = 1.05 * CFG.torque_error * limit * ONE
    # A mean over 75 readings, behind the 3 that an answer takes.
    assert broken_rule(asked + off) == "torque and command" and broken_rule(asked + off, steps=77) is None
    assert broken_rule(asked + 0.95 * CFG.torque_error * limit * ONE) is None
    # A motor that is driven fast gives less than it is asked for, and never more; one that says nothing is not judged.
    assert broken_rule(asked - off, speed=7.0) is None and broken_rule(asked + off, speed=7.0) == "torque and command"
    assert broken_rule(np.where(ONE > 0, 0.0, asked)) is None and broken_rule(np.where(ONE > 0, np.nan, asked)) is None
    # Where most readings are lost, the one that came before says nothing of this one.
    assert broken_rule(asked + off, every=3) is None
    damped = Safety(CONTRACT, CFG, PERIOD)
    damped.commanded(JointCommand.position(target, 0.0 * kp, kd))
    assert all(damped.check(state(n, PERIOD * n, joint_torque=asked + off)) is None for n in range(100))
