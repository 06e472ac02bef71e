"""Judges a robot under growing friction: at how much wear a policy's lifetime ended, and what its monitor noticed.

The lifetime lasts while the policy follows all its commands, a walk each, forward and backward say: from the first
window in which it does to the last one.

A window, of the speed or of the monitor, is known at its end and describes its middle: events are ordered by the time
at which they are known, and reported at the wear in the middle. Wear grows by equal ratios, so the middle is the mean.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import groupby
from math import exp, log
from typing import Any, Literal

import numpy as np

from stiction.core.records import column
from stiction.core.statistics import t_interval, wilson
from stiction.deploy.wear import WearMonitor
from stiction.files.bundle import Bundle
from stiction.files.velocity import Command
from stiction.files.wear import LEVEL
from stiction.robots.model import Robot
from stiction.virtual.cases import Case
from stiction.virtual.hidden import draw
from stiction.virtual.robot import Wear
from stiction.virtual.trial import Trial
from stiction_experiments.lab.straight import pace

End = Literal["alive", "too slow", "too fast", "fell", "too slow from the start", "too fast from the start"]
"""How a lifetime ended: not at all, it follows to the last; too slow or too fast for good; by a fall before that; or
there was none: no window follows, and the first was so."""

NEVER = " from the start"
"""Suffix of the name of an end that no window follows."""

Notice = Literal["before", "after", "at once", "never"]
"""When a monitor noticed: before the lifetime ended, after that, at its first reading, when nothing had worn yet, or
not at all. Where no window follows there is no before."""


def factor_text(factor: float | None) -> str:
    """Return a wear, which is a factor on friction, as people read it."""
    return "–" if factor is None else f"x{factor:.2f}"


def ratio_text(ratio: float) -> str:
    """Return a speed ratio, and what is wrong with it."""
    return f"{ratio:.2f}" if pace(ratio) == "follows" else f"{ratio:.2f}, {pace(ratio)}"


@dataclass(frozen=True)
class Walk:
    """Identity of the walk of a row."""

    policy: str = field(metadata=column("policy"))
    friction_level: str = field(metadata=column("level", "of τ_max"))
    """Level that wear multiplies, as it was typed: `0.1`, `bench+0.02`."""
    robot: int = field(metadata=column("robot"))
    steady: float | None
    """Wear at which the friction stayed, of a control walk, in which nothing grew [1]; None: it grew."""
    command: str = field(default="", kw_only=True, metadata={**column("command"), "later": True})
    """Command: `vx=0.5`; of a robot all commands, after each other. Older files do not have it."""


@dataclass(frozen=True)
class Window(Walk):
    """The speed over one window; a row of windows.csv."""

    time: float
    """End of the window, when it is known, since the robot was put in place [s]."""
    factor: float
    """Wear in the middle of it [1]."""
    ratio: float
    """Mean speed along the command over the commanded speed [-]."""


@dataclass(frozen=True)
class Reading(Walk):
    """The wear monitor's estimate of one target at the end of one of its windows; a row of readings.csv."""

    target: str
    """`level`, the mean over the joints, or the joint that wears."""
    time: float
    """End of the monitor's window [s]."""
    factor: float
    """Wear in the middle of it [1]."""
    true: float
    """Dry friction in motion there, as a bench without load would have found it, over the torque limit [-]."""
    estimate: float | None
    """The monitor's estimate of it [-]; None where its map does not estimate this target."""
    low: float | None
    """Lower end of its 95 % interval [-]."""
    high: float | None
    """Upper end [-]."""
    unusual: bool
    """True if the walk is unlike those that the monitor was fitted on."""


@dataclass(frozen=True)
class Lifetime(Walk):
    """Lifetime of one robot; a row of lives.csv."""

    method: str
    engine: str
    first_ratio: float | None = field(metadata=column("speed ratio, first", "1", form=ratio_text))
    """Speed ratio of the first window [-], of the command that it follows worst; None where the robot fell before."""
    last_ratio: float | None = field(metadata=column("last", "1", form=ratio_text))
    """... and of the last one [-]."""
    begin: float | None = field(metadata=column("follows from wear", "1", form=factor_text))
    """Wear at which it first follows [1]; None where it does in the first window, or never."""
    end: End = field(metadata=column("end"))
    factor: float | None = field(metadata=column("at wear", "1", form=factor_text))
    """Wear at which the lifetime ended [1]; None where it did not, or where there was none."""
    time: float | None
    """When that was known [s]."""
    monitored: bool = field(metadata=column("monitor"))
    unusual_factor: float | None = field(metadata=column("unusual reading at wear", "1", form=factor_text))
    """Wear at the monitor's first unusual reading [1]; None without one."""
    unusual: Notice = field(metadata=column("which is"))
    grown_factor: float | None = field(metadata=column("growth detected at wear", "1", form=factor_text))
    """Wear at the first reading whose interval lies wholly above the first reading's [1]; None without one."""
    grown: Notice = field(metadata=column("which is"))
    held: float | None
    """Share of the readings whose interval held the truth [-]; None where there was no estimate."""


