"""A run directory: config.json, metrics.jsonl, TensorBoard, checkpoints, summary.json."""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load, save

from stiction.core.decode import is_integer, is_number
from stiction.core.errors import FileError, TrainingError, UnwrittenError
from stiction.core.files import digest_of, near_file, open_regular, read_bounded, write_bytes, write_text
from stiction.core.lock import output_folder
from stiction.core.provenance import git_revision, machine
from stiction.files.actuator import FILE, actuator_file, read_actuator
from stiction.files.plain import read_object
from stiction.files.results import read_metrics
from stiction.joints.net import ActuatorNet
from stiction.learning.config import TrainCfg
from stiction.learning.stored import config_from
from stiction.robots.catalog import find_robot, is_shipped, robot_in_file
from stiction.robots.record import write_robot

A_CONFIG = "that of a folder that `stiction train` made"

HEADER: dict[str, Any] = {"config": dict, "revision": str, "identified": dict | None}

ROBOT = "robot.json"
"""A run's copy of a robot that does not come with the package."""

LARGEST_CHECKPOINT = 2**30
"""Bytes of a checkpoint's tensors that are read; those of the largest preset have some 4 MB."""

BROKEN = (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError, SafetensorError)
"""Errors of reading a damaged checkpoint."""

_TENSOR = "__tensor__"


def _split(tree: Any, name: str, tensors: dict[str, torch.Tensor]) -> Any:
    """Move the tensors and arrays of a nested structure into `tensors`; return the rest with references to them."""
    if isinstance(tree, np.ndarray):
        tree = torch.from_numpy(tree)
    if isinstance(tree, torch.Tensor):
        tensors[name] = tree.detach().cpu().clone().contiguous()
        return {_TENSOR: name}
    if isinstance(tree, dict):
        # JSON keys are strings; optimizers number their parameters.
        names = {key: f"{name}.{key}" if name else str(key) for key in tree}
        return {"__dict__": [[key, _split(value, names[key], tensors)] for key, value in tree.items()]}
    if isinstance(tree, list | tuple):
        return [_split(value, f"{name}.{index}", tensors) for index, value in enumerate(tree)]
    return tree


def _join(tree: Any, tensors: dict[str, torch.Tensor]) -> Any:
    """Undo `_split`."""
    if isinstance(tree, dict):
        if _TENSOR in tree:
            return tensors[tree[_TENSOR]]
        return {key: _join(value, tensors) for key, value in tree["__dict__"]}
    if isinstance(tree, list):
        return [_join(value, tensors) for value in tree]
    return tree


def write_json(path: Path, data: Any) -> None:
    """Write JSON atomically."""
    write_text(path, json.dumps(data, indent=1) + "\n")


def save_checkpoint(path: Path, tree: dict[str, Any]) -> None:
    """Write `tree` as `path` (.safetensors) and, last, a .json beside it: without that a checkpoint does not count."""
    tensors: dict[str, torch.Tensor] = {}
    rest = _split(tree, "", tensors)
    path.parent.mkdir(parents=True, exist_ok=True)
    # A header from an earlier try would vouch for tensors that are not its own.
    path.with_suffix(".json").unlink(missing_ok=True)
    content = save(tensors)
    write_bytes(path, content)
    write_json(path.with_suffix(".json"), {"tensors": len(tensors), "sha256": _digest(content, rest), "tree": rest})


