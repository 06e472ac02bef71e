"""Judges a walk under growing friction: at how much wear a policy's life ended, and whether its monitor saw it coming.

A policy lives while it follows its command: from the first window that does to the last one. Too fast at first it has
not begun to, too slow in the end it has ended, and the two are told apart.

A window, of the speed or of the monitor, is known at its end and speaks of its middle: events are put in order by when
they are known, and reported at the wear in the middle. The wear grows by equal ratios, so the middle is the mean.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from math import exp, log
from typing import Any, Literal

import numpy as np

from stiction.core.statistics import t_interval, wilson
from stiction.deploy.wear import WearEstimate, WearMonitor
from stiction.evaluate.command import Command
from stiction.formats.bundle import Bundle
from stiction.formats.following import pace
from stiction.formats.wear import LEVEL
from stiction.robots.model import Robot
from stiction.virtual.cases import Case
from stiction.virtual.hidden import draw
from stiction.virtual.robot import Wear
from stiction.virtual.trial import Trial

End = Literal["alive", "too slow", "too fast", "fell", "too slow from the start", "too fast from the start"]
"""How a life ended: not at all, it follows to the last; too slow or too fast for good; by a fall, before that; or it
never was one: no window follows, and so was the first."""

NEVER = " from the start"
"""What ends the name of an end without a life before it."""

Notice = Literal["before", "after", "at once", "never"]
"""When a monitor noticed: before the life ended, after that, at its first reading, before any wear, or not at all. A
life that never was one has no before."""


@dataclass(frozen=True)
class Walk:
    """Which walk a row is about."""

    policy: str
    """Name of the bundle."""
    friction_level: str
    """Level that wear multiplies, as it was typed: `0.1`, `bench+0.02`."""
    robot: int
    """Seed of the virtual robot."""
    steady: float | None
    """Wear at which the friction stayed, of a control walk, in which nothing grew [1]; None: it grew."""


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
    """What the wear monitor said of one target at the end of one of its windows; a row of readings.csv."""

    target: str
    """`level`, the mean over the joints, or the joint that wears."""
    time: float
    """End of the monitor's window [s]."""
    factor: float
    """Wear in the middle of it [1]."""
    true: float
    """Dry friction in motion there, as a bench without load would have found it, over the torque limit [-]."""
    estimate: float | None
    """What the monitor took it for [-]; None where its map does not tell this target."""
    low: float | None
    """Lower end of its 95 % interval [-]."""
    high: float | None
    """Upper end [-]."""
    unusual: bool
    """Whether it said that the walk is unlike those that it knows."""


@dataclass(frozen=True)
class Life(Walk):
    """What became of one robot; a row of lives.csv."""

    method: str
    """How the policy was trained."""
    engine: str
    """Physics engine."""
    command: str
    """What was commanded: `vx=0.5`."""
    first_ratio: float | None
    """Speed ratio of the first window [-]; None where the robot fell before its end."""
    last_ratio: float | None
    """... and of the last one [-]."""
    begin: float | None
    """Wear at which it first follows [1]; None where it does in the first window, or never."""
    end: End
    """How it ended."""
    factor: float | None
    """Wear at which the life ended [1]; None where it did not, or never was one."""
    time: float | None
    """When that was known [s]."""
    monitored: bool
    """Whether the bundle has a wear monitor."""
    unusual_factor: float | None
    """Wear at the monitor's first unusual reading [1]; None without one."""
    unusual: Notice
    """When that came."""
    grown_factor: float | None
    """Wear at the first reading whose interval lies wholly above the first reading's [1]; None without one."""
    grown: Notice
    """When that came."""
    held: float | None
    """Share of the readings whose interval held the truth [-]; None where none was told."""


SIGNALS = ("unusual", "grown")
"""What a monitor can notice: fields of `Life`."""


@dataclass(frozen=True)
class Ending:
    """How a life ended, at which wear [1], and when that was known [s]."""

    end: End
    factor: float | None = None
    time: float | None = None


