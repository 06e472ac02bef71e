"""Fits an Actuator Net to logs and measures it on held-out runs, beside the analytic law.

L_actuator = MSE(τ^motor, τ^motor*) of the paper, here of torque over the joint's limit: in newton metres the strongest
motor would count most.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch

from stiction.core.names import kind_of
from stiction.core.provenance import git_revision, machine, stream_seed
from stiction.files.actuator import FILE, ActuatorFit, write_actuator
from stiction.files.results import write_summary
from stiction.files.tables import write_arrays
from stiction.joints.net import (
    ActuatorCfg,
    ActuatorNet,
    Baseline,
    Layers,
    first_signal,
    fit_baseline,
    predict,
    used_inputs,
    weight_groups,
    windows,
)
from stiction.learning.actuator_data import LoggedRun, check_runs, split_runs

STD_FLOOR = 1e-6
"""Smallest standard deviation of an input that is used: scaled by less, its first change would swamp the net."""


@dataclass(frozen=True)
class Fit:
    """Fitted net of one group of joints."""

    layers: Layers
    """Weights for inputs in SI units; see `ActuatorNet.layers`."""
    training: tuple[float, ...]
    """Mean squared error of torque over limit on the training samples, while it was fitted, one entry an epoch [-]."""
    validation: tuple[float, ...]
    """The same on the validation samples after each epoch [-]; the last weights are used in any case."""


def fit_net(
    training: tuple[np.ndarray, np.ndarray],
    validation: tuple[np.ndarray, np.ndarray],
    cfg: ActuatorCfg,
    seed: int,
    progress: Callable[[float], None] = lambda share: None,
) -> Fit:
    """Fit one net to inputs, (M, 2 (H + 1)), in the order of `windows`, and torques over their limits, (M,).

    `validation`: the same of held-out runs; `seed`: of weights and order; `progress`: called with the share that is
    done.
    """
    inputs, torque = (torch.from_numpy(np.ascontiguousarray(part, np.float32)) for part in training)
    unseen, expected = (torch.from_numpy(np.ascontiguousarray(part, np.float32)) for part in validation)
    mean, deviation = inputs.mean(0), inputs.std(0).numpy()
    used = used_inputs(cfg.inputs, cfg.history) & (deviation > STD_FLOOR)
    # The maximum is for inputs that are left out: `where` computes both of its sides, and would divide by zero.
    scale = np.where(used, 1.0 / np.maximum(deviation, STD_FLOOR), 0.0)
    factor = torch.from_numpy(scale.astype(np.float32))
    inputs, unseen = (inputs - mean) * factor, (unseen - mean) * factor
    generator = torch.Generator().manual_seed(seed)
    parameters = _first_weights((inputs.shape[1], *cfg.hidden, 1), generator)
    optimizer = torch.optim.Adam(parameters, lr=cfg.learning_rate)
    batches = -(-len(inputs) // cfg.batch)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, cfg.epochs * batches)
    history: tuple[list[float], list[float]] = ([], [])
    for epoch in range(cfg.epochs):
        total = 0.0
        for rows in torch.randperm(len(inputs), generator=generator).split(cfg.batch):
            loss = torch.nn.functional.mse_loss(_forward(parameters, inputs[rows]), torque[rows])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            total += float(loss.detach()) * len(rows)
        with torch.no_grad():
            error = torch.nn.functional.mse_loss(_forward(parameters, unseen), expected)
        history[0].append(total / len(inputs))
        history[1].append(float(error))
        progress((epoch + 1) / cfg.epochs)
    return Fit(_in_si(parameters, mean.numpy(), scale), tuple(history[0]), tuple(history[1]))


def _first_weights(widths: tuple[int, ...], generator: torch.Generator) -> list[torch.Tensor]:
    """Return weights and biases in turn, uniform in ±1/sqrt(inputs)."""
    parameters = []
    for width, outputs in pairwise(widths):
        for shape in ((outputs, width), (outputs,)):
            value = (2 * torch.rand(shape, generator=generator) - 1) / width**0.5
            parameters.append(value.requires_grad_())
    return parameters


def _forward(parameters: list[torch.Tensor], inputs: torch.Tensor) -> torch.Tensor:
    """Return the outputs, shape (rows,), for inputs (rows, width)."""
    x = inputs
    for index in range(0, len(parameters), 2):
        x = torch.nn.functional.linear(x, parameters[index], parameters[index + 1])
        if index + 2 < len(parameters):
            x = torch.nn.functional.softsign(x)
    return x[:, 0]


def _in_si(parameters: list[torch.Tensor], mean: np.ndarray, scale: np.ndarray) -> Layers:
    """Return the layers with the inputs' centring and scaling moved into the first of them."""
    # In double precision: where an input hardly varies its weight is large, and the bias a difference of large numbers.
    arrays = [parameter.detach().double().numpy() for parameter in parameters]
    arrays[0] = arrays[0] * scale
    arrays[1] = arrays[1] - arrays[0] @ mean.astype(float)
    single = [array.astype(np.float32) for array in arrays]
    return tuple(zip(single[::2], single[1::2], strict=True))


