"""The training runs of the comparison: those of the experiment that it needs, and a few of its own."""

from __future__ import annotations

from stiction.transfer.experiment.manifest import Condition, Run, runs_of

STAIRS = ("--friction-level", "0.2", "--teacher.iterations", "1000", "--student.iterations", "200")
"""Options of both trainings on stairs."""

OWN = (
    Condition(
        "coulomb20-point",
        "comparison",
        "the nominal friction alone, no range: what one would try first",
        ("--method", "direct", "--friction-level", "0.2", "--task.friction.range", "1", "1"),
    ),
    *(
        Condition(
            *(f"stairs-{method}", "comparison", "stairs, blind"),
            (*("--terrain", "stairs", "--method", method), *STAIRS),
        )
        for method in ("none", "deception")
    ),
)
"""Conditions that no other experiment has. The Actuator Net's policy comes out of `stiction study actuator`."""


TAKEN = ("none", "direct", "deception", "finetune", "iterative", "compensation")
"""Conditions of the experiment that the comparison takes: one a way of training, none of its ablations."""


def comparison_runs() -> list[Run]:
    """Return every run: those of the experiment, conventional training first, then the comparison's own."""
    names = [f"coulomb20-{name}" for name in TAKEN]
    taken = [run for run in runs_of(("1", "2")) if run.condition.name in names]
    return [*taken, *(run for condition in OWN for run in condition.runs)]