SIGNALS = ("unusual", "grown")
"""Signals of a monitor: fields of `Lifetime`."""


@dataclass(frozen=True)
class Ending:
    """How a lifetime ended, at which wear [1], and when that was known [s]."""

    end: End
    factor: float | None = None
    time: float | None = None


def ending(windows: Sequence[Window], fell: tuple[float, float] | None) -> Ending:
    """Return how a lifetime ended: with the first window from which on none follows, or with a fall before that.

    windows: in order of time; fell: time [s] and wear [1] of a fall.
    """
    paces = [pace(window.ratio) for window in windows]
    if paces and "follows" not in paces:
        return Ending("too slow from the start" if paces[0] == "too slow" else "too fast from the start")
    last = max((index for index, one in enumerate(paces) if one == "follows"), default=-1)
    if last + 1 < len(windows):
        over = windows[last + 1]
        return Ending("too slow" if paces[last + 1] == "too slow" else "too fast", over.factor, over.time)
    return Ending("alive") if fell is None else Ending("fell", fell[1], fell[0])


def first_grown(readings: Sequence[Reading]) -> Reading | None:
    """Return the first reading whose interval lies wholly above that of the first one; None without estimates."""
    known = next((reading.high for reading in readings if reading.high is not None), None)
    if known is None:
        return None
    return next((reading for reading in readings if reading.low is not None and reading.low > known), None)


@dataclass(frozen=True)
class Seen:
    """Observations of one walk."""

    windows: Sequence[Window]
    readings: Sequence[Reading]
    fell: tuple[float, float] | None = None
    """Time [s] and wear [1] of a fall."""

    @property
    def unusual(self) -> Reading | None:
        """The first unusual reading."""
        return next((reading for reading in self.readings if reading.unusual), None)


def first_notice(
    walks: Sequence[Seen], notices: Sequence[Reading | None], ended: Ending
) -> tuple[Reading | None, Notice]:
    """Return the first of the readings in which something was noticed, one of each walk or None, and when it came.

    At the first reading of a walk nothing has worn yet, so that it is no notice of wear.
    """
    seen = min((one for one in notices if one is not None), key=lambda one: one.time, default=None)
    if seen is None:
        return None, "never"
    if any(seen is walk.readings[0] for walk in walks if walk.readings):
        return seen, "at once"
    late = ended.end.endswith(NEVER) or (ended.time is not None and seen.time > ended.time)
    return seen, "after" if late else "before"


def worst_windows(walks: Sequence[Seen]) -> list[Window]:
    """Return of each time that all walks of a robot have the window that is farthest from the command."""
    return [max(same, key=lambda one: abs(one.ratio - 1.0)) for same in zip(*(walk.windows for walk in walks))]


def judge_robot(robot: dict[str, Any], walks: Sequence[Seen], monitored: bool) -> Lifetime:
    """Return the row of one robot.

    robot: the fields of `Lifetime` that name it; walks: one a command; monitored: whether the bundle has a monitor.
    """
    windows = worst_windows(walks)
    ended = ending(windows, min((walk.fell for walk in walks if walk.fell is not None), default=None))
    unusual, unusual_notice = first_notice(walks, [walk.unusual for walk in walks], ended)
    grown, grown_notice = first_notice(walks, [first_grown(walk.readings) for walk in walks], ended)
    holding = [
        one.low <= one.true <= one.high
        for walk in walks
        for one in walk.readings
        if one.low is not None and one.high is not None
    ]
    begin = next((at for at, window in enumerate(windows) if pace(window.ratio) == "follows"), 0)
    return Lifetime(
        **robot,
        first_ratio=windows[0].ratio if windows else None,
        last_ratio=windows[-1].ratio if windows else None,
        begin=windows[begin].factor if begin else None,
        **asdict(ended),
        monitored=monitored,
        unusual_factor=None if unusual is None else unusual.factor,
        unusual=unusual_notice,
        grown_factor=None if grown is None else grown.factor,
        grown=grown_notice,
        held=float(np.mean(holding)) if holding else None,
    )


