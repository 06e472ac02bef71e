"""Mistakes that people make with the log of a joint: measured records, and simulated joints whose friction is known.

Mistakes with servos are in `drives`, with whole limbs in `limbs`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from stiction.core.errors import FileError
from stiction.files.joints import JointRecord
from stiction.files.log import JointSignals, Log, LogSetup
from stiction.identification.example import LEG, SATURN_LITE, Excitation, Motor, SensorNoise, example_log
from stiction.identification.setup import IdentifySetup
from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Gravity, Joint
from stiction_experiments.flags import RIGHT

ARM = Motor("arm", Joint(6.0, 12.0, Coulomb(13.0), 0.5, Gravity(90.0, 15.0)), PDGains(9000.0, 600.0, 330.0))
"""A large arm's shoulder, stiffly controlled; its gravity is seven times its friction."""

ARM_MOTION = Excitation((0.5, 0.25), (0.1, 0.37), 40.0, 250.0)
"""Two slow sines, as arms are moved."""

ARM_NOISE = SensorNoise(position=2e-5, resolution=1e-5, velocity=0.002, torque=1.0, ripple=0.5)
"""A good encoder; the motor current of a large joint."""

EMPS, GO2 = Path("emps") / "DATA_EMPS.mat", Path("go2") / "traj_0.pt"
"""The measured records within the folder that STICTION_DATA names."""

EMPS_VOLT, EMPS_POSITION_GAIN, EMPS_SPEED_GAIN = 35.15065188, 160.18, 243.45
"""Newtons per volt of the EMPS drive, and the gains of its cascaded loop [1/s, V s/m]."""

POSITIONS_ALONE = "in principle: the log stays the same if all torques grow together"
"""Why some mistakes cannot be seen."""

DEGREES = float(np.rad2deg(1.0))
"""In a radian."""

LEGS, KINDS = ("FL", "FR", "RL", "RR"), ("hip", "thigh", "calf")
"""Names of the Go2's joints, in the order of the record."""


@dataclass(frozen=True)
class Given:
    """One joint's log, and the flags that somebody gives with it."""

    log: Log
    """The log, of one joint."""
    setup: IdentifySetup
    """The flags."""
    level: float
    """Its dry friction [N m, N, or N m over k]: the truth of a simulation, what the right flags give of a record."""

    def identified(self) -> list[tuple[str, float, JointRecord]]:
        """Return name, right friction and record of what was identified. Raises `StictionError` where it is refused."""
        from stiction.identification.pipeline import identify_joint

        return [("", self.level, identify_joint(self.log, setup=self.setup).record)]

    @property
    def signals(self) -> JointSignals:
        """The joint's signals."""
        return next(iter(self.log.joints.values()))

    def changed(self, **signals: np.ndarray | None) -> Given:
        """Return the same with other signals."""
        joints = {name: replace(one, **signals) for name, one in self.log.joints.items()}
        return replace(self, log=replace(self.log, joints=joints))

    def flags(self, **flags: Any) -> Given:
        """Return the same with other flags."""
        return replace(self, setup=replace(self.setup, **flags))


@cache
def simulated(motor: Motor, motion: Excitation | None = None, noise: SensorNoise | None = None) -> Given:
    """Return a simulated joint with the flags that are right for it."""
    log = example_log(motor, motion, noise)
    flags = {name: value for name, value in vars(log.setup).items() if value not in (None, (), {})}
    return Given(replace(log, setup=LogSetup()), IdentifySetup(**flags), motor.joint.friction.level)


def motor() -> Given:
    """Return the paper's shank motor, bare."""
    return simulated(SATURN_LITE)


def leg() -> Given:
    """Return the same motor with a lower leg that hangs on it."""
    return simulated(LEG)


def free() -> Given:
    """Return the motor without any dry friction."""
    bare = replace(SATURN_LITE, joint=replace(SATURN_LITE.joint, friction=Coulomb(0.0)))
    return simulated(bare)


def arm() -> Given:
    """Return the shoulder of a large arm."""
    given = simulated(ARM, ARM_MOTION, ARM_NOISE)
    log = replace(given.log, joints={"shoulder": given.signals})
    return replace(given, log=log)


