"""The page of a study of gaits: contact bars of every foot, shares, and verdicts on the paper's sentences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from stiction.formats.errors import StictionError
from stiction.formats.gait import VARIANTS, ClaimRow, FootRow, GaitRow
from stiction.formats.results import write_summary
from stiction.formats.rows import write_rows
from stiction.report.page import COLORS, Section, figure_uri, new_figure, paragraph, picture, render_page, table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN = 3.0
"""How much of a walk the diagram shows [s]."""

DEFINITIONS = (
    ("rewards", "; ".join(f"{name}: {words}" for name, words in VARIANTS.items())),
    ("moving", "share of steps in which the base moves (over 0.1 m/s), what all other shares are of"),
    (
        "tripod",
        "exactly one contact group on the ground, no foot more or less, as in r_trot; then each group by itself",
    ),
    ("flight, all feet", "no foot on the ground; all feet on it"),
    (
        "together",
        "share of touch-downs and lift-offs in which every foot takes part within 0.06 s: 1 in a pronk, 0 in a tripod; "
        "contacts and swings shorter than 0.06 s are bounces and do not count",
    ),
    (
        "within, across",
        "mean correlation of two feet's contacts, of one group and of two: a tripod has 1 and −1, a pronk 1 and 1",
    ),
    (
        "one-sidedness",
        "difference of the two groups' use over their sum, in windows of 2 s: 0 is even, 1 one group alone",
    ),
    (
        "gait",
        "stands: moving under 50 %; else pronk: together at least 50 %; else hop on one group: one-sidedness at least "
        "0.5; else tripod: tripod share at least 50 %; else none of these",
    ),
)
"""What the columns mean."""


@dataclass(frozen=True)
class GaitResult:
    """All that a study of gaits found."""

    gaits: tuple[GaitRow, ...]
    """One row a policy and command."""
    feet: tuple[FootRow, ...]
    """One row a policy, command and foot."""
    claims: tuple[ClaimRow, ...]
    """One row a sentence."""
    contacts: tuple[np.ndarray, ...]
    """Contacts of the first episode of each row of `gaits`, feet as in `feet`, bool, shape (T, L)."""
    period: float
    """Control period [s]."""


def write_gait(out: Path, result: GaitResult, summary: dict[str, Any]) -> Path:
    """Write the tables, the contacts, the figure and the page into `out`; return the path of the page.

    Raises:
        StictionError: something cannot be written.

    """
    tables: dict[str, tuple[Any, ...]] = {"gaits": result.gaits, "feet": result.feet, "claims": result.claims}
    figure = draw_gaits(result)
    try:
        for name, rows in tables.items():
            write_rows(out / f"{name}.csv", rows)
        arrays = {f"{row.policy} {row.command}": c for row, c in zip(result.gaits, result.contacts, strict=True)}
        np.savez_compressed(out / "contacts.npz", allow_pickle=False, period=np.array(result.period), **arrays)
        write_summary(
            out / "summary.json", summary | {name: [asdict(r) for r in rows] for name, rows in tables.items()}
        )
        figure.savefig(out / "gait.png", dpi=110, facecolor="white")
        page = out / "report.html"
        text = render_page("Gait", sections(result, figure, summary), lead(result), summary["warnings"])
        page.write_text(text, encoding="utf-8")
    except OSError as error:
        raise StictionError(f"the study cannot be written to {out}: {error}; choose another --out") from error
    return page


def draw_gaits(result: GaitResult) -> Figure:
    """Return the contact bars of every policy (down) and command (across), a foot a line, coloured by contact group."""
    commands = list(dict.fromkeys(row.command for row in result.gaits))
    policies = list(dict.fromkeys(row.policy for row in result.gaits))
    height = 0.6 + 1.9 * len(policies)
    figure, axes = new_figure(len(policies), len(commands), size=(5.2 * len(commands), height))
    for row, contact in zip(result.gaits, result.contacts, strict=True):
        axis = axes[policies.index(row.policy) * len(commands) + commands.index(row.command)]
        feet = [foot for foot in result.feet if (foot.policy, foot.command) == (row.policy, row.command)]
        shown = contact[: round(SHOWN / result.period)]
        for line, foot in enumerate(feet):
            axis.broken_barh(bars(shown[:, line], result.period), (line - 0.38, 0.76), color=COLORS[foot.group])
        axis.set(xlim=(0.0, len(shown) * result.period), ylim=(len(feet) - 0.5, -0.5), xlabel="time [s]")
        axis.set_yticks(range(len(feet)), [foot.foot for foot in feet])
        axis.set_title(f"{row.policy}, {row.command}: {row.gait}", fontsize=8)
    return figure


def bars(contact: np.ndarray, period: float) -> list[tuple[float, float]]:
    """Return begin and length of each contact [s]; contact: one foot, bool, shape (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], contact, [False]]).astype(int)))
    return [(begin * period, (end - begin) * period) for begin, end in edges.reshape(-1, 2).tolist()]


