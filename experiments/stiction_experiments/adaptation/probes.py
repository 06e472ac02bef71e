"""Linear probes of a walk: how well the joints' friction can be read from z*, and from its inputs.

Inputs are compared on the same walks, robots and split. A row is one step, or the mean over a window. There is no
torque in o_H; `moments` are products of what is in it, which a linear probe of o_H cannot form.

All rows of a robot stay together, in folds, in the split and in the bootstrap: neighbouring steps of one walk are
nearly copies of each other, and a split between them would count the copies as unseen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np
import torch
from scipy.linalg import cho_factor, cho_solve

from stiction.core.provenance import stream_seed
from stiction.deploy.wear import Moments
from stiction.evaluation.course import SETTLE
from stiction.joints.friction import has_coefficient
from stiction.learning.config import TrainCfg
from stiction.learning.models import RMAActor
from stiction.task.config import TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg
from stiction_experiments.methods.context import ContextActor

Per = Literal["joint", "robot"]
"""Friction drawn for each joint by itself, or one level for all joints of a robot."""


@dataclass(frozen=True)
class WalkCfg:
    """Robots, time and friction of a walk. All else is drawn, and pushed, and noisy, as in the run's training."""

    robots: int = 384
    """Robots side by side; those that fall are left out."""
    seconds: float = 22.1
    """Length [s]; commands are drawn anew as in training, every 5 s. Beside what is left out, two windows of the wear
    monitor and the frame before the first of them."""
    settle: float = SETTLE
    """Start of the walk that is left out [s]."""
    highest: float = 0.24
    """Friction is drawn from 0 to this fraction of the torque limit, uniformly: 1.2 times 0.2, as `deception` draws."""
    seed: int = 0
    """Seed of everything drawn. It names its own stream: no training run has met these robots."""


@dataclass(frozen=True)
class FrictionWalk:
    """Signals of N robots that did not fall, over T control steps after settling."""

    frames: np.ndarray
    """o_prio, float32, shape (T, N, frame)."""
    latent: np.ndarray
    """z*, float32, shape (T, N, latent); latent is 0 of a policy without one."""
    explicit: np.ndarray
    """o_exp*, the estimate of base velocity and foot contacts, float32, shape (T, N, explicit)."""
    teacher: np.ndarray
    """z, the teacher's encoding of o_priv, float32, shape (N, latent): constant over a walk. (N, 0) where none is."""
    friction: np.ndarray
    """Dry friction of every joint as a fraction of its torque limit, shape (N, joints)."""
    fallen: int
    """Robots that fell or became unstable and were left out."""


def probe_task(task: TaskCfg, per: Per, cfg: WalkCfg) -> TaskCfg:
    """Return the task of a walk: the run's own but for the joints' friction, on flat ground, in one long episode."""
    friction = task.friction
    level = cfg.highest if has_coefficient(friction.law) else friction.level or cfg.highest
    method = "compensation" if friction.method == "compensation" else "direct"
    drawn = FrictionCfg(method=method, level=level, per=per, range=(0.0, cfg.highest / level))
    ground = TaskCfg().terrain
    episode, physics = cfg.seconds + task.control_period, task.physics.at_last
    return replace(task, friction=drawn, terrain=ground, episode=episode, physics=physics)


