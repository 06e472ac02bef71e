"""Seeds, threads, revision and machine."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from stiction import __version__
from stiction.core import provenance as reproducibility
from stiction.core.errors import StictionError


def test_a_stream_depends_on_the_seed_and_its_own_name_alone() -> None:
    """Draws a stream from the seed and its name only, whatever other streams exist."""
    alone = reproducibility.seed_streams(3, ["noise"])["noise"].random(5)
    among = reproducibility.seed_streams(3, ["commands", "noise", "pushes"])["noise"].random(5)
    other_seed = reproducibility.seed_streams(4, ["noise"])["noise"].random(5)
    np.testing.assert_array_equal(alone, among)
    assert not np.any(alone == other_seed)


def test_a_stream_is_the_same_in_every_release() -> None:
    """Draws the same numbers in every release. `printf noise | sha256sum` gives efe2a5c09e6d49d7..., which is the key:
    eight little-endian 32-bit words.
    """
    key = (0xC0A5E2EF, 0xD7496D9E, 0x985C73EB, 0x0474F775, 0x7B885BBE, 0x7863F5B3, 0xD4688903, 0x9881FFE3)
    expected = np.random.Generator(np.random.PCG64(np.random.SeedSequence(3, spawn_key=key))).random(4)
    np.testing.assert_array_equal(reproducibility.seed_streams(3, ["noise"])["noise"].random(4), expected)


def test_wrong_seeds_and_names_are_refused() -> None:
    """Rejects invalid seeds, and a name used twice, which would draw the same numbers for two quantities."""
    with pytest.raises(StictionError, match="with one name: a; give each a different name"):
        reproducibility.seed_streams(0, ["a", "b", "a"])
    with pytest.raises(StictionError, match="seed: got -1"):
        reproducibility.seed_streams(-1, ["a"])


def test_number_of_threads_follows_the_variable_and_else_the_affinity(monkeypatch: pytest.MonkeyPatch) -> None:
    """Starts no more workers than the cores that the run may use, or than the variable says."""
    monkeypatch.setenv("STICTION_THREADS", " 3 ")
    assert reproducibility.num_threads() == 3
    monkeypatch.delenv("STICTION_THREADS")
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 4, 5, 6, 7}, raising=False)
    assert reproducibility.num_threads() == 5
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 12)
    assert reproducibility.num_threads() == 12


def test_library_pools_get_one_thread_unless_the_user_says_otherwise() -> None:
    """Gives library pools one thread each, unless the user sets another number."""
    code = (
        "import sys; from stiction.core.provenance import limit_library_threads as limit; limit(); import os; "
        "print('numpy' in sys.modules, os.environ['OMP_NUM_THREADS'], os.environ['OPENBLAS_NUM_THREADS'])"
    )
    clean = {name: value for name, value in os.environ.items() if name not in reproducibility.LIBRARY_POOLS}
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=clean | {"OPENBLAS_NUM_THREADS": "2"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["False", "1", "2"]


def _checkout(folder: Path) -> Path:
    """Make a repository that holds a copy of the module in a package; return the module's path."""
    module = folder / "src/stiction/files/reproducibility.py"
    module.parent.mkdir(parents=True)
    shutil.copy(reproducibility.__file__, module)
    _git(folder, "init", "-q")
    _git(folder, "add", ".")
    _git(folder, "commit", "-q", "-m", "first")
    return module


def _git(folder: Path, *arguments: str) -> str:
    """Run git in `folder` as somebody; return what it prints."""
    identity = ["-c", "user.name=test", "-c", "user.email=test@example.org"]
    done = subprocess.run(["git", "-C", str(folder), *identity, *arguments], capture_output=True, text=True, check=True)
    return done.stdout.strip()


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed, so there is no checkout to describe")
def test_revision_names_the_commit_and_whether_the_code_differs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Names the commit, and marks uncommitted code."""
    module = _checkout(tmp_path)
    monkeypatch.setattr(reproducibility, "__file__", str(module))
    monkeypatch.setattr(reproducibility, "PACKAGE", module.parents[1])
    commit = _git(tmp_path, "rev-parse", "HEAD")[:12]
    assert reproducibility.git_revision() == commit

    (tmp_path / "notes.txt").write_text("outside the package")
    assert reproducibility.git_revision() == commit

    (module.parents[1] / "new.py").write_text("inside the package")
    assert reproducibility.git_revision() == f"{commit}-dirty"


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed, so there is no repository to confuse")
def test_revision_of_an_installed_package_is_unknown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Reports no revision for a package inside the user's own repository."""
    _checkout(tmp_path)
    installed = tmp_path / "env/stiction/formats/reproducibility.py"
    installed.parent.mkdir(parents=True)
    shutil.copy(reproducibility.__file__, installed)
    monkeypatch.setattr(reproducibility, "__file__", str(installed))
    monkeypatch.setattr(reproducibility, "PACKAGE", installed.parents[1])
    assert reproducibility.git_revision() == "unknown"


def test_machine_names_processor_threads_and_versions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Records what a benchmark's numbers need for a comparison."""
    monkeypatch.setenv("STICTION_THREADS", "2")
    record = reproducibility.machine()
    assert record["threads"] == 2
    assert record["python"] == ".".join(str(part) for part in sys.version_info[:3])
    assert record["packages"]["numpy"] == np.__version__
    assert record["packages"]["stiction"] == __version__
    assert "pytest" not in record["packages"]
