"""Evaluates the finished runs, teacher and student, over friction; what was evaluated once is read from its file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

from stiction.formats.errors import StictionError
from stiction.formats.friction import has_coefficient
from stiction.formats.reproducibility import made_by
from stiction.formats.results import DIRECTIONS, ResultRow, read_results, write_results
from stiction.locomotion.friction import FrictionCfg
from stiction.rma.checkpoint import latest_checkpoint
from stiction.rma.config import TrainCfg
from stiction.transfer.evaluate import EvaluationCfg
from stiction.transfer.experiment.manifest import LEVEL
from stiction.transfer.experiment.places import Place
from stiction.transfer.kept import RUN_WALKING
from stiction.transfer.workers import spread

Who = Literal["teacher", "student"]

LEVELS = (0.0, 0.01, 0.05, 0.1, 0.12, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5)
"""Coulomb friction of the evaluation at nominal 0.2 [-]: none, the paper's 1 %, the mean of deception (0.12), the
nominal one, and beyond what was trained, so that the onset of every policy is in sight. In proportion where the nominal
level is another: a robot with twice the torque meets the same friction in N m."""

COEFFICIENTS = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.442)
"""Coefficients of the law `load` in the evaluation [-]."""

COMMANDS = {"student": (*DIRECTIONS, "wz=0.5", "stand"), "teacher": DIRECTIONS}
"""What is commanded. The teacher is there for comparison: what no verdict needs of it is left out."""

BASE = EvaluationCfg(LEVELS, DIRECTIONS, episodes=16, seconds=10.0)
"""The evaluation of a run at the experiment's level; commands by policy."""

DIGITS = 6
"""Significant digits that are kept: more than the episodes can tell, and the files stay small."""


def training_mean(friction: FrictionCfg) -> float:
    """Return the mean friction level of the last stage of training [-].

    Raises `StictionError` where the level is the robot's own, which differs from joint to joint.
    """
    if friction.level is None:
        raise StictionError("the run has the robot's own friction; expected one trained at a --friction-level")
    mixture = friction.last.mixture
    mean = sum(weight * (low + high) / 2 for weight, low, high in mixture) / sum(weight for weight, _, _ in mixture)
    return round(mean * friction.level, 6)


def settings_for(cfg: TrainCfg, base: EvaluationCfg = BASE) -> EvaluationCfg:
    """Return what the policies of a run are put through, under the friction law that they were trained with.

    The levels of `base` in proportion to the run's own, those of `COEFFICIENTS` where the level is a coefficient, and
    in both cases the mean of its training.
    """
    friction = cfg.task.friction
    levels: set[float] = set(COEFFICIENTS)
    if not has_coefficient(friction.law):
        levels = {round(level * (friction.level or 0.0) / LEVEL, 6) for level in base.friction_levels}
    settings = replace(base, friction_levels=tuple(sorted(levels | {training_mean(friction)})))
    return replace(
        settings,
        friction_law=friction.law,
        static_ratio=friction.static_ratio,
        stribeck_velocity=friction.stribeck_velocity,
    )


@dataclass(frozen=True)
class Task:
    """One policy to evaluate."""

    path: Path
    """Folder of its run."""
    who: Who
    """Which of the run's two policies."""
    settings: EvaluationCfg
    """What it is put through."""
    cache: Path
    """Folder in which its rows are kept."""

    @property
    def name(self) -> str:
        """Name of the policy in results.csv."""
        return f"{self.path.resolve().name}/{self.who}"

    @property
    def file(self) -> Path:
        """File of its rows, named after everything that they depend on: weights, settings and code.

        Raises `StictionError` where the run has no such policy.
        """
        checkpoint = latest_checkpoint(self.path / "checkpoints", self.who)
        if checkpoint is None:
            raise StictionError(f"{self.path} has no {self.who}; finish it with `stiction train --resume {self.path}`")
        digest = hashlib.sha256(checkpoint.read_bytes())
        digest.update(json.dumps(asdict(self.settings) | made_by(*RUN_WALKING), sort_keys=True).encode())
        return self.cache / f"{self.who}-{digest.hexdigest()[:16]}.csv"


def tasks_for(places: Sequence[Place], base: EvaluationCfg = BASE, cache: Path | None = None) -> list[Task]:
    """Return the policies of finished runs. `cache`: a folder for the rows; by default `evaluation` in each run's."""
    return [
        Task(
            place.path,
            who,
            replace(settings_for(place.cfg, base), commands=COMMANDS[who]),
            place.path / "evaluation" if cache is None else cache / place.run.name,
        )
        for place in places
        for who in get_args(Who)
    ]


def evaluate_task(task: Task) -> list[ResultRow]:
    """Evaluate one policy on one thread, unless its rows are there; return them."""
    file = task.file
    if not file.exists():
        import torch

        from stiction.transfer.run_evaluation import evaluate_run

        torch.set_num_threads(1)
        rows = [_rounded(row) for row in evaluate_run(task.path, task.who, task.settings)]
        file.parent.mkdir(parents=True, exist_ok=True)
        temporary = file.with_suffix(".tmp")
        write_results(temporary, rows)
        temporary.replace(file)
    return read_results(file)


def _rounded(row: ResultRow) -> ResultRow:
    """Return a row with `DIGITS` significant digits in every number."""
    numbers: dict[str, Any] = {name: value for name, value in asdict(row).items() if isinstance(value, float)}
    numbers = {name: float(f"{value:.{DIGITS}g}") for name, value in numbers.items()}
    return replace(row, **numbers)


def evaluate_tasks(
    tasks: Sequence[Task], jobs: int, progress: Callable[[str, float], None] = lambda name, share: None
) -> tuple[list[ResultRow], dict[str, str]]:
    """Evaluate policies, `jobs` at once; return the rows in the order of the tasks, and policy -> why it has none.

    Raises `StictionError` where a process was killed; what is evaluated by then is kept.
    """
    found: dict[str, list[ResultRow]] = {}
    failed: dict[str, str] = {}
    kept = [task for task in tasks if task.file.exists()]
    new = [task for task in tasks if task not in kept]
    for some, processes in ((kept, 1), (new, jobs)):
        for number, rows in spread(_rows_or_reason, [(task,) for task in some], processes):
            if isinstance(rows, str):
                failed[some[number].name] = rows
            else:
                found[some[number].name] = rows
            progress("evaluation", (len(found) + len(failed)) / len(tasks))
    return [row for task in tasks for row in found.get(task.name, [])], failed


def _rows_or_reason(task: Task) -> list[ResultRow] | str:
    try:
        return evaluate_task(task)
    except StictionError as error:
        return str(error)
