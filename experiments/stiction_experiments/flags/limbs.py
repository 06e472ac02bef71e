"""Mistakes with a whole limb and the model of its links: `identify --robot`, by torque and by voltage.

The log is made backwards: a motion that is written down, the torques that links, rotors and friction ask for along it,
noise. No controller closes a loop, which the regression of a limb does not look at.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from stiction.files.joints import JointRecord
from stiction.files.log import JointSignals, Log, LogSetup
from stiction.identification.limb.dynamics import model_torques
from stiction.identification.limb.pipeline import identify_limb
from stiction.identification.setup import IdentifySetup, LimbSetup
from stiction.robots.mechanism import Mechanism
from stiction_experiments.flags import RIGHT
from stiction_experiments.flags.cases import (
    DEGREES,
    GO2,
    GO2_JOINTS,
    POSITIONS_ALONE,
    Case,
    all_right,
    cases,
    flags,
    record_file,
    stamps,
)

ROBOT = "go2"
"""The shipped robot whose front left leg moves."""

FRICTION, VISCOUS, ROTOR, OFFSET = (0.4, 0.5, 1.0), (0.3, 0.3, 0.5), (0.01, 0.01, 0.02), (0.05, -0.05, 0.1)
"""Dry and viscous friction, rotor inertia and torque offset of hip, thigh and calf [N m, N m s/rad, kg m², N m]."""

CENTRE, SWING = (0.0, 0.9, -1.7), (0.4, 0.6, 0.5)
"""Middle and largest swing of their motion [rad]."""

FREQUENCIES = ((0.23, 0.61, 1.07), (0.31, 0.53, 0.97), (0.19, 0.71, 1.13))
"""Frequencies of the three sines of each joint [Hz]."""

RATE, SECONDS = 250.0, 12.0
"""Samples per second, and length [Hz, s]."""

BY_LINKS = "to less than some 20 % links that are heavier than the model, by a tenth each, do the same"
"""Why a small error of the torques' scale cannot be seen."""

KT, RESISTANCE = 1.0, 2.0
"""Torque constant and resistance of motors driven by voltage, at the joint [N m/A, ohm]; they brake 0.5 N m s/rad."""


@dataclass(frozen=True)
class GivenLimb:
    """The log of a limb, and the model and flags that somebody gives with it."""

    log: Log
    mechanism: Mechanism
    friction: dict[str, float]
    """Joint -> its dry friction [N m]."""
    declared: IdentifySetup = field(default_factory=IdentifySetup)
    setup: LimbSetup = field(default_factory=LimbSetup)

    @property
    def level(self) -> float:
        """Friction of the first joint [N m]."""
        return next(iter(self.friction.values()))

    def identified(self) -> list[tuple[str, float, JointRecord]]:
        """Return name, right friction and record of each joint. Raises `StictionError` where all of it is refused."""
        records = identify_limb(self.log, self.mechanism, self.declared, self.setup).joints.joints
        return [(name, right, records[name]) for name, right in self.friction.items() if name in records]

    def flags(self, **flags: Any) -> GivenLimb:
        """Return the same with other flags."""
        return replace(self, declared=replace(self.declared, **flags))

    def signals(self, change: Callable[[JointSignals], JointSignals], joints: tuple[int, ...] = (0, 1, 2)) -> GivenLimb:
        """Return the same with the signals of some joints changed."""
        names = [name for number, name in enumerate(self.log.joints) if number in joints]
        changed = {name: change(one) if name in names else one for name, one in self.log.joints.items()}
        return replace(self, log=replace(self.log, joints=changed))


@cache
def leg(by_voltage: bool = False) -> GivenLimb:
    """Return a leg of a robot on its stand, with the right flags; by_voltage: volts were logged, and not torques."""
    from stiction.robots.catalog import find_mechanism

    mechanism, rng = find_mechanism(ROBOT), np.random.default_rng(0)
    time = np.arange(round(RATE * SECONDS)) / RATE
    motion = np.zeros((3, len(time), mechanism.num_joints))
    motion[0] = mechanism.rest
    for joint, frequencies in enumerate(FREQUENCIES):
        motion[0, :, joint] = CENTRE[joint]
        for place, frequency in enumerate(frequencies):
            rate, phase = 2 * np.pi * frequency, 1.3 * place + joint
            # A sine with its two derivatives from one complex exponential.
            wave = SWING[joint] / 3 * np.exp(1j * (rate * time + phase))
            motion[:, :, joint] += np.array([wave.imag, rate * wave.real, -(rate**2) * wave.imag])
    torque = model_torques(mechanism, *motion)
    joints, names = {}, mechanism.joint_names[:3]
    for joint, name in enumerate(names):
        angle, speed, acceleration = motion[:, :, joint]
        asked = torque[:, joint] + ROTOR[joint] * acceleration + VISCOUS[joint] * speed + OFFSET[joint]
        asked += FRICTION[joint] * np.sign(speed) + 0.05 * rng.standard_normal(len(time))
        seen = angle + 1e-4 * rng.standard_normal(len(time))
        logged = RESISTANCE / KT * asked + KT * speed if by_voltage else asked
        joints[name] = JointSignals(position=seen, torque=logged)
    setup = LogSetup(torque_source="motor_side")
    motor = {"torque_column": "voltage", "kt": KT, "resistance": RESISTANCE} if by_voltage else {}
    log = Log("leg", time, joints, setup)
    return GivenLimb(log, mechanism, dict(zip(names, FRICTION, strict=True)), IdentifySetup(**motor))  # type: ignore[arg-type]


