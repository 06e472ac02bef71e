"""`stiction runs [DIR | RUN RUN ...]`: list training runs, or compare some."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from stiction.core.errors import FileError
from stiction.core.flags import ARGUMENT
from stiction.core.options import read_options

if TYPE_CHECKING:
    from rich.console import RenderableType

    from stiction.learning.overview import Overview

DESCRIPTION = """List the training runs in a folder, newest first, or compare some of them.

A run is a folder with the config.json of `stiction train`. `reward` is that of a control step, mean of the last 20
iterations; `follows` counts followed commands in the newest results.csv in the run's folder, such as that of
`stiction evaluate RUN/bundle --out RUN/evaluation`. Two or more runs are compared: settings that differ, and where
their curves end. Damaged runs are named below the list.

Examples:
  stiction runs
  stiction runs runs/cohort --json
  stiction runs runs/first runs/second"""


@dataclass(frozen=True)
class RunsCfg:
    """Options of the verb."""

    folders: Annotated[tuple[Path, ...], ARGUMENT] = field(default=(Path("runs"),))
    """Folder to search, `runs` by default, or two or more runs to compare."""
    json: bool = False
    """Print the list, or the comparison, as JSON on standard output."""


def main(arguments: list[str]) -> int:
    """Run the verb; return the exit status."""
    from stiction.learning.overview import read_overview, run_folders

    cfg = read_options(RunsCfg, arguments, "stiction runs", DESCRIPTION)
    if len(cfg.folders) > 1:
        _compare([read_overview(path) for path in cfg.folders], cfg.json)
        return 0
    overviews, damaged = [], []
    for path in run_folders(cfg.folders[0]):
        try:
            overviews.append(read_overview(path))
        except (FileError, OSError) as error:
            damaged.append({"path": str(path), "damage": str(error)})
    overviews.sort(key=lambda run: run.written, reverse=True)
    if cfg.json:
        print(json.dumps({"runs": [run.to_dict() for run in overviews], "damaged": damaged}, indent=2))
        return 0
    if overviews:
        names = ("run", "robot", "method", "seed", "done", "state", "reward", "follows", "age")
        _print(_table(names, [_cells(run, cfg.folders[0]) for run in overviews]))
    elif not damaged:
        _print(f"no runs in {cfg.folders[0]}")
    for each in damaged:
        _print(f"damaged: {each['path']}: {each['damage']}")
    return 0


def _cells(run: Overview, folder: Path) -> list[str]:
    """Return the row of a run in the list."""
    name = run.path.name if run.path == folder else str(run.path.relative_to(folder))
    reward = f"{run.ends['reward']:.4f}" if "reward" in run.ends else "–"
    follows = "–" if run.followed is None else "{}/{}".format(*run.followed)
    done = f"{run.done}/{run.iterations}"
    return [name, run.robot, run.method, str(run.seed), done, run.state, reward, follows, _age(run.written)]


def _age(written: float) -> str:
    """Return the time since then, in the largest whole unit: `12 min`, `3 h`, `2 d`."""
    seconds = max(0.0, time.time() - written)
    for unit, length in (("d", 86400), ("h", 3600), ("min", 60)):
        if seconds >= length:
            return f"{seconds // length:.0f} {unit}"
    return f"{seconds:.0f} s"


def _compare(runs: Sequence[Overview], as_json: bool) -> None:
    """Print settings that differ, and the end values of the curves that are drawn of a run."""
    from stiction.learning.overview import different, short_names
    from stiction.report.training import PANELS

    settings, names = different(runs), short_names(run.path for run in runs)
    if as_json:
        print(json.dumps({"runs": [run.to_dict() for run in runs], "settings": settings}, indent=2))
        return
    if settings:
        _print(_table(("setting", *names), [[name, *map(_value, values)] for name, values in settings.items()]))
    else:
        _print("no setting differs")
    ends = [["iterations", *(f"{run.done}/{run.iterations} {run.state}" for run in runs)]]
    ends.append(
        ["commands followed", *("–" if run.followed is None else "{}/{}".format(*run.followed) for run in runs)]
    )
    for label, figures in PANELS:
        for name, short in figures.items():
            values = [f"{run.ends[name]:.4g}" if name in run.ends else "–" for run in runs]
            if set(values) != {"–"}:
                ends.append([label if len(figures) == 1 else f"{label}: {short}", *values])
    _print(_table(("mean of the last 20 iterations", *names), ends))


def _value(value: Any) -> str:
    """Return a setting as `--set` takes it."""
    return "–" if value is None else value if isinstance(value, str) else json.dumps(value)


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> RenderableType:
    """Return a table for 80 columns: its first column folds where it is long, the list's others never."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    whole = header[0] == "run"
    for number, name in enumerate(header):
        table.add_column(name, overflow="ellipsis" if whole and number else "fold", no_wrap=whole and number > 0)
    for row in rows:
        table.add_row(*row)
    return table


def _print(text: RenderableType) -> None:
    """Print a table, or a line, on standard output."""
    from stiction.report.terminal import Terminal

    Terminal().print(text, highlight=False, soft_wrap=isinstance(text, str))
