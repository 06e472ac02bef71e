"""Identification of a whole limb from its log: signals, one regression for all joints, a record for each.

A joint of a limb has no inertia of its own: what its motor moves depends on the pose of the others. The log tells that
of the rotor, beyond the links' torque by the model: it stands among the `combinations` as `armature`, and `inertia`
is null. The test condition is `in_air`: the friction of joint and gear with the links' weight on the bearings.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.files.joints import ARMATURE, Estimate, Finding, FitSignals, JointRecord, JointsFile, refused, warning
from stiction.files.log import Log
from stiction.identification.combinations import Strength, brake_summary, braking, exact, split_viscous
from stiction.identification.consistency import LARGEST_SIGMAS, compare_parts, find_drift, whiteness, widened
from stiction.identification.contradictions import SERIOUS, signal_findings
from stiction.identification.findings import NEGATIVE_FRICTION, find_warnings, no_friction_shown, unexplained
from stiction.identification.limb.dynamics import MODES, model_torques
from stiction.identification.limb.fit import PriorFit
from stiction.identification.limb.regression import (
    JOINT_PARAMETERS,
    LATENESS,
    JointRows,
    LimbRows,
    fit_limb,
    fit_scale,
    limb_rows,
)
from stiction.identification.limb.signals import LimbRun, limb_run
from stiction.identification.model import Model
from stiction.identification.record import plain, sampling
from stiction.identification.regression import MAX_INFLATION, Fit, fit_rows
from stiction.identification.runs import fit_signals
from stiction.identification.setup import IdentifySetup, LimbSetup
from stiction.identification.verdict import is_leg, judge, torque_unit
from stiction.joints.friction import dead_band, friction_ratio
from stiction.robots.mechanism import Mechanism

METHOD = "limb_regression"
"""Name of the estimator."""

FAR = 3.0
"""Deviations of the prior above which the error of a link is not one that the model was declared to have."""

ALONE = "all joints of the limb were fitted together, by torque regression alone: no simulation of the loop checks it"
"""Reason for the lack of a second estimator."""

SINGLE = ("inertia", *JOINT_PARAMETERS[1:])
"""Names of `JOINT_PARAMETERS` in the equation of a joint alone."""

MODEL = "check signs and zeros of the joints, the direction up (--up) and the load against the model, and run again"
"""Advice where the links are not the model's."""


@dataclass(frozen=True)
class LimbFits:
    """All fits to the log of a limb."""

    limb: LimbRun
    """Run of the limb."""
    rows: LimbRows
    """Equations of the log."""
    stated: PriorFit
    """Fit of the stated values."""
    free: PriorFit
    """Fit that lets the links err more."""
    scale: Estimate | None
    """Scale of the torques by the links' weight [1]; None where they do not tell."""

    def alone(self, joint: JointRows) -> Fit:
        """Return the joint's equation, fitted alone without the corrected torque of the links and the lateness.

        It serves the comparisons of parts and of time; its `inertia` is the armature, and its intervals know neither
        the model's errors nor the other joints.
        """
        columns = [self.rows.names.index(f"{name}.{joint.run.joint}") for name in JOINT_PARAMETERS]
        rest = np.delete(np.arange(len(self.rows.names)), columns)
        left = joint.torque - joint.regressor[:, rest] @ self.stated.values[rest]
        return fit_rows(replace(joint.run.rows, torque=left), Model())

    def corrected_torques(self) -> np.ndarray:
        """Return the torque of the links, with their estimated errors, over the whole log [N m], (T, J)."""
        limb = self.limb
        errors = np.zeros((limb.mechanism.num_joints, len(MODES)))
        for place in np.flatnonzero(self.rows.of_links):
            mode, _, link = self.rows.names[place].partition(".")
            errors[limb.mechanism.joint_names.index(link), MODES.index(mode)] = self.stated.values[place]
        return model_torques(limb.mechanism, limb.position, limb.velocity, limb.acceleration, errors=errors)


