"""`stiction study paper`: every sentence of the paper, judged on one cohort; and the work that this takes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from stiction_experiments.lab.study import ParallelOptions, Report, Study, Work

DESCRIPTION = """Judge every sentence of the paper by the rows in --out, and draw the report. With --do N the next N
steps that are missing are done before: trainings, policies, nets and walks, in the order of their worth; each leaves
its file, so that the same command goes on where it was. `stiction replicate` and `stiction study paper` are one.

Example:
  {program} --do 1 --out results/paper"""


@dataclass(frozen=True, kw_only=True)
class PaperOptions(ParallelOptions):
    """Options of `stiction study paper`."""

    out: Path = Path("stiction-paper")
    """Directory for rows of walks, curves, stairs, gaits, lives and estimators, for ledger.csv, sentences.csv and the
    page; with --do also for runs."""
    do: int = 0
    """Missing steps that are done before."""

    @property
    def free(self) -> tuple[str, ...]:
        """Options that add to the results of before."""
        return ("do",)


def run(options: PaperOptions, work: Work) -> Report:
    """Do what is missing, as far as it is asked for, and judge all rows."""
    from stiction.core.records import read_rows
    from stiction_experiments.paper.climbs import Climbed
    from stiction_experiments.paper.configurations import Configuration
    from stiction_experiments.paper.estimator import EstimateRow, ProfileRow
    from stiction_experiments.paper.gaits import Gait
    from stiction_experiments.paper.lives import Life
    from stiction_experiments.paper.page import report
    from stiction_experiments.paper.results import Results
    from stiction_experiments.paper.rows import WalkRow, Walks
    from stiction_experiments.paper.work import CurvePoint, LedgerRow, do_missing, learnings, missing_steps

    out = work.begin()
    if options.do:
        do_missing(out, options.do, work.jobs, work.say, work.progress)
    results = Results(
        Walks(read_rows(out / "walks.csv", WalkRow, optional=True)),
        learnings(
            read_rows(out / "curves.csv", CurvePoint, optional=True),
            read_rows(out / "ledger.csv", LedgerRow, optional=True),
        ),
        read_rows(out / "stairs.csv", Climbed, optional=True),
        read_rows(out / "gait.csv", Gait, optional=True),
        read_rows(out / "lives.csv", Life, optional=True),
        read_rows(out / "estimator.csv", EstimateRow, optional=True),
        read_rows(out / "configurations.csv", Configuration, optional=True),
    )
    step = next(missing_steps(out), None)
    further = () if step is None else (f"next: {step.name}: stiction {work.verb} --do 1 --out {out}",)
    return replace(report(results, read_rows(out / "profile.csv", ProfileRow, optional=True)), further=further)


STUDY = Study(
    "what becomes of every sentence of the paper, on one cohort",
    DESCRIPTION,
    PaperOptions,
    run,
    results=("sentences.csv", "followed.png", "profile.png"),
)


def main(arguments: list[str]) -> int:
    """Run the study as the verb `stiction replicate`."""
    return STUDY.main(arguments, "replicate")
