"""Grids of the comparison, each answering one question, each with its own ledger."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.grid import BATCH, GridCfg
from stiction.evaluation.policies import method_of
from stiction.files.contract import Contract
from stiction.files.results import DIRECTIONS
from stiction.files.velocity import STAND
from stiction.joints.net import TorqueSource
from stiction.robots.model import Robot
from stiction.virtual.bench import Bench
from stiction.virtual.cases import Case, parse_level, reported
from stiction_experiments.friction.manifest import MANIFEST, Condition, Run
from stiction_experiments.replication.records import CAUSES

Size = Literal["quick", "full"]

FLAT_COMMANDS = (*DIRECTIONS, "vy=0.3", "wz=0.5", STAND)
"""Every command on flat ground."""

STAIRS_COMMAND = "vx=0.4"
"""The command over stairs."""

SECONDS = 8.0
"""Length of a walk on flat ground [s], what it takes to settle included."""

LEVELS = (0.0, 0.01, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3)
"""Friction over the torque limit; 1 % is the paper's."""

QUICK_LEVELS = (0.0, 0.01, 0.1, 0.2, 0.3)
"""The same for the preset `quick`."""

PAPER_COEFFICIENT = 0.442
"""The paper's number [N m], read as a coefficient."""

COEFFICIENTS = (0.0, 0.02, 0.05, 0.1, 0.2, PAPER_COEFFICIENT)
"""Coefficients of the laws `load` and `effort`."""

OTHER_ENGINES = ("physx", "ode-webots")
"""Engines that are not the one of the training. Plain `ode` and `ode-webots` differ in their settings alone: `stiction
study engines` compares them."""

VIRTUAL_ROBOT, (NOMINAL_CELL, FRICTION_CELL, REST_CELL) = "physx+all", CAUSES
"""The virtual robot, and the cells by which causes are told apart."""

ROBOT_LEVELS = ("0.01", "0.1", "0.2", "0.3", "bench", "bench+0.02", "bench+0.1")
"""Friction of the virtual robot; `bench` is what the paper measured, without load and with some."""

COMPARED = ("none", "direct", "deception")
"""The training methods whose friction is read in other units."""


def conventional(contract: Contract) -> bool:
    """Return whether a policy is for flat ground and never met friction, so that some could be fed forward."""
    return contract.terrain == "flat" and method_of(contract) == "none"


@dataclass(frozen=True)
class Part:
    """One grid of the comparison."""

    name: str
    title: str
    grid: GridCfg
    """Grid of walks of the policies."""
    methods: tuple[str, ...] = ()
    """Training methods that walk in it; none: all."""
    stairs: bool = False
    """True for policies trained on uneven ground, False for those of flat ground."""
    forward: bool = False
    """True if conventional policies also walk with friction fed forward."""

    def takes(self, contract: Contract) -> bool:
        """Return whether a policy walks in it."""
        by_ground = (contract.terrain != "flat") == self.stairs
        return by_ground and (not self.methods or method_of(contract) in self.methods)


def _stairs(quick: bool, robots: int | None) -> tuple[Part, Part]:
    """Return the grids over stairs; arguments as of `parts_of`."""
    # 80 % of crossings are shown by 18, six of each of three seeds, and not by 15 (Wilson: from 0.824, from 0.796). On
    # virtual robots it takes 16 of them, however often each of them crosses.
    base = EvaluationCfg((0.0, 0.2), (STAIRS_COMMAND,), 3 if quick else 6, SECONDS)
    heights = ("stairs=0.08",) if quick else ("stairs=0.06", "stairs=0.08", "stairs=0.1")
    virtual = GridCfg(
        replace(base, episodes=2),
        (VIRTUAL_ROBOT,),
        heights,
        reported(robots or (2 if quick else 16)),
        robot_levels=("0", "0.2") if quick else ("0", "0.1", "0.2"),
    )
    return (
        Part("stairs", "Stairs, up, landing and down", GridCfg(base, (BATCH, *OTHER_ENGINES), heights), stairs=True),
        Part("stairs-robot", "Stairs, on the virtual robot", virtual, stairs=True),
    )


