"""From a log and a mechanism to filtered signals of all its joints, through one filter, on one grid.

All equations hold a joint's acceleration beside its neighbours', so all signals pass through the same filter. Its
corner is the median of what the joints would have alone: the lowest would leave quick joints few samples between
reversals, for the sake of the rotor's inertia of slow ones, whose intervals admit what noise takes from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.core.errors import LogError, unknown_name
from stiction.files.joint_map import parse_joint_map
from stiction.files.log import Log
from stiction.identification.checks import LARGEST_TIME, Uniform, check_excitation
from stiction.identification.filters import choose_cutoff, derivatives, low_pass, position_noise
from stiction.identification.prepare import make_rows, prepare
from stiction.identification.readings import read_once
from stiction.identification.regression import check_rows
from stiction.identification.runs import Run, driven_signals, in_si
from stiction.identification.setup import LARGEST_VALUE, IdentifySetup
from stiction.identification.timing import even_grid, resample
from stiction.robots.mechanism import Mechanism

SUFFIX = "_joint"
"""What many models end the names of their joints with, and many logs do not."""


@dataclass(frozen=True)
class JointRun:
    """One joint that can be identified."""

    number: int
    """Of the joint in the mechanism."""
    run: Run
    """Its own log, checked and filtered, under the mechanism's name of the joint."""


@dataclass(frozen=True)
class LimbRun:
    """A log of a mechanism with J joints, T samples."""

    source: str
    """Name of the log."""
    mechanism: Mechanism
    """The links."""
    joints: tuple[JointRun, ...]
    """Those that can be identified."""
    refused: dict[str, str]
    """The log's other joints, and why each cannot."""
    held: tuple[str, ...]
    """Joints of the mechanism that the log does not have."""
    position: np.ndarray
    """Of all joints, filtered [rad], (T, J)."""
    velocity: np.ndarray
    """[rad/s], (T, J)."""
    acceleration: np.ndarray
    """[rad/s²], (T, J)."""


def match_joints(log: Log, mechanism: Mechanism, pairs: tuple[str, ...]) -> dict[str, int]:
    """Return log's joint -> number of the mechanism's joint: by pairs, else by name, with or without `_joint`.

    Slides and the like, which the mechanism has as rigid, are left out.

    Raises `StictionError` for a pair that matches nothing, a joint of the log that is none of the mechanism's, and two
    that are the same.
    """
    wanted = {}
    for recorded, model in parse_joint_map(pairs):
        if recorded not in log.joints:
            raise LogError(f"--joint-map {recorded}={model}: {unknown_name('joint', recorded, log.joints)}")
        wanted[recorded] = model
    found: dict[str, int] = {}
    for recorded in log.joints:
        # A pair comes first, for a log may call another joint by the name of a slide.
        if recorded in mechanism.rigid and recorded not in wanted:
            continue
        name = wanted.get(recorded, recorded)
        tries = (name, name + SUFFIX, name.removesuffix(SUFFIX))
        known = next((one for one in tries if one in mechanism.joint_names), None)
        if known is None:
            raise LogError(
                f"{log.source}: robot {mechanism.name!r}: {unknown_name('joint', name, mechanism.joint_names)}; say "
                f"which it is with --joint-map {recorded}=JOINT"
            )
        number = mechanism.joint_names.index(known)
        if number in found.values():
            raise LogError(f"{log.source}: two joints of the log are {known!r} of the robot; mend --joint-map")
        found[recorded] = number
    return found


