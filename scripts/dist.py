"""Build the source distribution and the wheel, and try the wheel as a stranger would: python scripts/dist.py dist.

The wheel is built twice, from the checkout and from the source distribution, and both must hold the same. It is then
installed into an environment of its own, without extras and with `sim`, where the program is used; where uv is
installed, `uvx` runs it as well.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tarfile
import tempfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

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


def tried(wheel: Path) -> None:
    """Install a wheel into environments of its own and use it; ends the process where it fails."""
    with tempfile.TemporaryDirectory() as scratch:
        python = Path(scratch) / "bin" / "python"
        venv.create(scratch, with_pip=True)
        uses = ("", ["verify", "saturn_lite-flat-deception-0.2"]), ("[sim]", ["demo", "--episodes", "2"])
        for extra, arguments in uses:
            requirement = f"stiction{extra} @ {wheel.resolve().as_uri()}"
            subprocess.run([python, "-m", "pip", "install", "--quiet", requirement], check=True)
            subprocess.run([python.with_name("stiction"), *arguments], cwd=scratch, check=True)


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
    wheel, sdist = distributions(ROOT, parser.parse_args().out)
    tried(wheel)
    tried_by_uvx(wheel)
    print(f"{wheel}\n{sdist}")


if __name__ == "__main__":
    main()
