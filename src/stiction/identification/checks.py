"""Checks of a log before anything is estimated from it; every refusal is one line that names the row or column."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from stiction.core.errors import LogError
from stiction.files.log import JointSignals, Log
from stiction.identification.readings import take_readings
from stiction.identification.setup import LARGEST_VALUE
from stiction.identification.timing import FEWEST_PER_CYCLE, Grid, Timing, even_grid, resample

FEWEST_SAMPLES = 200
"""Fewest samples of a log: with fewer no interval can be trusted."""

FEWEST_POOLED = 60
"""Fewest samples of one of several runs: with fewer nothing is left of it between the filter's ends."""

LARGEST_TIME = 1e20
"""Largest stamp: stamps may count from 1970 in any unit; one that is not in seconds gets a message of its own."""

SMALLEST_RANGE = 1e-12
"""Smallest range of a signal in motion, in SI units."""

LARGEST_JUMP = {"torque": 50.0, "position": 20.0}
"""Largest step from sample to sample, over the 99th percentile of all steps: more is a damaged sample, not physics.

For a position, a step that differs so from its neighbours: noise of an encoder and stops make at most some 3."""

FEWEST_VALUES = 10
"""Fewest different values of a measured signal: with fewer it is constant but for its last digit."""

LARGEST_REACH = 20.0
"""Largest range of a leg's joint [rad]: none turns three times round; in degrees every gait passes this."""

FEWEST_REVERSALS = 4
"""Fewest changes of the velocity's sign: friction and offset differ only in their effect when the joint turns."""


class PoorMotion(LogError):
    """Error for motion that does not excite a joint enough to identify it.

    `seen` states the deficiency, `remedy` the advice where no cause is known.
    """

    def __init__(self, where: str, seen: str, remedy: str) -> None:
        """Set the message; where: the log and its joint."""
        self.where, self.seen = where, seen
        super().__init__(f"{where}: excitation too poor: {seen}; {remedy}")

    def because(self, cause: str) -> LogError:
        """Return the error with a known cause in place of the usual one."""
        return LogError(f"{self.where}: {self.seen}: {cause}")


SMALL_MOTION = 0.1
"""Range of another joint over that of the identified one above which it counts as moving too [1]."""


def other_moving_joints(log: Log, joint: str) -> tuple[str, ...]:
    """Return the other joints of a log that move while this one does."""
    ranges = {
        name: float(np.ptp(signals.position[np.isfinite(signals.position)]))
        for name, signals in log.joints.items()
        if signals.position is not None and np.isfinite(signals.position).any()
    }
    reference = ranges.get(joint, 0.0)
    return tuple(name for name, reach in ranges.items() if name != joint and reach > SMALL_MOTION * reference > 0)


def coupled_text(moving: Sequence[str]) -> str:
    """Describe the effect of other joints in motion on a joint that is taken to move alone; at least one."""
    named = ", ".join(moving[:MOST_NAMED]) + (
        f" and {len(moving) - MOST_NAMED} more" if len(moving) > MOST_NAMED else ""
    )
    return (
        f"other joints move in this log ({named}): what they do, and the ground where a foot is on it, acts on this "
        "joint, "
        "which is taken to move alone; log it with the others held, in the air"
    )


MOST_NAMED = 4
"""Largest number of joints named in a message."""


@dataclass(frozen=True)
class Uniform:
    """Signals of one joint on an even grid, torque in N m; arrays of shape (num_samples,)."""

    time: np.ndarray
    """From zero [s]."""
    step: float
    """Time between samples [s]."""
    position: np.ndarray
    """θ [rad]."""
    torque: np.ndarray | None
    """τ [N m], or None if it was not logged."""
    target: np.ndarray | None
    """a [rad], or None if it was not logged."""
    velocity: np.ndarray | None
    """θ' as logged [rad/s], or None."""
    disturbance: np.ndarray | None = None
    """d, a known torque from outside [N m], or None."""
    feedforward: np.ndarray | None = None
    """u, torque that the controller adds to that of its gains [N m], or None; the target carries it (`runs`)."""
    valid: np.ndarray = field(default_factory=lambda: np.ones(0, dtype=bool))
    """False where too many samples are missing to interpolate the signals; by default True everywhere."""
    bridged: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """True in a long gap, where no signal is known, the target neither; by default nowhere."""
    timing: Timing | None = None
    """Quality of the stamps, or None if it was not examined."""

    def __post_init__(self) -> None:
        """Take every sample as valid, and none as bridged, by default."""
        for name, value in (("valid", True), ("bridged", False)):
            if len(getattr(self, name)) == 0:
                object.__setattr__(self, name, np.full(len(self.time), value))


