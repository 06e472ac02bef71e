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

from stiction.core.errors import TrainingError
from stiction.core.isolation import isolated_environment, python_module
from stiction.core.lifeline import tied
from stiction.core.parallel import spread
from stiction.core.provenance import THREADS_VARIABLE, Origin
from stiction.core.records import make_folder, read_rows, write_rows
from stiction.deploy.check import check_for_simulation
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.grid import GridCfg
from stiction.evaluation.run import walk_grid
from stiction.evaluation.summary import commands_for
from stiction.evaluation.table import rows_of
from stiction.files.bundle import Bundle
from stiction.files.results import read_metrics
from stiction.robots.catalog import find_robot
from stiction.virtual.cases import Case, parse_level
from stiction_experiments import PACKAGE
from stiction_experiments.paper.climbs import STAIRS, Stairs, climb
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
from stiction_experiments.paper.results import Learning
from stiction_experiments.paper.rows import walk_row

TRAINED = Path("results/following/policies")
"""Policies of the cohort that were trained before, as `coulomb20-cohort-NAME-sSEED`, in the working folder."""

REWARDS = "--task.rewards.own"
"""Option of reward terms that are named as modules."""

EVERY = 10
"""Iterations over which a point of a learning curve is the mean."""


Progress = Callable[[str, float], None]
"""Called with what is in work and the share of it that is done."""


def no_progress(name: str, share: float) -> None:
    """Ignore progress."""


@dataclass(frozen=True)
class LedgerRow:
    """One step that was done; a row of ledger.csv."""

    step: str
    seconds: float
    """Processor time [s]."""
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
    same: tuple[str, ...]
    """Fields by whose values they replace rows of before."""
    form: str = ".4g"


@dataclass(frozen=True)
class Step:
    """One piece of work."""

    name: str
    """`train none-s10`, `walk physx none`."""
    do: Callable[[], Added | None]
    product: Path | None = None
    """File that it makes beside its rows, without which it is not done."""
    alone: bool = True
    """False of a training: others may run beside it."""

    @property
    def made(self) -> bool:
        """True if what it makes is there."""
        return self.product is None or self.product.exists()

    def timed(self) -> tuple[Added | None, float]:
        """Do it, and return what it adds, and its processor time [s]."""
        before = _processor_seconds()
        return self.do(), _processor_seconds() - before


def policy_of(training: Training, seed: int, out: Path) -> Path:
    """Return the folder of a policy: where it was trained before, that of the cohort."""
    trained = TRAINED / f"coulomb20-cohort-{training.name}-s{seed}"
    return trained if training in COHORT and trained.is_dir() else out / "policies" / f"{training.name}-s{seed}"


def steps(out: Path, done: Collection[str] = (), jobs: int = 1, progress: Progress = no_progress) -> Iterator[Step]:
    """Yield every step whose result may be needed, in the order of the trainings' worth.

    Policies of a group walk together, place by place: a place tells something once all have walked there.

    done: names of steps in the ledger; jobs: walks at once; progress: of the walks.
    """
    yield Step("estimate", partial(_estimate, out), out / "estimator.csv")
    rank = {place.name: number for number, place in enumerate(PLACES)}
    for group in GROUPS:
        walks = [(name, training, walk) for training in group for name, walk in _walks(training, out, jobs, progress)]
        missing = [each for each in walks if f"walk {each[0]} {each[1].name}" not in done]
        for training in dict.fromkeys(training for _, training, _ in missing):
            for seed in training.seeds:
                policy = policy_of(training, seed, out)
                if policy.parent != TRAINED:
                    train = partial(_train, training, seed, out)
                    yield Step(f"train {policy.name}", train, policy / "contract.json", alone=False)
        for name, training, walk in sorted(missing, key=lambda each: rank.get(each[0], len(rank))):
            folder = out / "walks" / name / training.name
            yield Step(f"walk {name} {training.name}", partial(_in_folder, folder, walk))


def _walks(
    training: Training, out: Path, jobs: int, progress: Progress
) -> Iterator[tuple[str, Callable[[Path], Added]]]:
    """Yield each place in which a training walks, with the function that walks there and returns its rows."""
    for place in PLACES:
        if place.takes(training):
            yield place.name, partial(_walk, place, training, out, jobs, progress)
    for stairs in STAIRS:
        if training.name in stairs.trainings:
            yield f"stairs-{stairs.name}", partial(_climb, stairs, training, out, jobs, progress)
    if training.name in GAITS:
        yield "gait", partial(_measure_gait, training, out)
    if training.name in WORN:
        yield "lives", partial(_wear, training, out, jobs, progress)


def _in_folder(folder: Path, walk: Callable[[Path], Added]) -> Added:
    """Walk in a folder, which is made."""
    make_folder(folder)
    return walk(folder)


def missing_steps(out: Path, jobs: int = 1, progress: Progress = no_progress) -> Iterator[Step]:
    """Yield the steps that are not done, in the order of their worth; arguments as of `steps`."""
    known = {row.step for row in read_rows(out / "ledger.csv", LedgerRow, optional=True)}
    yield from (step for step in steps(out, known, jobs, progress) if step.name not in known or not step.made)


def do_missing(out: Path, most: int, jobs: int, say: Callable[[str], None], progress: Progress = no_progress) -> None:
    """Do at most so many steps that are missing; jobs: walks, or trainings, at once.

    Raises `StictionError` at the first that fails; what was done before stays.
    """
    revision = str(Origin.now(PACKAGE).provenance["revision"])
    for name, group in groupby(
        islice(missing_steps(out, jobs, progress), most), lambda step: step.name if step.alone else ""
    ):
        together = [*group]
        say(name or ", ".join(step.name for step in together))
        ended = spread(Step.timed, [(step,) for step in together], jobs)
        for count, (number, (added, seconds)) in enumerate(ended, 1):
            if added is not None:
                _add(out, added)
            row = LedgerRow(together[number].name, round(seconds, 1), revision)
            _add(out, Added("ledger.csv", [row], ("step",), ".9g"))
            if not name:
                progress("trainings", count / len(together))


