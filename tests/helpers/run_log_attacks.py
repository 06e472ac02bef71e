"""Attacked logs of runs, and what else the folder of a loop holds: read in a process with little memory and time.

`python run_log_attacks.py FOLDER made` does those that have a name, each to a walk and to a played motion in turn, `...
both` to both of them, and `... random COUNT SEED` does some by chance. A JSON object on standard output says how many
were refused, how many taken, what must not happen, the slowest [s], and how much the memory grew [B]. What is taken has
rows of the run alone, each once, in their order, and says so where some in between are missing.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import shutil
import sys
import time
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from attacks import change_bytes, change_json
from bounded import bounded, peak_memory
from deployed import CONTRACT, JOINTS, STANDING
from stiction.cli.loop import friction_in, lateness, report_of
from stiction.cli.main import main as stiction
from stiction.core.errors import StictionError
from stiction.core.memory import limit_memory
from stiction.deploy.runtime.channel import row_layout, targets_layout
from stiction.deploy.runtime.recorder import MERGED, Parts
from stiction.files.joints import Estimate, JointRecord, JointsFile
from stiction.files.run_log import (
    HEADER,
    MOST_PARTS,
    READINGS,
    STEPS,
    RunLogHeader,
    find_run_log,
    is_walk_log,
    joint_log,
    part_name,
    read_run_log,
    walk_log,
    write_run_header,
)
from stiction.identification.example import SATURN_LITE, Excitation, example_log
from stiction.identification.logs.opening import open_log
from stiction.learning.actuator_data import read_run

LONGEST = 5.0
"""No log may take longer to be read [s]."""

MEMORY = 2**29
"""Memory limit of reading [B]; a table may take a quarter of it."""

HALVES, RATE, FEET = 8, 500, 6
"""Half seconds of the run, readings a second, feet."""

MOVED = 2
"""Joints that move in a played motion."""

RUN, OTHER = "0123456789abcdef", "fedcba9876543210"
"""Identifiers of two runs."""

HEADERS = {
    kind: RunLogHeader(
        robot="saturn_lite",
        joint_names=CONTRACT.joint_names,
        foot_names=tuple(f"foot_{n}" for n in range(FEET)),
        period=1 / RATE,
        control_period=0.02,
        kp=(20.0,) * JOINTS,
        kd=(0.5,) * JOINTS,
        torque_limit=CONTRACT.torque_limit,
        policy=policy,
        digest="0" * 64 if policy else "",
        armed=True,
        run=RUN,
    )
    for kind, policy in (("walk", "test"), ("motion", ""))
}
"""Kind of run -> its header."""

Change = Callable[[Path], object]
"""Does something to the folder of a log."""


def write_run(folder: Path, kind: str, run: str = RUN) -> None:
    """Write the log of a run as the logger does: a motor of known friction under a motion, the other joints still."""
    folder.mkdir(parents=True)
    write_run_header(folder, replace(HEADERS[kind], run=run))
    log = example_log(SATURN_LITE, Excitation(duration=HALVES / 2, rate=RATE))
    (moved,) = log.joints.values()
    assert moved.position is not None
    own = {"position": moved.position, "target": moved.target, "torque": moved.torque}
    own["velocity"] = np.gradient(moved.position, 1 / RATE)
    layouts = {READINGS: row_layout(JOINTS, FEET), STEPS: targets_layout(CONTRACT)}
    parts = {table: Parts(folder, table, layout, 10_000, run) for table, layout in layouts.items()}
    for number, stamp in enumerate(log.time):
        tilt = 0.01 * np.sin(3.0 * stamp)
        vectors: dict[str, Any] = {name: np.zeros(JOINTS) for name in own}
        vectors |= {"position": STANDING.copy(), "target": STANDING.copy(), "forward": np.zeros(JOINTS)}
        for name, values in own.items():
            vectors[name][:MOVED] += values[number]
        vectors |= {"stage": 2.0, "robot_time": stamp, "quaternion": [np.cos(tilt), np.sin(tilt), 0.0, 0.0]}
        vectors |= {"angular_velocity": np.zeros(3), "acceleration": [0.0, 0.0, 9.81]}
        vectors |= {"foot_contact": np.ones(FEET), "velocity_command": np.zeros(3)}
        _add(parts[READINGS], layouts[READINGS], 100.0 + stamp, vectors)
        if number % 10 == 0:
            _add(parts[STEPS], layouts[STEPS], 100.0 + stamp, {"mode": 1.0, "target": STANDING})
        if (number + 1) % (RATE // 2) == 0:
            for part in parts.values():
                part.flush()


def _add(part: Parts, layout: Any, at: float, vectors: dict[str, Any]) -> None:
    message = layout.unpack(layout.pack(1, at, vectors))
    part.add(at, message.values)


# Attacks by name


def part(number: int, table: str = READINGS) -> str:
    """Return the name of a half second's file."""
    return part_name(table, number, number)


