"""What the loop and gravity tell besides friction: how late the controller is, and where the encoder has its zero."""

from __future__ import annotations

import numpy as np

from stiction.formats.joints import Estimate
from stiction.identify.in_loop import InLoop
from stiction.identify.intervals import bootstrap_reach, with_intervals
from stiction.identify.model import GRAVITY
from stiction.identify.regression import LARGEST_INFLATION, Fit

DELAY_ERROR = 0.1
"""Share of a found delay by which its interval is widened: the loop's model is of second order in it, and loops that
were simulated with delays of 4 to 8 ms came out up to 9 % too long."""

CLEAR = 3.0
"""Standard deviations by which gravity must be there before its phase says anything."""

WIDEST_BIAS = 0.5
"""Half-width of the interval beyond which a bias is not known [rad]."""


def loop_unknowns(base: Fit, loop: InLoop, hanging: float | None) -> dict[str, Estimate | None]:
    """Return `delay` and `encoder_bias`, where they were asked for and the log tells them, else None.

    hanging: true angle at which the link hangs straight down [rad], if it is known: gravity then tells the bias.
    Otherwise the bias is that of the log's angle against the controller's.
    """
    found = {} if loop.symmetric is None else loop.symmetric.estimates
    bias = found.get("log_bias") if hanging is None else hanging_bias(base, hanging)
    delay = found.get("delay")
    if delay is not None:
        more = DELAY_ERROR * abs(delay.value)
        low, high = delay.interval95
        delay = Estimate(delay.value, float(np.hypot(delay.std, more / 2)), (low - more, high + more))
    return {"delay": delay, "encoder_bias": bias}


def hanging_bias(fit: Fit, hanging: float) -> Estimate | None:
    """Return by how much the logged angle is ahead of the true one [rad], from the phase of gravity; None without it.

    G sin(θ − bias − hanging) is gravity_sin sin θ + gravity_cos cos θ. hanging: true angle at which the link hangs
    straight down [rad].
    """
    if "gravity_sin" not in fit.names or max(fit.inflation[name] for name in GRAVITY) >= LARGEST_INFLATION:
        return None
    sine, cosine = (fit.names.index(name) for name in GRAVITY)
    along, across = fit.values[sine], -fit.values[cosine]
    size = float(np.hypot(along, across))
    largest = float(np.linalg.eigvalsh(fit.covariance[np.ix_((sine, cosine), (sine, cosine))])[-1])
    if size**2 < CLEAR**2 * largest:
        return None
    gradient = np.zeros(len(fit.names))
    gradient[sine], gradient[cosine] = -across / size**2, -along / size**2
    phase = (np.arctan2(across, along) - hanging + np.pi) % (2 * np.pi) - np.pi
    variance = gradient @ fit.covariance @ gradient
    reach = bootstrap_reach(fit.blocks)[cosine]
    found = with_intervals(np.array([phase]), np.array([[variance]]), reach)[0]
    return found if found.interval95[1] - found.value < WIDEST_BIAS else None
