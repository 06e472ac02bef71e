"""Says when a phase of training has reached its target and may end."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from stiction.rma.config import StopCfg

Row = Mapping[str, float]
"""The figures of one iteration."""


class EarlyStop:
    """Averages the last iterations of one phase. Given the same rows it says the same: a resumed run too."""

    def __init__(self, cfg: StopCfg, last_stage: int, not_before: int = 0) -> None:
        """Remember which iterations count.

        `last_stage`: number of the friction stage that every averaged iteration must belong to; `not_before`: the first
        iteration that counts, that from which a robot walks with its least noise.
        """
        self.cfg, self.last_stage, self.not_before = cfg, last_stage, not_before
        self._rows: deque[Row] = deque(maxlen=cfg.iterations)

    def check(self, row: Row, iteration: int = 0) -> dict[str, float] | None:
        """Take the figures of an iteration; return the means that met the target, or None."""
        if self.cfg.tracking_error is None:
            return None
        if row["friction/stage"] != self.last_stage or iteration < self.not_before:
            self._rows.clear()
            return None
        self._rows.append(row)
        if len(self._rows) < self.cfg.iterations:
            return None
        names = ("walk/tracking_error", "walk/falls", "terrain/level")
        means = {name: sum(r[name] for r in self._rows) / len(self._rows) for name in names if name in row}
        level = self.cfg.terrain_level
        met = means["walk/tracking_error"] < self.cfg.tracking_error and means["walk/falls"] <= self.cfg.falls
        return means if met and (level is None or means["terrain/level"] >= level) else None
