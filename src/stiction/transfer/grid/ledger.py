"""The walks that are done, one line of JSON each, written as they end: an interrupted grid goes on where it was.

A line is found again by everything that its walk depends on: the bundle's digest, the cell, the settings, the code
that measures, and the engine. What has changed since is walked anew; old lines stay, and are not read.
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

from stiction.formats.errors import StictionError
from stiction.formats.reproducibility import made_by
from stiction.robots.catalog import find_robot
from stiction.transfer.engines.catalog import binaries
from stiction.transfer.grid.config import ALONE, BATCH, GridCfg
from stiction.transfer.grid.plan import Walk
from stiction.transfer.kept import WALKING
from stiction.transfer.metrics import Metrics


class Ledger:
    """The walks of one grid that are done."""

    def __init__(self, path: Path, cfg: GridCfg, digests: dict[str, str], robot: str | None = None) -> None:
        """Read what is there.

        Args:
            path: the file; its folder exists.
            cfg: the grid.
            digests: policy -> digest of its bundle.
            robot: robot of one's own, see `robot_of`.

        Raises:
            StictionError: the file cannot be read.

        """
        self._path, self._digests = path, digests
        common = {"settings": cfg.settings(), "robot": robot} | made_by(*WALKING)
        if robot is not None:
            common["spec"] = repr(find_robot(robot))
        self._common = json.dumps(common, sort_keys=True)
        self._found: dict[str, dict[str, Any]] = {}
        self._torn = False
        self._read()

    def _read(self) -> None:
        """Read every whole line; one that an interruption cut off is none, and what comes next begins behind it."""
        try:
            text = self._path.read_text(encoding="utf-8") if self._path.exists() else ""
        except (OSError, UnicodeDecodeError) as error:
            raise StictionError(f"{self._path} cannot be read: {error}; move it away, or give another --out") from error
        self._torn = bool(text) and not text.endswith("\n")
        for line in text.splitlines():
            try:
                entry = json.loads(line)
                self._found[entry["key"]] = entry["metrics"]
            except (ValueError, TypeError, KeyError):
                continue

    def key(self, walk: Walk) -> str:
        """Return what a walk is found by."""
        engine = binaries(ALONE.get(walk.place.engine, BATCH))
        cell = json.dumps([asdict(walk), self._digests[walk.policy], engine], sort_keys=True)
        return hashlib.sha256((self._common + cell).encode()).hexdigest()[:24]

    def find(self, walk: Walk) -> Metrics | None:
        """Return what a walk was worth; None where it was not done."""
        found = self._found.get(self.key(walk))
        if found is None:
            return None
        share = found["group_share"]
        return Metrics(**found | {"group_share": None if share is None else tuple(share)})

    def add(self, walks: tuple[Walk, ...], metrics: list[Metrics]) -> None:
        """Keep walks, on disk when this returns.

        Raises:
            StictionError: the file cannot be written.

        """
        lines = []
        for walk, one in zip(walks, metrics, strict=True):
            key, plain = self.key(walk), asdict(one)
            self._found[key] = plain
            lines.append(json.dumps({"key": key, "walk": asdict(walk), "metrics": plain}, allow_nan=False))
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.write("\n" * self._torn + "".join(line + "\n" for line in lines))
                file.flush()
                os.fsync(file.fileno())
            self._torn = False
        except OSError as error:
            raise StictionError(f"{self._path} cannot be written: {error}; give another --out") from error
