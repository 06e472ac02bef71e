"""Attack the program, count what came of it, and write a table: damaged run folders, kills, and second writers.

    python scripts/attacks.py --folders 2000 --kills 100 --writers 50 --out results/attacks

Needs the tests beside it. Each part is left out where its count is 0. Exit status 1 where something must not be.
"""

from __future__ import annotations

import argparse
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
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "rma")]

POLICY = "saturn_lite-flat-deception-0.2"
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP)
LIMIT_SECONDS, LIMIT_BYTES, ORPHAN_SECONDS = 5.0, 2**30, 5.0

SMALL = "--num-envs 4 --preset two-phase --friction-level 0.1 --video-every 0 --checkpoint-every 2 "
SMALL += "--teacher.iterations 20 --teacher.steps 4 --teacher.mini-batches 2 "
SMALL += "--student.iterations 10 --student.steps 4 --student.mini-batches 2"
WALKS = f"{POLICY} --engines mujoco-alone --episodes 6 --seconds 4 --friction-levels 0 0.2 --commands vx=0.5"
VERBS = {
    "train": f"train --robot go1 {SMALL}",
    "evaluate": f"evaluate {WALKS} --jobs 2",
    "replicate": f"replicate --preset quick --parts standing --no-clips --jobs 2 --policies {POLICY}",
    "study": f"study wear {POLICY} --robots 1000 1001 --seconds 14 --jobs 2 --engine mujoco",
}
"""Verb -> the command that is killed, without its folder."""


def folders(count: int) -> dict[str, object]:
    """Open damaged run folders: resume the run, and load the student of a finished one."""
    import contextlib
    import io

    import test_attacked_runs as attacked

    from attacks import attack, copy_run
    from stiction.cli.main import main
    from stiction.core.errors import StictionError
    from stiction.rma.phase import Interrupted
    from stiction.rma.run import RunDirectory
    from stiction.rma.runner import load_student, train

    ends: Counter[str] = Counter()
    wrong: list[str] = []
    slowest = 0.0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        half = RunDirectory.create(folder / "half", attacked.CFG, "stiction train", None)
        asked: list[int] = []
        with contextlib.suppress(Interrupted):
            train(attacked.CFG, half, interrupted=lambda: asked.append(1) or len(asked) > 2)
        whole = RunDirectory(copy_run(half.path, folder / "whole"))
        train(attacked.CFG, whole)
        for seed in range(count):
            said = io.StringIO()
            resumed = seed % 2 == 0
            path = copy_run(half.path if resumed else whole.path, folder / "attacked")
            done = attack(path, seed)
            start = time.process_time()
            try:
                if resumed:
                    with contextlib.redirect_stderr(said):
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
            if "unforeseen" in said.getvalue():
                wrong.append(f"{seed} ({done}): {said.getvalue().splitlines()[-1][:200]}")
            slowest = max(slowest, time.process_time() - start)
            ends["refused" if status else "taken"] += 1
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    if slowest > LIMIT_SECONDS or most > LIMIT_BYTES:
        wrong.append("over the limits")
    return {
        "attack": "damaged run folders",
        "count": count,
        "result": f"{ends['refused']} refused in one line, {ends['taken']} taken, {len(wrong)} wrong; slowest "
        f"{slowest:.1f} s of processor time, {most / 2**20:.0f} MiB",
        "wrong": wrong,
    }


