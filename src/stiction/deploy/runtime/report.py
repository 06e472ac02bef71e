"""Report of a run: rate, lateness, time by section, limited targets, and the reason of its end. One JSON file."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stiction.deploy.control import LIMITED_BY
from stiction.deploy.runtime.channel import TIMES
from stiction.deploy.runtime.supervisor import Stop, Supervisor
from stiction.deploy.runtime.ticker import BUSY, LATE, QUIET, Histogram


@dataclass
class Timing:
    """Counts of a running run; their size does not grow."""

    probe: Histogram = field(default_factory=Histogram)
    """Lateness of an idle loop, before the run."""
    policy: dict[str, Histogram] = field(default_factory=lambda: {name: Histogram() for name in TIMES})
    reading: Histogram = field(default_factory=Histogram)
    """Time from having read a state to having sent the command, in the supervisor."""
    periods: int = 0
    skipped: int = 0
    first: float = 0.0
    last: float = 0.0
    """Times at which the first and the last step were answered [s]."""

    def answer(self, now: float, times: dict[str, float], skipped: int) -> None:
        """Count one step of the policy."""
        self.first = self.first if self.periods else now
        self.last = now
        self.periods += 1
        self.skipped += skipped
        for name, histogram in self.policy.items():
            histogram.add(times[name])

    @property
    def rate(self) -> float | None:
        """Steps per second [Hz], skipped ones not counted; None of less than two."""
        return (self.periods - 1) / (self.last - self.first) if self.last > self.first else None


def summary(supervisor: Supervisor, timing: Timing, more: dict[str, Any]) -> dict[str, Any]:
    """Return the report as plain data; more: fields of the runtime."""
    lateness, probe = timing.policy["lateness"].milliseconds(), timing.probe.milliseconds()
    judged = probe["p99"] <= QUIET and timing.periods > 0
    motion = supervisor.motion()
    sections = {name: timing.policy[name].milliseconds() for name in TIMES if name != "lateness"}
    return {
        "periods": timing.periods,
        "skipped": timing.skipped,
        "rate_hz": None if timing.rate is None else round(timing.rate, 4),
        "lateness_ms": lateness,
        "lateness_judged": ("well" if lateness["p99"] <= LATE else "late") if judged else "not judged",
        "probe_ms": probe,
        "sections_ms": sections,
        "supervisor_ms": timing.reading.milliseconds(),
        "limited": limited(supervisor),
        "hunting": hunting_joints(supervisor),
        "motion": motion,
        "end": end_line(supervisor.stop_record, timing, motion),
        "stop": None if supervisor.stop_record is None else supervisor.stop_record.summary(),
        **more,
    }


def hunting_joints(supervisor: Supervisor) -> list[str]:
    """Return the joints to which no friction is fed forward any more, because they hunted."""
    return [name for name, hunts in zip(supervisor.contract.joint_names, supervisor.hunts, strict=True) if hunts]


def limited(supervisor: Supervisor) -> dict[str, dict[str, float]]:
    """Return the share of readings in which a joint's target was limited, by rule, without joints that never were."""
    counts = supervisor.limited_counts
    total = np.maximum(counts.sum(1), 1)
    shares_by_joint = {}
    for joint, row, all_ in zip(supervisor.contract.joint_names, counts, total, strict=True):
        shares = {rule: round(float(n / all_), 5) for rule, n in zip(LIMITED_BY, row, strict=True) if rule and n}
        if shares:
            shares_by_joint[joint] = shares
    return shares_by_joint


def end_line(stop: Stop | None, timing: Timing, motion: dict[str, float] | None) -> str:
    """Return the end of a run, in one line; motion: as of `Supervisor.motion`."""
    if stop is not None:
        hint = "; was this machine busy? end other programs, or add --realtime 50"
        return f"stopped: {stop.sentence()}{hint if stop.violation.rule in BUSY else ''}"
    if motion is not None:
        seconds, played = motion["seconds"], motion["played"]
        whole = f"a motion of {seconds:g} s"
        return f"done: {whole}" if played >= seconds else f"done: the first {played:g} s of {whole}, cut by --duration"
    rate = "" if timing.rate is None else f" at {timing.rate:.3f} Hz"
    return f"done: {timing.periods} steps{rate}, {timing.skipped} skipped"
