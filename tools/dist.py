"""Build the source distribution and the wheel, and try the wheel as a stranger would: python tools/dist.py dist.

The wheel is built twice, from the checkout and from the source distribution, and both must hold the same. It is then
installed into three environments of their own, without extras, with `sim` and with `train`; in each README's blocks and
every verb run that this install promises. Beside it comes the wheel of the
experiments, which is tried in the last of them. Where uv is installed, `uvx` runs the wheel as well.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import venv
import zipfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[1]

MOST_SAID = 4000
"""Characters of the output of a command that failed."""

BUILD = "import sys; from setuptools import build_meta as build; print(getattr(build, sys.argv[1])(sys.argv[2]))"
"""Calls the build backend as an installer does, in the folder that it stands in."""


def built(kind: str, source: Path, out: Path) -> Path:
    """Build `sdist` or `wheel` of a source tree into a folder; return the file."""
    out.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-c", BUILD, f"build_{kind}", str(out.resolve())]
    done = subprocess.run(command, cwd=source, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{kind} of {source} could not be built:\n{done.stderr}")
    return out / done.stdout.splitlines()[-1]


def contents(wheel: Path) -> dict[str, int]:
    """Return path -> CRC of what a wheel holds, but for the list of it."""
    with zipfile.ZipFile(wheel) as file:
        return {entry.filename: entry.CRC for entry in file.infolist() if not entry.filename.endswith("/RECORD")}


def distributions(source: Path, out: Path) -> tuple[Path, Path]:
    """Build both of a source tree; return wheel and source distribution. Ends the process where they differ."""
    with tempfile.TemporaryDirectory() as scratch:
        copy = Path(scratch) / "source"
        ignored = shutil.ignore_patterns("__pycache__", "*.egg-info")
        shutil.copytree(source / "src", copy / "src", ignore=ignored)
        for name in ("pyproject.toml", "README.md", "LICENSE", "MANIFEST.in"):
            shutil.copy(source / name, copy)
        wheel, sdist = built("wheel", copy, out), built("sdist", copy, out)
        with tarfile.open(sdist) as packed:
            packed.extractall(scratch, filter="data")
        again = built("wheel", Path(scratch) / sdist.name.removesuffix(".tar.gz"), Path(scratch) / "again")
        if contents(wheel) != contents(again):
            both = set(contents(wheel)) ^ set(contents(again))
            raise SystemExit(f"the wheel of {sdist.name} differs from that of the checkout: {sorted(both)[:9]}")
    return wheel, sdist


def experiments(source: Path, out: Path) -> Path:
    """Build the wheel of the experiments; return the file."""
    with tempfile.TemporaryDirectory() as scratch:
        ignored = shutil.ignore_patterns("__pycache__", "*.egg-info", "build")
        return built(
            "wheel", Path(shutil.copytree(source / "experiments", Path(scratch) / "source", ignore=ignored)), out
        )


def run(words: Sequence[str | Path], folder: Path) -> None:
    """Run a command in a folder, as a user of this machine without settings of ours; end the process where it fails."""
    own = ("PYTHONPATH", "PYTHONSAFEPATH", "PYTHONDONTWRITEBYTECODE", "STICTION_DATA", "VIRTUAL_ENV")
    environment = {name: value for name, value in os.environ.items() if name not in own}
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        output = (done.stdout + done.stderr)[-MOST_SAID:]
        raise SystemExit(f"{shlex.join(map(str, words))}\nended with status {done.returncode}:\n{output}")


def promises() -> ModuleType:
    """Return the helper of tests that says what each install promises; it imports slow packages."""
    sys.path[:0] = [str(ROOT / "tests/helpers"), str(ROOT / "tools/shipped_robots")]
    import installs

    return installs


def try_install(wheel: Path, more: Path, extra: str, torch_flags: Sequence[str]) -> None:
    """Install a wheel into an environment of its own, and run there, in an empty folder, what that install promises.

    more: wheel of the experiments, installed beside `train`. The folder has the files of one's own that README names.
    Ends the process where a command fails.
    """
    begin, title = time.monotonic(), f"pip install stiction[{extra}]" if extra else "pip install stiction"
    with tempfile.TemporaryDirectory() as scratch:
        folder, programs = Path(scratch) / "empty", Path(scratch) / "environment" / "bin"
        folder.mkdir()
        venv.create(programs.parent, with_pip=True)
        install = [programs / "python", "-m", "pip", "install", "--quiet", "--no-compile"]
        if extra == "train":
            pinned = re.search(r"^torch==[\w.]+", (ROOT / "requirements.lock").read_text(), re.MULTILINE)
            assert pinned is not None
            run([*install, *torch_flags, pinned[0]], folder)
        further = [more.resolve()] if extra == "train" else []
        run([*install, f"stiction[{extra}] @ {wheel.resolve().as_uri()}", *further], folder)
        installed = time.monotonic()
        promises().make_files(folder)
        commands = promises().promised(extra)
        for program, *words in commands:
            run([programs / program, *words], folder)
    seconds = installed - begin, time.monotonic() - installed
    print(f"{title}: {seconds[0]:.0f} s, then {len(commands)} commands: {seconds[1]:.0f} s", flush=True)


def tried_by_uvx(wheel: Path) -> None:
    """Run a wheel as `uvx --from` does, where there is uv; ends the process where that fails."""
    program = shutil.which("uvx")
    if program is None:
        print("uvx is not installed: the wheel was not tried with it")
        return
    command = [program, "--quiet", "--python", sys.executable, "--from", f"{wheel.resolve()}[sim]", "stiction"]
    with tempfile.TemporaryDirectory() as scratch:
        subprocess.run([*command, "robot", "check", "saturn_lite"], cwd=scratch, check=True)


def main() -> None:
    """Build into the folder that is named, `dist` by default, and try what was built."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("out", nargs="?", type=Path, default=Path("dist"), help="folder for both files")
    parser.add_argument("--torch-flags", default="", help="options of pip where it installs torch, in one word")
    options = parser.parse_args()
    wheel, sdist = distributions(ROOT, options.out)
    more = experiments(ROOT, options.out)
    with ThreadPoolExecutor(2) as pool:  # the longest first
        tries = [
            pool.submit(try_install, wheel, more, extra, shlex.split(options.torch_flags))
            for extra in promises().INSTALLS[::-1]
        ]
        for one in tries:
            one.result()
    tried_by_uvx(wheel)
    print(f"{wheel}\n{sdist}\n{more}")


if __name__ == "__main__":
    main()
