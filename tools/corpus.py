"""Freeze what users get from the program, and show what a change does to it.

    python tools/corpus.py freeze --out DIR          # before the first step; every part takes some 6 minutes of a core
    python tools/corpus.py check DIR                 # after a step: a unified diff of every artefact that changed
    python tools/corpus.py check DIR --only help identify
    python tools/corpus.py check                     # no DIR: the digests in tools/corpus.sha256 alone

Each command of the corpus is run as a user types it, in a folder of its own, on one thread. Each thing that it prints
or writes is an artefact: text without times, paths, revisions and digests; of arrays, networks and checkpoints the
names, shapes and digests; of pages the visible text. Only the command line and `import stiction` are used, so the tool
works whatever the modules are called. Numbers are compared to the last bit: freeze and check on the same machine.
After a wanted change, freeze the part again, and commit tools/corpus.sha256 with the change.
"""

from __future__ import annotations

import argparse
import difflib
import hashlib
import html
import json
import os
import re
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

CHECKOUT = Path(__file__).resolve().parents[1]
DIGESTS = CHECKOUT / "tools" / "corpus.sha256"
LARGEST = 60_000
"""Characters of one artefact that are stored; the digest is of all of it."""

DROPPED = {
    *("command", "revision", "machine", "provenance", "created", "date", "platform", "packages", "threads"),
    *("rollout_seconds", "seconds", "minutes", "env_steps_per_second", "made_by", "code"),
}
"""JSON fields that differ between runs, revisions or machines."""

DRAWN = {".png", ".svg", ".webp", ".0"}
"""Suffixes of files of which only the name is kept: figures, clips, TensorBoard."""


WARM = """
import gc, json, os, runpy, signal, sys
answers = os.fdopen(os.dup(1), "w")
os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
sys.argv = ["stiction", sys.argv[1], "--help"]
try:
    runpy.run_module("stiction", run_name="__main__")
except SystemExit:
    pass
sys.stdout, sys.stderr = sys.__stdout__, sys.__stderr__
for number in (signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, signal.SIG_DFL)
for name in json.loads(os.environ["CORPUS_MODULES"]):
    __import__(name)
# A fork has no other thread, and waits for it for ever where it ends.
assert len(os.listdir("/proc/self/task")) == 1 if os.path.isdir("/proc") else True
# Memory that no child touches is shared with it.
gc.collect()
gc.freeze()
for line in sys.stdin:
    task = json.loads(line)
    child = os.fork()
    if child == 0:
        break
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), file=answers, flush=True)
else:
    os._exit(0)
os.chdir(task["folder"])
for number, name in ((0, os.devnull), (1, task["out"]), (2, task["err"])):
    os.dup2(os.open(name, os.O_RDWR | os.O_CREAT | os.O_TRUNC), number)
sys.path.insert(0, task["own"])
sys.argv = ["stiction", *task["words"]]
runpy.run_module("stiction", run_name="__main__")
"""
"""A process that has imported what others wrote, once for all commands, and runs each in a fork of itself: importing
NumPy, SciPy, matplotlib and torch anew costs more than most commands do."""

PLAIN = (
    "numpy",
    "scipy.signal",
    "scipy.optimize",
    "scipy.stats",
    "matplotlib.figure",
    "matplotlib.backends.backend_agg",
)
PLAIN += ("jinja2", "yaml", "rich.table", "rich.progress", "mujoco")
TORCH = (*PLAIN, "torch", "rsl_rl", "tensordict", "safetensors")
TRAINING = {"train", "train-actuator", "export", "study", "replicate"}
LEARNING = {"walks", "training", "ground", "studies"}
"""Verbs and parts that import torch."""


def normalised(text: str, folder: Path) -> str:
    """Return text without paths, dates, digests and revisions."""
    for path, name in ((folder, "$FOLDER"), (CHECKOUT, "$CHECKOUT"), (Path.home(), "$HOME")):
        text = text.replace(str(path), name)
    if data := os.environ.get("STICTION_DATA"):
        text = text.replace(data, "$DATA")
    text = re.sub(r"\b20\d\d-\d\d-\d\d(T[0-9:.+Z]+)?\b", "$DATE", text)
    digest = r"(?<![.\w])(?=[0-9]*[a-f])(?=[a-f]*[0-9])[0-9a-f]{12,128}\b(-dirty)?"
    text = re.sub(digest, "$DIGEST", text)
    text = re.sub(r"-----BEGIN [A-Z ]+-----.*?-----END [A-Z ]+-----", "$KEY", text, flags=re.S)
    text = re.sub(r" at 0x[0-9a-f]+", "", text)
    text = re.sub(r"events\.out\.tfevents\.[\w.]+", "events.out.tfevents", text)
    return "\n".join(line.rstrip() for line in text.splitlines()) + "\n"


