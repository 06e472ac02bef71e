"""Which walks a grid consists of, and what can be done in one go."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from stiction.formats.friction import Law
from stiction.formats.grid import FORWARD
from stiction.transfer.grid.config import GridCfg, Place
from stiction.transfer.robot.factorial import factorial

REAL = "real"
"""Law of a virtual robot's friction in results.csv: Stribeck's, different in every joint."""

COST = {"mujoco": 0.05, "mujoco-alone": 1.0, "physx": 2.0, "ode-webots": 4.0, "ode": 6.0}
"""Time that a walk takes in each engine, in some unit: the long ones go first, so that no core waits at the end."""

AT_ONCE = 320.0
"""Most robots times seconds of one batch [s], or one robot: some three seconds on one core, which is what an
interruption loses. Smaller ones cost more: a robot of a batch of 32 takes 0.086 s for 10 s, of 16 0.092, of 8 0.109."""


@dataclass(frozen=True)
class Walk:
    """One episode of one policy in one cell of the grid."""

    policy: str
    """Name of the bundle."""
    place: Place
    """Engine and robot."""
    law: str
    """Law of the friction; of a virtual robot with friction `REAL`."""
    level: str
    """Friction, as a number or as `parse_level` reads it."""
    terrain: str
    """Label of the ground."""
    command: str
    """Label of the command."""
    episode: int
    """Number of start pose and noise."""
    robot: int | None = None
    """Seed of the virtual robot."""
    forward: tuple[float, ...] | None = None
    """Friction that the joint controllers feed forward [N m], of each joint; None: they do not."""
    known: tuple[float, ...] | None = None
    """What a policy that observes its joints' friction is told, f/τ_max of each kind of joint [-]; None: what its
    contract says, or nothing."""

    @property
    def name(self) -> str:
        """What rows of results call the policy."""
        return self.policy + self.suffix

    @property
    def suffix(self) -> str:
        """What stands behind the names of policy and method."""
        return "" if self.forward is None else FORWARD

    @property
    def cell(self) -> tuple[str, ...]:
        """What the walks of one row of results.csv share."""
        return self.name, self.place.label, self.law, self.level, self.terrain, self.command


def plan(policies: Sequence[str], cfg: GridCfg) -> list[Walk]:
    """Return every walk of the grid without friction fed forward, those of one row beside each other.

    Episodes of a virtual robot are spread over the robots: every robot walks `episodes` of them.
    """
    return _walks([name for name in policies if not (cfg.forward_only and name in cfg.forward)], cfg)


def plan_forward(cfg: GridCfg) -> list[Walk]:
    """Return every walk that is to be walked with friction fed forward, still without it; none is in the batch."""
    return [walk for walk in _walks(cfg.forward, cfg) if not walk.place.is_batch]


def _walks(policies: Sequence[str], cfg: GridCfg) -> list[Walk]:
    """Return every combination once."""
    walks = []
    for policy in policies:
        for place in cfg.places:
            for terrain in cfg.terrains:
                asked = cfg.on(terrain)
                for law, level, robots in _frictions(place, cfg):
                    for command in asked.parsed_commands:
                        walks += [
                            Walk(policy, place, law, level, asked.terrain, command.label, episode, robot)
                            for robot in robots
                            for episode in range(asked.episodes)
                        ]
    return walks


def _frictions(place: Place, cfg: GridCfg) -> list[tuple[str, str, tuple[int | None, ...]]]:
    """Return law, level and robots of every friction that is met in a place."""
    if place.cell is None:
        return [(cfg.base.friction_law, f"{level:g}", (None,)) for level in cfg.base.friction_levels]
    cases = factorial(cfg.robots[:1], cfg.levels_of_robots, (place.cell,))
    law = REAL if "friction" in cases[0].groups else Law().name
    return [(law, case.level.label, cfg.robots) for case in cases]


@dataclass(frozen=True)
class Unit:
    """Walks that are done in one go: one, or episodes of one cell in a batch, with numbers that follow each other."""

    walks: tuple[Walk, ...]

    @property
    def policy(self) -> str:
        """Name of the bundle."""
        return self.walks[0].policy

    @property
    def place(self) -> Place:
        """Where."""
        return self.walks[0].place

    @property
    def cost(self) -> float:
        """How long it takes, in the unit of `COST`."""
        return COST[self.place.engine] * len(self.walks)


def units(walks: Sequence[Walk], cfg: GridCfg) -> list[Unit]:
    """Return the walks of a plan as units, the longest first."""
    found = [Unit((walk,)) for walk in walks if not walk.place.is_batch]
    for _, cell in groupby((walk for walk in walks if walk.place.is_batch), key=lambda walk: walk.cell):
        some = tuple(cell)
        size = max(1, int(AT_ONCE / cfg.asked(some[0].terrain, some[0].command).duration))
        found += [Unit(some[begin : begin + size]) for begin in range(0, len(some), size)]
    return sorted(found, key=lambda unit: -unit.cost)