def walk_with_friction(
    train: TrainCfg,
    identified: dict[str, np.ndarray] | None,
    actor: RMAActor,
    per: Per,
    cfg: WalkCfg,
    threads: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> FrictionWalk:
    """Let a student walk on its own z* with deterministic actions and record what the probes need.

    train, identified: configuration of its run, and its nominal joints, see `nominal_joints`; threads: of the
    simulator.
    """
    env = LocomotionEnv(
        probe_task(train.task, per, cfg), cfg.robots, stream_seed(cfg.seed, f"probe {per}"), threads, identified
    )
    steps, skip = (round(time / env.cfg.control_period) for time in (cfg.seconds, cfg.settle))
    share = torch.from_numpy(env.randomizer.nominal.frictionloss / env.fleet.torque_limit)
    friction = (env.randomizer.draws.friction * share).numpy().copy()
    upright, parts = np.ones(cfg.robots, dtype=bool), []
    with torch.no_grad():
        first = env.get_observations()
        # DreamWaQ has no teacher, and a policy without a latent neither that nor z*.
        coded, has_latent = isinstance(actor, ContextActor), bool(train.network.latent)
        teach = actor.privileged_encoder if has_latent and not coded else _nothing
        adapt = actor.adaptation if has_latent or coded else _nothing
        teacher = teach(first["privileged"]).numpy()
        for step in range(steps):
            obs = env.get_observations()
            if step >= skip:
                seen = obs["proprioception"], adapt(obs["history"]), actor.estimator(obs["history"])
                parts.append([value.numpy() for value in seen])
            _, _, dones, _ = env.step(actor(obs))
            # What the last step leads to is not recorded any more.
            upright &= ~dones.numpy() | (step == steps - 1)
            progress((step + 1) / steps)
    frames, latent, explicit = (np.stack(values)[:, upright] for values in zip(*parts, strict=True))
    return FrictionWalk(frames, latent, explicit, teacher[upright], friction[upright], int((~upright).sum()))


def _nothing(obs: torch.Tensor) -> torch.Tensor:
    """Return no numbers of every robot, (N, 0)."""
    return obs[:, :0]


PENALTIES = tuple(10.0**power for power in range(-4, 2))
"""Penalties tried, per row: features are standardised, so 1 halves the weight of a lone feature."""

FOLDS = 4
"""Parts of the training robots that are left out in turn to choose the penalty."""

RESAMPLES = 2000
"""Resamples of the bootstrap: the end of a 95 % interval is then known to within one per cent of probability."""

BOOTSTRAP_SEED = 20_260_101
"""Seed of the resamples: the same walks give the same intervals."""


LIMIT = 3.0
"""Standardised features are cut off here: a robot that stumbles has moments far out, which would dominate the fit."""


@dataclass(frozen=True)
class Ridge:
    """A fitted probe: y = intercept + clip((x - center) / scale, ±LIMIT) @ weights."""

    center: np.ndarray
    """Median of each feature, shape (features,)."""
    scale: np.ndarray
    """Half of the width that holds 68 % of each feature, 1 where that is nothing, shape (features,)."""
    weights: np.ndarray
    """Shape (features, targets)."""
    intercept: np.ndarray
    guess: np.ndarray
    """Mean of each target, the prediction without any feature, shape (targets,)."""
    penalty: float
    """Chosen penalty, one of `PENALTIES`."""

    def standard(self, features: np.ndarray) -> np.ndarray:
        """Return standardised features, cut off at `LIMIT`, shape (rows, features)."""
        return np.clip((features - self.center) / self.scale, -LIMIT, LIMIT)

    def predict(self, features: np.ndarray) -> np.ndarray:
        """Return predictions, shape (rows, targets), of features, shape (rows, features)."""
        return self.intercept + self.standard(features) @ self.weights


def fit_ridge(
    features: np.ndarray, targets: np.ndarray, robot: np.ndarray, penalties: tuple[float, ...] = PENALTIES
) -> Ridge:
    """Fit a probe: minimise |y - X w|² / rows + penalty |w|², the penalty by cross-validation over robots.

    features, targets: shape (rows, ...); robot: of each row, integers, shape (rows,), assigned to folds in turn;
    penalties: to choose from, by the least squared error, each target over its variance.
    """
    low, center, high = np.quantile(features, (0.16, 0.5, 0.84), axis=0)
    scale = np.where(high - low > 1e-9, (high - low) / 2, 1.0)
    x = np.clip((features - center) / scale, -LIMIT, LIMIT)
    guess, spread, middle = targets.mean(axis=0), targets.std(axis=0), x.mean(axis=0)
    spread = np.where(spread > 0, spread, 1.0)
    # Centred, so that the penalty does not reach the intercept; over their spread, so that all targets count alike.
    x, y = x - middle, (targets - guess) / spread
    fold = np.unique(robot, return_inverse=True)[1] % FOLDS
    parts = [(x[fold == k], y[fold == k]) for k in range(FOLDS)]
    grams = [(a.T @ a, a.T @ b) for a, b in parts]
    whole = sum(gram for gram, _ in grams), sum(cross for _, cross in grams)
    error = np.zeros(len(penalties))
    for (a, b), (gram, cross) in zip(parts, grams, strict=True):
        rows = len(x) - len(a)
        for index, penalty in enumerate(penalties):
            # The other folds' Gram matrix is that of all less this one's: no product is formed twice.
            weights = _solve(whole[0] - gram, whole[1] - cross, penalty * rows)
            error[index] += ((b - a @ weights) ** 2).sum()
    best = penalties[int(error.argmin())]
    weights = _solve(*whole, best * len(x)) * spread
    return Ridge(center, scale, weights, guess - middle @ weights, guess, best)


def _solve(gram: np.ndarray, cross: np.ndarray, penalty: float) -> np.ndarray:
    """Return (gram + penalty I)⁻¹ cross."""
    return cho_solve(cho_factor(gram + penalty * np.eye(len(gram)), check_finite=False), cross, check_finite=False)


@dataclass(frozen=True)
class Determination:
    """R² of every target and of their mean, with 95 % intervals over robots."""

    each: np.ndarray
    """1 - squared error over that of the training robots' mean, shape (targets,); below 0 that mean is better."""
    each_interval: np.ndarray
    mean: float
    mean_interval: tuple[float, float]


def determination(targets: np.ndarray, predicted: np.ndarray, robot: np.ndarray, guess: np.ndarray) -> Determination:
    """Return R² of predictions on unseen robots; intervals by resampling whole robots.

    targets, predicted: shape (rows, targets); robot: of each row, shape (rows,); guess: the prediction without any
    feature, the mean of the training robots, shape (targets,).
    """
    group = np.unique(robot, return_inverse=True)[1]
    num = int(group.max()) + 1
    squares = (targets - predicted) ** 2, (targets - guess) ** 2
    error, variation = (np.stack([np.bincount(group, column, num) for column in s.T], 1) for s in squares)
    each = 1.0 - error.sum(axis=0) / variation.sum(axis=0)
    weight = resamples(num)
    drawn = 1.0 - (weight @ error) / (weight @ variation)
    ends = np.quantile(drawn, (0.025, 0.975), axis=0)
    low, high = np.quantile(drawn.mean(axis=1), (0.025, 0.975))
    return Determination(each, ends, float(each.mean()), (float(low), float(high)))


def resamples(count: int) -> np.ndarray:
    """Return how often each of `count` units is drawn in each resample, shape (RESAMPLES, count), float64."""
    generator = np.random.default_rng(BOOTSTRAP_SEED)
    return generator.multinomial(count, np.full(count, 1.0 / count), RESAMPLES).astype(float)


def mean_interval(values: np.ndarray) -> tuple[float, float]:
    """Return the 95 % bootstrap interval of the mean of independent values, shape (n,)."""
    values = np.asarray(values, dtype=float)
    low, high = np.quantile(resamples(len(values)) @ values / len(values), (0.025, 0.975))
    return float(low), float(high)


HISTORIES = (11, 21, 51)
"""Lengths of the raw history [frames]: H of 10, 20 and 50, the present frame included as in the paper's set."""

EVERY = 50
"""Control steps between the single steps that are probed: 1 s, so that neighbours differ."""

WINDOWS = (50, 250)
"""Lengths of the windows over which features are averaged [control steps], beside the whole walk: 1 s and 5 s."""

TEST_OF = 4
"""One robot in this many is a test robot. Robots are drawn independently, so any split by number will do."""


def held_out(count: int) -> np.ndarray:
    """Return which robots no probe is fitted on, bool, shape (count,)."""
    return np.arange(count) % TEST_OF == TEST_OF - 1


def windows(features: np.ndarray, length: int) -> np.ndarray:
    """Return the means over consecutive windows, shape (T // length, N, ...), of features, shape (T, N, ...)."""
    count = len(features) // length
    cut = features[: count * length].reshape(count, length, *features.shape[1:])
    return cut.mean(axis=1, dtype=np.float64)


def histories(frames: np.ndarray, length: int) -> np.ndarray:
    """Return o_H of `length` frames, oldest first, every `EVERY` steps, shape (K, N, length * frame).

    All lengths are taken at the same steps, the first at which the longest is full.
    """
    ends = range(max(HISTORIES), len(frames) + 1, EVERY)
    return np.stack([np.concatenate(frames[end - length : end], axis=-1) for end in ends])


def inputs(walk: FrictionWalk, moments: Moments) -> Iterator[tuple[str, str, Callable[[], np.ndarray]]]:
    """Yield every input: its name, what a row is, and a function that returns it, (rows per robot, N, features).

    The first is what the policy knows of its history: z*, of one without it the explicit estimate.
    """
    steps, frames = slice(max(HISTORIES) - 1, None, EVERY), walk.frames
    products = moments(frames[:-1], frames[1:])
    signals = {"latent": walk.latent, "explicit": walk.explicit, "frame": frames, "moments": products}
    signals = {name: signal for name, signal in signals.items() if signal.shape[-1]}
    for name, signal in signals.items():
        if name in ("latent", "explicit"):
            yield name, "step", partial(signal.__getitem__, steps)
        for length in (*(length for length in WINDOWS if length < len(signal)), len(signal)):
            span = "walk" if length == len(signal) else f"mean of {length} steps"
            yield name, span, partial(windows, signal, length)
    for length in HISTORIES:
        yield f"history {length}", "step", partial(histories, frames, length)
    if walk.teacher.shape[-1]:
        yield "teacher", "walk", partial(walk.teacher.__getitem__, None)


def probe(features: np.ndarray, targets: np.ndarray) -> dict[str, Any]:
    """Fit a probe on the training robots and return its R² on the others, as plain data.

    `features`: shape (rows per robot, N, features); `targets`: shape (N, targets).
    """
    rows, count = features.shape[:2]
    test, robot = held_out(count), np.tile(np.arange(count), (rows, 1))
    train_x, test_x = (features[:, part].reshape(-1, features.shape[2]).astype(float) for part in (~test, test))
    train, held = (robot[:, part].ravel() for part in (~test, test))
    fitted = fit_ridge(train_x, targets[train], train)
    score = determination(targets[held], fitted.predict(test_x), held, fitted.guess)
    return {
        "mean": score.mean,
        "interval95": list(score.mean_interval),
        "each": score.each.tolist(),
        "each_interval95": score.each_interval.T.tolist(),
        "penalty": fitted.penalty,
        "features": features.shape[2],
        "rows": len(train),
    }


def probe_walk(
    walk: FrictionWalk, moments: Moments, per: Per, progress: Callable[[float], None] = lambda share: None
) -> list[dict[str, Any]]:
    """Probe every input of a walk; return R² of each, as plain data, with `input`, `row`, `per` and `shuffled`.

    Targets are the joints' f/τ_max; where friction is drawn per robot, its one level. The control beside them is the
    first input over the whole walk with the friction of the robots shuffled: what a probe finds by chance.
    """
    targets = walk.friction if per == "joint" else walk.friction[:, :1]
    every = list(inputs(walk, moments))
    results = []
    for number, (name, row, make) in enumerate(every):
        results.append({"input": name, "row": row, "per": per, "shuffled": False} | probe(make(), targets))
        progress((number + 1) / (len(every) + 1))
    mixed = targets[np.random.default_rng(0).permutation(len(targets))]
    first, _, _ = every[0]
    signal = getattr(walk, first)
    control = {"input": first, "row": "walk", "per": per, "shuffled": True}
    results.append(control | probe(windows(signal, len(signal)), mixed))
    progress(1.0)
    return results
