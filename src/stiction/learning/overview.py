"""Overviews of training runs from their files alone: no torch, and nothing in a folder is trusted or changed."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean
from typing import Any

from stiction.core.decode import is_integer
from stiction.core.errors import FileError
from stiction.core.files import open_regular
from stiction.core.lock import is_written
from stiction.files.following import judge_row
from stiction.files.plain import read_object
from stiction.files.results import read_results

DEPTH, MOST_FOLDERS = 4, 10_000
"""Folders below the one that is searched: levels, and their number."""

RECENT = 20
"""Iterations over which the end values of curves are averaged."""

TAIL = 2**18
"""Bytes of metrics.jsonl of which the last iterations are read; a row has some 2 kB."""

BLOCK = 2**20
"""Bytes that are read at once to count the iterations."""

LARGEST_CONFIG = 2**22
"""Bytes of config.json that are read; a run's has some 5 kB."""

LARGEST_RESULTS = 2**24
"""Bytes of results.csv that are read."""

EXPECTED = "that of a folder that `stiction train` made"


@dataclass(frozen=True)
class Overview:
    """State of one training run."""

    path: Path
    """Folder of the run."""
    robot: str
    """Name of the robot; of a file or module its last part."""
    method: str
    """Training method."""
    seed: int
    """Seed of the training."""
    done: int
    """Iterations that were made, in both phases."""
    iterations: int
    """Iterations in all; a phase that reached its target early makes fewer."""
    state: str
    """`running`, `stopped` or `finished`."""
    followed: tuple[int, int] | None
    """Commands that are followed, of how many: of the newest results.csv in the folder or one below; None without."""
    written: float
    """Time of the last iteration, of the begin where none was made [s since the epoch]."""
    settings: Mapping[str, Any] = field(repr=False)
    """Setting, by its path as in `--set`, -> value."""
    ends: Mapping[str, float] = field(repr=False)
    """Figure of metrics.jsonl -> its mean over the last iterations of the last phase."""

    def to_dict(self) -> dict[str, Any]:
        """Return what `stiction runs --json` prints: no NaN, which JSON lacks."""
        names = ("robot", "method", "seed", "done", "iterations", "state", "followed", "written")
        ends = {name: value if math.isfinite(value) else None for name, value in self.ends.items()}
        return {"path": str(self.path), **{name: getattr(self, name) for name in names}, "ends": ends}


def run_folders(folder: Path) -> list[Path]:
    """Return the folders with a config.json, at most `DEPTH` below `folder`; links are not followed, nor runs entered.

    Raises `FileError` where `folder` cannot be listed, or has too many folders.
    """
    if not folder.is_dir():
        raise FileError(f"{folder}: got no folder, expected one with runs of `stiction train`; name it, or train")
    runs, waiting, count = [], [(folder, 0)], 0
    while waiting:
        place, depth = waiting.pop()
        if (place / "config.json").is_file():
            runs.append(place)
            continue
        count += 1
        if count > MOST_FOLDERS:
            raise FileError(f"{folder} has over {MOST_FOLDERS} folders; name one with fewer, where the runs are")
        waiting += [(below, depth + 1) for below in _folders(place) if depth < DEPTH]
    return runs


def _folders(place: Path) -> Iterator[Path]:
    """Yield the visible folders in a folder; none where it cannot be listed."""
    try:
        with os.scandir(place) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False) and not entry.name.startswith("."):
                    yield Path(entry.path)
    except OSError:
        return


