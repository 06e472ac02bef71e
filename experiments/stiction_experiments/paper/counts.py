"""Count the commands that policies follow, in tables of `stiction evaluate`, and write the part of the advice.

    python -m stiction_experiments.paper.counts OUT TABLE... [--advice FILE --command WORDS --revision REVISION]

OUT gets counts.csv, counts.md and counts.png. Each TABLE is a results.csv, in whatever engines. FILE is what `stiction
identify` advises by: it gets the counts of the methods in `METHODS`, with the command and the revision that trained
their policies.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from stiction.core.errors import FileError
from stiction.core.files import write_text
from stiction.core.records import make_folder, write_rows
from stiction.files.advice import SHARES, TRAINING, Source, TrainedWith
from stiction.files.following import CommandCount, count_commands
from stiction.files.method import find_method
from stiction.files.results import ResultRow, read_results
from stiction.identification.advice import PLACES, TOLD
from stiction.report.following import counts_sheet
from stiction.report.page import Sheet, legend, line_look, mark_look, new_figure, save_figure
from stiction.robots.catalog import find_robot
from stiction_experiments.lab.files import write_source
from stiction_experiments.paper.plan import LEVEL

if TYPE_CHECKING:
    from matplotlib.figure import Figure

METHODS = {"none": "none", "direct": "direct", "deception": "deception", TOLD: "deception"}
"""Method of the rows that the advice compares -> `--method` of its training."""

WHOLE = "+all"
"""End of the name of a virtual robot's engine where all of the robot is real: nobody has one that is so in part."""


def way_of(row: ResultRow) -> str:
    """Return the training method; with what follows the seed in the policy's name, as in a control's `a-s3-plain`."""
    return row.method + row.policy.partition(f"-s{row.seed}")[2]


def read_tables(tables: Iterable[Path]) -> list[ResultRow]:
    """Return the rows of all tables.

    Raises:
        StictionError: a table cannot be read, has rows without a mean velocity, or two policies of one method and seed.

    """
    rows: list[ResultRow] = []
    for table in tables:
        rows += (own := read_results(table))
        if older := sum(row.mean_velocity is None for row in own):
            raise FileError(f"{table}: got {older} rows without a mean velocity, expected none; evaluate them again")
    names: dict[tuple[str, int, str], str] = {}
    for row in rows:
        way = way_of(row)
        if (known := names.setdefault((way, row.seed, row.engine), row.policy)) != row.policy:
            raise FileError(
                f"tables: got {known} and {row.policy}, both of {way!r} with seed {row.seed} in {row.engine}, expected "
                "one policy a seed; leave one of them out"
            )
    return rows


def pairs_sheet(rows: Sequence[ResultRow]) -> Sheet:
    """Return the seeds of each method that follow every command at every friction, a column for each place."""
    places = count_commands((replace(row, friction_level=0.0) for row in rows), way_of)
    engines = tuple(dict.fromkeys(place.engine for place in places))
    lines = []
    for way in dict.fromkeys(place.method for place in places):
        own = {place.engine: place for place in places if place.method == way}
        each = (f"{own[name].follow_all} of {own[name].seeds}" if name in own else "–" for name in engines)
        pairs = sum(one.follow_all for one in own.values()), sum(one.seeds for one in own.values())
        lines.append((way, *each, f"{pairs[0]} of {pairs[1]}"))
    title = "Pairs of seed and place that follow every command at every friction"
    return Sheet(title, ("method", *engines, "pairs of seed and place"), tuple(lines))


def draw_counts(counts: Sequence[CommandCount], names: Sequence[str]) -> Figure:
    """Return the share of commands followed over Coulomb friction, a panel for each engine, a line for each method.

    names: methods that are drawn, in the order of their colours.
    """
    drawn = [count for count in counts if count.friction_law == "coulomb" and count.method in names]
    drawn.sort(key=lambda count: count.friction_level)
    engines = tuple(dict.fromkeys(count.engine for count in counts if count in drawn and "+" not in count.engine))
    figure, axes = new_figure(1, len(engines), size=(3.0 * len(engines) + 0.4, 3.2))
    for axis, engine in zip(axes, engines, strict=True):
        for name in names:
            points = [count for count in drawn if (count.engine, count.method) == (engine, name)]
            levels, shares = [100 * one.friction_level for one in points], [one.followed / one.cells for one in points]
            look = {"marker": mark_look(name, names), "label": name} | line_look(name, names)
            axis.plot(levels, [100 * share for share in shares], markersize=4, linewidth=1.8, **look)
        axis.set(title=PLACES[engine], xlabel="friction, % of torque limit", ylim=(0, 103))
    axes[0].set_ylabel("commands followed, %")
    legend(axes[0], loc="lower left")
    return figure


def source_of(
    rows: Sequence[ResultRow], counts: Sequence[CommandCount], tables: Sequence[Path], args: argparse.Namespace
) -> Source:
    """Return the part of the advice; args: command, revision and robot of the training, see `main`."""
    methods = {}
    for way in dict.fromkeys(count.method for count in counts if count.method in METHODS):
        low, high = find_method(METHODS[way]).friction_range
        methods[way] = TrainedWith(METHODS[way], LEVEL if high else 0.0, low, high)
    cells = [
        count
        for count in counts
        if count.method in methods
        and count.friction_law in SHARES
        and ("+" not in count.engine or count.engine.endswith(WHOLE))
    ]
    return Source(
        args.command,
        args.revision,
        args.robot,
        len(find_robot(args.robot).feet),
        tuple(sorted({row.policy for row in rows if way_of(row) in methods})),
        methods,
        tuple(cells),
        tables=tuple(table.name for table in tables),
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the counts and their figure, and the part of the advice where its file is named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("out", type=Path, help="folder of counts.csv, counts.md and counts.png")
    parser.add_argument("tables", type=Path, nargs="+", help="results.csv of `stiction evaluate`")
    parser.add_argument("--advice", type=Path, help="advice.json, which gets the counts")
    parser.add_argument("--command", help="with --advice: command that trained the policies, with its --preset")
    parser.add_argument("--revision", help="with --advice: revision that trained them")
    parser.add_argument("--robot", default="saturn_lite", help="with --advice: robot that walked; default: %(default)s")
    args = parser.parse_args(arguments)
    if args.advice is not None and not (args.command and args.revision):
        parser.error("--advice requires --command and --revision of the training")
    rows = read_tables(args.tables)
    counts = count_commands(rows, way_of)
    make_folder(args.out)
    write_rows(args.out / "counts.csv", counts)
    write_text(
        args.out / "counts.md", "\n".join(sheet.markdown() for sheet in (pairs_sheet(rows), counts_sheet(counts)))
    )
    save_figure(
        draw_counts(counts, [name for name in METHODS if name in {row.method for row in counts}]),
        args.out / "counts.png",
    )
    if args.advice is not None:
        write_source(args.advice, TRAINING, source_of(rows, counts, args.tables, args))


if __name__ == "__main__":
    main()
