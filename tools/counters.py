"""Count what the size and the weight of the house are: lines, modules, flags, import times, modules of a command.

    python tools/counters.py            # everything, some minute of a core
    python tools/counters.py lines      # one group: lines, words, tree, flags, times, modules

Counting: `code` are lines that are neither blank, comment nor docstring; a string that stands alone is a docstring.
Times are processor time (user and system) of a fresh process, the least of seven, less that of an empty one: other
work on the machine matters little. A module is `loaded` when it is in sys.modules at the end of the command, and
`visited` when a function of it was called in the command's own process; a room is a folder of the package.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/helpers"))

import corpus_logs as logs

from plain_words import TREES, violations

CHECKOUT = Path(__file__).resolve().parents[1]

TRACE = """
import runpy, sys
visited = set()
def profile(frame, event, argument):
    # Bodies of modules and classes are no visits: they have no optimised locals.
    if event == "call" and frame.f_code.co_flags & 1:
        visited.add(frame.f_globals.get("__name__", ""))
sys.argv = ["stiction", *sys.argv[1:]]
sys.setprofile(profile)
try:
    runpy.run_module("stiction", run_name="__main__")
except SystemExit as end:
    status = end.code
sys.setprofile(None)
def count(names):
    names = {name for name in names if name.startswith("stiction.")}
    return len(names), len({name.split(".")[1] for name in names})
print("COUNTED", status or 0, *count(sys.modules), *count(visited))
"""


def run(*words: str, folder: Path | None = None) -> str:
    """Run Python with some words, on one thread; return what it printed."""
    pools = ("STICTION_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    env = {**os.environ, **dict.fromkeys(pools, "1"), "COLUMNS": "80"}
    done = subprocess.run([sys.executable, *words], cwd=folder, env=env, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"python {' '.join(words)}: status {done.returncode}\n{done.stderr}")
    return done.stdout


def kinds(source: str) -> tuple[int, int, int]:
    """Return lines of a module: all, code, docstrings."""
    lines = source.splitlines()
    documented = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            documented |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    code = [n for n, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    return len(lines), len(set(code) - documented), len(documented)


def count_lines() -> None:
    """Print lines and modules of each folder of code."""
    for name in ("src/stiction", "experiments", "tests", "tools", "examples"):
        paths = sorted((CHECKOUT / name).rglob("*.py"))
        if paths:
            counted = [kinds(path.read_text()) for path in paths]
            total, code, documented = (sum(column) for column in zip(*counted, strict=True))
            print(
                f"{name}: {len(paths)} modules, {total} lines, {code} of code, {documented / total:.1%} docstrings, "
                f"longest module {max(one[0] for one in counted)}, {sum(one[0] < 40 for one in counted)} under 40 lines"
            )


def count_words() -> None:
    """Print the docstrings and variables of each folder of code that have to be read twice."""
    for name in TREES:
        counts = {rule: len(lines) for rule, lines in violations(CHECKOUT / name).items()}
        print(f"words to reread in {name}:", ", ".join(f"{count} {rule}" for rule, count in counts.items()))


def count_tree() -> None:
    """Print the size of the tracked files, and the largest outside the shipped policies."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=CHECKOUT, capture_output=True, text=True, check=True).stdout
    sizes = {name: (CHECKOUT / name).stat().st_size for name in listed.split("\0") if (CHECKOUT / name).is_file()}
    results = sum(size for name, size in sizes.items() if name.startswith(("results/", "experiments/")))
    largest = max((name for name in sizes if not name.startswith("src/stiction/policies/")), key=sizes.__getitem__)
    print(f"tree: {len(sizes)} files, {sum(sizes.values()) / 1e6:.1f} MB, of these {results / 1e6:.1f} MB of results")
    print(f"largest file outside the shipped policies: {sizes[largest] / 1e6:.2f} MB, {largest}")


def count_flags() -> None:
    """Print the flags of every verb, --help and its like not counted."""
    verbs = re.findall(r"^  ([a-z-]+)  ", run("-m", "stiction", "--help").partition("\nExamples")[0], re.M)
    counted = {}
    for verb in [*verbs, "identify walk"]:
        text = run("-m", "stiction", *verb.split(), "--help")
        if "--help-all" in text:
            text = run("-m", "stiction", *verb.split(), "--help-all")
        counted[verb] = len(set(re.findall(r"^  (--[a-z][\w.-]*)", text, re.M)) - {"--help", "--help-all"})
    print("flags:", ", ".join(f"{verb} {number}" for verb, number in counted.items()))


def count_times() -> None:
    """Print what importing the package and the overview cost."""

    def least(*words: str) -> float:
        costs = []
        for _ in range(7):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            run(*words)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            costs.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        return 1e3 * min(costs)

    empty = least("-c", "pass")
    print(f"times [ms of a core]: empty Python {empty:.0f}", end="")
    for name, words in {
        "import stiction": ("-c", "import stiction"),
        "stiction --help": ("-m", "stiction", "--help"),
        "stiction identify --help": ("-m", "stiction", "identify", "--help"),
        "stiction train --help": ("-m", "stiction", "train", "--help"),
    }.items():
        print(f", {name} +{least(*words) - empty:.0f}", end="", flush=True)
    print()


def count_modules() -> None:
    """Print how many modules of the package a command loads, and how many it visits."""
    bundle = "saturn_lite-flat-none-0.2"
    row = f"evaluate {bundle} --friction-levels 0.2 --commands vx=0.5 --episodes 1 --seconds 3 --jobs 1 --out row"
    commands = {
        "identify log.csv": f"identify log.csv {logs.FLAGS} --out identified",
        "a row of evaluate": row,
        "a row of evaluate, virtual robot": f"{row}-virtual --engines mujoco-alone+all --robots 1000",
        "verify": f"verify {bundle}",
        "--help": "--help",
    }
    with tempfile.TemporaryDirectory() as folder:
        logs.text(Path(folder) / "log.csv", logs.simulate(logs.Joint(), 1))
        for name, words in commands.items():
            printed = run("-c", TRACE, *words.split(), folder=Path(folder))
            _, status, loaded, rooms, visited, entered = printed[printed.rindex("COUNTED") :].split()[:6]
            print(
                f"modules of `{name}`: {loaded} loaded in {rooms} rooms, {visited} visited in {entered} rooms"
                + ("" if status == "0" else f" (status {status})")
            )


GROUPS = {
    "lines": count_lines,
    "words": count_words,
    "tree": count_tree,
    "flags": count_flags,
    "times": count_times,
    "modules": count_modules,
}


def main() -> None:
    """Print the groups that are named, all by default."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("groups", nargs="*", metavar="group", help=f"one or more of {', '.join(GROUPS)}")
    groups = parser.parse_args().groups
    if unknown := sorted(set(groups) - set(GROUPS)):
        parser.error(f"group: got {unknown[0]!r}, expected one of {', '.join(GROUPS)}")
    for group in groups or GROUPS:
        GROUPS[group]()
        sys.stdout.flush()


if __name__ == "__main__":
    main()
