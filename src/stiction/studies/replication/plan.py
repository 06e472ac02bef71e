"""What the comparison consists of: grids, each answering one question, each with its own ledger."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from stiction.evaluate.command import STAND
from stiction.evaluate.evaluate import EvaluationCfg
from stiction.evaluate.grid import BATCH, GridCfg
from stiction.evaluate.methods import method_of
from stiction.formats.bundle import Bundle
from stiction.formats.contract import Contract
from stiction.formats.results import DIRECTIONS
from stiction.robots.model import Robot
from stiction.studies.friction.manifest import MANIFEST, Condition, Run
from stiction.studies.replication.net import WalkedNet
from stiction.studies.replication.records import CAUSES
from stiction.virtual.bench import Bench
from stiction.virtual.cases import Case, parse_level, reported

Size = Literal["quick", "full"]

ALL = (*DIRECTIONS, "vy=0.3", "wz=0.5", STAND)
"""Every command on flat ground."""

OVER = "vx=0.4"
"""The command over stairs."""

SECONDS = 8.0
"""Length of a walk on flat ground [s], what it takes to settle included."""

LEVELS = (0.0, 0.01, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3)
"""Friction over the torque limit; 1 % is the paper's."""

SHORT = (0.0, 0.01, 0.1, 0.2, 0.3)
"""The same for the preset `quick`."""

PAPER = 0.442
"""The paper's number [N m], read as a coefficient."""

COEFFICIENTS = (0.0, 0.02, 0.05, 0.1, 0.2, PAPER)
"""Of the laws `load` and `effort`."""

OTHERS = ("physx", "ode-webots")
"""Engines that are not the one of the training. Plain `ode` and `ode-webots` differ in their settings alone: `stiction
study engines` compares them."""

ROBOT, (NOMINAL, FRICTION, REST) = "physx+all", CAUSES
"""The virtual robot, and the cells by which causes are told apart."""

ROBOT_LEVELS = ("0.01", "0.1", "0.2", "0.3", "bench", "bench+0.02", "bench+0.1")
"""Friction of the virtual robot; `bench` is what the paper measured, without load and with some."""

COMPARED = ("none", "direct", "deception")
"""The training methods whose friction is read in other units."""


def everyone(contract: Contract) -> bool:
    """Take every policy for flat ground."""
    return contract.terrain == "flat"


def compared(contract: Contract) -> bool:
    """Take the policies whose friction is read in other units."""
    return everyone(contract) and method_of(contract) in COMPARED


def conventional(contract: Contract) -> bool:
    """Take the policies for flat ground that never met friction, and could be fed some forward."""
    return everyone(contract) and method_of(contract) == "none"


def told_to_stand(contract: Contract) -> bool:
    """Take the policies of which a sentence says how they stand, and those to hold them against."""
    return everyone(contract) and method_of(contract) in ("none", "deception", "iterative")


def told_apart(contract: Contract) -> bool:
    """Take the policies with which the causes on the virtual robot are told apart."""
    return everyone(contract) and method_of(contract) in ("none", "deception")


def climbers(contract: Contract) -> bool:
    """Take the policies that were trained on ground that is not flat."""
    return contract.terrain != "flat"


@dataclass(frozen=True)
class Part:
    """One grid of the comparison."""

    name: str
    """Name of its folder."""
    title: str
    """What it asks."""
    takes: Callable[[Contract], bool]
    """Which policies walk in it."""
    grid: GridCfg
    """What they are put through."""
    forward: bool = False
    """Whether conventional policies also walk with friction fed forward."""


def parts_of(size: Size, robots: int | None = None) -> tuple[Part, ...]:
    """Return the grids of a preset; `robots`: how many virtual robots, by default 2 (quick), or 8, over stairs 16."""
    quick = size == "quick"
    seeds = reported(robots or (2 if quick else 8))
    return (*_engines(quick), *_robot(quick, seeds), *_stairs(quick, robots), *_units())


