"""Plain data becomes dataclasses, or one line names the field by its whole path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import pytest

from stiction.core.decode import from_plain
from stiction.core.errors import BundleError, FileError


@dataclass(frozen=True)
class Leg:
    """Nested record."""

    joints: tuple[str, ...]
    mass: float = 1.0


@dataclass(frozen=True)
class Body:
    """Record with a field of every kind."""

    legs: tuple[Leg, ...]
    parts: Mapping[str, Leg]
    range: tuple[float, float] | None = None
    scale: float | tuple[float, ...] = 1.0
    tail: str | Leg = ""
    gait: Literal["trot", "pace"] = "trot"
    noise: dict[str, float] = field(default_factory=dict)
    free: Any = None
    weights: tuple[np.ndarray, ...] = ()


LEG = {"joints": ["hip", "knee"]}


def test_values_become_what_the_fields_declare() -> None:
    """Objects become dataclasses and mappings, lists tuples, integers floats; a union takes the fitting alternative."""
    body = from_plain(Body, {"legs": [LEG], "parts": {"tail": LEG}, "range": [0, 1], "noise": {"gyro": 2}}, "x.json")
    assert body == Body((Leg(("hip", "knee")),), {"tail": Leg(("hip", "knee"))}, (0.0, 1.0), noise={"gyro": 2.0})
    assert all(isinstance(value, float) for value in (*body.noise.values(), *(body.range or ())))
    empty: dict[str, Any] = {"legs": [], "parts": {}}
    assert from_plain(Body, empty | {"scale": [1, 2.5]}).scale == (1.0, 2.5)
    assert from_plain(Body, empty | {"scale": 2, "range": None}).scale == 2.0
    assert from_plain(Body, empty | {"tail": LEG}).tail == from_plain(Body, empty | {"tail": Leg(("hip", "knee"))}).tail
    assert from_plain(Body, empty | {"tail": "long", "free": [{"a": 1}]}).free == [{"a": 1}]
    array = np.ones(2)
    assert from_plain(Body, empty | {"weights": [array]}).weights[0] is array


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"legz": []}, "x.json: Body has no field 'legz'; did you mean 'legs'?"),
        ({"legs": {}}, "x.json: legs is {}; expected a list"),
        ({"legs": [3]}, r"x.json: legs\[0\] is 3; expected the fields of Leg"),
        ({"legs": [{"mass": 1.0}]}, r"x.json: legs\[0\]: field 'joints' is missing"),
        ({"parts": {"tail": 1}}, "x.json: parts: tail is 1; expected the fields of Leg"),
        ({"scale": [1.0, "x"]}, r"x.json: scale\[1\] is x; expected a finite number"),
        ({"scale": float("nan")}, "x.json: scale is nan; expected a finite number"),
        ({"gait": "walk"}, "x.json: gait is 'walk'; expected trot, pace"),
        ({"noise": {"gyro": True}}, "x.json: noise: gyro is True; expected a finite number"),
    ],
)
def test_a_wrong_field_is_named(change: dict[str, Any], message: str) -> None:
    """Names the field by its path, what it is, and what was expected, with the error class of the caller."""
    with pytest.raises(BundleError, match=f"^{message}"):
        from_plain(Body, {"legs": [], "parts": {}} | change, "x.json", BundleError)


def test_a_required_field_must_be_there_although_it_has_a_default() -> None:
    """Names the first field that is missing."""
    with pytest.raises(FileError, match=r"^x\.json: field 'range' is missing; was it written by another version\?$"):
        from_plain(Body, {"legs": [], "parts": {}}, "x.json", required={"range"})
    with pytest.raises(FileError, match=r"^x\.json is \[\]; expected the fields of Body$"):
        from_plain(Body, [], "x.json")