def check_log(
    log: Log, joint: str, signals: JointSignals, torque_scale: float = 1.0, fewest: int = FEWEST_SAMPLES
) -> Uniform:
    """Check one joint's signals and put them on an even grid.

    torque_scale: N m per unit of the torque column; fewest: samples that are needed. The position
    must be there, and the torque or the target. Raises `LogError`.
    """
    _check_presence(log, joint, signals)
    table = {"time": log.time} | {name: values for name, values in vars(signals).items() if values is not None}
    for name, values in table.items():
        limit = LARGEST_TIME if name == "time" else LARGEST_VALUE
        # Not `>`, which is false for NaN.
        bad = np.flatnonzero(~(np.abs(values) <= limit))
        if len(bad):
            raise LogError(
                f"{log.source}: {name} of joint {joint!r} has {len(bad)} values that are not finite or beyond "
                f"{limit:.0e}, the first in sample {bad[0] + 1}; cut those rows out or log again"
            )
    time, table, held = take_readings(log.time, {name: values for name, values in table.items() if name != "time"})
    if len(time) < fewest:
        raise LogError(
            f"{log.source}: {len(time)} samples over {np.ptp(time):.3g} s; at least {fewest} are needed: log for "
            f"{np.ptp(time) * FEWEST_SAMPLES / max(1, len(time) - 1):.2g} s or more at this rate"
            + (f", or give several runs of {FEWEST_POOLED} or more at once" if fewest > FEWEST_POOLED else "")
        )
    grid, timing = even_grid(log.source, time, table["position"])
    for name in ("position", "torque" if signals.torque is not None else "target"):
        _check_signal(f"{log.source}: {name} of joint {joint!r}", name, table[name], grid)
    even = {
        name: resample(grid, values, command=name in ("target", "disturbance", "feedforward"))
        for name, values in table.items()
    }
    return Uniform(
        time=grid.times,
        step=grid.step,
        position=even["position"],
        torque=torque_scale * even["torque"] if "torque" in even else None,
        target=even.get("target"),
        velocity=even.get("velocity"),
        disturbance=even.get("disturbance"),
        feedforward=even.get("feedforward"),
        valid=grid.valid,
        bridged=~grid.valid,
        timing=replace(timing, notes=(*held, *timing.notes)),
    )


def _check_presence(log: Log, joint: str, signals: JointSignals) -> None:
    """Reject a joint without position, and one without torque whose torque cannot be computed from the target."""
    if signals.position is None:
        raise LogError(
            f"{log.source}: joint {joint!r} has no position; log position.{joint} or map a column to it: position=NAME"
        )
    if signals.torque is None and signals.target is None:
        raise LogError(
            f"{log.source}: joint {joint!r} has no torque and no target; log torque.{joint}, or target.{joint} from "
            "which the controller's gains give the torque, or map a column: torque=NAME"
        )


def _check_signal(where: str, name: str, values: np.ndarray, grid: Grid) -> None:
    """Reject a signal that hardly varies, and one with samples that are out of line with their neighbours.

    A position does not jump; torque may jump and stay, but not there and back at once. A target may do what it likes.
    """
    if np.ptp(values) < SMALLEST_RANGE or (name != "target" and len(np.unique(values)) < FEWEST_VALUES):
        missing = "the driver seems not to report it: leave the column out and give --kp and --kd, or log the current"
        still = "the joint must move: log a sine of the target at two frequencies"
        raise LogError(f"{where} is (nearly) constant at {values[0]:.6g}; {missing if name == 'torque' else still}")
    if name == "target":
        return
    near = np.diff(grid.stamps) < 1.5 * grid.step
    changes = np.where(near, np.diff(values[grid.order]), 0.0)
    sizes = np.abs(changes)
    if name == "torque":
        odd = np.append(np.where(changes[1:] * changes[:-1] < 0, sizes[1:], 0.0), 0.0)
    else:
        # However fast a joint gets, it takes several samples to be so.
        turned = np.pad(np.abs(np.diff(changes)), 1)
        odd = np.maximum(turned[1:], turned[:-1])
    usual = float(np.percentile(sizes, 99))
    sizes = np.minimum(sizes, odd)
    worst, limit = int(np.argmax(sizes)), LARGEST_JUMP[name]
    if usual > 0 and sizes[worst] > limit * usual:
        before, after = grid.order[worst], grid.order[worst + 1]
        raise LogError(
            f"{where} jumps from {values[before]:.6g} to {values[after]:.6g} at sample {after + 1}, over "
            f"{limit:.0f} times its usual step; cut damaged samples out or log again"
        )


def check_excitation(source: str, velocity: np.ndarray, step: float) -> None:
    """Reject motion from which friction cannot be told from offset, or that is sampled too slowly.

    velocity: filtered θ' [rad/s]; step [s].
    """
    spectrum = np.abs(np.fft.rfft(velocity - velocity.mean())) ** 2
    share = np.cumsum(spectrum) / spectrum.sum()
    fastest = float(np.fft.rfftfreq(len(velocity), step)[np.searchsorted(share, 0.95)])
    if fastest * FEWEST_PER_CYCLE > 1 / step:
        raise LogError(
            f"{source}: sampled at {1 / step:.4g} Hz, but the motion reaches {fastest:.3g} Hz; expected at least "
            f"{FEWEST_PER_CYCLE} samples a period: log faster or move more slowly"
        )
    # Noise about a velocity of zero would count as turning round.
    moving = velocity[np.abs(velocity) > 0.05 * np.abs(velocity).max()]
    reversals = int(np.count_nonzero(np.diff(np.sign(moving))))
    if reversals < FEWEST_REVERSALS:
        raise PoorMotion(
            source,
            f"the joint turns round {reversals} times, expected at least {FEWEST_REVERSALS}",
            "log several periods of a sine of the target",
        )
