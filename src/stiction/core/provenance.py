"""Seeds, numbers of threads, and the code and machine that a result records.

NumPy is imported where it is used, so that `limit_library_threads` can run before NumPy loads its linear algebra.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import platform
import re
import subprocess
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction.core.errors import ConfigurationError
from stiction.core.gemm import gemm_path

if TYPE_CHECKING:
    import numpy as np


THREADS_VARIABLE = "STICTION_THREADS"
"""Environment variable that overrides the number of worker threads."""

MOST_THREADS = 1024
"""Maximum number of threads and of processes: above the cores of the largest machine, and few enough to start."""

LIBRARY_POOLS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""Environment variables of the thread pools of numerical libraries; they are read when a library loads."""

IDLE_THREADS = ("OMP_WAIT_POLICY", "PASSIVE")
"""Variable and value that make torch's threads sleep between two operations, and leave the cores to others."""

PACKAGE = Path(__file__).resolve().parents[1]

GIT_TIMEOUT = 10.0
"""Timeout of git [s]: a checkout on a slow disk does not hold up a result."""


def _sequence(seed: int, name: str) -> np.random.SeedSequence:
    """Return the seed sequence of one named stream, which depends only on the seed and the name."""
    import numpy as np

    if not 0 <= seed < 2**63:
        raise ConfigurationError(f"seed: got {seed if seed < 0 else 'more'}, expected an integer from 0 to 2^63 - 1")
    # In a stated byte order, so that every machine draws the same numbers.
    words = np.frombuffer(hashlib.sha256(name.encode()).digest(), dtype="<u4")
    return np.random.SeedSequence(seed, spawn_key=tuple(int(word) for word in words))


def seed_streams(seed: int, names: Iterable[str]) -> dict[str, np.random.Generator]:
    """Return one independent generator per name, all from one seed.

    Raises `StictionError` for a negative seed, and for a repeated name, whose users would draw the same numbers.
    """
    import numpy as np

    names = list(names)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ConfigurationError(f"random streams with one name: {', '.join(twice)}; give each a different name")
    # By name, since the generator that `default_rng` takes may change with NumPy.
    return {name: np.random.Generator(np.random.PCG64(_sequence(seed, name))) for name in names}


def stream_seed(seed: int, name: str) -> int:
    """Return an integer in [0, 2**63) for libraries that take a number instead of a generator, such as torch."""
    import numpy as np

    return int(_sequence(seed, name).generate_state(1, np.uint64)[0] >> np.uint64(1))


def num_threads() -> int:
    """Return the number of worker threads: STICTION_THREADS, else the cores that this process may use.

    Raises `StictionError` where the variable is not a positive integer.
    """
    text = os.environ.get(THREADS_VARIABLE, "").strip()
    if not text:
        # macOS has no affinity: all cores there.
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not re.fullmatch(r"[0-9]{1,9}", text) or not 1 <= int(text) <= MOST_THREADS:
        raise ConfigurationError(
            f"{THREADS_VARIABLE} is {text[:20]!r}; expected a positive integer of at most {MOST_THREADS}, or unset it "
            "to use every core"
        )
    return int(text)


def limit_library_threads() -> None:
    """Set the pools of numerical libraries to one thread, in this process and its children.

    Only the simulator and torch gain from more, and they get `num_threads()` explicitly. A variable set by the user
    stays. It has no effect on a loaded library, so the command line calls it first.
    """
    for variable in LIBRARY_POOLS:
        os.environ.setdefault(variable, "1")
    os.environ.setdefault(*IDLE_THREADS)


@cache
def source_digest(*patterns: str) -> str:
    """Return the SHA-256 of the files that match `patterns` of `source_files`."""
    matches = {pattern: source_files(pattern) for pattern in patterns}
    if missing := [pattern for pattern, files in matches.items() if not files]:
        # A module that was renamed would otherwise silently drop out of what a cached result depends on.
        raise ValueError(f"{', '.join(missing)}: no such module in the package")
    files = sorted({file for files in matches.values() for file in files})
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def source_files(pattern: str) -> list[Path]:
    """Return the files of the package that match a pattern of paths below it, such as `sim/*.py`.

    A pattern of another package has its name in front: `stiction_experiments:wear/*.py`.
    """
    name, _, paths = pattern.rpartition(":")
    spec = importlib.util.find_spec(name) if name else None
    return list((Path(spec.origin).parent if spec and spec.origin else PACKAGE).glob(paths))


