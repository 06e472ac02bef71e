"""Evaluates the finished runs, teacher and student, over friction; what was evaluated once is read from its file.

Candidate axes for the onset of a policy: friction over torque limit, f/τ_max; over the gain, f/kp, the dead band; over
what the first actions ask for, f/(kp · action scale · σ).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from stiction.core.cache import key_of
from stiction.core.errors import ConfigurationError, StictionError, TrainingError
from stiction.core.files import digest_of
from stiction.core.parallel import spread
from stiction.evaluation.evaluate import RUN_WALK_CODE, WALK_CODE, EvaluationCfg, evaluate_bundle
from stiction.evaluation.samples import SeedValues
from stiction.files.results import DIRECTIONS, FOLLOWS, ResultRow
from stiction.joints.friction import has_coefficient
from stiction.learning.config import TrainCfg
from stiction.learning.run import RunDirectory, latest_checkpoint
from stiction.task.friction import FrictionCfg
from stiction_experiments.friction.manifest import LEVEL, condition_of
from stiction_experiments.friction.planned import PlannedRun
from stiction_experiments.friction.records import STUDENT, CurvePoint
from stiction_experiments.lab.files import cached, entry_file
from stiction_experiments.methods import CODE

Who = Literal["teacher", "student"]

LEVELS = (0.0, 0.01, 0.05, 0.1, 0.12, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5)
"""Coulomb friction of the evaluation at nominal 0.2 [-]: none, the paper's 1 %, the mean of deception (0.12), the
nominal one, and beyond what was trained. In proportion where the nominal level is another: a robot with twice the
torque meets the same friction in N m."""

COEFFICIENTS = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.442)
"""Coefficients of the law `load` in the evaluation [-]."""

COMMANDS = {"student": (*DIRECTIONS, "wz=0.5", "stand"), "teacher": DIRECTIONS}
"""Commands of student and teacher. The teacher walks for comparison, with no more than a verdict needs."""

BASE = EvaluationCfg(LEVELS, DIRECTIONS, episodes=16, seconds=10.0)
"""The evaluation of a run at the experiment's level; commands by policy."""

DIGITS = 6
"""Significant digits of results."""


def training_mean(friction: FrictionCfg) -> float:
    """Return the mean friction level of the last stage of training [-].

    Raises `StictionError` where the level is the robot's own, which differs from joint to joint.
    """
    if friction.level is None:
        raise ConfigurationError("the run has the robot's own friction; expected one trained at a --friction-level")
    mixture = friction.last.mixture
    mean = sum(weight * (low + high) / 2 for weight, low, high in mixture) / sum(weight for weight, _, _ in mixture)
    return round(mean * friction.level, 6)


def settings_for(cfg: TrainCfg, base: EvaluationCfg = BASE) -> EvaluationCfg:
    """Return what the policies of a run are put through, under the friction law that they were trained with.

    The levels of `base` in proportion to the run's own, those of `COEFFICIENTS` where the level is a coefficient, and
    in both cases the mean of its training. Who observes its joints' friction is told what each robot has.
    """
    friction = cfg.task.friction
    levels: set[float] = set(COEFFICIENTS)
    if not has_coefficient(friction.law):
        levels = {round(level * (friction.level or 0.0) / LEVEL, 6) for level in base.friction_levels}
    return replace(
        base,
        friction_levels=tuple(sorted(levels | {training_mean(friction)})),
        friction_law=friction.law,
        static_ratio=friction.joint_law.static_ratio,
        stribeck_velocity=friction.joint_law.stribeck_velocity,
        known_friction="true" if cfg.task.known_friction else base.known_friction,
    )


@dataclass(frozen=True)
class Task:
    """One policy to evaluate."""

    run: PlannedRun
    who: Who
    settings: EvaluationCfg
    cache: Path
    exported: bool
    """True if the run's exported policy walks, instead of the network in its folder."""

    @property
    def name(self) -> str:
        """Name of the policy in results.csv."""
        return f"{self.run.run.name}/{self.who}"

    @property
    def key(self) -> str:
        """Return the cache key of its rows: a digest of the policy, the settings and the code.

        Raises `StictionError` where the run has no such policy.
        """
        code = WALK_CODE if self.exported else (*RUN_WALK_CODE, CODE, "stiction_experiments:lab/trained.py")
        return key_of([self._policy(), asdict(self.settings)], *code)

    @property
    def done(self) -> bool:
        """Return whether its rows are in the cache. Raises as `key`."""
        return entry_file(self.cache, self.who, self.key, ".json").exists()

    def _policy(self) -> Any:
        """Return what tells apart what walks: a bundle's digest; of a run that of the weights, and what it walks by."""
        if self.exported:
            return self.run.bundle().digest
        checkpoint = latest_checkpoint(self.run.path / "checkpoints", self.who)
        if checkpoint is None:
            path = self.run.path
            raise TrainingError(f"{path} has no {self.who}; finish it with `stiction train --resume {path}`")
        return [digest_of(checkpoint), RunDirectory(self.run.path).walks_by()]

    def walk(self) -> list[ResultRow]:
        """Return its rows, walked on this thread, by the network of its run or by the policy that was exported."""
        if self.exported:
            return list(evaluate_bundle(self.run.bundle(), self.settings).rows)
        import torch

        from stiction_experiments.lab.trained import walk_run

        torch.set_num_threads(1)
        return list(walk_run(self.run.path, self.who, self.settings).rows)


