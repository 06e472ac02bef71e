"""Split conformal prediction over robots: how far a map of the wear monitor is off on robots of another kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.cache import key_of
from stiction.core.provenance import seed_streams
from stiction.core.records import column
from stiction.core.statistics import CONFIDENCE, wilson
from stiction.deploy.check import check_bundle
from stiction.deploy.wear import Moments, is_unusual, raw_estimate
from stiction.engines.catalog import binaries, make_engine
from stiction.evaluation.evaluate import WALK_CODE
from stiction.files.contract import robot_of
from stiction.files.wear import WearCalibration, WearModel
from stiction.virtual.cases import Case, Level
from stiction.virtual.hidden import draw
from stiction.virtual.trial import World, walk
from stiction_experiments.lab.files import cached
from stiction_experiments.lab.statistics import conformal_bound

SLOWEST, FASTEST = 0.3, 0.6
"""Commanded speeds, forward and backward, another one in every window [m/s]."""

SETTLE = 2.0
"""Time after the start that no window is of [s]."""


@dataclass(frozen=True)
class Windows:
    """What the map said of one robot, and the truth."""

    seed: int
    """Of the robot."""
    error: np.ndarray
    """Truth less estimate [-], shape (windows, targets); NaN where the map does not estimate."""
    true: np.ndarray
    """f/τ_max in motion, without load, of each joint, then their mean [-], shape (targets,)."""
    unusual: np.ndarray
    """Whether each window was unlike those of the fit, bool, shape (windows,)."""


def walk_robot(path: Path, seed: int, windows: int, engine: str, out: Path) -> Windows | None:
    """Let one robot walk, unless its file is there, at a level drawn from what the map was fitted on.

    path: the bundle; windows: of the monitor, one after another; out: folder of the files. None where it fell before
    its first window was full.
    """
    bundle = check_bundle(path).bundle
    assert bundle.wear is not None
    key = key_of(
        [bundle.digest, seed, windows, engine, binaries(engine)], *WALK_CODE, "stiction_experiments:calibration/*.py"
    )
    make = partial(_record, path, seed, windows, engine)
    found = cached(out, f"{bundle.name}--{engine}--{seed}", key, make)
    if not found["estimate"]:
        return None
    true, said = np.array(found["true"]), np.array(found["estimate"], float)
    return Windows(seed, true - said, true, np.array(found["unusual"], bool))


def _record(path: Path, seed: int, windows: int, engine: str) -> dict[str, Any]:
    """Walk; return the `true` friction of every target, and of each window the `estimate` and whether `unusual`."""
    bundle = check_bundle(path).bundle
    contract, model = bundle.contract, bundle.wear
    assert model is not None
    spec, stream = robot_of(contract), seed_streams(seed, ["calibration"])["calibration"]
    level = Level(round(float(stream.uniform(0.0, model.highest)), 4))
    # One more than there are windows: a moment is of two successive frames, so the last window takes one beyond it.
    speed = stream.uniform(SLOWEST, FASTEST, windows + 1) * stream.choice([-1.0, 1.0], windows + 1)
    settle, length = round(SETTLE / contract.control_period), model.window
    case = Case(seed, "all", level)
    trial = walk(
        bundle,
        case,
        World(partial(make_engine, engine)),
        lambda step, motion: np.array([speed[max(0, step - settle) // length], 0.0, 0.0]),
        settle + windows * length + 1,
    )
    share = case.robot(draw(spec, seed)).friction.share
    own = level.coulomb(spec) * share / spec.joint_values("torque_limit")
    moments = Moments(contract.observation, contract.scale)
    size = contract.observation.frame_size
    frames = np.array([step.policy.observation[-size:] for step in trial.steps[settle:]], float)
    seen = moments(frames[:-1], frames[1:]) if len(frames) > 1 else np.empty((0, len(model.center)))
    means = [seen[at * length : (at + 1) * length].mean(axis=0) for at in range(len(seen) // length)]
    said = [[value if np.isfinite(value) else None for value in raw_estimate(model, mean)] for mean in means]
    return {
        "true": [*own.tolist(), float(own.mean())],
        "estimate": said,
        "unusual": [is_unusual(model, mean) for mean in means],
    }


def calibrate(
    model: WearModel, robots: Sequence[Windows], tested: Sequence[Windows], engine: str
) -> tuple[WearCalibration, list[Coverage]]:
    """Return what virtual robots say of a map, and how its intervals did on other ones.

    robots: at least one; tested: at least one, others. Each tail has half of what the interval may miss. A robot counts
    with its largest error to either side over its windows, so that windows of one robot are no sample of others.
    """
    tail = 1.0 - (1.0 - CONFIDENCE) / 2.0
    above = np.array([np.nan_to_num(one.error).max(axis=0) for one in robots])
    below = np.array([np.nan_to_num(one.error).min(axis=0) for one in robots])
    upper, lower = conformal_bound(above, tail), -conformal_bound(-below, tail)
    middle = np.median([np.nan_to_num(one.error).mean(axis=0) for one in robots], axis=0)
    # An estimate must lie within its own interval.
    shift = np.clip(middle, lower, upper)
    error = np.nan_to_num(np.concatenate([one.error for one in tested]))
    reach = np.array(model.reach)
    held, before = ((lower <= error) & (error <= upper)).mean(axis=0), (np.abs(error) <= reach).mean(axis=0)
    rows = []
    for at, target in enumerate(model.targets):
        whole = sum(bool(((lower <= one.error) & (one.error <= upper))[:, at].all()) for one in tested)
        ends = wilson(whole, len(tested))
        before_after = float(before[at]), float(held[at])
        rows.append(
            Coverage(
                target, float(reach[at]), float(shift[at]), float(lower[at]), float(upper[at]), *before_after, *ends
            )
        )
    calibration = WearCalibration(
        shift=tuple(shift.tolist()),
        lower=tuple(lower.tolist()),
        upper=tuple(upper.tolist()),
        held=tuple(held.tolist()),
        held_before=tuple(before.tolist()),
        robots=tuple(one.seed for one in robots),
        tested=tuple(one.seed for one in tested),
        engine=f"{engine}+all",
    )
    return calibration, rows


@dataclass(frozen=True)
class Coverage:
    """A target's interval before and after; a row of coverage.csv."""

    target: str
    """The joint, or `level`."""
    reach: float = field(metadata=column("reach before", "of τ_max", form=".3f"))
    """Half-width of the map's own interval [-]."""
    shift: float = field(metadata=column("shift", "of τ_max", form="+.3f"))
    """Added to the estimate [-]."""
    lower: float = field(metadata=column("from", "of τ_max", form="+.3f"))
    """Lower end of the interval less the map's estimate [-]."""
    upper: float = field(metadata=column("to", "of τ_max", form="+.3f"))
    """Upper end less the estimate [-]."""
    held_before: float = field(metadata=column("held before", "% of windows", form=".0%"))
    """Share of the test robots' windows whose own interval held the truth [-]."""
    held: float = field(metadata=column("held", "% of windows", form=".0%"))
    """The same of the calibrated interval [-]."""
    robots_low: float = field(metadata=column("robots all of whose windows held, from", "%", form=".0%"))
    """Wilson's 95 % interval of the share of test robots all of whose windows held, lower end [-]."""
    robots_high: float = field(metadata=column("to", "%", form=".0%"))
    """Upper end [-]."""


def usual(walked: Mapping[int, Windows | None]) -> list[Windows]:
    """Return the robots with a full window that was not unusual, and of them those windows: others are not read."""
    remaining = []
    for one in walked.values():
        if one is not None and not one.unusual.all():
            remaining.append(Windows(one.seed, one.error[~one.unusual], one.true, one.unusual[~one.unusual]))
    return remaining
