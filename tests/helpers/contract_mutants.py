"""Mutants of every field of a contract, however deep, and the fields in which a mutant may pass.

Each field is mutated at two of its places: the first, and one chosen by the field's name. Numbers change sign, become
zero, ten times as large, 0.3 more or less, NaN, infinite, text and null; lists lose, repeat, swap, turn and scale
entries; objects lose, repeat and swap fields; words become other words that are allowed somewhere.
"""

from __future__ import annotations

import io
import json
import math
import re
import tempfile
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import bundle_damage
from bundles import make_contract, make_network
from counts import count
from stiction.core.errors import StictionError
from stiction.deploy.check import check_bundle, check_robot
from stiction.deploy.policy import load_policy
from stiction.evaluation.golden import record_golden
from stiction.files.bundle import CARD, CONTRACT, GOLDEN, POLICY, SUMS, shipped_bundles
from stiction.files.contract import read_contract
from stiction.files.contract_rules import COMMAND_CORRECTION, TARGET_LIMITS, TERRAINS
from stiction.files.contract_training import OWN
from stiction.files.golden import BOUND, Golden
from stiction.files.observation import FRAMES, TERM_NAMES, proprioception
from stiction.joints.friction import simulated_laws
from stiction.robots.catalog import find_robot

SHIPPED = "saturn_lite-flat-deception-0.2"

FREE = {
    "seed": "names a training among others; no runtime reads it",
    "revision": "text: the code that trained",
    "command": "text: the command line that trained",
    "joints_file": "name and digest of a file that is not in the bundle",
    "actuator": "name and digest of a file that is not in the bundle; no runtime reads it",
    "target_limits": "null in an older bundle; a margin that is wider keeps targets closer; further ones are refused",
    "settings": "settings of the training that no other field repeats; null in a bundle from before they were recorded",
    "observation.terms.1.clip": "roll and pitch: no angle exceeds pi, so all bounds above it are one",
    "anatomy.*.shapes.*.color": "drawn, and nothing else",
}
"""Field in which, or in a part of which, a mutant may pass -> reason. `*` stands for names and indices."""

WORDS: dict[str, tuple[Any, ...]] = {
    "terrain": TERRAINS,
    "method": OWN,
    "friction_law": simulated_laws(),
    "direction": ("newest_first", "oldest_first"),
    "layout": ("frame_major", "term_major"),
    "fill": ("first", "zero"),
    "frame": tuple(sorted(set(FRAMES.values()))),
    "offset": ("none", "standing"),
    "contact": ("ground", "obstacles", "nothing"),
    "kind": ("sphere", "capsule", "cylinder", "box", "hip", "thigh"),
    "robot": ("go1", "go2", "saturn_lite", "my_robot"),
}
"""Field -> words that it could hold."""

FILE = {"name": "other.json", "sha256": "1" * 64}

PLAUSIBLE: dict[str, tuple[Any, ...]] = {
    "joints_file": (FILE,),
    "actuator": (FILE,),
    "imported": (FILE,),
    "known_friction_file": (FILE,),
    "known_friction": ({"hip": 0.1, "thigh": 0.1, "shank": 0.1}, {"hip": 0.1, "thigh": 0.1, "calf": 0.1}),
    "torque_source": ("motor_side", "output_side"),
    "stribeck": ([1.5, 0.1],),
    "friction_load": ([0.0, 0.1],),
    "friction_spread": ([0.5, 1.5],),
    "disturber": ("force",),
    "compensation_speeds": ([0.2, 0.3],),
    "target_limits": ({"slew": 40.0, "margin": 0.02},),
    "command_correction": ({"time": 1.0, "share": 0.6, "least": 0.05},),
    "slow_kept": (0.98,),
    "history_length": (5,),
    "clock": ({"period": 0.5, "offsets": [0.0]},),
    "heights": ({"points": [[0.0, 0.0]]},),
    "vendor": ({"order": [], "sign": [], "offset": []},),
    "mirror_names": ([],),
    "group": (0, 1),
}
"""Field that is null -> values that it could hold."""

TWICE = "~twice"
"""Ending of a name that is written as the name itself, a second time."""

Path_ = tuple[str | int, ...]


def places(value: Any, path: Path_ = ()) -> Iterator[tuple[Path_, Any]]:
    """Yield every value within a JSON value with its path, containers before their parts."""
    if path:
        yield path, value
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in parts:
        yield from places(part, (*path, key))


def pattern_of(path: Path_) -> str:
    """Return the field that a path leads to, whatever its place in a list: `anatomy.links.*.com.*`."""
    return ".".join("*" if isinstance(key, int) else key for key in path)


