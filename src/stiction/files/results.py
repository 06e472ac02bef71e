"""Results in long form: one row per policy, engine, friction law, friction level, terrain and command."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from stiction.core.decode import is_integer, is_number
from stiction.core.errors import FileError
from stiction.core.files import open_regular, write_text
from stiction.core.records import LATER, column, read_rows, write_rows
from stiction.files.plain import read_object, take_version
from stiction.files.velocity import Command

SCHEMA_VERSION = 1
"""Version of summary.json."""

DIRECTIONS = ("vx=0.5", "vx=-0.5")
"""Forward and backward: the commands by which training methods are compared."""

FOLLOWS = (0.8, 1.2)
"""Range of speed ratios that follow the command [-]."""


@dataclass(frozen=True)
class ResultRow:
    """Row of results.csv; its fields are the columns, in their order. None is an empty cell.

    Tables for readers show the measured columns, see `core.records.column`.
    """

    policy: str
    """Name of the bundle."""
    method: str
    """Training method with friction."""
    seed: int
    """Seed of the training run."""
    engine: str
    """Physics engine: `mujoco`."""
    friction_law: str
    """Law of the joint friction in the evaluation: `coulomb`."""
    friction_level: float
    """Dry friction as a fraction of each joint's torque limit [-]."""
    terrain: str
    """Terrain: `flat`."""
    command: str
    """Commanded velocity: `vx=0.5`."""
    speed_ratio: float | None = field(metadata=column("speed ratio", form=".2f"))
    """Speed reached along the command over the commanded speed [-]; None without a commanded speed."""
    tracking_error: float = field(metadata=column("error", form=".3f"))
    """Mean error of the velocity, averaged over windows of 1 s [m/s], of the yaw rate [rad/s] for a pure turn."""
    fall_rate: float = field(metadata=column("falls", form=".0%"))
    """Share of episodes with a fall [-]."""
    distance: float
    """Mean displacement of the base in the measured part [m]."""
    steps_climbed: float | None = field(metadata=column("steps passed", form=".1f"))
    """Mean number of stairs climbed; None on flat ground."""
    cost_of_transport: float | None = field(metadata=column("cost of transport", form=".2f"))
    """Mechanical energy over weight times displacement [-]; None for a robot that does not move away."""
    joint_jitter: float = field(metadata=column("jitter", form=".0f"))
    """Root mean square, over joints and steps, of the change of joint velocity over one control period, divided by that
    period [rad/s²]. Motion faster than half the control rate aliases: a joint that swings once per period shows
    none."""
    tripod_share: float | None = field(metadata=column("tripod", form=".0%"))
    """Share of moving steps in which the feet on the ground are exactly one contact group [-]; None without such
    steps."""
    flight_share: float | None = field(metadata=column("flight", form=".0%"))
    """Share of moving steps with no foot on the ground [-]; None without such steps."""
    episodes: int = field(metadata=column("episodes"))
    """Number of episodes behind the row."""
    slowest: float | None = field(default=None, metadata=LATER)
    """Speed ratio of the slowest virtual robot, the mean over its walks [-]; None on the robot of the data sheet, and
    in older files. For a single walk: `slowest_walk`."""
    fastest: float | None = field(default=None, metadata=LATER)
    """Speed ratio of the fastest virtual robot [-]."""
    slowest_walk: float | None = field(default=None, metadata=LATER)
    """Smallest ratio of reached to commanded velocity of any single walk, along any commanded axis and on any robot
    [-]; None without a commanded speed, and in older files. Older rows of several axes have it along the command."""
    mean_vx: float | None = field(default=None, metadata=LATER)
    """Mean forward velocity over all walks, zero after a fall [m/s]; None in older files."""
    mean_vy: float | None = field(default=None, metadata=LATER)
    """Mean sideways velocity, to the left [m/s]."""
    mean_wz: float | None = field(default=None, metadata=LATER)
    """Mean yaw rate [rad/s]."""
    joint_chatter: float | None = field(default=None, metadata=LATER)
    """Root mean square, over joints and physics steps, of joint acceleration [rad/s²]: `joint_jitter` with what swings
    faster than the control, and with contacts. None where many robots walk at once in MuJoCo, and in older files."""

    @property
    def mean_velocity(self) -> tuple[float, float, float] | None:
        """Mean vx, vy [m/s] and wz [rad/s] over all walks; None in older files."""
        if self.mean_vx is None or self.mean_vy is None or self.mean_wz is None:
            return None
        return self.mean_vx, self.mean_vy, self.mean_wz

    @property
    def ends(self) -> tuple[float, float] | None:
        """`(slowest, fastest)` speed ratios of robots, each a mean over walks [-]; both equal `speed_ratio` when
        per-robot values are missing, or for one robot; None without a commanded speed.
        """
        if self.slowest is None or self.fastest is None:
            return None if self.speed_ratio is None else (self.speed_ratio, self.speed_ratio)
        return self.slowest, self.fastest


