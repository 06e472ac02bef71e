"""The logs that an Actuator Net is fitted to: read, checked against each other, split by run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stiction.core.errors import LogError, StictionError
from stiction.files.run_log import is_walk_log, log_digest, read_walk_log
from stiction.files.walk import LARGEST_JITTER
from stiction.identification.logs.opening import open_log

UNNAMED = "unnamed"


@dataclass(frozen=True)
class LoggedRun:
    """One run of one robot: T samples of J joints."""

    name: str
    sha256: str
    robot: str
    command: str
    """The velocity command, empty where the log does not say."""
    joint_names: tuple[str, ...]
    """In the order of every array."""
    period: float
    """Time between two samples [s]."""
    torque_source: str
    """`motor_side` or `output_side`."""
    kp: np.ndarray
    """Gains of the joint controllers [N m/rad], shape (J,)."""
    kd: np.ndarray
    """[N m s/rad], shape (J,)."""
    torque_limit: np.ndarray
    """[N m], shape (J,)."""
    target: np.ndarray
    """a [rad], shape (T, J)."""
    position: np.ndarray
    """θ [rad], shape (T, J)."""
    velocity: np.ndarray
    """θ' [rad/s], shape (T, J)."""
    torque: np.ndarray
    """τ [N m], shape (T, J)."""

    @property
    def signals(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Target, position and velocity."""
        return self.target, self.position, self.velocity


def read_run(path: Path) -> LoggedRun:
    """Read a walking log, or a canonical log of joints with its sidecar. Raises `StictionError` where signals lack."""
    return _from_walk(path) if is_walk_log(path) else _from_joints(path)


def _undeclared(path: Path, how: str) -> StictionError:
    """Return the error of a log that does not say where its torque was measured."""
    return StictionError(
        f"{path.name}: where the torque was measured is not declared, and decides whether the simulation keeps its own "
        f"joint friction; {how}"
    )


def _from_walk(path: Path) -> LoggedRun:
    """Read a walking log."""
    log = read_walk_log(path)
    header = log.header
    if header.torque_source is None:
        raise _undeclared(path, "declare it in the header's torque_source, or log with evaluate --log-torque")
    if log.joint_torque is None:
        raise LogError(f"{path.name}: no joint_torque; an Actuator Net is fitted to measured torque: log it")
    return LoggedRun(
        name=path.name,
        sha256=log_digest(path),
        robot=header.robot,
        command=header.command,
        joint_names=header.joint_names,
        period=header.period,
        torque_source=header.torque_source,
        kp=np.array(header.kp),
        kd=np.array(header.kd),
        torque_limit=np.array(header.torque_limit),
        target=log.joint_target,
        position=log.joint_position,
        velocity=log.joint_velocity,
        torque=log.joint_torque,
    )


def _from_joints(path: Path) -> LoggedRun:
    """Read a canonical log; all of its joints must have the four signals and their gains."""
    log = open_log(path)
    names = tuple(log.joints)
    settings: dict[str, list[float]] = {"kp": [], "kd": [], "torque_limit": []}
    columns: dict[str, list[np.ndarray]] = {"target": [], "position": [], "velocity": [], "torque": []}
    sides = set()
    for name, joint in log.joints.items():
        setup = log.setup_of(name)
        for key, values in settings.items():
            number = getattr(setup, key)
            if number is None:
                raise LogError(f"{path.name}: no {key} of joint {name!r}; name it in {path.stem}.json beside it")
            values.append(number)
        for key, arrays in columns.items():
            array = getattr(joint, key)
            if array is None:
                raise LogError(f"{path.name}: no {key} of joint {name!r}; an Actuator Net needs it: log it")
            arrays.append(array)
        sides.add(setup.torque_source)
    side = sides.pop() if len(sides) == 1 else None
    if side is None:
        raise _undeclared(path, f"declare one torque_source for all joints in {path.stem}.json beside it")
    return LoggedRun(
        name=path.name,
        sha256=log_digest(path),
        robot=UNNAMED,
        command="",
        joint_names=names,
        period=_period(path, log.time),
        torque_source=side,
        **{key: np.array(values, float) for key, values in settings.items()},
        **{key: np.stack(arrays, axis=-1) for key, arrays in columns.items()},
    )


def _period(path: Path, time: np.ndarray) -> float:
    """Return the time between two samples [s]; refuse stamps that do not run evenly."""
    steps = np.diff(time)
    # To the nanosecond: stamps carry rounding errors, and the periods of two logs are compared for equality.
    period = float(np.round(np.median(steps), 9)) if len(steps) else 0.0
    if not period > 0 or np.abs(steps / period - 1).max() > LARGEST_JITTER:
        raise LogError(
            f"{path.name}: its time does not run evenly; an Actuator Net's window is in samples: resample the log"
        )
    return period


def check_runs(runs: Sequence[LoggedRun], history: int) -> None:
    """Raise `StictionError` unless the runs are of one kind of robot, sampled and measured alike, and different."""
    first = runs[0]
    for run in runs[1:]:
        if run.joint_names != first.joint_names:
            raise LogError(f"{run.name} has other joints than {first.name}; one net is for one kind of robot")
        for what, unit in (("period", " s"), ("torque_source", ""), ("robot", "")):
            ours, theirs = getattr(run, what), getattr(first, what)
            if ours != theirs:
                raise LogError(
                    f"{run.name}: {what} {ours}{unit}, {first.name}: {theirs}{unit}; fit one net to logs that agree"
                )
        for what in ("kp", "kd", "torque_limit"):
            if not np.allclose(getattr(run, what), getattr(first, what)):
                raise LogError(f"{run.name} has another {what} than {first.name}; fit one net to logs that agree")
    for run in runs:
        if len(run.torque) <= 2 * history + 2:
            raise LogError(f"{run.name}: {len(run.torque)} samples for a history of {history}; log for longer")
    hashes = [run.sha256 for run in runs]
    if twice := [run.name for run in runs if hashes.count(run.sha256) > 1]:
        raise LogError(f"{twice[0]} is there twice; a run that is fitted and kept out would flatter the net")
    names = [run.name for run in runs]
    if len(set(names)) < len(names):
        raise LogError(f"two logs are called {max(names, key=names.count)!r}; give every run a file name of its own")


def split_runs(runs: Sequence[LoggedRun], share: float, seed: int) -> tuple[list[LoggedRun], list[LoggedRun]]:
    """Return the runs to fit and those held out: a share of whole runs, at least one of either."""
    if len(runs) < 2:
        raise LogError(f"{len(runs)} log: expected at least two runs, one of them to be kept out of the fit")
    # The split depends on names and seed, not on the order in which a shell listed the files.
    ordered = sorted(runs, key=lambda run: run.name)
    held_out = min(max(round(share * len(ordered)), 1), len(ordered) - 1)
    order = np.random.default_rng([seed, len(ordered)]).permutation(len(ordered))
    return [ordered[k] for k in sorted(order[held_out:])], [ordered[k] for k in sorted(order[:held_out])]
