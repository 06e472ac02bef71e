"""Does what the plan names and the folder lacks: trains, exports, logs, walks. Each step leaves a file.

    OUT/runs/NAME-sSEED       the training, resumable       OUT/policies/NAME-sSEED    its policy
    OUT/nets/NAME-sSEED       logs and Actuator Net          OUT/walks/PLACE/NAME       walks of all its seeds, a ledger

Trainings of one group run beside each other, walks of one step do.

What is committed is `ledger.csv` and the rows: `walks.csv`, `curves.csv`, `stairs.csv`, `gait.csv`, `lives.csv`,
`estimator.csv` and `profile.csv`, to which each step adds its own. Walks in the ledger are done, wherever their
policies are by now; a policy is trained where one of its walks is missing.
"""

from __future__ import annotations

import resource
import subprocess
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby, islice, takewhile
from operator import attrgetter
from pathlib import Path
from statistics import fmean
from typing import Any

from stiction.core.errors import StictionError, TrainingError
from stiction.core.isolation import isolated_environment, python_module
from stiction.core.lifeline import tied
from stiction.core.memory import check_memory
from stiction.core.parallel import spread
from stiction.core.provenance import THREADS_VARIABLE, Origin
from stiction.core.records import make_folder, read_rows, write_rows
from stiction.deploy.check import check_for_simulation
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.grid import GridCfg
from stiction.evaluation.run import Progress, walk_grid
from stiction.evaluation.summary import commands_for
from stiction.evaluation.table import rows_of
from stiction.files.bundle import Bundle
from stiction.files.results import read_metrics
from stiction.robots.catalog import find_robot
from stiction.virtual.cases import Case, parse_level
from stiction_experiments import PACKAGE
from stiction_experiments.paper.climbs import STAIRS, Stairs, climb, of_level
from stiction_experiments.paper.estimator import DRAWS, TABLE, draw_motor, estimate_rows, profile_rows
from stiction_experiments.paper.gaits import walk_gaits
from stiction_experiments.paper.lives import life_cfg, live
from stiction_experiments.paper.net import WalkedNet, make_net
from stiction_experiments.paper.plan import (
    COHORT,
    GAIT_WALKS,
    GAITS,
    GROUPS,
    LEVEL,
    PLACES,
    SECONDS,
    VIRTUAL,
    WORN,
    Place,
    Training,
    own_robot,
)
from stiction_experiments.paper.results import HALF, Learning
from stiction_experiments.paper.rows import walk_row

TRAINED = Path("results/following/policies")
"""Policies of the cohort that were trained before, as `coulomb20-cohort-NAME-sSEED`, in the working folder."""

REWARDS = "--task.rewards.own"
"""Option of reward terms that are named as modules."""

EVERY = 10
"""Iterations over which a point of a learning curve is the mean."""


TRAINING = 0.8e9
"""Memory of a training of 512 robots, with the process that starts it [B]."""


@dataclass(frozen=True)
class LedgerRow:
    """One step that was done; a row of ledger.csv."""

    step: str
    seconds: float | None
    """Processor time [s]; None of a step that was begun before and then interrupted."""
    revision: str


@dataclass(frozen=True)
class CurvePoint:
    """Ten iterations of a training; a row of curves.csv."""

    training: str
    seed: int
    iteration: int
    """Last of the ten."""
    tracking_error: float
    """Mean distance of velocity and command [m/s]."""
    forward_ratio: float
    """Speed over command, of robots that are told to walk forward [1]."""
    backward_ratio: float
    """The same backward [1]."""


@dataclass(frozen=True)
class Added:
    """Rows that a step adds to a file of the folder."""

    file: str
    rows: Sequence[Any]
    """Dataclasses of one kind."""
    key: tuple[str, ...]
    """Fields that identify a row: one of before with the same values is replaced."""
    form: str = ".4g"
    """Format of its numbers."""


@dataclass(frozen=True)
class Step:
    """One piece of work."""

    name: str
    """`train none-s10`, `walk physx none`."""
    do: Callable[[Progress], Added]
    product: Path | None = None
    """File that it makes beside its rows, without which it is not done."""
    begun: Path | None = None
    """File that is there from its begin on."""
    batch: str = ""
    """Name of the trainings that run beside each other; empty: nothing else runs meanwhile."""

    @property
    def made(self) -> bool:
        """True if what it makes is there."""
        return self.product is None or self.product.exists()


