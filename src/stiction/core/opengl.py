"""Rendering in a separate process, where OpenGL is chosen before MuJoCo is imported; a crash costs only the picture."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from stiction.core.errors import EngineError
from stiction.core.isolation import isolated_environment, python_module
from stiction.core.lifeline import tied


def opengl_environment() -> dict[str, str]:
    """Return the environment for rendering: EGL on Linux without a display, unless another one is chosen."""
    environment = isolated_environment()
    headless = not (environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY"))
    if sys.platform == "linux" and headless:
        environment.setdefault("MUJOCO_GL", "egl")
    return environment


def render(
    module: str, words: Iterable[object], out: Path, timeout: float, error: type[EngineError], what: str
) -> Path:
    """Run a module that draws a file, and return the file's path.

    module: run as `python -P -m` with these words, and calls `follow_parent`; timeout: [s]; error: raised on a timeout,
    a failure, or a missing file, with the last output; what: name of the picture, such as `clip`.
    """
    try:
        done = subprocess.run(
            python_module(module, words),
            **tied(opengl_environment()),
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )
    except subprocess.TimeoutExpired as late:
        raise error(f"no {what}: rendering took more than {timeout:.0f} s") from late
    if done.returncode != 0 or not out.is_file():
        output = (done.stderr.strip().splitlines() or [f"it ended with status {done.returncode}"])[-1]
        raise error(
            f"no {what}: OpenGL is not available here ({output}); on Debian and Ubuntu: apt install libegl1 libgl1"
        )
    return out
