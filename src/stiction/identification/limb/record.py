"""From the fit of a limb to a record for each joint: what `joints.json` holds, and what a reader should know.

A joint of a limb has no inertia of its own: what its motor moves depends on how the others stand. What the log tells is
the rotor's, behind what the links ask for by the model: it stands among the `combinations` as `armature`, and `inertia`
is null. The test condition is `in_air`: the friction of joint and gear with the links' weight on the bearings.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from stiction.files.joints import ARMATURE, Estimate, FitSignals, JointRecord
from stiction.identification.assumption import torque_unit
from stiction.identification.back_emf import brake_summary, braking, split_viscous
from stiction.identification.combinations import Strength, exact
from stiction.identification.consistency import Comparison, compare_parts, find_drift, whiteness, widened
from stiction.identification.limb.dynamics import MODES, corrected_torques
from stiction.identification.limb.objections import limb_objections
from stiction.identification.limb.regression import LATENESS, OWN, JointRows, LimbFit
from stiction.identification.limb.signals import LimbRun
from stiction.identification.model import Model
from stiction.identification.record import plain, sampling
from stiction.identification.regression import MAX_INFLATION, Fit, fit_rows
from stiction.identification.runs import fit_signals
from stiction.identification.verdict import is_leg, judge
from stiction.identification.warnings import find_warnings
from stiction.joints.friction import dead_band, friction_ratio

METHOD = "limb_regression"
"""Name of the estimator."""

FAR = 3.0
"""Deviations of the prior beyond which the error of a link is none that a model was declared to have."""

ALONE = "all joints of the limb were fitted together, by torque regression alone: no simulation of the loop checks it"
"""Why there is no second estimator."""

SINGLE = ("inertia", *OWN[1:])
"""Names of `OWN` in the equation of a joint alone."""


def own_fit(fit: LimbFit, rows: JointRows) -> Fit:
    """Return the joint's own equation, fitted alone once the links' torque, corrected, and the lateness are off.

    It serves the comparisons of parts and of time; its `inertia` is the armature, and its intervals know neither the
    model's errors nor the other joints.
    """
    run = rows.joint.run
    mine = [fit.index[f"{name}.{run.joint}"] for name in OWN]
    others = np.delete(np.arange(len(fit.names)), mine)
    left = rows.torque - rows.regressor[:, others] @ fit.values[others]
    return fit_rows(replace(run.rows, torque=left), Model())


def joint_record(limb: LimbRun, fit: LimbFit, free: LimbFit, scale: Estimate | None, rows: JointRows) -> JointRecord:
    """Return one joint's record with its warnings.

    free: a fit that was allowed larger errors of the links; scale: of the limb's torques by its links, where they tell.
    """
    doubts = model_doubts(fit, free)
    run = rows.joint.run
    own, inflation = own_fit(fit, rows), fit.inflation(rows)
    comparisons = compare_parts(own.rows, own)
    stated = widened(dict(zip(SINGLE, fit.own(rows).values())), comparisons)
    found = {name: stated[name] if inflation[one] < MAX_INFLATION else None for name, one in zip(SINGLE, OWN)}
    # Without a sensor the encoder's noise is in the torque and in the acceleration: the rotor would be their product.
    coulomb, armature = found["coulomb_friction"], found["inertia"] if run.measured else None
    together: dict[str, Estimate] = {}
    # Take viscous friction apart from the motor's own brake.
    brakes = braking(run, None)
    if brakes is not None and (viscous := found["viscous_friction"]) is not None:
        strength = Strength(exact(1.0), "measured")
        brakes = brakes.scaled(run.setup.motor_strength or 1.0)
        found["viscous_friction"], together = split_viscous(brakes, viscous, strength)
    limit = run.setup.torque_limit or limb.mechanism.torque_limit[rows.joint.number]
    record = JointRecord(
        viscous_friction=found["viscous_friction"],
        coulomb_friction=coulomb,
        offset=found["offset"],
        friction_ratio=coulomb.scaled(friction_ratio(1.0, limit)) if coulomb is not None and limit else None,
        dead_band=coulomb.scaled(dead_band(1.0, run.setup.kp)) if coulomb is not None and run.setup.kp else None,
        combinations=together | ({} if armature is None else {ARMATURE: armature}),
        test_condition=run.setup.test_condition or "in_air",
        torque_source=(run.setup.torque_source or "motor_side") if run.measured else None,
        kp=run.setup.kp,
        kd=run.setup.kd,
        torque_limit=limit,
    )
    diagnostics = _diagnostics(limb, fit, rows, own, comparisons) | {"inflation": inflation}
    diagnostics |= {"torque_unit": torque_unit(run), "torque_by_links": scale}
    if brakes is not None and together:
        diagnostics["drive"] = brake_summary(brakes, together, strength)
    record = replace(record, diagnostics=plain(diagnostics), friction_law=_law(record, diagnostics, own))
    record = replace(record, objections=limb_objections(record, fit, free, scale, rows))
    verdict = judge(record, legs=is_leg(run.joint), robot=limb.mechanism.name).to_dict()
    record = replace(record, diagnostics=record.diagnostics | plain({"verdict": verdict}))
    said = (*(one.seen for one in record.objections), *doubts, *find_warnings(record, run))
    return replace(record, warnings=(*said, *_limb_warnings(limb, record)))


def _law(record: JointRecord, diagnostics: dict[str, Any], own: Fit) -> dict[str, Any]:
    """Return the law, which is Coulomb's: no other is tried."""
    known = {name: getattr(record, name) for name in OWN[1:]} | {"inertia": record.combinations.get(ARMATURE)}
    return {
        "law": "coulomb",
        "parameters": {name: value.to_dict() for name, value in known.items() if value is not None},
        "over_strength": False,
        "drawn": {
            "viscous_friction": own.by_name["viscous_friction"],
            "symmetric": own.by_name["coulomb_friction"],
        },
        "middle": 0.0,
        "text": "Viscous and Coulomb friction: the only law that is fitted to a whole limb.",
        "candidates": [],
        "method": METHOD,
        "relative_torque_error": diagnostics["relative_torque_error"],
    }


