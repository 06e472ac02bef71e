"""Where a run of the manifest stands: not begun, interrupted or finished; a folder of another run is refused."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from stiction.formats.actuator import ActuatorNet, read_actuator
from stiction.formats.errors import StictionError
from stiction.formats.metrics import read_metrics
from stiction.rma.checkpoint import latest_checkpoint
from stiction.rma.config import TrainCfg
from stiction.rma.run import RunDirectory
from stiction.transfer.experiment.manifest import Run

State = Literal["missing", "interrupted", "finished"]


MADE_BY = {"layers": None, "revision": None, "command": None}
"""Fields of an Actuator Net that are compared by value, or not at all."""


@dataclass(frozen=True)
class Place:
    """A run of the manifest, what it is to be, and the folder where it is or will be."""

    run: Run
    """The run."""
    cfg: TrainCfg
    """Its configuration, complete."""
    path: Path
    """Its folder."""

    @property
    def iterations(self) -> int:
        """Iterations of teacher and student together."""
        return self.cfg.teacher.iterations + self.cfg.student.iterations

    def done(self) -> int:
        """Return the iterations that its metrics have."""
        rows = read_metrics(self.path / "metrics.jsonl")
        if not rows:
            return 0
        before = self.cfg.teacher.iterations if rows[-1]["phase"] == "student" else 0
        return before + int(rows[-1]["iteration"])

    def state(self) -> State:
        """Return where the run stands.

        A configuration that was written before a field existed equals the manifest's when the field has its default. A
        `joints.json` and an Actuator Net are known by what is in them, and may have moved.

        Raises:
            StictionError: the folder holds a run with another configuration, joints or net, or one of the manifest's
                cannot be read.

        """
        if not (self.path / "config.json").exists():
            return "missing"
        run = RunDirectory(self.path)
        if other := [*differences(_pathless(run.config()), _pathless(self.cfg)), *self._other_files(run)]:
            raise StictionError(
                f"{self.path} holds another run than the manifest's: {', '.join(other)}; "
                "move it away, or name another folder with --runs"
            )
        newest = latest_checkpoint(self.path / "checkpoints", "student")
        last = newest is not None and int(newest.stem.rpartition("_")[2]) == self.cfg.student.iterations
        return "finished" if last and (self.path / "summary.json").is_file() else "interrupted"

    def _other_files(self, run: RunDirectory) -> list[str]:
        """Return in which of the files that a training starts from a run is another than the manifest's."""
        identified, joints = run.header()["identified"], self.cfg.joints
        found = identified["sha256"] if identified else None
        expected = None if joints is None else _digest(Path(joints))
        net = None if self.cfg.actuator is None else read_actuator(Path(self.cfg.actuator))
        other = differences(found, expected, "SHA-256 of joints")
        return other if _alike(run.actuator(), net) else [*other, f"actuator is another net than {self.cfg.actuator}"]


def _pathless(cfg: TrainCfg) -> TrainCfg:
    """Return a configuration without the paths of its files, which say nothing of what is in them."""
    return replace(cfg, joints=None, actuator=None)


def _digest(file: Path) -> str:
    """Return the SHA-256 of a file, as `stiction train` records it; raise `StictionError` where it cannot be read."""
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise StictionError(f"{file} cannot be read: {error}; expected the joints.json to train with") from error


def _alike(net: ActuatorNet | None, other: ActuatorNet | None) -> bool:
    """Say whether two nets are the same but for the command and the revision that made them."""
    if net is None or other is None:
        return net is other
    arrays, others = ([array for group in one.layers for layer in group for array in layer] for one in (net, other))
    same = len(arrays) == len(others) and all(map(np.array_equal, arrays, others))
    return same and vars(net) | MADE_BY == vars(other) | MADE_BY


def differences(found: Any, expected: Any, name: str = "") -> list[str]:
    """Return the fields in which two configurations differ, as `teacher.iterations is 3, expected 350`."""
    if is_dataclass(found) and is_dataclass(expected):
        nested = (
            differences(getattr(found, f.name), getattr(expected, f.name), f"{name}.{f.name}".lstrip("."))
            for f in fields(found)
        )
        return [text for texts in nested for text in texts]
    return [] if found == expected else [f"{name} is {found}, expected {expected}"]
