"""Gaits of the report: one number of each training seed for the sentences on trot, pronk, hop and steadiness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stiction.core.errors import RobotError
from stiction.core.rotation import roll_pitch
from stiction.evaluation.evaluate import EvaluationCfg, batch_policy, make_rollout
from stiction.evaluation.metrics import moving_steps, set_share
from stiction.files.bundle import Bundle
from stiction.files.contract import robot_of
from stiction.files.walk import Recording
from stiction.virtual.drive import Recorder, drive

COMMAND = "vx=0.5"
"""Commanded velocity of the walks."""

TOUCHES = 0.1
"""Share of a period within which touch-downs happen together [1]."""

SHORTEST = 0.06
"""A foot that leaves the ground for less than this has bounced or scuffed: no touch-down [s]."""

UNSYNC_WINDOW = 2.0
"""Windows over which the use of the two groups is compared [s], the H of r_unsync in training."""


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
    if not moving.any():
        return Gait(training, seed, None, None, None, None, None)
    steps, landings = contact[moving], touch_downs(contact, round(SHORTEST / period))
    per_step = float(landings[moving].mean())
    # A foot that never touches down leaves no period, and no touch-down to be counted.
    window = round(TOUCHES / per_step) if per_step else 0
    return Gait(
        training,
        seed,
        together_share(landings, moving, window),
        sum(set_share(steps, groups == group) for group in (0, 1)),
        in_phase_share(steps, groups),
        imbalance(contact, moving, groups, round(UNSYNC_WINDOW / period)),
        sway(tilt, moving),
    )


def touch_downs(contact: np.ndarray, shortest: int) -> np.ndarray:
    """Return where feet touch down after at least `shortest` steps off the ground, bool, shape (T, N, L).

    How long a foot was up before the first step is not known, so it counts from there.
    """
    touches = np.zeros_like(contact)
    away = np.zeros(contact.shape[1:], int)
    for step, down in enumerate(contact):
        touches[step] = down & (away >= max(shortest, 1))
        away = np.where(down, 0, away + 1)
    return touches


def together_share(touches: np.ndarray, moving: np.ndarray, window: int) -> float:
    """Return the share of touch-downs in moving steps that all feet take part in, within `window` steps.

    touches: bool, shape (T, N, L). Returns 0 without any.
    """
    near = touches.copy()
    for shift in range(1, window + 1):
        near[shift:] |= touches[:-shift]
        near[:-shift] |= touches[shift:]
    # Partners are looked for in all steps, touch-downs counted in moving ones: one at the edge of a stop has its
    # partners too.
    counted = touches & moving[..., None]
    total = int(counted.sum())
    return int((counted & near.all(axis=-1, keepdims=True)).sum()) / total if total else 0.0


def imbalance(contact: np.ndarray, moving: np.ndarray, groups: np.ndarray, window: int) -> float | None:
    """Return the mean of |n_0 − n_1| / (n_0 + n_1) over robots and windows of `window` steps; None without contacts.

    n_g: contacts of group g's feet in the moving steps of a window, over the number of its feet.
    """
    used = contact & moving[..., None]
    mean = [used[..., groups == group].mean(axis=-1) for group in (0, 1)]
    values = []
    for start in range(0, len(contact), window):
        first, second = (part[start : start + window].sum(axis=0) for part in mean)
        touched = first + second > 0
        values += (np.abs(first - second)[touched] / (first + second)[touched]).tolist()
    return float(np.mean(values)) if values else None


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
