"""Identification of a walk, start to end: swing, stance, and a record for every joint that the walk tells about."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.files.joints import LOAD_REGRESSORS, Estimate, Finding, JointRecord, JointsFile, warning
from stiction.files.walk import WalkFit
from stiction.identification.combinations import shifted
from stiction.identification.limb.dynamics import joint_inertia
from stiction.identification.record import plain
from stiction.identification.verdict import judge
from stiction.identification.walking.findings import check_walk, joint_errors
from stiction.identification.walking.load import LoadFit, fit_load
from stiction.identification.walking.swing import SwingFit, SwingRows, fit_swing, swing_rows
from stiction.identification.walking.walk import SOURCES, Walk
from stiction.joints.friction import dead_band, friction_ratio
from stiction.robots.model import Robot

GAIT_SHOWN = 4.0
"""Length of the gait that the page draws [s]."""

COARSE = 0.0025
"""Period above which a robot's accelerations are blurred [s]: intervals of inertia and viscous friction then hold the
truth too seldom, those of dry friction do not. Where the torque was sampled they are not stated then."""


@dataclass(frozen=True)
class WalkIdentification:
    """Result for the log of a walk."""

    joints: JointsFile
    """Record under each joint's name where its own swings tell; else under its kind's, from all legs together."""
    load: LoadFit
    """Friction under load, or the reason why it is not known."""
    fit: WalkFit
    """Signals for the page."""


@dataclass(frozen=True)
class WalkFits:
    """All fits to a walk."""

    walk: Walk
    """Walk that was fitted."""
    chosen: dict[str, SwingFit]
    """Stated fits: joint, or kind where a joint's own swings do not tell -> fit."""
    load: LoadFit
    """Fit of the friction that load adds."""
    errors: tuple[Finding, ...]
    """Errors that make all of the fits invalid."""
    weight: Estimate | None
    """Weight that the motors hold over the robot's [1], where the walk tells."""


def identify_walk(walk: Walk) -> WalkIdentification:
    """Identify the joints of a walking robot.

    A joint's own swings are used first. Where they do not tell, the joints of its kind are taken to be alike and their
    swings are put together, under the kind's name. Where those do not tell either, the kind's record has the reason,
    and its numbers are null. Raises `StictionError` where no joint is told.
    """
    spec, limits = walk.spec, walk.limits
    rows = swing_rows(walk)
    single = [fit_swing([joint], limit, walk.period, walk.setup) for joint, limit in zip(rows, limits, strict=True)]
    load = fit_load(walk, rows)
    chosen = {name: fit for name, fit in zip(spec.joint_names, single, strict=True) if fit.fit is not None}
    for kind in spec.joint_kinds:
        members = spec.joints_of(kind).tolist()
        if any(single[number].fit is None for number in members):
            chosen[kind] = fit_swing([rows[number] for number in members], limits[members[0]], walk.period, walk.setup)
    if all(fit.fit is None for fit in chosen.values()):
        name = max(chosen, key=lambda name: chosen[name].rows)
        raise LogError(f"the walk does not excite any joint enough to identify it: {name}: {chosen[name].refusal}")
    known = [chosen.get(joint.name) or chosen[joint.kind] for joint in spec.joints]
    fits = WalkFits(walk, chosen, load, *check_walk(walk, [swing.fit for swing in known]))
    records = {name: joint_record(fits, name) for name in chosen}
    return WalkIdentification(JointsFile(records), load, _walk_fit(fits, rows))


def rates_are_known(walk: Walk) -> bool:
    """Return True if inertia and viscous friction may be stated.

    A sampled torque that jumps with every target is not known between its samples, which looks like viscous friction
    and rotor: the bound of that takes the targets and the gains, and holds at short periods alone.
    """
    log = walk.log
    # Where the file had no targets the positions stand in their place.
    complete = bool(np.ptp(log.joint_target - log.joint_position, axis=0).all()) and min(log.header.kp) > 0
    return not walk.sampled or (complete and walk.period <= 1.001 * COARSE)


def standing_inertia(spec: Robot) -> np.ndarray:
    """Return the inertia that the links put on each joint in the standing pose, all others held [kg m²], shape (J,)."""
    return joint_inertia(spec.links, spec.joint_values("default_position"))