def ending(windows: Sequence[Window], fell: tuple[float, float] | None) -> Ending:
    """Return how a life ended.

    It ends with the first window from which on none follows, or with a fall before that. windows: in order of time;
    fell: time [s] and wear [1] of a fall.
    """
    paces = [pace(window.ratio) for window in windows]
    if paces and "follows" not in paces:
        return Ending("too slow from the start" if paces[0] == "too slow" else "too fast from the start")
    last = max((index for index, one in enumerate(paces) if one == "follows"), default=-1)
    if last + 1 < len(windows):
        over = windows[last + 1]
        return Ending("too slow" if paces[last + 1] == "too slow" else "too fast", over.factor, over.time)
    if fell is not None:
        return Ending("fell", fell[1], fell[0])
    return Ending("alive")


def first_unusual(readings: Sequence[Reading]) -> Reading | None:
    """Return the first reading that the monitor itself called unusual."""
    return next((reading for reading in readings if reading.unusual), None)


def first_grown(readings: Sequence[Reading]) -> Reading | None:
    """Return the first reading whose interval lies wholly above that of the first one; None where none is told."""
    known = next((reading.high for reading in readings if reading.high is not None), None)
    if known is None:
        return None
    return next((reading for reading in readings if reading.low is not None and reading.low > known), None)


def notice(seen: Reading | None, readings: Sequence[Reading], ended: Ending) -> Notice:
    """Say when a reading came: one at once is no notice of wear, for there was none yet.

    What comes later comes too late where there was no life.
    """
    if seen is None:
        return "never"
    if seen is readings[0]:
        return "at once"
    late = ended.end.endswith(NEVER) or (ended.time is not None and seen.time > ended.time)
    return "after" if late else "before"


def life(
    walk: dict[str, Any],
    windows: Sequence[Window],
    readings: Sequence[Reading],
    fell: tuple[float, float] | None,
    monitored: bool,
) -> Life:
    """Return the row of one walk.

    walk: the fields of `Life` that say which it is; windows, readings: in order of time; fell: see `ending`; monitored:
    whether the bundle has a monitor.
    """
    ended = ending(windows, fell)
    unusual, grown = first_unusual(readings), first_grown(readings)
    holding = [one.low <= one.true <= one.high for one in readings if one.low is not None and one.high is not None]
    return Life(
        **walk,
        first_ratio=windows[0].ratio if windows else None,
        last_ratio=windows[-1].ratio if windows else None,
        begin=_begin(windows),
        **asdict(ended),
        monitored=monitored,
        unusual_factor=None if unusual is None else unusual.factor,
        unusual=notice(unusual, readings, ended),
        grown_factor=None if grown is None else grown.factor,
        grown=notice(grown, readings, ended),
        held=float(np.mean(holding)) if holding else None,
    )


def _begin(windows: Sequence[Window]) -> float | None:
    """Return the wear of the first window that follows, where others came before it."""
    first = next((at for at, window in enumerate(windows) if pace(window.ratio) == "follows"), 0)
    return windows[first].factor if first else None


def judge_again(lives: Sequence[dict[str, Any]], windows: Sequence[Window], readings: Sequence[Reading]) -> list[Life]:
    """Return the rows of walks that were judged before, by what was seen of them.

    lives: as in summary.json, also of earlier definitions; windows, readings: of all of them.
    """
    names = ("policy", "friction_level", "robot", "steady")
    what = (*names, "method", "engine", "command")
    seen: dict[tuple[Any, ...], tuple[list[Window], list[Reading]]] = {}
    for at, rows in enumerate((windows, readings)):
        for row in rows:
            seen.setdefault(tuple(getattr(row, name) for name in names), ([], []))[at].append(row)  # type: ignore[arg-type]
    found = []
    for before in lives:
        own = seen.get(tuple(before[name] for name in names), ([], []))
        fell = (before["time"], before["factor"]) if before["end"] == "fell" else None
        found.append(life({name: before[name] for name in what}, *own, fell, before["monitored"]))
    return found