def lead(result: GaitResult) -> str:
    """Return what each set of policies did, in a sentence a variant."""
    sentences = []
    for variant, words in VARIANTS.items():
        rows = [row for row in result.gaits if row.variant == variant]
        if rows:
            names = list(dict.fromkeys(row.gait for row in rows))
            counts = ", ".join(f"{name} {sum(row.gait == name for row in rows)}" for name in names)
            seeds = len({(row.seed, row.policy) for row in rows})
            sentences.append(f"Trained with {words} ({seeds} polic{'y' if seeds == 1 else 'ies'}): {counts}.")
    return " ".join(sentences)


def sections(result: GaitResult, figure: Figure, summary: dict[str, Any]) -> list[Section]:
    """Return the sections of the page."""
    caption = (
        f"Which feet are on the ground, {SHOWN:g} s of the first episode of each policy and command, from the end of "
        "the settling time on. Blue: contact group 0 (FL, MR, RL of a hexapod), orange: group 1."
    )
    claims = table(["sentence", "verdict", "criterion", "numbers"], map(_texts, result.claims))
    return [
        Section("Gait diagram", (picture(figure_uri(figure), caption),)),
        Section("Shares", (gait_table(result.gaits), table(["column", "meaning"], DEFINITIONS))),
        Section("Feet", (feet_table(result.feet),)),
        Section("What the paper says", (paragraph(JUDGED), claims)),
        Section("What was run", run_blocks(summary)),
    ]


JUDGED = (
    "Numbers are means over commands for each training seed; a seed that stands still has no gait and is left out. A "
    "number is above or below its threshold where the 95 % t-interval of the mean over seeds is. One seed decides "
    "nothing."
)


def gait_table(rows: Sequence[GaitRow]) -> Markup:
    """Return the numbers of every policy and command."""
    lines = [
        [
            row.policy,
            row.variant,
            row.command,
            row.gait,
            _number(row.speed_ratio, ".2f"),
            *(_number(getattr(row, name), ".0%") for name in SHARES),
            *(_number(getattr(row, name), ".2f") for name in ("within_groups", "across_groups", "one_sidedness")),
        ]
        for row in rows
    ]
    header = [
        "policy",
        "rewards",
        "command",
        "gait",
        "speed ratio",
        "falls",
        "moving",
        "tripod",
        "group 0",
        "group 1",
    ]
    return table([*header, "flight", "all feet", "together", "within", "across", "one-sidedness"], lines)


SHARES = (
    "fall_rate",
    "moving_share",
    "tripod_share",
    "first_group_share",
    "second_group_share",
    "flight_share",
    "all_feet_share",
    "together_share",
)
"""Fields of `GaitRow` that are shown in per cent."""


def feet_table(rows: Sequence[FootRow]) -> Markup:
    """Return duty factor and stride frequency, a policy and command a line, a foot a column."""
    names = list(dict.fromkeys(row.foot for row in rows))
    cells: dict[tuple[str, str], dict[str, str]] = {}
    for row in rows:
        text = f"{_number(row.duty_factor, '.0%')}, {_number(row.stride_frequency, '.1f')}"
        cells.setdefault((row.policy, row.command), {})[row.foot] = text
    lines = [[policy, command, *(feet.get(name, "") for name in names)] for (policy, command), feet in cells.items()]
    caption = "Duty factor (share of moving steps on the ground), and touch-downs per second of moving [Hz]."
    return table(["policy", "command", *names], lines, caption)


def run_blocks(summary: dict[str, Any]) -> tuple[Markup, ...]:
    """Return what was run, on which policies and which machine."""
    policies = [
        (name, policy["variant"], str(policy["seed"]), policy["revision"], policy["command"])
        for name, policy in summary["policies"].items()
    ]
    cfg = summary["evaluation"]
    return (
        paragraph(f"Command: {summary['command']}"),
        paragraph(
            f"{cfg['episodes']} episodes of {cfg['seconds']:g} s a command, the first {cfg['settle']:g} s left out, "
            f"dry friction {cfg['friction_levels'][0]:.0%} of the torque limit, flat ground, seed {cfg['seed']}."
        ),
        table(["policy", "variant", "seed", "revision", "made by"], policies),
        paragraph(f"Revision {summary['revision']}, {summary['seconds']:.0f} s on {summary['machine']['cpu']}."),
        paragraph("Everything here is simulation (MuJoCo)."),
    )


def _texts(row: ClaimRow) -> tuple[str, ...]:
    """Return a verdict as cells."""
    return row.sentence, row.verdict, row.criterion, row.figures


def _number(value: float | None, form: str) -> str:
    """Return a number as text, a dash where there is none."""
    return "–" if value is None else format(value, form)