@cache
def emps(folder: Path) -> Given:
    """Return the EMPS drive; its friction is the published one [N]. Raises `StictionError` where it is not there."""
    from stiction.identification.logs import open_log, parse_columns

    path = record_file(folder, EMPS)
    log = open_log(path, parse_columns(["time=t", "position=qm", "target=qg", "torque=vir"]), "drive")
    setup = IdentifySetup(
        kp=EMPS_VOLT * EMPS_SPEED_GAIN * EMPS_POSITION_GAIN,
        kd=EMPS_VOLT * EMPS_SPEED_GAIN,
        torque_limit=10.0 * EMPS_VOLT,
        torque_source="motor_side",
        test_condition="loaded",
        axis="linear",
        torque_scale=EMPS_VOLT,
        velocity_delay=0.001,
    )
    return Given(log, setup, 20.3935)


@cache
def go2(folder: Path, joint: str = "RL_thigh") -> Given:
    """Return a joint of the Go2; its friction is what the right flags give (results/identification).

    Raises `StictionError` where the record is not there.
    """
    from stiction.identification.logs import open_log

    path = record_file(folder, GO2)
    log = open_log(path, names=tuple(f"{leg}_{kind}" for leg in LEGS for kind in KINDS))
    setup = IdentifySetup(kp=20.0, kd=1.5, torque_limit=23.7, test_condition="in_air")
    return Given(replace(log, joints={joint: log.joints[joint]}), setup, {"RL_thigh": 0.188, "FL_hip": 0.303}[joint])


def record_file(folder: Path, name: Path) -> Path:
    """Return the file of a record; raise `FileError` where it is not there."""
    if not (folder / name).is_file():
        raise FileError(f"{folder} has no {name}: set STICTION_DATA to a folder with the measured records")
    return folder / name


def without_gravity(given: Given) -> Given:
    """Say that nothing hangs on a joint that carries a link."""
    return given.flags(test_condition="bare_motor")


def unstated(given: Given) -> Given:
    """Say neither what hung on the joint nor whether gravity pulls on it."""
    return given.flags(test_condition=None, gravity=None)


def loaded(given: Given) -> Given:
    """Say that the joint was loaded, and nothing of gravity."""
    return given.flags(test_condition="loaded", gravity=None)


def other_sign(given: Given) -> Given:
    """Take the torque with the sign the other way round."""
    return given.flags(torque_scale=-(given.setup.torque_scale or 1.0))


def other_target_sign(given: Given) -> Given:
    """Log the target with the sign the other way round."""
    return given.changed(target=-_target(given))


def scale(factor: float) -> Callable[[Given], Given]:
    """Return the mistake of a torque column in other units."""
    return lambda given: given.flags(torque_scale=factor * (given.setup.torque_scale or 1.0))


def degrees(given: Given) -> Given:
    """Log position and target in degrees."""
    return given.changed(position=np.rad2deg(_position(given)), target=np.rad2deg(_target(given)))


def target_in_degrees(given: Given) -> Given:
    """Log the target alone in degrees."""
    return given.changed(target=np.rad2deg(_target(given)))


def gains(kp: float = 1.0, kd: float = 1.0) -> Callable[[Given], Given]:
    """Return the mistake of gains that are so many times the true ones."""

    def mistaken(given: Given) -> Given:
        assert given.setup.kp is not None and given.setup.kd is not None
        return given.flags(kp=kp * given.setup.kp, kd=kd * given.setup.kd)

    return mistaken


def late_target(seconds: float) -> Callable[[Given], Given]:
    """Return the mistake of a target that is logged so much later than it acted [s]."""
    return lambda given: given.changed(target=np.interp(given.log.time - seconds, given.log.time, _target(given)))


def torque_of(other: Callable[[], Given]) -> Callable[[Given], Given]:
    """Return the mistake of another joint's torque."""

    def mistaken(given: Given) -> Given:
        torque = other().signals.torque
        assert torque is not None
        return given.changed(torque=np.resize(torque, len(given.log.time)))

    return mistaken


