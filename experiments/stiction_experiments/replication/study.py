"""`stiction replicate`: the paper's comparison, and what a user would try, in other engines and on a virtual robot."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from stiction.core.effects import excludes, needs
from stiction.core.errors import ConfigurationError, StictionError, TrainingError, unknown_name
from stiction.core.records import make_folder
from stiction_experiments.lab.study import ParallelOptions, RedrawnOptions, Report, Study, Work

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from stiction.files.bundle import Bundle
    from stiction.joints.net import TorqueSource
    from stiction_experiments.friction.manifest import Run

DESCRIPTION = """The paper's comparison as one command, resumable: conventional, Actuator Net and friction-aware
training, the paper's other ways, and what a user would try; in other physics engines, on a virtual robot with joints of
its own, on flat ground and stairs. Each sentence of the paper gets a verdict with its numbers.

quick: the shipped policies, some ten minutes on two cores. One training seed a method: numbers, no verdicts. A
verdict takes several training seeds of every method that a sentence compares: give bundles or runs of each seed with
--policies, or --preset full, which trains what is missing first (days on two cores): three seeds or more of each
method on flat ground, and of two over stairs; none of an Actuator Net over stairs. A training
that fails is named and left out, and the exit status is 1. Stop it at any time: the same command goes on; a walk in
progress, or a bench of some minutes, is begun anew. Policies that observe their joints' friction are told what was
identified on the bench of each virtual robot, which is put there first: minutes for each robot and friction."""

EXPORTING = (
    *("evaluation/export.py", "evaluation/golden.py", "evaluation/rollout.py"),
    *("files/contract*.py", "files/golden.py", "files/observation.py"),
    *("task/config.py", "task/randomization.py", "learning/identity.py", "learning/models.py", "learning/run.py"),
    *("robots/*.py", "robots/shipped/*.json"),
)
"""Code that makes a bundle of a run."""

BENCH, NETS = "bench", "nets"
"""Folders, beside the runs, of the bench of the robot that training knows, and of the nets of its walks."""

ROBOT = "saturn_lite"
"""The paper's robot: engines are tried with it before anything is trained."""


@dataclass(frozen=True, kw_only=True)
class ReplicateOptions(ParallelOptions, RedrawnOptions):
    """Options of `stiction replicate`."""

    preset: Literal["quick", "full"] = "quick"
    """quick: few levels, episodes and robots, one training seed a method, no verdicts; full: all of them, and policies
    that are trained for it."""
    policies: tuple[Path, ...] = field(default=(), metadata=excludes("--runs"))
    """Bundles, names of shipped ones, or finished training runs; by default the shipped bundles (quick), or the runs
    of the experiment (full)."""
    runs: Path = field(default=Path("runs"), metadata=needs("--preset full"))
    """Folder of the training runs of the preset `full`, as `stiction study friction` has it."""
    parts: tuple[str, ...] = ()
    """Parts to walk: training, engines, robot, standing, causes, forward, stairs, stairs-robot, load, effort; by
    default all. Where --out has a report of more parts, that is refused."""
    num_robots: int | None = None
    """How many virtual robots, seeds from 1000; by default 2 (quick) or 8 (full), over stairs 16."""
    free: ClassVar[tuple[str, ...]] = ("parts",)
    """Options that do more of the same."""
    out: Path | None = None  # type: ignore[assignment]
    """By default stiction-replication-quick, or -full. Folder of results.csv, methods.csv, budget.csv, forward.csv,
    onsets.csv, following.csv, verdicts.csv, evidence.csv, summary.json, tables.md, figures, report.html, and a folder
    for each part, by which an interrupted command goes on."""
    plan: bool = field(default=False, metadata=needs("--preset full") | excludes(but=("--preset", "--runs")))
    """With --preset full: only say which trainings it takes, where each stands, its cost in minutes of one core, and
    what is missing in all; the walks come on top."""
    json: bool = False
    """Print the verdicts as JSON on standard output, and nothing else."""

    def __post_init__(self) -> None:
        """Raise `ConfigurationError` for a comparison without robots."""
        if self.num_robots is not None and self.num_robots < 1:
            raise ConfigurationError(f"--num-robots {self.num_robots}: expected at least 1")

    @property
    def folder(self) -> Path:
        """Where the comparison is written."""
        return self.out or Path(f"stiction-replication-{self.preset}")


