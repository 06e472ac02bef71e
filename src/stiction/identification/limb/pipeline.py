"""A log of a whole limb, start to end: signals, one regression for all joints, a record for each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.core.errors import LogError
from stiction.files.joints import Estimate, FitSignals, JointRecord, JointsFile
from stiction.files.log import Log
from stiction.identification.limb.record import found_torques, joint_record, joint_signals
from stiction.identification.limb.regression import JointRows, LimbFit, fit_limb, fit_scale, limb_rows
from stiction.identification.limb.setup import LimbSetup, check_declared
from stiction.identification.limb.signals import limb_run
from stiction.identification.pipeline import REFUSED
from stiction.identification.setup import IdentifySetup
from stiction.robots.mechanism import Mechanism

FREED = 10.0
"""Factor on the declared errors of the links under which the log says by itself what they are: where it contradicts the
declaration, the tighter fit would take the contradiction for noise."""


@dataclass(frozen=True)
class LimbIdentification:
    """What was found in the log of a limb."""

    joints: JointsFile
    """A record for every joint of the log, in the order of the mechanism; of one that was refused, why."""
    signals: dict[str, FitSignals]
    """For `fit.npz`: joint -> what the page draws, of the joints that were identified."""
    fit: LimbFit
    """The regression."""


def identify_limb(
    log: Log, mechanism: Mechanism, declared: IdentifySetup | None = None, setup: LimbSetup | None = None
) -> LimbIdentification:
    """Identify all joints of a limb whose base is held.

    declared: how the log was made, as for a single joint; a sidecar says it joint by joint. Raises `StictionError` with
    one line where the log and the mechanism do not go together, or no joint moves.
    """
    declared, setup = declared or IdentifySetup(), setup or LimbSetup()
    setup.check()
    check_declared(declared)
    mechanism = mechanism if setup.up is None else mechanism.with_up(setup.up)
    limb = limb_run(log, mechanism, declared, setup.joint_map)
    names, prior, rows = limb_rows(limb, setup)
    try:
        fit = fit_limb(names, prior, rows)
        free = fit_limb(names, np.where(fit.of_links, FREED * prior, prior), rows)
    except np.linalg.LinAlgError as error:
        raise LogError(
            f"{log.source}: excitation too poor: what the joints do cannot be told apart; move each at two frequencies "
            "of its own, in both directions"
        ) from error
    scale = _scale(names, prior, rows)
    torques = found_torques(limb, fit)
    records = {one.joint.run.joint: joint_record(limb, fit, free, scale, one) for one in rows}
    refused = {name: JointRecord(warnings=(REFUSED + text,)) for name, text in limb.refused.items()}
    everyone = records | refused
    return LimbIdentification(
        JointsFile({name: everyone[name] for name in mechanism.joint_names if name in everyone}),
        {one.joint.run.joint: joint_signals(limb, fit, torques, one) for one in rows},
        fit,
    )


def _scale(names: tuple[str, ...], prior: np.ndarray, rows: tuple[JointRows, ...]) -> Estimate | None:
    """Return the scale of the torques by the links' weight; None where no joint bears any, as with upright axes."""
    try:
        return fit_scale(names, prior, rows)
    except np.linalg.LinAlgError:
        return None
