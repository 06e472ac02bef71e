"""A training run in the viewer: its newest checkpoint or a chosen one, with the reward terms of its training."""

from __future__ import annotations

import threading
from functools import partial
from pathlib import Path

from stiction.core.errors import TrainingError, unknown_name
from stiction.evaluation.newest import NewestPolicy
from stiction.view.rewards import RewardMeter
from stiction.view.simulation import ViewedPolicy

NEWEST = "newest"
"""Choice that follows the training."""


class ViewedRun(NewestPolicy):
    """A run whose checkpoint can be chosen; `refresh` and `watch` do nothing while an older one is chosen."""

    def __init__(self, run: Path, wait: bool = False, robot: str | None = None) -> None:
        """Read a run's newest checkpoint; arguments and errors as of `NewestPolicy`."""
        self.chosen, self._lock = NEWEST, threading.RLock()
        super().__init__(run, wait, robot)

    @property
    def checkpoints(self) -> tuple[str, ...]:
        """Names of the choices: `newest`, then the complete checkpoints, newest first."""
        files = self._directory.checkpoints.glob("*_*.safetensors")
        names = [file.stem for file in files if file.with_suffix(".json").exists()]
        return (NEWEST, *sorted(names, key=lambda name: (name.startswith("student"), name), reverse=True))

    def choose(self, name: str) -> None:
        """Read a checkpoint by its name, or the newest. Raises `StictionError` if it is missing or not readable."""
        if name not in self.checkpoints:
            raise TrainingError(unknown_name("checkpoint", name, self.checkpoints))
        with self._lock:
            if name == NEWEST:
                self.chosen = name
                self.refresh()
                return
            file = self._directory.checkpoints / f"{name}.safetensors"
            self._module, self._file = self._read(name.partition("_")[0], file), file
            self.chosen = name

    def refresh(self) -> bool:
        """Read the newest checkpoint, unless an older one is chosen; return whether it is another one than before."""
        with self._lock:
            return self.chosen == NEWEST and super().refresh()

    def viewed(self) -> ViewedPolicy:
        """Return the policy of the checkpoint that was read last."""
        meter = partial(RewardMeter, self._directory.config().task, self.robot)
        return ViewedPolicy(self.name, self.contract, self.load, rewards=meter)
