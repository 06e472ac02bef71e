"""Mistakes that people make with the log of a joint: measured records, and simulated joints whose friction is known.

Mistakes with servos are in `drives`, with whole limbs in `limbs`, with walks in `walks`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
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

GO2_JOINTS = tuple(f"{leg}_{kind}" for leg in ("FL", "FR", "RL", "RR") for kind in ("hip", "thigh", "calf"))
"""The Go2's joints, in the order of the record."""

GO2_LEVELS = {"RL_thigh": 0.188, "FL_hip": 0.303}
"""Dry friction of joints with which mistakes are made [N m over k]."""


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
    record: str
    load: Callable[[], Identified]
    """Loader of the log and its flags after the mistake."""
    invisible: str = ""
    """Why nothing in the log can show it; empty where something can."""
    flag: str = ""
    """The flag that is then wrong, which the verdict's first line must name as its assumption."""


def cases(
    records: Mapping[str, Callable[[], Any]],
    mistake: str,
    names: str,
    change: Callable[[Any], Any],
    invisible: str = "",
    flag: str = "",
) -> list[Case]:
    """Return the cases of some records with their right flags, `leg; arm`, in each of which `change` is made."""

    def after(record: Callable[[], Any]) -> Identified:
        return change(record())

    return [Case(mistake, name, partial(after, records[name]), invisible, flag) for name in names.split("; ")]


def all_right(entry: Any) -> Any:
    """Make no mistake."""
    return entry


@dataclass(frozen=True)
class Given:
    """One joint's log, and the flags that somebody gives with it."""

    log: Log
    setup: IdentifySetup
    level: float
    """Its dry friction [N m, N, or N m over k]: the truth of a simulation, what the right flags give of a record."""

    def identified(self) -> list[tuple[str, float, JointRecord]]:
        """Return what `Identified` says."""
        from stiction.identification.pipeline import identify_joint

        return [("", self.level, identify_joint(self.log, setup=self.setup).record)]

    @property
    def signals(self) -> JointSignals:
        """The joint's signals."""
        return next(iter(self.log.joints.values()))

    def role(self, name: str) -> Any:
        """Return the samples of a signal that was logged."""
        return getattr(self.signals, name)

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


motor, leg = partial(simulated, SATURN_LITE), partial(simulated, LEG)
"""The paper's shank motor, bare, and with a lower leg that hangs on it."""

free = partial(simulated, replace(SATURN_LITE, joint=replace(SATURN_LITE.joint, friction=Coulomb(0.0))))
"""The motor without any dry friction."""


def arm() -> Given:
    """Return the shoulder of a large arm."""
    entry = simulated(ARM, ARM_MOTION, ARM_NOISE)
    return replace(entry, log=replace(entry.log, joints={"shoulder": entry.signals}))


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
def go2_in_air(folder: Path) -> Given:
    """Return all joints of the Go2. Raises `StictionError` where the record is not there."""
    from stiction.identification.logs import open_log

    setup = IdentifySetup(kp=20.0, kd=1.5, torque_limit=23.7, test_condition="in_air")
    return Given(open_log(record_file(folder, GO2), names=GO2_JOINTS), setup, np.nan)


def go2(folder: Path, joint: str = "RL_thigh") -> Given:
    """Return a joint of the Go2; its friction is what the right flags give (results/identification), where a case asks.

    Raises `StictionError` where the record is not there.
    """
    legs = go2_in_air(folder)
    log = replace(legs.log, joints={joint: legs.log.joints[joint]})
    return replace(legs, log=log, level=GO2_LEVELS.get(joint, np.nan))


def data_folder() -> Path:
    """Return the folder of the measured records; raise `FileError` where none is named."""
    folder = os.environ.get("STICTION_DATA")
    if not folder:
        raise FileError("STICTION_DATA names no folder; expected one with the measured records emps and go2")
    return Path(folder)


def record_file(folder: Path, name: Path) -> Path:
    """Return the file of a record; raise `FileError` where it is not there."""
    if not (folder / name).is_file():
        raise FileError(f"{folder} has no {name}: set STICTION_DATA to a folder with the measured records")
    return folder / name


def flags(**changes: Any) -> Callable[[Any], Any]:
    """Return the mistake of these flags, of a joint or a limb."""
    return lambda entry: entry.flags(**changes)


without_gravity = flags(test_condition="bare_motor")
"""Nothing hangs on the joint, says who leaves gravity out."""


def scale(factor: float) -> Callable[[Given], Given]:
    """Return the mistake of a torque column in other units, or of the other sign, by its flag."""
    return lambda entry: entry.flags(torque_scale=factor * (entry.setup.torque_scale or 1.0))


def times(factor: float, *roles: str) -> Callable[[Given], Given]:
    """Return the mistake of signals in other units, or of another sign."""
    return lambda entry: entry.changed(**{role: factor * entry.role(role) for role in roles})


target_in_degrees = times(DEGREES, "target")


def gains(**factors: float) -> Callable[[Given], Given]:
    """Return the mistake of gains that are so many times the true ones."""
    return lambda entry: entry.flags(**{name: factor * getattr(entry.setup, name) for name, factor in factors.items()})


