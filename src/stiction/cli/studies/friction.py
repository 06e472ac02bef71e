"""`stiction study friction`: trains, evaluates and judges the ways to train with dry friction."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from stiction.cli.jobs import jobs_of
from stiction.formats.errors import StictionError

if TYPE_CHECKING:
    from stiction.formats.experiment import Experiment
    from stiction.transfer.experiment.places import Place

DESCRIPTION = """The experiment on training with dry friction: every run of its manifest, and what follows from them.

`stiction study friction --train` trains what is missing, goes on with what was interrupted, and then evaluates;
without --train it evaluates what is finished. Stop it at any time: nothing is done twice."""


@dataclass(frozen=True)
class FrictionStudy:
    """Options of `stiction study friction`."""

    runs: Path = Path("runs")
    """Folder of the training runs, one folder each."""
    out: Path = Path("results/friction-training")
    """Folder of results.csv, intervals.csv, following.csv, curves.csv, summary.json, tables.md, figures,
    report.html."""
    parts: tuple[str, ...] = ()
    """Parts of the experiment: 1 to 6, gait, history; all of them by default."""
    train: bool = False
    """First train what is missing."""
    jobs: int | None = None
    """Runs, or evaluations, at once, each on one thread; by default as many as there are cores (STICTION_THREADS)."""
    cache: Path | None = None
    """Folder in which evaluations are kept; by default `evaluation` in each run's folder."""
    episodes: int = 16
    """Episodes per level and command."""
    seconds: float = 10.0
    """Length of an episode [s]; its first 2 s are not measured."""
    judge_again: bool = False
    """Train and evaluate nothing: judge what --out has by today's criteria, and draw its page anew."""
    advice: Path | None = None
    """Also write who follows into this file of what `stiction identify` advises by."""
    ship: Path | None = None
    """Export the median seed of each way of training of the first part into this folder."""
    list: bool = False
    """Only say what the experiment is made of, and where it stands."""
    json: bool = False
    """Print the verdicts as JSON on standard output, and nothing else."""


def places_of(options: FrictionStudy) -> list[Place]:
    """Return the runs of the chosen parts with their configurations and folders."""
    from stiction.cli.train import parse
    from stiction.transfer.experiment.manifest import runs_of
    from stiction.transfer.experiment.places import Place

    runs = runs_of(options.parts)
    return [Place(run, parse([*run.arguments]).config, options.runs / run.name) for run in runs]


def main(arguments: list[str]) -> int:
    """Run the study; return 1 if a run could not be trained or evaluated."""
    options = tyro.cli(FrictionStudy, args=arguments, prog="stiction study friction", description=DESCRIPTION)
    jobs = jobs_of(options.jobs)
    from stiction.cli.interruption import stop_requests
    from stiction.cli.terminal import print_warnings, work_progress
    from stiction.formats.folder import make_folder
    from stiction.formats.origin import Origin
    from stiction.transfer.experiment.again import judge_again
    from stiction.transfer.experiment.assemble import assemble, ship
    from stiction.transfer.experiment.evaluation import BASE, evaluate_tasks, tasks_for
    from stiction.transfer.experiment.training import train_missing

    command = shlex.join(["stiction", "study", "friction", *arguments])
    if options.judge_again:
        tell(options, judge_again(options.out, {"command": command, **Origin.now().provenance}))
        return 0
    places = places_of(options)
    states = {place.run.name: place.state() for place in places}
    if options.list:
        print_places(places, states)
        return 0
    if not options.train and "finished" not in states.values():
        raise StictionError(
            f"no run of the experiment in {options.runs} is finished; train them with --train, or name their folder "
            "with --runs"
        )
    make_folder(options.out)
    origin, failed = Origin.now(), dict[str, str]()
    with work_progress() as progress:
        if options.train:
            with stop_requests(say, "an iteration of each run") as asked:
                failed = train_missing(places, jobs, progress, asked=asked)
            if asked():
                return asked.status
        base = replace(BASE, episodes=options.episodes, seconds=options.seconds)
        finished = [place for place in places if place.state() == "finished"]
        rows, unevaluated = evaluate_tasks(tasks_for(finished, base, options.cache), jobs, progress)
    failed |= unevaluated
    made = {"command": command, "failed": failed, **origin.provenance, "warnings": origin.warnings()}
    print_warnings("study friction", made["warnings"])
    tell(options, assemble(places, rows, base, made))
    for name, reason in failed.items():
        say(f"{name}: {reason}")
    if options.ship is not None:
        for folder in ship(places, rows, options.ship):
            say(f"shipped {folder}")
    return 1 if failed else 0


def tell(options: FrictionStudy, experiment: Experiment) -> None:
    """Write the experiment's files, and its part of the advice if asked to; print the outcome."""
    from stiction.formats.advice import TRAINING, write_source
    from stiction.report.experiment import lead, write_experiment
    from stiction.transfer.experiment.advice import source_of

    page = write_experiment(options.out, experiment)
    if options.advice is not None:
        write_source(options.advice, TRAINING, source_of(experiment))
    if options.json:
        print(json.dumps({verdict.id: verdict.outcome for verdict in experiment.verdicts}))
    else:
        print(f"{lead(experiment)}\nreport: {page}")


def say(text: str) -> None:
    """Print a line on standard error."""
    print(f"stiction study friction: {text}", file=sys.stderr)


def print_places(places: list[Place], states: Mapping[str, str], show: Callable[[str], None] = print) -> None:
    """Print every run with its state and the command that trains it by hand."""
    for place in places:
        run = place.run
        share = place.done() / place.iterations
        show(f"{states[run.name]:<12}{share:>5.0%}  stiction train {shlex.join(run.arguments)} --out {place.path}")
