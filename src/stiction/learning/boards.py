"""Loggers of a training (`--logger`): TensorBoard, Weights & Biases, trackio. metrics.jsonl is written beside each."""

from __future__ import annotations

import io
import json
import os
import secrets
import warnings
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from stiction.core.errors import FileError
from stiction.core.extras import missing_extra
from stiction.core.files import write_text
from stiction.files.plain import read_object
from stiction.learning.config import TrainCfg
from stiction.learning.run import Interrupted

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

PROJECT = "stiction"
"""Project of runs in Weights & Biases (unless WANDB_PROJECT names another) and in trackio."""

IDENTITY = "logger.json"
"""File of a run with its id in Weights & Biases or trackio, by which a resumed run goes on there."""

COLORS = 128
"""Colours of a clip as GIF, the one moving picture that all three loggers show."""

INIT_TIMEOUT, FINISH_TIMEOUT = 20.0, 60.0
"""Longest wait for a Weights & Biases server at the begin and at the end of a training [s]."""


class Logger(Protocol):
    """Service that shows the figures and clips of one training."""

    def add(self, phase: str, iteration: int, figures: Mapping[str, float]) -> None:
        """Log the figures of one iteration of a phase, `teacher` or `student`."""

    def add_clip(self, phase: str, iteration: int, clip: bytes, size: tuple[int, int]) -> None:
        """Log a clip, GIF of `size` (width, height), of the policy after an iteration."""

    def flush(self) -> None:
        """Write buffered figures to the disk."""

    def close(self, failed: bool) -> None:
        """End the log. failed: True if the training ended with an error."""


class TensorBoard:
    """Writes one folder per phase, which TensorBoard shows as one run each."""

    def __init__(self, folder: Path) -> None:
        """Set the parent folder; a phase's file is created with its first figures."""
        self.folder = folder
        self._writers: dict[str, SummaryWriter] = {}

    def add(self, phase: str, iteration: int, figures: Mapping[str, float]) -> None:
        """Log one iteration. The first one makes TensorBoard drop older values from this iteration on."""
        from torch.utils.tensorboard import SummaryWriter

        if phase not in self._writers:
            self._writers[phase] = SummaryWriter(str(self.folder / phase), purge_step=iteration)
        for name, value in figures.items():
            self._writers[phase].add_scalar(name, value, iteration)

    def add_clip(self, phase: str, iteration: int, clip: bytes, size: tuple[int, int]) -> None:
        """Log a clip as an image, which TensorBoard passes to the browser as it is: a GIF moves there."""
        from tensorboard.compat.proto.summary_pb2 import Summary

        width, height = size
        image = Summary.Image(width=width, height=height, colorspace=3, encoded_image_string=clip)
        if (writer := self._writers.get(phase)) is not None:
            summary = Summary(value=[Summary.Value(tag="clip", image=image)])
            writer.file_writer.add_summary(summary, iteration)  # type: ignore[attr-defined]

    def flush(self) -> None:
        """Write buffered figures to the disk."""
        for writer in self._writers.values():
            writer.flush()

    def close(self, failed: bool) -> None:
        """Close the files."""
        for writer in self._writers.values():
            writer.close()


class OneRun:
    """Base of services in which a training is one run: the student's steps follow the teacher's, as in curves.png."""

    def __init__(self, folder: Path, cfg: TrainCfg) -> None:
        """Read the id of the run in `folder`, or draw one. Raises `FileError` where its file cannot be read."""
        self.folder, self.cfg = folder, cfg
        self.step = 0
        file = folder / IDENTITY
        if not file.exists():
            write_text(file, json.dumps({"id": secrets.token_hex(4)}) + "\n")
        identity = read_object(file, "that of `stiction train`").get("id")
        if not isinstance(identity, str) or len(identity) != 8 or not identity.isalnum():
            raise FileError(f"{file}: got the id {str(identity)[:40]!r}, expected 8 hexadecimal digits; remove it")
        self.identity = identity

    def add(self, phase: str, iteration: int, figures: Mapping[str, float]) -> None:
        """Log one iteration at its step of the whole training."""
        self.step = iteration + (self.cfg.teacher.iterations if phase == "student" else 0)
        self.log(dict(figures), self.step)

    def add_clip(self, phase: str, iteration: int, clip: bytes, size: tuple[int, int]) -> None:
        """Log a clip at the current step: steps must not decrease."""
        file = self.folder / "clips" / f".{phase}_{iteration:06d}.gif"
        file.write_bytes(clip)
        try:
            self.log({"clip": self.video(file, f"{self.cfg.name_of(phase)}, iteration {iteration}")}, self.step)
        finally:
            file.unlink()

    def log(self, values: dict[str, Any], step: int) -> None:
        """Log values at a step."""
        raise NotImplementedError

    def video(self, file: Path, caption: str) -> Any:
        """Return the service's own object for a clip, which has its own copy of the file."""
        raise NotImplementedError

    def flush(self) -> None:
        """Do nothing: these services write in processes or threads of their own."""