def late_target(seconds: float) -> Callable[[Given], Given]:
    """Return the mistake of a target that is logged so much later than it acted [s]."""
    return lambda entry: entry.changed(target=np.interp(entry.log.time - seconds, entry.log.time, entry.role("target")))


def torque_of(other: Callable[[], Given]) -> Callable[[Given], Given]:
    """Return the mistake of another joint's torque."""
    return lambda entry: entry.changed(torque=np.resize(other().role("torque"), len(entry.log.time)))


def clipped(share: float) -> Callable[[Given], Given]:
    """Return the mistake of a sensor that reports no more than a share of the largest torque."""

    def mistaken(entry: Given) -> Given:
        most = share * float(np.abs(entry.role("torque")).max())
        return entry.changed(torque=np.clip(entry.role("torque"), -most, most))

    return mistaken


def stamps(factor: float) -> Callable[[Any], Any]:
    """Return the mistake of stamps, or of --rate, that make the log `factor` times as long, of a joint or a limb."""
    return lambda entry: replace(entry, log=replace(entry.log, time=factor * entry.log.time))


def contact(size: float, angle: float = 0.6) -> Callable[[Given], Given]:
    """Return a log in which something is in the way, against which the motor pushes with up to `size` [N m, or N].

    Beyond a share `angle` of its range the joint presses on a spring; the motion stays that of the record, so the motor
    gives the spring's torque more, by its torque column and by its target.
    """

    def mistaken(entry: Given) -> Given:
        position = entry.role("position")
        low, high = float(position.min()), float(position.max())
        begin = low + angle * (high - low)
        pressed = size * np.clip((position - begin) / (high - begin), 0.0, None)
        assert entry.setup.kp is not None
        changed = entry.changed(target=entry.role("target") + pressed / entry.setup.kp)
        if entry.signals.torque is None:
            return changed
        return changed.changed(torque=entry.signals.torque + pressed / (entry.setup.torque_scale or 1.0))

    return mistaken


unchecked = flags(kp=None, kd=None, torque_limit=None)
"""Gains and limit are left out, against which torque could be held."""


def joint_cases(folder: Path) -> list[Case]:
    """Return the right flags of single joints, and mistakes with them. folder: of the measured records."""
    records: dict[str, Callable[[], Any]] = {"motor": motor, "leg": leg, "arm": arm, "free": free}
    records |= {"EMPS": partial(emps, folder), "Go2": partial(go2, folder)}
    add = partial(cases, records)
    hip = partial(go2, folder, "FL_hip")
    viscous = "but for more viscous friction, which a joint may have"
    return [
        *add(RIGHT, "motor; leg; arm; free; EMPS; Go2", all_right),
        *add("gravity left out", "leg; arm; Go2", without_gravity),
        *add("condition not stated", "leg; arm; Go2", flags(test_condition=None, gravity=None)),
        *add("loaded, gravity not said", "leg; arm", flags(test_condition="loaded", gravity=None)),
        *add("sign of the torque", "EMPS; arm", scale(-1.0)),
        *add("sign of the target", "Go2", times(-1.0, "target")),
        *add("volts for newtons", "EMPS", scale(1 / EMPS_VOLT)),
        *add("torque twice as large", "leg", scale(2.0)),
        *add("torque a third too large", "motor", scale(4 / 3)),
        *add("torque a fifth too large", "motor; leg", scale(1.2)),
        *add("torque an eighth too large", "motor", scale(9 / 8)),
        *add("torque a seventh too small", "leg", scale(6 / 7)),
        *add(
            *("torque twice as large, no gains", "motor", lambda entry: scale(2.0)(unchecked(entry))),
            *("without gains, limit or known load", "--torque-scale"),
        ),
        *add("torque of another joint", "motor; arm", torque_of(leg)),
        *add("torque cut off at half", "EMPS; leg; motor", clipped(0.5)),
        *add("cut off at half, no gains", "motor", lambda entry: unchecked(clipped(0.5)(entry))),
        *add("degrees", "motor; leg; Go2", times(DEGREES, "position", "target")),
        *add("target in degrees", "motor", target_in_degrees),
        *add("kp twice as large", "EMPS", gains(kp=2.0)),
        *add("kp half as large", "leg; Go2", gains(kp=0.5)),
        *add("kp twice as large", "Go2", gains(kp=2.0), viscous, "--kp"),
        *add("kp and kd twice as large", "Go2", gains(kp=2.0, kd=2.0), POSITIONS_ALONE, "--kp"),
        *add("target 20 ms late", "EMPS; leg; Go2", late_target(0.02)),
        *add("target of another joint", "Go2", lambda entry: entry.changed(target=hip().role("target"))),
        *add("half the rate", "EMPS; leg; Go2", stamps(2.0)),
        *add("twice the rate", "Go2", stamps(0.5)),
        *add("contact", "EMPS", contact(40.0)),
        *add("contact", "leg", contact(2.0)),
        *add("contact", "motor", contact(1.0)),
        *add("contact", "Go2", contact(1.5)),
    ]
