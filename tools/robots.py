"""Take robots that nobody here wrote through every verb, and write a table: what passed, and what refused what.

    STICTION_ROBOTS=wheels python tools/robots.py results/robots      # some three minutes a robot and core

STICTION_ROBOTS: a folder with their packages side by side, as `tests/robots/test_strangers.py` says. Each robot is
described in `tests/robots/described/`. A row is written as soon as it is known; rows that are there are not made again.
"""

from __future__ import annotations

import argparse
import csv
import os
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

DESCRIBED = Path(__file__).parents[1] / "tests" / "robots" / "described"

TINY = "--preset quick --num-envs 64 --teacher.iterations 10 --video-every 0 --method deception --friction-level 0.2"

VERBS = {
    "check": "robot check {description} --json",
    "doctor": "doctor --randomization --robot {description} --json",
    "train": "train --robot {description} --out run " + TINY,
    "export": "export run --out bundle",
    "verify": "verify bundle",
    "evaluate mujoco": "evaluate bundle --engines mujoco --friction-levels 0.2 --episodes 2 --seconds 4 --out m --json",
    "evaluate physx": "evaluate bundle --engines physx --friction-levels 0.2 --episodes 1 --seconds 4 --out p --json",
}
"""Column -> command."""


def last_line(text: str) -> str:
    """Return the last line that says something."""
    lines = [line for line in text.splitlines() if line.strip()]
    return lines[-1][:200] if lines else ""


def row_of(description: Path, wheels: Path) -> dict[str, str]:
    """Return the row of one robot."""
    row = {"robot": description.stem, "lines": str(len(description.read_text().splitlines()))}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for package in wheels.iterdir():
            (folder / package.name).symlink_to(package.resolve())
        (folder / description.name).write_text(description.read_text())
        for verb, words in VERBS.items():
            command = [sys.executable, "-m", "stiction", *shlex.split(words.format(description=description.name))]
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
            row[verb] = "passed" if done.returncode == 0 else last_line(done.stderr) or f"status {done.returncode}"
    return row


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("out", type=Path, help="folder for strangers.csv")
    out = parser.parse_args().out
    if "STICTION_ROBOTS" not in os.environ:
        parser.error("STICTION_ROBOTS is not set: the folder with the robots' packages")
    wheels = Path(os.environ["STICTION_ROBOTS"])
    out.mkdir(parents=True, exist_ok=True)
    table, columns = out / "strangers.csv", ["robot", "lines", *VERBS]
    rows = {row["robot"]: row for row in csv.DictReader(table.open())} if table.is_file() else {}
    for description in sorted(DESCRIBED.glob("*.yaml")):
        if description.stem not in rows:
            rows[description.stem] = row_of(description, wheels)
            with table.open("w", newline="") as file:
                writer = csv.DictWriter(file, columns)
                writer.writeheader()
                writer.writerows(rows[name] for name in sorted(rows))
            print(description.stem, {verb: rows[description.stem][verb][:60] for verb in VERBS}, flush=True)


if __name__ == "__main__":
    main()