def fingerprint(*patterns: str) -> dict[str, Any]:
    """Return the code, by patterns of `source_digest`, and the packages that a cached result depends on."""
    return {"code": source_digest(*patterns), "packages": _package_versions()}


def git_revision(*packages: Path) -> str:
    """Return the short hash of the commit of this code, with `-dirty` where a package differs from it.

    packages: folders of packages besides `stiction`, such as the experiments. `unknown` without git, for an installed
    package, and for a package inside an unrelated repository.
    """
    here = Path(__file__).resolve()
    if _git("ls-files", "--error-unmatch", here.name, folder=here.parent) is None:
        return "unknown"
    commit = _git("rev-parse", "--short=12", "HEAD", folder=PACKAGE)
    changes = [_git("status", "--porcelain", "--", ".", folder=package) for package in (PACKAGE, *packages)]
    if not commit or None in changes:
        return "unknown"
    return f"{commit}-dirty" if any(changes) else commit


def _git(*arguments: str, folder: Path) -> str | None:
    command = ["git", "-C", str(folder), *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=GIT_TIMEOUT, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def machine() -> dict[str, Any]:
    """Return the machine of a result: processor, threads, matrix products, system, versions."""
    return {
        "cpu": _cpu_model(Path("/proc/cpuinfo")),
        "cores": os.cpu_count() or 1,
        "threads": num_threads(),
        "gemm": gemm_path(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "packages": _package_versions(),
    }


def provenance(*packages: Path) -> dict[str, Any]:
    """Return the code and machine that every summary records: `revision` and `machine`.

    packages: as of `git_revision`.
    """
    return {"revision": git_revision(*packages), "machine": machine()}


def _cpu_model(cpuinfo: Path) -> str:
    """Return the processor's name from Linux's `cpuinfo`, or the architecture where there is none."""
    try:
        match = re.search(r"^model name\s*:\s*(.+)$", cpuinfo.read_text(), re.MULTILINE)
    except OSError:
        match = None
    return match.group(1).strip() if match else platform.processor() or platform.machine()


@cache
def _package_versions() -> dict[str, str]:
    wanted = {"stiction"}
    for requirement in metadata.requires("stiction") or []:
        if "extra == 'dev'" not in requirement.replace('"', "'"):
            wanted |= set(re.findall(r"^[A-Za-z0-9._-]+", requirement))
    versions = {}
    for name in sorted(wanted):
        with suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    return versions


SOURCE = (".py", ".c", ".html")
"""Suffixes of code files."""


@dataclass(frozen=True)
class Origin:
    """Code and machine at the begin of a command: a commit may change them while it runs."""

    provenance: dict[str, Any]
    """`revision` and `machine`, for its summary."""
    code: tuple[str, ...]
    packages: tuple[Path, ...] = ()
    """Folders of packages besides `stiction`."""

    @classmethod
    def now(cls, *packages: Path) -> Origin:
        """Return revision and machine; call it before the work. packages: those of `git_revision`."""
        return cls(provenance(*packages), tuple(map(code_digest, (PACKAGE, *packages))), packages)

    def warnings(self) -> list[str]:
        """Return a warning where the code on disk has changed since the begin; call it after the work."""
        if tuple(map(code_digest, (PACKAGE, *self.packages))) == self.code:
            return []
        return [
            f"The code of stiction changed while this command ran, from revision {self.provenance['revision']} to "
            f"{git_revision(*self.packages)}; results may mix both: run the same command again."
        ]


def code_digest(package: Path) -> str:
    """Return the SHA-256 of the code in a folder, names of files included."""
    digest = hashlib.sha256()
    for folder, folders, names in os.walk(package):
        # In place: `os.walk` goes on in this order, and not in the file system's.
        folders.sort()
        for name in sorted(name for name in names if name.endswith(SOURCE)):
            file = Path(folder, name)
            digest.update(f"{os.path.relpath(file, package)}\0".encode() + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()