def read_overview(path: Path) -> Overview:
    """Return the overview of the run in a folder. Raises `FileError` where its config.json or metrics.jsonl is damaged.

    A results.csv that cannot be read does not count.
    """
    file = path / "config.json"
    header = read_object(file, EXPECTED, most=LARGEST_CONFIG)
    settings: dict[str, Any] = dict(flattened(header.get("config", {})))
    robot, method = settings.get("task.robot"), settings.get("task.friction.method")
    counts: list[Any] = [settings.get(f"{phase}.iterations") for phase in ("teacher", "student")]
    seed: Any = header.get("seed", settings.get("seed"))
    if not (isinstance(robot, str) and isinstance(method, str) and all(is_integer(count) for count in (*counts, seed))):
        raise FileError(f"{file}: holds no robot, method, seed and iterations; expected {EXPECTED}")
    done, rows = _read_end(path / "metrics.jsonl")
    last = [row for row in rows if row.get("phase") == rows[-1].get("phase")][-RECENT:]
    names = dict.fromkeys(name for row in last for name in row if name not in ("phase", "iteration"))
    series = {name: [row[name] for row in last if isinstance(row.get(name), int | float)] for name in names}
    finished = (path / "summary.json").is_file()
    return Overview(
        path=path,
        robot=Path(robot).name.rpartition(":")[2],
        method=method,
        seed=seed,
        done=done,
        iterations=sum(counts),
        state="finished" if finished else "running" if is_written(path) else "stopped",
        followed=_followed(path),
        written=(path / "metrics.jsonl" if done else file).stat().st_mtime,
        settings=settings,
        ends={name: fmean(values) for name, values in series.items() if values},
    )


def _read_end(file: Path) -> tuple[int, list[dict[str, Any]]]:
    """Return the number of whole lines of metrics.jsonl, and the last rows; 0 and none without the file."""
    try:
        with open_regular(file) as lines:
            count = sum(block.count(b"\n") for block in iter(lambda: lines.read(BLOCK), b""))
            lines.seek(max(0, lines.tell() - TAIL))
            # The first line may be cut off by the tail, the last one by a kill.
            texts = lines.read(TAIL).split(b"\n")[:-1][-RECENT:]
    except FileNotFoundError:
        return 0, []
    except OSError as error:
        raise FileError(f"{file} cannot be read: {error.strerror}") from error
    try:
        rows = [json.loads(text) for text in texts]
    except (ValueError, RecursionError) as error:
        raise FileError(f"{file}: not JSON ({str(error)[:80]}); expected figures of `stiction train`") from error
    if not all(isinstance(row, dict) for row in rows):
        raise FileError(f"{file}: holds no figures of iterations; expected those of `stiction train`")
    return count, rows


def _followed(path: Path) -> tuple[int, int] | None:
    """Return the followed commands, and all, of the newest results of an evaluation in a run's folder."""
    files = [*path.glob("results.csv"), *path.glob("*/results.csv")]
    try:
        newest = max(files, key=lambda file: file.stat().st_mtime, default=None)
        if newest is None or newest.stat().st_size > LARGEST_RESULTS:
            return None
        verdicts = [verdict for row in read_results(newest) if (verdict := judge_row(row)) is not None]
    except (FileError, OSError):
        return None
    return (sum(verdict.follows for verdict in verdicts), len(verdicts)) if verdicts else None


def flattened(settings: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the path of each setting in nested plain data and its value; lists are values."""
    if not isinstance(settings, dict):
        yield prefix.removesuffix("."), settings
        return
    for name, value in settings.items():
        yield from flattened(value, f"{prefix}{name}.")


def different(overviews: Sequence[Overview]) -> dict[str, list[Any]]:
    """Return setting in which runs differ -> its value in each; None where a run of an older version lacks it."""
    names = dict.fromkeys(name for each in overviews for name in each.settings)
    values = {name: [each.settings.get(name) for each in overviews] for name in names}
    return {name: each for name, each in values.items() if any(value != each[0] for value in each)}


def short_names(paths: Iterable[Path]) -> list[str]:
    """Return the paths without the folders that all have in common: of one run its own name."""
    whole = [path.resolve() for path in paths]
    common = Path(os.path.commonpath([path.parent for path in whole])) if whole else Path()
    return [str(path.relative_to(common)) for path in whole]