@dataclass(frozen=True)
class Attempt:
    """Outcome of a step that was tried."""

    added: Added | None = None
    seconds: float | None = None
    """Processor time [s]; None where it had been begun before."""
    failure: StictionError | None = None


def attempt(step: Step, progress: Progress = lambda name, share: None) -> Attempt:
    """Do a step; a failure is returned, so that those beside it are not lost."""
    fresh, before = step.begun is None or not step.begun.exists(), _processor_seconds()
    try:
        added = step.do(progress)
    except StictionError as failure:
        return Attempt(failure=failure)
    return Attempt(added, round(_processor_seconds() - before, 1) if fresh else None)


def policy_of(training: Training, seed: int, out: Path) -> Path:
    """Return the folder of a policy: where it was trained before, that of the cohort."""
    trained = TRAINED / f"coulomb20-cohort-{training.name}-s{seed}"
    return trained if training in COHORT and trained.is_dir() else out / "policies" / f"{training.name}-s{seed}"


def steps(out: Path, done: Collection[str] = (), jobs: int = 1) -> Iterator[Step]:
    """Yield every step whose result may be needed, in the order of the trainings' worth.

    Policies of a group walk together, place by place: a place tells something once all have walked there. A net is of
    walks of `none`, whose policies are made before.

    done: names of steps in the ledger; jobs: walks at once.
    """
    yield Step("estimate", partial(_estimate, out), out / "estimator.csv")
    rank = {place.name: number for number, place in enumerate(PLACES)}
    for number, group in enumerate(GROUPS):
        walks = [(name, training, walk) for training in group for name, walk in _walks(training, out, jobs)]
        missing = [each for each in walks if f"walk {each[0]} {each[1].name}" not in done]
        needed = dict.fromkeys(training for _, training, _ in missing)
        if number and any(training.net for training in needed):
            yield from _policies(COHORT[0], f"walkers of {number}", out)
        for training in needed:
            yield from _policies(training, f"group {number}", out)
        for name, training, walk in sorted(missing, key=lambda each: rank.get(each[0], len(rank))):
            folder = out / "walks" / name / training.name
            yield Step(f"walk {name} {training.name}", partial(_in_folder, folder, walk))


def _policies(training: Training, batch: str, out: Path) -> Iterator[Step]:
    """Yield the steps that make a training's policies, but for those that were trained before."""
    for seed in training.seeds:
        policy = policy_of(training, seed, out)
        if policy.parent != TRAINED:
            begun = out / "runs" / policy.name / "config.json"
            train = partial(_train, training, seed, out)
            yield Step(f"train {policy.name}", train, policy / "contract.json", begun, batch)


Walk = Callable[[Path, Progress], Added]
"""Walks in a folder, and returns the rows."""


def _walks(training: Training, out: Path, jobs: int) -> Iterator[tuple[str, Walk]]:
    """Yield each place in which a training walks, with the function that walks there."""
    for place in PLACES:
        if place.takes(training):
            yield place.name, partial(_walk, place, training, out, jobs)
    for stairs in STAIRS:
        if training.name in stairs.trainings:
            yield f"stairs-{stairs.name}", partial(_climb, stairs, training, out, jobs)
    if training.name in GAITS:
        yield "gait", partial(_measure_gait, training, out)
    if training.name in WORN:
        yield "lives", partial(_wear, training, out, jobs)


def _in_folder(folder: Path, walk: Walk, progress: Progress) -> Added:
    """Walk in a folder, which is made."""
    make_folder(folder)
    return walk(folder, progress)


def missing_steps(out: Path, jobs: int = 1) -> Iterator[Step]:
    """Yield the steps that are not done, each once, in the order of their worth; jobs: walks at once."""
    known = {row.step for row in read_rows(out / "ledger.csv", LedgerRow, optional=True)}
    every: dict[str, Step] = {}
    for step in steps(out, known, jobs):
        every.setdefault(step.name, step)
    yield from (step for step in every.values() if step.name not in known or not step.made)


