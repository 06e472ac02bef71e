"""Folders of trainings, as far as overviews of them read."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from stiction.learning.config import StudentCfg, TeacherCfg, TrainCfg

CFG = TrainCfg(teacher=TeacherCfg(iterations=100), student=StudentCfg(iterations=50))
"""A training of two phases."""


def make_run(path: Path, rows: int = 0, cfg: TrainCfg = CFG, phase: str = "teacher", **header: Any) -> Path:
    """Write config.json and metrics.jsonl of a run, with reward 1, 2, 3, ... in its iterations."""
    path.mkdir(parents=True)
    config = {"revision": "a", "identified": None, "seed": cfg.seed, "config": asdict(cfg)} | header
    (path / "config.json").write_text(json.dumps(config))
    lines = [{"phase": phase, "iteration": n, "reward": float(n), "walk/falls": 0.5} for n in range(1, rows + 1)]
    (path / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path
