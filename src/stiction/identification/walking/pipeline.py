"""A walking log, start to end: motion, swing, stance, and a record for every joint that the walk tells about."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.files.joints import LOAD_REGRESSORS, JointRecord, JointsFile
from stiction.files.walk import WalkFit, WalkHeader, WalkLog
from stiction.identification.combinations import shifted
from stiction.identification.record import plain
from stiction.identification.verdict import judge
from stiction.identification.walking.body import BaseMotion, JointMotion, link_effort
from stiction.identification.walking.contact import SOURCES, contact_source, feet_down
from stiction.identification.walking.load import LoadFit, fit_load
from stiction.identification.walking.motion import WalkMotion, walk_motion
from stiction.identification.walking.objections import WalkChecks, check_walk, joint_objections
from stiction.identification.walking.setup import WalkSetup
from stiction.identification.walking.swing import PARAMETERS, SwingFit, SwingRows, fit_swing, swing_rows
from stiction.joints.friction import dead_band, friction_ratio
from stiction.robots.model import Robot

GAIT_SHOWN = 4.0
"""Length of the gait that the page draws [s]."""

COARSE = 0.0025
"""Period beyond which a robot's accelerations are blurred [s]: intervals of inertia and viscous friction then hold the
truth too seldom, those of dry friction do not. Where the torque was sampled they are not stated then."""


@dataclass(frozen=True)
class WalkIdentification:
    """What was found in the log of a walk."""

    joints: JointsFile
    """A record under each joint's own name where its own swings tell; else its kind's, from all legs together."""
    load: LoadFit
    """What is known about friction under load, or why nothing is."""
    fit: WalkFit
    """For the page."""


def identify_walk(
    log: WalkLog,
    spec: Robot,
    setup: WalkSetup | None = None,
    notes: tuple[str, ...] = (),
    sampled: bool = False,
    unplaced: float = 0.0,
) -> WalkIdentification:
    """Identify the joints of a walking robot.

    notes: on how the log was read, for whoever reads the result; sampled, unplaced: see `walk_motion`.

    A joint's own swings are asked first. Where they do not tell, the joints of its kind are taken to be alike and their
    swings are put together, under the kind's name. Where those do not tell either, the kind's record says why, and its
    numbers are null. Raises `StictionError` where the log is not of this robot, or no joint is told.
    """
    setup = setup or WalkSetup()
    contact = contact_source(log, setup)
    motion = walk_motion(log, spec, sampled, unplaced)
    fine = not sampled or rates_are_known(log)
    rows = swing_rows(log, motion, spec, setup)
    limits = log.header.torque_limit
    own = [fit_swing([joint], limit, motion.period, setup) for joint, limit in zip(rows, limits, strict=True)]
    load = fit_load(log, motion, spec, rows, setup)
    links = standing_inertia(spec)
    records: dict[str, JointRecord] = {}
    chosen = {name: fit for name, fit in zip(spec.joint_names, own, strict=True) if fit.fit is not None}
    for kind in spec.joint_kinds:
        members = spec.joints_of(kind).tolist()
        if any(own[number].fit is None for number in members):
            chosen[kind] = fit_swing([rows[number] for number in members], limits[members[0]], motion.period, setup)
    if all(fit.fit is None for fit in chosen.values()):
        name = max(chosen, key=lambda name: chosen[name].rows)
        raise LogError(f"this walk tells nothing about any joint: {name}: {chosen[name].refusal}")
    fits = [chosen.get(joint.name) or chosen.get(joint.kind) for joint in spec.joints]
    checks = check_walk(log, motion, spec, setup, fits)
    for name, fit in chosen.items():
        number = _number(name, spec)
        record = _record(fit, log.header, spec, number, float(links[number]), load, motion, fine, checks)
        record.diagnostics["contact"] = SOURCES[contact]
        warnings = _warnings(name, fit, record, own, spec, log, motion, load, contact, fine)
        records[name] = replace(record, warnings=(*warnings, *notes))
    return WalkIdentification(JointsFile(records), load, _walk_fit(log, motion, spec, setup, rows, chosen, load))


def rates_are_known(log: WalkLog) -> bool:
    """Return whether inertia and viscous friction may be stated where the torque was sampled.

    A torque that jumps with every target is not known between its samples, which looks like viscous friction and rotor:
    the bound of that takes the targets and the gains, and holds at short periods alone.
    """
    # Where the file had no targets the positions stand in their place.
    complete = bool(np.ptp(log.joint_target - log.joint_position, axis=0).all()) and min(log.header.kp) > 0
    return complete and log.header.period <= 1.001 * COARSE


def _number(name: str, spec: Robot) -> int:
    """Return the number of a joint, or of the first one of a kind."""
    return spec.joint_names.index(name) if name in spec.joint_names else int(spec.joints_of(name)[0])


def standing_inertia(spec: Robot) -> np.ndarray:
    """Return the inertia that the links put on each joint in the standing pose, all others held [kg m²], shape (J,)."""
    each = np.eye(spec.num_joints)
    standing, rest = np.tile(spec.joint_values("default_position"), (len(each), 1)), np.zeros((len(each), 3))
    joints = JointMotion(standing, np.zeros_like(each), each)
    return link_effort(spec, joints, BaseMotion(rest, rest, rest)).torque.diagonal()


def _record(
    swing: SwingFit,
    header: WalkHeader,
    spec: Robot,
    number: int,
    links: float,
    load: LoadFit,
    motion: WalkMotion,
    fine: bool,
    checks: WalkChecks,
) -> JointRecord:
    """Return a joint's record, warnings apart. fine: inertia and viscous friction are told too.

    The inertia is that of a leg in the air: rotor, and links in the standing pose, whoever uses it takes those off.
    Where no torque was logged, the motor's strength is unknown: newton metres are null, the ratios stay.
    """
    kind, limit, kp = spec.joints[number].kind, header.torque_limit[number], header.kp[number]
    settings: dict[str, Any] = {
        "test_condition": "in_air",
        "torque_source": (header.torque_source or "motor_side") if motion.measured_torque else None,
        "kp": kp,
        "kd": header.kd[number],
        "torque_limit": limit,
    }
    law = load.laws.get(kind)
    torque, friction = load.under_load.get(kind, (None, None))
    if law is not None and friction is not None:
        settings["load_coefficient"] = law["load_coefficient"]
        settings["combinations"] = {f"coulomb_friction + {torque:.3g} N m * load_coefficient": friction}
        named = {"law": "load", "regressor": "motor_torque", "load": LOAD_REGRESSORS["motor_torque"]}
        settings["friction_law"] = named | {name: estimate.to_dict() for name, estimate in law.items()}
    diagnostics: dict[str, Any] = {
        "method": "walking",
        "kind": kind,
        "joints": list(swing.joints),
        "swings": swing.swings,
        "samples_used": swing.rows,
        "output_error": None,
        "load": {
            "refusal": load.refusal or load.refused.get(kind, ""),
            "equations": load.rows,
            "carried_torque": torque,
            "carried_friction": friction,
        },
    }
    if swing.fit is not None:
        rotor, viscous, coulomb = (swing.fit.estimate(index) for index in range(3))
        diagnostics |= {
            "scaled_condition_number": swing.fit.condition,
            "rms_residual": float(np.std(swing.fit.residual)),
            "lateness": swing.fit.estimate(PARAMETERS.index("lateness")),
            "coulomb_friction_by_heavier_links": float(swing.fit.shifts[0, 2]),
        }
        if fine:
            diagnostics["rotor_inertia"] = rotor
        settings["friction_ratio"] = coulomb.scaled(friction_ratio(1.0, limit))
        settings["dead_band"] = coulomb.scaled(dead_band(1.0, kp)) if kp > 0 else None
        if motion.measured_torque:
            settings["coulomb_friction"] = coulomb
            if fine:
                settings |= {"viscous_friction": viscous, "inertia": shifted(rotor, links)}
            # Offsets stand behind what all joints share, one a joint: of several none is the kind's.
            settings["offset"] = swing.fit.estimate(len(PARAMETERS)) if len(swing.joints) == 1 else None
        else:
            settings["combinations"] = {"f/k": coulomb, "B/k": viscous}
    diagnostics["torque_by_weight"] = checks.weight
    own = () if swing.fit is None else joint_objections(swing.fit, motion.measured_acceleration)
    record = JointRecord(**settings, objections=(*checks.objections, *own), diagnostics=plain(diagnostics))
    return replace(record, diagnostics=record.diagnostics | {"verdict": judge(record, robot=spec.name).to_dict()})


def _warnings(
    name: str,
    swing: SwingFit,
    record: JointRecord,
    own: list[SwingFit],
    spec: Robot,
    log: WalkLog,
    motion: WalkMotion,
    load: LoadFit,
    contact: str,
    fine: bool,
) -> tuple[str, ...]:
    """Return what a reader should know before trusting a record."""
    found = [one.seen for one in record.objections]
    kind = spec.joints[_number(name, spec)].kind
    if swing.fit is None:
        found.append(f"nothing is known: {swing.refusal}")
    elif name not in spec.joint_names:
        silent = [spec.joint_names[number] for number in spec.joints_of(kind) if own[number].fit is None]
        alike = ", ".join(silent)
        found.append(f"swings of all {name} joints together, as if alike, for those whose own do not tell: {alike}")
    if not motion.measured_torque:
        found.append(
            "torque was not logged: what the controller asked for stands in, so newton metres are null; friction is "
            "known as a share of the motor's command"
        )
    elif log.header.torque_source is None:
        found.append(
            "where torque was measured was not declared: taken as the motor's side (current or command, joint friction "
            "not in it); declare it, --torque-source, or torque_source in the header of a log of evaluate --log"
        )
    if not motion.measured_acceleration:
        found.append("there was no accelerometer: the base's acceleration is neglected, and intervals are wide for it")
    if not fine:
        found.append(
            "inertia and viscous friction are not stated: between samples of the torque it is not known when it jumps "
            f"with the target; that takes {1 / COARSE:.0f} samples a second, the targets, and the gains --kp and --kd"
        )
    elif log.header.recorded_in == "robot" and motion.period > COARSE:
        found.append(
            f"sampled at {1 / motion.period:.0f} Hz: inertia and viscous friction may be off by a tenth, dry friction "
            "is not; log at 500 Hz"
        )
    if log.foot_contact is None and contact == "height":
        found.append("foot contact was not logged: feet clear of the lowest one are taken to swing, as on flat ground")
    refusal = load.refusal or load.refused.get(kind, "")
    if refusal:
        found.append(f"friction under load is not known: {refusal}")
    return tuple(found)


def _walk_fit(
    log: WalkLog,
    motion: WalkMotion,
    spec: Robot,
    setup: WalkSetup,
    rows: list[SwingRows],
    chosen: dict[str, SwingFit],
    load: LoadFit,
) -> WalkFit:
    """Collect what the page draws: clouds under the names of the records."""
    clouds = {}
    for name, fit in chosen.items():
        if fit.fit is not None:
            members = [joint for joint in rows if joint.joint in fit.joints]
            armature = float(fit.fit.values[0])
            clouds[name] = (
                np.concatenate([joint.velocity for joint in members]),
                np.concatenate([joint.torque - armature * joint.acceleration for joint in members]),
            )
    shown = slice(0, round(GAIT_SHOWN / motion.period))
    down = feet_down(log, motion, spec, setup)[shown]
    gait = {foot: column for foot, column in zip(spec.foot_names, down.T, strict=True)}
    partial = {kind: (parts[0], parts[1]) for kind, parts in load.partial.items()}
    return WalkFit(clouds, log.time[shown] - log.time[0], gait, partial)
