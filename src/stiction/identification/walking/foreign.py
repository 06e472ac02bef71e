"""Walk from a log with its own columns: matched, checked, even in time.

Torque is taken as sampled at its own stamp, where the second difference of the angle is too. Facts about the motors
that the file lacks come from flags or its sidecar; undeclared torque limits come from the robot.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stiction.core.errors import LogError
from stiction.core.rotation import continuous, up_in_frames
from stiction.files.log import BODY, BodySignals, JointSignals, Log
from stiction.files.walk import LARGEST, WalkHeader, WalkLog
from stiction.identification.checks import LARGEST_TIME
from stiction.identification.limb.dynamics import motions_at_rest
from stiction.identification.limb.signals import bare, match_joints
from stiction.identification.runs import in_si, notes_of
from stiction.identification.setup import IdentifySetup
from stiction.identification.timing import Grid, even_grid, resample
from stiction.identification.walking.imu import base_imu
from stiction.identification.walking.setup import RobotLogSetup, WalkSetup
from stiction.identification.walking.walk import LONGEST_PERIOD, SHORTEST, Walk, foot_positions
from stiction.robots.model import Robot

FEWEST_SAMPLES = 100
"""Fewest samples of a log: fewer are no second of a walk at any rate that is admitted."""

LOUDEST = 1.5
"""Torque over the motor's limit above which it is not in N m, or not this robot's [1]."""

UNPLACED = 0.05
"""Largest distance of an IMU of unknown place from the base's origin along each axis [m]; 95 % bound. A Go2's
is 4 cm above it and 3 cm behind. A choice."""

UNLOADED = 0.2
"""Share between the least and the largest force of a foot above which it bears load [1]."""

LEAST_AGREEMENT = 0.2
"""Correlation between a foot's force and its being low below which the force is not this foot's [1]."""


def foreign_walk(
    log: Log,
    spec: Robot,
    declared: IdentifySetup | None = None,
    recorded: RobotLogSetup | None = None,
    setup: WalkSetup | None = None,
) -> Walk:
    """Return the walk in a log with its own columns, of the robot `spec`.

    declared: set-up of the log, as for a joint's; recorded: names and the IMU's place; setup: of the walk.
    Raises `LogError` where joints do not match, a necessary signal is missing, or the signals contradict one
    another.
    """
    declared, recorded = declared or IdentifySetup(), recorded or RobotLogSetup()
    names = match_names(log, spec, recorded.joint_map)
    body = log.body or BodySignals()
    _refuse_holes(log, names, body)
    grid, timing = even_grid(log.source, log.time)
    part, cut = _longest_part(grid)
    _refuse_slow(log, names, body, grid.step, (part.stop - part.start) * grid.step)

    def even(values: np.ndarray, held: bool = False) -> np.ndarray:
        return np.stack([resample(grid, column, held) for column in values.T], axis=1)[part]

    setups = [declared.with_sidecar(log.setup_of(name)) for name in names]
    for item in setups:
        item.check_torque_limit()
    signals = [in_si(log.joints[name], item) for name, item in zip(names, setups, strict=True)]
    position, velocity, target, torque = (
        _column(signals, role) for role in ("position", "velocity", "target", "torque")
    )
    header = _header(log.source, spec, setups, grid.step)
    assert position is not None
    position = even(position)
    if torque is not None:
        torque = even(torque) * [item.torque_scale or 1.0 for item in setups]
        _refuse_loud(log.source, torque, header)
    elif target is None or 0.0 in header.kp:
        raise LogError(
            f"{log.source}: no torque of every joint, and without targets and the gains --kp and --kd it cannot be "
            "reconstructed; log the motors' torque"
        )
    if body.quaternion is not None:
        body = replace(body, quaternion=continuous(body.quaternion))
    imu, concluded = base_imu(log.source, body.each(even), grid.step, recorded.imu_position)
    assert imu.quaternion is not None and imu.gyroscope is not None
    contact, contact_notes = _contact(log.source, imu, position, spec)
    walk = WalkLog(
        header,
        time=np.arange(len(position)) * grid.step,
        joint_position=position,
        joint_velocity=np.gradient(position, grid.step, axis=0) if velocity is None else even(velocity),
        joint_target=position if target is None else even(target, True),
        angular_velocity=imu.gyroscope,
        quaternion=imu.quaternion,
        joint_torque=torque,
        specific_force=imu.accelerometer,
        foot_contact=contact,
    )
    notes = (*notes_of(log, setups[0]), *timing.warnings(), *cut, *concluded, *contact_notes)
    unplaced = recorded.imu_position is None and imu.accelerometer is not None
    return Walk(walk, spec, setup or WalkSetup(), notes, True, UNPLACED if unplaced else 0.0)


def match_names(log: Log, spec: Robot, pairs: tuple[str, ...] = ()) -> list[str]:
    """Return the log's name of each of the robot's joints, in the robot's order; raise `LogError` where one is missing.

    Joints that the robot holds are left out; see `match_joints`.
    """
    numbers = match_joints(log, spec.name, spec.joint_names, pairs, [joint.name for joint in spec.held])
    names = {number: recorded for recorded, number in numbers.items()}
    missing = [name for number, name in enumerate(spec.joint_names) if number not in names]
    if missing:
        raise LogError(
            f"{log.source}: robot {spec.name!r} has the joint {missing[0]!r}, the log has not; expected all joints of "
            "the robot that walked: name it with --robot, or say which joint is which, --joint-map RECORDED=JOINT"
        )
    return [names[number] for number in range(spec.num_joints)]


def _refuse_holes(log: Log, names: list[str], body: BodySignals) -> None:
    """Reject a log that is too short, joints without a position, and numbers that are not finite."""
    if len(log.time) < FEWEST_SAMPLES:
        raise LogError(f"{log.source}: {len(log.time)} samples; expected at least {SHORTEST:g} s of a walk")
    arrays = [("time", log.time)]
    for name in names:
        if log.joints[name].position is None:
            raise LogError(f"{log.source}: joint {name!r} has no position; log that of every joint of the robot")
        parts = ("position", "velocity", "target", "torque")
        arrays += [(f"{part} of {name}", getattr(log.joints[name], part)) for part in parts]
    arrays += [(name, getattr(body, name)) for name in BODY]
    for name, values in arrays:
        largest = LARGEST_TIME if name == "time" else LARGEST
        if values is not None and not np.all(np.abs(values) <= largest):
            raise LogError(f"{log.source}: {name} is not finite, or huge; expected numbers: cut those rows out")


def _longest_part(grid: Grid) -> tuple[slice, tuple[str, ...]]:
    """Return the longest part of the grid without a long gap, and a note on the rest."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], grid.valid.astype(int), [0]))))
    if not len(edges):
        return slice(0, 0), ()
    first, last = max(edges.reshape(-1, 2).tolist(), key=lambda ends: ends[1] - ends[0])
    if last - first == len(grid.times):
        return slice(first, last), ()
    note = f"the longest part without a gap is used, {first * grid.step:.4g} to {last * grid.step:.4g} s of the log"
    return slice(first, last), (note,)