def target_of(folder: Path, joint: str) -> Callable[[Given], Given]:
    """Return the mistake of another joint's target."""
    return lambda given: given.changed(target=go2(folder, joint).signals.target)


def clipped(share: float) -> Callable[[Given], Given]:
    """Return the mistake of a sensor that reports no more than a share of the largest torque."""

    def mistaken(given: Given) -> Given:
        torque = given.signals.torque
        assert torque is not None
        most = share * float(np.abs(torque).max())
        return given.changed(torque=np.clip(torque, -most, most))

    return mistaken


def stamps(factor: float) -> Callable[[Any], Any]:
    """Return the mistake of stamps, or of --rate, that make the log `factor` times as long, of a joint or a limb."""
    return lambda given: replace(given, log=replace(given.log, time=factor * given.log.time))


def flags(**changes: Any) -> Callable[[Any], Any]:
    """Return the mistake of these flags, of a joint or a limb."""
    return lambda given: given.flags(**changes)


def contact(size: float, angle: float = 0.6) -> Callable[[Given], Given]:
    """Return a log in which something is in the way, against which the motor pushes with up to `size` [N m, or N].

    Beyond a share `angle` of its range the joint presses on a spring; the motion stays that of the record, so the motor
    gives the spring's torque more, by its torque column and by its target.
    """

    def mistaken(given: Given) -> Given:
        position = _position(given)
        low, high = float(position.min()), float(position.max())
        begin = low + angle * (high - low)
        pressed = size * np.clip((position - begin) / (high - begin), 0.0, None)
        changes: dict[str, np.ndarray | None] = {}
        if given.signals.torque is not None:
            changes["torque"] = given.signals.torque + pressed / (given.setup.torque_scale or 1.0)
        assert given.setup.kp is not None
        changes["target"] = _target(given) + pressed / given.setup.kp
        return given.changed(**changes)

    return mistaken


def _position(given: Given) -> np.ndarray:
    assert given.signals.position is not None
    return given.signals.position


def _target(given: Given) -> np.ndarray:
    assert given.signals.target is not None
    return given.signals.target


def unchecked(given: Given) -> Given:
    """Leave out the gains and the limit, against which torque could be held."""
    return given.flags(kp=None, kd=None, torque_limit=None)


class Identified(Protocol):
    """A log with flags, right or wrong, that can be identified."""

    @property
    def level(self) -> float:
        """Right friction, of several joints the first one's [N m, or N]."""

    def identified(self) -> list[tuple[str, float, JointRecord]]:
        """Return name, right friction and record of each joint. Raises `StictionError` where all of it is refused."""


@dataclass(frozen=True)
class Case:
    """One mistake on one record."""

    mistake: str
    """What was done wrong."""
    record: str
    """To which record."""
    given: Callable[[], Identified]
    """The log and the flags after it."""
    invisible: str = ""
    """Why nothing in the log can show it; empty where something can."""
    flag: str = ""
    """The flag that is then wrong, which the verdict's first line must name as its assumption."""


def joint_cases(folder: Path) -> list[Case]:
    """Return mistakes with single joints. folder: of the measured records."""
    return [*_torque_cases(folder), *_motion_cases(folder)]


