"""What makes the fit of a limb's joint invalid: its signals, what is not explained, a model that is not the robot's."""

from __future__ import annotations

import numpy as np

from stiction.files.joints import Estimate, JointRecord, Objection
from stiction.identification.consistency import LARGEST_SIGMAS
from stiction.identification.limb.regression import JointRows, LimbFit
from stiction.identification.objections import (
    LARGEST_REST,
    NEGATIVE_FRICTION,
    SERIOUS,
    no_friction_shown,
    signal_objections,
)

MODEL = "check signs and zeros of the joints, the direction up (--up) and the load against the model, and run again"
"""What to do where the links are not the model's."""


def limb_objections(
    record: JointRecord, fit: LimbFit, free: LimbFit, scale: Estimate | None, rows: JointRows
) -> tuple[Objection, ...]:
    """Return what makes the fit invalid, the plainest first.

    free: a fit that may let the links err more; scale: of the limb's torques by its links, None where they do not tell.
    """
    found = list(signal_objections(rows.joint.run, record))
    if scale is not None and not scale.interval95[0] <= 1 <= scale.interval95[1]:
        low, high = scale.interval95
        seen = (
            f"the logged torques are {scale.value:.3g} times ({low:.3g} to {high:.3g}) what the links' masses ask for: "
            "the torques' unit or sign, or the model, is not the robot's"
        )
        unit = "check the torques' unit (--torque-scale; --kt, --resistance, --duty-voltage) and the masses"
        found.append(Objection("torque_scale", seen, f"{unit}; {MODEL}"))
    rest = record.diagnostics["relative_torque_error"]
    if rest > LARGEST_REST:
        seen = (
            f"{rest:.0%} of the torque is not explained by links, rotor and friction, at most {LARGEST_REST:.0%} may be"
        )
        found.append(Objection("unexplained_torque", seen, MODEL))
    name = f"coulomb_friction.{rows.joint.run.joint}"
    stated, other = fit.estimate(name), free.estimate(name)
    gap = abs(stated.value - other.value)
    if gap > max(SERIOUS * abs(stated.value), LARGEST_SIGMAS * float(np.hypot(stated.std, other.std))):
        seen = (
            f"coulomb_friction is {stated.value:.4g} with the links within the declared error, and {other.value:.4g} "
            "where they may err more: the model is not the robot's"
        )
        found.append(Objection("model", seen, f"{MODEL}; or declare a larger --model-error"))
    if stated.interval95[1] < 0:
        seen = f"coulomb_friction comes out below zero ({stated.value:.4g}), which no joint has"
        found.append(Objection(NEGATIVE_FRICTION, seen, f"check --torque-scale; {MODEL}"))
    return (*found, *no_friction_shown(record, record.coulomb_friction or stated))
