"""Terrain: the course and difficulty of each robot, and its commands there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

import numpy as np

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.core.flags import flag
from stiction.robots.terrain import KINDS, REACH, SLABS, Terrain, assign, step_height

TerrainName = Literal["flat", "slopes", "rough", "stairs", "mixed"]

SHARES: dict[str, tuple[float, ...]] = {
    "flat": (1.0, 0.0, 0.0, 0.0),
    "slopes": (0.25, 0.75, 0.0, 0.0),
    "rough": (0.25, 0.0, 0.75, 0.0),
    "stairs": (0.25, 0.0, 0.0, 0.75),
    "mixed": (0.25, 0.15, 0.2, 0.4),
}
"""Shares of the robots on flat ground, slopes, rough ground and stairs. A quarter stays on flat ground, under ordinary
commands: turning and walking sideways are not forgotten."""

START = 0.7
"""Distance of a robot's start from the foot of its course [m]."""

FINISH_MARGIN = 0.6
"""Distance beyond the other foot at which a robot has crossed its course [m]."""

LENGTH = START + 2 * REACH + FINISH_MARGIN
"""Length from the start to the end of a crossed course [m]."""

START_HALF_WIDTH = 1.0
"""Half-width of the start, across the course [m]."""

HEADING_ERROR = 0.2
"""Half-width of the initial error of heading [rad]."""

FASTEST = 10.0
"""Bound of the commanded speed [m/s]."""

SCAN = (np.linspace(-0.6, 0.9, 13), np.linspace(-0.3, 0.3, 5))
"""Points of the elevation map, forward and left of the base [m]: a tread is two to three points deep."""

SCAN_POINTS = np.stack(np.meshgrid(*SCAN, indexing="ij"), -1).reshape(-1, 2)

UNDER_TRUNK = (np.abs(SCAN_POINTS[:, 0]) <= 0.35) & (np.abs(SCAN_POINTS[:, 1]) <= 0.2)
"""Points of the map under the trunk: their mean is the ground for the base's height."""


@dataclass(frozen=True)
class TerrainCfg:
    """Ground in training, and its curriculum."""

    kind: Annotated[TerrainName, flag("--terrain")] = "flat"
    """Ground; a quarter of the robots stays on flat ground. mixed: slopes, rough ground and stairs."""
    levels: int = 10
    """Levels of difficulty, equal ranges in which a course is drawn: steps of 0 to 2 cm in the lowest, of 18 to 20 cm
    in the highest; slopes up to 26°, slabs up to 15 cm."""
    first_level: int = 2
    """Highest initial level; initial levels are drawn from 0 on."""
    promote_above: float = 0.75
    """Share of the commanded distance above which a robot goes one level up after an episode..."""
    demote_below: float = 0.4
    """... and below which it goes one down. After a fall the rest of the course counts as commanded too."""
    speed: tuple[float, float] = (0.3, 0.55)
    """Commanded speed across a course [m/s]."""
    heading_gain: float = 1.0
    """Turn rate over error of heading, for robots on a course [1/s]."""
    elevation_noise: float = 0.02
    """Half-width of the noise on the elevation map [m]."""

    def __post_init__(self) -> None:
        """Validate ground and numbers of the curriculum."""
        if self.kind not in get_args(TerrainName):
            raise ConfigurationError(unknown_name("terrain", self.kind, get_args(TerrainName)))
        if not 0 <= self.first_level < self.levels or not 0 <= self.demote_below <= self.promote_above:
            raise ConfigurationError(
                f"{self.levels} terrain levels, the first up to {self.first_level}, demotion under "
                f"{self.demote_below}, promotion above {self.promote_above}: expected them in that order"
            )
        if not 0 < self.speed[0] <= self.speed[1] <= FASTEST:
            raise ConfigurationError(
                f"speed on terrain {self.speed}: expected a lower and an upper end above 0, up to {FASTEST:g} m/s"
            )
        if not 0 <= self.elevation_noise < 1 or not 0 <= self.heading_gain <= 100:
            raise ConfigurationError(
                f"elevation noise {self.elevation_noise} m, heading gain {self.heading_gain}/s: expected numbers in "
                "[0, 1) and [0, 100]"
            )


FASTEST_TURN = 0.6
"""Maximum turn rate for holding a heading [rad/s]."""


def hold_heading(error: np.ndarray, gain: float) -> np.ndarray:
    """Return the turn rate that corrects an error of heading [rad], at most `FASTEST_TURN`."""
    return np.clip(gain * ((error + np.pi) % (2 * np.pi) - np.pi), -FASTEST_TURN, FASTEST_TURN)


STATE, TERRAIN_STATE = ("level", "heading", "speed", "covered", "asked"), ("difficulty", "position", "quaternion")
"""Fields of a curriculum, and of its terrain, in a checkpoint."""