voltage_leg = partial(leg, True)
"""The leg with volts in its log."""


@cache
def measured(folder: Path) -> GivenLimb:
    """Return the measured Go2, its commanded torque taken at its word; right is what that gives with the right gains.

    Raises `StictionError` where the record is not there.
    """
    from stiction.identification.logs import open_log
    from stiction.robots.catalog import find_mechanism

    log = open_log(record_file(folder, GO2), names=GO2_JOINTS)
    declared = IdentifySetup(kp=20.0, kd=1.5, torque_limit=23.7, motor_strength=1.0)
    entry = GivenLimb(log, find_mechanism(ROBOT), {}, declared)
    records = identify_limb(log, entry.mechanism, declared).joints.joints
    friction = {name: one.coulomb_friction for name, one in records.items() if not one.objections}
    return replace(entry, friction={name: one.value for name, one in friction.items() if one is not None})


def heavier(factor: float) -> Callable[[GivenLimb], GivenLimb]:
    """Return the mistake of a model whose links weigh so many times what they do."""

    def mistaken(entry: GivenLimb) -> GivenLimb:
        links = tuple(link.scaled(factor) for link in entry.mechanism.links)
        return replace(entry, mechanism=replace(entry.mechanism, links=links))

    return mistaken


def signals(
    name: str, factor: float, shift: float = 0.0, joints: tuple[int, ...] = (0, 1, 2)
) -> Callable[[GivenLimb], GivenLimb]:
    """Return the mistake of a signal in other units, of another sign, or from another zero."""
    return lambda entry: entry.signals(lambda one: replace(one, **{name: factor * getattr(one, name) + shift}), joints)


torques, angles = partial(signals, "torque"), partial(signals, "position")
"""The same of torques [N m] and of angles [rad]."""


def turned(entry: GivenLimb) -> GivenLimb:
    """Log the thigh, angle and torque, the other way round than the model has it."""
    return torques(-1.0, joints=(1,))(angles(-1.0, joints=(1,))(entry))


def swapped(entry: GivenLimb) -> GivenLimb:
    """Take the hip for the thigh, and the thigh for the hip."""
    hip, thigh, *others = entry.log.joints
    joints = {hip: entry.log.joints[thigh], thigh: entry.log.joints[hip]}
    joints |= {name: entry.log.joints[name] for name in others}
    return replace(entry, log=replace(entry.log, joints=joints))


def other_torque(entry: GivenLimb) -> GivenLimb:
    """Log the calf's torque as the thigh's as well."""
    calf = list(entry.log.joints.values())[2].torque
    return entry.signals(lambda one: replace(one, torque=calf), (1,))


def limb_cases(folder: Path) -> list[Case]:
    """Return mistakes with limbs, simulated and measured. folder: of the measured records."""
    records: dict[str, Callable[[], GivenLimb]] = {"limb": leg, "limb by voltage": voltage_leg}
    add = partial(cases, records | {"Go2 limb": partial(measured, folder)})
    as_torque = flags(torque_column=None, kt=None, resistance=None)
    return [
        *add(RIGHT, "limb; limb by voltage; Go2 limb", all_right),
        *add("links twice as heavy in the model", "limb", heavier(2.0)),
        *add("links a third heavier in the model", "limb", heavier(4 / 3)),
        *add("links half as heavy in the model", "limb", heavier(0.5)),
        *add("torque twice as large", "limb", torques(2.0)),
        *add("torque a fifth too large", "limb", torques(1.2), BY_LINKS, "--torque-scale"),
        *add("torque half as large", "limb", torques(0.5)),
        *add("sign of the torque", "limb", torques(-1.0)),
        *add("sign of one torque", "limb", torques(-1.0, joints=(1,))),
        *add("one joint the other way round", "limb", turned),
        *add("zero of the calf off by half a radian", "limb", angles(1.0, 0.5, (2,))),
        *add("degrees", "limb", angles(DEGREES)),
        *add("two joints exchanged", "limb", swapped),
        *add("torque of another joint", "limb", other_torque),
        *add("upside down", "limb", lambda entry: replace(entry, setup=LimbSetup(up=(0.0, 0.0, -1.0)))),
        *add("on its side", "limb", lambda entry: replace(entry, setup=LimbSetup(up=(0.0, 1.0, 0.0)))),
        *add("half the rate", "limb", stamps(2.0)),
        *add("twice the rate", "limb", stamps(0.5)),
        *add("kt twice as large", "limb by voltage", flags(kt=2 * KT)),
        *add("kt half as large", "limb by voltage", flags(kt=KT / 2)),
        *add("R twice as large", "limb by voltage", flags(resistance=2 * RESISTANCE)),
        *add("R half as large", "limb by voltage", flags(resistance=RESISTANCE / 2)),
        *add("sign of the voltage", "limb by voltage", flags(torque_scale=-1.0)),
        *add("volts taken for torque", "limb by voltage", as_torque),
        *add("kp and kd twice as large", "Go2 limb", flags(kp=40.0, kd=3.0), POSITIONS_ALONE, "--kp"),
        *add("kp half as large", "Go2 limb", flags(kp=10.0), "but for less viscous friction", "--kp"),
    ]
