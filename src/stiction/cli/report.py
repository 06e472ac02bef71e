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
    table = Table(*header(BenchRow))
    for row in rows:
        table.add_row(*texts(row))
    console = Terminal()
    console.print(table)
    written = ", ".join(str(cfg.bench / name) for name in (PAGE, TABLE, SHEET))
    for line in (*(f"missing: {text}" for text in lacking), f"written: {written}"):
        console.print(line, highlight=False, soft_wrap=True)
    return 0
