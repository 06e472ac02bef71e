"""Consistency of a contract's record of its training: method, friction, commands, settings, and the age of the file.

`settings` holds the values that differed from the defaults of the code, by name. A field of the contract that repeats a
setting must have its value, or, where the setting is not listed, a default of some version.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from stiction.core.decode import is_number
from stiction.core.errors import BundleError
from stiction.files.contract_rules import IMPORTED, UNKNOWN, expect

Contract = Any
"""`stiction.files.contract.Contract`, whose module imports this one."""

FRICTION_RANGES: dict[str, tuple[float, float]] = {"none": (0.0, 0.0), "direct": (0.8, 1.2), "deception": (0.0, 1.2)}
"""Multiplier of the nominal dry friction in the last stage, by training method of the product.

`none` is conventional randomisation, the paper's Table II without its friction row; `deception` has that row; `direct`
has the range that the table gives every other joint parameter. Ranges of other methods are in their distributions, and
are not checked.
"""

OWN = (*FRICTION_RANGES, IMPORTED)
"""Methods whose contracts are checked against them; other methods are not checked."""

ERAS: tuple[tuple[str, ...], ...] = (
    ("stribeck", "actuator"),
    ("known_friction", "known_friction_file"),
    ("phases",),
    ("anatomy",),
    ("command_range", "imported"),
    ("friction_load", "friction_spread", "disturber", "torque_source"),
    ("settings",),
    ("compensation_speeds",),
    ("target_limits",),
    ("command_correction",),
)
"""Fields in the order in which version 2 got them; a file with some of them has all earlier ones."""

DEFAULTS: dict[str, tuple[Any, ...]] = {
    "task.friction.method": ("deception",),
    "task.friction.law": ("coulomb",),
    "task.friction.load": (None,),
    "task.friction.spread": (None,),
    "task.friction.range": (None,),
    "task.friction.mixture": ([],),
    "task.friction.static-ratio": (1.5,),
    "task.friction.stribeck-velocity": (0.1,),
    "task.terrain.kind": ("flat",),
    "task.terrain.speed": ([0.3, 0.55],),
    "task.decimation": (4,),
    "task.timestep": (0.005,),
    "task.action-clip": (5.0,),
    "task.history": (11,),
    "task.commands.forward": ([-0.8, 0.8],),
    "task.commands.sideways": ([-0.3, 0.3],),
    "task.commands.turn": ([-0.6, 0.6],),
    "task.commands.standing-share": (0.1,),
    "student.iterations": (240,),
}
"""Setting -> all its defaults so far; a new default is added, and no older one removed."""

RISE = ("task.friction.static-ratio", "task.friction.stribeck-velocity")
"""Settings whose middle the contract has in `stribeck`: a number, or its lowest and highest."""

REPEATED = {
    "method": "task.friction.method",
    "friction_law": "task.friction.law",
    "friction_load": "task.friction.load",
    "friction_spread": "task.friction.spread",
    "terrain": "task.terrain.kind",
    "decimation": "task.decimation",
    "physics_timestep": "task.timestep",
    "action_clip": "task.action-clip",
}
"""Field of the contract -> the setting that it repeats."""


def ends_of(value: Any) -> tuple[float, float]:
    """Return the lowest and the highest of a setting that is a number or a pair; NaN for anything else."""
    pair = value if isinstance(value, list | tuple) and len(value) == 2 else (value, value)
    low, high = (float(end) if is_number(end) else math.nan for end in pair)
    return low, high


def span_text(span: tuple[float, float]) -> str:
    """Return a range in words, `1.2 to 1.8`, or the one number."""
    low, high = span
    return f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"


def check_age(data: Mapping[str, Any], version: int) -> None:
    """Reject a contract.json that lacks a field although it has later ones. `data`: its object, not yet converted."""
    has = [[name for name in era if name in data] for era in ERAS]
    if version == 1 and (late := [name for names in has for name in names]):
        raise BundleError(f"contract.json: {late[0]!r} does not exist in schema version 1; export the bundle again")
    for number, (era, names) in enumerate(zip(ERAS, has, strict=True)):
        later = [name for names in has[number:] for name in names]
        if len(names) < len(era) and later:
            lost = next(name for name in era if name not in names)
            raise BundleError(
                f"contract.json: field {lost!r} is missing, and {later[-1]!r}, which came later, is there; "
                "export the bundle again"
            )
    if data.get("imported") is None:
        for first, then in pairwise(("phases", "anatomy", "command_range", "settings")):
            if data.get(first) is None and data.get(then) is not None:
                raise BundleError(
                    f"contract.json: {first!r} is null, and {then!r}, which came later, is not; export the bundle again"
                )


def check_training(contract: Contract) -> None:
    """Reject a contract whose method, friction, motors and settings contradict each other."""
    elsewhere, method = contract.method == IMPORTED, contract.method
    words = f"{UNKNOWN!r} with the method {IMPORTED!r}, and with no other"
    expect((contract.terrain == UNKNOWN) == elsewhere, "terrain", contract.terrain, words)
    expect(contract.imported is None or elsewhere, "imported", contract.imported, f"null with the method {method!r}")
    disturber, source, speeds = contract.disturber, contract.torque_source, contract.compensation_speeds
    expect(disturber is None or method not in OWN, "disturber", disturber, f"null with the method {method!r}")
    right = source is None or contract.actuator is not None
    expect(right, "torque_source", source, "null, as 'actuator' is")
    if contract.compensation is None:
        expect(speeds is None, "compensation_speeds", speeds, "null, as 'compensation' is")
        # Friction that is fed forward by the error has this width too.
        width, usual = contract.compensation_width, type(contract).compensation_width
        expect(width == usual, "compensation_width", width, f"{usual}, as 'compensation' is null")
    _check_range(contract)
    if contract.settings is not None:
        _check_settings(contract, contract.settings)


def _check_range(contract: Contract) -> None:
    """Check that the range of friction is a range of the method."""
    level, (low, high), load = contract.friction_level, contract.friction_range, contract.largest_load
    usual = FRICTION_RANGES.get(contract.method, (0.0, 0.0))
    without = contract.method in ("none", IMPORTED)
    if without or level == 0.0:
        expect(high == 0.0, "friction_range", (low, high), f"[0, 0] with method {contract.method!r}, level {level:g}")
    if without:
        for name in ("friction_load", "friction_spread"):
            expect(getattr(contract, name) is None, name, getattr(contract, name), f"null with {contract.method!r}")
    elif usual[1] > 0.0 and level > 0.0:
        expect(high > 0.0 or load > 0.0, "friction_range", (low, high), f"friction, by the method {contract.method!r}")
    if usual[0] > 0.0 and contract.settings is None:
        expect(low <= level <= high, "friction_level", level, f"a level in the range drawn from, {low:g} to {high:g}")


def _check_settings(contract: Contract, settings: Mapping[str, Any]) -> None:
    def values(name: str) -> tuple[Any, ...]:
        return (settings[name],) if name in settings else DEFAULTS[name]

    def numbers(name: str, least: int = 2) -> list[list[float]]:
        lists = [
            list(each) if isinstance(each, list | tuple) else []
            for each in values(name)
            if each is not None or None not in DEFAULTS[name]
        ]
        right = all(len(each) >= least and all(map(is_number, each)) for each in lists)
        expect(right, f"settings.{name}", settings.get(name), "numbers")
        return lists

    def agree(field: str, value: Any, allowed: Sequence[Any], name: str) -> None:
        expect(any(_same(value, each) for each in allowed), field, value, f"{allowed[0]!r}, by the setting {name!r}")

    for field, name in REPEATED.items():
        agree(field, getattr(contract, field), values(name), name)
    agree("observation.history_length", contract.observation.history_length, values("task.history"), "task.history")
    for name, middle in zip(RISE, contract.stribeck or (), strict=False):
        low, high = ends_of(values(name)[0])
        expect(low <= high, f"settings.{name}", settings.get(name), "a number, or the lower end and the upper one")
        agree("stribeck", middle, ((low + high) / 2,), name)
    if (level := settings.get("task.friction.level")) is not None:
        agree("friction_level", contract.friction_level, (level,), "task.friction.level")
    phases = [2 if iterations else 1 for iterations in values("student.iterations")]
    agree("phases", contract.phases, phases, "student.iterations")
    # Weight, lower and upper end of each part of a mixture, in one list.
    mixture, ranges = numbers("task.friction.mixture", 0)[0], numbers("task.friction.range")
    ends = (*mixture[1::3], *mixture[2::3]) or (ranges[0] if ranges else FRICTION_RANGES.get(contract.method))
    if ends or contract.method == IMPORTED:
        drawn = [contract.friction_level * end for end in (min(ends or (0.0,)), max(ends or (0.0,)))]
        agree("friction_range", contract.friction_range, (drawn,), "task.friction.range")
    flat, standing = contract.terrain == "flat", [0.0] if any(values("task.commands.standing-share")) else []
    for command, span in (contract.command_range or {}).items():
        name, courses = f"task.commands.{command}", [[0.0] * 0]
        if command == "turn" and not flat:
            continue  # courses turn as fast as their code asks
        if command == "forward" and not flat:
            courses = numbers("task.terrain.speed")
        spans = [[*each, *course, *standing] for each in numbers(name) for course in courses]
        agree(f"command_range.{command}", span, [[min(each), max(each)] for each in spans], name)


def _same(value: Any, setting: Any) -> bool:
    """Return whether a field has the value of a setting; numbers may have been rounded."""
    if isinstance(value, tuple) and isinstance(setting, list | tuple):
        return len(value) == len(setting) and all(map(_same, value, setting))
    if is_number(value) and is_number(setting):
        return math.isclose(value, setting, rel_tol=1e-9, abs_tol=1e-12)
    return type(value) is type(setting) and value == setting
