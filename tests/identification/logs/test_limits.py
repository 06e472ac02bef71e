"""Logs beyond the limits of memory and time are rejected in one line, in little memory and time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import log_attacks
from processes import outcome
from stiction.cli.main import main

REASONS = {
    "sidecar_of_names": "names has 80001 entries; expected at most 256",
    "sidecar_of_joints": "joints has 40001 entries; expected at most 256",
    "mcap_of_zeros": "not a whole bag",
    "mcap_of_one_message": "expected at most 65536",
    "mcap_of_small_messages": "is damaged",
    "npz_of_bytes": "its arrays would take 1006632960 bytes",
    "csv_with_a_bad_end": "line 30002: 'x' in column 'position' is not a number",
    "csv_of_one_line": "a line of over",
    "csv_of_commas": "a line of over 4096 columns",
    "gzip_of_lines": "which no log does",
    "json_of_objects": "as JSON it would take",
    "json_of_depth": "not JSON",
    "parquet_of_one_number": "rows would take 805306368 bytes",
    "parquet_of_lists": "rows would take 268435",
    "database_of_views": "not a whole bag",
    "database_of_a_column": "not a whole bag",
    "database_of_one_cell": "expected at most 65536",
}
"""Attack -> what it is refused for."""


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict]:
    """Return the output of one process with bounded memory and processor time for every attack."""
    folder = tmp_path_factory.mktemp("log_attacks")
    paths = {}
    for name, attack in log_attacks.ATTACKS.items():
        (folder / name).mkdir()
        paths[name] = str(attack(folder / name))
    (folder / "attacks.json").write_text(json.dumps(paths))
    return outcome("log_attacks.py", folder)


@pytest.mark.parametrize("name", log_attacks.ATTACKS)
def test_an_attack_is_refused_in_one_line(outcomes: dict[str, dict], name: str) -> None:
    """The reader rejects an attack before it allocates memory."""
    case = outcomes[name]
    assert REASONS[name] in case["error"] and "\n" not in case["error"] and "not enough memory" not in case["error"]
    assert case["grown"] < log_attacks.MEMORY / 2 + 2 * case["size"], case


def stiction(*arguments: str, limit: int | None = None) -> subprocess.CompletedProcess:
    """Run the program, with a limit to its address space [B] if there is one."""
    code = "import sys\nfrom stiction.cli.main import entry\nimport stiction.identification.pipeline\n"
    if limit is not None:
        code += f"import resource; resource.setrlimit(resource.RLIMIT_AS, ({limit}, {limit}))\n"
    return subprocess.run(
        [sys.executable, "-c", code + "entry()", *arguments],
        capture_output=True,
        text=True,
        check=False,
        env=dict(os.environ) | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )


def test_want_of_memory_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """A valid log in a process with too little memory, and a limit below the log's size, each give one line."""
    rows = np.random.default_rng(0).standard_normal((100_000, 40))
    columns = {"time": np.arange(100_000) * 1e-3, "position": rows[:, 0]} | {f"c{i}": rows[:, i] for i in range(40)}
    np.savez(tmp_path / "log.npz", **columns)
    done = stiction("identify", str(tmp_path / "log.npz"), "--memory-limit", "0.125")
    assert done.returncode == 1 and done.stderr.count("\n") == 1, done.stderr
    assert "at most 33554432 are read" in done.stderr and "--memory-limit" in done.stderr
    done = stiction("identify", str(tmp_path / "log.npz"), limit=2**30 + 2**27)
    assert done.returncode == 1 and "Traceback" not in done.stderr, done.stderr
    for wrong in ("0", "nan", "1e9"):
        assert main(["identify", str(tmp_path / "log.npz"), "--memory-limit", wrong]) == 1
        assert "memory limit" in capsys.readouterr().err