def joint_record(fits: WalkFits, name: str) -> JointRecord:
    """Return the record of a joint or of a kind, with its findings and verdict.

    The inertia is that of a leg in the air: rotor, and links in the standing pose, whoever uses it takes those off.
    Where no torque was logged, the motor's strength is unknown: newton metres are null, the ratios stay.
    """
    walk, swing, spec, header = fits.walk, fits.chosen[name], fits.walk.spec, fits.walk.log.header
    number = spec.joint_names.index(name) if name in spec.joint_names else int(spec.joints_of(name)[0])
    kind, limit, kp = spec.joints[number].kind, header.torque_limit[number], header.kp[number]
    settings: dict[str, Any] = {
        "test_condition": "in_air",
        "torque_source": (header.torque_source or "motor_side") if walk.measured_torque else None,
        "kp": kp,
        "kd": header.kd[number],
        "torque_limit": limit,
    }
    torque, friction = fits.load.under_load.get(kind, (None, None))
    if friction is not None:
        law = fits.load.laws[kind]
        settings["load_coefficient"] = law["load_coefficient"]
        settings["combinations"] = {f"coulomb_friction + {torque:.3g} N m * load_coefficient": friction}
        regressor = {"law": "load", "regressor": "motor_torque", "load": LOAD_REGRESSORS["motor_torque"]}
        settings["friction_law"] = regressor | {key: estimate.to_dict() for key, estimate in law.items()}
    diagnostics: dict[str, Any] = {
        "method": "walking",
        "kind": kind,
        "joints": list(swing.joints),
        "swings": swing.swings,
        "samples_used": swing.rows,
        "output_error": None,
        "load": {
            "refusal": fits.load.refusal or fits.load.refused.get(kind, ""),
            "equations": fits.load.rows,
            "carried_torque": torque,
            "carried_friction": friction,
        },
        "torque_by_weight": fits.weight,
        "contact": SOURCES[walk.contact],
    }
    errors = fits.errors
    if swing.fit is not None:
        fit, rates = swing.fit, rates_are_known(walk)
        rotor, viscous, coulomb = (fit.estimate(key) for key in ("armature", "viscous_friction", "coulomb_friction"))
        diagnostics |= {
            "scaled_condition_number": fit.condition,
            "rms_residual": float(np.std(fit.residual)),
            "lateness": fit.estimate("lateness"),
            "coulomb_friction_by_heavier_links": float(fit.shifts[0, fit.names.index("coulomb_friction")]),
        }
        settings["friction_ratio"] = coulomb.scaled(friction_ratio(1.0, limit))
        settings["dead_band"] = coulomb.scaled(dead_band(1.0, kp)) if kp > 0 else None
        if rates:
            diagnostics["rotor_inertia"] = rotor
        if not walk.measured_torque:
            settings["combinations"] = {"f/k": coulomb, "B/k": viscous}
        else:
            settings["coulomb_friction"] = coulomb
            # Offsets stand behind what all joints share, one a joint: of several none is the kind's.
            settings["offset"] = fit.estimate(f"offset.{swing.joints[0]}") if len(swing.joints) == 1 else None
            if rates:
                inertia = shifted(rotor, float(standing_inertia(spec)[number]))
                settings |= {"viscous_friction": viscous, "inertia": inertia}
        errors += tuple(joint_errors(fit, walk.measured_acceleration))
    record = JointRecord(**settings, findings=errors, diagnostics=plain(diagnostics))
    record = replace(record, diagnostics=record.diagnostics | {"verdict": judge(record, robot=spec.name).to_dict()})
    notes = (Finding("reading", text, severity="note") for text in walk.notes)
    return replace(record, findings=(*errors, *_warnings(fits, name, kind), *notes))


def _warnings(fits: WalkFits, name: str, kind: str) -> Iterator[Finding]:
    """Yield warnings that a reader should know before trusting the record of a joint, or of a kind."""
    walk, swing = fits.walk, fits.chosen[name]
    if swing.fit is None:
        yield warning("swings", f"nothing is known: {swing.refusal}")
    elif name not in walk.spec.joint_names:
        silent = ", ".join(joint for joint in swing.joints if joint not in fits.chosen)
        yield warning(
            "swings", f"swings of all {name} joints together, as if alike, for those whose own do not tell: {silent}"
        )
    if not walk.measured_torque:
        yield warning(
            "torque",
            "torque was not logged: what the controller asked for stands in, so newton metres are null; friction is "
            "known as a share of the motor's command",
        )
    elif walk.log.header.torque_source is None:
        yield warning(
            "torque_source",
            "where torque was measured was not declared: taken as the motor's side (current or command, joint friction "
            "not in it); declare it, --torque-source, or torque_source in the header of a log of evaluate --log",
        )
    if not walk.measured_acceleration:
        yield warning(
            "accelerometer",
            "there was no accelerometer: the base's acceleration is neglected, and intervals are wide for it",
        )
    if not rates_are_known(walk):
        yield warning(
            "rates",
            "inertia and viscous friction are not stated: between samples of the torque it is not known when it jumps "
            f"with the target; that takes {1 / COARSE:.0f} samples a second, the targets, and the gains --kp and --kd",
        )
    elif walk.log.header.recorded_in == "robot" and walk.period > COARSE:
        yield warning(
            "rates",
            f"sampled at {1 / walk.period:.0f} Hz: inertia and viscous friction may be off by a tenth, dry friction "
            "is not; log at 500 Hz",
        )
    if walk.log.foot_contact is None and walk.contact == "height":
        yield warning(
            "contact", "foot contact was not logged: feet clear of the lowest one are taken to swing, as on flat ground"
        )
    if refusal := fits.load.refusal or fits.load.refused.get(kind, ""):
        yield warning("load", f"friction under load is not known: {refusal}")


def _walk_fit(fits: WalkFits, rows: list[SwingRows]) -> WalkFit:
    """Collect the signals that the page draws: clouds under the names of the records."""
    clouds, walk = {}, fits.walk
    for name, swing in fits.chosen.items():
        if swing.fit is not None:
            members = [joint for joint in rows if joint.joint in swing.joints]
            armature = swing.fit.value("armature")
            clouds[name] = (
                np.concatenate([joint.regressor[:, 1] for joint in members]),
                np.concatenate([joint.torque - armature * joint.regressor[:, 0] for joint in members]),
            )
    shown = slice(0, round(GAIT_SHOWN / walk.period))
    gait = dict(zip(walk.spec.foot_names, walk.down[shown].T, strict=True))
    return WalkFit(clouds, walk.log.time[shown] - walk.log.time[0], gait, fits.load.partial)
