"""Filtered signals of all joints of a mechanism from a log, through one filter, on one grid.

All equations hold a joint's acceleration beside its neighbours', so all signals pass through the same filter. Its
corner is the median of those that the joints would have alone: the lowest would leave quick joints few samples between
reversals, for the sake of the rotor's inertia of slow ones, whose intervals admit what noise takes from it.
"""

from __future__ import annotations

from collections.abc import Sequence
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
from stiction.identification.runs import Run, driven_signals, in_si, notes_of
from stiction.identification.setup import LARGEST_VALUE, IdentifySetup
from stiction.identification.timing import even_grid, resample
from stiction.robots.mechanism import Mechanism

SUFFIXES = ("_joint", "_foot")
"""Suffixes of names in many models, which many logs leave out."""


@dataclass(frozen=True)
class LimbRun:
    """Log of a mechanism with J joints, T samples."""

    source: str
    """Name of the log."""
    mechanism: Mechanism
    """Mechanism of the limb."""
    runs: dict[int, Run]
    """Number of an identifiable joint -> its log, checked and filtered, under the mechanism's name."""
    refused: dict[str, str]
    """Other joints of the log, and the reason why each cannot be identified."""
    held: tuple[str, ...]
    """Joints of the mechanism that the log does not have."""
    position: np.ndarray
    """Angles of all joints, filtered [rad], (T, J)."""
    velocity: np.ndarray
    """Speeds [rad/s], (T, J)."""
    acceleration: np.ndarray
    """Accelerations [rad/s²], (T, J)."""


def bare(name: str) -> str:
    """Return a name in lower case without the suffixes of models."""
    name = name.lower()
    for suffix in SUFFIXES:
        name = name.removesuffix(suffix)
    return name


def match_joints(
    log: Log, robot: str, joints: Sequence[str], pairs: tuple[str, ...] = (), rigid: Sequence[str] = ()
) -> dict[str, int]:
    """Return the log's joint -> number of the robot's joint: by RECORDED=JOINT pairs, else by name, see `bare`.

    rigid: further joints of the robot, which count as rigid, and are left out of the log. Raises `StictionError` for a
    pair that matches nothing, a joint of the log that is none of the robot's, and two that are the same.
    """
    known = {bare(name): number for number, name in enumerate(joints)}
    known |= {name: number for number, name in enumerate(joints)}
    wanted = dict(parse_joint_map(pairs))
    for recorded, joint in wanted.items():
        if recorded not in log.joints:
            raise LogError(f"--joint-map {recorded}={joint}: {unknown_name('joint of the log', recorded, log.joints)}")
        if joint not in known and bare(joint) not in known:
            raise LogError(f"--joint-map {recorded}={joint}: {unknown_name('joint', joint, joints)}")
    numbers: dict[str, int] = {}
    for recorded in log.joints:
        name = wanted.get(recorded, recorded)
        # A pair comes first, for a log may call another joint by the name of a rigid one.
        if name == recorded and name not in known and bare(name) in map(bare, rigid):
            continue
        number = known.get(name, known.get(bare(name)))
        if number is None:
            numbered = all(label.startswith("joint_") and label[6:].isdigit() for label in log.joints)
            raise LogError(
                f"{log.source}: robot {robot!r}: {unknown_name('joint', name, joints)}; "
                + (
                    "the log only numbers its joints: name them in its order, --names NAME ..."
                    if numbered
                    else f"name the log's robot with --robot, or say which joint it is, --joint-map {recorded}=JOINT"
                )
            )
        if number in numbers.values():
            raise LogError(f"{log.source}: two joints of the log are {joints[number]!r} of the robot; mend --joint-map")
        numbers[recorded] = number
    return numbers


def limb_run(log: Log, mechanism: Mechanism, declared: IdentifySetup, pairs: tuple[str, ...] = ()) -> LimbRun:
    """Check and filter all joints of a log. Raises `StictionError` where none can be identified."""
    names = mechanism.joint_names
    numbers = match_joints(log, mechanism.name, names, pairs, mechanism.rigid)
    log = read_once(log)
    angles = _angles(log, mechanism, numbers, declared)
    checked: dict[str, tuple[IdentifySetup, Uniform, np.ndarray, np.ndarray]] = {}
    refused: dict[str, str] = {}
    for recorded, number in numbers.items():
        try:
            checked[recorded] = _check_joint(log, recorded, declared)
        except LogError as error:
            refused[names[number]] = str(error)
    if not checked:
        raise LogError(next(iter(refused.values())))
    # All joints have the log's time, and so one step.
    step = next(iter(checked.values()))[1].step
    corners = [
        choose_cutoff(signals.position, step, position_noise(signals.position)) for _, signals, _, _ in checked.values()
    ]
    corner = declared.cutoff or float(np.median(corners))
    runs: dict[int, Run] = {}
    for recorded, (setup, signals, torque, unusable) in checked.items():
        name, where = names[numbers[recorded]], f"{log.source}: joint {recorded!r}"
        prepared = prepare(signals, torque, corner, unusable)
        rows = make_rows([prepared], [None])
        try:
            check_excitation(where, prepared.velocity, step)
            check_rows(where, rows, prepared)
        except LogError as error:
            refused[name] = str(error)
            continue
        notes = notes_of(log, setup) + mechanism.notes
        runs[numbers[recorded]] = Run(log.source, name, setup, signals, torque, prepared, rows, notes)
    if not runs:
        raise LogError(next(iter(refused.values())))
    rates = [derivatives(column, step, corner) for column in angles.T]
    return LimbRun(
        source=log.source,
        mechanism=mechanism,
        runs=dict(sorted(runs.items())),
        refused=refused,
        held=tuple(name for number, name in enumerate(names) if number not in numbers.values()),
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
    lacking = ""
    if setup.motor_strength is None and signals.torque is None:
        lacking = (
            " has no torque, and the links of the robot weigh newton metres: log the motor's torque, or give --kp, "
            "--kd and --set motor_strength=1, which takes the commanded torque at its word"
        )
    elif setup.motor_strength is None and not setup.calibrated:
        lacking = ": the torque column has no known unit, and the links weigh newton metres: give --torque-scale"
    if lacking:
        raise LogError(f"{log.source}: joint {recorded!r}{lacking}")
    return setup, signals, (setup.motor_strength or 1.0) * torque, unusable
