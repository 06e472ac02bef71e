"""Made-up results of the experiment: rows with given speed ratios, learning curves, finished runs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from stiction.files.results import ResultRow
from stiction.learning.arguments import parse
from stiction_experiments.friction.manifest import Condition, Run
from stiction_experiments.friction.planned import PlannedRun
from stiction_experiments.friction.records import CurvePoint


def row(policy: str, level: float, command: str, ratio: float | None, **columns: Any) -> ResultRow:
    """A row of results.csv; the seed is read from the policy's name."""
    defaults: dict[str, Any] = {
        "method": "direct",
        "seed": int(policy.partition("/")[0].rpartition("-s")[2]),
        "engine": "mujoco",
        "friction_law": "coulomb",
        "terrain": "flat",
        "tracking_error": 0.05,
        "fall_rate": 0.0,
        "distance": 4.0,
        "steps_climbed": None,
        "cost_of_transport": 0.5,
        "joint_jitter": 80.0,
        "tripod_share": 0.9,
        "flight_share": 0.0,
        "episodes": 16,
    }
    return ResultRow(policy=policy, friction_level=level, command=command, speed_ratio=ratio, **{**defaults, **columns})


def condition_rows(
    condition: str,
    ratios: Mapping[float, Sequence[float]],
    who: str = "student",
    backward: float = 1.0,
    **columns: Any,
) -> list[ResultRow]:
    """Rows of a condition: level -> forward speed ratio of seed 0, 1, ...; backward that times `backward`."""
    return [
        row(f"{condition}-s{seed}/{who}", level, command, ratio * factor, **columns)
        for level, values in ratios.items()
        for seed, ratio in enumerate(values)
        for command, factor in (("vx=0.5", 1.0), ("vx=-0.5", backward))
    ]


def curve(run: str, walks_at: int, iterations: int = 350) -> list[CurvePoint]:
    """A teacher that stands until it walks, every ten iterations."""
    return [
        CurvePoint(run, "teacher", end, *(2 * [0.9 if end >= walks_at else 0.1]))
        for end in range(10, iterations + 1, 10)
    ]


def place(folder: Path, name: str = "toy", seed: int = 0, *options: str) -> PlannedRun:
    """A run of a made-up condition with one iteration in each phase."""
    words = ("--teacher.iterations", "1", "--student.iterations", "1", *options)
    run = Run(Condition(name, "1", "a test", words, (seed,)), seed)
    return PlannedRun(run, parse([*run.arguments]).config, folder / run.name)


def run_files(at: PlannedRun) -> dict[str, str]:
    """File -> text of what a finished run leaves, as far as the experiment looks at it."""
    header = {"command": "stiction train", "revision": "abc", "seed": at.run.seed, "identified": None}
    phases = [{"phase": phase, "iteration": 1, "seconds": 30.0} for phase in ("teacher", "student")]
    walks = {"walk/forward_ratio": 0.5, "walk/backward_ratio": 0.5}
    return {
        "config.json": json.dumps(header | {"config": asdict(at.cfg)}),
        "metrics.jsonl": "".join(json.dumps(phase | walks) + "\n" for phase in phases),
        "checkpoints/student_000001.safetensors": "weights",
        "checkpoints/student_000001.json": "{}",
        "summary.json": "{}",
    }


def write_run(at: PlannedRun, *leave_out: str) -> None:
    """Write those files, some left out."""
    for name, text in run_files(at).items():
        if name not in leave_out:
            file = at.path / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)
