"""Evidence for the advice of `stiction identify`: commands followed after each training, one part per study.

A study writes its part, from its rows, with the command, the revision and the policies that they belong to.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from stiction.core.decode import from_plain
from stiction.core.errors import FileError
from stiction.files.following import CommandCount
from stiction.files.plain import read_object, take_version

SCHEMA_VERSION = 3

TRAINING = "friction-training"
"""Name of the part that advises a training."""

SHARES = ("coulomb", "real")
"""Laws under which a level is a share of the torque limit and nothing else."""

KINDS = {2: "biped", 4: "quadruped", 6: "hexapod"}
"""Number of feet -> kind of robot, for readers."""


@dataclass(frozen=True)
class TrainedWith:
    """Friction in the training of one method."""

    method: str
    level: float
    """`--friction-level` [-]; 0 without friction."""
    low: float
    """Minimum friction in training, over that level [-]."""
    high: float
    """Maximum friction in training, over that level [-]."""

    @property
    def width(self) -> float:
        """Width of the range of friction in training, over the torque limit [-]."""
        return self.level * (self.high - self.low)


@dataclass(frozen=True)
class Source:
    """Part of one study."""

    command: str
    revision: str
    robot: str
    """Name of the robot, on flat ground."""
    feet: int
    policies: tuple[str, ...]
    methods: Mapping[str, TrainedWith] = field(default_factory=dict)
    cells: tuple[CommandCount, ...] = ()
    """Commands that each method follows, by engine and friction; every cell covers exactly `policies`."""
    tables: tuple[str, ...] = ()
    """Names of the tables with the rows of the cells: `cohort-physx.csv`."""

    @property
    def robot_text(self) -> str:
        """Robot in words: `the hexapod Saturn Lite`."""
        return f"the {KINDS.get(self.feet, 'robot')} {robot_title(self.robot)}"


def robot_title(name: str) -> str:
    """Return a robot's name for readers: `Saturn Lite` of `saturn_lite`; other than identifiers unchanged."""
    return name.replace("_", " ").title() if name.isidentifier() else name


def read_advice(path: Path) -> dict[str, Source]:
    """Return every study's part.

    Raises `StictionError`: the file cannot be read, or has another version.
    """
    data = take_version(read_object(path, "what `stiction identify` advises by"), SCHEMA_VERSION, path.name)
    sources = data.get("sources")
    if not isinstance(sources, dict):
        raise FileError(f"{path.name}: field 'sources' is {str(sources)[:80]}; expected an object")
    return {name: from_plain(Source, source, f"{path.name}: {name}") for name, source in sources.items()}