def parts_of(size: Size, robots: int | None = None) -> tuple[Part, ...]:
    """Return the grids of a preset; `robots`: how many virtual robots, by default 2 (quick), or 8, over stairs 16."""
    quick = size == "quick"
    # Training seeds are the sample: episodes differ in their first angles alone, and two show whether that matters.
    base = EvaluationCfg(QUICK_LEVELS if quick else LEVELS, DIRECTIONS, 2, SECONDS)
    flat_robots = reported(robots or (2 if quick else 8))

    def on_robots(
        levels: tuple[str, ...], *cells: str, commands: tuple[str, ...] = DIRECTIONS, forward_only: bool = False
    ) -> GridCfg:
        walk = EvaluationCfg((0.0,), commands, 1, SECONDS)
        return GridCfg(walk, cells, robots=flat_robots, robot_levels=levels, forward_only=forward_only)

    causes = ("0.01", "0.1", "0.2", "bench", "bench+0.02") if quick else ROBOT_LEVELS
    return (
        Part(
            "training",
            "In the simulator of the training",
            GridCfg(replace(base, commands=FLAT_COMMANDS, episodes=8), (BATCH,)),
        ),
        Part(
            "engines",
            "Sim2Sim: other engines",
            GridCfg(base, OTHER_ENGINES if quick else ("mujoco-alone", *OTHER_ENGINES)),
            forward=True,
        ),
        Part("robot", "On the virtual robot", on_robots(ROBOT_LEVELS, REST_CELL, VIRTUAL_ROBOT)),
        Part(
            "standing",
            "On the virtual robot, told to stand",
            on_robots(ROBOT_LEVELS[:-1] if quick else ROBOT_LEVELS, VIRTUAL_ROBOT, commands=(STAND,)),
            ("none", "deception", "iterative"),
        ),
        Part(
            "causes",
            "On the virtual robot: friction alone, and neither friction nor the rest",
            on_robots(causes, NOMINAL_CELL, FRICTION_CELL),
            ("none", "deception"),
        ),
        Part(
            "forward",
            "What a user would try: the virtual robot's identified friction, fed forward",
            on_robots(("0.1", "0.2") if quick else ("0.1", "0.2", "0.3"), VIRTUAL_ROBOT, forward_only=True),
            ("none",),
            forward=True,
        ),
        *_stairs(quick, robots),
        *(
            Part(
                law,
                f"Friction as a coefficient of the {words}",
                GridCfg(EvaluationCfg(COEFFICIENTS, DIRECTIONS, 8, SECONDS, friction_law=law), (BATCH,)),
                COMPARED,
            )
            for law, words in (("load", "joint's load"), ("effort", "motor's torque"))
        ),
    )


STAIRS = ("--friction-level", "0.2", "--teacher.iterations", "1000", "--student.iterations", "200")
"""Options of both trainings on stairs."""

SEEDS = (0, 1, 2)
"""Training seeds that each method has: a criterion takes two, and its interval over two is 3.6 times as wide."""

LOOP_SEEDS = SEEDS
"""Training seeds of the Actuator Net's policies, on flat ground alone."""

OVER_STAIRS = tuple(
    Condition(f"stairs-{method}", "comparison", "stairs, blind", ("--terrain", "stairs", "--method", method, *STAIRS))
    for method in ("none", "deception")
)
"""Conditions over stairs."""

KNOWN_CASE = Case(0, "all", parse_level("0.2"))
"""The virtual robot whose bench says what the method `identified` trains with. It is of the kind of the reported ones
and none of them: of a robot, training sees the `joints.json` from its bench log and nothing else."""

FROM_EXPERIMENT = ("none", "direct", "deception", "finetune", "iterative", "compensation")
"""Conditions of the experiment that the comparison takes: one a training method, none of its ablations."""


def known_bench(spec: Robot) -> Bench:
    """Return the bench of the robot that training knows; spec: its data sheet."""
    return Bench("physx", KNOWN_CASE, spec)


def first_policy(seed: int) -> str:
    """Return the name of the run of f0, which walks on the robot that training knows."""
    return f"coulomb20-none-s{seed}"


ACTUATOR_RUNS: dict[TorqueSource, str] = {
    "output_side": "coulomb20-actuator-output",
    "motor_side": "coulomb20-actuator",
}
"""Side of the gear on which the net's torque was measured -> condition of f1: the paper's way, and its control."""


def actuator_run(net: Path, seed: int, torque_source: TorqueSource) -> Run:
    """Return the run of f1, trained as f0 of the same seed was but for its motors.

    net: of the walks of that f0; torque_source: of the net.
    """
    options = ("--method", "none", "--friction-level", "0.2", "--actuator", str(net))
    what = f"conventional, an Actuator Net of the robot's walk, {torque_source}, in place of the PD law"
    return Run(Condition(ACTUATOR_RUNS[torque_source], "comparison", what, options), seed)


def identified_conditions(joints: Path) -> tuple[Condition, Condition]:
    """Return the conditions that train with what a bench identified: at each joint's value alone, which is what one
    would try first, and from none up to 1.2 of it; joints: the `joints.json`.
    """
    what, known = "each joint's friction as it was identified", ("--joints", str(joints))
    alone = "--method", "direct", *known, "--task.friction.range", "1", "1"
    return (
        Condition("identified-point", "comparison", f"{what}, no range", alone),
        Condition(
            "identified-range", "comparison", f"{what}, from zero up to 1.2 of it", ("--method", "deception", *known)
        ),
    )


def comparison_runs(joints: Path) -> list[Run]:
    """Return every run: those of the experiment, conventional training first, then the comparison's own; seed by seed.

    So a comparison that is cut short has the same seeds of every method. Runs have the experiment's names, so that
    finished ones count; where the experiment has more seeds of a method than `SEEDS`, it has those here too.

    joints: the `joints.json` of `known_bench`.
    """
    known = {condition.name: condition for condition in MANIFEST}
    conditions = (
        *(known[f"coulomb20-{name}"] for name in FROM_EXPERIMENT),
        *OVER_STAIRS,
        *identified_conditions(joints),
    )
    runs = [Run(one, seed) for one in conditions for seed in sorted({*SEEDS, *one.seeds})]
    return sorted(runs, key=lambda run: run.seed)