class Curriculum:
    """Ground, level and course of each robot. Levels change at the end of an episode."""

    def __init__(self, cfg: TerrainCfg, num: int, generator: np.random.Generator) -> None:
        """Assign kinds and draw first levels."""
        self.cfg, self.generator = cfg, generator
        self.terrain = Terrain(assign(SHARES[cfg.kind], num))
        self.on_course = self.terrain.kind != KINDS.index("flat")
        self.level = np.where(self.on_course, generator.integers(0, cfg.first_level + 1, num), 0)
        self.heading, self.speed = np.zeros(num), np.zeros(num)
        self.covered, self.asked = np.zeros(num), np.zeros(num)

    def begin(self, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Update the levels of the robots `ids` and start their next episode along the course up to `HEADING_ERROR`.

        Returns difficulty (n,), numbers for `Terrain.place` (n, SLABS, 4), start (n, 2) [m], heading (n,) [rad].
        """
        cfg, num = self.cfg, len(ids)
        # At the very first beginning nothing has been asked yet.
        walked = self.asked[ids] > 0
        share = self.covered[ids] / np.where(walked, self.asked[ids], 1.0)
        level = self.level[ids] + (walked & (share > cfg.promote_above)) - (walked & (share < cfg.demote_below))
        again = self.generator.integers(0, cfg.levels, num)
        self.level[ids] = np.where(level >= cfg.levels, again, np.maximum(level, 0)) * self.on_course[ids]
        difficulty = (self.level[ids] + self.generator.random(num)) / cfg.levels
        self.covered[ids] = self.asked[ids] = 0.0
        self.speed[ids] = self.generator.uniform(*cfg.speed, num)

        stairs = self.terrain.kind[ids] == KINDS.index("stairs")
        # Stairs can be met from four sides, other courses along x alone.
        quarter = np.where(stairs, self.generator.integers(0, 4, num), 2 * self.generator.integers(0, 2, num))
        heading = np.where(self.on_course[ids], np.pi / 2 * quarter, self.generator.uniform(-np.pi, np.pi, num))
        self.heading[ids] = heading
        forward = np.stack((np.cos(heading), np.sin(heading)), -1)
        left = np.stack((-forward[:, 1], forward[:, 0]), -1)
        aside = self.generator.uniform(-START_HALF_WIDTH, START_HALF_WIDTH, (num, 1))
        start = np.where(self.on_course[ids][:, None], aside * left - (REACH + START) * forward, 0.0)
        askew = self.generator.uniform(-HEADING_ERROR, HEADING_ERROR, num)
        return difficulty, self.generator.random((num, SLABS, 4)), start, heading + askew

    def command(self, yaw: np.ndarray) -> np.ndarray:
        """Return speed and turn towards the heading on a course, (N, 3) [m/s, rad/s]; yaw: current [rad], (N,)."""
        turn = hold_heading(self.heading - yaw, self.cfg.heading_gain)
        return np.stack((self.speed, np.zeros_like(turn), turn), -1)

    def _along(self, vector: np.ndarray) -> np.ndarray:
        """Return the components of vectors in the world, (N, 2), along the courses, (N,)."""
        return vector[:, 0] * np.cos(self.heading) + vector[:, 1] * np.sin(self.heading)

    def walk(self, velocity: np.ndarray, period: float) -> None:
        """Add the distance of one control period. `velocity`: of the base in the world, (N, 2) [m/s]."""
        self.covered += self._along(velocity) * period
        self.asked += self.speed * period

    def fall(self, fallen: np.ndarray, left: np.ndarray) -> None:
        """Count the rest of a course as commanded for fallen robots, (N,) bool; left: of their episodes [s]."""
        whole = np.minimum(self.asked + self.speed * left, LENGTH)
        self.asked = np.where(fallen, np.maximum(self.asked, whole), self.asked)

    def crossed(self, position: np.ndarray) -> np.ndarray:
        """Return the mask of robots that crossed their courses, (N,) bool. `position`: of the base, (N, 2) [m]."""
        return self.on_course & (self._along(position) > REACH + FINISH_MARGIN)

    def figures(self) -> dict[str, float]:
        """Return mean level and mean difficulty in its unit, by kind of ground."""
        figures = {"terrain/level": float(self.level[self.on_course].mean())}
        unit = {"stairs": "step_height", "slope": "slope", "rough": "slab_height"}
        for name in self.terrain.used:
            mine = self.terrain.kind == KINDS.index(name)
            height = step_height(name, self.terrain.difficulty[mine])
            figures[f"terrain/{unit[name]}"] = float(height.mean())
            figures[f"terrain/{unit[name]}_best_tenth"] = float(np.quantile(height, 0.9))
        return figures

    def state(self) -> dict[str, Any]:
        """Return the state for a checkpoint."""
        mine = {name: getattr(self, name).copy() for name in STATE}
        ground = {name: getattr(self.terrain, name).copy() for name in TERRAIN_STATE}
        return mine | ground | {"generator": self.generator.bit_generator.state}

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore a `state`."""
        for name in STATE:
            getattr(self, name)[:] = np.asarray(state[name])
        self.generator.bit_generator.state = state["generator"]
        self.terrain.restore(*(np.asarray(state[name]) for name in TERRAIN_STATE))
