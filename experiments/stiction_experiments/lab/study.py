"""The framework of all studies: a study says what it asks, runs, and what its page shows; all else is done here.

    STUDY = Study(question, description, options, run)      an entry point, or anywhere on the path

    arguments -> options -> run(options, work) -> Report -> CSV tables, summary.json, figures, report.html

This module and those that hold a `STUDY` import nothing heavy at the top: `--help` needs neither simulator nor torch.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import shlex
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from stiction.core.cache import key_of
from stiction.core.errors import FileError
from stiction.core.files import write_text
from stiction.core.lock import output_folder
from stiction.core.options import read_options
from stiction.core.provenance import Origin, num_threads
from stiction.core.records import check_folder, check_numbers, make_folder, write_rows
from stiction.files.results import ResultRow, summary_text, write_results, write_summary
from stiction.files.settings import results_folder
from stiction.report.terminal import Terminal, jobs_of, print_warnings, work_progress
from stiction_experiments import CODE, PACKAGE
from stiction_experiments.lab.cluster import use_cluster
from stiction_experiments.lab.files import cached

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.figure import Figure

    from stiction.files.bundle import Bundle
    from stiction.report.page import Section, Sheet

Summary = Mapping[str, Any]
"""Content of summary.json."""

WRITTEN = ("summary.json", "report.html", "tables.md")
"""Files of studies; each study writes those for which it has content."""

INPUTS = ("policies", "bundles", "bundle", "robot")
"""Options of studies that name what is read, of which the content counts."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of every study; a study's own are the fields of a subclass."""

    out: Path = Path("stiction-study")
    """Directory for tables, summary.json, figures and report.html."""
    overwrite: bool = False
    """Write over results of other settings in --out."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""

    @property
    def folder(self) -> Path:
        """Where the study is written."""
        return self.out


@dataclass(frozen=True, kw_only=True)
class ParallelOptions(Options):
    """Options of a study whose work is spread over processes."""

    jobs: int | None = None
    """Tasks at once, each on one thread; by default as many as there are cores (STICTION_THREADS)."""
    cluster: str | None = None
    """Do the tasks on a Ray cluster (extra cluster): HOST:PORT of its head node, or `auto` on one of its nodes. Every
    node needs the same installation and sees --out at the same place; --jobs is then all of its processors."""


@dataclass(frozen=True, kw_only=True)
class RedrawnOptions(Options):
    """Options of a study whose page can be drawn anew from its files."""

    judge_again: bool = False
    """Run nothing: judge what --out has by today's criteria, and draw its page anew."""


def recorded(out: Path, work: Work, names: Sequence[str] = ()) -> dict[str, Any]:
    """Return the summary that a folder has, for `--judge-again`: its `judged` is by what it is judged now.

    names: what it must have. Raises `FileError` where it is none of this study.
    """
    from stiction.files.results import read_summary

    path = out / "summary.json"
    before = read_summary(path)
    for name in names:
        if name not in before:
            raise FileError(f"{path} is none of `stiction {work.verb}`: no {name!r}")
    unchanged = {name: value for name, value in before.items() if name != "schema_version"}
    return {"warnings": []} | unchanged | {"judged": work.provenance}


class UsageError(Exception):
    """Raised by a study for a command line that lacks something: one line that says what."""