def settled(value: Any) -> Any:
    """Return JSON without the fields that differ."""
    if isinstance(value, dict):
        return {key: settled(one) for key, one in value.items() if key not in DROPPED}
    return [settled(one) for one in value] if isinstance(value, list) else value


def shape(value: Any) -> Any:
    """Return JSON with the kind of each value in place of the value, one entry of each list."""
    if isinstance(value, dict):
        return {key: shape(one) for key, one in value.items()}
    if isinstance(value, list):
        return [shape(one) for one in value[:1]]
    return type(value).__name__


def lines_of(value: Any, indent: str = "") -> str:
    """Return JSON as text, lists of plain values on one line."""
    if isinstance(value, dict) and value:
        inner = [f"{indent} {json.dumps(key)}: {lines_of(one, indent + ' ')}" for key, one in value.items()]
        return "{\n" + ",\n".join(inner) + f"\n{indent}}}"
    if isinstance(value, list) and any(isinstance(one, dict | list) for one in value):
        return "[\n" + ",\n".join(f"{indent} {lines_of(one, indent + ' ')}" for one in value) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False)


def short(content: bytes) -> str:
    """Return the first digits of a SHA-256."""
    return hashlib.sha256(content).hexdigest()[:16]


def array(name: str, values: np.ndarray) -> str:
    """Return one line for an array."""
    return f"{name} {values.dtype} {list(values.shape)} {short(np.ascontiguousarray(values).tobytes())}"


def page(text: str) -> str:
    """Return the visible text of an HTML page, and how many figures it has."""
    figures = len(re.findall(r"<(?:img|svg)\b", text))
    text = re.sub(r"(?s)<(style|script|svg)\b.*?</\1>", "", text)
    text = re.sub(r"</(p|h\d|tr|li|div|figcaption|section|table)>", "\n", text)
    text = html.unescape(re.sub(r"<[^>]+>", " ", text))
    kept = [" ".join(line.split()) for line in text.splitlines()]
    return "\n".join([f"figures: {figures}", *(line for line in kept if line)])


def network(path: Path) -> str:
    """Return operators, inputs, outputs, metadata names and weights of an ONNX file."""
    import onnx
    from onnx import numpy_helper

    model = onnx.load(path)
    graph = model.graph
    lines = [f"{one.key}" for one in model.metadata_props]
    lines += [f"input {one.name}" for one in graph.input] + [f"output {one.name}" for one in graph.output]
    lines += [node.op_type for node in graph.node]
    lines += [array(one.name, numpy_helper.to_array(one)) for one in graph.initializer]
    return "\n".join(lines)


def checkpoint(path: Path) -> str:
    """Return names, shapes and digests of the tensors of a safetensors file."""
    content = path.read_bytes()
    size = int.from_bytes(content[:8], "little")
    header, data = json.loads(content[8 : 8 + size]), content[8 + size :]
    header.pop("__metadata__", None)
    lines = []
    for name, entry in sorted(header.items()):
        start, end = entry["data_offsets"]
        lines.append(f"{name} {entry['dtype']} {entry['shape']} {short(data[start:end])}")
    return "\n".join(lines)


def content_of(path: Path, moving: bool) -> str | None:
    """Return a file as text, None for figures; moving: its values differ from run to run, the layout does not."""
    keep = shape if moving else settled
    if path.suffix in DRAWN or ".tfevents" in path.name:
        return None
    if path.suffix == ".npz":
        with np.load(path) as file:
            arrays = [(name, file[name]) for name in sorted(file.files)]
        texts = [lines_of(keep(json.loads(str(values)))) for name, values in arrays if name == "header"]
        if moving:
            return "\n".join([*(f"{name} {values.dtype} {values.ndim}" for name, values in arrays), *texts])
        return "\n".join([*(array(name, values) for name, values in arrays if name != "header"), *texts])
    if path.suffix == ".onnx":
        return network(path)
    if path.suffix == ".safetensors":
        return checkpoint(path)
    try:
        text = path.read_text()
    except UnicodeDecodeError:
        return f"binary {short(path.read_bytes())}"
    if path.suffix == ".html":
        return page(text)
    if path.suffix == ".json":
        return lines_of(keep(json.loads(text)))
    if path.suffix == ".jsonl":
        return "\n".join(json.dumps(keep(json.loads(line))) for line in text.splitlines())
    return text


