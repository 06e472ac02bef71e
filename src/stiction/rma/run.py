"""A run directory: config.json, metrics.jsonl, TensorBoard, checkpoints, summary.json."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from stiction.formats.configuration import from_plain, to_plain
from stiction.formats.errors import StictionError
from stiction.formats.metrics import read_metrics
from stiction.formats.reproducibility import git_revision, machine
from stiction.rma.checkpoint import write_json
from stiction.rma.config import TrainCfg


class RunDirectory:
    """The files of one training run."""

    def __init__(self, path: Path) -> None:
        """Name the run at `path`; nothing is read or written yet."""
        self.path = path
        self.checkpoints = path / "checkpoints"
        self.metrics = path / "metrics.jsonl"

    @classmethod
    def create(cls, path: Path, cfg: TrainCfg, command: str, identified: dict[str, Any] | None) -> RunDirectory:
        """Start a run in an empty or new folder. Raises `StictionError` where a run is there already."""
        if (path / "config.json").exists():
            raise StictionError(
                f"{path} holds a run already; resume it with --resume, or name another folder with --out"
            )
        run = cls(path)
        try:
            run.checkpoints.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StictionError(
                f"the run's folder {path} cannot be made: {error.strerror}; name another --out"
            ) from error
        header = {"command": command, "revision": git_revision(), "seed": cfg.seed, "identified": identified}
        write_json(path / "config.json", header | {"config": to_plain(cfg)})
        return run

    def header(self) -> dict[str, Any]:
        """Return config.json whole. Raises `StictionError` where it cannot be read."""
        file = self.path / "config.json"
        try:
            data = json.loads(file.read_text())
        except (OSError, ValueError) as error:
            raise StictionError(
                f"{file} cannot be read: {error}; expected a folder that `stiction train` made"
            ) from error
        if not isinstance(data, dict) or "config" not in data:
            raise StictionError(f"{file}: holds no 'config'; expected a folder that `stiction train` made")
        return data

    def config(self) -> TrainCfg:
        """Return the configuration the run was started with."""
        return from_plain(TrainCfg, self.header()["config"], str(self.path / "config.json"))

    def log(self, row: dict[str, Any]) -> None:
        """Append one iteration's figures."""
        with self.metrics.open("a") as file:
            file.write(json.dumps(row) + "\n")

    def rows(self) -> list[dict[str, Any]]:
        """Return the figures of every iteration so far."""
        return read_metrics(self.metrics)

    def resume(self) -> None:
        """Add the revision that continues the run to the one that began it, where they differ: `a1b2+c3d4`."""
        header, revision = self.header(), git_revision()
        if revision not in header["revision"].split("+"):
            write_json(self.path / "config.json", header | {"revision": f"{header['revision']}+{revision}"})

    def forget_after(self, phase: str, iteration: int) -> None:
        """Drop the figures of iterations that will be run again, and a last line that a kill cut off."""
        order = {"teacher": 0, "student": 1}
        kept = [row for row in self.rows() if (order[row["phase"]], row["iteration"]) <= (order[phase], iteration)]
        temporary = self.metrics.with_suffix(".tmp")
        temporary.write_text("".join(json.dumps(row) + "\n" for row in kept))
        temporary.replace(self.metrics)

    def finish(self, figures: dict[str, Any]) -> None:
        """Write summary.json: the last figures, what made them, and where."""
        header = {key: value for key, value in self.header().items() if key != "config"}
        write_json(self.path / "summary.json", header | figures | {"machine": machine()})
