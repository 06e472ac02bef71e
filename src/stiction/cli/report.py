"""`stiction report --bench DAY`: the runs of a day on a robot on one page, and in one table."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

from stiction.core.errors import ConfigurationError
from stiction.core.options import read_options

DESCRIPTION = """Put the runs of a day on a robot on one page and in one table, beside what was predicted.

DAY/CONDITION/RESULT is a run of deploy, a folder of identify or one of evaluate. Writes bench.html and bench.csv into
DAY, and sheet.csv, in which you fill in how far the robot went. Says what the comparison lacks; refuses damaged
logs, and two policies of one name. The page "A day on the bench" of the documentation has every step.

Examples:
  stiction report --bench day"""


SHOWN = ("friction", "command", "runs", "reached/told", "spread", "predicted", "stops")
"""Columns on the terminal; the page has all."""


@dataclass(frozen=True)
class ReportCfg:
    """Options of the verb."""

    bench: Path | None = None
    """Folder of the day."""


def main(arguments: list[str]) -> int:
    """Run the verb; return the exit status."""
    cfg = read_options(ReportCfg, arguments, "stiction report", DESCRIPTION)
    if cfg.bench is None:
        raise ConfigurationError("--bench: got nothing, expected the folder of a day; name it, --bench day")
    from rich.table import Table

    from stiction.core.lock import output_folder
    from stiction.core.records import header, texts
    from stiction.report.bench import PAGE, SHEET, TABLE, BenchRow, write_bench
    from stiction.report.terminal import Terminal

    if not cfg.bench.is_dir():
        raise ConfigurationError(f"--bench: got {cfg.bench}, which is no folder, expected that of a day")
    with output_folder(cfg.bench):
        rows, lacking = write_bench(cfg.bench, shlex.join(["stiction", "report", *arguments]))
    console = Terminal()
    for policy in dict.fromkeys(row.policy for row in rows):
        console.print(policy, style="bold", soft_wrap=True, highlight=False)
        table = Table(*SHOWN)
        for row in rows:
            if row.policy == policy:
                cells = dict(zip(header(BenchRow), texts(row), strict=True))
                table.add_row(*(cells[name] for name in SHOWN))
        console.print(table)
    written = ", ".join(str(cfg.bench / name) for name in (PAGE, TABLE, SHEET))
    for line in (*(f"missing: {text}" for text in lacking), f"written: {written}"):
        console.print(line, highlight=False, soft_wrap=True)
    return 0
