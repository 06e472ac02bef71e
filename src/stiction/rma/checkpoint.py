"""Checkpoints: tensors in safetensors, the rest in JSON, written whole or not at all. Nothing is unpickled."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from stiction.formats.errors import StictionError

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
        return {
            "__dict__": [
                [key, _split(value, f"{name}.{key}" if name else str(key), tensors)] for key, value in tree.items()
            ]
        }
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


def _replace(path: Path, temporary: Path) -> None:
    """Make `temporary` durable and give it its name in one step."""
    with temporary.open("rb") as file:
        os.fsync(file.fileno())
    temporary.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def write_json(path: Path, data: Any) -> None:
    """Write JSON atomically."""
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(json.dumps(data, indent=1) + "\n")
    _replace(path, temporary)


def save_checkpoint(path: Path, tree: dict[str, Any]) -> None:
    """Write `tree` as `path` (.safetensors) and a .json beside it.

    The JSON is written last and names what must be there: a checkpoint without it was cut off, and does not count.
    """
    tensors: dict[str, torch.Tensor] = {}
    rest = _split(tree, "", tensors)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.tmp")
    # A header from an earlier try would vouch for tensors that are not its own.
    path.with_suffix(".json").unlink(missing_ok=True)
    try:
        save_file(tensors, temporary)
    except SafetensorError as error:
        raise OSError(f"{temporary}: {error}") from error
    _replace(path, temporary)
    write_json(path.with_suffix(".json"), {"tensors": len(tensors), "tree": rest})


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read what `save_checkpoint` wrote. Raises `StictionError` where a file is missing, cut off or altered."""
    try:
        header = json.loads(path.with_suffix(".json").read_text())
        # A copy each: in the file they lie unaligned, and the linear algebra rounds by how its numbers lie in memory.
        tensors = {name: tensor.clone() for name, tensor in load_file(path).items()}
        if len(tensors) != header["tensors"]:
            raise StictionError(
                f"checkpoint {path}: {len(tensors)} tensors, expected {header['tensors']}; it is incomplete"
            )
        tree = _join(header["tree"], tensors)
    except (OSError, ValueError, KeyError, TypeError, SafetensorError) as error:
        raise StictionError(
            f"checkpoint {path} cannot be read: {error}; remove it to go on from the one before it, or train again"
        ) from error
    if not isinstance(tree, dict):
        raise StictionError(f"checkpoint {path}: holds no named parts; it was not written by this program")
    return tree


def latest_checkpoint(folder: Path, phase: str) -> Path | None:
    """Return the newest complete checkpoint of a phase (`teacher` or `student`), or None."""
    return max(_complete(folder, phase), default=None)


def _complete(folder: Path, phase: str) -> list[Path]:
    """Return the complete checkpoints of a phase, oldest first."""
    return sorted(path for path in folder.glob(f"{phase}_*.safetensors") if path.with_suffix(".json").exists())


def keep_newest(folder: Path, phase: str, keep: int = 2) -> None:
    """Delete all but the newest complete checkpoints of a phase, and what a kill left incomplete."""
    kept = _complete(folder, phase)[-keep:]
    for path in folder.glob(f"{phase}_*.safetensors"):
        if path not in kept:
            path.with_suffix(".json").unlink(missing_ok=True)
            path.unlink()
