"""Rejects implausible readings: each attack is one fault of a real deployment on a robot that walks."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from bundles import make_contract
from stiction.core.errors import ConfigurationError, PolicyError
from stiction.core.rotation import about, product
from stiction.deploy.observation import Sensors
from stiction.deploy.plausibility import RULES, ClockRate, ReadingGuard, Violation, compare_drive
from stiction.files.contract import Contract

WALK = np.array([0.5, 0.0, 0.2])
PERIOD = 0.02
Attack = Callable[[float, Sensors], tuple[float, Sensors]]


def walking(contract: Contract, seconds: float = 2.0, period: float = PERIOD, yaw: float = 0.3, noise: float = 1.0
            ) -> Iterator[tuple[float, Sensors]]:  # fmt: skip
    """Yield times and readings of a robot that turns at 0.5 rad/s, pitches at 2 Hz, and swings its joints at 1.5 Hz."""
    draw = np.random.default_rng(0).standard_normal
    joints = contract.num_joints
    phase = np.linspace(0, 2 * np.pi, joints)
    for step in range(round(seconds / period)):
        t = step * period
        pitch, rate = 0.1 * math.sin(4 * np.pi * t), 0.4 * np.pi * math.cos(4 * np.pi * t)
        turned = product(about(2, yaw + 0.5 * t), about(1, pitch))
        turned = turned + noise * 0.002 * draw(4)
        # The rate of the heading, 0.5 rad/s about the world's z, as the pitched base sees it.
        gyro = np.array([-0.5 * math.sin(pitch), rate, 0.5 * math.cos(pitch)]) + noise * 0.05 * draw(3)
        angle = contract.array("standing") + 0.3 * np.sin(3 * np.pi * t + phase) + noise * 0.003 * draw(joints)
        speed = 0.9 * np.pi * np.cos(3 * np.pi * t + phase) + noise * 0.2 * draw(joints)
        yield 100.0 + t, Sensors(turned / np.linalg.norm(turned), gyro, angle, speed)


def first(contract: Contract, attack: Attack, start: float = 0.0, **options) -> tuple[float, Violation] | None:
    """Return the time of the first finding on an attacked walk, from its start [s], and the finding; None without."""
    guard = ReadingGuard(contract)
    for time, sensors in walking(contract, **options):
        reading = attack(time, sensors) if time - 100.0 >= start else (time, sensors)
        if (violation := guard.check(*reading, WALK)) is not None:
            return time - 100.0 - start, violation
    return None


@pytest.mark.parametrize("period", [0.002, 0.02, 0.05])
def test_a_walk_is_plausible(contract: Contract, period: float) -> None:
    """No finding on a walk at any rate of readings."""
    assert first(contract, lambda t, s: (t, s), period=period) is None
    assert first(contract, lambda t, s: (t, s), period=period, yaw=2.0) is None


def test_recordings_of_shipped_policies_are_plausible() -> None:
    """Walks of MuJoCo with the noise of training, 0.5 rad/s at each joint, stairs among them."""
    from stiction.files.bundle import read_bundle, shipped_bundles

    for path in shipped_bundles().values():
        bundle = read_bundle(path)
        golden, guard = bundle.golden, ReadingGuard(bundle.contract)
        walked = np.ones(len(golden), dtype=bool) if golden.walked is None else golden.walked
        for t in np.flatnonzero(walked):
            if golden.reset[t]:
                guard.reset()
            parts = (golden.quaternion, golden.angular_velocity, golden.joint_position, golden.joint_velocity)
            assert guard.check(float(golden.time[t]), Sensors(*(part[t] for part in parts)), golden.command[t]) is None


def swapped(s: Sensors) -> Sensors:
    """Return readings with the quaternion in the order x, y, z, w."""
    return replace(s, quaternion=np.roll(s.quaternion, -1))


def spiked(s: Sensors, name: str, joint: int, value: float) -> Sensors:
    """Return readings with one number replaced."""
    values = np.array(getattr(s, name))
    values[joint] = value
    return replace(s, **{name: values})


def degrees(t: float, s: Sensors, name: str) -> tuple[float, Sensors]:
    """Return a reading with angles, or rates, in degrees."""
    return t, replace(s, **{name: np.degrees(getattr(s, name))})


ATTACKS: dict[str, tuple[str, float, Attack]] = {
    "angles in degrees": ("joint range", 0.0, lambda t, s: degrees(t, s, "joint_position")),
    "speeds in degrees": ("joint rate", 0.3, lambda t, s: degrees(t, s, "joint_velocity")),
    "gyroscope in degrees": ("turn rate", 0.1,
                             lambda t, s: degrees(t, s, "angular_velocity")),
    "gyroscope turned round": ("attitude and gyroscope", 1.5,
                               lambda t, s: (t, replace(s, angular_velocity=-3 * s.angular_velocity))),
    "zero quaternion": ("quaternion length", 0.0, lambda t, s: (t, replace(s, quaternion=np.zeros(4)))),
    "doubled quaternion": ("quaternion length", 0.0, lambda t, s: (t, replace(s, quaternion=2 * s.quaternion))),
    "NaN in a joint": ("not finite", 0.0, lambda t, s: (t, spiked(s, "joint_velocity", 3, np.nan))),
    "NaN in the gyroscope": ("not finite", 0.0, lambda t, s: (t, spiked(s, "angular_velocity", 1, np.nan))),
    "NaN time": ("not finite", 0.0, lambda t, s: (np.nan, s)),
    "milliseconds": ("time jump", PERIOD, lambda t, s: (1000 * t, s)),
    "an encoder that wraps": ("joint jump", 0.0,
                              lambda t, s: (t, spiked(s, "joint_position", 4, float(s.joint_position[4]) + 1.25))),
    "velocities of other joints": ("velocity and angle", 1.0,
                                   lambda t, s: (t, replace(s, joint_velocity=4 * s.joint_velocity[::-1]))),
    "a base upside down": ("leans at the start", 0.0,
                           lambda t, s: (t, replace(s, quaternion=product(about(0, np.pi), s.quaternion)))),
}  # fmt: skip


@pytest.mark.parametrize("name", ATTACKS)
@pytest.mark.parametrize("late", [False, True])
def test_an_attack_is_found(contract: Contract, name: str, late: bool) -> None:
    """From the first reading on, and on a walking robot; a robot that leans at the start may fall later."""
    rule, within, attack = ATTACKS[name]
    start = 0.5 if late else PERIOD if name == "an encoder that wraps" else 0.0
    alarm = first(contract, attack, start)
    assert alarm is not None, "it acts"
    expected = {rule, "attitude and gyroscope", "orientation jump"} if late else {rule}
    assert alarm[1].rule in expected
    assert alarm[0] <= (1.5 if late else within + 1.1 * PERIOD)


def test_a_quaternion_in_the_other_order_is_found_at_once_whichever_way_the_robot_looks(contract: Contract) -> None:
    """A level robot with heading 0 reads as level, turned by 180°, in x, y, z, w; it is found nevertheless."""
    guard = ReadingGuard(contract)
    for yaw in np.radians(np.arange(-180, 180, 5.0)):
        _, sensors = next(walking(contract, yaw=yaw))
        guard.reset()
        violation = guard.check(0.0, swapped(sensors), WALK)
        assert violation is not None and violation.rule in ("leans at the start", "half turn at the start")
        assert "w, x, y, z" in RULES[violation.rule].hint
        guard.reset()
        # 5.7° to either side of a half turn are refused although the order is right: both readings are the same.
        right = guard.check(0.0, sensors, WALK)
        assert right is None or (right.rule == "half turn at the start" and abs(abs(yaw) - np.pi) < np.radians(12))


def test_sensors_that_froze_do_not_act(contract: Contract) -> None:
    """A computer whose robot is no longer read sees the last reading again, with new times: for 0.1 s, not for 4."""
    for period in (0.002, 0.02):
        readings = list(walking(contract, 1.0, period))
        held = readings[len(readings) // 2][1]
        alarm = first(contract, lambda t, s, held=held: (t, held), start=0.5, period=period)
        rules = ("frozen IMU", "attitude and gyroscope")  # The gyroscope goes on turning, the orientation does not.
        assert alarm is not None and alarm[1].rule in rules and alarm[0] <= 0.1 + 1.1 * period


def test_a_frozen_reading_stays_refused(contract: Contract) -> None:
    """Rejects every reading of a frozen robot after the first six."""
    guard, refused = ReadingGuard(contract), []
    _, held = next(walking(contract))
    for step in range(200):
        refused.append(guard.check(step * PERIOD, held, WALK) is not None)
    assert sum(refused) >= 194 and all(refused[6:])


def test_an_imu_and_an_encoder_freeze_alone(contract: Contract) -> None:
    """Each sensor is judged alone: the rest still changes. A joint that friction holds for two seconds is not dead."""
    _, held = list(walking(contract, 0.5))[-1]
    imu = first(
        contract, lambda t, s: (t, replace(s, quaternion=held.quaternion, angular_velocity=held.angular_velocity)), 0.5
    )
    assert imu is not None and imu[1].rule == "frozen IMU" and imu[0] <= 0.12

    def dead(time: float, s: Sensors) -> tuple[float, Sensors]:
        at = float(held.joint_position[7])
        return time, spiked(spiked(s, "joint_position", 7, at), "joint_velocity", 7, 0.0)

    assert first(contract, dead, 0.5, seconds=2.6) is None
    joint = first(contract, dead, 0.5, seconds=4.0)
    assert joint is not None and (joint[1].rule, joint[1].joint) == ("frozen joint", contract.joint_names[7])
    assert joint[0] <= 3.02


def test_an_angle_or_a_gyroscope_that_is_read_no_more_is_found_beside_what_goes_on(contract: Contract) -> None:
    """A policy walks on a dead encoder or gyroscope; a joint that rests, or a still robot, is called dead."""
    for period in (0.002, 0.02):
        _, held = list(walking(contract, 0.5, period))[-1]
        angle = float(held.joint_position[7])
        alarm = first(contract, lambda t, s, at=angle: (t, spiked(s, "joint_position", 7, at)), 0.5, period=period)
        assert alarm is not None and alarm[0] <= 0.2
        assert (alarm[1].rule, alarm[1].joint) == ("frozen angle", contract.joint_names[7])
        dead = first(contract, lambda t, s: (t, replace(s, angular_velocity=np.zeros(3))), 0.5, period=period)
        assert dead is not None and dead[0] <= 0.13
        assert dead[1].rule in ("frozen gyroscope", "attitude and gyroscope")
    # A joint whose encoder is coarse, and whose velocity is noise about zero: it stands.
    guard, noise = ReadingGuard(contract), np.random.default_rng(1)
    for time, sensors in walking(contract, 4.0, 0.002):
        rests = spiked(spiked(sensors, "joint_position", 7, angle), "joint_velocity", 7, 0.1 * noise.standard_normal())
        assert guard.check(time, rests, WALK) is None


def test_clocks_of_two_rates_are_found_and_one_step_is_none() -> None:
    """A robot's clock at half speed halves every difference; a clock that was set once is no clock that is slow."""

    def delay(rate: float, step: float = 0.0) -> float | None:
        clock = ClockRate(RULES["clock rate"].limit)
        for number in range(500):
            now = 0.002 * number
            if (violation := clock.check(rate * now + step * (number > 250), now)) is not None:
                assert violation.rule == "clock rate"
                return now
        return None

    assert delay(1.0) is None and delay(1.0, 0.09) is None and delay(1.0, -0.09) is None and delay(0.7) is None
    # 1 ms in each 2 ms: 0.08 s are over behind 81 steps, and the largest that is left out.
    assert delay(0.5) == pytest.approx(0.164, abs=0.003) and delay(1.5) == pytest.approx(0.164, abs=0.003)