def joint_record(fits: LimbFits, joint: JointRows) -> JointRecord:
    """Return one joint's record with its findings and verdict."""
    run, setup, mechanism = joint.run, joint.run.setup, fits.limb.mechanism
    alone = fits.alone(joint)
    comparisons = compare_parts(alone.rows, alone)
    stated = widened(dict(zip(SINGLE, joint.estimates(fits.stated).values())), comparisons)
    # Errors of the links, which a prior bounds, cannot hide a parameter: its interval admits them.
    known = {name: stated[name] if alone.inflation[name] < MAX_INFLATION else None for name in SINGLE}
    # Without a sensor the encoder's noise is in the torque and in the acceleration: the rotor would be their product.
    coulomb, armature = known["coulomb_friction"], known["inertia"] if run.measured else None
    combinations: dict[str, Estimate] = {}
    diagnostics = _diagnostics(fits, joint, alone) | {
        "comparisons": [comparison.to_dict() for comparison in comparisons]
    }
    # Take viscous friction apart from the motor's own brake.
    brakes = braking(run, None)
    if brakes is not None and (viscous := known["viscous_friction"]) is not None:
        strength = Strength(exact(1.0), "measured")
        brakes = brakes.scaled(setup.motor_strength or 1.0)
        known["viscous_friction"], combinations = split_viscous(brakes, viscous, strength)
        if combinations:
            diagnostics["drive"] = brake_summary(brakes, combinations, strength)
    if armature is not None:
        combinations = combinations | {ARMATURE: armature}
    limit, gain = setup.torque_limit or mechanism.torque_limit[joint.number], setup.used_kp
    record = JointRecord(
        viscous_friction=known["viscous_friction"],
        coulomb_friction=coulomb,
        offset=known["offset"],
        friction_ratio=coulomb.scaled(friction_ratio(1.0, limit)) if coulomb is not None and limit else None,
        dead_band=coulomb.scaled(dead_band(1.0, gain)) if coulomb is not None and gain else None,
        combinations=combinations,
        test_condition=setup.test_condition or "in_air",
        torque_source=(setup.torque_source or "motor_side") if run.measured else None,
        kp=setup.kp,
        kd=setup.kd,
        torque_limit=limit,
        walking_kp=setup.walking_kp,
        diagnostics=plain(diagnostics),
    )
    record = replace(record, friction_law=_law(record, alone))
    record = replace(record, findings=tuple(limb_errors(record, fits, joint)))
    verdict = judge(record, legs=is_leg(run.joint), robot=mechanism.name).to_dict()
    record = replace(record, diagnostics=record.diagnostics | plain({"verdict": verdict}))
    findings = (*record.findings, *model_doubts(fits), *find_warnings(record, run), *_limb_warnings(fits.limb, record))
    return replace(record, findings=findings)


def _law(record: JointRecord, alone: Fit) -> dict[str, Any]:
    """Return the law, which is always Coulomb's."""
    known = {name: getattr(record, name) for name in JOINT_PARAMETERS[1:]} | {
        "inertia": record.combinations.get(ARMATURE)
    }
    return {
        "law": "coulomb",
        "parameters": {name: value.to_dict() for name, value in known.items() if value is not None},
        "over_strength": False,
        "drawn": {
            "viscous_friction": alone.by_name["viscous_friction"],
            "symmetric": alone.by_name["coulomb_friction"],
        },
        "middle": 0.0,
        "text": "Viscous and Coulomb friction: the only law that is fitted to a whole limb.",
        "candidates": [],
        "method": METHOD,
        "relative_torque_error": record.diagnostics["relative_torque_error"],
    }


