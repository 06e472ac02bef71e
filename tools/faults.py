"""Injects every fault into runs on the virtual robot, in real time, and measures how soon the robot is damped.

    python tools/faults.py --trials 50 --out results/deploy
    python tools/faults.py --stops --trials 50 --out results/deploy/stops

The second is of stops themselves, see `stop_trials`: `stops.csv` and `README.md`.

One line a trial in `faults.csv`, or `stops.csv`, with which it goes on where it was, killed or not; `faults.md` is the
table. Times are taken by the robot's own process: when it said something true last, and when the first damping frame
came. A fault of the network is to be borne: the run goes on for its 8 s. Each trial is a run of its own, with its own
standing up. Run it on an idle machine: how late an idle loop is stands beside every trial. A run that ended before its
fault came, as on a busy machine, is kept, counted apart, and made again.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import redirect_stderr, redirect_stdout
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from stiction.cli.main import main as deploy
from stiction.core.files import write_text
from stiction.core.provenance import git_revision
from stiction.deploy.runtime.ticker import QUIET
from stiction.virtual.faults import FAULTS, OF_ROBOT, OF_WAY

BUNDLE = "saturn_lite-flat-deception-0.2"

COLUMNS = ("fault", "trial", "rule", "joint", "status", "detected_ms", "bus_ms", "good_ms", "fault_ms", "probe_ms")
"""From the fault to its detection; from there to the bus; from the last good state, and from the fault, to the bus;
p99 of an idle loop's lateness."""


BUS, GOOD, KILLED = 20.0, 60.0, 100.0
"""Maximum delays to the bus [ms]: from detection, from the last good state, from SIGKILL."""

TRIES = 3
"""Number of attempts at a trial whose run ended before its fault, as on a machine that is too busy."""


def trial(fault: str, number: int, folder: Path) -> dict[str, object]:
    """Run once, by the program's own entry; return a row."""
    second = 0.3 + 0.02 * (number % 50)
    words = ["deploy", BUNDLE, "--robot", "virtual", "--armed", "--command", "vx=0.5", "--json", "--duration", "8"]
    words += ["--robot-seed", str(number), "--keep-minutes", "0", "--out", str(folder), "--fault", f"{fault}@{second}"]
    output, errors = io.StringIO(), io.StringIO()
    with redirect_stdout(output), redirect_stderr(errors):
        status = deploy(words)
    row: dict[str, object] = {"fault": fault, "trial": number, "status": status}
    try:
        report = json.loads(output.getvalue())
    except ValueError:
        return row | {"rule": f"{BEFORE} {errors.getvalue().strip()[:100]}"}
    stop, seen = report["stop"], report["virtual"]
    if stop is None:
        return row | {"rule": "none", "probe_ms": report["probe_ms"]["p99"]}
    row |= {"rule": stop["rule"], "joint": stop["joint"] or "", "probe_ms": report["probe_ms"]["p99"]}
    if fault not in report["faults"]:
        return row | {"rule": f"{BEFORE} {stop['rule']}"}
    if "damped" not in seen:
        return row
    at, bus = report["faults"][fault], seen["damped"]
    ends = {"detected_ms": (at, stop["time"]), "bus_ms": (stop["time"], bus), "fault_ms": (at, bus)}
    ends |= {"good_ms": (seen["last_good"], bus)} if fault in OF_ROBOT else {}
    return row | {name: round(1e3 * (end - begin), 3) for name, (begin, end) in ends.items()}


BEFORE = "before the fault:"
"""How the rule of a row begins whose run ended before the fault came; it is no trial of the fault."""


def whole_rows(file: Path) -> list[dict[str, str]]:
    """Return the rows of a table; what a kill left half written at its end is taken away."""
    if not file.exists():
        return []
    text = file.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        write_text(file, whole)
    return list(csv.DictReader(whole.splitlines()))


def csv_of(columns: Sequence[str], rows: list[dict[str, str]]) -> str:
    """Return a table with its header."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def numbers(rows: list[dict[str, str]], name: str) -> np.ndarray:
    """Return a column's numbers, without empty cells."""
    return np.array([float(row[name]) for row in rows if row[name]])


def spread(values: np.ndarray, most: float | None = None) -> str:
    """Return median and largest [ms], and how many are within a limit."""
    if not len(values):
        return ""
    within = "" if most is None else f", {int((values <= most).sum())} of {len(values)}"
    return f"{np.median(values):.1f} ({values.max():.1f}){within}"