def groups(lives: Sequence[Life]) -> list[dict[str, Any]]:
    """Return, for each policy and level, how its robots ended and the geometric mean of the wear at which they did.

    Only walks in which friction grew; those in which it stayed stand beside them, see `control`.

    The mean, and its 95 % t-interval over the robots, of the logarithm, is None unless every robot's life ended within
    the wear that was tried: the mean of those that did would be too short. The median is None where the middle one did
    not. The interval speaks of virtual robots that walk with this policy, and not of other trainings.
    """
    found = []
    for (policy, level), same in groupby(lives, key=lambda one: (one.policy, one.friction_level)):
        walks = list(same)
        rows = [row for row in walks if row.steady is None]
        ended = [row.factor for row in rows if row.factor is not None]
        whole = len(ended) == len(rows)
        interval = t_interval([log(factor) for factor in ended]) if whole else None
        found.append(
            {
                "policy": policy,
                "friction_level": level,
                "robots": len(rows),
                "ends": _ends(rows),
                "first": _first(rows),
                "begin": _geometric([row.begin for row in rows if row.begin is not None]),
                "mean": _geometric(ended) if whole else None,
                "interval95": None if interval is None else [exp(end) for end in interval],
                "median": _median(rows),
                "monitored": rows[0].monitored,
                "held": float(np.mean(held)) if (held := [row.held for row in rows if row.held is not None]) else None,
                "unusual": _count(rows, "unusual"),
                "grown": _count(rows, "grown"),
                "controls": [
                    control([row for row in walks if row.steady == steady])
                    for steady in dict.fromkeys(row.steady for row in walks if row.steady is not None)
                ],
            }
        )
    return found