def _diagnostics(fits: LimbFits, joint: JointRows, alone: Fit) -> dict[str, Any]:
    """Return the numbers behind the fit; null for those that only the record of a single joint has."""
    run, mechanism, fit = joint.run, fits.limb.mechanism, fits.stated
    residual = joint.residual(fit)
    carried = [name for n, name in enumerate(mechanism.joint_names) if joint.number in mechanism.chain(n)]
    masses = [name for name in carried if f"{MODES[0]}.{name}" in fit.names]
    return {
        "method": METHOD,
        "robot": mechanism.name,
        "strength": {"source": "measured" if run.measured else "declared", "missing": None},
        "samples": len(run.signals.time),
        "samples_used": len(residual),
        **sampling(run),
        "scaled_condition_number": alone.scaled_condition,
        "inflation": dict(zip(JOINT_PARAMETERS, alone.inflation.values())),
        "relative_torque_error": float(np.linalg.norm(residual) / np.linalg.norm(run.rows.torque)),
        "whiteness": whiteness(residual),
        "blocks": fit.blocks,
        "position_torque": None,
        "predictions": [],
        "inertia_known": True,
        "gravity": None,
        "drift": find_drift(alone.rows, alone),
        "closed_loop": ALONE,
        "output_error": None,
        "lateness": fit.estimate(LATENESS),
        "model_error": next(iter(fit.prior[fits.rows.of_links].tolist()), None),
        "link_mass_errors": {name: fit.estimate(f"{MODES[0]}.{name}") for name in masses},
        "torque_unit": torque_unit(run),
        "torque_by_links": fits.scale,
    }


def limb_errors(record: JointRecord, fits: LimbFits, joint: JointRows) -> Iterator[Finding]:
    """Yield errors that make the fit invalid, the plainest first: signals, scale, rest, a model of another robot."""
    yield from signal_findings(joint.run, record)
    scale = fits.scale
    if scale is not None and not scale.interval95[0] <= 1 <= scale.interval95[1]:
        low, high = scale.interval95
        yield Finding(
            "torque_scale",
            f"the logged torques are {scale.value:.3g} times ({low:.3g} to {high:.3g}) what the links' masses ask for: "
            "the torques' unit or sign, or the model, is not the robot's",
            "check the torques' unit (--torque-scale; --kt, --resistance, --duty-voltage) and the masses; " + MODEL,
        )
    yield from unexplained(record.diagnostics["relative_torque_error"], "links, rotor and friction", "", MODEL)
    stated, free = (fit.estimate(f"coulomb_friction.{joint.run.joint}") for fit in (fits.stated, fits.free))
    gap = abs(stated.value - free.value)
    if gap > max(SERIOUS * abs(stated.value), LARGEST_SIGMAS * float(np.hypot(stated.std, free.std))):
        yield Finding(
            "model",
            f"coulomb_friction is {stated.value:.4g} with the links within the declared error, and {free.value:.4g} "
            "where they may err more: the model is not the robot's",
            f"{MODEL}; or declare a larger --model-error",
        )
    if stated.interval95[1] < 0:
        seen = f"coulomb_friction comes out below zero ({stated.value:.4g}), which no joint has"
        yield Finding(NEGATIVE_FRICTION, seen, f"check --torque-scale; {MODEL}")
    yield from no_friction_shown(record, record.coulomb_friction or stated)


def model_doubts(fits: LimbFits) -> Iterator[Finding]:
    """Yield a warning for the link that differs most from the model, beyond the declared error."""
    free, prior = fits.free, fits.stated.prior
    size = np.where(fits.rows.of_links, free.values / prior, 0.0)
    certain = np.abs(free.values) > FAR * np.sqrt(np.diag(free.covariance))
    worst = int(np.argmax(np.abs(size) * certain))
    if certain[worst] and abs(size[worst]) > FAR:
        mode, _, link = free.names[worst].partition(".")
        yield warning(
            "model",
            f"the model is not the log's within the declared error ({prior[worst]:.3g}): {mode.replace('_', ' ')} of "
            f"the link that {link} moves would be off by {free.values[worst]:+.0%}; are signs and zeros of the joints, "
            "the direction up (--up) and the load the model's, or does friction depend on the angle? Mend the model, "
            "or declare a larger --model-error",
        )


