"""What is seen of a robot that wears out: its speed, window by window, and what the wear monitor says on the way."""

from __future__ import annotations

from typing import Any

import numpy as np

from stiction.deploy.wear import WearEstimate, WearMonitor
from stiction.formats.bundle import Bundle
from stiction.formats.wear import LEVEL
from stiction.robots.spec import RobotSpec
from stiction.transfer.command import Command
from stiction.transfer.robot.draw import draw
from stiction.transfer.robot.factorial import Case
from stiction.transfer.robot.trial import Trial
from stiction.transfer.robot.wear import Wear


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


def listen(
    trial: Trial, bundle: Bundle, spec: RobotSpec, case: Case, wear: Wear, settle: float
) -> list[dict[str, Any]]:
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
    for steps, turn in enumerate(trial.turns[first:], first + 1):
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
