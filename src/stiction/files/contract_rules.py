"""Rules of the fields of a contract: numbers that a robot could have, and words from a list.

Every bound is far outside the range of robots. Within it a number may still be wrong; beyond it, it is of no robot, and
a computer that used it would wait, overflow, or move something with all its force.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from stiction.core.decode import is_integer, is_number, is_text
from stiction.core.errors import BundleError
from stiction.files.velocity import COMMANDS


class Rule(NamedTuple):
    """Condition on a value."""

    allowed: Callable[[Any], bool]
    expected: str


LONGEST = 4096
"""Maximum length of a text."""


def _between(low: float, high: float, unit: str = "") -> Rule:
    return Rule(lambda value: is_number(value) and low <= value <= high, f"a number from {low:g} to {high:g}{unit}")


def _integer(low: int, high: int) -> Rule:
    return Rule(lambda value: is_integer(value) and low <= value <= high, f"an integer from {low} to {high}")


def one_of(*values: Any) -> Rule:
    """Return the rule of a field with a list of values."""
    words = " or ".join("null" if value is None else repr(value) for value in values)
    # To Python, True is in (1, 2).
    return Rule(lambda value: value in values and not isinstance(value, bool), words)


def _or_null(allowed: Callable[[Any], bool], expected: str) -> Rule:
    return Rule(lambda value: value is None or allowed(value), f"null, or {expected}")


def expect(condition: bool, field: str, value: object, expected: str) -> None:
    """Raise `BundleError` naming the field of a contract unless the condition holds."""
    if not condition:
        raise BundleError(f"contract field {field!r} is {repr(value)[:200]}; expected {expected}")


def is_name(value: Any) -> bool:
    """Return whether a value is a printable text of the length of a name."""
    return is_text(value) and len(value) <= 128 and value.isprintable()


def _is_pair(value: Any, rule: Rule) -> bool:
    return isinstance(value, tuple) and len(value) == 2 and all(map(rule.allowed, value))


def _is_range(value: Any, rule: Rule) -> bool:
    return _is_pair(value, rule) and value[0] <= value[1]


def _has(value: Any, names: Any) -> bool:
    """Return whether a value is an object with exactly these keys."""
    return isinstance(value, Mapping) and set(value) == set(names)


def _object(rules: Mapping[str, Rule], expected: str) -> Rule:
    """Return the rule of null, or of an object with exactly these keys, each with its rule."""
    return _or_null(
        lambda value: _has(value, rules) and all(rule.allowed(value[name]) for name, rule in rules.items()),
        f"an object with {expected}",
    )


def _is_file(value: Any) -> bool:
    digest = _has(value, ("name", "sha256")) and is_name(value["name"]) and value["sha256"]
    return isinstance(digest, str) and re.fullmatch("[0-9a-f]{64}", digest) is not None


def _is_imported(value: Any) -> bool:
    """Return whether a value is a file, alone or with a preset and the names of the fields that it filled."""
    if not isinstance(value, Mapping):
        return False
    filled = [value[name] for name in ("preset", "assumed") if name in value]
    plain = {name: value[name] for name in value if name not in ("preset", "assumed")}
    return _is_file(plain) and len(filled) in (0, 2) and all(map(TEXT.allowed, filled))


ANGLE = _between(-1000.0, 1000.0, " rad")
SHARE = _between(0.0, 10.0)
"""Range of friction over a torque limit, or of a coefficient: at 1 a joint is stuck."""

JOINT_SPEED = _between(1e-4, 100.0, " rad/s")

TARGET_RULES = {"slew": _between(0.1, 1000.0, " rad/s"), "margin": _between(0.0, 1.0, " rad")}

TARGET_LIMITS = {"slew": 40.0, "margin": 0.02}
"""Default limits of new bundles, and of a robot's runtime for an older one: 0.8 rad in a control period of 20 ms, more
than the shipped policies request (results/deploy)."""

CORRECTION_RULES = {"time": _between(0.1, 100.0, " s"), "share": _between(0.0, 1.0), "least": _between(0.0, 0.2)}

COMMAND_CORRECTION = {"time": 1.0, "share": 0.6, "least": 0.05}
"""Default correction of new bundles: integral action over a stride or two, at most 60 % of the command, and 0.05 m/s
(rad/s) against a drift."""

SPEED_RATIO = (_between(1.0, 10.0), JOINT_SPEED)
"""Rules of static over dynamic friction, and of the speed of Stribeck's law."""

VELOCITY = _between(-100.0, 100.0)
"""Ranges of a commanded velocity [m/s], [rad/s]."""

TEXT = Rule(
    lambda value: is_text(value) and len(value) <= LONGEST and all(c.isprintable() or c == "\n" for c in value),
    f"a text of 1 to {LONGEST} printable characters",
)
NAME = Rule(is_name, "a printable text of 1 to 128 characters")
FILE = _or_null(_is_file, "an object with 'name' and 'sha256', 64 hexadecimal digits")
RANGE = Rule(lambda value: _is_range(value, SHARE), "two numbers, 0 <= low <= high <= 10")

