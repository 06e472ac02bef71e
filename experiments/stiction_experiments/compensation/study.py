"""`stiction study compensation BUNDLE...`: friction fed forward in every way, walking and standing still."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from stiction.core.errors import check_once
from stiction.core.flags import ARGUMENT
from stiction.files.results import DIRECTIONS
from stiction.joints.compensation import parse_compensation
from stiction.report.terminal import RobotSeeds
from stiction_experiments.lab.study import ParallelOptions, RedrawnOptions, Report, Study, UsageError, Work, recorded

if TYPE_CHECKING:
    from stiction_experiments.compensation.standing import Standing

DESCRIPTION = """Feed friction forward in every way, with a right share of it and with a wrong one, and see who follows.

Policies that never met friction walk in the simulator of the training, without it and with it fed forward; others walk
as they are, to be compared. The friction that is fed is the joints' own times the share: of 0.75, 0.525 and 0.975 are
what comes of an identification that is 30 % too low or too high, 0.375 and 1.125 of one that is 50 % off. Then virtual
robots, with delays, backlash and sensors of their own, hold their standing pose: do their joints move to and fro? The
friction of each of their joints in motion is taken as known. With friction as benches identify it, walks are `stiction
evaluate --forward --forward-by`.

Example:
  stiction study compensation saturn_lite-flat-none-0.2 saturn_lite-flat-deception-0.2 --out compensation"""

SHARES = (0.375, 0.525, 0.7, 0.75, 0.8, 0.975, 1.125)

OLD = ("error", *(f"error={share:g}" for share in (0.5, 0.7, 1.3, 1.5)))
"""By the position error, all of the friction, as the comparison fed it first."""

WAYS = (*OLD, *(f"{by}={share:g}" for by in ("reference", "measured") for share in SHARES))
"""Ways and shares of the walks: as identified, 30 % off, and 50 % off."""

STANDING = (
    "error",
    "error=1.5",
    *(f"{by}{wrong}" for by in ("reference", "measured", "measured-motor") for wrong in ("", "=1.125")),
)
"""Compensations of the standing robots."""


@dataclass(frozen=True, kw_only=True)
class CompensationOptions(ParallelOptions, RedrawnOptions):
    """Options of `stiction study compensation`."""

    policies: Annotated[tuple[Path, ...], ARGUMENT]
    """Directories of the bundles, or names of shipped ones."""
    ways: tuple[str, ...] = WAYS
    """How friction is fed forward while robots walk, and which share of it."""
    friction_levels: tuple[float, ...] = (0.0, 0.1, 0.2, 0.3)
    """Dry friction as fractions of each joint's torque limit [-], of `effort` its coefficient; at 0 there is nothing to
    feed forward."""
    friction_law: str = "coulomb"
    """Law of the dry friction while robots walk. That of `effort` grows with the motor's torque: give `--ways` without
    `error`, which feeds none of it. Virtual robots that stand still have a law of their own."""
    commands: tuple[str, ...] = DIRECTIONS
    """Commanded velocities; with stand the page shows how much joints shake then."""
    episodes: int = 16
    """Episodes per level and command."""
    seconds: float = 10.0
    """Length of an episode [s]; its first 2 s are not measured."""
    seed: int = 1000
    """Seed of initial states and sensor noise; the ways were tuned with other ones, and on another policy."""
    standing: tuple[str, ...] = STANDING
    """How friction is fed forward while virtual robots stand still; `--standing` alone: nobody stands."""
    robots: RobotSeeds = (1000, 1001)
    robot_levels: tuple[str, ...] = ("0.2",)
    """Friction of the virtual robots, fractions of the torque limit."""
    engine: str = "physx"
    """Their physics engine: physx, ode, ode-webots, mujoco."""
    out: Path = Path("stiction-compensation")
    """Directory for walks.csv, standing.csv, summary.json and report.html; and for parts, what was done, by which an
    interrupted command goes on."""


def run(options: CompensationOptions, work: Work) -> Report:
    """Walk in every way, then stand still; or draw the page of what did anew."""
    if options.judge_again:
        return redrawn(options.out, work)
    if not options.policies:
        raise UsageError("no bundle given")
    from functools import partial

    from stiction.core.parallel import spread
    from stiction.core.records import part_of
    from stiction.evaluation.evaluate import EvaluationCfg
    from stiction.evaluation.grid import check_fed_law
    from stiction.evaluation.policies import method_of
    from stiction.evaluation.summary import describe
    from stiction.files.contract import robot_of
    from stiction.virtual.cases import parse_levels, warnings_on
    from stiction_experiments.compensation.page import report
    from stiction_experiments.compensation.standing import stand_by
    from stiction_experiments.compensation.walking import walk_by

    for name in ("ways", "standing", "robots"):
        check_once(name, getattr(options, name), least=0)
    cfg = part_of(EvaluationCfg, options)
    fed_ways = [*map(parse_compensation, options.ways)]
    check_fed_law(cfg.friction_law, fed_ways)
    ways = [None, *fed_ways]
    stand_ways = [None, *map(parse_compensation, options.standing)] if options.standing else []
    parse_levels(options.robot_levels)
    bundles = work.bundles(options.policies)
    work.begin()
    plans = [(b, how) for b in bundles for how in (ways if method_of(b.contract) == "none" else ways[:1])]
    fed = replace(cfg, friction_levels=tuple(level for level in cfg.friction_levels if level) or (0.0,))
    walks = []
    for count, (bundle, how) in enumerate(plans, 1):
        at = cfg if how is None else fed
        name = f"{bundle.name}--{'none' if how is None else how.label}"
        inputs = {"bundle": bundle.digest, "cfg": asdict(at), "how": None if how is None else asdict(how)}
        walks += work.cached(name, inputs, partial(walk_by, bundle, at, how, work.threads))["rows"]
        work.progress("walks", count / len(plans))
    spec = robot_of(bundles[0].contract)
    tasks = [
        (options.engine, seed, level, spec, how)
        for level in options.robot_levels
        for seed in options.robots
        for how in stand_ways
    ]
    stood: dict[int, Standing] = {}
    for number, row in spread(stand_by, tasks, work.jobs):
        stood[number] = row
        work.progress("standing", len(stood) / len(tasks))
    return report(
        walks,
        [stood[number] for number in range(len(tasks))],
        {
            "settings": asdict(cfg),
            "policies": {bundle.name: describe(bundle) for bundle in bundles},
            "robots": list(options.robots),
            "engine": options.engine,
        },
        warnings_on(options.robots if stand_ways else ()),
    )


def redrawn(out: Path, work: Work) -> Report:
    """Return the report of the walks that a folder has."""
    from stiction.core.records import read_rows
    from stiction.files.results import read_results
    from stiction_experiments.compensation.page import report
    from stiction_experiments.compensation.standing import Standing

    before = recorded(out, work, ("settings", "policies", "engine"))
    stood = read_rows(out / "standing.csv", Standing, optional=True)
    return report([asdict(row) for row in read_results(out / "walks.csv")], stood, before, ())


STUDY = Study(
    "whether friction fed forward makes a policy follow, and whether it hunts at standstill",
    DESCRIPTION,
    CompensationOptions,
    run,
    results=("walks.csv", "following.csv", "standing.csv"),
)