def _limb_warnings(limb: LimbRun, record: JointRecord) -> Iterator[Finding]:
    """Yield warnings for a limb only: joints that were held, and parameters that cannot be told."""
    if limb.held:
        rest = dict(zip(limb.mechanism.joint_names, limb.mechanism.rest))
        angles = ", ".join(f"{name} at {rest[name]:.3g} rad" for name in limb.held)
        yield warning("held", f"not in the log, and taken to be held: {angles}")
    if record.coulomb_friction is None:
        yield warning(
            "coulomb_friction",
            "dry friction cannot be told from the joint's other torques: use two frequencies, both directions",
        )
    if record.torque_source is None:
        yield warning(
            ARMATURE,
            "the rotor's inertia is not told: the torque was made from the position, whose noise is then on both sides "
            "of the equation; log the motor's torque",
        )
    elif ARMATURE not in record.combinations:
        yield warning(ARMATURE, "the rotor's inertia cannot be told from the links': move faster")
    elif record.combinations[ARMATURE].interval95[0] <= 0:
        yield warning(
            ARMATURE, "the interval of the rotor's inertia reaches zero: the log does not show it; move faster"
        )


def joint_signals(fits: LimbFits, torques: np.ndarray, joint: JointRows) -> FitSignals:
    """Return the signals of one joint for the page; torques: those of `corrected_torques`, the same for all joints."""
    prepared, fit = joint.run.prepared, fits.stated
    armature, viscous, coulomb, offset = (fit.value(f"{name}.{joint.run.joint}") for name in JOINT_PARAMETERS)
    late = fit.value(LATENESS) * np.gradient(prepared.torque, prepared.step)
    rigid = torques[:, joint.number] + armature * prepared.acceleration + offset - late - prepared.outside
    fitted = rigid + viscous * prepared.velocity + coulomb * prepared.direction
    return fit_signals(joint.run, fitted, fitted, rigid)


FREED = 10.0
"""Factor on the declared errors of the links with which the log tells them by itself: where it contradicts the
declaration, the tighter fit would take the contradiction for noise."""


@dataclass(frozen=True)
class LimbIdentification:
    """Result for the log of a limb."""

    joints: JointsFile
    """Records of all joints of the log, in the order of the mechanism; a refused one has the reason."""
    signals: dict[str, FitSignals]
    """Signals for `fit.npz`: joint -> signals of the page, for the identified joints."""


def identify_limb(
    log: Log, mechanism: Mechanism, declared: IdentifySetup | None = None, setup: LimbSetup | None = None
) -> LimbIdentification:
    """Identify all joints of a limb whose base is held.

    declared: set-up of the log, as for a single joint; a sidecar states it joint by joint. Raises `StictionError` with
    one line where the log and the mechanism do not go together, or no joint moves.
    """
    declared, setup = declared or IdentifySetup(), setup or LimbSetup()
    setup.check_with(declared)
    mechanism = mechanism if setup.up is None else mechanism.with_up(setup.up)
    limb = limb_run(log, mechanism, declared, setup.joint_map)
    rows = limb_rows(limb, setup)
    try:
        stated = fit_limb(rows)
        free = fit_limb(replace(rows, prior=np.where(rows.of_links, FREED * rows.prior, rows.prior)))
    except np.linalg.LinAlgError as error:
        raise LogError(
            f"{log.source}: excitation too poor: what the joints do cannot be told apart; move each at two frequencies "
            "of its own, in both directions"
        ) from error
    try:
        scale = fit_scale(rows)
    except np.linalg.LinAlgError:
        scale = None
    fits = LimbFits(limb, rows, stated, free, scale)
    torques = fits.corrected_torques()
    records = {joint.run.joint: joint_record(fits, joint) for joint in rows.joints}
    records |= {name: refused(text) for name, text in limb.refused.items()}
    return LimbIdentification(
        JointsFile({name: records[name] for name in mechanism.joint_names if name in records}),
        {joint.run.joint: joint_signals(fits, torques, joint) for joint in rows.joints},
    )