def tasks_for(planned: Sequence[PlannedRun], base: EvaluationCfg = BASE, cache: Path | None = None) -> list[Task]:
    """Return the policies of finished and exported runs, of one phase the student alone: no teacher walked in its
    training, and none is exported. A student whose policy is there walks by it: it is what is deployed.

    cache: a folder for the rows; by default `evaluation` in each run's.
    """
    tasks = []
    for run in planned:
        exported = run.state() == "exported"
        folder = run.path / "evaluation" if cache is None else cache / run.run.name
        for who in get_args(Who):
            if who == STUDENT or not (exported or run.cfg.teacher.latent == "history"):
                settings = replace(settings_for(run.cfg, base), commands=COMMANDS[who])
                tasks.append(Task(run, who, settings, folder, who == STUDENT and run.policy is not None))
    return tasks


def evaluate_task(task: Task) -> list[ResultRow]:
    """Evaluate one policy on one thread, unless its rows are there; return them."""

    def walk() -> dict[str, Any]:
        return {"rows": [asdict(_rounded(row)) for row in task.walk()]}

    rows = cached(task.cache, task.who, task.key, walk)["rows"]
    # A folder may be a link to one of another name; what walked is called as the manifest calls it.
    return [ResultRow(**row | {"policy": task.name}) for row in rows]


def _rounded(row: ResultRow) -> ResultRow:
    """Return a row with `DIGITS` significant digits in every number."""
    numbers: dict[str, Any] = {
        name: float(f"{value:.{DIGITS}g}") for name, value in asdict(row).items() if isinstance(value, float)
    }
    return replace(row, **numbers)


def evaluate_tasks(
    tasks: Sequence[Task], jobs: int, progress: Callable[[str, float], None] = lambda name, share: None
) -> tuple[list[ResultRow], dict[str, str]]:
    """Evaluate policies, `jobs` at once; return the rows in the order of the tasks, and policy -> why it has none.

    Raises `StictionError` where a process was killed; what is evaluated by then is kept.
    """
    results: dict[str, list[ResultRow]] = {}
    failed: dict[str, str] = {}
    done = [task for task in tasks if _is_done(task)]
    new = [task for task in tasks if task not in done]
    # Those that are done are only read, for which no process is worth its start.
    for some, processes in ((done, 1), (new, jobs)):
        for number, rows in spread(_rows_or_reason, [(task,) for task in some], processes):
            if isinstance(rows, str):
                failed[some[number].name] = rows
            else:
                results[some[number].name] = rows
            progress("evaluation", (len(results) + len(failed)) / len(tasks))
    return [row for task in tasks for row in results.get(task.name, [])], failed


def _is_done(task: Task) -> bool:
    """Return whether a task is done; one that cannot tell, for want of a checkpoint, is not, and says why later."""
    try:
        return task.done
    except TrainingError:
        return False


def _rows_or_reason(task: Task) -> list[ResultRow] | str:
    try:
        return evaluate_task(task)
    except StictionError as error:
        return str(error)


WINDOW = 10
"""Iterations that are averaged: 240 control steps of 512 robots."""

FORWARD, BACKWARD = "walk/forward_ratio", "walk/backward_ratio"


def learning_curve(run: str, rows: Sequence[dict[str, Any]]) -> list[CurvePoint]:
    """Return the speed ratios of a run, means of `WINDOW` iterations; a rest that is shorter is left out.

    rows: the lines of its metrics.jsonl.
    """
    points = []
    for phase in ("teacher", "student"):
        own = [row for row in rows if row["phase"] == phase]
        for end in range(WINDOW, len(own) + 1, WINDOW):
            part = own[end - WINDOW : end]
            forward, backward = (float(np.mean([row[name] for row in part])) for name in (FORWARD, BACKWARD))
            points.append(CurvePoint(run, phase, int(part[-1]["iteration"]), forward, backward))
    return points


def iterations_by_seed(condition: str, curves: Mapping[str, Sequence[CurvePoint]]) -> tuple[SeedValues, int]:
    """Return the iterations of every seed of a condition until it walks both ways, and how many seeds never do.

    A teacher walks from the speed ratio on from which a policy is not too slow. A run that never walks counts as its
    whole first phase, which is less than the truth. curves: run -> its learning curve.
    """
    iterations: SeedValues = {}
    never = 0
    for (name, seed), run in sorted((condition_of(run), run) for run in curves):
        first = [point for point in curves[run] if point.phase == "teacher"]
        if name == condition and first:
            walks = (p.iteration for p in first if min(p.forward_ratio, p.backward_ratio) >= FOLLOWS[0])
            begin = next(walks, None)
            iterations[seed] = float(first[-1].iteration if begin is None else begin)
            never += begin is None
    return iterations, never