def mutations(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield what and value of mutants of a value; `name`: of its field."""
    yield "text", "x"
    yield "null", None
    if isinstance(value, bool) or value is None or isinstance(value, str):
        yield from (("five", 5), ("empty list", []), ("empty object", {}))
    if value is None:
        yield from ((f"value {number}", each) for number, each in enumerate(PLAUSIBLE.get(name, ())))
    elif isinstance(value, str):
        yield from (("empty", ""), ("doubled", value + value), ("backwards", value[::-1]))
        yield from ((each, each) for each in WORDS.get(name, TERM_NAMES if name == "name" else ()))
    elif isinstance(value, int | float):
        changed = {"sign": -value, "zero": 0, "ten times": 10 * value, "more": value + 0.3, "less": value - 0.3}
        changed |= {"one more": value + 1, "half": value / 2, "list": [value], "words": str(value)}
        yield from changed.items()
        yield from (("NaN", math.nan), ("inf", math.inf), ("-inf", -math.inf))
    elif isinstance(value, list):
        yield from _lists(name, value)
    elif isinstance(value, dict):
        keys = list(value)
        yield from (("empty", {}), ("unknown field", value | {"gravity": 9.81}))
        yield from ((f"drop {key}", {k: v for k, v in value.items() if k != key}) for key in keys)
        yield from ((f"twice {key}", value | {key + TWICE: value[key]}) for key in keys[:2])
        for first, second in pairwise(keys):
            if type(value[first]) is type(value[second]):
                yield f"swap {first}", value | {first: value[second], second: value[first]}


def _lists(name: str, value: list[Any]) -> Iterator[tuple[str, Any]]:
    """Yield mutants of a list."""
    if not value:
        yield from (("one entry", [0.0]), ("one word", ["x"]))
        return
    middle = zlib.crc32(name.encode()) % len(value)
    yield from (("empty", []), ("first lost", value[1:]), ("last lost", value[:-1]), ("one twice", [*value, value[-1]]))
    yield from (("backwards", value[::-1]), ("turned", [*value[1:], value[0]]), ("object", {}))
    for first, second in ((0, len(value) - 1), (middle, (middle + 1) % len(value)), (0, len(value) // 2)):
        swapped = list(value)
        swapped[first], swapped[second] = value[second], value[first]
        yield f"swap {first} {second}", swapped
    if all(isinstance(each, int | float) and not isinstance(each, bool) for each in value):
        yield "all signs", [-each for each in value]
        yield "all ten times", [10 * each for each in value]
        yield "all zero", [0.0] * len(value)
        yield "all more", [each + 0.3 for each in value]


def mutants(contract: dict[str, Any], share: int = 1) -> Iterator[tuple[str, str, str]]:
    """Yield field, what was done, and text of mutants of a contract: all, or one of `share` by what was done."""
    whole = {"contract": contract}
    of_field: dict[str, list[tuple[Path_, Any]]] = {}
    for path, value in places(whole):
        of_field.setdefault(pattern_of(path[1:]), []).append((path, value))
    for pattern, entries in of_field.items():
        chosen = {0, zlib.crc32(pattern.encode()) % len(entries)}
        for path, value in (entries[number] for number in sorted(chosen)):
            name = next(key for key in reversed(path) if isinstance(key, str))
            inner: Any = whole
            for key in path[:-1]:
                inner = inner[key]
            for what, mutated in mutations(name, value):
                label = f"{'.'.join(map(str, path[1:]))} {what}"
                if _same(mutated, value) or zlib.crc32(label.encode()) % share:
                    continue
                inner[path[-1]] = mutated
                # A name that stands twice is written as the name itself.
                yield pattern, label, json.dumps(whole["contract"]).replace(TWICE, "")
            inner[path[-1]] = value


def _same(mutated: Any, value: Any) -> bool:
    """Return whether a mutant is the value again; the least differences of numbers are rounding."""
    if isinstance(mutated, list) and isinstance(value, list):
        return len(mutated) == len(value) and all(map(_same, mutated, value))
    if type(mutated) is type(value) or {type(mutated), type(value)} == {int, float}:
        numbers = isinstance(value, int | float)
        return math.isclose(mutated, value, rel_tol=1e-6, abs_tol=1e-12) if numbers else bool(mutated == value)
    return False


@dataclass
class Tally:
    """Count of mutants of one bundle."""

    refused: int = 0
    same: int = 0
    """Mutants that mean what the original does."""
    accepted: list[tuple[str, str]] = field(default_factory=list)
    """Field and mutation."""
    wrong: list[str] = field(default_factory=list)
    """Ends other than one line."""

    @property
    def surprising(self) -> list[str]:
        """Accepted mutants of fields that are not `FREE`."""
        return [what for field, what in self.accepted if not is_free(field, what)]


def is_free(pattern: str, what: str) -> bool:
    """Return whether a mutant may pass: its field is free, or a free one was dropped or swapped with the next one."""
    words = what.split()
    changed = f"{pattern}.{words[-1]}".lstrip(".") if words[-2:-1] in (["drop"], ["swap"]) else pattern
    patterns = (re.escape(free).replace(r"\*", ".*") for free in FREE)
    return any(re.fullmatch(rf"{free}(\..*)?", each) for free in patterns for each in (changed, words[0]))


def attack_contract(folder: Path, files: bundle_damage.Files, arrays: bundle_damage.Arrays) -> Tally:
    """Check every mutant of a bundle's contract, of which a third without STICTION_FULL=1."""
    bundle_damage.write(folder, files, arrays)
    original = check_bundle(folder).bundle.contract
    tally = Tally()
    for pattern, what, text in mutants(json.loads(files[CONTRACT]), count(3, 1)):
        content = text.encode()
        try:
            # What `check_bundle` does first; most mutants go no further.
            contract = read_contract(content)
            if contract == original:
                tally.same += 1  # a field that was left out, and has its default
                continue
            check_robot(contract)
            if not is_free(pattern, what):
                bundle_damage.write(folder, files | {CONTRACT: content}, arrays)
                check_bundle(folder)
            tally.accepted.append((pattern, what))
        except StictionError as error:
            tally.refused += 1
            if "\n" in str(error) or not 0 < len(str(error)) < 2000:
                tally.wrong.append(f"{what}: {error!r}"[:300])
        except Exception as error:
            tally.wrong.append(f"{what}: {type(error).__name__}: {error}"[:300])
    return tally


def shipped() -> tuple[bundle_damage.Files, bundle_damage.Arrays]:
    """Return a shipped policy."""
    folder = shipped_bundles()[SHIPPED]
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    with np.load(io.BytesIO(files[GOLDEN]), allow_pickle=False) as golden:
        arrays = {name: golden[name] for name in golden.files if not name.startswith(BOUND)}
    return {name: content for name, content in files.items() if name not in (GOLDEN, SUMS)}, arrays


@cache
def go2() -> tuple[bundle_damage.Files, bundle_damage.Arrays]:
    """Return a bundle of a Go2 with every record of a training, whose recording reaches every limit."""
    robot = find_robot("go2")
    commands = {"forward": (-0.8, 0.8), "sideways": (-0.3, 0.3), "turn": (-0.6, 0.6)}
    contract = make_contract(
        "go2",
        anatomy=robot,
        method="deception",
        observation=proprioception(robot.num_joints, 2),
        action_clip=5.0,
        target_limits=TARGET_LIMITS,
        command_correction=COMMAND_CORRECTION,
        command_range=commands,
        settings={"task.friction.level": 0.2, "task.history": 2, "student.iterations": 0, "teacher.quiet": 30},
    )
    model = make_network(contract, gain=0.15)
    golden = record_golden(contract, load_policy(contract, model, (1,)), robot)
    arrays = {part.name: getattr(golden, part.name) for part in fields(Golden)}
    files = {POLICY: model, CONTRACT: contract.to_json().encode(), CARD: b"# Toy\n"}
    return files, {name: values for name, values in arrays.items() if values is not None}


BUNDLES = {"shipped": shipped, "go2": go2}
"""Name -> bundle whose contract is mutated."""


def report() -> int:
    """Attack both bundles and print the counts; return 1 where a mutant was accepted that may not be, else 0."""
    status = 0
    for name, make in BUNDLES.items():
        with tempfile.TemporaryDirectory() as folder:
            tally = attack_contract(Path(folder) / "bundle", *make())
        free = Counter(field for field, what in tally.accepted if is_free(field, what))
        print(f"{name}: {tally.refused + len(tally.accepted) + len(tally.wrong)} mutants, {tally.refused} refused, "
              f"{free.total()} accepted in free fields, {len(tally.surprising)} elsewhere, {len(tally.wrong)} without "
              "one line")  # fmt: skip
        print("  free: " + ", ".join(f"{field} {count}" for field, count in free.items()))
        for line in (*tally.surprising, *tally.wrong):
            print(f"  {line}")
        status = max(status, int(bool(tally.surprising or tally.wrong)))
    return status
