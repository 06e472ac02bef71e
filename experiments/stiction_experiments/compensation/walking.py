"""Walks of one policy in the simulator of the training, friction fed forward in one way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from stiction.core.records import LATER, column
from stiction.evaluation.benches import fed_at_level
from stiction.evaluation.evaluate import EvaluationCfg, evaluate_bundle
from stiction.evaluation.policies import fed_suffix
from stiction.files.bundle import Bundle
from stiction.files.results import ResultRow
from stiction.joints.compensation import Compensation
from stiction_experiments.lab.straight import pace, worst


def walk_by(bundle: Bundle, cfg: EvaluationCfg, compensation: Compensation | None, threads: int) -> dict[str, Any]:
    """Return `rows`, of results.csv, of a policy at every level and command, with friction fed forward or without.

    What is fed is the level's own, as `stiction evaluate --forward` feeds it: see `fed_at_level`.
    """
    contract, controller, suffix = bundle.contract, None, ""
    if compensation is not None:
        limit = contract.array("torque_limit")
        friction, load = fed_at_level(cfg.friction_law, cfg.robot_levels[:, None], limit)
        period, width = contract.physics_timestep, contract.compensation_width
        controller = compensation.controller(friction, period, width, 0.0 if load is None else load)
        suffix = fed_suffix(compensation)
    rows = evaluate_bundle(bundle, cfg, threads=threads, compensation=controller).rows
    return {"rows": [asdict(replace(r, policy=r.policy + suffix, method=r.method + suffix)) for r in rows]}


@dataclass(frozen=True)
class Followed:
    """Walk of a policy at one friction, and whether it follows; a row of the page."""

    policy: str = field(metadata=column("policy"))
    """Name of the bundle, and how friction was fed forward."""
    friction_level: float = field(metadata=column("friction", "of τ_max, or c"))
    """Friction of every joint, over its torque limit, or the coefficient of the law [-]."""
    forward: float = field(metadata=column("forward", "1", form=".2f"))
    """Speed reached over commanded [-]."""
    backward: float = field(metadata=column("backward", "1", form=".2f"))
    """The same backward [-]."""
    follows: str = field(metadata=column("paces"))
    """Verdict on both directions: `follows`, or the fault."""
    fall_rate: float = field(metadata=column("falls", "% of walks", form=".0%"))
    """Share of episodes of both that end in a fall [-]."""
    jitter: float | None = field(metadata=column("joint jitter told to stand [rad/s²]", form=".0f"))
    """Root mean square joint acceleration under the command to stand; None where that was not given."""
    friction_law: str = field(default="coulomb", metadata=LATER)


def followed(rows: Sequence[ResultRow]) -> list[Followed]:
    """Return which policies follow, from rows of both directions; policies without both are left out."""
    cells: dict[tuple[str, float], dict[str, ResultRow]] = {}
    for row in rows:
        cells.setdefault((row.policy, row.friction_level), {})[row.command] = row
    walks = []
    for (policy, level), by in cells.items():
        ahead = next((r for c, r in by.items() if c.startswith("vx=") and not c.startswith("vx=-")), None)
        back = next((r for c, r in by.items() if c.startswith("vx=-")), None)
        if ahead is None or back is None or ahead.speed_ratio is None or back.speed_ratio is None:
            continue
        paces = dict.fromkeys(pace(worst(row.ends or (0.0,))) for row in (ahead, back))
        falls = (ahead.fall_rate + back.fall_rate) / 2.0
        still = by["stand"].joint_jitter if "stand" in by else None
        speeds, law = (ahead.speed_ratio, back.speed_ratio), ahead.friction_law
        walks.append(Followed(policy, level, *speeds, ", ".join(paces), falls, still, law))
    return walks
