"""onnxruntime sends no telemetry: its setting is made before it is loaded."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

WALK = """
import stiction, numpy as np
policy = stiction.load_policy("saturn_lite-flat-deception-0.2")
policy.network(np.zeros((1, policy.contract.observation.size), np.float32))
"""


def files_of(program: str, folder: Path) -> list[str]:
    """Return the files that a program leaves in a home and a temporary folder of its own."""
    folder.mkdir()
    places = dict.fromkeys(("HOME", "TMPDIR", "XDG_CACHE_HOME", "MPLCONFIGDIR"), str(folder))
    own = {name: value for name, value in os.environ.items() if name != "ORT_DISABLE_TELEMETRY"}
    own |= {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    subprocess.run([sys.executable, "-P", "-c", program], env=own | places, check=True, timeout=120)
    return [file.name for file in folder.rglob("*") if file.is_file()]


def test_a_policy_leaves_no_identifier_and_no_account_of_its_sessions(tmp_path: Path) -> None:
    """A policy's process leaves neither an identifier nor a session log of onnxruntime."""
    left = files_of(WALK, tmp_path / "ours")
    assert not [name for name in left if name.startswith((".ses", "deviceid", "onnxruntime"))], left
