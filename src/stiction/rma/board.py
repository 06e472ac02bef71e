"""TensorBoard: the figures of one phase, without the steps that a resumed run makes again."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from torch.utils.tensorboard import SummaryWriter

LOOSE = "training"
"""Group of the figures whose name has none."""


class Board:
    """Writes into one folder, which TensorBoard shows as one run: teacher and student side by side, same tags."""

    def __init__(self, folder: Path) -> None:
        """Name the folder; a file is begun with the first figures."""
        self.folder = folder
        self._writer: SummaryWriter | None = None

    def add(self, iteration: int, figures: Mapping[str, float]) -> None:
        """Write one iteration. The first one tells TensorBoard to forget what it has from this iteration on."""
        if self._writer is None:
            self._writer = SummaryWriter(str(self.folder), purge_step=iteration)
        for name, value in figures.items():
            self._writer.add_scalar(name if "/" in name else f"{LOOSE}/{name}", value, iteration)

    def flush(self) -> None:
        """Bring everything to the disk: what comes before a checkpoint must not be lost with a killed run."""
        if self._writer is not None:
            self._writer.flush()

    def close(self) -> None:
        """End the file."""
        if self._writer is not None:
            self._writer.close()
