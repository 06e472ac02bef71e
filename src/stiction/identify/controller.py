"""Does the torque in the log agree with the gains that were declared? Output error rests on that."""

from __future__ import annotations

import numpy as np

from stiction.identify.checks import Uniform
from stiction.identify.gaps import near
from stiction.identify.prepare import low_pass
from stiction.joints.pd import PDGains, pd_torque

LARGEST_MISMATCH = 0.15
"""Relative size of logged torque − PD torque beyond which gains, torque unit or timing must be wrong."""


def controller_mismatch(
    signals: Uniform, gains: PDGains, velocity: np.ndarray, cutoff: float, biased: bool = False
) -> float:
    """Return |τ_logged − PD(target, position, velocity)| / |τ_logged|, both below `cutoff` [Hz].

    signals: with target and torque; velocity: filtered θ' as the controller has it, late if it is [rad/s], shape
    (num_samples,); biased: the log's angle may be ahead of the controller's, so a constant difference is not held
    against it. Samples in a long gap, or within a period of the filter of one, do not count, if there are any others.
    """
    target = low_pass(np.asarray(signals.target), cutoff, signals.step)
    position = low_pass(signals.position, cutoff, signals.step)
    measured = low_pass(np.asarray(signals.torque), cutoff, signals.step)
    expected = pd_torque(gains, target, position, velocity)
    clear = ~near(signals.bridged, round(1 / (cutoff * signals.step)))
    if not clear.any():
        clear = ~signals.bridged
    difference = (expected - measured)[clear]
    return float(np.linalg.norm(difference - difference.mean() * biased) / np.linalg.norm(measured[clear]))
