"""Measurements of each engine: the conformance suite, two motions to draw, and pace."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from stiction.core.errors import EngineError, check_once
from stiction.core.records import column
from stiction.engines.catalog import ENGINES, make_engine, missing_engine
from stiction.robots.model import Robot
from stiction_experiments.engines.conformance import flight, joint
from stiction_experiments.engines.conformance.suite import CHECKS, check_timestep, conformance, steps_per_second

ROUNDS = 3
"""Times that every engine's pace is measured, in turn, so that other load on the machine meets all of them."""

PACE_SECONDS = 1.0
"""Simulated in each of them [s]."""


@dataclass(frozen=True)
class FigureRow:
    """One figure of the conformance suite in one engine."""

    engine: str
    timestep: float
    check: str
    figure: str
    value: float | None
    """Measured value, ideally zero; None where it is not a number."""
    unit: str
    """Its unit, `1` for a ratio."""
    bound: float
    passed: bool


@dataclass(frozen=True)
class PaceRow:
    """How fast one engine steps, all engines side by side in one run."""

    engine: str = field(metadata=column("engine"))
    timestep: float = field(metadata=column("step", "ms", lambda step: f"{1000 * step:g}"))
    steps_per_second: float = field(metadata=column("pace", "steps/s", form=",.0f"))
    """Steps per second of processor time, median over rounds [1/s]."""
    share: float = field(metadata=column("share", "1", form=".2f"))
    """... over that of the first engine in the same rounds, median [1]."""


@dataclass(frozen=True)
class Traces:
    """Two motions of every engine, to be drawn; arrays of shape (samples,)."""

    time: np.ndarray
    """Time of the joint's samples [s]."""
    load: np.ndarray
    """Torque on the joint over its dry friction [1]."""
    exact_speed: np.ndarray
    """Speed of the joint in closed form [rad/s]."""
    speed: dict[str, np.ndarray]
    """Engine -> speed of the joint [rad/s]."""
    error: dict[str, np.ndarray]
    """Engine -> magnitude of the error of the joint's angle [rad]."""
    flight: dict[str, np.ndarray]
    """Engine -> largest error of a joint's angle in free flight, from the start to its end [rad]."""
    flight_time: np.ndarray
    """Time of the flight's samples [s]."""


def find_engines(asked: Sequence[str] | None, spec: Robot) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the engines asked for, or all that can be had here; and of all the others why not, and how to get them.

    Raises:
        StictionError: one that was asked for is unknown, not here, or was asked for twice.

    """
    names = tuple(ENGINES if asked is None else asked)
    check_once("engines", names)
    missing = {name: line for name in names if (line := missing_engine(name, spec))}
    here = tuple(name for name in names if name not in missing)
    if missing and (asked is not None or not here):
        raise EngineError(next(iter(missing.values())))
    return here, missing


def check_timesteps(timesteps: Sequence[float]) -> None:
    """Raise `StictionError` unless there is a timestep, each once, and the suite can be run with each."""
    check_once("timesteps", timesteps)
    for timestep in timesteps:
        check_timestep(timestep)


def figure_rows(name: str, spec: Robot, timestep: float, progress: Callable[[float], None]) -> list[FigureRow]:
    """Run the suite on a robot in an engine; `progress` is called with the share of the suite that is done."""
    rows, order = [], list(CHECKS)
    for measured in conformance(partial(make_engine, name), spec, timestep):
        figure = measured.figure
        value = figure.value if math.isfinite(figure.value) else None
        cells = (figure.name, value, figure.unit, figure.tolerance, figure.passed)
        rows.append(FigureRow(name, timestep, measured.check, *cells))
        progress(order.index(measured.check) / len(order))
    progress(1.0)
    return rows


def traces(names: Sequence[str], spec: Robot, timestep: float) -> Traces:
    """Return the joint that breaks away and the free flight, in every engine at one timestep."""
    makers = {name: partial(make_engine, name) for name in names}
    joints = {name: joint.break_away(make, spec, timestep) for name, make in makers.items()}
    one = next(iter(joints.values()))
    flown = flight.reference(spec, timestep, 0.0).joint_position
    flights = {name: flight.fly(make, spec, timestep, 0.0, timestep).joint_position for name, make in makers.items()}
    return Traces(
        time=one.time,
        load=one.load / one.friction,
        exact_speed=one.truth.velocity,
        speed={name: seen.speed for name, seen in joints.items()},
        error={name: np.abs(seen.angle - seen.truth.position) for name, seen in joints.items()},
        flight={name: np.abs(angles - flown).max(-1) for name, angles in flights.items()},
        flight_time=np.arange(len(flown)) * timestep,
    )


def pace_rows(names: Sequence[str], spec: Robot, timestep: float) -> list[PaceRow]:
    """Return how fast the engines step, side by side: `ROUNDS` times one after the other, `PACE_SECONDS` each."""
    paces: dict[str, list[float]] = {name: [] for name in names}
    for _ in range(ROUNDS):
        for name in names:
            paces[name].append(steps_per_second(partial(make_engine, name), spec, timestep, PACE_SECONDS))
    first = paces[names[0]]
    return [
        PaceRow(
            name,
            timestep,
            statistics.median(mine),
            statistics.median(one / other for one, other in zip(mine, first, strict=True)),
        )
        for name, mine in paces.items()
    ]