def _torque_cases(folder: Path) -> list[Case]:
    """Return the right flags, and mistakes about gravity and the torque."""
    drive, leg_of_go2 = partial(emps, folder), partial(go2, folder)

    def no_gains(factor: float) -> Callable[[Given], Given]:
        return lambda given: scale(factor)(unchecked(given))

    return [
        *(case(RIGHT, name, record, all_right) for name, record in (("motor", motor), ("leg", leg), ("arm", arm))),
        case(RIGHT, "free", free, all_right),
        case(RIGHT, "EMPS", drive, all_right),
        case(RIGHT, "Go2", leg_of_go2, all_right),
        case("gravity left out", "leg", leg, without_gravity),
        case("gravity left out", "arm", arm, without_gravity),
        case("gravity left out", "Go2", leg_of_go2, without_gravity),
        case("condition not stated", "leg", leg, unstated),
        case("condition not stated", "arm", arm, unstated),
        case("condition not stated", "Go2", leg_of_go2, unstated),
        case("loaded, gravity not said", "leg", leg, loaded),
        case("loaded, gravity not said", "arm", arm, loaded),
        case("sign of the torque", "EMPS", drive, other_sign),
        case("sign of the torque", "arm", arm, other_sign),
        case("sign of the target", "Go2", leg_of_go2, other_target_sign),
        case("volts for newtons", "EMPS", drive, scale(1 / EMPS_VOLT)),
        case("torque twice as large", "leg", leg, scale(2.0)),
        case("torque a third too large", "motor", motor, scale(4 / 3)),
        case("torque a fifth too large", "motor", motor, scale(1.2)),
        case("torque a fifth too large", "leg", leg, scale(1.2)),
        case("torque an eighth too large", "motor", motor, scale(9 / 8)),
        case("torque a seventh too small", "leg", leg, scale(6 / 7)),
        case(
            "torque twice as large, no gains",
            "motor",
            motor,
            no_gains(2.0),
            "without gains, limit or known load",
            "--torque-scale",
        ),
        case("torque of another joint", "motor", motor, torque_of(leg)),
        case("torque of another joint", "arm", arm, torque_of(leg)),
        case("torque cut off at half", "EMPS", drive, clipped(0.5)),
        case("torque cut off at half", "leg", leg, clipped(0.5)),
        case("torque cut off at half", "motor", motor, clipped(0.5)),
        case("cut off at half, no gains", "motor", motor, lambda given: unchecked(clipped(0.5)(given))),
    ]


def _motion_cases(folder: Path) -> list[Case]:
    """Return mistakes about angles, gains, targets and time, and touch."""
    drive, leg_of_go2 = partial(emps, folder), partial(go2, folder)
    return [
        case("degrees", "motor", motor, degrees),
        case("degrees", "leg", leg, degrees),
        case("degrees", "Go2", leg_of_go2, degrees),
        case("target in degrees", "motor", motor, target_in_degrees),
        case("kp twice as large", "EMPS", drive, gains(2.0)),
        case("kp half as large", "leg", leg, gains(0.5)),
        case("kp half as large", "Go2", leg_of_go2, gains(0.5)),
        case(
            "kp twice as large",
            "Go2",
            leg_of_go2,
            gains(2.0),
            "but for more viscous friction, which a joint may have",
            "--kp",
        ),
        case("kp and kd twice as large", "Go2", leg_of_go2, gains(2.0, 2.0), POSITIONS_ALONE, "--kp"),
        case("target 20 ms late", "EMPS", drive, late_target(0.02)),
        case("target 20 ms late", "leg", leg, late_target(0.02)),
        case("target 20 ms late", "Go2", leg_of_go2, late_target(0.02)),
        case("target of another joint", "Go2", leg_of_go2, target_of(folder, "FL_hip")),
        case("half the rate", "EMPS", drive, stamps(2.0)),
        case("half the rate", "leg", leg, stamps(2.0)),
        case("half the rate", "Go2", leg_of_go2, stamps(2.0)),
        case("twice the rate", "Go2", leg_of_go2, stamps(0.5)),
        case("contact", "EMPS", drive, contact(40.0)),
        case("contact", "leg", leg, contact(2.0)),
        case("contact", "motor", motor, contact(1.0)),
        case("contact", "Go2", leg_of_go2, contact(1.5)),
    ]


def case(
    mistake: str,
    record: str,
    right: Callable[[], Any],
    change: Callable[[Any], Any],
    invisible: str = "",
    flag: str = "",
) -> Case:
    """Return the case of a record, with its right flags, and what is changed about it; the rest as of `Case`."""
    return Case(mistake, record, partial(_after, right, change), invisible, flag)


def all_right(given: Any) -> Any:
    """Make no mistake."""
    return given


def _after(right: Callable[[], Any], change: Callable[[Any], Any]) -> Identified:
    return change(right())