def _engines(quick: bool) -> tuple[Part, ...]:
    # Training seeds are the sample: episodes differ in their first angles alone, and two show whether that matters.
    levels = SHORT if quick else LEVELS
    return (
        Part(
            "training",
            "In the simulator of the training",
            everyone,
            GridCfg(EvaluationCfg(levels, ALL, 8, SECONDS), (BATCH,)),
        ),
        Part(
            "engines",
            "Sim2Sim: other engines",
            everyone,
            GridCfg(
                EvaluationCfg(levels, DIRECTIONS, 2, SECONDS),
                OTHERS if quick else ("mujoco-alone", *OTHERS),
            ),
            forward=True,
        ),
    )


def _robot(quick: bool, seeds: tuple[int, ...]) -> tuple[Part, ...]:
    def grid(
        commands: tuple[str, ...], cells: tuple[str, ...], short: tuple[str, ...], long: tuple[str, ...]
    ) -> GridCfg:
        base = EvaluationCfg((0.0,), commands, 1, SECONDS)
        return GridCfg(base, cells, robots=seeds, robot_levels=short if quick else long)

    told = ("0.1", "0.2")
    return (
        Part("robot", "On the virtual robot", everyone, grid(DIRECTIONS, (REST, ROBOT), ROBOT_LEVELS, ROBOT_LEVELS)),
        Part(
            "standing",
            "On the virtual robot, told to stand",
            told_to_stand,
            grid((STAND,), (ROBOT,), ROBOT_LEVELS[:-1], ROBOT_LEVELS),
        ),
        Part(
            "causes",
            "On the virtual robot: friction alone, and neither friction nor the rest",
            told_apart,
            grid(
                DIRECTIONS,
                (NOMINAL, FRICTION),
                ("0.01", *told, "bench", "bench+0.02"),
                ("0.01", *told, "0.3", "bench", "bench+0.02", "bench+0.1"),
            ),
        ),
        Part(
            "forward",
            "What a user would try: the virtual robot's identified friction, fed forward",
            conventional,
            replace(grid(DIRECTIONS, (ROBOT,), told, (*told, "0.3")), forward_only=True),
            forward=True,
        ),
    )


def _stairs(quick: bool, robots: int | None) -> tuple[Part, ...]:
    # 80 % of crossings are shown by 18, six of each of three seeds, and not by 15 (Wilson: from 0.824, from 0.796). On
    # virtual robots it takes 16 of them, however often each of them crosses.
    heights = ("stairs=0.08",) if quick else ("stairs=0.06", "stairs=0.08", "stairs=0.1")
    seeds = reported(robots or (2 if quick else 16))
    base = EvaluationCfg((0.0, 0.2), (OVER,), 3 if quick else 6, SECONDS)
    return (
        Part("stairs", "Stairs, up, landing and down", climbers, GridCfg(base, (BATCH, *OTHERS), heights)),
        Part(
            "stairs-robot",
            "Stairs, on the virtual robot",
            climbers,
            GridCfg(
                replace(base, episodes=2),
                (ROBOT,),
                heights,
                robots=seeds,
                robot_levels=("0", "0.2") if quick else ("0", "0.1", "0.2"),
            ),
        ),
    )


def _units() -> tuple[Part, ...]:
    return tuple(
        Part(
            law,
            f"Friction as a coefficient of the {words}",
            compared,
            GridCfg(EvaluationCfg(COEFFICIENTS, DIRECTIONS, 8, SECONDS, friction_law=law), (BATCH,)),
        )
        for law, words in (("load", "joint's load"), ("effort", "motor's torque"))
    )


STAIRS = ("--friction-level", "0.2", "--teacher.iterations", "1000", "--student.iterations", "200")
"""Options of both trainings on stairs."""

SEEDS = (0, 1, 2)
"""Training seeds that each method has: a criterion takes two, and its interval over two is 3.6 times as wide."""

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
"""Conditions of the experiment that the comparison takes: one a training method, none of its ablations."""


def known_bench(spec: Robot) -> Bench:
    """Return the bench of the robot that training knows; spec: its data sheet."""
    return Bench("physx", KNOWN, spec)


def walked_net(spec: Robot, policy: Bundle) -> WalkedNet:
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

    So a comparison that is cut short has the same seeds of every method. Runs have the experiment's names, so that
    finished ones count; where the experiment has more seeds of a method than `SEEDS`, it has those here too.

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
