"""The page of a study of gaits: contact bars of every foot, shares, and verdicts on the paper's sentences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from stiction.evaluate.metrics import MOVING_SPEED
from stiction.report.page import COLORS, Section, figure_uri, new_figure, paragraph, picture, row_table, table
from stiction.studies.claims import Verdict
from stiction.studies.gait.measure import (
    HOP,
    PRONK,
    SHORTEST,
    SIMULTANEOUS,
    STANDS,
    TRIPOD,
    UNSYNC_WINDOW,
    VARIANTS,
    FootRow,
    GaitRow,
)
from stiction.studies.study import Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN = 3.0
"""How much of a walk the diagram shows [s]."""

DEFINITIONS = (
    ("rewards", "; ".join(f"{name}: {words}" for name, words in VARIANTS.items())),
    ("moving", f"share of steps in which the base moves (over {MOVING_SPEED:g} m/s), what all other shares are of"),
    (
        "tripod",
        "exactly one contact group on the ground, no foot more or less, as in r_trot; then each group by itself",
    ),
    ("flight, all feet", "no foot on the ground; all feet on it"),
    (
        "together",
        f"share of touch-downs and lift-offs in which every foot takes part within {SIMULTANEOUS:g} s: 1 in a pronk, 0 "
        f"in a tripod; contacts and swings shorter than {SHORTEST:g} s are bounces and do not count",
    ),
    (
        "within, across",
        "mean correlation of two feet's contacts, of one group and of two: a tripod has 1 and −1, a pronk 1 and 1",
    ),
    (
        "one-sidedness",
        f"difference of the two groups' use over their sum, in windows of {UNSYNC_WINDOW:g} s: 0 is even, 1 one group "
        "alone",
    ),
    (
        "gait",
        f"stands: moving under {STANDS:.0%}; else pronk: together at least {PRONK:.0%}; else hop on one group: "
        f"one-sidedness at least {HOP:g}; else tripod: tripod share at least {TRIPOD:.0%}; else none of these",
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
    claims: tuple[Verdict, ...]
    """One row a sentence."""
    contacts: tuple[np.ndarray, ...]
    """Contacts of the first episode of each row of `gaits`, feet as in `feet`, bool, shape (T, L)."""
    period: float
    """Control period [s]."""


def report(result: GaitResult, settings: dict[str, Any]) -> Report:
    """Return the report of the study. settings: `evaluation`, `seconds`, and `policies` with their variants."""
    figure = draw_gaits(result)
    said = lead(result)

    def write_contacts(out: Path) -> None:
        arrays = {f"{row.policy} {row.command}": c for row, c in zip(result.gaits, result.contacts, strict=True)}
        np.savez_compressed(out / "contacts.npz", allow_pickle=False, period=np.array(result.period), **arrays)

    return Report(
        title="Gait",
        lead=said,
        tables={"gaits": result.gaits, "feet": result.feet},
        claims=result.claims,
        judged=JUDGED,
        sections=sections(result, figure),
        run=run_blocks(settings),
        summary=settings
        | {"lead": said, "gaits": list(map(asdict, result.gaits)), "feet": list(map(asdict, result.feet))},
        figures={"gait": figure},
        files=write_contacts,
    )


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


def sections(result: GaitResult, figure: Figure) -> list[Section]:
    """Return the sections of the page."""
    caption = (
        f"Which feet are on the ground, {SHOWN:g} s of the first episode of each policy and command, from the end of "
        "the settling time on. Blue: contact group 0 (FL, MR, RL of a hexapod), orange: group 1."
    )
    return [
        Section("Gait diagram", (picture(figure_uri(figure), caption),)),
        Section("Shares", (row_table(result.gaits), table(["column", "meaning"], DEFINITIONS))),
        Section("Feet", (feet_table(result.feet),)),
    ]


JUDGED = (
    "Numbers are means over commands for each training seed; a seed that stands still has no gait and is left out. A "
    "number is above or below its threshold where the 95 % t-interval of the mean over seeds is. One seed decides "
    "nothing."
)


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


def run_blocks(settings: dict[str, Any]) -> tuple[Markup, ...]:
    """Return what was run, on which policies."""
    policies = [
        (name, policy["variant"], str(policy["seed"]), policy["revision"], policy["command"])
        for name, policy in settings["policies"].items()
    ]
    cfg = settings["evaluation"]
    return (
        paragraph(
            f"{cfg['episodes']} episodes of {cfg['seconds']:g} s a command, the first {cfg['settle']:g} s left out, "
            f"dry friction {cfg['friction_levels'][0]:.0%} of the torque limit, flat ground, seed {cfg['seed']}."
        ),
        table(["policy", "variant", "seed", "revision", "made by"], policies),
        paragraph("Everything here is simulation (MuJoCo)."),
    )


def _number(value: float | None, form: str) -> str:
    """Return a number as text, a dash where there is none."""
    return "–" if value is None else format(value, form)