def judge_again(
    before: Sequence[dict[str, Any]], windows: Sequence[Window], readings: Sequence[Reading]
) -> list[Lifetime]:
    """Return the rows of robots that were judged before, judged by today's criteria.

    before: `lives` of summary.json, also of earlier definitions; windows, readings: of all of them.
    """
    names = ("policy", "friction_level", "robot", "steady")
    seen: dict[tuple[Any, ...], dict[str, tuple[list[Window], list[Reading]]]] = {}
    for at, rows in enumerate((windows, readings)):
        for row in rows:
            of_robot = seen.setdefault(tuple(getattr(row, name) for name in names), {})
            of_robot.setdefault(row.command, ([], []))[at].append(row)  # type: ignore[arg-type]
    lifetimes = []
    for old in before:
        own = seen.get(tuple(old[name] for name in names), {})
        fell = (old["time"], old["factor"]) if old["end"] == "fell" else None
        what = {name: old[name] for name in (*names, "method", "engine", "command")}
        # A walk that fell before its first window has no row. Which of them fell makes no difference.
        walks = [Seen(*own.get(command, ([], [])), fell) for command in old["command"].split()]
        lifetimes.append(judge_robot(what, walks, old["monitored"]))
    return lifetimes


def groups(lifetimes: Sequence[Lifetime]) -> list[dict[str, Any]]:
    """Return, for each policy and level, how its robots ended and the geometric mean of the wear at which they did.

    Only walks in which friction grew; those in which it stayed are under `controls`, see `control`.

    The mean, and its 95 % t-interval over the robots, of the logarithm, is None unless every robot's lifetime ended
    within the wear that was tried: the mean of those that did would be too short. The median is None where the middle
    one did not. The interval is over virtual robots that walk with this policy, and not over other trainings.
    """
    summaries = []
    for (policy, level), same in groupby(lifetimes, key=lambda one: (one.policy, one.friction_level)):
        walks = list(same)
        rows = [row for row in walks if row.steady is None]
        ended = [row.factor for row in rows if row.factor is not None]
        whole = len(ended) == len(rows)
        interval = t_interval([log(factor) for factor in ended]) if whole else None
        held = [row.held for row in rows if row.held is not None]
        summaries.append(
            {
                "policy": policy,
                "friction_level": level,
                "robots": len(rows),
                "ends": dict(Counter(row.end for row in rows)),
                "first": dict(Counter(pace(row.first_ratio) for row in rows if row.first_ratio is not None)),
                "begin": _geometric_mean([row.begin for row in rows if row.begin is not None]),
                "mean": _geometric_mean(ended) if whole else None,
                "interval95": None if interval is None else [exp(end) for end in interval],
                "median": _median(rows),
                "monitored": rows[0].monitored,
                "held": float(np.mean(held)) if held else None,
                **{name: dict(Counter(getattr(row, name) for row in rows)) for name in SIGNALS},
                "controls": [
                    control([row for row in walks if row.steady == steady])
                    for steady in dict.fromkeys(row.steady for row in walks if row.steady is not None)
                ],
            }
        )
    return summaries


def _geometric_mean(factors: Sequence[float]) -> float | None:
    """Return the geometric mean; None of nothing."""
    return exp(float(np.mean(np.log(factors)))) if factors else None


