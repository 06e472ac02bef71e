"""Gaits of the report: one number of each training seed for the sentences on trot, pronk, hop and steadiness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stiction.core.errors import RobotError
from stiction.core.rotation import roll_pitch
from stiction.evaluation.evaluate import EvaluationCfg, batch_policy, make_rollout
from stiction.evaluation.metrics import moving_steps
from stiction.files.bundle import Bundle
from stiction.files.contract import robot_of
from stiction.files.walk import Recording
from stiction.virtual.drive import Recorder, drive
from stiction_experiments.gait import measure

COMMAND = "vx=0.5"
"""Commanded velocity of the walks."""

TOUCHES = 0.1
"""Share of a period within which touch-downs happen together [1]."""


@dataclass(frozen=True)
class Gait:
    """Gait of one seed without friction at 0.5 m/s: a row of gait.csv; None of a robot that stands still."""

    training: str
    seed: int
    pronk: float | None
    """Share of touch-downs with those of all other legs within a tenth of the period [1]."""
    diagonal: float | None
    """Share of steps in which exactly one contact group stands [1]."""
    in_phase: float | None
    """Share of steps in which the feet of each contact group are all down or all up [1]."""
    imbalance: float | None
    """Difference of the use of both contact groups, as a share of both [1]."""
    sway: float | None
    """Standard deviation of roll and pitch, root of the sum of squares [rad]."""


def gait_of(
    training: str,
    seed: int,
    contact: np.ndarray,
    moving: np.ndarray,
    groups: np.ndarray,
    tilt: np.ndarray,
    period: float,
) -> Gait:
    """Return the gait of N robots of one policy.

    contact: feet on the ground, bool, shape (T, N, L); moving: steps that count, bool, (T, N); groups: contact group of
    each foot, (L,); tilt: roll and pitch [rad], (T, N, 2); period: of control [s].
    """
    gait = measure.measure_gait(contact, moving, groups, period)
    if gait.stride_frequency is None:
        return Gait(training, seed, None, None, None, None, None)
    landings = measure.events(contact, round(measure.SHORTEST / period))
    frequency = float(np.mean(gait.stride_frequency))
    # A foot that never touches down leaves no period, and no touch-down to be counted.
    window = round(TOUCHES / (frequency * period)) if frequency else 0
    pronk = measure.together_share([landings], moving, window)
    return Gait(
        training,
        seed,
        pronk or 0.0,
        gait.tripod_share,
        in_phase_share(contact[moving], groups),
        gait.one_sidedness,
        sway(tilt, moving),
    )


def in_phase_share(steps: np.ndarray, groups: np.ndarray) -> float:
    """Return the share of steps, bool (num_steps, L), in which the feet of each group are all down or all up."""
    own = (steps[:, groups == group] for group in (0, 1))
    return float(np.all([feet.all(axis=1) | ~feet.any(axis=1) for feet in own], axis=0).mean())


def sway(tilt: np.ndarray, moving: np.ndarray) -> float:
    """Return the standard deviation of roll and pitch, root of the sum of squares [rad], mean over robots that move.

    tilt: roll and pitch [rad], shape (T, N, 2); moving: steps that count, bool, shape (T, N).
    """
    each = [tilt[steps, robot].var(axis=0).sum() ** 0.5 for robot, steps in enumerate(moving.T) if steps.any()]
    return float(np.mean(each))


def walked(bundle: Bundle, cfg: EvaluationCfg) -> tuple[Recording, np.ndarray]:
    """Let a policy walk in MuJoCo; return the motion after settling, and roll and pitch [rad], shape (T, N, 2)."""
    contract, spec = bundle.contract, robot_of(bundle.contract)
    friction = cfg.friction(contract)
    rollout = make_rollout(batch_policy(bundle, spec, cfg, friction), contract, spec, cfg)
    steps = round(cfg.duration / contract.control_period)
    recorder, tilt = Recorder(rollout, contract.control_period, steps), []
    for _ in drive(rollout, cfg.robot_commands, steps):
        recorder.record()
        tilt.append(roll_pitch(rollout.fleet.base_quaternion))
    first = round(cfg.settle / contract.control_period)
    return recorder.recording().of(slice(None), first), np.array(tilt[first:])


def walk_gaits(training: str, bundles: Sequence[Bundle], seconds: float, episodes: int) -> list[Gait]:
    """Return the gaits of the policies of a training; seconds, episodes: of their walks."""
    cfg = EvaluationCfg((0.0,), (COMMAND,), episodes, seconds)
    (command,), gaits = cfg.parsed_commands, []
    for bundle in bundles:
        part, tilt = walked(bundle, cfg)
        moving, groups = moving_steps(part, command), robot_of(bundle.contract).groups()
        if moving is None or groups is None:
            raise RobotError(f"robot {bundle.contract.robot!r} has no contact groups; expected one with them")
        gaits.append(gait_of(training, bundle.contract.seed, part.contact, moving, groups, tilt, part.period))
    return gaits
