"""`stiction study disturber BUNDLE...`: what a fresh disturber gains against each frozen policy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from stiction.core.errors import check_once
from stiction.core.flags import ARGUMENT
from stiction_experiments.lab.study import Options, Report, Study, UsageError, Work

if TYPE_CHECKING:
    from stiction_experiments.disturber.duel import DuelRow

DESCRIPTION = """Train a new disturber against each policy, which does not learn any more, and see what it gains.

How well a policy withstands the disturber that it was trained beside says little: a new one finds other weaknesses. It
pushes the base, or puts a torque on each joint that the joint's own friction bounds, in the task of the training, and
maximises the share of the task's reward that is lost. Then the same robots walk with nobody, with random disturbances
within the same limit, and with the disturber, without its exploration. Joints have inertia and viscous friction of the
bundle, as they were in training, drawn about them, and dry friction by the solver's rows; a policy of `compensation`
feeds forward what it was trained with. While robots are judged no episode times out, and one that falls stands up anew,
at the cost of all that 99 control steps would have paid. Policy by seed is cached: a rerun goes on.

Examples:
  stiction study disturber saturn_lite-flat-none-0.2 saturn_lite-flat-deception-0.2 --out disturber
  stiction study disturber BUNDLE --disturber friction --friction-level 0.2 --out disturber-friction"""


@dataclass(frozen=True, kw_only=True)
class DisturberOptions(Options):
    """Options of `stiction study disturber`."""

    policies: Annotated[tuple[Path, ...], ARGUMENT]
    """Directories of the bundles, or names of shipped ones."""
    disturber: str = "force"
    """`force`: pushes the base. `friction`: a torque on each joint, bounded by its friction."""
    limit: float | None = None
    """Largest disturbance, a share of the robot's weight or of each joint's friction [1]; by default half of the
    weight, all of the friction."""
    friction_level: float = 0.0
    """Dry friction of every joint, a fraction of its torque limit [-]; `friction` needs some."""
    command: str = "vx=0.5"
    """Commanded velocity, forward or sideways."""
    iterations: int = 100
    """Rollouts from which the disturber learns: the budget, the same for every policy."""
    steps: int = 24
    """Control steps of one rollout."""
    num_envs: int = 256
    """Robots side by side."""
    seconds: float = 20.0
    """Time for which robots are judged [s], without time-outs; its first 2 s do not count. A robot that falls stands up
    anew, and its way back to speed counts."""
    seeds: tuple[int, ...] = (0, 1)
    """Seeds of disturber and robots."""
    robot: str | None = None
    """The robot, where the bundles' is not a shipped one."""
    out: Path = Path("stiction-disturber")
    """Directory for duels.csv, gains.csv, summary.json and report.html; and for parts, what was done."""


@dataclass(frozen=True)
class Gain:
    """Cost of the disturbances for a policy; a row of gains.csv."""

    policy: str = field(metadata={"label": "policy"})
    disturbed_by: str = field(metadata={"label": "disturbed by"})
    """Draws, or the disturber that learned."""
    seeds: int = field(metadata={"label": "seeds"})
    falls: float = field(metadata={"label": "more falls [1/s]", "form": "+.4f"})
    """Falls above those with nobody, mean over seeds [1/s]."""
    speed_ratio: float = field(metadata={"label": "speed ratio", "form": "+.3f"})
    """Change of the speed ratio."""
    tracking_error: float = field(metadata={"label": "tracking error [m/s]", "form": "+.3f"})
    """Change of the tracking error [m/s]."""
    cost: float = field(metadata={"label": "cost", "form": "+.3f"})
    """Change of the share of the task's reward that is lost, mean over seeds; what the disturber was trained for."""
    least: float = field(metadata={"label": "least", "form": "+.3f"})
    """The same, in the seed with the least."""
    most: float = field(metadata={"label": "most", "form": "+.3f"})
    """The same, in the seed with the most."""


def gains(rows: Sequence[DuelRow]) -> list[Gain]:
    """Return what each side changed against nobody, policy by policy; rows: of one budget."""
    differences = []
    calm = {(row.policy, row.seed): row for row in rows if row.disturbed_by == "nobody"}
    for policy in dict.fromkeys(row.policy for row in rows):
        for who in ("random", "learned"):
            pairs = [(r, calm[policy, r.seed]) for r in rows if (r.policy, r.disturbed_by) == (policy, who)]

            def mean(name: str, pairs: Sequence[tuple[DuelRow, DuelRow]] = pairs) -> float:
                return sum(getattr(a, name) - getattr(b, name) for a, b in pairs) / len(pairs)

            costs = [a.cost - b.cost for a, b in pairs]
            changes = (mean("fall_rate"), mean("speed_ratio"), mean("tracking_error"), mean("cost"))
            differences.append(Gain(policy, who, len(pairs), *changes, min(costs), max(costs)))
    return differences


def _part(fight: Callable[..., list[dict[str, Any]]], *arguments: Any) -> dict[str, Any]:
    return {"rows": fight(*arguments)}


def run(options: DisturberOptions, work: Work) -> Report:
    """Train a disturber for every policy and seed, and judge."""
    if not options.policies or not options.seeds:
        raise UsageError("no bundle given" if not options.policies else "no seed given")
    from functools import partial

    from stiction.core.decode import from_plain
    from stiction.core.records import part_of
    from stiction.evaluation.summary import describe
    from stiction_experiments.disturber.duel import DuelCfg, DuelRow, fight, task_for

    check_once("seeds", options.seeds)
    cfg, bundles = part_of(DuelCfg, options), work.bundles(options.policies)
    for bundle in bundles:
        task_for(bundle.contract, cfg, options.robot)
    work.begin()
    rows: list[DuelRow] = []
    for bundle in bundles:
        for seed in options.seeds:
            inputs = {"bundle": bundle.digest, "cfg": asdict(cfg), "seed": seed, "robot": options.robot}
            name = f"{bundle.name}--{seed}"
            watch = partial(work.progress, name)
            part = work.cached(
                name, inputs, partial(_part, fight, bundle, cfg, seed, work.threads, watch, options.robot)
            )
            rows += [from_plain(DuelRow, dict(row), "a duel of before") for row in part["rows"]]
            work.progress(name, 1.0)
    return report(rows, {"settings": asdict(cfg), "policies": {bundle.name: describe(bundle) for bundle in bundles}})


def report(rows: Sequence[DuelRow], summary: Mapping[str, Any]) -> Report:
    """Return the tables and the page."""
    from stiction.report.page import Section, row_table

    losses = gains(rows)
    by_who = {(gain.policy, gain.disturbed_by): gain for gain in losses}
    words = [
        f"{policy} {by_who[policy, 'learned'].cost:+.3f} ({by_who[policy, 'random'].cost:+.3f} by draws)"
        for policy in dict.fromkeys(gain.policy for gain in losses)
    ]
    return Report(
        title="A fresh disturber against each policy",
        lead=f"Share of the task's reward that the disturber takes beside what is lost without: {'; '.join(words)}.",
        tables={"duels": rows, "gains": losses},
        sections=[
            Section("What is lost beside what is lost with nobody", (row_table(losses),)),
            Section("How the robots walked", (row_table(rows),)),
        ],
        summary=summary,
        notes=["A disturber with another budget, or another seed, may find more: what it gains is a lower bound."],
    )


STUDY = Study(
    "what a fresh disturber gains against each frozen policy",
    DESCRIPTION,
    DisturberOptions,
    run,
    results=("duels.csv", "gains.csv"),
)