MOST_SETTINGS, MOST_IN_LIST, LONGEST_SETTING, LARGEST_SETTING = 512, 256, 512, 1e300
"""Maximum number of settings of a training, entries of a list, characters of a text, and size of a number."""


def _is_scalar(value: Any) -> bool:
    """Return whether a value is a number, a text, true, false or null, and not too large."""
    if isinstance(value, str):
        return len(value) <= LONGEST_SETTING and value.isprintable()
    return value is None or isinstance(value, bool) or is_number(value, LARGEST_SETTING)


def _are_settings(value: Any) -> bool:
    """Return whether a value is an object of settings of a training."""
    if not isinstance(value, Mapping) or len(value) > MOST_SETTINGS or not all(map(is_name, value)):
        return False
    lists = [item if isinstance(item, list | tuple) else [item] for item in value.values()]
    return all(len(item) <= MOST_IN_LIST and all(map(_is_scalar, item)) for item in lists)


SETTINGS = _or_null(
    _are_settings,
    f"an object of at most {MOST_SETTINGS} settings: a printable name of 1 to 128 characters, and a number, a "
    f"printable text of at most {LONGEST_SETTING} characters, true, false, null, or a list of at most {MOST_IN_LIST} "
    "such",
)

UNKNOWN, IMPORTED = "unknown", "imported"
"""Ground, and method, of an imported policy."""

TERRAINS = ("flat", "slopes", "rough", "stairs", "mixed", UNKNOWN)

METHOD = Rule(
    lambda value: isinstance(value, str) and re.fullmatch("[a-z][a-z0-9_-]{0,39}", value) is not None,
    "a name of 1 to 40 lower-case letters, digits, - and _",
)
"""Name of a training method, or of a disturbance, also of any installed distribution."""

SCHEMA_VERSION = 2
"""Version of contract.json. Version 1 is read as well; all others are refused."""

RULES: dict[str, Rule] = {
    "schema_version": one_of(SCHEMA_VERSION),
    "robot": NAME,
    "terrain": one_of(*TERRAINS),
    "method": METHOD,
    **dict.fromkeys(("revision", "command"), TEXT),
    "seed": _integer(0, 2**63 - 1),
    "phases": one_of(1, 2, None),
    "disturber": _or_null(*METHOD),
    "torque_source": one_of("motor_side", "output_side", None),
    # From 2 kHz to 5 Hz; a physics step under 10 µs would take days for a minute of walking.
    "control_period": _between(5e-4, 0.2, " s"),
    "decimation": _integer(1, 200),
    "physics_timestep": _between(1e-5, 0.05, " s"),
    "action_clip": _between(1e-3, 1000.0),
    "compensation_width": _between(1e-4, 3.2, " rad"),
    "compensation_speeds": _or_null(lambda value: _is_pair(value, JOINT_SPEED), "two numbers from 0.0001 to 100 rad/s"),
    "target_limits": _object(TARGET_RULES, "'slew', 0.1 to 1000 rad/s, and 'margin', 0 to 1 rad"),
    "command_correction": _object(CORRECTION_RULES, "'time', 0.1 to 100 s, 'share', 0 to 1, and 'least', 0 to 0.2 m/s"),
    "friction_level": SHARE,
    "friction_range": RANGE,
    **dict.fromkeys(("friction_load", "friction_spread"), _or_null(*RANGE)),
    "command_range": _or_null(
        lambda value: _has(value, COMMANDS) and all(_is_range(ends, VELOCITY) for ends in value.values()),
        "for each of 'forward', 'sideways' and 'turn' two numbers, -100 <= low <= high <= 100",
    ),
    "action_offset": one_of("standing"),
    "quaternion_order": one_of("wxyz"),
    **dict.fromkeys(("joints_file", "actuator", "known_friction_file"), FILE),
    "imported": _or_null(
        _is_imported,
        f"{FILE.expected.removeprefix('null, or ')}, and of a preset 'preset' and 'assumed', printable texts",
    ),
    "settings": SETTINGS,
}
"""Field -> its rule, for fields independent of the number of joints."""

PER_JOINT: dict[str, Rule] = {
    **dict.fromkeys(("standing", "lower", "upper"), ANGLE),
    "kp": _between(1e-3, 1e5, " N m/rad"),
    "kd": _between(0.0, 1e4, " N m s/rad"),
    "torque_limit": _between(1e-3, 1e4, " N m"),
    "armature": _between(1e-9, 100.0, " kg m²"),
    "damping": _between(0.0, 1e3, " N m s/rad"),
    "friction": _between(0.0, 1e4),
    "compensation": _between(0.0, 3.2, " rad"),
    "action_scale": _between(1e-6, 10.0, " rad"),
}
"""Field with one number per joint, in the order of `joint_names` -> the rule of each number."""

TERM_RULES: dict[str, Rule] = {"scale": _between(1e-6, 1e6), "clip": _between(1e-6, 1e6)}
