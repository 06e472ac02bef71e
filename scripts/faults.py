"""Injects every fault into runs on the virtual robot, in real time, and measures how soon the robot is damped.

    python scripts/faults.py --trials 50 --out results/deploy

One line a trial in `faults.csv`, with which it goes on where it was; `faults.md` is the table. Times are taken by the
robot's own process: when it said something true last, and when the first damping frame came. Run it on an idle machine:
what an idle loop is late by stands beside every trial.
"""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from stiction.core.isolation import isolated_environment, python_module
from stiction.core.provenance import git_revision
from stiction.deploy.runtime.ticker import QUIET
from stiction.virtual.faults import FAULTS, OF_MACHINE, OF_ROBOT, POLICY

BUNDLE = "saturn_lite-flat-deception-0.2"

OTHERS = ("policy-kill", "policy-stop", "sigterm", "sigint", "stop-file", "second-writer")
"""Faults of the machine that one command can show."""

COLUMNS = ("fault", "trial", "rule", "joint", "status", "detected_ms", "bus_ms", "good_ms", "fault_ms", "probe_ms")
"""From the fault to its detection; from there to the bus; from the last good state, and from the fault, to the bus;
p99 of an idle loop's lateness."""


def trial(fault: str, number: int, folder: Path) -> dict[str, object]:
    """Run once; return a row."""
    second = 0.3 + 0.02 * (number % 50)
    words = ["deploy", BUNDLE, "--robot", "virtual", "--armed", "--command", "vx=0.5", "--json", "--duration", "20"]
    words += ["--robot-seed", str(number), "--keep-minutes", "0", "--out", str(folder), "--fault", f"{fault}@{second}"]
    done = subprocess.run(
        python_module("stiction", words), env=isolated_environment(), capture_output=True, text=True, check=False
    )
    row: dict[str, object] = {"fault": fault, "trial": number, "status": done.returncode}
    try:
        report = json.loads(done.stdout)
    except ValueError:
        return row | {"rule": done.stderr.strip()[:100]}
    stop, seen = report["stop"], report["virtual"]
    if stop is None:
        return row | {"rule": "none"}
    row |= {"rule": stop["rule"], "joint": stop["joint"] or "", "probe_ms": report["probe_ms"]["p99"]}
    if fault not in report["faults"] or "damped" not in seen:
        return row
    at, bus = report["faults"][fault], seen["damped"]
    ends = {"detected_ms": (at, stop["time"]), "bus_ms": (stop["time"], bus), "fault_ms": (at, bus)}
    ends |= {"good_ms": (seen["last_good"], bus)} if fault in OF_ROBOT else {}
    return row | {name: round(1e3 * (end - begin), 3) for name, (begin, end) in ends.items()}


def table(rows: list[dict[str, str]]) -> str:
    """Return the table, one row a fault; the largest times, of trials on a quiet machine where there were some."""
    lines = [
        "| fault | trials | damped | rules | detection to bus, largest | last good state to bus, largest "
        "| fault to bus, median (largest) | quiet trials |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for fault in dict.fromkeys(row["fault"] for row in rows):
        own = [row for row in rows if row["fault"] == fault]
        timed = [row for row in own if row["fault_ms"]]
        quiet = [row for row in timed if float(row["probe_ms"]) <= QUIET]
        shown = quiet or timed
        most = {
            name: max((float(row[name]) for row in shown if row[name]), default=None)
            for name in ("bus_ms", "good_ms", "fault_ms")
        }
        middle = np.median([float(row["fault_ms"]) for row in shown]) if shown else np.nan
        cells = [f"`{fault}`", len(own), len(timed), ", ".join(sorted({row["rule"] for row in own}))]
        cells += ["" if most[name] is None else f"{most[name]:.1f} ms" for name in ("bus_ms", "good_ms")]
        cells += [f"{middle:.1f} ms ({most['fault_ms'] or np.nan:.1f})", len(quiet)]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run the trials that are missing, then write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=50, help="trials of each fault")
    parser.add_argument("--faults", nargs="*", default=[*OF_ROBOT, *POLICY, *OTHERS], choices=list(FAULTS))
    parser.add_argument("--out", type=Path, default=Path("results/deploy"), help="folder of faults.csv and faults.md")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    file = args.out / "faults.csv"
    rows = list(csv.DictReader(file.open(encoding="utf-8"))) if file.exists() else []
    done = {(row["fault"], int(row["trial"])) for row in rows}
    with file.open("a", newline="", encoding="utf-8") as out:
        writer = csv.DictWriter(out, COLUMNS)
        if not rows:
            writer.writeheader()
        for number in range(args.trials):
            for fault in args.faults:
                if (fault, number) in done:
                    continue
                with tempfile.TemporaryDirectory() as folder:
                    writer.writerow(trial(fault, number, Path(folder) / "run"))
                out.flush()
            print(f"{number + 1} of {args.trials} trials of {len(args.faults)} faults", file=sys.stderr)
    rows = list(csv.DictReader(file.open(encoding="utf-8")))
    (args.out / "faults.md").write_text(f"Revision {git_revision()}.\n\n{table(rows)}", encoding="utf-8")


if __name__ == "__main__":
    main()