def _refuse_slow(log: Log, names: list[str], body: BodySignals, step: float, length: float) -> None:
    """Reject a walk that is too short, and signals too slow for the acceleration of a leg in swing."""
    positions = np.stack([log.joints[name].position for name in names], axis=1)  # type: ignore[misc]
    # A log may be written faster than its signals come, which then repeat themselves.
    periods = {"the log": step, "the joints' positions": step / _fresh(positions)}
    if body.gyroscope is not None:
        periods["the IMU"] = max(body.period or 0.0, step / _fresh(body.gyroscope))
    for signal, period in periods.items():
        if period > 1.01 * LONGEST_PERIOD:
            raise LogError(
                f"{log.source}: {signal} came {1 / period:.0f} times a second; expected {1 / LONGEST_PERIOD:.0f} or "
                "more: a swing lasts some 0.2 s and the joint's controller changes its torque within milliseconds, so "
                "that between slower samples neither acceleration nor torque is known, and friction would be stated "
                "wrongly: log at the rate of the joint controllers, 200 to 1000 Hz"
            )
    if length < SHORTEST:
        raise LogError(f"{log.source}: {length:.3g} s of a walk; expected at least {SHORTEST:g} s: log for longer")


def _fresh(values: np.ndarray) -> float:
    """Return the share of samples that differ from the one before, at least one in a thousand; values: (T, N)."""
    return max(1e-3, float(np.mean(np.any(np.diff(values, axis=0) != 0, axis=1))))


