"""Golden vectors: recorded sensors and what the policy made of them, so that any runtime can be held to them.

`export` records them with the policy as training computes it, in torch; `verify` and robots replay them with NumPy and
onnxruntime. They also hold the SHA-256 of the bundle's other files, so that a contract or a card edited afterwards no
longer fits.
"""

from __future__ import annotations

import io
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from stiction.formats.errors import StictionError

MIN_STEPS = 500
"""Steps that golden vectors must have: ten seconds at 50 Hz."""

MAX_BYTES = 64 * 2**20
"""Largest size of the arrays together, unpacked [B]: a small archive may not fill the memory."""


class GoldenError(StictionError):
    """Golden vectors that cannot be replayed; the message names the array."""


@dataclass(frozen=True)
class Golden:
    """A recorded rollout of one robot, T steps. Angles [rad], velocities [rad/s]."""

    joint_names: np.ndarray
    """Names of the joints, text, shape (J,)."""
    time: np.ndarray
    """Time since the start of the recording [s], shape (T,)."""
    reset: np.ndarray
    """True where the history starts anew before this step, bool, shape (T,)."""
    command: np.ndarray
    """Commanded velocity: forward, sideways [m/s], turn [rad/s], shape (T, 3)."""
    quaternion: np.ndarray
    """Measured orientation of the base, w x y z, shape (T, 4)."""
    angular_velocity: np.ndarray
    """Measured angular velocity in the base frame [rad/s], shape (T, 3)."""
    joint_position: np.ndarray
    """Measured joint angles [rad], shape (T, J)."""
    joint_velocity: np.ndarray
    """Measured joint velocities [rad/s], shape (T, J)."""
    observation: np.ndarray
    """Input of the network, float32, shape (T, observation size)."""
    action: np.ndarray
    """Output of the network after clipping, float32, shape (T, J)."""
    target: np.ndarray
    """Joint targets [rad], shape (T, J)."""

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.time)


DAMAGED = (
    *(OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, MemoryError, OverflowError),
    *(SyntaxError, tokenize.TokenError, zipfile.BadZipFile, zlib.error),
)
"""What zipfile and numpy raise for a damaged archive."""

BOUND = "sha256:"
"""Prefix of the arrays that hold the SHA-256 of the bundle's other files."""


def write_golden(golden: Golden, digests: Mapping[str, str]) -> bytes:
    """Return the bytes of golden.npz; `digests` maps the bundle's other files to their SHA-256 in hexadecimal."""
    arrays = {field.name: getattr(golden, field.name) for field in fields(Golden)}
    arrays |= {BOUND + name: np.array(digest) for name, digest in digests.items()}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def read_golden(data: bytes, observation_size: int, joint_names: tuple[str, ...]) -> tuple[Golden, dict[str, str]]:
    """Parse golden.npz and check it against the contract's sizes; return it and the digests that it binds.

    Raises:
        GoldenError: not an NPZ, too large unpacked, an array missing, unknown, of the wrong shape or type, not finite,
            fewer than `MIN_STEPS` steps, fewer than two resets, or no reset at the first step.

    """
    arrays = _unpack(data)
    digests = {name.removeprefix(BOUND): str(arrays.pop(name)) for name in list(arrays) if name.startswith(BOUND)}
    expected = {field.name for field in fields(Golden)}
    if arrays.keys() != expected:
        odd = sorted(arrays.keys() ^ expected)
        raise GoldenError(f"golden.npz: the array {odd[0]!r} is missing or unknown; export the bundle again")
    golden = Golden(**arrays)
    _check(golden, observation_size, joint_names)
    return golden, digests


def _unpack(data: bytes) -> dict[str, np.ndarray]:
    """Read every array without executing anything, bounded in size."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            total = sum(entry.file_size for entry in archive.infolist())
        if total > MAX_BYTES:
            raise GoldenError(f"golden.npz unpacks to {total} bytes; at most {MAX_BYTES} are read")
        with np.load(io.BytesIO(data), allow_pickle=False) as loaded:
            arrays = {name: loaded[name] for name in loaded.files}
    except DAMAGED as error:
        raise GoldenError(f"golden.npz cannot be read: {error}; export the bundle again") from error
    if other := [name for name, array in arrays.items() if not isinstance(array, np.ndarray)]:
        raise GoldenError(f"golden.npz: {other[0]!r} is not an array; export the bundle again")
    return arrays


def _check(golden: Golden, observation_size: int, joint_names: tuple[str, ...]) -> None:
    """Check names, shapes, types and values."""
    if golden.joint_names.dtype.kind != "U" or tuple(golden.joint_names.tolist()) != joint_names:
        raise GoldenError(f"golden.npz is for the joints {golden.joint_names.tolist()}, the contract has {joint_names}")
    steps, joints = golden.time.shape[0] if golden.time.ndim else 0, len(joint_names)
    widths = {"command": 3, "quaternion": 4, "angular_velocity": 3, "observation": observation_size}
    widths |= {"joint_position": joints, "joint_velocity": joints, "action": joints, "target": joints}
    shapes = {"time": (steps,), "reset": (steps,), **{name: (steps, width) for name, width in widths.items()}}
    for name, shape in shapes.items():
        array = getattr(golden, name)
        kinds = "b" if name == "reset" else "f"
        if array.shape != shape or array.dtype.kind not in kinds:
            raise GoldenError(f"golden.npz: {name!r} is {array.dtype} {array.shape}; expected {shape}, kind {kinds!r}")
        if not np.isfinite(array).all():
            raise GoldenError(f"golden.npz: {name!r} contains numbers that are not finite")
    if steps < MIN_STEPS:
        raise GoldenError(f"golden.npz has {steps} steps; at least {MIN_STEPS} are needed")
    if not golden.reset[0] or golden.reset.sum() < 2:
        raise GoldenError("golden.npz must start with a reset and contain at least one more")