def test_time_goes_on(contract: Contract) -> None:
    """Rejects a clock that stands or goes back, and a late reading."""
    guard = ReadingGuard(contract)
    readings = [sensors for _, sensors in walking(contract, 0.5)]

    def rule(time: float, now: float | None = None) -> str | None:
        violation = guard.check(time, readings.pop(), np.zeros(3), now)
        return None if violation is None else violation.rule

    guard.limits["joint jump"] = guard.limits["attitude and gyroscope"] = guard.limits["velocity and angle"] = math.inf
    assert rule(1.0) is None and rule(1.02, now=1.06) is None
    assert rule(1.02) == rule(1.0) == "time stands still"
    assert rule(1.04, now=1.10) == "stale reading"
    assert rule(1.06, now=math.nan) == "stale reading"
    assert rule(1.2) == "time jump" and rule(1.22) is None
    guard.reset()
    assert rule(0.0) is None


def test_commands_end_where_training_did() -> None:
    """Rejects commands beyond the training's range, or beyond an assumed range in older bundles."""
    told = make_contract(command_range={"forward": (0.0, 1.5), "sideways": (0.0, 0.0), "turn": (-1.0, 1.0)})
    _, sensors = next(walking(told))
    cases = [([1.5, 0, -1], None), ([1.6, 0, 0], "m/s forward"), ([-0.1, 0, 0], "m/s forward"),
             ([0, 0.1, 0], "m/s sideways"), ([1e9, 0, 0], "m/s forward"), ([0, math.nan, 0], "m/s sideways"),
             ([0, 0, -1.2], "rad/s turn")]  # fmt: skip
    for command, unit in cases:
        violation = ReadingGuard(told).check(0.0, sensors, np.array(command))
        assert (None if violation is None else violation.unit) == unit, command
    older = ReadingGuard(make_contract())
    assert older.assumed_range and not ReadingGuard(told).assumed_range
    violation = older.check(0.0, sensors, np.array([0.9, 0, 0]))
    assert violation is not None and (violation.rule, violation.limit) == ("command", 0.8)


