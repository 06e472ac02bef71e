"""Clips of a training run while it goes on: what the policy of a checkpoint does, as an animated WebP.

A process of its own films a copy of each checkpoint at a low priority; the training is the same with and without. All
clips show the same robot at `FORWARD`, without pushes or noise, on the mean terrain level that was reached.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction.core.files import publish
from stiction.core.isolation import python_module
from stiction.core.lifeline import follow_parent, tied
from stiction.core.opengl import opengl_environment
from stiction.evaluation.clip import FRAME_EVERY, SETTLE, following, write_clip

if TYPE_CHECKING:
    from stiction.task.config import TaskCfg
    from stiction.task.env import LocomotionEnv

FORWARD = 0.5
"""Commanded speed [m/s]."""

SECONDS = 4.0
"""Length of a clip [s]."""

PRIORITY = 10

COPY = ".filming-"

TIMEOUT = 600.0
"""Longest that a clip may take beside a training on all cores [s]."""


@dataclass(frozen=True)
class _Shot:
    """A checkpoint to film: a copy, since the training deletes old ones."""

    out: Path
    checkpoint: Path

    @property
    def log(self) -> Path:
        """Output of the renderer."""
        return self.checkpoint.parent / "log"

    def discard(self) -> None:
        """Remove the copy."""
        shutil.rmtree(self.checkpoint.parent, ignore_errors=True)


class ClipRecorder:
    """Films checkpoints, one at a time; a clip that fails costs the clips of the run and one line."""

    def __init__(
        self, run: Path, say: Callable[[str], None], done: Callable[[str, int, Path], None] = lambda *_: None
    ) -> None:
        """`run`: folder of the training run; `say`: prints a line; `done`: takes phase, iteration, path of a clip."""
        self.run, self.say, self.done = run, say, done
        self._filming: tuple[_Shot, subprocess.Popen, float] | None = None
        self._waiting: _Shot | None = None
        self._lost = False
        # What a training that was killed left.
        for left in (run / "clips").glob(f"{COPY}*"):
            shutil.rmtree(left, ignore_errors=True)

    def __call__(self, phase: str, iteration: int, checkpoint: Path) -> None:
        """Film a checkpoint, now or once the clip before is done; a newer one takes the place of one that waits."""
        if self._lost:
            return
        if self._waiting is not None:
            self._waiting.discard()
        clips = self.run / "clips"
        try:
            clips.mkdir(exist_ok=True)
            copy = Path(tempfile.mkdtemp(prefix=COPY, dir=clips)) / checkpoint.name
            self._waiting = _Shot(clips / f"{phase}_{iteration:06d}.webp", copy)
            for suffix in (".safetensors", ".json"):
                shutil.copy(checkpoint.with_suffix(suffix), copy.with_suffix(suffix))
        except OSError as error:
            self._give_up(str(error))
        self._proceed(0.0)

    def poll(self) -> None:
        """Take in a clip that is done; return at once."""
        self._proceed(0.0)

    def finish(self) -> None:
        """Wait until every clip is there."""
        while self._filming is not None:
            self._proceed(TIMEOUT)

    def abandon(self) -> None:
        """Abandon unfinished clips."""
        if self._filming is not None:
            shot, process, _ = self._filming
            process.kill()
            process.wait()
            shot.discard()
        if self._waiting is not None:
            self._waiting.discard()
        self._filming = self._waiting = None

    def _proceed(self, wait: float) -> None:
        """Take in a clip that is done, after at most `wait` seconds, and begin the one that waits."""
        if self._filming is not None:
            shot, process, deadline = self._filming
            try:
                status = process.wait(wait)
            except subprocess.TimeoutExpired:
                if time.monotonic() > deadline:
                    self._give_up(f"rendering took more than {TIMEOUT:.0f} s")
                return
            output = shot.log.read_text(errors="replace").strip().splitlines()
            shot.discard()
            self._filming = None
            if status != 0 or not shot.out.is_file():
                self._give_up((output or [f"it ended with status {status}"])[-1])
            else:
                phase, _, iteration = shot.out.stem.rpartition("_")
                self.done(phase, int(iteration), shot.out)
        if self._waiting is not None:
            self._begin(self._waiting)
            self._waiting = None

    def _begin(self, shot: _Shot) -> None:
        """Start the process that films."""
        with shot.log.open("wb") as log:
            process = subprocess.Popen(
                python_module("stiction.evaluation.film", (self.run, shot.checkpoint, shot.out)),
                **tied(opengl_environment() | {"STICTION_THREADS": "1", "OMP_NUM_THREADS": "1"}),
                stdout=subprocess.DEVNULL,
                stderr=log,
                start_new_session=True,  # Ctrl-C is for the training
            )
        self._filming = (shot, process, time.monotonic() + TIMEOUT)

    def _give_up(self, reason: str) -> None:
        """Print why no more clips follow."""
        self._lost = True
        self.abandon()
        self.say(
            f"no more clips of this run: {reason}; the training goes on. Without OpenGL, on Debian and Ubuntu: "
            "apt install libegl1 libgl1; or --video-every 0"
        )


def filmed_task(task: TaskCfg) -> TaskCfg:
    """Return the task as it is filmed: one command, no pushes, terrain levels that stay, else as trained at last."""
    commands = replace(
        task.commands, forward=(FORWARD, FORWARD), sideways=(0.0, 0.0), turn=(0.0, 0.0), standing_share=0.0
    )
    terrain = replace(task.terrain, speed=(FORWARD, FORWARD), promote_above=float("inf"), demote_below=0.0)
    calm = replace(task.randomization, push_interval=0.0)
    return replace(task, commands=commands, randomization=calm, terrain=terrain, physics=task.physics.at_last)


def _to_level(env: LocomotionEnv, course: dict[str, Any]) -> None:
    """Begin the robot's episode anew on the mean terrain level of the robots in a checkpoint's `course`."""
    import numpy as np

    from stiction.robots.terrain import KINDS, assign
    from stiction.task.terrain import SHARES

    assert env.course is not None
    level = np.asarray(course["level"])
    climbs = assign(SHARES[env.cfg.terrain.kind], len(level)) != KINDS.index("flat")
    env.course.level[:] = round(float(level[climbs].mean()))
    # An episode that covered what was asked, and is over with the next step, begins anew on the level that it was on.
    env.course.covered[:] = env.course.asked[:] = 1.0
    env.episode_length_buf = env.episode_length_buf + env.max_episode_length


def _render(run: Path, checkpoint: Path, out: Path) -> None:
    """Film the policy of a checkpoint."""
    import torch

    from stiction.core.provenance import stream_seed
    from stiction.learning.run import RunDirectory, identified_values, load_checkpoint
    from stiction.learning.runner import load_actor
    from stiction.task.env import LocomotionEnv

    directory = RunDirectory(run)
    cfg, values = directory.config(), identified_values(directory.header())
    actor = load_actor(directory, checkpoint.stem.partition("_")[0], checkpoint)
    env = LocomotionEnv(
        filmed_task(cfg.task), 1, stream_seed(cfg.seed, "clip"), 1, values, actuator=directory.actuator()
    )
    trained = load_checkpoint(checkpoint)["environment"]
    if trained["stage"] != env.stage:
        env.enter_stage(trained["stage"])
    if trained.get("course"):
        _to_level(env, trained["course"])
    fleet, period = env.fleet, env.fleet.control_period

    def moments() -> Iterator[list[Any]]:
        for step in range(round((SETTLE + SECONDS) / period)):
            with torch.no_grad():
                env.step(actor(env.get_observations()))
            if step * period >= SETTLE and step % FRAME_EVERY == 0:
                # With its model of now: a reset may lay the ground anew.
                yield [fleet.data(0)[1]]

    model, _ = fleet.data(0)
    with publish(out) as partial:
        write_clip(model, moments(), following(model), FRAME_EVERY * period, partial)


if __name__ == "__main__":
    follow_parent()
    os.nice(PRIORITY)
    _render(*map(Path, sys.argv[1:]))