def _processor_seconds() -> float:
    """Return the processor time of this process and of those that it waited for [s]."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def _program(words: Sequence[object], log: Path) -> None:
    """Run `stiction` on one thread; what it prints goes to a file. Raises `TrainingError` where it fails."""
    environment = isolated_environment(**{THREADS_VARIABLE: "1"})
    with log.open("a") as file:
        command = python_module("stiction", words)
        status = subprocess.run(command, stdout=file, stderr=file, check=False, **tied(environment)).returncode
    if status:
        lines = log.read_text(errors="replace").strip().splitlines() or ["it printed nothing"]
        raise TrainingError(f"stiction {words[0]} ended with status {status}: {lines[-1]} (see {log})")


def _train(training: Training, seed: int, out: Path) -> Added:
    """Make the policy of one seed, or go on with it, and return its learning curve; the net comes first."""
    name = f"{training.name}-s{seed}"
    run, net = out / "runs" / name, out / "nets" / name
    if training.net and not (net / "actuator.npz").exists():
        _make_net(training, seed, net, out)
    run.mkdir(parents=True, exist_ok=True)
    words = [str(net) if word == "{net}" else word for word in training.words]
    preset = ["--preset", training.preset, "--video-every", "0"]
    begin: list[object] = ["train", *preset, *words, "--seed", seed, "--out", run]
    resume: list[object] = ["train", "--resume", run, *reward_words(words)]
    if not (run / "summary.json").exists():
        _program(resume if (run / "config.json").exists() else begin, run / "train.log")
    _program(["export", run, "--out", policy_of(training, seed, out)], run / "train.log")
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
    """Return area and processor time of each training; its logs and net belong to it."""
    seconds = {row.step: row.seconds for row in ledger}
    areas: dict[tuple[str, int], list[float]] = {}
    for point in curves:
        areas.setdefault((point.training, point.seed), []).append(point.tracking_error)
    return [Learning(*key, fmean(own), seconds.get(f"train {key[0]}-s{key[1]}")) for key, own in areas.items()]


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
    path, key = out / added.file, attrgetter(*added.same)
    replaced = {key(row) for row in added.rows}
    before = [row for row in read_rows(path, type(added.rows[0]), optional=True) if key(row) not in replaced]
    write_rows(path, [*before, *added.rows], form=added.form)


def _walk(place: Place, training: Training, out: Path, jobs: int, progress: Progress, folder: Path) -> Added:
    """Walk all seeds of a training in one place, and return their rows."""
    bundles, rows = _bundles(training, out), []
    forward = place.forward and training.name == "none"
    for level in place.levels:
        cfg = _grid(place, level, bundles, forward)
        walks = walk_grid(bundles, cfg, folder / level, jobs, progress=partial(_of_level, progress, level))
        for row in rows_of(walks, bundles)[0]:
            fed = "+measured" if "+measured" in row.policy else ""
            rows.append(walk_row(training.name + fed, place.name, level, row))
    return Added("walks.csv", rows, ("training", "place"))


def _of_level(progress: Progress, level: str, engine: str, share: float) -> None:
    """Say how far the walks under one friction are."""
    progress(f"{engine}, friction {level}", share)


def _climb(stairs: Stairs, training: Training, out: Path, jobs: int, progress: Progress, folder: Path) -> Added:
    """Let all seeds of a training cross stairs in one place, and return their rows."""
    rows = climb(training.name, _bundles(training, out), stairs, folder, jobs, progress)
    return Added("stairs.csv", rows, ("training", "place"))


def _measure_gait(training: Training, out: Path, _: Path) -> Added:
    """Measure the gait of all seeds of a training, and return their rows; nothing is kept in the folder."""
    return Added("gait.csv", walk_gaits(training.name, _bundles(training, out), SECONDS, GAIT_WALKS), ("training",))


def _wear(training: Training, out: Path, jobs: int, progress: Progress, folder: Path) -> Added:
    """Let robots wear under all seeds of a training, and return their lives."""
    policies = [policy_of(training, seed, out) for seed in training.seeds]
    return Added("lives.csv", live(training.name, policies, life_cfg(VIRTUAL), folder, jobs, progress), ("training",))


def _estimate(out: Path) -> None:
    """Ask every estimator about every motor, and write the rows; the profile first, for the other file is the mark."""
    motors = [draw_motor(number) for number in range(len(TABLE) * DRAWS)]
    write_rows(out / "profile.csv", profile_rows(motors[0]), form=".4g")
    write_rows(out / "estimator.csv", [row for motor in motors for row in estimate_rows(motor)], form=".6g")


def _grid(place: Place, level: str, bundles: list[Bundle], forward: bool) -> GridCfg:
    """Return what is walked in one place at one level."""
    names = tuple(bundle.name for bundle in bundles) if forward and level != "0" else ()
    base = EvaluationCfg((0.0,), commands_for(bundles), place.episodes, SECONDS)
    if place.robot is None:
        base = replace(base, friction_levels=(float(level),), friction_law=place.law)
        return GridCfg(base, (place.engine,), forward=names)
    return GridCfg(base, (place.engine,), robots=(place.robot,), robot_levels=(level,), forward=names)