def limb_run(log: Log, mechanism: Mechanism, declared: IdentifySetup, pairs: tuple[str, ...] = ()) -> LimbRun:
    """Check and filter all joints of a log. Raises `StictionError` where none can be identified."""
    numbers = match_joints(log, mechanism, pairs)
    log = read_once(log)
    angles = _angles(log, mechanism, numbers, declared)
    checked: dict[str, tuple[IdentifySetup, Uniform, np.ndarray, np.ndarray]] = {}
    refused: dict[str, str] = {}
    for recorded in numbers:
        try:
            checked[recorded] = _check_joint(log, recorded, declared)
        except LogError as error:
            refused[recorded] = str(error)
    if not checked:
        raise LogError(next(iter(refused.values())))
    # All joints have the log's time, and so one step.
    step = next(iter(checked.values()))[1].step
    corners = [choose_cutoff(one.position, step, position_noise(one.position)) for _, one, _, _ in checked.values()]
    corner = declared.cutoff or float(np.median(corners))
    runs = []
    for recorded, (setup, signals, torque, unusable) in checked.items():
        prepared = prepare(signals, torque, corner, unusable)
        try:
            check_excitation(f"{log.source}: joint {recorded!r}", prepared.velocity, step)
            rows = make_rows([prepared], [None])
            check_rows(f"{log.source}: joint {recorded!r}", rows, prepared)
        except LogError as error:
            refused[recorded] = str(error)
            continue
        number = numbers[recorded]
        name = mechanism.joint_names[number]
        notes = log.notes + mechanism.notes
        runs.append(JointRun(number, Run(log.source, name, setup, signals, torque, prepared, rows, notes)))
    if not runs:
        raise LogError(next(iter(refused.values())))
    rates = [derivatives(column, step, corner) for column in angles.T]
    held = tuple(name for number, name in enumerate(mechanism.joint_names) if number not in numbers.values())
    return LimbRun(
        source=log.source,
        mechanism=mechanism,
        joints=tuple(sorted(runs, key=lambda run: run.number)),
        refused={mechanism.joint_names[numbers[recorded]]: text for recorded, text in refused.items()},
        held=held,
        position=np.stack([low_pass(column, corner, step) for column in angles.T], axis=1),
        velocity=np.stack([rate for rate, _ in rates], axis=1),
        acceleration=np.stack([rate for _, rate in rates], axis=1),
    )


def _angles(log: Log, mechanism: Mechanism, numbers: dict[str, int], declared: IdentifySetup) -> np.ndarray:
    """Return the angles of all joints on the even grid, those without a log at rest, shape (T, J)."""
    for name, values in (("time", log.time), *((name, log.joints[name].position) for name in numbers)):
        if values is None or not np.all(np.abs(values) <= (LARGEST_TIME if name == "time" else LARGEST_VALUE)):
            raise LogError(
                f"{log.source}: {name} has no position, or one that is not finite; how a joint moves is needed for all "
                "of them: cut those rows out, or log it"
            )
    columns = {}
    for recorded, number in numbers.items():
        position = in_si(log.joints[recorded], declared.with_sidecar(log.setup_of(recorded))).position
        assert position is not None
        # As `check_log` does it, joint by joint: the times are the same for all.
        columns[number] = resample(even_grid(log.source, log.time, position)[0], position)
    samples = len(next(iter(columns.values())))
    return np.stack([columns.get(number, np.full(samples, rest)) for number, rest in enumerate(mechanism.rest)], axis=1)


def _check_joint(
    log: Log, recorded: str, declared: IdentifySetup
) -> tuple[IdentifySetup, Uniform, np.ndarray, np.ndarray]:
    """Return setup, signals, driving torque in N m and samples to leave out of one joint; raise `LogError`."""
    setup, signals, torque, unusable = driven_signals(log, recorded, declared)
    if signals.torque is None and setup.motor_strength is None:
        raise LogError(
            f"{log.source}: joint {recorded!r} has no torque, and the links of the robot weigh newton metres: log the "
            "motor's torque, or give --kp, --kd and --set motor_strength=1, which takes the commanded torque at its "
            "word"
        )
    if signals.torque is not None and not setup.calibrated and setup.motor_strength is None:
        raise LogError(
            f"{log.source}: joint {recorded!r}: the torque column has no known unit, and the links weigh newton "
            "metres: give --torque-scale"
        )
    return setup, signals, (setup.motor_strength or 1.0) * torque, unusable