def do_missing(out: Path, most: int, jobs: int, say: Callable[[str], None], progress: Progress) -> None:
    """Do at most so many steps that are missing; jobs: walks, or trainings, at once.

    Raises the first `StictionError` of a batch when all of it has ended; what was done stays.
    """
    revision = str(Origin.now(PACKAGE).provenance["revision"])
    todo = islice(missing_steps(out, jobs), most)
    for _, batch in groupby(todo, lambda step: step.batch or step.name):
        together = [*batch]
        say(", ".join(step.name for step in together))
        failures = []
        for number, came in _attempts(together, jobs, progress):
            if came.failure is not None or came.added is None:
                failures.append(came.failure)
                continue
            _add(out, came.added)
            _add(out, Added("ledger.csv", [LedgerRow(together[number].name, came.seconds, revision)], ("step",), ".9g"))
        if failures and failures[0] is not None:
            raise failures[0]


def _attempts(together: Sequence[Step], jobs: int, progress: Progress) -> Iterator[tuple[int, Attempt]]:
    """Yield the number of each step and what came of it, as it ends: of trainings beside each other."""
    if not together[0].batch:
        # In this process, which spreads the walks of a step.
        yield 0, attempt(together[0], lambda what, share: progress(f"{together[0].name}: {what}", share))
        return
    check_memory(min(jobs, len(together)) * TRAINING, f"{jobs} trainings at once", "ask for fewer --jobs")
    for count, came in enumerate(spread(attempt, [(step,) for step in together], jobs), 1):
        progress("trainings", count / len(together))
        yield came