def over_seeds(lives: Sequence[Life], methods: Mapping[str, str], tried: tuple[float, float]) -> list[dict[str, Any]]:
    """Return, for each training method that has at least two policies and each level, when lives end over its seeds.

    A policy is one sample: the geometric mean of the wear at which its robots' lives ended. `mean` is that of the
    policies, `interval95` its t-interval, of the logarithm. Both are None where a life did not end within the wear that
    was tried. Then `at_least` is the mean with the greatest wear for each life that goes on, and `at_most` that with
    the least for each that never was one; with lives of both kinds there is neither.

    methods: policy -> training method under which its seeds stand alone, as of `methods_of`; tried: least and greatest
    wear.
    """
    found = []
    cells: dict[tuple[str, str], dict[str, list[Life]]] = {}
    for row in lives:
        if row.steady is None:
            policies = cells.setdefault((methods[row.policy], row.friction_level), {})
            policies.setdefault(row.policy, []).append(row)
    for (method, level), policies in cells.items():
        if len(policies) < 2:
            continue
        each = {name: _policy_life(own, tried) for name, own in policies.items()}
        above, below = (any(life[count] for life in each.values()) for count in ("alive", "never"))
        means = [log(life["mean"]) for life in each.values()]
        middle, interval = exp(float(np.mean(means))), t_interval(means)
        whole = not above and not below
        found.append(
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
    return found


def _within(row: Life, tried: tuple[float, float]) -> float:
    """Return the wear at which a life ended, or the end of what was tried beyond which it did."""
    return row.factor if row.factor is not None else tried[row.end == "alive"]


def _policy_life(rows: Sequence[Life], tried: tuple[float, float]) -> dict[str, Any]:
    """Return the geometric mean over one policy's robots, and how many lives of which it is at least and at most."""
    return {
        "mean": exp(float(np.mean([log(_within(row, tried)) for row in rows]))),
        "alive": sum(row.end == "alive" for row in rows),
        "never": sum(row.end.endswith(NEVER) for row in rows),
    }


def control(rows: Sequence[Life]) -> dict[str, Any]:
    """Return how robots of one policy and level did while their friction stayed the same, and how often it was noticed.

    Whatever a monitor notices there is a false alarm, at once or later. The intervals are Wilson's, over the robots.
    """
    alarms = {name: [getattr(row, name) for row in rows if getattr(row, name) != "never"] for name in SIGNALS}
    return {
        "steady": rows[0].steady,
        "robots": len(rows),
        "ends": _ends(rows),
        "alarms": {name: len(came) for name, came in alarms.items()},
        "at_once": {name: came.count("at once") for name, came in alarms.items()},
        "interval95": {name: list(wilson(len(came), len(rows))) for name, came in alarms.items()},
    }


def _ends(rows: Sequence[Life]) -> dict[str, int]:
    """Return how often each end came."""
    return {end: sum(row.end == end for row in rows) for end in dict.fromkeys(row.end for row in rows)}


def _first(rows: Sequence[Life]) -> dict[str, int]:
    """Return what the robots were in their first window, and how many of them."""
    paces = [pace(row.first_ratio) for row in rows if row.first_ratio is not None]
    return {one: paces.count(one) for one in dict.fromkeys(paces)}


def _geometric(factors: Sequence[float]) -> float | None:
    """Return the geometric mean; None of nothing."""
    return exp(float(np.mean(np.log(factors)))) if factors else None


def _median(rows: Sequence[Life]) -> float | None:
    """Return the median wear at the end: those that never lived before all, those alive after all."""
    order = sorted(rows, key=lambda row: (row.end == "alive", not row.end.endswith(NEVER), row.factor or 0.0))
    middle = order[(len(order) - 1) // 2 : len(order) // 2 + 1]
    factors = [row.factor for row in middle if row.factor is not None]
    return float(np.mean(factors)) if len(factors) == len(middle) else None


def _count(rows: Sequence[Life], name: str) -> dict[str, int]:
    """Return how often each kind of notice came."""
    said = [getattr(row, name) for row in rows]
    return {kind: said.count(kind) for kind in dict.fromkeys(said)}


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


def listen(trial: Trial, bundle: Bundle, spec: Robot, case: Case, wear: Wear, settle: float) -> list[dict[str, Any]]:
    """Return what the bundle's monitor says of what the policy saw after `settle` [s]; nothing without one.

    The target is the joint that wears, or the level where several do. The truth is the referee's to know.
    """
    if bundle.wear is None:
        return []
    period, worn = bundle.contract.control_period, wear.worn(spec.joint_names)
    share = case.robot(draw(spec, case.seed)).friction.share
    own = case.level.coulomb(spec) * share / spec.joint_values("torque_limit")
    one = int(np.argmax(worn)) if worn.sum() == 1 else None
    target = LEVEL if one is None else spec.joint_names[one]
    monitor, first, said = WearMonitor(bundle.contract, bundle.wear), round(settle / period), []
    for steps, turn in enumerate(trial.steps[first:], first + 1):
        estimate = monitor.step(turn.policy.observation)
        if estimate is None:
            continue
        time = steps * period
        factor = wear.factor(time - bundle.wear.window * period / 2)
        true = own * np.where(worn, factor, 1.0)
        true = float(true.mean() if one is None else true[one])
        told = {name: value if np.isfinite(value) else None for name, value in numbers(estimate, one).items()}
        said.append(
            {"target": target, "time": time, "factor": factor, "true": true} | told | {"unusual": estimate.unusual}
        )
    return said


def numbers(estimate: WearEstimate, joint: int | None) -> dict[str, float]:
    """Return the estimate of one joint, by its number, or of the level, with the ends of its interval."""
    if joint is None:
        low, high = estimate.level_interval95
        return {"estimate": estimate.level, "low": low, "high": high}
    low, high = estimate.interval95[:, joint].tolist()
    return {"estimate": float(estimate.friction[joint]), "low": low, "high": high}
