"""Robots that stand in for the real one in the loop: the training's simulator, with joints of their own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from stiction.core.provenance import seed_streams, stream_seed
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.walk_logs import RecordCfg, record_walks
from stiction.files.bundle import Bundle
from stiction.files.contract import Contract, robot_of
from stiction.files.walk import write_walk
from stiction_experiments.actuator.config import BACKWARD, DRAWN, EVERYWHERE, RUNS, LoopCfg

FACTORS = (0.8, 1.2)
"""Range of motor strength, viscous friction and inertia over their nominal values: what the paper's table allows joints
to differ by."""

FRICTION_FACTORS = (0.5, 1.5)
"""Range of dry friction over that of the study's robot: it differs more than anything else between joints."""


@dataclass(frozen=True)
class LoopRobot:
    """One robot, by its joints relative to the nominal ones; neither policy nor log contains any of it."""

    name: str
    """`robot-0` is the study's own; `robot-1` and on are drawn."""
    level: float
    """Dry friction as a fraction of the torque limit [-]."""
    strength: float = 1.0
    """Torque delivered over torque asked for [-]: kp and kd alike."""
    damping: float = 1.0
    """Viscous friction over the nominal one [-]."""
    armature: float = 1.0
    """Rotor inertia over the nominal one [-]."""

    def joints(self, contract: Contract) -> Contract:
        """Return the contract with this robot's joints where the simulation reads them."""
        factors = {"kp": self.strength, "kd": self.strength, "damping": self.damping, "armature": self.armature}
        values = {name: (factor * contract.array(name)).tolist() for name, factor in factors.items()}
        spec = robot_of(contract)
        joints = tuple(
            replace(joint, **{name: value[number] for name, value in values.items()})
            for number, joint in enumerate(spec.joints)
        )
        fields: dict[str, Any] = {name: tuple(value) for name, value in values.items()}
        return replace(contract, anatomy=replace(spec, joints=joints), **fields)


def loop_robots(level: float, seed: int) -> tuple[LoopRobot, ...]:
    """Return the study's robot, nominal but for its friction, and `DRAWN` others."""
    robots = [LoopRobot("robot-0", level)]
    for number, generator in enumerate(seed_streams(seed, [f"robot {k + 1}" for k in range(DRAWN)]).values(), 1):
        strength, damping, armature = generator.uniform(*FACTORS, 3)
        share = generator.uniform(*FRICTION_FACTORS)
        robots.append(LoopRobot(f"robot-{number}", round(level * share, 4), strength, damping, armature))
    return tuple(robots)


def plan_logs(variant: str, cfg: LoopCfg) -> list[tuple[LoopRobot, tuple[str, ...], int]]:
    """Return what is walked for a data set: robot, commands, and runs of each command."""
    robots = loop_robots(cfg.level, cfg.train.seed)
    commands = EVERYWHERE if variant == "everywhere" else BACKWARD
    walking: Sequence[LoopRobot] = robots[1:] if variant == "three-robots" else robots[:1]
    return [(robot, commands, RUNS * cfg.repeats // (len(commands) * len(walking))) for robot in walking]


def record_logs(
    bundle: Bundle,
    variant: str,
    cfg: LoopCfg,
    folder: Path,
    threads: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> int:
    """Have a policy walk on the virtual robots of a data set and write the logs; return how many there are.

    Their headers have the gains that the runtime asked for, not those times the strength of its motors.
    Each data set has episodes of its own. A robot that falls at once leaves no log.
    """
    count, plan = 0, plan_logs(variant, cfg)
    for index, (robot, commands, repeats) in enumerate(plan):
        walks = record_walks(
            replace(bundle, contract=robot.joints(bundle.contract)),
            EvaluationCfg((robot.level,), commands, seed=stream_seed(cfg.train.seed, f"logs {variant} {robot.name}")),
            RecordCfg(repeats, cfg.log_seconds, torque=cfg.torque),
            threads=threads,
            progress=lambda share, index=index: progress((index + share) / len(plan)),  # type: ignore[misc]
        )
        for walk in walks:
            if walk.log is not None:
                header = replace(walk.log.header, kp=bundle.contract.kp, kd=bundle.contract.kd)
                name = f"{robot.name}--{walk.command}--{walk.robot}.npz"
                write_walk(folder / name, replace(walk.log, header=header))
                count += 1
    return count