def _processor_seconds() -> float:
    """Return the processor time of this process and of those that it waited for [s]."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def _program(words: Sequence[object], log: Path) -> None:
    """Run `stiction` on one thread; what it prints goes to a file. Raises `TrainingError` where it fails.

    A training whose parent ends goes on to the end of its iteration, and can be resumed.
    """
    environment = isolated_environment(**{THREADS_VARIABLE: "1"})
    with log.open("a") as file:
        command = python_module("stiction", words)
        status = subprocess.run(command, stdout=file, stderr=file, check=False, **tied(environment)).returncode
    if status:
        lines = log.read_text(errors="replace").strip().splitlines() or ["it printed nothing"]
        raise TrainingError(f"stiction {words[0]} ended with status {status}: {lines[-1]} (see {log})")


def _train(training: Training, seed: int, out: Path, _: Progress) -> Added:
    """Make the policy of one seed, or go on with it, and return its learning curve; the net comes first."""
    policy = policy_of(training, seed, out)
    run, net = out / "runs" / policy.name, out / "nets" / policy.name
    if training.net:
        _make_net(training, seed, net, out)
    run.mkdir(parents=True, exist_ok=True)
    words = [str(net) if word == "{net}" else word for word in training.words]
    preset = ["--preset", training.preset, "--video-every", "0"]
    begin: list[object] = ["train", *preset, *words, "--seed", seed, "--out", run]
    resume: list[object] = ["train", "--resume", run, *reward_words(words)]
    if not (run / "summary.json").exists():
        _program(resume if (run / "config.json").exists() else begin, run / "train.log")
    if not (policy / "contract.json").exists():
        _program(["export", run, "--out", policy], run / "train.log")
    metrics = [row for row in read_metrics(run / "metrics.jsonl") if row["phase"] == "teacher"]
    return Added("curves.csv", curve_points(training.name, seed, metrics), ("training", "seed"), ".9g")


def reward_words(words: Sequence[str]) -> list[str]:
    """Return the words of a training that `--resume` wants again: those that name reward terms."""
    if REWARDS not in words:
        return []
    first, *more = words[words.index(REWARDS) :]
    return [first, *takewhile(lambda word: not word.startswith("--"), more)]


def curve_points(training: str, seed: int, metrics: Sequence[Mapping[str, float]]) -> list[CurvePoint]:
    """Return the learning curve of a run: means over `EVERY` iterations."""
    names = ("walk/tracking_error", "walk/forward_ratio", "walk/backward_ratio")
    points = []
    for begin in range(0, len(metrics) - EVERY + 1, EVERY):
        part = metrics[begin : begin + EVERY]
        values = (round(sum(row[name] for row in part) / EVERY, 4) for name in names)
        points.append(CurvePoint(training, seed, begin + EVERY, *values))
    return points


def learnings(curves: Sequence[CurvePoint], ledger: Sequence[LedgerRow]) -> list[Learning]:
    """Return area, first steps and processor time of each training; its logs and net belong to it."""
    seconds = {row.step: row.seconds for row in ledger}
    each: dict[tuple[str, int], list[CurvePoint]] = {}
    for point in curves:
        each.setdefault((point.training, point.seed), []).append(point)
    return [
        Learning(
            *(name, seed, fmean(point.tracking_error for point in own)),
            next((p.iteration for p in own if p.forward_ratio >= HALF), own[-1].iteration + EVERY),
            seconds.get(f"train {name}-s{seed}"),
        )
        for (name, seed), own in each.items()
    ]


def _make_net(training: Training, seed: int, net: Path, out: Path) -> None:
    """Let `none` of the same seed walk on its virtual robots, and fit the Actuator Net to the logs."""
    walker = check_for_simulation(policy_of(COHORT[0], seed, out))
    first, *others = (
        Case(own_robot(seed + number), "all", parse_level(f"{LEVEL:g}")) for number in range(training.logged)
    )
    walked = WalkedNet("physx", first, find_robot("saturn_lite"), walker, commands=training.net, others=tuple(others))
    make_net(walked, net, f"stiction study paper --out {out}")


def _bundles(training: Training, out: Path) -> list[Bundle]:
    """Return the policies of a training, checked."""
    return [check_for_simulation(policy_of(training, seed, out)) for seed in training.seeds]


def _add(out: Path, added: Added) -> None:
    """Add rows to a file of the folder, in place of those of before with the same values of some fields."""
    path, key = out / added.file, attrgetter(*added.key)
    replaced = {key(row) for row in added.rows}
    before = [row for row in read_rows(path, type(added.rows[0]), optional=True) if key(row) not in replaced]
    write_rows(path, [*before, *added.rows], form=added.form)


def _walk(place: Place, training: Training, out: Path, jobs: int, folder: Path, progress: Progress) -> Added:
    """Walk all seeds of a training in one place, and return their rows."""
    bundles, rows = _bundles(training, out), []
    forward = place.forward and training.name == "none"
    for level in place.levels_of(training):
        cfg = _grid(place, level, bundles, forward)
        walks = walk_grid(bundles, cfg, folder / level, jobs, progress=partial(of_level, progress, level))
        for row in rows_of(walks, bundles)[0]:
            fed = "+measured" if "+measured" in row.policy else ""
            rows.append(walk_row(training.name + fed, place.name, level, row))
    return Added("walks.csv", rows, ("training", "place"))


def _climb(stairs: Stairs, training: Training, out: Path, jobs: int, folder: Path, progress: Progress) -> Added:
    """Let all seeds of a training cross stairs in one place, and return their rows."""
    rows = climb(training.name, _bundles(training, out), stairs, folder, jobs, progress)
    return Added("stairs.csv", rows, ("training", "place"))


def _measure_gait(training: Training, out: Path, _: Path, __: Progress) -> Added:
    """Measure the gait of all seeds of a training, and return their rows; nothing is kept in the folder."""
    return Added("gait.csv", walk_gaits(training.name, _bundles(training, out), SECONDS, GAIT_WALKS), ("training",))


def _wear(training: Training, out: Path, jobs: int, folder: Path, progress: Progress) -> Added:
    """Let robots wear under all seeds of a training, and return their lives."""
    policies = [policy_of(training, seed, out) for seed in training.seeds]
    return Added("lives.csv", live(training.name, policies, life_cfg(VIRTUAL), folder, jobs, progress), ("training",))


def _estimate(out: Path, _: Progress) -> Added:
    """Ask every estimator about every motor; the profile is a file of its own."""
    motors = [draw_motor(number) for number in range(len(TABLE) * DRAWS)]
    write_rows(out / "profile.csv", profile_rows(motors[0]), form=".4g")
    rows = [row for motor in motors for row in estimate_rows(motor)]
    return Added("estimator.csv", rows, ("draw", "estimator", "parameter"), ".6g")


def _grid(place: Place, level: str, bundles: list[Bundle], forward: bool) -> GridCfg:
    """Return what is walked in one place at one level."""
    names = tuple(bundle.name for bundle in bundles) if forward and level != "0" else ()
    base = EvaluationCfg((0.0,), commands_for(bundles), place.episodes, SECONDS)
    if place.robot is None:
        base = replace(base, friction_levels=(float(level),), friction_law=place.law)
        return GridCfg(base, (place.engine,), forward=names)
    return GridCfg(base, (place.engine,), robots=(place.robot,), robot_levels=(level,), forward=names)
