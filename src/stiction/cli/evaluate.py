"""`stiction evaluate BUNDLE...`: what a policy reaches over engines, friction, grounds and commands."""

from __future__ import annotations

import shlex
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from stiction.core.effects import excludes, needs, requirement
from stiction.core.errors import ConfigurationError, FileError
from stiction.core.flags import ARGUMENT
from stiction.core.lock import output_folder
from stiction.core.options import read_options, refuse
from stiction.files.following import EVERY
from stiction.files.settings import results_folder
from stiction.report.terminal import RobotSeeds, jobs_of
from stiction.task.friction import law_flag

if TYPE_CHECKING:
    from stiction.files.results import ResultRow


VIRTUAL = needs("--engines mujoco+all", lambda cfg: any("+" in engine for engine in cfg.engines))
"""Requirement of a virtual robot, in any engine."""

TOLD = ("--forward", "--known-friction")
"""Options of policies or controllers that are told the friction of a level."""


@dataclass(frozen=True, kw_only=True)
class EvaluateCfg:
    """Drive policy bundles over engines, friction levels, grounds and commands."""

    bundles: Annotated[tuple[Path, ...], ARGUMENT] = ()
    """Directories of the bundles."""
    policy_callable: str | None = None
    """A policy of your own in Python, `package.module:FUNCTION`, on --robot, in the engine mujoco alone: called as
    FUNCTION(sensors, command, fresh), it returns joint targets, see `evaluation/policies.py`. For evaluation only."""
    callable_period: float = field(default=0.02, metadata=needs("--policy-callable"))
    """Time between two calls of it [s]."""
    friction_levels: tuple[float, ...] = (0.0, 0.1, 0.2)
    """Dry friction in every joint, as fractions of its torque limit [-]; of the laws load and effort, coefficients."""
    joints: tuple[Path, ...] = field(default=(), metadata=excludes("--friction-levels", "--friction-law", *TOLD))
    """Files joints.json with the dry friction of each joint, else of its kind, in place of levels."""
    friction_law: Annotated[str, law_flag("Law of the dry friction, whatever the training's.")] = "coulomb"
    static_ratio: float = field(default=1.5, metadata=needs("--friction-law stribeck"))
    """Friction at rest over friction in motion, of the law stribeck."""
    stribeck_velocity: float = field(default=0.1, metadata=needs("--friction-law stribeck"))
    """Speed at which 63 % of that excess is gone [rad/s], of the law stribeck."""
    engines: tuple[str, ...] = ("mujoco",)
    """Physics engines. mujoco: the simulator of the training, all robots at once; mujoco-alone, physx, ode, ode-webots:
    one robot, steps of 2 ms, motors and friction by us; package.module:ENGINE: the same in an engine of your own (an
    `EngineSpec`). After a +, a virtual robot with joints of its own plays the
    real one: physx+all, or what of it is real: +nominal, +friction, +rest (all but friction), +delays+gears."""
    robots: RobotSeeds = field(default=(1000, 1001, 1002), metadata=VIRTUAL)
    robot_levels: tuple[str, ...] = field(default=(), metadata=VIRTUAL)
    """Friction of virtual robots: fractions of the torque limit, bench (0.442 N m at Saturn Lite's shank, 0.25 N m at
    hip and thigh), bench+0.02 (and that coefficient of the load); by default as --friction-levels."""
    forward: tuple[str, ...] = ()
    """Names of bundles that also walk with friction fed forward in the joint controllers, as policies of their own,
    NAME+measured. Of the data sheet's robot that is the friction of the level, of a virtual robot what identify finds
    on that robot's bench, which takes minutes a robot and level, and what it finds to grow with load too, save by
    error. Under the law effort the level grows with the motor's torque, and error cannot feed it."""
    forward_by: tuple[str, ...] = field(default=("measured",), metadata=needs("--forward"))
    """How: error, all of it in the direction of the position error; reference and measured, 75 % of it by the speed of
    the target or of the joint, and by the error while a joint is stuck, at every reading; reference-motor and
    measured-motor, the same in the motors' controllers. With another share: reference=0.8. Policies are called
    NAME+measured, NAME+reference=0.8, and by error NAME+forward."""
    known_friction: str = "contract"
    """Friction told to policies that observe their joints' friction (`train --task.known-friction`), f/τ_max of each
    kind of joint. contract: as in their bundles; true: as in each robot; bench: of a virtual robot as identified on its
    own bench, which takes minutes per robot and level, else as true; 0.1: this value for every joint; true*0.7,
    bench*1.3: with an error. Other policies are told nothing."""
    terrains: tuple[str, ...] = ("flat",)
    """Grounds: flat, stairs=0.1 (step height [m]), slope=0.2 (angle [rad]), rough=0.05 (highest slab [m]). What is not
    flat is crossed blind, straight on, by the commands that lead forward."""
    commands: tuple[str, ...] = (EVERY,)
    """Commanded velocities, vx forward, vy sideways [m/s], wz turn [rad/s]: vx=0.5 or vx=0.3,wz=0.2 or stand; all: the
    fifteen that a policy has to follow, each axis scaled to the commands of its training."""
    episodes: int = 8
    """Episodes per level and command, of every virtual robot."""
    seconds: float = 20.0
    """Length of an episode [s]; its first 2 s are not measured."""
    seed: int = 0
    """Seed of initial states and sensor noise; the same for every bundle, engine, level and command."""
    jobs: int | None = None
    """Walks at once, each on one thread; by default as many as there are cores (STICTION_THREADS)."""
    action_delay: float = 0.0
    """Delay between joint target and motor [s], in whole physics steps, at most 8 of them; of the engine mujoco."""
    robot: str | None = None
    """A robot of your own, its file or `package.module:NAME`; by default the robot that the bundle names."""
    key: Path | None = field(default=None, metadata=excludes("--policy-callable"))
    """Public key of the maker, a PEM file: every bundle must have this key's signature. Needs the extra sign."""
    log: Path | None = None
    """Also log the walks as a robot would, for `stiction identify` and `stiction train-actuator`: a folder for one NPZ
    per bundle, level, command and robot. The first --log-robots episodes, at the physics rate."""
    log_robots: int = field(default=4, metadata=needs("--log"))
    """Robots to log per level and command."""
    log_seconds: float = field(default=10.0, metadata=needs("--log"))
    """Length of a log [s]; a fall ends it sooner."""
    log_torque: Literal["motor_side", "output_side"] = field(default="motor_side", metadata=needs("--log"))
    """Torque in the log: `motor_side`, what the motor gave (what `stiction identify` needs), or `output_side`, what
    reached the link, dry and viscous friction of the joint taken off."""
    out: Path = Path("stiction-evaluation")
    """Directory for results.csv, methods.csv (every column over the seeds of one training), summary.json,
    friction_budget.svg and .png, and report.html; for walks.jsonl, by which an interrupted command goes on where it
    was; and for bench, what was identified for --forward and --known-friction."""
    judge_again: bool = field(default=False, metadata=excludes(but=("--out", "--json")))
    """Walk nothing: read results.csv and summary.json in --out, and draw its page anew. No bundle is needed."""
    overwrite: bool = False
    """Write over results of other settings in --out."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Check and evaluate the bundles, write the results, print them."""
    cfg = read_options(EvaluateCfg, arguments, "stiction evaluate", DESCRIPTION, groups=GROUPS)
    command = shlex.join(["stiction", "evaluate", *arguments])
    if cfg.judge_again:
        lacking = [name for name in ("results.csv", "summary.json") if not (cfg.out / name).is_file()]
        if lacking:
            raise FileError(
                f"{cfg.out} has no {' and no '.join(lacking)}; expected a folder that `stiction evaluate` wrote: name "
                "it with --out, or evaluate first"
            )
        with output_folder(cfg.out):
            judge_again(cfg, command)
        return 0
    if not cfg.bundles and cfg.policy_callable is None:
        refuse("stiction evaluate", "no bundle given")
    jobs = jobs_of(cfg.jobs)
    from stiction.core.provenance import num_threads
    from stiction.core.records import part_of
    from stiction.evaluation.benches import as_identified
    from stiction.evaluation.evaluate import EvaluationCfg
    from stiction.evaluation.grid import GridCfg, parse_simulator
    from stiction.evaluation.summary import bundle_of, evaluate_all
    from stiction.evaluation.walk_logs import RecordCfg, log_all
    from stiction.report.evaluation import FILES
    from stiction.report.terminal import work_progress

    for engine in cfg.engines:
        parse_simulator(engine)  # names before numbers
    base = part_of(EvaluationCfg, cfg)
    settings = part_of(GridCfg, cfg, base=base)
    record = None if cfg.log is None else RecordCfg(cfg.log_robots, cfg.log_seconds, torque=cfg.log_torque)
    policies: list[Path | str] = [*cfg.bundles]
    if cfg.policy_callable is not None:
        policies.append(cfg.policy_callable)
    # Before the folder: what is no bundle would be called one of other settings than those of the results there.
    bundles = [bundle_of(policy, settings, cfg.robot, cfg.callable_period, cfg.key) for policy in policies]
    settings, notes = as_identified(settings, bundles, cfg.joints) if cfg.joints else (settings, ())
    read = {"bundles": cfg.bundles, "robot": cfg.robot, "joints": cfg.joints}
    with (
        results_folder(cfg.out, "evaluate", cfg, FILES, read),
        nullcontext() if cfg.log is None else output_folder(cfg.log, "--log"),
    ):
        listening = any(bundle.contract.observes_friction for bundle in bundles)
        if cfg.known_friction != EvaluateCfg.known_friction and not listening:
            raise ConfigurationError(requirement("--known-friction", "a policy trained with --task.known-friction"))
        with work_progress() as progress:
            rows, summary = evaluate_all(bundles, settings, cfg.out, cfg.robot, jobs, progress)
            summary["warnings"] += notes
            if record is not None and cfg.log is not None:
                threads = num_threads()
                summary["logs"] = log_all(
                    bundles, settings.base, record, cfg.log, cfg.robot, threads, progress, cfg.overwrite
                )
        write_and_print(cfg, rows, {"command": command} | summary)
    return 0