def _diagnostics(
    limb: LimbRun, fit: LimbFit, rows: JointRows, own: Fit, comparisons: tuple[Comparison, ...]
) -> dict[str, Any]:
    """Return the numbers behind the fit."""
    run = rows.joint.run
    residual = fit.residual(rows)
    carrying = [
        name
        for number, name in enumerate(limb.mechanism.joint_names)
        if rows.joint.number in limb.mechanism.chain(number)
    ]
    strength = Strength(exact(run.setup.motor_strength or 1.0), "measured" if run.measured else "declared")
    return {
        "method": METHOD,
        "robot": limb.mechanism.name,
        "strength": {"source": strength.source, "missing": None},
        "samples": len(run.signals.time),
        "samples_used": len(residual),
        **sampling(run),
        "scaled_condition_number": own.scaled_condition,
        "relative_torque_error": float(np.linalg.norm(residual) / np.linalg.norm(run.rows.torque)),
        "whiteness": whiteness(residual),
        "blocks": fit.blocks,
        "position_torque": None,
        "predictions": [],
        "inertia_known": True,
        "gravity": None,
        "comparisons": [comparison.to_dict() for comparison in comparisons],
        "drift": find_drift(own.rows, own),
        "closed_loop": ALONE,
        "output_error": None,
        "lateness": fit.estimate(LATENESS),
        "model_error": float(fit.prior[fit.index[fit.link_names[0]]]) if fit.link_names else None,
        "link_mass_errors": {
            name: fit.estimate(f"{MODES[0]}.{name}") for name in carrying if f"{MODES[0]}.{name}" in fit.index
        },
    }


def _limb_warnings(limb: LimbRun, record: JointRecord) -> list[str]:
    """Return what only a limb calls for: what was held, and what cannot be told."""
    found = []
    if limb.held:
        names = limb.mechanism.joint_names
        angles = ", ".join(f"{name} at {limb.mechanism.rest[names.index(name)]:.3g} rad" for name in limb.held)
        found.append(f"not in the log, and taken to be held: {angles}")
    if record.coulomb_friction is None:
        found.append("dry friction cannot be told from the joint's other torques: use two frequencies, both directions")
    if record.torque_source is None:
        found.append(
            "the rotor's inertia is not told: the torque was made from the position, whose noise is then on both sides "
            "of the equation; log the motor's torque"
        )
    elif ARMATURE not in record.combinations:
        found.append("the rotor's inertia cannot be told from the links': move faster")
    elif record.combinations[ARMATURE].interval95[0] <= 0:
        found.append("the interval of the rotor's inertia reaches zero: the log does not show it; move faster")
    return found


def model_doubts(fit: LimbFit, free: LimbFit) -> tuple[str, ...]:
    """Say which link is not the log's within the declared error, the worst one.

    free: a fit that was allowed larger errors.
    """
    size = np.where(fit.of_links, free.values / fit.prior, 0.0)
    certain = np.abs(free.values) > FAR * np.sqrt(np.diag(free.covariance))
    worst = int(np.argmax(np.abs(size) * certain))
    if not (certain[worst] and abs(size[worst]) > FAR):
        return ()
    mode, _, link = fit.names[worst].partition(".")
    return (
        f"the model is not the log's within the declared error ({fit.prior[worst]:.3g}): {mode.replace('_', ' ')} of "
        f"the link that {link} moves would be off by {free.values[worst]:+.0%}; are signs and zeros of the joints, the "
        "direction up (--up) and the load the model's, or does friction depend on the angle? Mend the model, or "
        "declare a larger --model-error",
    )


def joint_signals(limb: LimbRun, fit: LimbFit, torques: np.ndarray, rows: JointRows) -> FitSignals:
    """Return what the page draws of one joint; torques: of the links, corrected, over the whole log [N m], (T, J)."""
    run, prepared = rows.joint.run, rows.joint.run.prepared
    armature, viscous, coulomb, offset = (fit.values[fit.index[f"{name}.{run.joint}"]] for name in OWN)
    late = fit.values[fit.index[LATENESS]] * np.gradient(prepared.torque, prepared.step)
    rigid = torques[:, rows.joint.number] + armature * prepared.acceleration + offset - late - prepared.outside
    fitted = rigid + viscous * prepared.velocity + coulomb * prepared.direction
    return fit_signals(run, fitted, fitted, rigid)


def found_torques(limb: LimbRun, fit: LimbFit) -> np.ndarray:
    """Return the torque of the links, with the errors that were found, over the whole log [N m], (T, J)."""
    errors = np.zeros((limb.mechanism.num_joints, len(MODES)))
    for name in fit.link_names:
        mode, _, link = name.partition(".")
        errors[limb.mechanism.joint_names.index(link), MODES.index(mode)] = fit.values[fit.index[name]]
    return corrected_torques(limb.mechanism, errors, limb.position, limb.velocity, limb.acceleration)