def table(rows: list[dict[str, str]]) -> str:
    """Return the table, one row a fault, and what was asked for; busy trials are in it, and counted."""
    lines = [
        f"| fault | trials | damped | rules | detection to bus [ms], within {BUS:g} "
        f"| last good state to bus [ms], within {GOOD:g} | fault to bus [ms] | on a quiet machine | ended before |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    trials = [row for row in rows if not row["rule"].startswith(BEFORE)]
    for fault in dict.fromkeys(row["fault"] for row in rows):
        own = [row for row in trials if row["fault"] == fault]
        timed = [row for row in own if row["fault_ms"]]
        quiet = int((numbers(timed, "probe_ms") <= QUIET).sum())
        cells = [f"`{fault}`", len(own), len(timed), ", ".join(sorted({row["rule"] for row in own}))]
        cells += [spread(numbers(timed, "bus_ms"), BUS), spread(numbers(timed, "good_ms"), GOOD)]
        killed = KILLED if fault == "policy-kill" else None
        cells += [spread(numbers(timed, "fault_ms"), killed), quiet]
        cells.append(sum(row["fault"] == fault for row in rows) - len(own))
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(
        ["Median (largest), and how many of how many are within what is asked for.", "", *lines, "", asked(trials)]
    )


def asked(rows: list[dict[str, str]]) -> str:
    """Return, of all trials and of those on a quiet machine, how many are within what is asked for.

    A fault of the network is to be borne, and is counted apart.
    """
    lines, network = [], [row for row in rows if row["fault"] in OF_WAY]
    rows = [row for row in rows if row["fault"] not in OF_WAY]
    for name, own in (
        ("all trials", rows),
        ("trials on a quiet machine", [row for row in rows if row["probe_ms"] and float(row["probe_ms"]) <= QUIET]),
    ):
        timed = [row for row in own if row["fault_ms"]]
        killed = [row for row in timed if row["fault"] == "policy-kill"]
        parts = [f"damped {len(timed)} of {len(own)}"]
        for what, durations, most in (
            (f"within {BUS:g} ms of detection", numbers(timed, "bus_ms"), BUS),
            (f"within {GOOD:g} ms of the last good state", numbers(timed, "good_ms"), GOOD),
            (f"within {KILLED:g} ms of SIGKILL", numbers(killed, "fault_ms"), KILLED),
        ):
            parts.append(f"{what} {int((durations <= most).sum())} of {len(durations)}")
        lines.append(f"* {name}: {'; '.join(parts)}")
    if network:
        borne = sum(row["rule"] == "none" and row["status"] == "0" for row in network)
        lines.append(f"* of the network, where a run is to go on: it went on in {borne} of {len(network)}")
    return "\n".join(lines) + "\n"


def judge(rows: list[dict[str, str]]) -> str:
    """Return the table of stops, one row a situation, with the figures that are asked for."""
    outcomes = ("damped", "refused", "stiff", "before")
    lines = [
        f"| situation | trials | {' | '.join(outcomes)} | rules | event to damping [ms], median (largest) | within |"
    ]
    lines += ["|---" * 9 + "|"]
    for situation in dict.fromkeys(row["situation"] for row in rows):
        own = [row for row in rows if row["situation"] == situation]
        counts = [sum(row["outcome"] == name for row in own) for name in outcomes]
        rules = ", ".join(sorted({row["rule"] for row in own} - {""}))
        times = numbers(own, "event_to_damping_ms")
        asked_for = ASKED_OF_STOPS.get(situation)
        within = "" if asked_for is None else f"{int((times <= asked_for).sum())} of {len(own)} in {asked_for:g} ms"
        cells = [situation, len(own), *counts, rules, spread(times), within]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines)


ASKED_OF_STOPS = {"supervisor killed": 80.0, "supervisor halted": 80.0, "policy killed": 20.0}
"""Situation -> longest time from its event to the first damping frame at the robot that is asked for [ms]."""


