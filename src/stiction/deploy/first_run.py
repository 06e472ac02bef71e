"""First run of a network: in a process of its own, with little memory and time, which may fail.

The work of a network is bounded beforehand (`operators`). The behaviour of onnxruntime is not ours to promise; so a
robot, and an evaluation, runs a network only after it has run on recorded observations in another process.
"""

from __future__ import annotations

import hashlib
import struct
import subprocess
import sys

import numpy as np

from stiction.core.errors import BundleError, PolicyError
from stiction.core.isolation import run_isolated
from stiction.core.memory import address_space, bound

MEMORY = 384 * 2**20
"""Address space for loading and running, beyond that of Python and onnxruntime at that time [B]."""

SECONDS = 8
"""Processor time of the whole process [s]; starting Python and onnxruntime takes some 0.4 s of it."""

PATIENCE = 120.0
"""Longest time on a machine that is busy with other things [s]."""

STEPS = 32

_passed: set[bytes] = set()
"""Digests of networks that ran, with their observations, in this process."""


def first_run(model: bytes, observations: np.ndarray) -> None:
    """Load a network and run it on observations, float32, shape (T, size), within bounds of memory and time.

    It costs some 0.5 s, once for each network in a process. Raises `BundleError` where it fails or takes too much, and
    `PolicyError` where no process can be started.
    """
    # From all over the recording, and not from its beginning alone.
    rows = np.ascontiguousarray(observations[:: max(1, len(observations) // STEPS)][:STEPS], dtype="<f4")
    digest = hashlib.sha256(model + rows.tobytes()).digest()
    if digest in _passed:
        return
    try:
        content = struct.pack("<2q", *rows.shape) + rows.tobytes() + model
        done = run_isolated("stiction.deploy.first_run", PATIENCE, content=content)
    except subprocess.TimeoutExpired as error:
        raise BundleError(f"policy.onnx: its first run took more than {PATIENCE:.0f} s; do not use it") from error
    except OSError as error:
        why = error.strerror or error
        raise PolicyError(f"no process can be started for the network's first run: {why}") from error
    if done.returncode != 0:
        lines = done.stderr.decode("utf-8", "replace").strip().splitlines()
        why = lines[-1][:200] if lines else f"it ended with status {done.returncode}"
        raise BundleError(
            f"policy.onnx did not run within {MEMORY >> 20} MB and {SECONDS} s ({why}); do not use it, export it again"
        )
    _passed.add(digest)


def _limit() -> None:
    """Bound memory and processor time of this process, where the system can, and never above its former limits."""
    import resource

    bound(resource.RLIMIT_CPU, SECONDS)
    bound(resource.RLIMIT_CORE, 0)
    if (taken := address_space()) is not None:
        bound(resource.RLIMIT_AS, taken + MEMORY)


def main() -> None:
    """Read the input of `first_run`, and run it; the status reports success."""
    from stiction.deploy.policy import INPUT, OUTPUT, open_session

    # Behind the imports: onnxruntime's own address space is not the network's.
    _limit()
    content = sys.stdin.buffer.read()
    steps, size = struct.unpack("<2q", content[:16])
    end = 16 + 4 * steps * size
    rows = np.frombuffer(content[16:end], dtype="<f4").reshape(steps, size)
    session = open_session(content[end:])
    # One by one as on a robot, and side by side as in an evaluation.
    for batch in (*np.split(rows, steps), rows):
        if not np.isfinite(session.run([OUTPUT], {INPUT: batch})[0]).all():
            sys.exit("it puts out what is not finite")


if __name__ == "__main__":
    main()