Progress = Callable[[str, float], None]
"""Called with the name of the group of joints and the share of its epochs that is done."""

SHOWN = 3.0
"""Length of the piece of a run that the page draws [s]."""


@dataclass(frozen=True)
class TrainedActuator:
    """A net, its errors, and the curves of its page."""

    net: ActuatorNet
    summary: dict[str, Any]
    """Errors, by part, joint and command; configuration, and what made it."""
    fit: ActuatorFit


def train_actuator(
    runs: Sequence[LoggedRun], cfg: ActuatorCfg, command: str, progress: Progress = lambda name, share: None
) -> TrainedActuator:
    """Fit a net to runs of one kind of robot, of which a share is held out and measures it.

    `command`: the command line. Raises `StictionError` where runs do not agree, or there are fewer than two.
    """
    begun = time.perf_counter()
    check_runs(runs, cfg.history)
    training, validation = split_runs(runs, cfg.validation_share, cfg.seed)
    first = training[0]
    groups = weight_groups(first.joint_names, cfg.share)
    fits = _fit_groups(groups, training, validation, cfg, progress)
    net = _assemble(groups, fits, training, validation, cfg, command)
    gains = first.kp, first.kd, first.torque_limit
    baseline = fit_baseline(gains, [(*run.signals, run.torque) for run in training])
    summary = {
        "robot": net.robot,
        "inputs": net.inputs,
        "history": net.history,
        "period": net.period,
        "torque_source": net.torque_source,
        "groups": [list(group) for group in groups],
        "samples": {
            "training": sum(len(r.torque) for r in training),
            "validation": sum(len(r.torque) for r in validation),
        },
        **measure(net, baseline, training, validation),
        "loss": dict(net.loss),
        "training": dict(net.training),
        "validation": dict(net.validation),
        "config": asdict(cfg),
        "command": command,
        "revision": net.revision,
        "seconds": round(time.perf_counter() - begun, 2),
        "machine": machine(),
    }
    return TrainedActuator(net, summary, _curves(net, baseline, validation[0], fits))


def _fit_groups(
    groups: tuple[tuple[str, ...], ...],
    training: Sequence[LoggedRun],
    validation: Sequence[LoggedRun],
    cfg: ActuatorCfg,
    progress: Progress,
) -> list[Fit]:
    """Fit one perceptron to each group of joints; each has a seed of its own."""
    fits = []
    for group in groups:
        columns = [training[0].joint_names.index(name) for name in group]
        label = kind_of(group[0]) if cfg.share == "kind" else "all joints"
        parts = _samples(training, columns, cfg), _samples(validation, columns, cfg)
        fits.append(fit_net(*parts, cfg, stream_seed(cfg.seed, f"actuator {label}"), partial(progress, label)))
    return fits


def _assemble(
    groups: tuple[tuple[str, ...], ...],
    fits: Sequence[Fit],
    training: Sequence[LoggedRun],
    validation: Sequence[LoggedRun],
    cfg: ActuatorCfg,
    command: str,
) -> ActuatorNet:
    """Return the net with its record; losses weigh each joint alike."""
    first = training[0]
    sizes = np.array([len(group) for group in groups]) / len(first.joint_names)
    return ActuatorNet(
        robot=first.robot,
        joint_names=first.joint_names,
        torque_limit=tuple(first.torque_limit.tolist()),
        groups=groups,
        inputs=cfg.inputs,
        history=cfg.history,
        period=first.period,
        torque_source=first.torque_source,
        layers=tuple(fit.layers for fit in fits),
        training={run.name: run.sha256 for run in training},
        validation={run.name: run.sha256 for run in validation},
        loss={
            "training": float(sizes @ [fit.training[-1] for fit in fits]),
            "validation": float(sizes @ [fit.validation[-1] for fit in fits]),
        },
        seed=cfg.seed,
        revision=git_revision(),
        command=command,
    )