def stops(trials: int, out: Path, situations: list[str], how: str) -> None:
    """Make the missing trials of stops in some situations, then write the table; how: `patient`, `realtime` or empty.

    A trial that ended before its event counts as missing.
    """
    import stop_trials as of

    begin, file = time.monotonic(), out / "stops.csv"
    patience = {"patient": of.PATIENT, "realtime": of.REALTIME}.get(how, ())
    rows = [row for row in whole_rows(file) if row["outcome"] != "before"]
    done = {(row["situation"], int(row["trial"])) for row in rows}
    wanted = [(name, number) for number in range(trials) for name in situations or of.SITUATIONS]
    missing = [each for each in wanted if each not in done]
    write_text(file, csv_of(of.COLUMNS, rows))
    with tempfile.TemporaryDirectory() as folder, file.open("a", newline="", encoding="utf-8") as table:
        writer = csv.DictWriter(table, of.COLUMNS, lineterminator="\n")
        bundles = of.prepare(Path(folder))
        # Forked: everything is imported once, and the bundles are checked once.
        with ProcessPoolExecutor(2, get_context("fork")) as pool:
            waiting = [pool.submit(of.trial, *each, bundles, 1 + n % 200, patience) for n, each in enumerate(missing)]
            for count, trial in enumerate(as_completed(waiting), 1):
                writer.writerow(trial.result())
                table.flush()
                print(f"{count} of {len(missing)}, {time.monotonic() - begin:.0f} s", file=sys.stderr)
    rows = sorted(whole_rows(file), key=lambda row: (of.SITUATIONS.index(row["situation"]), int(row["trial"])))
    write_text(file, csv_of(of.COLUMNS, rows))
    command = f"python tools/faults.py --stops --trials {trials}{f' --{how}' if how else ''}"
    command += f" --situations {' '.join(map(repr, situations))}" if situations else ""
    write_text(out / "README.md", PAGE.format(command=command, out=out, revision=git_revision(), table=judge(rows)))
    print(judge(rows))


PAGE = """# How runs are stopped

{table}

`{command} --out {out}`, revision `{revision}`; rows in [stops.csv](stops.csv).

* **Event to damping** is the time, on the machine's monotonic clock, from just before the event to when the robot's own
  process has read the first damping frame, for which it looks every 2 ms. The event: the signal is sent; the policy's
  or the supervisor's process is killed with SIGKILL; the supervisor is halted with SIGSTOP, for 200 ms; the second
  robot is about to send its first state (UDP) or to open the network (DDS).
* **Refused**: the run ended before any stiff command was sent. **Stiff**: the robot's last command was stiff.
  **Before**: the run ended before its event, three times over.
* The robot is a process that follows its commands, without physics. `policy killed`, `supervisor killed` and
  `supervisor halted` are runs of the shipped policy, which stands; all others play a motion that stands still. Signals
  come while the robot stands up. Two trials run at once.
* `stop with lost commands`: three of ten commands are lost, by a generator whose seed is the trial's number.
"""


def main() -> None:
    """Run the trials that are missing, then write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=50, help="trials of each fault")
    parser.add_argument("--faults", nargs="*", default=list(FAULTS), choices=list(FAULTS))
    parser.add_argument("--stops", action="store_true", help="trials of stops, in place of faults")
    parser.add_argument("--patient", action="store_true", help="of --stops: on a machine that does other work")
    parser.add_argument("--realtime", action="store_true", help="of --stops: runs and robots at real-time priority")
    parser.add_argument("--situations", nargs="*", default=[], help="of --stops: some alone")
    parser.add_argument("--out", type=Path, default=Path("results/deploy"), help="folder of faults.csv and faults.md")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    if args.stops:
        how = "patient" if args.patient else "realtime" if args.realtime else ""
        stops(args.trials, args.out, args.situations, how)
        return
    file = args.out / "faults.csv"
    rows = whole_rows(file)
    done = {(row["fault"], int(row["trial"])) for row in rows if not row["rule"].startswith(BEFORE)}
    missing = [(number, fault) for number in range(args.trials) for fault in args.faults if (fault, number) not in done]
    with file.open("a", newline="", encoding="utf-8") as out:
        writer = csv.DictWriter(out, COLUMNS)
        if not rows:
            writer.writeheader()
        begin = time.monotonic()
        for count, (number, fault) in enumerate(missing, 1):
            for _ in range(TRIES):
                with tempfile.TemporaryDirectory() as folder:
                    row = trial(fault, number, Path(folder) / "run")
                writer.writerow(row)
                out.flush()
                if not str(row["rule"]).startswith(BEFORE):
                    break
            each = (time.monotonic() - begin) / count
            left = each * (len(missing) - count) / 60
            print(f"{count} of {len(missing)} trials, {each:.1f} s each, {left:.0f} minutes left", file=sys.stderr)
    made = f"The last rows are of revision {git_revision()}, earlier ones as the README says."
    write_text(args.out / "faults.md", f"{made}\n\n{table(whole_rows(file))}")


if __name__ == "__main__":
    main()
