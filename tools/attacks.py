"""Attack the program, count what came of it, and write a table.

    python tools/attacks.py --folders 2000 --kills 100 --writers 50 --bundles 1 --logs 10000 --run-logs 2000

Damaged run folders, kills, second writers, bundles that contradict themselves (times all of them), damaged logs, and
logs of `deploy` (those that have a name, and as many by chance as are asked for); a part whose count is 0 is left out,
so that each can run alone. What is done is kept in attacks.jsonl of the folder, a few attacks a line: the same command
goes on after whatever ended it, and begins anew where code or packages are others. Needs the tests beside it. Exit
status 1 where something came of it that must not be.
"""

from __future__ import annotations

import argparse
import getpass
import hashlib
import json
import os
import random
import resource
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / folder) for folder in ("helpers", "learning")]

POLICY = "saturn_lite-flat-deception-0.2"
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP)
THREADS = ("STICTION_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
LIMIT_SECONDS, LIMIT_BYTES, ORPHAN_SECONDS = 5.0, 2**30, 5.0

SHARED = {f"stiction-{os.getuid()}", f"torchinductor_{getpass.getuser()}"}
"""Folders of the temporary folder that are one a user: ours, and torch's, which is empty."""

SMALL = "--num-envs 4 --preset two-phase --friction-level 0.1 --video-every 0 --checkpoint-every 2 "
SMALL += "--teacher.iterations 20 --teacher.steps 4 --teacher.mini-batches 2 "
SMALL += "--student.iterations 10 --student.steps 4 --student.mini-batches 2"
WALKS = f"{POLICY} --engines mujoco-alone --episodes 6 --seconds 4 --friction-levels 0 0.2 --commands vx=0.5"
VERBS = {
    "train": f"train --robot go1 {SMALL}",
    "evaluate": f"evaluate {WALKS} --jobs 2",
    "study": f"study wear {POLICY} --robots 1000 1001 --seconds 14 --jobs 2 --engine mujoco",
}
"""Verb -> the command that is killed, without its folder."""


class Unit(NamedTuple):
    """Some attacks that are done together, and kept together."""

    attack: str
    """Description of the attack, for the table."""
    first: int
    """Number of the first."""
    count: int
    """Number of attacks."""
    do: Callable[[int, int], dict[str, Any]]
    """Called with both; returns `ends` (what came of how many), `wrong`, `slowest` [s] and `memory` [B]."""


def units(attack: str, count: int, each: int, do: Callable[[int, int], dict[str, Any]]) -> Iterator[Unit]:
    """Yield an attack in pieces."""
    for first in range(0, count, each):
        yield Unit(attack, first, min(each, count - first), do)


def found(ends: Counter[str] | dict[str, int], wrong: list[str], slowest: float, memory: int = 0) -> dict[str, Any]:
    """Return what a unit found."""
    return {"ends": dict(ends), "wrong": wrong, "slowest": slowest, "memory": memory}


@cache
def runs() -> tuple[Path, Path, tempfile.TemporaryDirectory]:
    """Return a run that is half done, a whole one, and the folder that they lie in."""
    import contextlib

    import test_attacked_runs as attacked

    from attacks import copy_run
    from stiction.learning.run import Interrupted, RunDirectory
    from stiction.learning.runner import train

    folder = tempfile.TemporaryDirectory()
    half = RunDirectory.create(Path(folder.name) / "half", attacked.CFG, "stiction train", None)
    asked: list[int] = []
    with contextlib.suppress(Interrupted):
        train(attacked.CFG, half, interrupted=lambda: asked.append(1) or len(asked) > 2)
    whole = RunDirectory(copy_run(half.path, Path(folder.name) / "whole"))
    train(attacked.CFG, whole)
    return half.path, whole.path, folder


def folders(first: int, count: int) -> dict[str, Any]:
    """Open damaged run folders: resume the run, and load the student of a finished one."""
    import contextlib
    import io

    from attacks import attack, copy_run
    from stiction.cli.main import main
    from stiction.core.errors import StictionError
    from stiction.learning.run import RunDirectory
    from stiction.learning.runner import load_student

    half, whole, folder = runs()
    ends: Counter[str] = Counter()
    wrong: list[str] = []
    slowest = 0.0
    for seed in range(first, first + count):
        errors = io.StringIO()
        resumed = seed % 2 == 0
        path = copy_run(half if resumed else whole, Path(folder.name) / "attacked")
        done = attack(path, seed)
        start = time.process_time()
        try:
            if resumed:
                with contextlib.redirect_stderr(errors):
                    status = main(["train", "--resume", str(path)])
            else:
                run = RunDirectory(path)
                run.check_finished("student")
                load_student(run)
                status = 0
        except StictionError:
            status = 1
        except Exception as error:
            wrong.append(f"{seed} ({done}): {type(error).__name__}: {str(error)[:100]}")
            continue
        if "unforeseen" in errors.getvalue():
            wrong.append(f"{seed} ({done}): {errors.getvalue().splitlines()[-1][:200]}")
        took = time.process_time() - start
        if took > LIMIT_SECONDS:
            wrong.append(f"{seed} ({done}): {took:.1f} s")
        slowest = max(slowest, took)
        ends["refused in one line" if status else "taken"] += 1
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    if most > LIMIT_BYTES:
        wrong.append(f"{most / 2**20:.0f} MiB")
    return found(ends, wrong, slowest, most)


def separately(program: str, *words: str) -> dict[str, Any]:
    """Return what one of the tests' programs, which bounds its own memory and time, says of what it has attacked."""
    path = os.pathsep.join([str(ROOT / "tests/helpers"), str(ROOT / "src"), *filter(None, sys.path)])
    threads = dict.fromkeys(THREADS, "1")
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, str(ROOT / "tests/helpers" / program), folder, *words],
            env=os.environ | threads | {"PYTHONPATH": path},
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode != 0:
        return found({}, [f"{program} {' '.join(words)}: {done.returncode} {done.stderr[-300:]}"], 0.0)
    summary = json.loads(done.stdout)
    taken = summary.get("taken", summary.get("accepted", []))
    taken, named = (taken, []) if isinstance(taken, int) else (len(taken), taken)
    wrong = [*summary["wrong"], *(f"accepted: {name}" for name in named if words[0] != "random")]
    return found(
        {"refused in one line": summary["refused"], "taken": taken}, wrong, summary["slowest"], summary["growth"]
    )