def _samples(runs: Sequence[LoggedRun], columns: list[int], cfg: ActuatorCfg) -> tuple[np.ndarray, np.ndarray]:
    """Return windows of some joints, (M, 2 (H + 1)), none across runs, and their torques over the limits, (M,)."""
    inputs, torque = [], []
    for run in runs:
        target, position, velocity = (signal[:, columns] for signal in run.signals)
        rows = windows(first_signal(cfg.inputs, target, position), velocity, cfg.history)
        inputs.append(rows.reshape(-1, rows.shape[-1]).astype(np.float32))
        torque.append((run.torque[cfg.history :, columns] / run.torque_limit[columns]).ravel().astype(np.float32))
    return np.concatenate(inputs), np.concatenate(torque)


def measure(
    net: ActuatorNet, baseline: Baseline, training: Sequence[LoggedRun], validation: Sequence[LoggedRun]
) -> dict[str, Any]:
    """Return root mean square errors of the torque, net and baseline on the same samples.

    `rmse`: part -> law -> error over the limit [-]; `joints`: joint -> in N m, and the baseline's f, B, λ; `commands`.
    """
    parts = {"training": list(training), "validation": list(validation)}
    squares = {part: [_squares(net, baseline, run) for run in runs] for part, runs in parts.items()}
    limit, laws = np.array(net.torque_limit), ("net", "baseline")

    def over_limit(errors: list[dict[str, np.ndarray]]) -> dict[str, float]:
        relative = {law: np.concatenate([run[law] / limit**2 for run in errors]) for law in laws}
        return {law: float(np.sqrt(values.mean())) for law, values in relative.items()}

    joints = {}
    for index, name in enumerate(net.joint_names):
        entry = {field: float(getattr(baseline, field)[index]) for field in ("coulomb", "viscous", "later")}
        for part, errors in squares.items():
            for law in laws:
                values = np.concatenate([run[law][:, index] for run in errors])
                entry[f"{law}_{part}"] = float(np.sqrt(values.mean()))
        joints[name] = entry
    commands: dict[str, dict[str, dict[str, float]]] = {}
    for part, runs in parts.items():
        for label in dict.fromkeys(run.command for run in runs):
            chosen = [item for item, run in zip(squares[part], runs, strict=True) if run.command == label]
            commands.setdefault(label or "not known", {})[part] = over_limit(chosen)
    rmse = {part: over_limit(errors) for part, errors in squares.items()}
    return {"rmse": rmse, "joints": joints, "commands": commands}


def _squares(net: ActuatorNet, baseline: Baseline, run: LoggedRun) -> dict[str, np.ndarray]:
    """Return the squared errors of both laws [N² m²], (T - H, J)."""
    torque = run.torque[net.history :]
    return {
        "net": (predict(net, *run.signals) - torque) ** 2,
        "baseline": (baseline.torque(*run.signals)[net.history :] - torque) ** 2,
    }


def _curves(net: ActuatorNet, baseline: Baseline, run: LoggedRun, fits: Sequence[Fit]) -> ActuatorFit:
    """Return the end of a run as measured and by both laws, and the losses."""
    # Counted from the end: the predictions lack the first `history` samples, and so all curves end together.
    cut = slice(-min(round(SHOWN / net.period), len(run.torque) - net.history), None)
    return ActuatorFit(
        time=(np.arange(len(run.torque)) * net.period)[cut],
        measured=run.torque[cut],
        net=predict(net, *run.signals)[cut],
        baseline=baseline.torque(*run.signals)[cut],
        loss_training=np.array([fit.training for fit in fits]),
        loss_validation=np.array([fit.validation for fit in fits]),
    )


def write_trained(folder: Path, trained: TrainedActuator) -> None:
    """Write `fit.npz`, `summary.json`, and last `actuator.npz`: where that is there, the others are too."""
    folder.mkdir(parents=True, exist_ok=True)
    write_arrays(folder / "fit.npz", trained.fit)
    write_summary(folder / "summary.json", trained.summary)
    write_actuator(folder / FILE, trained.net)
