"""Kill what shares work, at random moments: a process of a training, a node of a cluster, the command that uses it.

    python tools/shared_kills.py --kills 20 --out results/attacks

Half of the kills hit one of the two processes of a training, at random: the other must end by itself within 30 s with
one line, the run goes on, and ends in the checkpoints of one that nobody disturbed. The others hit, in turn, a node of
a Ray cluster on this machine, which another one replaces, and the command that uses it, which is given again: its
tables must be those of an undisturbed one, so that nothing is lost and no row comes twice. Adds its rows to attacks.md
and attacks.json of the folder. Exit status 1 where something came of it that must not be.
"""

from __future__ import annotations

import argparse
import os
import random
import shlex
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from attacks import POLICY, SMALL, THREADS, digest, environment, found, row_of, write_table

LIMIT = 30.0
"""Maximum time for the rest of a training to end [s]."""

PATIENCE = 600.0
"""Maximum time of any step [s]."""

STUDY = f"study wear {POLICY} --robots 1000 1001 --seconds 14 --engine mujoco"
"""Work of the cluster: six walks."""


def free_port() -> int:
    """Return a port at which nobody listens."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        return listening.getsockname()[1]


def pair(out: Path, temporary: Path) -> list[subprocess.Popen]:
    """Start a training in two processes, as torchrun does, or let it go on where it has begun."""
    words = (
        ["--resume", str(out)] if (out / "config.json").exists() else shlex.split(f"--robot go1 {SMALL} --out {out}")
    )
    place = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(free_port()), "WORLD_SIZE": "2"}
    return [
        subprocess.Popen(
            [sys.executable, "-m", "stiction", "train", *words],
            env=environment(temporary) | place | {"RANK": str(rank), "LOCAL_RANK": str(rank)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        for rank in range(2)
    ]


def whole(processes: list[subprocess.Popen]) -> bool:
    """Wait for both processes; return whether both came to their ends."""
    for process in processes:
        process.communicate(timeout=PATIENCE)
    return all(process.returncode == 0 for process in processes)


def ranks(count: int) -> dict[str, Any]:
    """Kill one of two processes again and again, let the run go on, and compare with an undisturbed one."""
    pick, wrong, killed, rounds, slowest = random.Random("ranks"), [], 0, 0, 0.0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        begun = time.monotonic()
        if not whole(pair(folder / "whole", folder)):
            return found({}, ["ranks: the undisturbed training failed"], 0.0) | {"count": 0}
        took, reference = time.monotonic() - begun, digest(folder / "whole")
        while killed < count:
            out = folder / f"killed-{rounds}"
            processes = pair(out, folder)
            until = time.monotonic() + pick.uniform(0.1, 1.0) * took
            while time.monotonic() < until and all(process.poll() is None for process in processes):
                time.sleep(0.01)
            ran = all(process.poll() is None for process in processes)
            if ran:
                victim = pick.randrange(2)
                processes[victim].send_signal(signal.SIGKILL)
                end = time.monotonic()
                output = processes[1 - victim].communicate(timeout=PATIENCE)[1]
                slowest = max(slowest, time.monotonic() - end)
                lines = [line for line in output.splitlines() if line.startswith("stiction train:")]
                killed += 1
                if "Traceback" in output or len(lines) > 1:
                    wrong.append(f"ranks, kill {killed}: the other process said {output[-200:]!r}")
            ended = whole(processes)
            print(f"ranks: {killed} of {count} kills, {rounds} runs whole", file=sys.stderr)
            if not ran or killed == count:
                if ran:
                    ended = whole(pair(out, folder))
                if not ended:
                    wrong.append(f"ranks, after kill {killed}: a process that was left alone did not end with status 0")
                if digest(out) != reference:
                    wrong.append(f"ranks, after kill {killed}: other checkpoints than the undisturbed run")
                rounds += 1
    if slowest > LIMIT:
        wrong.append(f"ranks: the other process took {slowest:.1f} s to end")
    ends = {"kills": killed, "runs, each compared with one that nobody disturbed": rounds}
    return found(ends, wrong, slowest) | {"count": killed}


def command(address: str, out: Path, temporary: Path) -> subprocess.Popen:
    """Begin the study on a cluster, or let it go on."""
    words = [*shlex.split(STUDY), "--cluster", address, "--out", str(out)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([sys.executable, "-m", "stiction", *words], env=environment(temporary), **quiet)


def cluster(count: int) -> dict[str, dict[str, Any]]:
    """Kill a node and the command that uses it in turn; return the results of both attacks."""
    from ray.cluster_utils import Cluster

    small = {"object_store_memory": 80 * 2**20}
    victims = ("node", "command")
    pick, wrong, kills = random.Random("cluster"), {name: [] for name in victims}, dict.fromkeys(victims, 0)
    rounds = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        head = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False, **small})
        try:
            nodes = [head.add_node(num_cpus=1, **small) for _ in range(2)]
            begun = time.monotonic()
            if failure := _failure(command(head.address, folder / "whole", folder)):
                return {"node": found({}, [f"the undisturbed study failed: {failure}"], 0.0) | {"count": 0}}
            took, reference = time.monotonic() - begun, digest(folder / "whole")
            while sum(kills.values()) < count:
                victim = victims[sum(kills.values()) % 2]
                out = folder / f"killed-{rounds}"
                process = command(head.address, out, folder)
                until = time.monotonic() + pick.uniform(0.1, 1.0) * took
                while time.monotonic() < until and process.poll() is None:
                    time.sleep(0.01)
                if process.poll() is None and victim == "command":
                    process.send_signal(signal.SIGKILL)
                    process.communicate()
                    kills[victim] += 1
                    process = command(head.address, out, folder)
                elif process.poll() is None:
                    head.remove_node(nodes.pop(0), allow_graceful=False)
                    nodes.append(head.add_node(num_cpus=1, **small))
                    kills[victim] += 1
                if failure := _failure(process):
                    wrong[victim].append(f"{victim}, kill {kills[victim]}: {failure}")
                elif digest(out) != reference:
                    wrong[victim].append(f"{victim}, kill {kills[victim]}: other tables than the undisturbed study")
                rounds += 1
                print(f"cluster: {kills} of {count} kills, {rounds} studies", file=sys.stderr)
        finally:
            head.shutdown()
    return {
        name: found({"kills, each study compared with one that nobody disturbed": kills[name]}, wrong[name], 0.0)
        | {"count": kills[name]}
        for name in victims
    }


def _failure(process: subprocess.Popen) -> str:
    """Wait for a command; return the end of its error output if it failed, an empty string otherwise."""
    errors = process.communicate(timeout=PATIENCE)[1]
    return errors[-300:] if process.returncode else ""


def main() -> int:
    """Kill, print, write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=20, help="number of kills, half of them of a training's process")
    parser.add_argument("--ranks", action="store_true", help="only those of a training's process, all of the number")
    parser.add_argument("--out", type=Path, default=Path("attacks"), help="folder of the table")
    options = parser.parse_args()
    os.environ.update(dict.fromkeys(THREADS, "1") | {"RAY_USAGE_STATS_ENABLED": "0"})
    os.environ["PYTHONPATH"] = environment(Path(tempfile.gettempdir()))["PYTHONPATH"]
    from stiction.core.lock import output_folder
    from stiction.core.provenance import provenance

    of_ranks = options.kills if options.ranks else options.kills // 2
    parts = {"train in two processes, one of them killed, and resumed": ranks(of_ranks)}
    if not options.ranks:
        parts |= {
            f"study on a Ray cluster of two nodes on one machine, a {victim} killed": part
            for victim, part in cluster(options.kills - of_ranks).items()
        }
    with output_folder(options.out):
        rows = [row_of(attack, [part]) for attack, part in parts.items()]
        made = {"command": shlex.join(["python", "tools/shared_kills.py", *sys.argv[1:]]), **provenance()}
        table = write_table(options.out, rows, made)
    wrong = [text for row in rows for text in row["wrong"]]
    print("\n".join([table, *wrong]))
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
