"""`stiction study friction`, and `study training`: trains, evaluates and judges training methods under dry friction."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Literal

from stiction.core.effects import excludes
from stiction.core.errors import FileError, TrainingError
from stiction_experiments.lab.study import ParallelOptions, RedrawnOptions, Report, Study, Work

DESCRIPTION = """The experiment on training with dry friction: every run of its manifest, and what follows from them.

`stiction study friction --train` trains what is missing, goes on with what was interrupted, and then evaluates;
without --train it evaluates what is finished. Stop it at any time: nothing is done twice. `stiction study training` is
the same.

Examples:
  stiction study friction --preset quick --parts cohort --train --runs runs --out friction
  stiction study friction --preset quick --parts cohort --runs runs --out friction"""


@dataclass(frozen=True, kw_only=True)
class FrictionOptions(ParallelOptions, RedrawnOptions):
    """Options of `stiction study friction`."""

    preset: Literal["two-phase", "quick", "full"] | None = None
    """How the runs are trained; by default `two-phase`, and of a plan both that and `quick`. `cohort`, `designs` and
    `methods` have presets of one phase, and no teacher, all other parts that of two."""
    runs: Path = Path("runs")
    """Folder of the training runs, one folder each."""
    policies: tuple[Path, ...] = ()
    """Folders of exported policies, one folder each, named like the runs: a student that has one is evaluated by it,
    and where its run is not in --runs there is no learning curve. The first folder that has one of its name counts.
    With --add those that --out has already, trained by the same code, are not evaluated again."""
    add: bool = False
    """Add to what --out has: results of runs that are not in --runs, but were in --runs when --out was written, stay.
    Trainings on several machines, or over several days, then make one experiment."""
    free: ClassVar[tuple[str, ...]] = ("train", "add", "plan", "parts", "cache")
    """Options that do more of the same, or say where from."""
    out: Path = Path("results/friction-training")
    """Folder of results.csv, intervals.csv, following.csv, curves.csv, learned.csv, summary.json, tables.md, figures,
    report.html."""
    parts: tuple[str, ...] = ()
    """Parts of the experiment: 1 to 6, gait, history, literal, and in one phase cohort, designs, methods; by default
    all that the preset has."""
    train: bool = False
    """First train what is missing."""
    cache: Path | None = None
    """Folder in which evaluations are kept; by default `evaluation` in each run's folder."""
    episodes: int = 16
    """Episodes per level and command."""
    seconds: float = 10.0
    """Length of an episode [s]; its first 2 s are not measured."""
    plan: bool = field(default=False, metadata=excludes(but=("--preset", "--runs", "--policies", "--parts")))
    """Only say what the experiment is made of: runs, seeds, where each stands, its cost in minutes of one core, and
    what is missing in all."""
    json: bool = False
    """Print the verdicts as JSON on standard output, and nothing else."""

    def __post_init__(self) -> None:
        """Set the preset of an experiment that is run; a plan without one covers both presets."""
        if self.preset is None and not self.plan:
            object.__setattr__(self, "preset", "two-phase")


def run(options: FrictionOptions, work: Work) -> Report | int:
    """Train, evaluate and judge; the exit status is 1 if a run could not be trained or evaluated."""
    from stiction.learning.identity import unrecorded_note
    from stiction_experiments.friction.assemble import assemble, judge_again, read_earlier, unwalked
    from stiction_experiments.friction.evaluation import BASE, evaluate_tasks, tasks_for
    from stiction_experiments.friction.manifest import TWO_PHASE, runs_of
    from stiction_experiments.friction.page import report
    from stiction_experiments.friction.planned import EVALUATED, PlannedRun, unrecorded
    from stiction_experiments.friction.training import train

    if options.judge_again:
        return report(judge_again(options.out, work.provenance))
    if strange := [folder for folder in options.policies if not folder.is_dir()]:
        raise FileError(f"there is no folder {strange[0]}; give that of the exported policies with --policies")
    if options.plan:
        plan(options, work)
        return 0
    preset = options.preset or TWO_PHASE
    planned = [PlannedRun.of(run, options.runs, options.policies) for run in runs_of(options.parts, preset)]
    # All of them, before anything is written: a folder may hold another run.
    states = [run.state() for run in planned]
    if not options.train and not {*EVALUATED} & {*states}:
        raise TrainingError(
            f"no run of the experiment in {options.runs} is finished; train them with --train, name their folder with "
            "--runs, or that of their policies with --policies"
        )
    before = read_earlier(options.out, preset) if options.add else None
    if before is not None:
        planned = unwalked(planned, states, before)
    work.begin()
    # Before anything is trained or walks: a policy that is another's stops all.
    for note in unrecorded_note(unrecorded(planned)):
        work.say(note)
    failed = train(planned, work.jobs, work.progress, work.say) if options.train else {}
    base = replace(BASE, episodes=options.episodes, seconds=options.seconds)
    finished = [run for run in planned if run.state() in EVALUATED]
    rows, unevaluated = evaluate_tasks(tasks_for(finished, base, options.cache), work.jobs, work.progress)
    failed |= unevaluated
    for name, reason in failed.items():
        work.say(f"{name}: {reason}")
    origin = work.provenance | {"failed": failed, "preset": preset}
    return replace(report(assemble(planned, rows, base, origin, before)), status=1 if failed else 0)


def plan(options: FrictionOptions, work: Work) -> None:
    """Print every run of a preset, or of both, with what it costs, and what is missing in all."""
    from stiction.learning.identity import unrecorded_note
    from stiction_experiments.friction.manifest import ONE_PHASE, TWO_PHASE, parts_of, runs_of
    from stiction_experiments.friction.planned import PlannedRun, own_files, plan_lines, unrecorded

    presets = (TWO_PHASE, ONE_PHASE) if options.preset is None else (options.preset,)
    asked = {preset: [part for part in options.parts if part in parts_of(preset)] for preset in presets}
    if {*options.parts} - {part for parts in asked.values() for part in parts}:
        runs_of(options.parts, presets[0])  # says which part nobody trains
    having = [preset for preset in presets if asked[preset] or not options.parts]
    runs = [run for preset in having for run in runs_of(asked[preset], preset)]
    planned = [PlannedRun.of(run, options.runs, options.policies) for run in runs]
    if len(having) > 1:
        planned = own_files(planned)
    # A policy that is another's stands for no run of the plan.
    for note in unrecorded_note(unrecorded(planned)):
        work.say(note)
    print(*plan_lines(planned, [run.state() for run in planned]), sep="\n")
    if not options.parts:
        if len(having) == 1:
            other = ONE_PHASE if having[0] == TWO_PHASE else TWO_PHASE
            parts = ", ".join(parts_of(other))
            print(f"{len(runs_of((), other))} more are those of --preset {other}: parts {parts}")
        print(
            "with an Actuator Net, at what a bench identified, and over stairs: stiction replicate --preset full --plan"
        )


STUDY = Study(
    "which training method works under joint friction, and at how much of it; a verdict a claim; the same as "
    "`stiction study training`",
    DESCRIPTION,
    FrictionOptions,
    run,
    results=(
        *("results.csv", "intervals.csv", "following.csv", "curves.csv", "learned.csv"),
        *("budget.png", "each.png", "learning.png"),
    ),
)