def _digest(tensors: bytes, rest: Any) -> str:
    """Return the SHA-256 of a checkpoint: of the file of its tensors, and of the rest as JSON."""
    return hashlib.sha256(hashlib.sha256(tensors).digest() + json.dumps(rest).encode()).hexdigest()


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint. Raises `StictionError` where a file is missing, cut off or altered.

    Old ones have no digest.
    """
    try:
        header = read_object(path.with_suffix(".json"), "that of a checkpoint")
        content = read_bounded(path, "tensors of a checkpoint", FileError, LARGEST_CHECKPOINT)
        if header["tensors"] != (count := _count(content)):
            raise TrainingError(f"checkpoint {path}: {count} tensors, expected {header['tensors']}; it is incomplete")
        if "sha256" not in header:
            warnings.warn(
                f"{path} was written before checkpoints had digests: damage in it would not show", stacklevel=2
            )
        elif header["sha256"] != _digest(content, header["tree"]):
            raise ValueError("it is not what its digest says, and was damaged or altered")
        # A copy each: in the file they lie unaligned, and the linear algebra rounds by how its numbers lie in memory.
        tree = _join(header["tree"], {name: tensor.clone() for name, tensor in load(content).items()})
    except (*BROKEN, FileError) as error:
        raise TrainingError(
            f"checkpoint {path} cannot be read: {error}; remove it to go on from the one before it, or train again"
        ) from error
    if not isinstance(tree, dict):
        raise TrainingError(f"checkpoint {path}: holds no named parts; it was not written by this program")
    return tree


def _count(content: bytes) -> int:
    """Return the tensors that a file of them declares. Raises `ValueError` where it is none."""
    length = int.from_bytes(content[:8], "little")
    if not 2 <= length <= len(content) - 8:
        raise ValueError("it is cut off")
    return len(json.loads(content[8 : 8 + length]).keys() - {"__metadata__"})


def latest_checkpoint(folder: Path, phase: str) -> Path | None:
    """Return the newest complete checkpoint of a phase (`teacher` or `student`), or None."""
    return max(_complete(folder, phase), default=None)


def _complete(folder: Path, phase: str) -> list[Path]:
    """Return the complete checkpoints of a phase, oldest first."""
    return sorted(path for path in folder.glob(f"{phase}_*.safetensors") if path.with_suffix(".json").exists())


def keep_newest(folder: Path, phase: str, keep: int = 2) -> None:
    """Delete all but the newest complete checkpoints of a phase, and what a kill left incomplete."""
    newest = _complete(folder, phase)[-keep:]
    for path in folder.glob(f"{phase}_*.safetensors"):
        if path not in newest:
            # The header first: a kill in between leaves tensors, which the next call finds; a header alone it would not
            # find.
            path.with_suffix(".json").unlink(missing_ok=True)
            path.unlink()


REPORTED, STOPPED = ("walk/tracking_error",), ("iteration", "walk/tracking_error")
"""Figures in summary.json of a phase, and of one that reached its target."""

OTHERS = ("contract.json", "metrics.jsonl", "summary.json", "checkpoints/*")
"""Files that a new run's folder must not hold: those of a bundle, and of a run without its config.json."""

HOLDS_ONE = "{} holds a run already; resume it with --resume, or name another folder with --out"


class Interrupted(TrainingError):
    """A training was asked to stop, and has written a checkpoint."""


