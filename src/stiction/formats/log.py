"""The canonical log of one or more joints: CSV, NPZ or Parquet, with an optional sidecar of what columns cannot say.

Columns are `time` [s] and, per joint, `position.<joint>` [rad], `velocity.<joint>` [rad/s], `target.<joint>` [rad],
`torque.<joint>` [N m], `disturbance.<joint>` [N m], those that exist; a log of a single joint may drop the joint's
name. The sidecar of `swing.csv` is `swing.json` (`stiction.formats.sidecar`). Nothing that executes code is ever read.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stiction.formats.errors import LogError
from stiction.formats.parquet import read_parquet, write_parquet
from stiction.formats.sidecar import LogSetup
from stiction.formats.tables import Columns, read_csv, read_npz, write_csv, write_npz

SIGNALS = ("position", "velocity", "target", "torque", "disturbance")
"""What a log may hold per joint."""

UNNAMED = "joint"
"""Name of a joint that neither the columns nor the user named."""


@dataclass(frozen=True)
class JointSignals:
    """The signals of one joint, each of shape (num_samples,); what was not logged is None."""

    position: np.ndarray | None = None
    """θ [rad]."""
    velocity: np.ndarray | None = None
    """θ' [rad/s]."""
    target: np.ndarray | None = None
    """a, the position asked for [rad]."""
    torque: np.ndarray | None = None
    """τ [N m]."""
    disturbance: np.ndarray | None = None
    """d, a known torque on the joint from outside, positive in the position's direction [N m]."""


@dataclass(frozen=True)
class Log:
    """A log as read: nothing resampled, nothing filtered."""

    source: str
    """Name of the file, for messages."""
    time: np.ndarray
    """Time stamps [s], shape (num_samples,)."""
    joints: dict[str, JointSignals]
    """Joint name -> signals."""
    setup: LogSetup = field(default_factory=LogSetup)
    """The sidecar's content."""
    notes: tuple[str, ...] = ()
    """What a reader of the results should know about how the file was read; each one sentence."""

    def joint(self, name: str | None) -> tuple[str, JointSignals]:
        """Return a joint by name, or the only one for None; raise `LogError` naming what there is."""
        if name is None and len(self.joints) == 1:
            return next(iter(self.joints.items()))
        if name is not None and name in self.joints:
            return name, self.joints[name]
        asked = "no joint was chosen" if name is None else f"no joint {name!r}"
        raise LogError(f"{self.source}: {asked}; the log has {', '.join(self.joints)}; choose one with --joint")

    def setup_of(self, joint: str) -> LogSetup:
        """Return the setup of one joint: the log's, then what the sidecar says of its kind, then of itself."""
        return self.setup.of_joint(joint)


def read_table(path: Path) -> tuple[Columns, tuple[str, ...]]:
    """Read the named columns of a CSV, NPZ or Parquet file, and notes on how that went. Raises `LogError`."""
    suffix = path.suffix.lower()
    if suffix == ".csv":
        return read_csv(path)
    if suffix == ".npz":
        return read_npz(path), ()
    if suffix == ".parquet":
        return read_parquet(path), ()
    raise LogError(f"{path.name}: unknown kind of table {path.suffix!r}; expected .csv, .npz or .parquet")


def by_joint(table: Columns, joint: str | None) -> dict[str, JointSignals]:
    """Group columns `position.<joint>` by joint; bare names belong to one joint, `joint` or `UNNAMED`."""
    found: dict[str, Columns] = {}
    for name, values in table.items():
        signal, dot, owner = name.partition(".")
        if signal in SIGNALS:
            found.setdefault(owner if dot and owner else (joint or UNNAMED), {})[signal] = values
    return {owner: JointSignals(**signals) for owner, signals in found.items()}


def write_log(path: Path, log: Log) -> None:
    """Write a log as CSV, NPZ or Parquet, by the name of the file, and its sidecar if there is anything to say."""
    writers = {".csv": write_csv, ".npz": write_npz, ".parquet": write_parquet}
    if path.suffix.lower() not in writers:
        raise LogError(f"{path.name}: cannot write {path.suffix!r}; expected .csv, .npz or .parquet")
    table = {"time": log.time}
    for joint, signals in log.joints.items():
        for name in SIGNALS:
            values = getattr(signals, name)
            if values is not None:
                table[f"{name}.{joint}"] = values
    path.parent.mkdir(parents=True, exist_ok=True)
    writers[path.suffix.lower()](path, table)
    setup = log.setup.to_dict()
    if setup:
        path.with_suffix(".json").write_text(json.dumps(setup, indent=2) + "\n", encoding="utf-8")


def listed(table: Columns) -> str:
    """Return the column names for a message, shortened if there are many."""
    names = list(table)
    return ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "")