def test_limits_can_be_changed_and_switched_off(contract: Contract) -> None:
    """Limits can be changed and switched off by name; rejects a misspelt rule."""
    _, sensors = next(walking(contract))
    leaning = replace(sensors, quaternion=about(1, 1.0))
    assert ReadingGuard(contract).check(0.0, leaning, WALK) is not None
    assert ReadingGuard(contract, {"leans at the start": math.inf}).check(0.0, leaning, WALK) is None
    with pytest.raises(ConfigurationError, match="did you mean 'leans at the start'"):
        ReadingGuard(contract, {"lean at the start": 1.0})
    with pytest.raises(ConfigurationError, match="expected a number of 0 or more"):
        ReadingGuard(contract, {"joint range": math.nan})


def test_drives_have_the_gains_of_the_contract(contract: Contract) -> None:
    """A drive that was reset has its maker's gains; 1 % is rounding, and what cannot be read is not said."""
    kp, kd, limit = (contract.array(name) for name in ("kp", "kd", "torque_limit"))
    assert compare_drive(contract, kp.astype(np.float32), kd * 1.009, limit) == compare_drive(contract) == []
    kp[3], kd[5], limit[0] = 50.0, math.nan, 1e3
    violations = compare_drive(contract, kp, kd, limit)
    names = contract.joint_names
    assert [(v.rule, v.joint) for v in violations] == [
        ("drive kp", names[3]), ("drive kd", names[5]), ("drive torque limit", names[0])
    ]  # fmt: skip
    assert violations[0].sentence() == "drive kp of FR_hip: 50 N m/rad, allowed 100 N m/rad"
    with pytest.raises(PolicyError, match="one for each joint"):
        compare_drive(contract, kp[1:])
