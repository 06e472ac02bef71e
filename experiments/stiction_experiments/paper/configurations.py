"""Public configurations of legged locomotion, and the share that randomise joint friction, of sentence 11."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stiction_experiments.lab.statistics import exact_interval
from stiction_experiments.paper.decide import Seeds


@dataclass(frozen=True)
class Configuration:
    """One public repository, by the rules of `results/paper/criteria.md`: a row of configurations.csv."""

    repository: str
    """Owner and name on GitHub."""
    part: str
    """`named` before any was read, or `drawn` from lists of names."""
    vote: str
    """`counts`; `copy`: of another that counts; `out`: no training of legs, or none that randomises."""
    path: str
    """File of the configuration; empty where it does not count."""
    commit: str
    """Version that was read."""
    date: str
    """Day of that commit, as year-month-day; empty where only the file was held."""
    simulator: str
    robots: str
    ground_friction: bool | None
    """True if friction of the ground is drawn; None where it does not count."""
    joint_friction: str
    """`yes`, `no`, or `without effect`, as a factor on a friction of zero: dry friction of the joints is drawn."""
    joint_friction_range: str
    """Range of the draw, with its unit or its base; a bare number is the engine's coefficient."""
    fixed_joint_friction: bool | None
    """True if the joints have a fixed dry friction that is not zero; None where it was not found out."""
    damping: bool | None
    """True if damping or viscous friction of the joints is drawn, beside gains; None where it does not count."""
    in_2024: str
    """As `joint_friction`, of the newest version up to 2024-12-31; empty where it had none then, or was a copy."""
    commit_2024: str
    """Version of the end of 2024; empty where `in_2024` is."""
    note: str


def votes(rows: Sequence[Configuration], in_2024: bool = False) -> Seeds:
    """Return a vote of each repository that counts, by its place in the rows: 1 if it randomises joint friction [1]."""
    return {
        place: float(value == "yes")
        for place, row in enumerate(rows)
        if row.vote == "counts" and (value := row.in_2024 if in_2024 else row.joint_friction)
    }


@dataclass(frozen=True)
class Share:
    """Share of one way to count."""

    counted: str
    yes: int
    """Repositories that randomise joint friction."""
    repositories: int
    low: float
    """Lower end of the exact 95 % interval of the share [1]."""
    high: float
    """Upper end [1]."""


def shares(rows: Sequence[Configuration]) -> list[Share]:
    """Return the share of joint friction in ways to count; the first two decide, others are beside them."""
    counted = [row for row in rows if row.vote == "counts"]
    dated = [row for row in counted if row.in_2024]
    ways = {
        "all": [vote == 1.0 for vote in votes(rows).values()],
        "in 2024": [vote == 1.0 for vote in votes(rows, in_2024=True).values()],
        "named before": [row.joint_friction == "yes" for row in counted if row.part == "named"],
        "drawn by lot": [row.joint_friction == "yes" for row in counted if row.part == "drawn"],
        "all, and copies": [row.joint_friction == "yes" for row in rows if row.vote != "out"],
        "all, draws without effect as a yes": [row.joint_friction != "no" for row in counted],
        "in 2024, draws without effect as a yes": [row.in_2024 != "no" for row in dated],
    }
    return [Share(way, sum(yes), len(yes), *exact_interval(sum(yes), len(yes))) for way, yes in ways.items() if yes]
