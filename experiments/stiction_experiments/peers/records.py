"""Records cut into a first part, which every estimator is fitted to, and a rest, which none of them sees."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stiction.core.errors import LogError
from stiction.files.log import Log
from stiction.identification.example import LEG, SATURN_LITE, Excitation, Motor, example_log
from stiction.identification.held_out import TRAINED
from stiction.identification.reading import Reading
from stiction.identification.runs import Run, make_run
from stiction.identification.setup import IdentifySetup
from stiction.joints.friction import Breakaway, Effort, Stribeck
from stiction_experiments.flags.cases import GO2_JOINTS, emps, go2


@dataclass(frozen=True)
class Problem:
    """Signals of one joint in closed loop, on an even grid, and everything known about its controller."""

    run: Run
    """Checked log."""
    time: np.ndarray
    """Time from zero [s], shape (T,)."""
    step: float
    """Time between samples [s]."""
    position: np.ndarray
    """Measured position [rad, or m], shape (T,)."""
    target: np.ndarray
    """Target position [rad, or m], shape (T,)."""
    torque: np.ndarray | None
    """Logged torque [N m, or N], shape (T,); None where none was logged."""
    speed: float
    """Velocity at the first sample [rad/s, or m/s]."""
    kp: float
    """Proportional gain [N m/rad, or N/m]."""
    kd: float
    """Derivative gain [N m s/rad, or N s/m]."""
    limit: float
    """Torque limit [N m, or N]; infinite where none is known."""
    velocity_delay: float
    """Known delay of the velocity that the controller uses [s]."""
    gravity: bool
    """True if gravity pulls on the link."""

    @classmethod
    def of(cls, log: Log, setup: IdentifySetup) -> Problem:
        """Return the problem in a log of one joint. Raises `StictionError` for whatever the log lacks."""
        run = make_run(log, None, setup, alone=False)
        signals, gains = run.signals, run.gains
        if gains is None or signals.target is None:
            raise LogError(f"{run.where}: no gains or no target; expected both, for the comparison is in closed loop")
        return cls(
            run=run,
            time=signals.time,
            step=signals.step,
            position=signals.position,
            target=np.asarray(signals.target),
            torque=signals.torque,
            speed=float(run.prepared.velocity[0]),
            kp=gains.kp,
            kd=gains.kd,
            limit=gains.torque_limit,
            velocity_delay=setup.velocity_delay or 0.0,
            gravity=setup.fits_gravity,
        )

    def read(self, reading: Reading) -> Run:
        """Return the run with a reading of what happens between its samples."""
        return replace(self.run, reading=reading)

    def targets(self, times: np.ndarray) -> np.ndarray:
        """Return the target at any times [s], straight between samples, shape of `times`."""
        return np.interp(times, self.time, self.target)


@dataclass(frozen=True)
class Record:
    """One joint's record, cut in two."""

    name: str
    """Name of the record: `EMPS`, `Go2`, or the simulated friction law."""
    joint: str
    """Joint, or seed of a simulated record."""
    measured: bool
    """True if a robot was measured."""
    first: Log
    """Part that is fitted."""
    rest: Log
    """Part that is predicted."""
    setup: IdentifySetup
    """Known gains, limits and conditions."""

    @property
    def digest(self) -> str:
        """SHA-256 of the positions of both parts."""
        parts = (signals.position for log in (self.first, self.rest) for signals in log.joints.values())
        return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()


def cut(log: Log, begin: float, end: float) -> Log:
    """Return the part of a log between two shares of its samples."""
    part = slice(round(begin * len(log.time)), round(end * len(log.time)))
    joints = {
        name: replace(signals, **{role: values[part] for role, values in vars(signals).items() if values is not None})
        for name, signals in log.joints.items()
    }
    return replace(log, time=log.time[part], joints=joints)


def halves(name: str, joint: str, log: Log, setup: IdentifySetup) -> Record:
    """Return a measured record cut where identification cuts one."""
    return Record(name, joint, True, cut(log, 0.0, TRAINED), cut(log, TRAINED, 1.0), setup)


CALF_LIMIT = 45.43
"""Torque limit of a Go2's calf [N m]."""


def measured_records(folder: Path) -> Iterator[Record]:
    """Return the EMPS drive and the twelve joints of the Go2. Raises `StictionError` where a record is missing."""
    drive = emps(folder)
    yield halves("EMPS", "drive", drive.log, drive.setup)
    for joint in GO2_JOINTS:
        leg = go2(folder, joint)
        limit = CALF_LIMIT if joint.endswith("calf") else leg.setup.torque_limit
        yield halves("Go2", joint, leg.log, replace(leg.setup, torque_limit=limit))


def simulated_motors() -> dict[str, Motor]:
    """Return simulated joints of known friction by the name of their law; the leg has gravity, the others have none."""
    motor = SATURN_LITE.joint
    return {
        "coulomb": SATURN_LITE,
        "stribeck": replace(SATURN_LITE, joint=replace(motor, friction=Stribeck(0.442, 0.65, 0.4))),
        "breakaway": replace(SATURN_LITE, joint=replace(motor, friction=Breakaway(0.442, 0.65))),
        "effort": replace(SATURN_LITE, joint=replace(motor, friction=Effort(0.3, 0.15))),
        "leg": LEG,
    }


UNSEEN = 1000
"""Added to the seed of a simulated record for its part that is predicted."""


def simulated_excitation(seed: int, seconds: float) -> Excitation:
    """Return two sines drawn by a seed, so that what is predicted is another motion too."""
    rng = np.random.default_rng(seed)
    amplitudes, frequencies = rng.uniform([0.3, 0.2], [0.5, 0.4]), rng.uniform([0.3, 1.5], [0.8, 2.5])
    return Excitation(tuple(amplitudes.tolist()), tuple(frequencies.tolist()), seconds)


def simulated_records(seeds: tuple[int, ...], seconds: float = 12.0) -> Iterator[Record]:
    """Return simulated records, each law with each seed; the part that is predicted has a seed of its own.

    seconds: length of either part [s].
    """
    for name, motor in simulated_motors().items():
        for seed in seeds:
            first, rest = (
                example_log(motor, simulated_excitation(number, seconds), seed=number)
                for number in (seed, seed + UNSEEN)
            )
            flags = {key: value for key, value in vars(first.setup).items() if value not in (None, (), {})}
            yield Record(name, f"seed {seed}", False, first, rest, IdentifySetup(**flags))


def part_of_problem(problem: Problem, count: int) -> Problem:
    """Return the first samples of a problem, without a run: for a simulator of its own."""
    signals = {"time", "position", "target"} | ({"torque"} if problem.torque is not None else set())
    return replace(problem, **{name: getattr(problem, name)[:count] for name in signals})
