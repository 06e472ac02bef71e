"""A stranger's clock, from an empty folder to the first answer: python tools/stranger.py --out results/first-contact.

The commands are those of the front page, and the files of one's own those that its test makes. With `--wheel` each task
begins with an environment of its own, into which the wheel is installed; without, with the package of `--python`.
Training is stopped when its first iteration is written. Times are wall-clock seconds; what else the machine did is in
the load average, of the minute before, and in the processor's seconds, which do not know of it. A task that is measured
again takes the place of its row in clock.csv.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tools/shipped_robots"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/helpers"))

from code_blocks import MADE, blocks_of
from stiction.core.provenance import git_revision, machine
from stiction.core.records import make_folder, read_rows, write_rows

README = Path(__file__).resolve().parents[1] / "README.md"

FIRST = Path("runs/mine/metrics.jsonl")
"""Has a line when the first iteration of the front page's training is done."""

PATIENCE = 1800.0
"""Longest that a command may take [s]."""


@dataclass(frozen=True)
class Task:
    """Task of a new user."""

    name: str
    heading: str
    """Heading of the front page above its commands; empty: the demo."""
    file: str = ""
    """Name of the user's own file."""
    extra: str = ""
    """Extra that is installed."""
    commands: int | None = None
    """Commands of the heading that are typed; None: all of them."""


TASKS = (
    Task("own log to verdict", "A log to a verdict", "swing.csv"),
    Task("demo", "", extra="[sim]"),
    Task("own ONNX to evaluated under friction", "Check my ONNX policy", "policy.onnx", "[sim]"),
    Task("own MJCF to first training iteration", "My own robot", "robot.yaml", "[train]", commands=2),
)


@dataclass(frozen=True)
class Row:
    """A row of clock.csv."""

    task: str
    commands: int
    """Typed, those that install included."""
    install: float | None
    """Environment and installation [s]; None: it was there."""
    seconds: float
    """Time from then to the answer [s]."""
    processor: float
    """Processor time of all its processes [s]."""
    load: float
    """Load average before it began: about as many processes wanted a core."""
    cores: int
    cpu: str
    revision: str


def commands(task: Task) -> list[list[str]]:
    """Return the commands of a task as the front page has them."""
    if not task.heading:
        return [["stiction", "demo"]]
    text = README.read_text(encoding="utf-8")
    begin = text[: text.index(f"\n## {task.heading}\n")].count("\n")
    end = begin + text.split(f"\n## {task.heading}\n")[1].partition("\n## ")[0].count("\n")
    blocks = [block for block in blocks_of(README) if begin < block.line <= end + 1 and block.language == "console"]
    return [words for block in blocks for words in block.commands][: task.commands]


def run(words: Sequence[str], folder: Path, until: Path | None) -> None:
    """Run a command in a folder to its end, or until a file has a line; end this process where it fails."""
    with (folder / "said.txt").open("w+") as output:
        process = subprocess.Popen(words, cwd=folder, stdout=output, stderr=subprocess.STDOUT)
        deadline = time.monotonic() + PATIENCE
        while process.poll() is None and time.monotonic() < deadline:
            if until is not None and until.is_file() and until.stat().st_size:
                process.terminate()
                process.wait()
                return
            time.sleep(0.1)
        if process.poll() != 0:
            process.kill()
            process.wait()
            output.seek(0)
            raise SystemExit(f"{' '.join(words)} failed:\n{output.read()}")


def measured(task: Task, python: Path, wheel: Path | None, revision: str) -> Row:
    """Do a task in an empty folder."""
    load, install, typed = os.getloadavg()[0], None, commands(task)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "empty"
        folder.mkdir()
        if task.file:
            MADE[task.file](folder / task.file)
        if wheel is not None:
            begin = time.monotonic()
            venv.create(Path(scratch) / "venv", with_pip=True)
            python = Path(scratch) / "venv" / "bin" / "python"
            requirement = f"stiction{task.extra} @ {wheel.resolve().as_uri()}"
            run([str(python), "-m", "pip", "install", "--quiet", requirement], folder, None)
            install = time.monotonic() - begin
        begin, used = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
        for words in typed:
            stop = folder / FIRST if words[1] == "train" else None
            run([str(python.with_name("stiction")), *words[1:]], folder, stop)
        seconds, now = time.monotonic() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime
    here, count = machine(), len(typed) + 2 * (wheel is not None)
    return Row(task.name, count, install, seconds, processor, load, here["cores"], here["cpu"], revision)


def main() -> None:
    """Do what is asked for and write clock.csv."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("stranger"), help="directory for clock.csv")
    parser.add_argument("--python", type=Path, default=Path(sys.executable), help="Python that has the package")
    parser.add_argument("--wheel", type=Path, help="install this wheel first, for each task anew")
    parser.add_argument("--tasks", nargs="+", metavar="WORD", default=[""], help="some: log, demo, ONNX, MJCF")
    cfg = parser.parse_args()
    make_folder(cfg.out)
    asked = [task for task in TASKS if any(word in task.name for word in cfg.tasks)]
    if not asked:
        raise SystemExit(f"no task is called {' '.join(cfg.tasks)}; expected log, demo, ONNX or MJCF")
    # Before its own table is written, which is in the repository.
    file, revision = cfg.out / "clock.csv", git_revision()
    rows = {row.task: row for row in read_rows(file, Row, optional=True)}
    for task in asked:
        rows[task.name] = measured(task, cfg.python, cfg.wheel, revision)
        print(rows[task.name], flush=True)
        write_rows(file, list(rows.values()), ".1f")


if __name__ == "__main__":
    main()