def environment() -> dict[str, str]:
    """Return the environment of a command: one thread, a terminal of 80 columns."""
    pools = ("STICTION_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    return {**os.environ, **dict.fromkeys(pools, "1"), "COLUMNS": "80"}


class Warm:
    """The process of `WARM`, started when it is first used."""

    def __init__(self, verb: str, modules: tuple[str, ...]) -> None:
        """Name the verb whose help is run first, for the settings that the program makes before it imports NumPy."""
        self.verb, self.modules = verb, modules
        self.process: subprocess.Popen[str] | None = None

    def run(self, folder: Path, own: Path, words: list[str]) -> subprocess.CompletedProcess[str]:
        """Run `stiction WORDS` in a folder."""
        if self.process is None:
            env = environment() | {"CORPUS_MODULES": json.dumps(self.modules)}
            command = [sys.executable, "-c", WARM, self.verb]
            self.process = subprocess.Popen(command, env=env, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self.process.stdin is not None and self.process.stdout is not None
        with tempfile.TemporaryDirectory(prefix="corpus-printed-") as printed:
            out, err = Path(printed) / "out", Path(printed) / "err"
            task = {"folder": str(folder), "own": str(own), "words": words, "out": str(out), "err": str(err)}
            self.process.stdin.write(json.dumps(task) + "\n")
            self.process.stdin.flush()
            status = self.process.stdout.readline()
            if not status:
                raise SystemExit(f"stiction {shlex.join(words)}: the process that runs commands ended")
            return subprocess.CompletedProcess(words, int(status), out.read_text(), err.read_text())

    def close(self) -> None:
        """End the process."""
        if self.process is not None and self.process.stdin is not None:
            self.process.stdin.close()
            self.process.wait()


class Corpus:
    """Artefacts of one part, made in a folder of its own."""

    def __init__(self, part: str, folder: Path) -> None:
        """Start a part."""
        self.part, self.folder = part, folder
        self.artefacts: dict[str, str] = {}
        self.warm = {False: Warm("identify", PLAIN), True: Warm("train", TORCH)}

    def add(self, name: str, text: str) -> None:
        """Store one artefact."""
        text = normalised(text, self.folder)
        if len(text) > LARGEST:
            text = f"{text[:LARGEST]}\n... sha256 of all: {short(text.encode())}\n"
        self.artefacts[f"{self.part}/{name}"] = text

    def file(self, name: str, path: Path, moving: bool = False) -> None:
        """Store one file, figures not."""
        text = content_of(path, moving)
        if text is not None:
            self.add(name, text)

    def run(self, name: str, words: str, cwd: str = ".", moving: bool = False, quiet: bool = False) -> int:
        """Run `stiction WORDS`; store what it prints, and every file in the folder or file behind --out.

        moving: store the layout alone. quiet: store nothing of it, raise where it fails: input of another command.
        """
        folder = self.folder / cwd
        folder.mkdir(parents=True, exist_ok=True)
        arguments = shlex.split(words)
        torch = self.part in LEARNING and arguments[0] in TRAINING
        done = self.warm[torch].run(folder, self.folder / "own", arguments)
        if quiet:
            if done.returncode:
                raise SystemExit(f"stiction {words}\n{done.stderr}")
            return 0
        out = folder / arguments[arguments.index("--out") + 1] if "--out" in arguments else None
        written = sorted(path for path in out.rglob("*") if path.is_file()) if out and out.is_dir() else []
        if out and out.is_file():
            written = [out]
        names = [str(path.relative_to(folder)) for path in written]
        for path, relative in zip(written, names, strict=True):
            self.file(f"{name}/{relative}", path, moving)
        text = f"$ stiction {words}\nstatus {done.returncode}\n"
        if moving:
            text += "files: " + " ".join(sorted({re.sub(r"\d+", "0", one) for one in names}))
        elif "--json" in arguments and done.returncode == 0:
            text += f"{lines_of(settled(json.loads(done.stdout)))}\n--- standard error\n{done.stderr}"
        else:
            text += f"{done.stdout}\n--- standard error\n{done.stderr}\n--- files\n" + "\n".join(names)
        self.add(f"{name}/printed", text)
        return done.returncode

    def script(self, source: str) -> subprocess.CompletedProcess[str]:
        """Run Python code in the folder of the part."""
        command = [sys.executable, "-c", source]
        return subprocess.run(command, cwd=self.folder, env=environment(), capture_output=True, text=True, check=False)


def main() -> int:
    """Freeze or check the corpus; return 1 where an artefact differs."""
    from corpus_parts import PARTS

    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    freeze = verbs.add_parser("freeze", help="make the corpus and store it")
    freeze.add_argument("--out", type=Path, required=True, help="folder of the corpus; parts in it are replaced")
    check = verbs.add_parser("check", help="make the corpus again and show what changed")
    check.add_argument("folder", type=Path, nargs="?", help="frozen corpus; without it, tools/corpus.sha256")
    for verb in (freeze, check):
        verb.add_argument("--only", nargs="+", choices=PARTS, metavar="PART", help=f"of {', '.join(PARTS)}")
    options = parser.parse_args()
    parts = options.only or [name for name, part in PARTS.items() if not part.long]
    changed = 0
    for name in parts:
        new = made(name, PARTS[name].make)
        if options.verb == "freeze":
            store(options.out, name, new)
        else:
            changed += compare(name, new, options.folder)
    if options.verb == "freeze":
        files = [path for name in parts for path in stored(options.out / name)]
        digests = {name: digest for name, digest in committed().items() if name.partition("/")[0] not in parts}
        digests |= {str(path.relative_to(options.out)): short(path.read_bytes()) for path in files}
        DIGESTS.write_text("".join(f"{digest}  {name}\n" for name, digest in sorted(digests.items())))
        print(f"{len(files)} artefacts; digests: {DIGESTS}")
    else:
        print(f"{changed} artefacts changed" if changed else "nothing changed")
    return int(changed > 0)


def made(name: str, make: Callable[[Corpus], None]) -> dict[str, str]:
    """Make the artefacts of one part; say what it cost."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory(prefix="corpus-") as folder:
        corpus = Corpus(name, Path(folder))
        make(corpus)
        for warm in corpus.warm.values():
            warm.close()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"{name}: {len(corpus.artefacts)} artefacts, {seconds:.0f} s of a core", file=sys.stderr, flush=True)
    return corpus.artefacts


def committed() -> dict[str, str]:
    """Return artefact -> digest, as tools/corpus.sha256 has them."""
    lines = DIGESTS.read_text().splitlines() if DIGESTS.exists() else []
    return {name: digest for digest, name in (line.split("  ", 1) for line in lines)}


def stored(folder: Path) -> list[Path]:
    """Return the files of a frozen corpus."""
    return sorted(path for path in folder.rglob("*") if path.is_file())


def store(folder: Path, part: str, artefacts: dict[str, str]) -> None:
    """Write the artefacts of a part in place of those that are there."""
    shutil.rmtree(folder / part, ignore_errors=True)
    for name, text in artefacts.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def compare(part: str, new: dict[str, str], folder: Path | None) -> int:
    """Print what differs from the frozen corpus; return how many artefacts do."""
    if folder is None:
        old = {name: digest for name, digest in committed().items() if name.startswith(f"{part}/")}
        fresh = {name: short(text.encode()) for name, text in new.items()}
    else:
        old = {str(path.relative_to(folder)): path.read_text() for path in stored(folder / part)}
        fresh = new
    different = [name for name in sorted({*old, *fresh}) if old.get(name) != fresh.get(name)]
    for name in different:
        state = "gone" if name not in fresh else "new" if name not in old else "changed"
        print(f"=== {name}: {state}")
        if folder is not None and state == "changed":
            before, after = old[name].splitlines(), fresh[name].splitlines()
            print("\n".join(difflib.unified_diff(before, after, "frozen", "now", lineterm="", n=1)))
    return len(different)


if __name__ == "__main__":
    sys.exit(main())
