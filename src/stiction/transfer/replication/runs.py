"""The training runs of the comparison: those of the experiment that it needs, and a few of its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from stiction.formats.bundle import Bundle
from stiction.robots.spec import RobotSpec
from stiction.transfer.experiment.manifest import MANIFEST, Condition, Run
from stiction.transfer.replication.net import WalkedNet
from stiction.transfer.robot.factorial import Case, parse_level
from stiction.transfer.robot.identification import Bench

STAIRS = ("--friction-level", "0.2", "--teacher.iterations", "1000", "--student.iterations", "200")
"""Options of both trainings on stairs."""

SEEDS = (0, 1, 2)
"""Training seeds that every way has at least: a criterion takes two, and its interval over two is 3.6 times as wide."""

LOOP_SEEDS = SEEDS
"""Training seeds of the Actuator Net's policies, on flat ground alone."""

OVER_STAIRS = tuple(
    Condition(
        *(f"stairs-{method}", "comparison", "stairs, blind"), (*("--terrain", "stairs", "--method", method), *STAIRS)
    )
    for method in ("none", "deception")
)
"""Conditions over stairs."""

KNOWN = Case(0, "all", parse_level("0.2"))
"""The virtual robot whose bench says what the way `identified` trains with. It is of the kind of the reported ones and
none of them: of a robot, training sees the `joints.json` from its bench log and nothing else."""

TAKEN = ("none", "direct", "deception", "finetune", "iterative", "compensation")
"""Conditions of the experiment that the comparison takes: one a way of training, none of its ablations."""


def known_bench(spec: RobotSpec) -> Bench:
    """Return the bench of the robot that training knows; spec: its data sheet."""
    return Bench("physx", KNOWN, spec)


def walked_net(spec: RobotSpec, policy: Bundle) -> WalkedNet:
    """Return the Actuator Net of the robot that training knows; spec: its data sheet; policy: f0, which walks on it."""
    return WalkedNet("physx", KNOWN, spec, policy)


def first_policy(seed: int) -> str:
    """Return the name of the run of f0, which walks on the robot that training knows."""
    return f"coulomb20-none-s{seed}"


def actuator_run(net: Path, seed: int) -> Run:
    """Return the run of f1, trained as f0 of the same seed was but for its motors; net: of the walks of that f0."""
    options = ("--method", "none", "--friction-level", "0.2", "--actuator", str(net))
    what = "conventional, an Actuator Net of the robot's walk in place of the PD law"
    return Run(Condition("coulomb20-actuator", "comparison", what, options), seed)


def told_by_the_bench(joints: Path) -> tuple[Condition, Condition]:
    """Return the conditions of those who train with what a bench said: at each joint's value alone, which is what one
    would try first, and from none up to 1.2 of it; joints: the `joints.json`.
    """
    known = "--joints", str(joints)
    return (
        Condition(
            "identified-point",
            "comparison",
            "each joint's friction as it was identified, no range",
            ("--method", "direct", *known, "--task.friction.range", "1", "1"),
        ),
        Condition(
            "identified-range",
            "comparison",
            "each joint's friction as it was identified, from zero up to 1.2 of it",
            ("--method", "deception", *known),
        ),
    )


def comparison_runs(joints: Path) -> list[Run]:
    """Return every run: those of the experiment, conventional training first, then the comparison's own; seed by seed.

    So a comparison that is cut short has the same seeds of every way. Runs have the names of the experiment's, so that
    finished ones count; where the experiment has more seeds of a way than `SEEDS`, it has those here too.

    joints: the `joints.json` of `known_bench`.
    """
    known = {condition.name: condition for condition in MANIFEST}
    conditions = (*(known[f"coulomb20-{name}"] for name in TAKEN), *OVER_STAIRS, *told_by_the_bench(joints))
    runs = [
        run
        for condition in conditions
        for run in replace(condition, seeds=tuple(sorted({*SEEDS, *condition.seeds}))).runs
    ]
    return sorted(runs, key=lambda run: run.seed)