def run(options: ReplicateOptions, work: Work) -> Report | int:
    """Walk the comparison and judge it; the exit status is 1 if a run could not be trained."""
    if options.plan:
        print_plan(options.runs)
        return 0
    from stiction.learning.identity import unrecorded_note
    from stiction.robots.catalog import find_robot
    from stiction_experiments.replication.page import report, warnings
    from stiction_experiments.replication.plan import parts_of
    from stiction_experiments.replication.run import check_engines, judge_again, replicate, unrecorded

    parts = parts_of(options.preset, options.num_robots)
    names = [part.name for part in parts]
    if unknown := [name for name in options.parts if name not in names]:
        raise ConfigurationError(unknown_name("part", unknown[0], names))
    parts = tuple(part for part in parts if part.name in (options.parts or names))
    if not options.judge_again:
        check_engines(parts, find_robot(ROBOT))
    out = work.begin()
    failed: dict[str, str] = {}
    if options.judge_again:
        result = judge_again(out, work.provenance)
    else:
        bundles, failed = find_policies(options, work)
        origin = work.provenance | {"preset": options.preset, "failed": failed}
        result = replicate(bundles, parts, out, work.jobs, work.progress, origin)
        for note in unrecorded_note(unrecorded(bundles)):
            work.say(note)

    for note in warnings(result):
        work.say(note)
    return replace(report(result), status=1 if failed else 0)


def find_policies(options: ReplicateOptions, work: Work) -> tuple[list[Bundle], dict[str, str]]:
    """Return the checked policies, and why others could not be trained."""
    from stiction.core.parallel import spread
    from stiction.deploy.check import check_for_simulation, record_notes
    from stiction.files.bundle import find_bundle, shipped_bundles

    folders = [find_bundle(path) for path in options.policies] or list(shipped_bundles().values())
    failed: dict[str, str] = {}
    if options.preset == "full" and not options.policies:
        folders, failed = train_all(options, work.jobs, work.progress, work.say)
    runs = [number for number, path in enumerate(folders) if (path / "checkpoints").is_dir()]
    tasks = [(folders[number], work.out) for number in runs]
    for done, (task, folder) in enumerate(spread(exported, tasks, work.jobs), start=1):
        folders[runs[task]] = folder
        work.progress("export", done / len(tasks))
    bundles = [check_for_simulation(folder) for folder in folders]
    for note in record_notes(bundles):
        work.say(note)
    return bundles, failed


def exported(run: Path, out: Path) -> Path:
    """Return the bundle of a training run, exported into `out` where it is not there yet: that takes some seconds."""
    from stiction.core.cache import key_of
    from stiction.evaluation.export import export_run
    from stiction.learning.run import RunDirectory

    directory = RunDirectory(run)
    directory.check_finished("student")
    key = key_of([directory.student_digest(), directory.walks_by()], *EXPORTING)
    folder = out / "bundles" / key[:12] / run.resolve().name
    if not folder.exists():
        make_folder(folder.parent)
        export_run(run, folder)
    return folder


def train_all(
    options: ReplicateOptions, jobs: int, progress: Callable[[str, float], None], say: Callable[[str], None]
) -> tuple[list[Path], dict[str, str]]:
    """Train everything that is missing; return the folders of the finished runs, and why the others are not finished.

    A run that fails does not stop the others: what is finished is walked. Raises `Stopped` at Ctrl-C.

    Raises:
        StictionError: no run is finished, or a folder holds another run.

    """
    from stiction_experiments.friction.planned import PlannedRun
    from stiction_experiments.friction.training import train
    from stiction_experiments.replication.plan import comparison_runs

    folders: list[Path] = []
    failed: dict[str, str] = {}

    def add(runs: Sequence[Run]) -> None:
        planned = [PlannedRun.of(run, options.runs) for run in runs]
        failed.update(train(planned, jobs, progress, say))
        folders.extend(run.path for run in planned if run.run.name not in failed)

    runs = options.runs.resolve()
    add(comparison_runs(known_joints(runs, jobs, progress)))
    add(loop_runs(runs, failed, jobs, progress))
    for name, reason in failed.items():
        say(f"{name} is left out: {reason}")
    if not folders:
        raise TrainingError(f"none of the {len(failed)} runs in {options.runs} could be trained; the reasons are above")
    return folders, failed