def _column(signals: list[JointSignals], role: str) -> np.ndarray | None:
    """Return a signal of all joints, shape (T, J); None where a joint has none."""
    columns = [getattr(joint, role) for joint in signals]
    return None if any(column is None for column in columns) else np.stack(columns, axis=1)


def _header(source: str, spec: Robot, setups: list[IdentifySetup], step: float) -> WalkHeader:
    """Return the header of a walk, which its signals do not contain; gains that were not declared are 0."""
    limits = spec.joint_values("torque_limit").tolist()
    sources = {setup.torque_source for setup in setups}
    if len(sources) > 1:
        raise LogError(f"{source}: torque sources differ between joints; expected one for all, --torque-source")
    return WalkHeader(
        robot=spec.name,
        joint_names=spec.joint_names,
        foot_names=spec.foot_names,
        period=step,
        kp=tuple(setup.kp or 0.0 for setup in setups),
        kd=tuple(setup.kd or 0.0 for setup in setups),
        torque_limit=tuple(setup.torque_limit or limit for setup, limit in zip(setups, limits, strict=True)),
        torque_source=sources.pop(),
    )


def _refuse_loud(source: str, torque: np.ndarray, header: WalkHeader) -> None:
    """Reject torques that these motors cannot give."""
    share = np.quantile(np.abs(torque), 0.99, axis=0) / header.torque_limit
    loudest = int(share.argmax())
    if share[loudest] > LOUDEST:
        raise LogError(
            f"{source}: the torque of {header.joint_names[loudest]} reaches {share[loudest]:.3g} times its limit, "
            f"{header.torque_limit[loudest]:g} N m; expected newton metres at the joint: --torque-scale, or say the "
            "limit, --torque-limit"
        )


def _contact(
    source: str, body: BodySignals, position: np.ndarray, spec: Robot
) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """Return the feet that bear load by their force, bool, shape (T, L), None without one, and notes."""
    force, feet = body.foot_force, ", ".join(spec.foot_names)
    if force is None:
        return None, ()
    places = {bare(name): place for place, name in enumerate(body.foot_names or spec.foot_names)}
    if force.shape[1] != len(places) or not places.keys() >= set(map(bare, spec.foot_names)):
        named = ", ".join(body.foot_names) or f"{force.shape[1]} feet"
        raise LogError(
            f"{source}: foot force of {named}, robot {spec.name!r} has the feet {feet}; map it in that order: "
            "--columns foot_force=NAME,NAME,..."
        )
    force = force[:, [places[bare(name)] for name in spec.foot_names]]
    low, high = np.quantile(force, [0.02, 0.95], axis=0)
    height = foot_positions(spec, motions_at_rest(spec.links, position))
    assert body.quaternion is not None
    height = np.einsum("tli,ti->tl", height, up_in_frames(body.quaternion))
    # How high a foot swings says nothing of its load: from 5 cm on all are equally up.
    depth = (height.min(axis=1, keepdims=True) - height).clip(-0.05)
    for number, name in enumerate(spec.foot_names):
        if high[number] <= low[number]:
            raise LogError(
                f"{source}: the force of foot {name} never changes; leave foot_force out, or mend the sensor"
            )
        match = float(np.corrcoef(force[:, number], depth[:, number])[0, 1])
        if not match > LEAST_AGREEMENT:
            raise LogError(
                f"{source}: the force of foot {name} is not large where that foot is low (correlation {match:.2f}); "
                "expected the feet in the robot's order, larger under load: --columns foot_force=NAME,NAME,..."
            )
    down = force > low + UNLOADED * (high - low)
    notes = [] if body.foot_names else [f"foot forces were taken in the robot's order, {feet}"]
    return down, (*notes, f"a foot bears load from {UNLOADED:.0%} between its least and largest force on")