def _median(rows: Sequence[Lifetime]) -> float | None:
    """Return the median wear at the end: those that never follow before all, those that still do after all."""
    order = sorted(rows, key=lambda row: (row.end == "alive", not row.end.endswith(NEVER), row.factor or 0.0))
    middle = order[(len(order) - 1) // 2 : len(order) // 2 + 1]
    factors = [row.factor for row in middle if row.factor is not None]
    return float(np.mean(factors)) if len(factors) == len(middle) else None


def control(rows: Sequence[Lifetime]) -> dict[str, Any]:
    """Return how robots of one policy and level did while their friction stayed the same, and how often it was noticed.

    Whatever a monitor notices there is a false alarm, at once or later. The intervals are Wilson's, over the robots
    that it `read`: of one that fell before its first reading, or that gave it nothing to read, it could not say.
    """
    read = sum(row.held is not None or row.unusual != "never" for row in rows)
    alarms = {name: [getattr(row, name) for row in rows if getattr(row, name) != "never"] for name in SIGNALS}
    return {
        "steady": rows[0].steady,
        "robots": len(rows),
        "ends": dict(Counter(row.end for row in rows)),
        "alarms": {name: len(came) for name, came in alarms.items()},
        "at_once": {name: came.count("at once") for name, came in alarms.items()},
        "read": read,
        "interval95": {name: list(wilson(len(came), read)) if read else None for name, came in alarms.items()},
    }


def over_seeds(
    lifetimes: Sequence[Lifetime], methods: Mapping[str, str], tried: tuple[float, float]
) -> list[dict[str, Any]]:
    """Return when lifetimes end over the seeds of each level and training method that has at least two policies.

    A policy is one sample: the geometric mean of the wear at which its robots' lifetimes ended. `mean` is that of the
    policies, `interval95` its t-interval, of the logarithm. Both are None where a lifetime did not end within the wear
    that was tried. Then `at_least` is the mean with the greatest wear for each that goes on, and `at_most` that with
    the least for each robot that never follows; with both kinds there is neither.

    methods: policy -> training method, as from `methods_of`; tried: least and greatest wear.
    """
    summaries = []
    cells: dict[tuple[str, str], dict[str, list[Lifetime]]] = {}
    for row in lifetimes:
        if row.steady is None:
            policies = cells.setdefault((methods[row.policy], row.friction_level), {})
            policies.setdefault(row.policy, []).append(row)
    for (method, level), policies in cells.items():
        if len(policies) < 2:
            continue
        each = {name: _policy_mean(own, tried) for name, own in policies.items()}
        above, below = (any(one[count] for one in each.values()) for count in ("alive", "never"))
        means = [log(one["mean"]) for one in each.values()]
        middle, interval = exp(float(np.mean(means))), t_interval(means)
        whole = not above and not below
        summaries.append(
            {
                "way": method,
                "friction_level": level,
                "policies": each,
                "mean": middle if whole else None,
                "interval95": [exp(end) for end in interval] if whole and interval is not None else None,
                "at_least": middle if above and not below else None,
                "at_most": middle if below and not above else None,
            }
        )
    return summaries


def _policy_mean(rows: Sequence[Lifetime], tried: tuple[float, float]) -> dict[str, Any]:
    """Return the geometric mean over one policy's robots, and of how many it is a lower and an upper bound."""
    # Who never followed counts with the least wear that was tried, who follows to the end with the greatest.
    ends = [row.factor if row.factor is not None else tried[row.end == "alive"] for row in rows]
    return {
        "mean": exp(float(np.mean([log(end) for end in ends]))),
        "alive": sum(row.end == "alive" for row in rows),
        "never": sum(row.end.endswith(NEVER) for row in rows),
    }


def speeds(
    trial: Trial, command: Command, wear: Wear, settle: float, window: float, every: float
) -> list[dict[str, Any]]:
    """Return `time`, `factor` and `ratio` of every window of a walk; settle, window, every: as of `ratios`."""
    recording, direction = trial.recording, np.asarray(command.direction)
    along = (recording.velocity[:, 0] @ direction) * recording.upright[:, 0] / command.speed
    return [
        {"time": time, "factor": wear.factor(time - window / 2), "ratio": ratio}
        for time, ratio in ratios(along, recording.period, settle, window, every)
    ]


def ratios(speed: np.ndarray, period: float, settle: float, window: float, every: float) -> list[tuple[float, float]]:
    """Return the end [s] and the mean of every window that fits, the first beginning at `settle`.

    speed: over the commanded one, one entry a control step [-]; period: of control [s]; window: its length [s]; every:
    time from one window to the next [s].
    """
    begin, width, stride = (round(time / period) for time in (settle, window, every))
    total = np.concatenate([[0.0], np.cumsum(speed)])
    ends = range(begin + width, len(speed) + 1, stride)
    return [(end * period, float(total[end] - total[end - width]) / width) for end in ends]


def monitor_readings(
    trial: Trial, bundle: Bundle, spec: Robot, case: Case, wear: Wear, settle: float
) -> list[dict[str, Any]]:
    """Return the readings of the bundle's monitor after `settle` [s], from the policy's input; none without a monitor.

    The target is the joint that wears, or the level where several do. Nothing but this study sees the truth.
    """
    if bundle.wear is None:
        return []
    period, worn = bundle.contract.control_period, wear.worn(spec.joint_names)
    share = case.robot(draw(spec, case.seed)).friction.share
    own = case.level.coulomb(spec) * share / spec.joint_values("torque_limit")
    joint = int(np.argmax(worn)) if worn.sum() == 1 else None
    monitor, first, readings = WearMonitor(bundle.contract, bundle.wear), round(settle / period), []
    for steps, step in enumerate(trial.steps[first:], first + 1):
        estimate = monitor.step(step.policy.observation)
        if estimate is None:
            continue
        time = steps * period
        # An estimate is a mean over its window, and so of the wear at its middle.
        factor = wear.factor(time - bundle.wear.window * period / 2)
        friction = own * np.where(worn, factor, 1.0)
        if joint is None:
            target, true, values = LEVEL, friction.mean(), (estimate.level, *estimate.level_interval95)
        else:
            target, true = spec.joint_names[joint], friction[joint]
            values = (float(estimate.friction[joint]), *estimate.interval95[:, joint].tolist())
        known = {
            name: value if np.isfinite(value) else None
            for name, value in zip(("estimate", "low", "high"), values, strict=True)
        }
        readings.append(
            {"target": target, "time": time, "factor": factor, "true": float(true)}
            | known
            | {"unusual": estimate.unusual}
        )
    return readings
