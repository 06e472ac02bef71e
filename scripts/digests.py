"""Print a digest of each result that a move of code must not change: run it before and after, and compare.

    python scripts/digests.py > before.json        # some ten minutes of one core
    python scripts/digests.py training > after.json   # one part alone

Everything goes through the command line, so that it holds whatever the modules are called. Of what a command writes,
what says when and by which revision it was made is left out. Parts whose data is absent (STICTION_DATA) are null.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

MOVING = ("command", "revision", "created", "seconds", "minutes", "date", "time", "version", "provenance", "platform")
"""Words of fields, anywhere in their names, that differ from one run to the next."""

METHODS = ("none", "direct", "compensation", "finetune", "iterative", "deception")

LEGS = [f"{leg}_{joint}" for leg in ("FL", "FR", "RL", "RR") for joint in ("hip", "thigh", "calf")]

GO2 = {
    **{"kp": 20, "kd": 1.5, "test_condition": "in_air", "torque_limit": 23.7, "names": LEGS},
    "joints": {"calf": {"torque_limit": 45.43}},
}
"""What is known of the measured robot, see results/identification."""

EMPS = (
    "--columns time=t position=qm target=qg torque=vir --torque-scale 35.15065 --kp 1370750 --kd 8557.5 "
    "--velocity-delay 0.001 --axis linear --joint drive --torque-source motor_side --test-condition loaded"
)

SHORT = "--num-envs 32 --teacher.iterations 3 --video-every 0 --friction-level 0.2"


def stiction(words: str, folder: Path) -> str:
    """Run a command in a folder, on one thread; return what it printed."""
    threads = dict.fromkeys(("STICTION_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    command = [sys.executable, "-m", "stiction", *shlex.split(words)]
    done = subprocess.run(
        command, cwd=folder, env={**os.environ, **threads}, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"stiction {words}\n{done.stderr}")
    return done.stdout


def settled(value: object) -> object:
    """Return JSON without the fields that differ from run to run."""
    if isinstance(value, dict):
        return {k: settled(v) for k, v in value.items() if not any(word in k for word in MOVING)}
    return [settled(one) for one in value] if isinstance(value, list) else value


def digest(*contents: bytes) -> str:
    """Return the first digits of the SHA-256 of some contents."""
    return hashlib.sha256(b"\0".join(contents)).hexdigest()[:16]


def of_json(file: Path) -> str:
    """Return the digest of a JSON file."""
    return digest(json.dumps(settled(json.loads(file.read_text())), sort_keys=True).encode())


def evaluation(folder: Path) -> Iterator[tuple[str, str]]:
    """Drive the shipped policies in each engine, and on a virtual robot."""
    walks = "--friction-levels 0 0.2 --commands vx=0.5 vx=-0.5 --seconds 4 --jobs 1 --robots 1000"
    policies = [f"saturn_lite-flat-{method}-0.2" for method in ("none", "direct", "deception")]
    policies.append("saturn_lite-stairs-deception-0.2")
    cases = {"mujoco": " ".join(policies), **dict.fromkeys(("mujoco-alone", "physx", "ode", "mujoco-alone+all"), "")}
    for engine, names in cases.items():
        stiction(
            f"evaluate {names or policies[2]} {walks} --engines {engine} --episodes 1 --out evaluate-{engine}", folder
        )
        yield f"evaluate {engine}", digest((folder / f"evaluate-{engine}" / "results.csv").read_bytes())


def identification(folder: Path) -> Iterator[tuple[str, str | None]]:
    """Identify the measured records."""
    data = os.environ.get("STICTION_DATA")
    if data is None:
        yield from (("identify emps", None), ("identify go2", None))
        return
    (folder / "go2.json").write_text(json.dumps(GO2))
    records = {"emps": f"emps/DATA_EMPS.mat {EMPS}", "go2": f"go2/traj_0.pt --sidecar {folder / 'go2.json'}"}
    for name, words in records.items():
        stiction(f"identify {data}/{words} --out {name}", folder)
        yield f"identify {name}", of_json(folder / name / "joints.json")


def training(folder: Path) -> Iterator[tuple[str, str]]:
    """Train each method for a few iterations, in two phases and in one, and on stairs."""
    cases = {
        f"two-phase {method}": f"--preset two-phase --method {method} --student.iterations 2" for method in METHODS
    }
    cases |= {f"one-phase {method}": f"--preset quick --method {method}" for method in ("none", "deception")}
    cases["stairs"] = "--preset two-phase --method deception --terrain stairs --student.iterations 2"
    for name, words in cases.items():
        out = name.replace(" ", "-")
        stiction(f"train {words} {SHORT} --out {out}", folder)
        files = sorted((folder / out / "checkpoints").glob("*.safetensors"))
        yield f"train {name}", digest(*(file.read_bytes() for file in files))


def replication(folder: Path) -> Iterator[tuple[str, str]]:
    """Run the quick replication, and the conformance suite of the engines."""
    stiction("replicate --preset quick --jobs 1 --no-clips --out replication", folder)
    for file in sorted((folder / "replication").rglob("*.csv")):
        yield f"replicate {file.relative_to(folder / 'replication')}", digest(file.read_bytes())
    stiction("study engines --no-walks --jobs 1 --out engines", folder)
    yield "conformance", digest((folder / "engines" / "conformance.csv").read_bytes())


PARTS: dict[str, Callable[[Path], Iterator[tuple[str, str | None]]]] = {
    "evaluation": evaluation,
    "identification": identification,
    "training": training,
    "replication": replication,
}


def main() -> None:
    """Print the digests of the parts that are named, of all by default."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("parts", nargs="*", metavar="part", help=f"one or more of {', '.join(PARTS)}")
    parts = parser.parse_args().parts
    if odd := sorted(set(parts) - set(PARTS)):
        parser.error(f"unknown part {odd[0]!r}; known: {', '.join(PARTS)}")
    found: dict[str, str | None] = {}
    for part in parts or PARTS:
        with tempfile.TemporaryDirectory() as folder:
            for name, value in PARTS[part](Path(folder)):
                found[name] = value
                print(f"{name}: {value}", file=sys.stderr)
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
