"""What a grid is made of: engines, with or without a virtual robot in them, levels, grounds, commands, episodes."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any

from stiction.formats.errors import StictionError
from stiction.formats.friction import has_coefficient
from stiction.transfer.course import parse_course
from stiction.transfer.engines.catalog import ENGINES
from stiction.transfer.evaluate import EvaluationCfg
from stiction.transfer.robot.factorial import CELLS, Case, Level, parse_levels
from stiction.transfer.robot.seeds import FIRST_REPORTED, reported

BATCH = "mujoco"
"""The simulator of the training, all its robots at once: what `stiction evaluate` takes where no engine is named."""

ALONE = {"mujoco-alone": "mujoco"} | {name: name for name in ENGINES if name != "mujoco"}
"""Name of an engine with one robot in it, as in results.csv -> its name in the catalogue of engines."""


@dataclass(frozen=True)
class Place:
    """Where a policy is put: an engine, and the robot in it."""

    engine: str
    """`mujoco`, the simulator of the training, or one of `ALONE`."""
    cell: str | None = None
    """Of a virtual robot, what of it is real (see `Case.cell`); None: the robot of the data sheet."""

    @property
    def label(self) -> str:
        """As it stands in results.csv: `physx`, `physx+all`."""
        return self.engine if self.cell is None else f"{self.engine}+{self.cell}"

    @property
    def is_batch(self) -> bool:
        """Whether all its robots are simulated at once."""
        return self.engine == BATCH


def parse_place(text: str) -> Place:
    """Return the place that a text names: an engine; after a `+` a cell of the virtual robot, or some of its groups.

    Raises:
        StictionError: there is no such engine or cell, or the virtual robot is asked for in a batch.

    """
    engine, plus, cell = text.strip().partition("+")
    if engine not in (BATCH, *ALONE):
        raise StictionError(
            f"engine {text!r} is unknown; expected {BATCH} (the simulator of the training), {', '.join(ALONE)}, or one "
            f"of these with a virtual robot in it: physx+{', physx+'.join(CELLS)}"
        )
    if plus and engine == BATCH:
        raise StictionError(f"engine {text!r}: a virtual robot is alone in its engine; expected mujoco-alone+{cell}")
    if plus:
        _ = Case(FIRST_REPORTED, cell, Level(0.0)).groups
    return Place(engine, cell if plus else None)


@dataclass(frozen=True)
class GridCfg:
    """What the policies are put through."""

    base: EvaluationCfg = field(default_factory=EvaluationCfg)
    """Friction levels and law, commands, episodes from 0 on, seconds, seed. Its terrain is not read."""
    engines: tuple[str, ...] = (BATCH,)
    """Engines, as `parse_place` reads them."""
    terrains: tuple[str, ...] = ("flat",)
    """Grounds, as `parse_course` reads them."""
    robots: tuple[int, ...] = reported(3)
    """Seeds of the virtual robots, see `stiction.transfer.robot.seeds`."""
    robot_levels: tuple[str, ...] = ()
    """Friction of the virtual robots: fractions of the torque limit, `bench`, `bench+0.02`; none: those of `base`."""
    forward: tuple[str, ...] = ()
    """Policies that also walk with friction fed forward in the joint controllers, see `stiction.transfer.grid.forward`:
    names of bundles."""
    forward_only: bool = False
    """Whether the policies of `forward` walk in that way alone: their walks without are in another grid."""

    def __post_init__(self) -> None:
        """Refuse what cannot be walked."""
        for name in ("engines", "terrains", "robots", "robot_levels", "forward"):
            given = getattr(self, name)
            if len(set(given)) < len(given) or not (given or name in ("robot_levels", "forward")):
                raise StictionError(f"{name.replace('_', ' ')} {list(given)}: expected at least one, each once")
        parse_levels(self.levels_of_robots)
        for terrain in self.terrains:
            self.on(terrain)
        alone = [place.label for place in self.places if not place.is_batch]
        if alone and self.base.action_delay:
            raise StictionError(
                f"{alone[0]} with an action delay: only {BATCH} has it; a virtual robot has delays of its own"
            )
        self._check_forward()
        if any(place.cell for place in self.places) and has_coefficient(self.base.law.name) and not self.robot_levels:
            raise StictionError("virtual robots have a law of their own; give their --robot-levels, such as 0.1 bench")

    def _check_forward(self) -> None:
        """Refuse friction fed forward where there is no joint controller to do it, or no one torque to feed."""
        if not self.forward:
            return
        if all(place.is_batch for place in self.places):
            raise StictionError(
                f"friction fed forward in {BATCH}: its joint controllers are the simulator's own and take no torque "
                "beside their targets; give another engine, such as physx"
            )
        law = self.base.law.name
        if has_coefficient(law) and any(place.cell is None and not place.is_batch for place in self.places):
            raise StictionError(
                f"friction fed forward under the law {law}: it has a coefficient and no torque that could be fed; "
                "expected coulomb or stribeck"
            )

    @property
    def places(self) -> tuple[Place, ...]:
        """The engines, parsed."""
        return tuple(parse_place(text) for text in self.engines)

    @property
    def levels_of_robots(self) -> tuple[str, ...]:
        """Friction of the virtual robots."""
        return self.robot_levels or tuple(f"{level:g}" for level in self.base.friction_levels)

    @property
    def used_robots(self) -> list[int]:
        """Seeds of the virtual robots that walk."""
        return list(self.robots) if any(place.cell for place in self.places) else []

    def on(self, terrain: str) -> EvaluationCfg:
        """Return what is asked on one ground: over a course only the commands that lead over it.

        Raises:
            StictionError: there is no such ground, or no command leads over it.

        """
        course = parse_course(terrain)
        commands = tuple(command.label for command in self.base.parsed_commands if course.takes(command))
        if not commands:
            given = ", ".join(self.base.commands)
            raise StictionError(
                f"terrain {terrain}: none of the commands {given} leads over it; add one such as vx=0.4"
            )
        return replace(self.base, terrain=course.label, commands=commands)

    def asked(self, terrain: str, command: str) -> EvaluationCfg:
        """Return what is asked under one command alone, by its label; over a course it says how long a walk lasts."""
        return replace(self.on(terrain), commands=(command,))

    def settings(self) -> dict[str, Any]:
        """Return everything that a walk depends on beside its own cell, as plain data."""
        names = ("episodes", "seconds", "settle", "seed", "noise", "action_delay", "static_ratio", "stribeck_velocity")
        return {name: value for name, value in asdict(self.base).items() if name in names}