class Work:
    """Context of a study: its folder, policies, processes, earlier results, and progress."""

    def __init__(
        self, options: Options, verb: str, command: str, code: str, stack: ExitStack, results: Sequence[str] = ()
    ) -> None:
        """`verb`: words that call the study; `code`: digest of its module; `stack`: ends with the work.

        results: what the study writes, as far as it is known before.
        """
        self.verb, self.command, self.out = verb, command, options.folder
        self.jobs = jobs_of(getattr(options, "jobs", None))
        """Processes at once."""
        self.threads = num_threads()
        """Threads of a simulator, where there is one process."""
        self.origin = Origin.now(PACKAGE)
        self.bars = ExitStack()
        """Ends with the progress, when the study has run."""
        self._options = options
        self._code, self._stack, self._start = code, stack, time.perf_counter()
        self._results = (*WRITTEN, *results)
        self._begun = False

    def begin(self) -> Path:
        """Make and return the study's folder: call it when the options are checked, before the work begins.

        From then on the work goes to the cluster, if one is named. A second call does nothing.

        Raises `StictionError` where it cannot be written, or another process writes it; it is this one's to the end.
        """
        if self._begun:
            return self.out
        self._begun = True
        if getattr(self._options, "judge_again", False):
            self._stack.enter_context(output_folder(self.out))
        else:
            free = getattr(self._options, "free", ())
            inputs = {name: getattr(self._options, name, None) for name in INPUTS if name not in free}
            self._stack.enter_context(results_folder(self.out, self.verb, self._options, self._results, inputs))
        cluster = self._stack.enter_context(use_cluster(getattr(self._options, "cluster", None), self.out))
        if cluster is not None and getattr(self._options, "jobs", None) is None:
            self.jobs = cluster.processors
        self._start = time.perf_counter()
        return self.out

    @cached_property
    def progress(self) -> Callable[[str, float], None]:
        """Shows how far a named piece of work is, as a share of it."""
        return self.bars.enter_context(work_progress())

    @property
    def seconds(self) -> float:
        """Time since `begin` [s]."""
        return time.perf_counter() - self._start

    @property
    def provenance(self) -> dict[str, Any]:
        """`command`, `revision` and `machine`, for summary.json."""
        return {"command": self.command, **self.origin.provenance}

    def say(self, text: str) -> None:
        """Print a line on standard error."""
        print(f"stiction {self.verb}: {text}", file=sys.stderr)

    def bundles(self, paths: Sequence[Path] | None) -> list[Bundle]:
        """Return checked policies, each of another name.

        paths: directories (of policy records too), or names of shipped ones; None: all those.

        Raises:
            UsageError: no path is given.
            StictionError: a bundle cannot be found or is damaged, or two have one name.

        """
        from stiction.deploy.check import check_for_simulation, record_notes
        from stiction.evaluation.summary import check_names
        from stiction.files.bundle import find_bundle, shipped_bundles

        if paths is not None and not paths:
            raise UsageError("no bundle given")
        bundle_paths = shipped_bundles().values() if paths is None else map(find_bundle, paths)
        bundles = [check_for_simulation(path) for path in bundle_paths]
        print_warnings(self.verb, record_notes(bundles))
        check_names([bundle.name for bundle in bundles])
        return bundles

    def cached(self, name: str, inputs: dict[str, Any], make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Return a part of the study: read where the same command made it before, else made by `make`, and kept.

        inputs: what the part depends on beside both packages, the study's module and other packages.
        """
        folder = self.out / "parts"
        make_folder(folder)
        return cached(folder, name, key_of(inputs | {"study": self._code}, *CODE), make)


@dataclass(frozen=True)
class Report:
    """Results of a study and their page."""

    title: str = ""
    """Heading of the page; without one there is none."""
    lead: str = ""
    """The answer, a sentence that can be read aloud, and further lines: on the page, and printed."""
    tables: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    """Name -> records, written as NAME.csv. Of what has no rows, a file of before is removed."""
    sections: Sequence[Section] = ()
    """The page without provenance; by default its tables."""
    run: Sequence[Markup] = ()
    """Facts on the run, after command, revision and machine."""
    summary: Summary = field(default_factory=dict)
    """Entries of summary.json in addition to `Work.provenance` and warnings, or in their place."""
    warnings: Sequence[str] = ()
    """Warnings for the reader: printed, on the page, in summary.json."""
    notes: Sequence[str] = ()
    """The same, on the page alone."""
    figures: Mapping[str, Figure | None] = field(default_factory=dict)
    """Name -> figure, written as NAME.png; of None, a file of before is removed."""
    sheets: Sequence[Sheet] = ()
    """Tables of text that a README can take: tables.md."""
    files: Callable[[Path], None] | None = None
    """Writes what else belongs into the folder."""
    answer: Sequence[Any] = ()
    """Printed in place of the lead: lines, and tables of `rich`."""
    further: Sequence[str] = ()
    """Lines that are printed after the path of the page."""
    json: Summary | None = None
    """Printed by --json in place of the summary, on one line."""
    status: int = 0
    """Exit status: 1 where something that was asked for failed."""


Chosen = TypeVar("Chosen", bound=Options)


@dataclass(frozen=True)
class Study(Generic[Chosen]):
    """An experiment that is one command and one page."""

    question: str
    description: str
    """Text of `--help`; `{program}` in it is the words that call the study."""
    options: type[Chosen]
    run: Callable[[Chosen, Work], Report]
    """Does it."""
    results: Sequence[str] = ()
    """Files that it writes beside `WRITTEN`: somebody else's of these names is refused before the work begins."""

    def main(self, arguments: Sequence[str], verb: str) -> int:
        """Run the study from the command line; return the exit status. verb: the words before the arguments.

        Raises:
            StictionError: whatever the study refuses, or its folder cannot be written.

        """
        program = f"stiction {verb}"
        description = self.description.replace("{program}", program)
        if "\n  stiction " not in description:
            description += f"\n\nExample:\n  {program} --out {verb.split()[-1]}"
        options = read_options(self.options, arguments, program, description)
        check_numbers(options)
        check_folder(options.folder)
        command = shlex.join([*program.split(), *arguments])
        # A study of one's own lies outside the packages, whose files are in the key of every part.
        code = hashlib.sha256(Path(inspect.getfile(self.run)).read_bytes()).hexdigest()
        with ExitStack() as stack:
            work = Work(options, verb, command, code, stack, self.results)
            try:
                # Bars end before anything is printed: a live display would draw over it.
                with work.bars:
                    report = self.run(options, work)
            except UsageError as error:
                work.say(f"{error}; `{program} --help` shows the usage")
                return 2
            warnings = [*work.origin.warnings(), *report.warnings]
            print_warnings(verb, warnings)
            summary = write_report(work.begin(), report, work.provenance | {"warnings": warnings})
        if options.json:
            print(summary_text(dict(summary)) if report.json is None else f"{json.dumps(report.json)}\n", end="")
        else:
            _show(report, work.out)
        return report.status


def write_report(out: Path, report: Report, provenance: Summary) -> Summary:
    """Write tables, summary.json, figures and page into a folder; return the summary.

    provenance: `Work.provenance` and `warnings`.

    Raises:
        FileError: something cannot be written.

    """
    summary = {**provenance, **report.summary}
    from stiction.report.page import save_figure

    for name, rows in report.tables.items():
        path = out / f"{name}.csv"
        if rows:
            (write_results if isinstance(rows[0], ResultRow) else write_rows)(path, rows)
        elif path.exists():
            path.unlink()
    write_summary(out / "summary.json", summary)
    for name, figure in report.figures.items():
        picture = out / f"{name}.png"
        if figure is not None:
            save_figure(figure, picture)
        else:
            picture.unlink(missing_ok=True)
    if report.title:
        write_text(out / PAGE, page_text(report, summary))
    if report.sheets:
        write_text(out / "tables.md", "\n".join(sheet.markdown() for sheet in report.sheets))
    if report.files is not None:
        report.files(out)
    return summary


PAGE = "report.html"
"""Name of the page."""


def page_text(report: Report, summary: Summary) -> str:
    """Return the page: what the study shows, and what was run."""
    from stiction.report.following import judged_text
    from stiction.report.page import Section, paragraph, render_page, row_table

    parts = report.sections or [Section(name, (row_table(rows),)) for name, rows in report.tables.items() if rows]
    took = f", {summary['seconds']:.0f} s" if "seconds" in summary else ""
    revision = f"Revision {summary['revision']}{took} on {summary['machine']['cpu']}."
    again = judged_text(summary)
    blocks = [paragraph(f"Command: {summary['command']}"), *report.run, paragraph(revision)]
    parts = [*parts, Section("What was run", (*blocks, *((paragraph(again),) if again else ())))]
    notes = [*namesakes(summary.get("policies", {})), *summary["warnings"], *report.notes]
    return render_page(report.title, parts, report.lead.split("\n"), notes, summary["command"])


def namesakes(policies: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return a warning where the package has other policies by now under the names of those that were walked.

    policies: name -> `digest`, `seed`, `revision` and perhaps `phases`, as in summary.json.
    """
    from stiction.files.bundle import read_bundle, shipped_bundles
    from stiction.files.contract import PHASES

    def origin(policy: Mapping[str, Any]) -> str:
        phases = PHASES.get(policy.get("phases", 0))
        return ", ".join([f"seed {policy['seed']}", *([phases] if phases else []), f"revision {policy['revision']}"])

    shipped = {name: path for name, path in shipped_bundles().items() if name in policies}
    others = [name for name, path in shipped.items() if policies[name]["digest"] != read_bundle(path).digest]
    names = ", ".join(f"{name} ({origin(policies[name])})" for name in others)
    return [f"Walked with earlier policies than the package has under these names now: {names}."] if others else []


WIDE = 140
"""Width of tables where standard output is a file or a pipe [characters]."""


def _show(report: Report, out: Path) -> None:
    """Print the answer, where the page is, and what to do next."""
    console = Terminal()
    if not console.is_terminal:
        console = Terminal(width=WIDE)
    for line in report.answer or (report.lead,):
        (print if isinstance(line, str) else console.print)(line)
    for line in (*((f"report: {out / PAGE}",) if report.title else ()), *report.further):
        print(line)