COLUMNS = tuple(item.name for item in fields(ResultRow))
"""Header of results.csv."""


def ends_of(ratios: Iterable[float | None]) -> dict[str, Any]:
    """Return the columns `slowest` and `fastest` from the speed ratios of virtual robots, or None."""
    known = [ratio for ratio in ratios if ratio is not None]
    return {"slowest": min(known, default=None), "fastest": max(known, default=None)}


def slowest_of(command: Command, velocities: Iterable[Sequence[float]]) -> float | None:
    """Return the column `slowest_walk` from the mean velocity of each walk, shape (3,); None without a command."""
    return min((ratio for velocity in velocities for ratio in command.axis_ratios(velocity)), default=None)


def tell_slowest_walk(rows: Iterable[ResultRow]) -> bool:
    """Return whether any row has `slowest_walk`; older files do not."""
    return any(row.slowest_walk is not None for row in rows)


def write_results(path: Path, rows: Sequence[ResultRow]) -> None:
    """Write results.csv, numbers with the digits that read back exactly. Errors: `write_rows`."""
    write_rows(path, rows, form="")


def read_results(path: Path) -> list[ResultRow]:
    """Read results.csv. Errors: `read_rows`."""
    return read_rows(path, ResultRow)


INDENTED = 500_000
"""Maximum size of a summary.json that is written with indentation [B], which adds half."""


def write_summary(path: Path, summary: dict[str, Any]) -> None:
    """Write summary.json; a number that is not finite is refused (`ValueError`)."""
    write_text(path, summary_text(summary))


def read_summary(path: Path) -> dict[str, Any]:
    """Return the contents of a summary.json.

    Raises `StictionError`: it cannot be read, or has another version.
    """
    data = take_version(read_object(path, "a summary.json"), SCHEMA_VERSION, path.name)
    return {"schema_version": SCHEMA_VERSION} | data


def summary_text(summary: dict[str, Any]) -> str:
    """Return the text of summary.json, schema version first; without indentation above `INDENTED`."""
    versioned = {"schema_version": SCHEMA_VERSION} | summary
    text = json.dumps(versioned, indent=2, allow_nan=False)
    return (text if len(text) <= INDENTED else json.dumps(versioned, allow_nan=False)) + "\n"


def read_metrics(path: Path) -> list[dict[str, Any]]:
    """Return the figures of every iteration, in order; empty without the file.

    A killed run may leave its last line cut off, which is ignored. Raises `StictionError` where the file cannot be
    read.
    """
    rows: list[dict[str, Any]] = []
    try:
        with open_regular(path) as file:
            for line in file:
                # Nothing behind a damaged line counts: rows would be missing in between.
                if not _is_row(row := json.loads(line)):
                    break
                rows.append(row)
    except FileNotFoundError:
        return []
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError):
        pass
    return rows


def _is_row(row: Any) -> bool:
    return (
        isinstance(row, dict)
        and row.get("phase") in ("teacher", "student")
        and is_integer(row.get("iteration"))
        and all(isinstance(value, float) or is_number(value, 1e300) for name, value in row.items() if name != "phase")
    )
