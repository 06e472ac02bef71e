"""Configuration of the loop f0 -> log -> f_motor -> f1. Neither torch nor mujoco: the command line reads it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

from stiction.core.errors import ConfigurationError
from stiction.core.flags import FLAT
from stiction.files.results import DIRECTIONS
from stiction.joints.net import ActuatorCfg
from stiction.learning.config import TrainCfg
from stiction.learning.presets import PRESETS
from stiction.task.config import TaskCfg
from stiction.task.friction import FrictionCfg

BACKWARD = ("vx=-0.2", "vx=-0.35", "vx=-0.5", "vx=-0.65")
"""Commands of the paper's log: its robot walked backward only. Four speeds, so that runs differ."""

EVERYWHERE = ("vx=0.5", "vx=-0.5", "vy=0.3", "vy=-0.3", "wz=0.5", "wz=-0.5")
"""Commands of the control: forward, backward, sideways, turns."""

DRAWN = 3
"""Robots that are drawn differently from the one of the study."""

RUNS = 12
"""Runs of a data set, before `repeats`: divisible by four commands on three robots, and by six commands on one."""

VARIANTS = {
    "backward": "backward walking of one robot, as in the paper",
    "everywhere": "forward, backward, sideways and turns of one robot",
    "three-robots": "backward walking of three robots with joints of their own",
}
"""Data set -> what is logged. Each has as many runs of the same length as the others."""


def conventional() -> TrainCfg:
    """Return the training of f0 and of every f1: the preset `two-phase`, without friction in the simulation."""
    return replace(PRESETS["two-phase"], task=TaskCfg(friction=FrictionCfg(method="none")))


@dataclass(frozen=True)
class LoopCfg:
    """The paper's loop with an Actuator Net, on a virtual robot in place of the real one."""

    policy: Path | None = None
    """Bundle of f0, trained without friction; by default it is trained first."""
    level: float = 0.2
    """Dry friction of the virtual robot's joints, as a fraction of the torque limit: it plays the real robot."""
    torque: Literal["output_side", "motor_side"] = "output_side"
    """Where the virtual robot measures torque. On the output side friction is in it, and f1 is trained with no other.
    On the motor side it is not, so that f1 is trained without any; a control."""
    repeats: int = 1
    """Times 12 runs in each data set."""
    log_seconds: float = 10.0
    """Length of a run [s]."""
    variants: tuple[str, ...] = tuple(VARIANTS)
    """Data sets to go through, some of backward, everywhere, three-robots."""
    net: ActuatorCfg = field(default_factory=ActuatorCfg)
    """How the nets are fitted; both sets of inputs are, f1 is trained with that of `inputs`."""
    train: Annotated[TrainCfg, FLAT] = field(default_factory=conventional)
    """Training of f0 and of every f1."""
    episodes: int = 32
    """Episodes per policy, robot and command of the evaluation."""
    seconds: float = 20.0
    """Length of an episode [s]."""
    commands: tuple[str, ...] = DIRECTIONS
    """Commands of the evaluation."""

    def __post_init__(self) -> None:
        """Refuse what cannot be run."""
        if not 0 < self.level <= 0.5 or self.repeats < 1:
            raise ConfigurationError(
                f"friction level {self.level}, {self.repeats} repeats: expected a level in (0, 0.5], at least 1 repeat"
            )
        unknown = [name for name in self.variants if name not in VARIANTS]
        if unknown or not self.variants or len(set(self.variants)) < len(self.variants):
            raise ConfigurationError(f"variants {self.variants}: expected different ones of {', '.join(VARIANTS)}")
        train = self.train
        if train.actuator is not None or train.joints is not None or train.task.friction.method != "none":
            raise ConfigurationError(
                "f0 and f1 are trained conventionally, f1 with the net of this study: leave out --actuator, --joints "
                "and --method"
            )