class RunDirectory:
    """The files of one training run."""

    def __init__(self, path: Path) -> None:
        """Name the run at `path`; nothing is read or written yet."""
        self.path = path
        self.checkpoints = path / "checkpoints"
        self.metrics = path / "metrics.jsonl"

    @classmethod
    def create(
        cls, path: Path, cfg: TrainCfg, command: str, identified: dict[str, Any] | None, processes: int = 1
    ) -> RunDirectory:
        """Start a run in an empty or new folder, with copies of its Actuator Net and of a robot that is not shipped.

        Raises `StictionError` where a run is there already, or the net cannot be read or does not fit the task.
        """
        if (path / "config.json").exists():
            raise TrainingError(HOLDS_ONE.format(path))
        if files := [file.relative_to(path) for pattern in OTHERS for file in sorted(path.glob(pattern))]:
            raise TrainingError(
                f"{path} holds {files[0]}, of a bundle or of a run without its config.json; name another --out"
            )
        run, robot = cls(path), find_robot(cfg.task.robot)
        header = {"command": command, "revision": git_revision(), "seed": cfg.seed, "identified": identified}
        header["compensation"] = cfg.task.friction.compensation
        if processes > 1:
            header["processes"] = processes
        if cfg.actuator is not None:
            net = read_actuator(Path(cfg.actuator))
            cfg.task.check_net(net, robot)
            file = actuator_file(Path(cfg.actuator))
            name = file.resolve().parent.name if file.name == FILE else file.name
            header |= {"actuator": {"name": name, "sha256": digest_of(file)}, "torque_source": net.torque_source}
        with output_folder(path):
            # Again, now that the folder is locked: another training may have begun in it in the meantime.
            if (path / "config.json").exists():
                raise TrainingError(HOLDS_ONE.format(path))
            try:
                run.checkpoints.mkdir(exist_ok=True)
                if cfg.actuator is not None:
                    write_bytes(path / FILE, file.read_bytes())
                if not is_shipped(cfg.task.robot):
                    write_robot(robot, path / ROBOT)
                # Last, for it is what makes the folder a run: whatever it names lies there by now.
                write_json(path / "config.json", header | {"config": asdict(cfg)})
            except OSError as error:
                raise FileError(
                    f"the run's folder {path} cannot be made: {error.strerror}; name another --out"
                ) from error
        return run

    def check_processes(self, processes: int) -> None:
        """Raise `StictionError` unless the run was begun in as many processes: each has robots of its own in it."""
        begun = self.header().get("processes", 1)
        if begun != processes:
            raise TrainingError(
                f"the run {self.path} was begun in {begun} processes, and there are {processes}; go on with as many: "
                f"torchrun --nproc-per-node {begun} -m stiction train --resume {self.path}"
            )

    def robots_of(self, rank: int) -> Path:
        """Return the folder of the checkpoints of a process: of rank 0 the run's, which have the networks."""
        return self.checkpoints / f"rank{rank}" if rank else self.checkpoints

    def actuator(self) -> ActuatorNet | None:
        """Return the run's Actuator Net, None where it has none. Raises `StictionError` where it was altered."""
        recorded = self.header().get("actuator")
        if recorded is None:
            return None
        if not isinstance(recorded, dict) or "sha256" not in recorded:
            raise FileError(f"{self.path / 'config.json'}: its actuator has no 'sha256'; expected {A_CONFIG}")
        net = read_actuator(self.path / FILE)
        if digest_of(self.path / FILE) != recorded["sha256"]:
            raise TrainingError(f"{self.path / FILE} is not the net that the run was started with; put that one back")
        return net

    def header(self) -> dict[str, Any]:
        """Return config.json whole. Raises `StictionError` where it cannot be read."""
        file = self.path / "config.json"
        if not file.exists():
            raise FileError(
                f"no run in {self.path}{near_file(self.path) or ';'} expected a folder that `stiction train` made"
            )
        data = read_object(file, A_CONFIG)
        if missing := [name for name, kind in HEADER.items() if not isinstance(data.get(name), kind)]:
            raise FileError(f"{file}: holds no {missing[0]!r}; expected {A_CONFIG}")
        return data

    def config(self) -> TrainCfg:
        """Return the configuration of the run, without reward terms of one's own; its copy of a robot of one's own.

        Raises `StictionError` where there is no copy of a robot that is named as a module, or friction was added
        otherwise.
        """
        cfg = self._written()
        if self.header().get("compensation") != cfg.task.friction.compensation:
            raise TrainingError(f"{self.path}: friction was added by the error, expected by the speed; train it again")
        if (copy := self.path / ROBOT).is_file():
            robot = str(copy)
        else:
            again = f"say it yourself, once: stiction export {self.path} --robot {shlex.quote(str(cfg.task.robot))}"
            robot = robot_in_file(cfg.task.robot, str(self.path / "config.json"), again)
        return replace(cfg, task=replace(cfg.task, robot=robot, rewards=replace(cfg.task.rewards, own=())))

    def config_to_train(self, named: tuple[tuple[str, float], ...] = ()) -> TrainCfg:
        """Return the configuration to go on training with.

        named: the run's own reward terms, said again, since finding one runs its module. Raises `StictionError` for
        others.
        """
        cfg, terms = self.config(), self._written().task.rewards.own
        if named != terms:
            words = " ".join(shlex.quote(str(word)) for term in terms for word in term)
            raise TrainingError(
                f"{self.path / 'config.json'}: reward terms are named as modules, and a file runs no module; say the "
                f"same again, if you trust them: stiction train --resume {self.path} --task.rewards.own {words}"
                if terms
                else f"the run {self.path} has no reward terms of your own; leave --task.rewards.own out"
            )
        return replace(cfg, task=replace(cfg.task, rewards=replace(cfg.task.rewards, own=terms)))

    def adopt(self, robot: str) -> None:
        """Copy the robot that the user named into the run. Raises `StictionError` where the run is of another."""
        if robot != self._written().task.robot:
            raise TrainingError(
                f"the run {self.path} is of the robot {self._written().task.robot!r}, not {robot!r}; leave --robot out"
            )
        if not is_shipped(robot) and not (self.path / ROBOT).exists():
            with self.writing():
                write_robot(find_robot(robot), self.path / ROBOT)

    def _written(self) -> TrainCfg:
        """Return the configuration as config.json says it: modules in it are names, and nothing looks them up."""
        return config_from(self.header()["config"], str(self.path / "config.json"))

    @property
    def finished(self) -> bool:
        """True if the run has its summary."""
        return (self.path / "summary.json").is_file()

    def summary(self) -> dict[str, Any]:
        """Return summary.json; empty where the run is not finished. Raises `StictionError` where it cannot be read."""
        if not self.finished:
            return {}
        file, expected = self.path / "summary.json", "that of a finished run; remove it and finish the run again"
        summary = read_object(file, expected)
        figures = {"last": REPORTED, "stopped": STOPPED}
        for name, wanted in figures.items():
            phases = summary.get(name, {})
            if not isinstance(phases, dict) or not all(
                isinstance(phase, dict) and all(is_number(phase.get(figure), 1e12) for figure in wanted)
                for phase in phases.values()
            ):
                raise FileError(f"{file}: {name!r} lacks numbers; expected {expected}")
        if "teacher" not in summary.get("last", {}) or not is_number(summary.get("seconds"), 1e12):
            raise FileError(f"{file}: lacks 'last' or 'seconds'; expected {expected}")
        return summary

    def check_finished(self, phase: str) -> None:
        """Raise `StictionError` unless a phase, `teacher` or `student`, has a whole checkpoint of its last step."""
        newest = latest_checkpoint(self.checkpoints, phase)
        iterations = getattr(self.config(), phase).iterations
        iterations = self.summary().get("stopped", {}).get(phase, {}).get("iteration", iterations)
        done = int(newest.stem.rpartition("_")[2]) if newest else 0
        if newest is None and self.finished:
            raise TrainingError(
                f"{self.path} is finished, and has no whole checkpoint of its {phase} any more; put its checkpoints "
                "back, or train again in another folder"
            )
        if newest is None or done != iterations:
            raise TrainingError(
                f"{self.path} is not finished, its {phase} stands at iteration {done} of {iterations}; "
                f"finish it with `stiction train --resume {self.path}`"
            )
        self.check_checkpoints()

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Lock the run; turn a full disk, and a folder without permission, into one line."""
        try:
            with output_folder(self.path):
                yield
        except (OSError, UnwrittenError) as error:
            raise FileError(
                f"the run {self.path} cannot be written: {error}; make room or name the right owner, then "
                f"`stiction train --resume {self.path}` goes on from the last checkpoint"
            ) from error

    def flush(self) -> None:
        """Bring the figures to the disk: those before a checkpoint must not be lost with the machine's power."""
        with self.metrics.open("a") as file:
            os.fsync(file.fileno())

    def _figures(self) -> bytes:
        """Return metrics.jsonl as it lies there; empty without it. Raises `StictionError` where it cannot be read."""
        try:
            with open_regular(self.metrics) as file:
                return file.read()
        except FileNotFoundError:
            return b""
        except OSError as error:
            raise FileError(f"{self.metrics} cannot be read: {error.strerror}") from error

    def origin(self) -> dict[str, Any]:
        """Return digests of the run's settings and figures, for a checkpoint."""
        header = self.header()
        settings = {name: header.get(name) for name in ("config", "identified", "actuator")}
        robot = self.path / ROBOT
        figures = self._figures()
        return {
            "settings": hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest(),
            "robot": digest_of(robot) if robot.is_file() else None,
            "figures": {"bytes": len(figures), "sha256": hashlib.sha256(figures).hexdigest()},
        }

    def check(self, tree: dict[str, Any], path: Path) -> None:
        """Raise `StictionError` where a checkpoint is none of this run. Older ones do not say which they are of."""
        phase, _, number = path.stem.rpartition("_")
        stopped, iterations = tree.get("stopped"), getattr(self.config(), phase).iterations
        if not (
            is_integer(tree.get("iteration"))
            and number == f"{tree['iteration']:06d}"
            and tree["iteration"] <= iterations
            and (stopped is None or isinstance(stopped, dict))
        ):
            raise TrainingError(
                f"checkpoint {path}: it is of another iteration than its name says, or of none of the {iterations}; "
                "remove it to go on from the one before it"
            )
        try:
            if "run" in tree:
                self.check_origin(path.name, tree["run"])
        except BROKEN as error:
            raise TrainingError(
                f"checkpoint {path}: cannot be compared with its run ({type(error).__name__}: {error}); remove it to "
                "go on from the one before it"
            ) from error

    def check_checkpoints(self) -> None:
        """Raise `StictionError` where the newest checkpoints are damaged, or none of this run: before it is built."""
        for phase in ("teacher", "student"):
            newest = latest_checkpoint(self.checkpoints, phase)
            if newest is not None:
                self.check(load_checkpoint(newest), newest)

    def check_origin(self, checkpoint: str, origin: dict[str, Any]) -> None:
        """Raise `StictionError` where a checkpoint is of other settings or figures: both decide how the run goes on."""
        now, figures = self.origin(), origin["figures"]
        # The file has grown since; only what it held then can be compared.
        begin = self._figures()[: figures["bytes"]]
        same = {
            "config.json": now["settings"] == origin["settings"],
            ROBOT: origin.get("robot") in (None, now["robot"]),  # none: the user has named it again since
            "metrics.jsonl": hashlib.sha256(begin).hexdigest() == figures["sha256"],
        }
        for name, agrees in same.items():
            if not agrees:
                raise TrainingError(
                    f"{self.path / name} is not what it was when {checkpoint} was written; put it back, or train again "
                    "in another folder"
                )

    def student_digest(self) -> str:
        """Return the SHA-256 of the newest checkpoint of the student. Raises `StictionError` where there is none."""
        newest = latest_checkpoint(self.checkpoints, "student")
        if newest is None:
            raise TrainingError(f"{self.path} has no student yet; finish it with `stiction train --resume {self.path}`")
        return digest_of(newest)

    def walks_by(self) -> dict[str, Any]:
        """Return all that decides how the run's policies walk, except their weights, for keys of a cache."""
        header = self.header()
        names = ("config", "identified", "actuator", "torque_source")
        return {name: header.get(name) for name in names} | {"robot": repr(find_robot(self.config().task.robot))}

    def log(self, row: dict[str, Any]) -> None:
        """Append one iteration's figures."""
        with self.metrics.open("a") as file:
            file.write(json.dumps(row) + "\n")

    def rows(self) -> list[dict[str, Any]]:
        """Return the figures of every iteration so far."""
        return read_metrics(self.metrics)

    def resume(self) -> None:
        """Add the revision that continues the run to the one that began it, where they differ: `a1b2+c3d4`."""
        header, revision = self.header(), git_revision()
        if revision not in header["revision"].split("+"):
            write_json(self.path / "config.json", header | {"revision": f"{header['revision']}+{revision}"})

    def forget_after(self, phase: str, iteration: int) -> None:
        """Drop the figures of iterations that will be run again, and a last line that a kill cut off."""
        order = {"teacher": 0, "student": 1}
        rows = [row for row in self.rows() if (order[row["phase"]], row["iteration"]) <= (order[phase], iteration)]
        write_text(self.metrics, "".join(json.dumps(row) + "\n" for row in rows))

    def finish(self, figures: dict[str, Any]) -> None:
        """Write summary.json: the last figures, the command and revision that made them, and the machine."""
        header = {key: value for key, value in self.header().items() if key != "config"}
        write_json(self.path / "summary.json", header | figures | {"machine": machine()})


def identified_values(header: dict[str, Any]) -> dict[str, np.ndarray] | None:
    """Return the joints that a run, by its `RunDirectory.header`, took from an identification, None where none."""
    identified = header["identified"]
    if not identified:
        return None
    try:
        return {name: np.array(value, float) for name, value in identified["values"].items()}
    except (KeyError, AttributeError, ValueError, TypeError) as error:
        raise FileError(f"config.json: its identified joints cannot be read: {error}; expected {A_CONFIG}") from error