def judge_again(cfg: EvaluateCfg, command: str) -> None:
    """Draw the page of what a folder has; what an older summary lacks is what it was then."""
    from stiction.core.provenance import Origin
    from stiction.files.results import read_results, read_summary

    rows = read_results(cfg.out / "results.csv")
    engines, terrains = ([*dict.fromkeys(getattr(row, name) for row in rows)] for name in ("engine", "terrain"))
    older = {"engines": engines, "terrains": terrains, "robots": [], "warnings": [], "ways": {}}
    before = {name: value for name, value in read_summary(cfg.out / "summary.json").items() if name != "schema_version"}
    write_and_print(cfg, rows, older | before | {"judged": {"command": command, **Origin.now().provenance}})


def write_and_print(cfg: EvaluateCfg, rows: list[ResultRow], summary: dict[str, Any]) -> None:
    """Write the files and the page; print the rows."""
    from stiction.api.evaluation import Evaluated
    from stiction.files.results import summary_text
    from stiction.report.evaluated import evaluation_glance, rows_table
    from stiction.report.glance import print_glance
    from stiction.report.terminal import Terminal, print_warnings

    Evaluated(tuple(rows), summary).write(cfg.out)
    if cfg.json:
        print_warnings("evaluate", summary["warnings"])
        print(summary_text(summary), end="")
        return
    if "logs" in summary:
        print(f"logs: {len(summary['logs'])} in {cfg.log}")
    print_glance(Terminal(), evaluation_glance(rows, summary, cfg.out), rows_table(rows))


DESCRIPTION = """Drive policy bundles over levels of dry joint friction, velocity commands, grounds and physics engines,
on the robot of the data sheet or on a virtual one with joints of its own, from the bundles alone. A bundle is a
directory, or the name of one that comes with the package.

Examples:
  stiction evaluate runs/mine/bundle
  stiction evaluate saturn_lite-flat-deception-0.2 --friction-levels 0 0.1 0.2 0.3 --commands vx=0.5 vx=-0.5
  stiction evaluate bundle --engines mujoco physx+all --robots 1000 1001

Stop it at any time: the same command goes on. What is lost is the walks in progress, one a core; of the engine mujoco a
batch, some three seconds of computing; of --forward and --known-friction bench the bench in progress, minutes."""

GROUPS = {
    "usually needed": ("--friction-levels", "--commands", "--engines", "--terrains", "--out", "--json"),
    "which robot": ("--robot", "--robots", "--robot-levels"),
    "the friction": ("--friction-law", "--forward", "--known-friction"),
    "how much of it": ("--episodes", "--seconds", "--seed", "--jobs"),
    "what else": ("--log", "--judge-again", "--key", "--overwrite"),
}
"""The options that people use."""