def children_of(pid: int) -> set[int]:
    """Return all descendants of a process."""
    parents: dict[int, list[int]] = {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        try:
            child, parent = int(file.parent.name), int(file.read_text().rpartition(")")[2].split()[1])
        except (OSError, IndexError):
            continue
        parents.setdefault(parent, []).append(child)
    found: set[int] = set()
    left = [pid]
    while left:
        new = parents.get(left.pop(), [])
        found |= set(new)
        left += new
    return found


def digest(folder: Path) -> str:
    """Return the digest of what must be the same bit by bit: checkpoints, and tables."""
    files = sorted((folder / "checkpoints").glob("*.safetensors")) or sorted(folder.rglob("*.csv"))
    return hashlib.sha256(b"".join(file.name.encode() + file.read_bytes() for file in files)).hexdigest()


def kill_verb(verb: str, count: int, folder: Path, pick: random.Random) -> dict[str, object]:
    """Kill one command again and again at random moments, let it go on, and compare with an undisturbed one."""
    from processes import is_alive

    temporary = folder / "temporary"
    temporary.mkdir(parents=True)
    threads = dict.fromkeys(("STICTION_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    path = os.pathsep.join(filter(None, (str(ROOT / "src"), os.environ.get("PYTHONPATH"))))
    environment = {**os.environ, **threads, "TMPDIR": str(temporary), "PYTHONPATH": path}

    def start(out: Path) -> subprocess.Popen:
        again = verb == "train" and (out / "config.json").exists()
        words = ["train", "--resume", str(out)] if again else [*shlex.split(VERBS[verb]), "--out", str(out)]
        quiet = subprocess.DEVNULL
        return subprocess.Popen([sys.executable, "-m", "stiction", *words], env=environment, stdout=quiet, stderr=quiet)

    begun = time.monotonic()
    wrong = [] if start(folder / "whole").wait() == 0 else [f"{verb}: the undisturbed command failed"]
    took = time.monotonic() - begun
    reference = digest(folder / "whole")
    out, slowest, killed, rounds = folder / "killed-0", 0.0, 0, 0
    while killed < count:
        process = start(out)
        time.sleep(pick.uniform(0.1, 1.0) * took)
        family = children_of(process.pid)
        if process.poll() is None:
            process.send_signal(SIGNALS[killed % len(SIGNALS)])
            killed += 1
            process.wait()
        end = time.monotonic()
        while any(map(is_alive, family)) and time.monotonic() - end < 4 * ORPHAN_SECONDS:
            time.sleep(0.02)
        slowest = max(slowest, time.monotonic() - end)
        time.sleep(0.2)
        if any(map(is_alive, family)) or time.monotonic() - end > 4 * ORPHAN_SECONDS:
            wrong.append(f"{verb}: orphans after kill {killed}")
        if left := list(temporary.iterdir()):
            wrong.append(f"{verb}: {left[0].name} stays in the temporary folder after kill {killed}")
        if process.returncode == 0 or killed == count:
            if process.returncode != 0 and start(out).wait() != 0:
                wrong.append(f"{verb}: it does not go on after kill {killed}")
            if digest(out) != reference:
                wrong.append(f"{verb}: {out.name} is another result than the undisturbed one")
            rounds += 1
            out = folder / f"killed-{rounds}"
    if slowest > ORPHAN_SECONDS:
        wrong.append(f"{verb}: a process outlived its parent by {slowest:.1f} s")
    return {
        "attack": f"{verb}, killed by SIGKILL, SIGTERM and SIGHUP in turn, and begun again",
        "count": count,
        "result": f"{rounds} results, {'bit-identical' if not wrong else 'WRONG'}; the last process was gone after at "
        f"most {slowest:.2f} s",
        "wrong": wrong,
    }


def writers(count: int) -> dict[str, object]:
    """Start commands into the folder of one that goes on."""
    refused = 0
    wrong: list[str] = []
    with tempfile.TemporaryDirectory() as name:
        run, walks = Path(name) / "run", Path(name) / "walks"
        long = SMALL.replace("--teacher.iterations 20", "--teacher.iterations 100000")
        commands = {
            run: [*shlex.split(f"train --robot go1 {long}"), "--out", str(run)],
            walks: [*shlex.split(WALKS.replace("--episodes 6", "--episodes 500")), "--jobs", "1", "--out", str(walks)],
        }
        commands[walks].insert(0, "evaluate")
        program = [sys.executable, "-m", "stiction"]
        environment = {**os.environ, "STICTION_THREADS": "1"}
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        holders = {
            folder: subprocess.Popen([*program, *words], env=environment, **quiet) for folder, words in commands.items()
        }
        while not all((folder / ".lock").exists() for folder in holders) or not (run / "metrics.jsonl").exists():
            time.sleep(0.1)
        second = {run: ["train", "--resume", str(run)], walks: commands[walks]}
        for number in range(count):
            folder = (run, walks)[number % 2]
            done = subprocess.run(
                [*program, *second[folder]], env=environment, capture_output=True, text=True, check=False
            )
            said = f"is being written by process {holders[folder].pid} on "
            if done.returncode == 1 and said in done.stderr and done.stderr.count("\n") == 1:
                refused += 1
            else:
                wrong.append(f"writer {number} into {folder.name}: status {done.returncode}, {done.stderr[-200:]!r}")
        for holder in holders.values():
            holder.kill()
            holder.wait()
    return {
        "attack": "a second writer (train --resume, evaluate)",
        "count": count,
        "result": f"{refused} of {count} refused, with the holder's number",
        "wrong": wrong,
    }


def main() -> int:
    """Attack, print, write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, text in (("folders", "damaged run folders"), ("kills", "kills, over four verbs"), ("writers", "writers")):
        parser.add_argument(f"--{name}", type=int, default=0, help=f"number of {text}")
    parser.add_argument("--verbs", nargs="+", choices=VERBS, default=list(VERBS), help="verbs that are killed")
    parser.add_argument("--out", type=Path, default=Path("attacks"), help="folder of attacks.json and attacks.md")
    options = parser.parse_args()
    parts: list[Callable[[], dict[str, object]]] = []
    if options.folders:
        parts.append(lambda: folders(options.folders))
    if options.writers:
        parts.append(lambda: writers(options.writers))
    rows = [part() for part in parts]
    with tempfile.TemporaryDirectory() as name:
        for verb in options.verbs if options.kills else []:
            each = options.kills // len(options.verbs)
            rows.append(kill_verb(verb, each, Path(name) / verb, random.Random(verb)))
            print(json.dumps(rows[-1]), flush=True)
    from stiction.core.provenance import provenance

    command = shlex.join(["python", "scripts/attacks.py", *sys.argv[1:]])
    options.out.mkdir(parents=True, exist_ok=True)
    file = options.out / "attacks.json"
    made = {"command": command, **provenance()}
    before = json.loads(file.read_text()) if file.exists() else []
    everything = [*before, *(row | made for row in rows)]
    file.write_text(json.dumps(everything, indent=1) + "\n")
    lines = ["# Attacks", "", "| attack | count | what came of it | command | revision |", "|---|---|---|---|---|"]
    lines += [
        f"| {row['attack']} | {row['count']} | {row['result']} | `{row['command']}` | {row['revision']} |"
        for row in everything
    ]
    (options.out / "attacks.md").write_text("\n".join(lines) + "\n")
    wrong = [text for row in rows for text in row["wrong"]]  # type: ignore[attr-defined]
    print("\n".join([*lines, *wrong]))
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