def children_of(pid: int) -> set[int]:
    """Return all descendants of a process."""
    parents: dict[int, list[int]] = {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        try:
            child, parent = int(file.parent.name), int(file.read_text().rpartition(")")[2].split()[1])
        except (OSError, IndexError):
            continue
        parents.setdefault(parent, []).append(child)
    descendants: set[int] = set()
    left = [pid]
    while left:
        new = parents.get(left.pop(), [])
        descendants |= set(new)
        left += new
    return descendants


def digest(folder: Path) -> str:
    """Return the digest of what must be the same bit by bit: checkpoints, and tables."""
    files = sorted((folder / "checkpoints").glob("*.safetensors")) or sorted(folder.rglob("*.csv"))
    return hashlib.sha256(b"".join(file.name.encode() + file.read_bytes() for file in files)).hexdigest()


def environment(temporary: Path) -> dict[str, str]:
    """Return the environment of a command: one thread, and temporary files where they can be seen."""
    path = os.pathsep.join(filter(None, (str(ROOT / "src"), os.environ.get("PYTHONPATH"))))
    return {**os.environ, **dict.fromkeys(THREADS, "1"), "TMPDIR": str(temporary), "PYTHONPATH": path}


def start(verb: str, out: Path, temporary: Path) -> subprocess.Popen:
    """Start a command, or let it go on where it has begun."""
    again = verb == "train" and (out / "config.json").exists()
    words = ["train", "--resume", str(out)] if again else [*shlex.split(VERBS[verb]), "--out", str(out)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen([sys.executable, "-m", "stiction", *words], env=environment(temporary), **quiet)


@cache
def undisturbed(verb: str) -> tuple[float, str | None]:
    """Return how long a command takes that nobody kills [s], and the digest of its result; None where it failed."""
    with tempfile.TemporaryDirectory() as name:
        begun = time.monotonic()
        status = start(verb, Path(name) / "whole", Path(name)).wait()
        return time.monotonic() - begun, None if status else digest(Path(name) / "whole")


def kill(process: subprocess.Popen, number: int, after: float) -> tuple[bool, float, bool]:
    """Kill a command; return whether it still ran, when the last of its processes was gone [s], and if one stays."""
    from processes import is_alive

    with_time = time.monotonic() + after
    while time.monotonic() < with_time and process.poll() is None:
        time.sleep(0.01)
    family = children_of(process.pid)
    ran = process.poll() is None
    if ran:
        process.send_signal(SIGNALS[number % len(SIGNALS)])
        process.wait()
    end = time.monotonic()
    while any(map(is_alive, family)) and time.monotonic() - end < 4 * ORPHAN_SECONDS:
        time.sleep(0.02)
    return ran, time.monotonic() - end, any(map(is_alive, family))


def kills(verb: str, first: int, count: int) -> dict[str, Any]:
    """Kill one command again and again at random moments, let it go on, and compare with an undisturbed one."""
    took, reference = undisturbed(verb)
    if reference is None:
        return found({}, [f"{verb}: the undisturbed command failed"], 0.0)
    pick = random.Random(f"{verb} {first}")
    wrong: list[str] = []
    slowest, killed, rounds = 0.0, 0, 0
    with tempfile.TemporaryDirectory() as name:
        temporary = Path(name) / "temporary"
        temporary.mkdir()
        while killed < count:
            out = Path(name) / f"killed-{rounds}"
            process = start(verb, out, temporary)
            ran, gone, stays = kill(process, first + killed, pick.uniform(0.1, 1.0) * took)
            killed += ran
            slowest = max(slowest, gone)
            what = f"{verb}, kill {first + killed}"
            wrong += [f"{what}: a process stays"] * stays
            time.sleep(0.2)
            if left := {path.name for path in temporary.iterdir()} - SHARED:
                wrong.append(f"{what}: {min(left)} stays in the temporary folder")
            if process.returncode == 0 or killed == count:
                if process.returncode != 0 and start(verb, out, temporary).wait() != 0:
                    wrong.append(f"{what}: it does not go on")
                elif digest(out) != reference:
                    wrong.append(f"{what}: another result than the undisturbed one")
                rounds += 1
    if slowest > ORPHAN_SECONDS:
        wrong.append(f"{verb}: a process outlived its parent by {slowest:.1f} s")
    return found({"kills": killed, "results, each compared with one that nobody disturbed": rounds}, wrong, slowest)


def writers(first: int, count: int) -> dict[str, Any]:
    """Start commands into the folder of one that goes on."""
    refused = 0
    wrong: list[str] = []
    with tempfile.TemporaryDirectory() as name:
        run, walks = Path(name) / "run", Path(name) / "walks"
        long = SMALL.replace("--teacher.iterations 20", "--teacher.iterations 100000")
        much = WALKS.replace("--episodes 6 --seconds 4", "--episodes 500 --seconds 60")
        walk = [*shlex.split(much), "--jobs", "1", "--out", str(walks)]
        commands = {
            run: [*shlex.split(f"train --robot go1 {long}"), "--out", str(run)],
            walks: ["evaluate", *walk],
        }
        program = [sys.executable, "-m", "stiction"]
        own = environment(Path(name))
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        holders = {path: subprocess.Popen([*program, *words], env=own, **quiet) for path, words in commands.items()}
        try:
            while not all((path / ".lock").exists() for path in holders) or not (run / "metrics.jsonl").exists():
                if gone := [path.name for path, holder in holders.items() if holder.poll() is not None]:
                    return found({}, [f"the first writer of {gone[0]} ended by itself"], 0.0)
                time.sleep(0.1)
            second = {run: ["train", "--resume", str(run)], walks: commands[walks]}
            for number in range(first, first + count):
                path = (run, walks)[number % 2]
                done = subprocess.run([*program, *second[path]], env=own, capture_output=True, text=True, check=False)
                refusal = f"is being written by process {holders[path].pid} on "
                if done.returncode == 1 and refusal in done.stderr and done.stderr.count("\n") == 1:
                    refused += 1
                else:
                    wrong.append(f"writer {number} into {path.name}: {done.returncode}, {done.stderr[-200:]!r}")
        finally:
            for holder in holders.values():
                holder.kill()
                holder.wait()
    return found({"refused, with the holder's number": refused}, wrong, 0.0)


def planned(options: argparse.Namespace) -> Iterator[Unit]:
    """Yield all that is asked for."""
    yield from units("damaged run folders", options.folders, 20, folders)
    yield from units("a second writer (train --resume, evaluate)", options.writers, 10, writers)
    for verb in options.verbs if options.kills else []:
        each = -(-options.kills // len(options.verbs))
        what = f"{verb}, killed by SIGKILL, SIGTERM and SIGHUP in turn, and begun again"
        yield from units(what, each, 5, lambda first, count, verb=verb: kills(verb, first, count))
    if options.bundles:
        import bundle_damage

        for group in bundle_damage.GROUPS:
            what = f"bundles that contradict themselves: {group}"
            yield Unit(what, 0, 1, lambda first, count, group=group: separately("helpers/bundle_damage.py", group))
        what = "bundles damaged by chance"
        rest = options.bundles * 150
        yield from units(
            what, rest, 50, lambda n, count: separately("helpers/bundle_damage.py", "random", str(count), str(n))
        )
    if options.logs:
        import damage

        for kind in damage.KINDS:
            each = -(-options.logs // len(damage.KINDS))
            do = lambda n, count, kind=kind: separately("damage.py", kind, str(count), str(n))  # noqa: E731
            yield from units(f"damaged logs: {kind}", each, 200, do)
    if options.run_logs:
        do = lambda n, count: separately("run_log_attacks.py", "both")  # noqa: E731
        yield Unit("logs of deploy: attacks by name, on a walk and a motion", 0, 1, do)
        do = lambda n, count: separately("run_log_attacks.py", "random", str(count), str(n))  # noqa: E731
        yield from units("logs of deploy and reports: attacks by chance", options.run_logs, 100, do)


def clock(seconds: float) -> str:
    """Return a time as people say it."""
    return f"{seconds / 3600:.1f} h" if seconds > 5400 else f"{seconds / 60:.1f} min"


def row_of(attack: str, parts: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the row of one attack from its units."""
    ends: Counter[str] = sum((Counter(part["ends"]) for part in parts), Counter())
    wrong = [text for part in parts for text in part["wrong"]]
    slowest, memory = (max(part[name] for part in parts) for name in ("slowest", "memory"))
    result = f"{', '.join(f'{count} {end}' for end, count in ends.items())}; {len(wrong)} wrong"
    result += f"; slowest {slowest:.2f} s" * (slowest > 0) + f"; {memory / 2**20:.0f} MiB" * (memory > 0)
    return {"attack": attack, "count": sum(part["count"] for part in parts), "result": result, "wrong": wrong}


def write_table(out: Path, rows: list[dict[str, Any]], made: dict[str, Any]) -> str:
    """Write attacks.json and attacks.md, in which rows of other attacks stay; return the table."""
    from stiction.core.files import write_text

    file = out / "attacks.json"
    new = {row["attack"] for row in rows}
    before = json.loads(file.read_text()) if file.exists() else []
    everything = [*(row for row in before if row["attack"] not in new), *(row | made for row in rows)]
    lines = ["# Attacks", "", "| attack | count | what came of it | command | revision |", "|---|---|---|---|---|"]
    lines += [
        f"| {row['attack']} | {row['count']} | {row['result']} | `{row['command']}` | {row['revision']} |"
        for row in everything
    ]
    write_text(file, json.dumps(everything, indent=1) + "\n")
    write_text(out / "attacks.md", "\n".join(lines) + "\n")
    return "\n".join(lines)


def main() -> int:
    """Attack, print, write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    counts = {"folders": "damaged run folders", "kills": "kills, over the verbs", "writers": "second writers"}
    counts |= {"bundles": "times all bundles that contradict themselves", "logs": "damaged logs, over all kinds"}
    counts |= {"run-logs": "attacked logs of deploy"}
    for name, text in counts.items():
        parser.add_argument(f"--{name}", type=int, default=0, help=f"number of {text}")
    parser.add_argument("--verbs", nargs="+", choices=VERBS, default=list(VERBS), help="verbs that are killed")
    parser.add_argument("--out", type=Path, default=Path("attacks"), help="folder of the table, and of what is done")
    options = parser.parse_args()
    os.environ.update(dict.fromkeys(THREADS, "1"))
    from stiction.core.cache import Ledger, key_of
    from stiction.core.lock import output_folder
    from stiction.core.provenance import provenance

    command = shlex.join(["python", "tools/attacks.py", *sys.argv[1:]])
    with output_folder(options.out):
        made = {"command": command, **provenance()}
        ledger = Ledger(options.out / "attacks.jsonl")
        code = key_of("attacks", "**/*.py")
        todo, parts, spent, done = list(planned(options)), {}, 0.0, 0
        missing = [unit for unit in todo if ledger.get(key_of([unit[:3], code])) is None]
        for unit in todo:
            key = key_of([unit[:3], code])
            if (entry := ledger.get(key)) is None:
                begun = time.monotonic()
                entry = {"key": key, "count": unit.count, **unit.do(unit.first, unit.count)}
                ledger.extend([entry])
                spent, done = spent + time.monotonic() - begun, done + 1
                left = [other for other in missing[done:] if other.attack == unit.attack]
                each = (time.monotonic() - begun) / unit.count
                now = f"{unit.attack}: {unit.first + unit.count} done, {each:.2f} s each"
                rest = clock(each * sum(other.count for other in left))
                print(f"{now}, {rest} left of it; {len(missing) - done} units left in all", file=sys.stderr)
            parts.setdefault(unit.attack, []).append(entry)
        rows = [row_of(attack, list(some)) for attack, some in parts.items()]
        table = write_table(options.out, rows, made) if rows else "nothing to do"
    wrong = [text for row in rows for text in row["wrong"]]
    print("\n".join([table, *wrong]))
    print(f"{clock(spent)} spent now", file=sys.stderr)
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