def loop_runs(runs: Path, failed: dict[str, str], jobs: int, progress: Callable[[str, float], None]) -> list[Run]:
    """Return the runs with an Actuator Net, and add to `failed` why one has no net: its f0 failed, or does not walk."""
    from stiction_experiments.replication.plan import ACTUATOR_RUNS, LOOP_SEEDS, actuator_run, first_policy

    trainings = []
    for seed, side in product(LOOP_SEEDS, ACTUATOR_RUNS):
        first, name = first_policy(seed), actuator_run(runs, seed, side).name
        if first in failed:
            failed[name] = f"{first} failed, whose walk its Actuator Net is of"
            continue
        try:
            trainings.append(actuator_run(known_net(runs, runs / first, side, jobs, progress), seed, side))
        except StictionError as error:
            failed[name] = str(error)
    return trainings


def known_joints(runs: Path, jobs: int, progress: Callable[[str, float], None]) -> Path:
    """Return the `joints.json` of the robot that training knows, identified on its bench where that is not done yet."""
    from stiction.evaluation.benches import identify_on_benches
    from stiction.robots.catalog import find_robot
    from stiction_experiments.replication.plan import known_bench

    identify_on_benches([known_bench(find_robot(ROBOT))], runs / BENCH, jobs, progress)
    return joints_file(runs)


def joints_file(runs: Path) -> Path:
    """Return where that file is, or will be."""
    from stiction.robots.catalog import find_robot
    from stiction.virtual.bench import JOINTS
    from stiction_experiments.replication.plan import known_bench

    return runs / BENCH / known_bench(find_robot(ROBOT)).label / JOINTS


def known_net(
    runs: Path, conventional: Path, torque_source: TorqueSource, jobs: int, progress: Callable[[str, float], None]
) -> Path:
    """Return the folder of the Actuator Net of that robot, fitted to its walks where that is not done yet.

    conventional: the run of f0, which walks; torque_source: where its joints' torque is measured.
    """
    from stiction.deploy.check import check_bundle
    from stiction.robots.catalog import find_robot
    from stiction_experiments.replication.net import WalkedNet, make_net
    from stiction_experiments.replication.plan import known_bench

    bench, policy = known_bench(find_robot(ROBOT)), check_bundle(exported(conventional, runs)).bundle
    walked = WalkedNet(bench.engine, bench.case, bench.spec, policy, torque_source)
    folder = runs / NETS / walked.label
    make_net(walked, folder, "stiction replicate --preset full", jobs, progress)
    return folder


def print_plan(runs: Path) -> None:
    """Print every training of the preset `full`, those with a net of walks that are not walked yet among them."""
    from stiction.robots.catalog import find_robot
    from stiction_experiments.friction.planned import PlannedRun, plan_lines
    from stiction_experiments.replication.net import net_label
    from stiction_experiments.replication.plan import (
        ACTUATOR_RUNS,
        LOOP_SEEDS,
        actuator_run,
        comparison_runs,
        first_policy,
        known_bench,
    )

    bench, folder = known_bench(find_robot(ROBOT)), runs.resolve()
    loop = [
        actuator_run(folder / NETS / net_label(bench, first_policy(seed), side), seed, side)
        for seed, side in product(LOOP_SEEDS, ACTUATOR_RUNS)
    ]
    planned = [PlannedRun.of(run, runs) for run in (*comparison_runs(joints_file(folder)), *loop)]
    print(*plan_lines(planned, [run.state() for run in planned]), sep="\n")


STUDY = Study(
    "the paper's comparison over engines and a virtual robot, a verdict a sentence; the same as `stiction replicate`",
    DESCRIPTION,
    ReplicateOptions,
    run,
    results=(
        *("results.csv", "methods.csv", "budget.csv", "forward.csv", "onsets.csv", "following.csv"),
        *("verdicts.csv", "evidence.csv", "budget.png", "needs.png"),
    ),
)


def main(arguments: list[str]) -> int:
    """Run the comparison as a verb of its own."""
    return STUDY.main(arguments, "replicate")