class WeightsAndBiases(OneRun):
    """Logs to Weights & Biases, offline where WANDB_MODE says so or no login is stored."""

    def __init__(self, folder: Path, cfg: TrainCfg) -> None:
        """Begin the run, or resume it. Nothing is asked on the terminal; neither code nor output is uploaded."""
        import wandb

        super().__init__(folder, cfg)
        mode = os.environ.get("WANDB_MODE")
        if mode is None and not wandb.login(prompt=False):
            mode = "offline"
            warnings.warn(
                f"wandb: no login is stored; logging offline in {folder / 'wandb'}; `wandb login` and `wandb sync` "
                "upload it later",
                stacklevel=2,
            )
        quiet = {"console": "off", "silent": True, "disable_git": True, "disable_code": True, "save_code": False}
        self.run = wandb.init(
            project=os.environ.get("WANDB_PROJECT", PROJECT),
            name=folder.resolve().name,
            id=self.identity,
            resume="allow",
            dir=str(folder),
            mode=mode,
            config=asdict(cfg),
            settings=wandb.Settings(init_timeout=INIT_TIMEOUT, finish_timeout=FINISH_TIMEOUT, **quiet),
        )

    def log(self, values: dict[str, Any], step: int) -> None:
        """Log values; the service drops steps that it has, which a resumed run makes again to the same values."""
        self.run.log(values, step=step)

    def video(self, file: Path, caption: str) -> Any:
        """Return a clip as `wandb.Video`."""
        import wandb

        # As bytes, of which wandb makes a file of its own: the one given by name would be uploaded later.
        return wandb.Video(io.BytesIO(file.read_bytes()), caption=caption, format="gif")

    def close(self, failed: bool) -> None:
        """End the run, as crashed where the training failed; wait for uploads for `FINISH_TIMEOUT` at most."""
        self.run.finish(exit_code=int(failed))


class Trackio(OneRun):
    """Logs to trackio: locally, or where TRACKIO_SPACE_ID or TRACKIO_SERVER_URL say."""

    def __init__(self, folder: Path, cfg: TrainCfg) -> None:
        """Begin the run, or resume it; its name has the id, since trackio resumes by name."""
        import trackio

        super().__init__(folder, cfg)
        self.run = trackio.init(
            project=PROJECT,
            name=f"{folder.resolve().name}-{self.identity}",
            resume="allow",
            config=asdict(cfg),
            embed=False,
            auto_log_gpu=False,
            auto_log_cpu=False,
        )

    def log(self, values: dict[str, Any], step: int) -> None:
        """Log values."""
        self.run.log(values, step=step)

    def video(self, file: Path, caption: str) -> Any:
        """Return a clip as `trackio.Video`."""
        import trackio

        return trackio.Video(file, caption=caption)

    def close(self, failed: bool) -> None:
        """End the run; trackio knows no failed ones."""
        import trackio

        # Not the run's own `finish`: trackio would end it once more at exit, and print that.
        trackio.finish()


class Board:
    """Logger of a training, which cannot end it: a logger that fails costs one warning and its further figures."""

    def __init__(self, name: str, begin: Callable[[], Logger]) -> None:
        """Set the logger's name, for messages, and how it begins, which it does with the first figures."""
        self.name, self._begin = name, begin
        self._logger: Logger | None = None
        self._failed = False

    def __enter__(self) -> Board:
        """Return the board, which is closed at the end."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the log; a training that was asked to stop has not failed."""
        if self._logger is not None:
            self._try(lambda logger: logger.close(kind is not None and not issubclass(kind, Interrupted)))
            self._logger = None

    def add(self, phase: str, iteration: int, figures: Mapping[str, float]) -> None:
        """Log the figures of one iteration; those without a group go under `training`."""
        grouped = {name if "/" in name else f"training/{name}": value for name, value in figures.items()}
        self._try(lambda logger: logger.add(phase, iteration, grouped))

    def add_clip(self, phase: str, iteration: int, clip: Path) -> None:
        """Log a clip, an animated WebP."""
        if self._logger is not None:
            self._try(lambda logger: logger.add_clip(phase, iteration, *as_gif(clip)))

    def flush(self) -> None:
        """Write buffered figures to the disk: those before a checkpoint must not be lost with a killed run."""
        if self._logger is not None:
            self._try(lambda logger: logger.flush())

    def _try(self, act: Callable[[Logger], None]) -> None:
        """Call the logger; give it up with one warning where it fails, however that may be."""
        if self._failed:
            return
        try:
            # Standard output belongs to --json.
            with redirect_stdout(io.StringIO()):
                if self._logger is None:
                    self._logger = self._begin()
                act(self._logger)
        except Exception as error:
            self._failed = True
            known = missing_extra(error, f"--logger {self.name}") if isinstance(error, ModuleNotFoundError) else None
            cause = known or " ".join(str(error).split())[:200] or type(error).__name__
            warnings.warn(f"{self.name} failed: {cause}; figures go to metrics.jsonl alone from now on", stacklevel=3)


def as_gif(clip: Path) -> tuple[bytes, tuple[int, int]]:
    """Return an animated WebP as GIF with every second frame, and its width and height."""
    from PIL import Image

    with Image.open(clip) as moving:
        frames, duration = [], 0.0
        for number in range(0, getattr(moving, "n_frames", 1), 2):
            moving.seek(number)
            frames.append(moving.convert("RGB").quantize(COLORS, method=Image.Quantize.FASTOCTREE))
            duration = moving.info.get("duration", 40.0)
        size = moving.size
    content = io.BytesIO()
    frames[0].save(content, "GIF", save_all=True, append_images=frames[1:], duration=round(2 * duration), loop=0)
    return content.getvalue(), size


def open_board(folder: Path, cfg: TrainCfg) -> Board:
    """Return the board of a training with the logger of its configuration; `folder`: of the run."""
    services: dict[str, Callable[[], Logger]] = {
        "tensorboard": partial(TensorBoard, folder / "tensorboard"),
        "wandb": partial(WeightsAndBiases, folder, cfg),
        "trackio": partial(Trackio, folder, cfg),
    }
    return Board(cfg.logger, services[cfg.logger])
