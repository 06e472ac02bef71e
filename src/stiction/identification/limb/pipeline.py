"""A log of a whole limb, start to end: signals, one regression for all joints, a record for each."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stiction.core.errors import LogError
from stiction.files.joints import FitSignals, JointRecord, JointsFile
from stiction.files.log import Log
from stiction.identification.limb.record import LimbFits, joint_record, joint_signals
from stiction.identification.limb.regression import fit_limb, fit_scale, limb_rows
from stiction.identification.limb.setup import LimbSetup
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


def identify_limb(
    log: Log, mechanism: Mechanism, declared: IdentifySetup | None = None, setup: LimbSetup | None = None
) -> LimbIdentification:
    """Identify all joints of a limb whose base is held.

    declared: how the log was made, as for a single joint; a sidecar says it joint by joint. Raises `StictionError` with
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
    records |= {name: JointRecord(warnings=(REFUSED + text,)) for name, text in limb.refused.items()}
    return LimbIdentification(
        JointsFile({name: records[name] for name in mechanism.joint_names if name in records}),
        {joint.run.joint: joint_signals(fits, torques, joint) for joint in rows.joints},
    )
