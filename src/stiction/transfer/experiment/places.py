"""Where a run of the manifest stands: not begun, interrupted or finished; a folder of another run is refused."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal

from stiction.formats.errors import StictionError
from stiction.formats.metrics import read_metrics
from stiction.rma.checkpoint import latest_checkpoint
from stiction.rma.config import TrainCfg
from stiction.rma.run import RunDirectory
from stiction.transfer.experiment.manifest import Run

State = Literal["missing", "interrupted", "finished"]


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

        A configuration that was written before a field existed equals the manifest's when the field has its default.

        Raises:
            StictionError: the folder holds a run with another configuration.

        """
        if not (self.path / "config.json").exists():
            return "missing"
        found = RunDirectory(self.path).config()
        if found != self.cfg:
            raise StictionError(
                f"{self.path} holds another run than the manifest's: {', '.join(differences(found, self.cfg))}; "
                "move it away, or name another folder with --runs"
            )
        newest = latest_checkpoint(self.path / "checkpoints", "student")
        last = newest is not None and int(newest.stem.rpartition("_")[2]) == self.cfg.student.iterations
        return "finished" if last and (self.path / "summary.json").is_file() else "interrupted"


def differences(found: Any, expected: Any, name: str = "") -> list[str]:
    """Return the fields in which two configurations differ, as `teacher.iterations is 3, expected 350`."""
    if is_dataclass(found) and is_dataclass(expected):
        nested = (
            differences(getattr(found, f.name), getattr(expected, f.name), f"{name}.{f.name}".lstrip("."))
            for f in fields(found)
        )
        return [text for texts in nested for text in texts]
    return [] if found == expected else [f"{name} is {found}, expected {expected}"]
