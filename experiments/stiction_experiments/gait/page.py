"""The page of a study of gaits: contact bars of every foot, shares, and verdicts on the paper's sentences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from stiction.evaluation.metrics import MOVING_SPEED
from stiction.files.tables import publish_npz
from stiction.report.page import (
    COLORS,
    Section,
    figure_block,
    file_uri,
    new_figure,
    paragraph,
    picture,
    row_table,
    table,
)
from stiction_experiments.gait.measure import (
    HOP,
    NO_GAIT,
    PRONK,
    SHORTEST,
    SIMULTANEOUS,
    STANDS,
    TRIPOD,
    UNSYNC_WINDOW,
    VARIANTS,
    FootRow,
    GaitRow,
    Walked,
)
from stiction_experiments.lab.claims import Verdict
from stiction_experiments.lab.study import Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAMED = {NO_GAIT: "no clear gait"}
"""Words of the lead for a gait without a name."""

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
"""Meaning of the columns."""


def report(
    gaits: Sequence[GaitRow],
    feet: Sequence[FootRow],
    claims: Sequence[Verdict],
    settings: dict[str, Any],
    walked: Sequence[Walked] = (),
    drawn: Path | None = None,
) -> Report:
    """Return the report of the study.

    settings: `evaluation`, `seconds`, and `policies` with their variants. walked: what is drawn, or drawn: the file of
    a diagram of before, where contacts were not kept.
    """
    figure, answer = draw_gaits(walked) if walked else None, lead(gaits)

    def write_contacts(out: Path) -> None:
        arrays = {f"{one.row.policy} {one.row.command}": one.contact for one in walked}
        publish_npz(out / "contacts.npz", {"period": np.array(walked[0].period), **arrays}, compressed=True)

    caption = (
        f"Which feet are on the ground, {SHOWN:g} s of the first episode of each policy and command, from the end of "
        "the settling time on. Blue: the first contact group (FL, MR, RL of a hexapod), orange: the second."
    )
    diagram: tuple[Markup, ...] = ()
    if figure is not None:
        diagram = (figure_block(figure, caption),)
    elif drawn is not None:
        diagram = (picture(file_uri(drawn), caption, white=True),)
    return Report(
        title="Which of the two gait rewards makes the tripod?",
        lead=answer,
        tables={"gaits": gaits, "feet": feet},
        claims=claims,
        judged=JUDGED,
        sections=(
            Section("Gait diagram", diagram),
            Section("Shares", (row_table(gaits, grouped=True), table(["column", "meaning"], DEFINITIONS))),
            Section("Feet", (feet_table(feet),)),
        ),
        run=run_blocks(settings),
        summary=settings | {"lead": answer, "gaits": list(map(asdict, gaits)), "feet": list(map(asdict, feet))},
        figures={} if figure is None else {"gait": figure},
        files=write_contacts if walked else None,
    )


def draw_gaits(walked: Sequence[Walked]) -> Figure:
    """Return the contact bars of every policy (down) and command (across), a foot a line, coloured by contact group."""
    commands = list(dict.fromkeys(one.row.command for one in walked))
    policies = list(dict.fromkeys(one.row.policy for one in walked))
    height = 0.6 + 1.9 * len(policies)
    figure, axes = new_figure(len(policies), len(commands), size=(5.2 * len(commands), height))
    for one in walked:
        row, feet, shown = one.row, one.feet, one.contact[: round(SHOWN / one.period)]
        axis = axes[policies.index(row.policy) * len(commands) + commands.index(row.command)]
        for line, foot in enumerate(feet):
            axis.broken_barh(bars(shown[:, line], one.period), (line - 0.38, 0.76), color=COLORS[foot.group])
        axis.set(xlim=(0.0, len(shown) * one.period), ylim=(len(feet) - 0.5, -0.5), xlabel="time [s]")
        axis.set_yticks(range(len(feet)), [foot.foot for foot in feet])
        axis.set_title(f"{row.policy}, {row.command}: {row.gait}")
    return figure


def bars(contact: np.ndarray, period: float) -> list[tuple[float, float]]:
    """Return begin and length of each contact [s]; contact: one foot, bool, shape (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], contact, [False]]).astype(int)))
    return [(begin * period, (end - begin) * period) for begin, end in edges.reshape(-1, 2).tolist()]


def lead(rows: Sequence[GaitRow]) -> str:
    """Return which reward makes the tripod, to be read aloud, then which gait the policies of each variant have."""
    phrases, tripod = [], {}
    for variant, trained in VARIANTS.items():
        own = [row for row in rows if row.variant == variant]
        counts = Counter(row.gait for row in own).most_common()
        walks = " and ".join(f"{NAMED.get(gait, gait)} in {number} of {len(own)} walks" for gait, number in counts)
        phrases += [f"with {trained}: {walks}"] if own else []
        if own:
            tripod[variant] = all(row.gait == "tripod" for row in own)
    return f"{_makes(tripod)}Trained {'; '.join(phrases)}."


def _makes(tripod: Mapping[str, bool]) -> str:
    """Return which rewards make the tripod, where all four variants walked: variant -> whether in all of its walks."""
    if set(tripod) != set(VARIANTS):
        return ""
    makers = [VARIANTS[name] for name in VARIANTS if tripod[name]]
    return f"The tripod comes {', and '.join(f'with {one}' for one in makers) or 'with none of them'}.\n"


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
        duty, frequency = row.duty_factor, row.stride_frequency
        text = "–" if duty is None or frequency is None else f"{duty:.0%}, {frequency:.1f}"
        cells.setdefault((row.policy, row.command), {})[row.foot] = text
    lines = [[policy, command, *(feet.get(name, "") for name in names)] for (policy, command), feet in cells.items()]
    caption = "Duty factor (share of moving steps on the ground), and touch-downs per second of moving."
    return table(["policy", "command", *(f"{name} [%, Hz]" for name in names)], lines, caption, grouped=True)


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
