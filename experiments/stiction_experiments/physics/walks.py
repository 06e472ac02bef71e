"""Effect of the simulation of joint friction on a walk: the same policies under several, against a fine reference.

Episode e meets the same start and the same sensor noise in every physics, at every level and command: rows differ by
physics alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stiction.core.provenance import seed_streams
from stiction.deploy.policy import load_policy
from stiction.evaluation.course import SETTLE
from stiction.evaluation.rollout import Rollout, friction_at
from stiction.files.bundle import Bundle
from stiction.files.contract import robot_of
from stiction.robots.physics import EXACT, FAST, PhysicsCfg
from stiction.virtual.drive import drive
from stiction_experiments.physics.config import WalkCfg

REFERENCE = "rows, 0.25 ms"
"""The setting that the others are held against."""

_STIFF = PhysicsCfg("plastic", stiffness=64000.0)

SETTINGS: dict[str, tuple[PhysicsCfg, float]] = {
    REFERENCE: (EXACT, 0.00025),
    "rows": (EXACT, 0.005),
    "rows, impedance 0.9": (PhysicsCfg(impedance=0.9), 0.005),
    "plastic, Newton": (PhysicsCfg("plastic", solver="newton"), 0.005),
    "plastic": (FAST, 0.005),
    "plastic, 10 ms": (FAST, 0.01),
    "plastic, 0.25 ms": (FAST, 0.00025),
    "plastic, 64000 N m/rad, 0.25 ms": (_STIFF, 0.00025),
}
"""Name -> how friction is simulated, and the physics step [s]."""


WALKS = 0.3
"""Speed ratio of the reference from which physics are compared [-]."""


@dataclass(frozen=True)
class PhysicsRow:
    """One policy in one physics at one level in one direction."""

    physics: str
    """Name in `SETTINGS`."""
    policy: str
    level: float
    """Dry friction as a fraction of the torque limit [-]."""
    direction: str
    """`forward` or `backward`."""
    speed_ratio: float
    """Mean speed over the commanded one [-]."""
    standard_error: float
    """Standard error of that mean, over the walks [-]."""
    falls: int
    """Walks in which the robot fell or its simulation blew up."""


def walk(bundle: Bundle, name: str, physics: str, cfg: WalkCfg, threads: int = 1) -> list[PhysicsRow]:
    """Walk one policy in one physics over all levels and both directions."""
    contract, (option, step) = bundle.contract, SETTINGS[physics]
    shape = (len(cfg.friction_levels), 2, cfg.episodes)
    levels = np.broadcast_to(np.array(cfg.friction_levels)[:, None, None], shape).ravel()
    command = np.zeros((len(levels), 3))
    command[:, 0] = np.broadcast_to(cfg.speed * np.array([1.0, -1.0])[:, None], shape).ravel()
    names = [f"walk {number}" for number in range(cfg.episodes)]
    rollout = Rollout(
        contract,
        load_policy(contract, bundle.policy, (len(levels),)),
        robot_of(contract),
        friction_at(contract, levels),
        list(seed_streams(cfg.seed, names).values()),
        threads,
        physics=option,
        timestep=step,
    )
    period = contract.physics_timestep * contract.decimation
    steps, settle = round(cfg.seconds / period), round(SETTLE / period)
    speed, fallen = np.zeros(len(levels)), np.zeros(len(levels), bool)
    for number, _ in enumerate(drive(rollout, command, steps)):
        fallen |= rollout.truth().fallen
        if number >= settle:
            speed += rollout.fleet.base_linear_velocity[:, 0] / (steps - settle)
    ratio, falls = (speed / command[:, 0]).reshape(shape), fallen.reshape(shape)
    error = ratio.std(-1, ddof=1) / np.sqrt(cfg.episodes)
    return [
        PhysicsRow(physics, name, level, direction, ratio[i, j].mean(), error[i, j], int(falls[i, j].sum()))
        for i, level in enumerate(cfg.friction_levels)
        for j, direction in enumerate(("forward", "backward"))
    ]


def compare(
    bundles: Mapping[str, Bundle],
    cfg: WalkCfg,
    threads: int = 1,
    progress: Callable[[str, float], None] = lambda name, share: None,
) -> list[PhysicsRow]:
    """Walk every policy in every physics. `progress`: called with a name and the share that is done."""
    rows: list[PhysicsRow] = []
    for number, physics in enumerate(SETTINGS):
        for name, bundle in bundles.items():
            rows += walk(bundle, name, physics, cfg, threads)
        progress("physics", (number + 1) / len(SETTINGS))
    return rows


def bias(rows: Sequence[PhysicsRow]) -> dict[str, dict[str, float]]:
    """Return the largest and the mean distance of each physics' speed ratios from `rows` and from the reference.

    Only where nobody fell, and where the reference reaches at least `WALKS` of the command: near a stall the speed is
    decided by little. Empty where that is nowhere.
    """
    cells = {(row.physics, row.policy, row.level, row.direction): row for row in rows}
    biases = {}
    for physics in SETTINGS:
        mine = {key[1:]: row for key, row in cells.items() if key[0] == physics}
        apart: dict[str, float] = {}
        for name in ("rows", REFERENCE):
            distances = [
                abs(row.speed_ratio - cells[(name, *key)].speed_ratio)
                for key, row in mine.items()
                if cells[(REFERENCE, *key)].speed_ratio >= WALKS and not row.falls
            ]
            label = "reference" if name == REFERENCE else name
            if distances:
                apart |= {f"largest_from_{label}": max(distances), f"mean_from_{label}": float(np.mean(distances))}
        biases[physics] = apart
    return biases