def arrays_of(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of a part."""
    with np.load(path, allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def altered(number: int, change: Callable[[dict[str, np.ndarray]], object], table: str = READINGS) -> Change:
    """Return the attack that changes the arrays of a part, which is a whole file again."""

    def attack(folder: Path) -> None:
        arrays = arrays_of(folder / part(number, table))
        change(arrays)
        np.savez(folder / part(number, table), **arrays)  # type: ignore[arg-type]

    return attack


def everywhere(change: Callable[[dict[str, np.ndarray]], object]) -> Change:
    """Return the attack that changes the arrays of every part alike."""

    def attack(folder: Path) -> None:
        for number in range(HALVES):
            altered(number, change)(folder)

    return attack


def put(name: str, value: Callable[[np.ndarray], np.ndarray]) -> Callable[[dict[str, np.ndarray]], object]:
    """Return the change of one array."""
    return lambda arrays: arrays.update({name: value(arrays[name])})


def filled(value: float, at: int = 100) -> Callable[[np.ndarray], np.ndarray]:
    """Return an array with one row of a value."""

    def change(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[at] = value
        return values

    return change


def swapped(one: int, two: int) -> Change:
    """Return the attack that exchanges two parts."""

    def attack(folder: Path) -> None:
        first, second = folder / part(one), folder / part(two)
        first.rename(folder / "kept")
        second.rename(first)
        (folder / "kept").rename(second)

    return attack


def from_other_run(number: int, at: int | None = None) -> Change:
    """Return the attack that takes a part from another run of the same robot and policy."""

    def attack(folder: Path) -> None:
        other = folder.with_name("other")
        shutil.copy(other / part(number), folder / part(number if at is None else at))

    return attack


def rewritten(name: str, change: Callable[[bytes], bytes]) -> Change:
    """Return the attack that changes the bytes of a file."""
    return lambda folder: (folder / name).write_bytes(change((folder / name).read_bytes()))


def cut(name: str, share: float) -> Change:
    """Return the attack that loses the end of a file."""
    return rewritten(name, lambda data: data[: int(share * len(data))])


def flipped(name: str, share: float) -> Change:
    """Return the attack that turns one bit of a file."""

    def turn(data: bytes) -> bytes:
        place = int(share * len(data))
        return data[:place] + bytes([data[place] ^ 4]) + data[place + 1 :]

    return rewritten(name, turn)


def written(name: str, content: bytes) -> Change:
    """Return the attack that writes a file."""
    return lambda folder: (folder / name).write_bytes(content)


def header(**changes: Any) -> Change:
    """Return the attack that changes fields of the header."""
    return rewritten(HEADER, lambda data: json.dumps(json.loads(data) | changes).encode())


def header_text(old: str, new: str) -> Change:
    """Return the attack that changes the header's text."""

    def change(data: bytes) -> bytes:
        assert old.encode() in data
        return data.replace(old.encode(), new.encode(), 1)

    return rewritten(HEADER, change)


def npy(shape: str, descr: str = "'<f4'", data: bytes = bytes(64)) -> bytes:
    """Return an NPY file that says anything of itself."""
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data


def member(name: str, content: bytes, extra: int = 0) -> Change:
    """Return the attack that puts a file into a part in the place of an array, and more empty ones beside it."""

    def attack(folder: Path) -> None:
        path = folder / part(3)
        with zipfile.ZipFile(path) as archive:
            members = {entry: archive.read(entry) for entry in archive.namelist()}
        members[f"{name}.npy"] = content
        members |= {f"more{number}.npy": npy("(0,)", data=b"") for number in range(extra)}
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for entry, data in members.items():
                archive.writestr(entry, data)

    return attack


def bomb(folder: Path) -> None:
    """A part that says truly that it holds 400 MB of zeros."""
    with zipfile.ZipFile(folder / part(3), "w", zipfile.ZIP_DEFLATED) as archive, archive.open("time.npy", "w") as file:
        file.write(npy(f"({100 * 2**20},)", data=b""))
        for _ in range(400):
            file.write(bytes(2**20))


def objects(folder: Path) -> None:
    """A part with a pickle in it, which would make a file."""

    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return os.mkdir, (str(folder.with_name("trapped")),)

    arrays: dict[str, Any] = dict(arrays_of(folder / part(3)))
    arrays["position"] = np.array([Trap()], dtype=object)
    np.savez(folder / part(3), **arrays)


def many_parts(folder: Path) -> None:
    """Very many whole parts without a row in them."""
    arrays = {name: values[:0] for name, values in arrays_of(folder / part(3)).items() if values.ndim}
    np.savez(folder / part(3), **arrays)  # type: ignore[arg-type]
    for number in range(HALVES, MOST_PARTS):
        os.link(folder / part(3), folder / part(number))


def replaced(name: str, put: Callable[[Path], object]) -> Change:
    """Return the attack that puts something else in the place of a file."""

    def attack(folder: Path) -> None:
        (folder / name).unlink()
        put(folder / name)

    return attack


def duplicate(number: int, at: int) -> Change:
    """Return the attack that copies a part to another place."""
    return lambda folder: shutil.copy(folder / part(number), folder / part(at))


def without(number: int) -> Change:
    """Return the attack that loses a part."""
    return lambda folder: (folder / part(number)).unlink()


def renamed(number: int, first: int, last: int) -> Change:
    """Return the attack that gives a part a name that promises other half seconds."""
    return lambda folder: (folder / part(number)).rename(folder / part_name(READINGS, first, last))


IDENTIFIED = ("nothing", "middle missing", "name of control characters")
"""Attacks that leave a log to be taken, which is then identified too."""

REFUSED, TAKEN, NOTED = "refused", "taken", "noted"
"""Outcomes of an attack: refused in one line; read whole; the rest read, with a note on what is missing."""


def made() -> Iterator[tuple[str, Change, str]]:
    """Yield name, attack and what must come of it."""
    middle, names = part(3), list(CONTRACT.joint_names)
    yield "nothing", lambda folder: None, TAKEN
    yield "part cut", cut(middle, 0.5), REFUSED
    yield "part without its end", cut(middle, 0.999), REFUSED
    yield "part empty", written(middle, b""), REFUSED
    for share in (0.1, 0.5, 0.9):
        yield f"bit flipped at {share}", flipped(middle, share), REFUSED
    yield "parts swapped", swapped(2, 5), REFUSED
    yield "steps swapped", lambda folder: _swap_steps(folder), REFUSED
    yield "part doubled behind", duplicate(3, HALVES), REFUSED
    yield "part doubled over another", duplicate(3, 4), REFUSED
    yield "part of another run", from_other_run(3), REFUSED
    yield "part of another run behind", from_other_run(3, HALVES), REFUSED
    yield "header of another run", header(run=OTHER), REFUSED
    yield "header without a run", header(run=""), REFUSED
    yield "part that says no run", altered(3, lambda arrays: arrays.pop("run")), REFUSED
    yield "middle missing", without(3), NOTED
    yield "two missing", lambda folder: (without(3)(folder), without(5)(folder)), NOTED
    yield "last missing", without(HALVES - 1), TAKEN
    yield "ends before it begins", renamed(3, 5, 3), REFUSED
    yield "overlaps the one before", renamed(HALVES - 1, 3, HALVES - 1), REFUSED
    yield "part of the future", renamed(HALVES - 1, 999_999, 999_999), NOTED
    yield "stranger's file beside", written("notes.txt", b"x"), TAKEN
    yield "covered part left over", written(f"readings-00000{MERGED % 10}-x.npz", b"x"), TAKEN
    yield "zip bomb", bomb, REFUSED
    yield "huge shape", member("position", npy("(1000000000000000,)")), REFUSED
    yield "negative shape", member("position", npy("(-1,)")), REFUSED
    yield "shape that overflows", member("position", npy("(4294967296, 4294967296)")), REFUSED
    yield "shape of anything", member("position", npy("(" * 200 + ")" * 200)), REFUSED
    yield "many members", member("more", npy("(0,)", data=b""), 20_000), REFUSED
    yield "pickle", objects, REFUSED
    yield "text for numbers", altered(3, put("position", lambda v: v.astype("U9"))), REFUSED
    yield "complex numbers", altered(3, put("position", lambda v: v.astype(complex))), REFUSED
    yield "truth values", altered(3, put("position", lambda v: v > 0)), REFUSED
    for name in ("time", "robot_time", "position", "stage", "quaternion", "foot_contact"):
        yield f"{name} shorter", altered(3, put(name, lambda v: v[:-1])), REFUSED
        yield f"{name} missing everywhere", everywhere(lambda arrays, name=name: arrays.pop(name)), REFUSED
        yield f"{name} of more axes", everywhere(put(name, lambda v: v.reshape(*v.shape, 1, 1))), REFUSED
        yield f"{name} a number", everywhere(put(name, lambda v: v.ravel()[0])), REFUSED
        yield f"{name} wider", everywhere(put(name, lambda v: np.stack([v, v], axis=1))), REFUSED
    yield "one joint less", everywhere(put("torque", lambda v: v[:, :-1])), REFUSED
    yield "steps shorter", altered(3, put("target", lambda v: v[:-1]), STEPS), REFUSED
    yield "another array", altered(3, lambda arrays: arrays.update(x=np.zeros(RATE // 2))), REFUSED
    for value in (np.nan, np.inf, -np.inf, 1e300, 0.0):
        yield f"time {value}", altered(3, put("time", filled(value))), REFUSED
        yield f"robot's time {value}", altered(3, put("robot_time", filled(value))), REFUSED
    yield "times equal", everywhere(put("robot_time", np.zeros_like)), REFUSED
    yield "times backwards", everywhere(put("time", lambda v: v[::-1])), REFUSED
    yield "not many parts", lambda folder: [without(number)(folder) for number in range(HALVES)], REFUSED
    yield "very many parts", many_parts, REFUSED
    yield from _made_of_files(middle)
    yield from _made_of_header(names)


def _made_of_files(middle: str) -> Iterator[tuple[str, Change, str]]:
    for name in (middle, HEADER):
        yield f"{name} a pipe", replaced(name, os.mkfifo), REFUSED
        yield f"{name} a folder", replaced(name, Path.mkdir), REFUSED
        for target in ("/dev/zero", "nowhere", name):
            yield f"{name} a link to {target}", replaced(name, lambda path, to=target: path.symlink_to(to)), REFUSED


def _made_of_header(names: list[str]) -> Iterator[tuple[str, Change, str]]:
    """Yield headers that are none."""
    first = f'"{names[0]}"'
    yield "header cut", cut(HEADER, 0.5), REFUSED
    yield "header empty", written(HEADER, b""), REFUSED
    yield "header no text", written(HEADER, b"\xff\xfe"), REFUSED
    yield "header deep", written(HEADER, b"[" * 500_000), REFUSED
    yield "header deep in a field", header_text('"robot": ', '"robot": ' + "[" * 200_000 + '"x", "x": '), REFUSED
    yield "header large", written(HEADER, b'{"robot": "' + b"x" * 2**21 + b'"}'), REFUSED
    yield "key twice", header_text('"armed": ', '"armed": false, "armed": '), REFUSED
    yield "NaN", header_text('"period": ', '"period": NaN, "more": '), REFUSED
    yield "huge number", header_text('"period": ', f'"period": 1{"0" * 5000}, "more": '), REFUSED
    yield "same joint twice", header(joint_names=[names[0], *names[:-1]]), REFUSED
    yield "one name less", header(joint_names=names[:-1]), REFUSED
    yield "name of control characters", header_text(first, '"\\u001b[2J\\u202e\\r"'), TAKEN
    yield "name of half a character", header_text(first, '"\\ud800"'), REFUSED
    odd: dict[str, list[Any]] = {
        "period": [0, -1, "x", None, True, 1e308, 10**400],
        "kp": ["x", [], [20.0], ["x"] * JOINTS, [-1.0] * JOINTS, [10**400] * JOINTS],
        "walking_kp": ["x", [], [20.0], ["x"] * JOINTS, [0.0] * JOINTS, [10**400] * JOINTS],
        "torque_limit": [[0.0] * JOINTS, [-1.0] * JOINTS],
        "joint_names": ["x", [], [1] * JOINTS, [""] * JOINTS],
        "foot_names": ["x", [1]],
        "robot": [1, {}],
        "armed": ["x", 2],
        "torque_source": ["x"],
        "schema_version": [2, "1"],
        "more": [1],
    }
    for name, values in odd.items():
        for number, value in enumerate(values):
            yield f"header {name} {number}", header(**{name: value}), REFUSED


def _swap_steps(folder: Path) -> None:
    for before, after in ((2, 90), (5, 2), (90, 5)):
        (folder / part(before, STEPS)).rename(folder / part(after, STEPS))


# Attacks by chance


def by_chance(seed: int) -> tuple[str, Change]:
    """Return an attack, the same for the same seed, and what it does."""
    pick = random.Random(f"run log {seed}")
    how = pick.choice(("header", "header", "bytes", "bytes", "array", "array", "array", "files"))
    table, number = pick.choice((READINGS, READINGS, STEPS)), pick.randrange(HALVES)
    name = part(number, table)
    if how == "header":
        return how, rewritten(HEADER, lambda data: pick.choice((change_json, change_bytes))(data, pick))
    if how == "bytes":
        return f"{how} of {name}", rewritten(name, lambda data: change_bytes(data, pick))
    if how == "array":
        return f"{how} of {name}", altered(number, lambda arrays: _change_array(arrays, pick), table)
    other = pick.randrange(HALVES + 2)
    change = pick.choice((duplicate(number, other), without(number), renamed(number, other, pick.randrange(12))))
    return f"{how}: {number}, {other}", lambda folder: _tried(change, folder)


def _tried(change: Change, folder: Path) -> None:
    with contextlib.suppress(shutil.SameFileError):
        change(folder)


ODD = (np.nan, np.inf, -1.0, 0.0, 1e30, 1e300, 7.0)
"""Values that are written over some of an array."""


def _change_array(arrays: dict[str, np.ndarray], pick: random.Random) -> None:
    """Change one array in values, type, shape, order or name."""
    name = pick.choice(sorted(arrays))
    values = arrays[name]
    if name == "run" or pick.random() < 0.15:
        arrays[pick.choice((f"{name}_", "x", "header"))] = arrays.pop(name)
        return
    at = pick.randrange(len(values))
    changes: tuple[Callable[[np.ndarray], np.ndarray], ...] = (
        filled(pick.choice(ODD), at),
        lambda v: v[::-1],
        lambda v: v[:at],
        lambda v: np.concatenate([v, v]),
        lambda v: v.astype(pick.choice(("f2", "f8", ">f4", "i1", "u8", "?"))),
        lambda v: v.T,
        lambda v: np.roll(v, at, axis=0),
        lambda v: np.full_like(v, pick.choice(ODD)),
    )
    with np.errstate(all="ignore"):
        arrays[name] = pick.choice(changes)(values)


# What comes of an attack


def original(kind: str, folder: Path) -> np.ndarray:
    """Return time and position of every reading of a whole log, shape (T, 1 + J)."""
    log = read_run_log(folder / kind)
    return np.column_stack([log.readings["time"], log.readings["position"]])


def read_all(folder: Path) -> Any:
    """Read a log by every way; return it. Raises `StictionError`."""
    log = read_run_log(folder)
    assert find_run_log(folder) == folder
    walks = is_walk_log(folder)
    (walk_log if walks else lambda data: joint_log("log", data))(log)
    if not walks:
        open_log(folder)
    with contextlib.suppress(StictionError):  # An Actuator Net wants more: even stamps, say.
        read_run(folder)
    return log


def untrue(log: Any, rows: np.ndarray, edited: bool) -> str | None:
    """Return what is not true of a log that was taken, or None; rows: of the run; edited: they may be other numbers."""
    shapes = {name: len(values) for table in (log.readings,) for name, values in table.items()}
    if len(set(shapes.values())) != 1:
        return f"columns of several lengths: {shapes}"
    if edited:
        return None
    place = {row.tobytes(): number for number, row in enumerate(rows)}
    readings = np.column_stack([log.readings["time"], log.readings["position"]])
    numbers = [place.get(row.tobytes(), -1) for row in readings]
    if min(numbers, default=0) < 0 or (np.diff(numbers) <= 0).any():
        return "rows that are not of the run, or twice, or in another order"
    if (np.diff(numbers) != 1).any() and not any("are not there" in note for note in log.notes):
        return "rows are missing, and nothing is said"
    return None


def judge(folder: Path, rows: np.ndarray, edited: bool) -> tuple[str, str | None]:
    """Read a log; return what came of it, one of `REFUSED`, `TAKEN`, `NOTED`, and what must not happen, or None."""

    def read() -> Any:
        with limit_memory(MEMORY):
            return read_all(folder)

    log, fault = bounded(read, LONGEST)
    return (REFUSED, fault) if log is None else (NOTED if log.notes else TAKEN, untrue(log, rows, edited))


def identified(folder: Path, out: Path) -> str | None:
    """Identify an attacked log that was taken, as a user does; return what must not happen, or None."""
    output = io.StringIO()
    with contextlib.redirect_stderr(output), contextlib.redirect_stdout(output):
        status = stiction(["identify", str(folder), "--out", str(out)])
    shutil.rmtree(out, ignore_errors=True)
    last = output.getvalue().splitlines()[-1:]
    if status not in (0, 1) or "unforeseen" in output.getvalue() or "Traceback" in output.getvalue():
        return f"identify ended with status {status}: {last}"
    return None


def attack_loop(folder: Path, seed: int) -> str | None:
    """Change what one step of a loop leaves for the next, and read it; return what must not happen, or None."""
    pick = random.Random(f"loop {seed}")
    good = {"stop": None, "probe_ms": {"p99": 0.1}, "lateness_ms": {"p99": 0.1}, "end": "done"}
    JointsFile({"hip": JointRecord(coulomb_friction=Estimate(0.15, 0.02, (0.1, 0.2)))}).write(folder / "joints.json")
    (folder / "report.json").write_text(json.dumps(good, indent=1))
    for name, read in (
        ("report.json", lambda: lateness(report_of(folder))),
        ("joints.json", lambda: friction_in(folder / "joints.json")),
    ):
        text = (folder / name).read_bytes()
        (folder / name).write_bytes(pick.choice((change_json, change_json, change_bytes))(text, pick))
        try:
            read()
        except StictionError as error:
            if "\n" in str(error):
                return f"{name}: {error!r}"
        except Exception as error:
            return f"{name}: {type(error).__name__}: {error}: {(folder / name).read_bytes()[:300]!r}"
    return None


class Attacks:
    """Logs in a folder, and what came of the attacks on them."""

    def __init__(self, folder: Path) -> None:
        """Write a log of each kind, and one of another run."""
        self._folder, self._target = folder, folder / "attacked"
        for kind in HEADERS:
            write_run(folder / kind, kind)
        write_run(folder / "other", "walk", OTHER)
        self._rows = {kind: original(kind, folder) for kind in HEADERS}
        self.counts = {REFUSED: 0, TAKEN: 0, NOTED: 0}
        self.wrong: list[str] = []
        self.slowest = 0.0

    def attack(self, name: str, kind: str, change: Change, edited: bool) -> str:
        """Attack a copy of a log; return what came of it."""
        shutil.rmtree(self._target, ignore_errors=True)
        shutil.copytree(self._folder / kind, self._target)
        change(self._target)
        begun = time.perf_counter()
        came, fault = judge(self._target, self._rows[kind], edited)
        self.slowest = max(self.slowest, time.perf_counter() - begun)
        self.counts[came] += 1
        if (self._folder / "trapped").exists():
            fault = "a pickle was opened"
        if fault:
            self.wrong.append(f"{name} ({kind}): {fault}")
        return came

    def by_name(self, both: bool) -> None:
        """Do every attack that has a name, to both kinds of runs or to one in turn; identify some that were taken."""
        for number, (name, change, expected) in enumerate(made()):
            for kind in HEADERS if both or name in IDENTIFIED else [list(HEADERS)[number % 2]]:
                came = self.attack(name, kind, change, False)
                if came != expected:
                    self.wrong.append(f"{name} ({kind}): {came}, expected {expected}")
                elif name in IDENTIFIED and (fault := identified(self._target, self._folder / "out")):
                    self.wrong.append(f"{name} ({kind}): {fault}")

    def by_chance(self, count: int, seed: int) -> None:
        """Do attacks by chance; two in a hundred are identified, if they are taken."""
        for number in range(seed, seed + count):
            done, change = by_chance(number)
            kind = ("walk", "motion")[number % 2]
            came = self.attack(f"{number}, {done}", kind, change, done.startswith("array"))
            faults = [attack_loop(self._folder, number)]
            if came != REFUSED and number % 100 < 2:
                faults.append(identified(self._target, self._folder / "out"))
            self.wrong += [f"{number}, {done}: {fault}" for fault in faults if fault]


def main() -> None:
    """Run as a program, with an alarm and a bound on memory."""
    folder, how, *more = sys.argv[1:]
    attacks = Attacks(Path(folder))
    start = peak_memory()
    np.seterr(all="ignore")
    if how == "random":
        attacks.by_chance(*map(int, more))
    else:
        attacks.by_name(how == "both")
    growth = peak_memory() - start
    taken = attacks.counts[TAKEN] + attacks.counts[NOTED]
    summary = {"refused": attacks.counts[REFUSED], "taken": taken, "wrong": attacks.wrong}
    print(json.dumps(summary | {"slowest": attacks.slowest, "growth": growth}))


if __name__ == "__main__":
    main()
