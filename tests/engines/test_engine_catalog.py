"""Engines are found by name; what is missing is said in one line, with how to get it."""

from __future__ import annotations

import sys

import pytest

from stiction.core.errors import StictionError
from stiction.engines.catalog import make_engine, missing_engine
from stiction.engines.engine import Body
from stiction.engines.ground import flat
from stiction.robots.catalog import find_robot


def test_mujoco_is_made_as_asked() -> None:
    """The robot, and the step that its controller counts with."""
    body = Body.nominal(find_robot("go1"))
    engine = make_engine("mujoco", body, flat(), 0.001)
    assert (engine.name, engine.timestep) == ("mujoco", 0.001)
    assert engine.body is body and missing_engine("mujoco", body.spec) is None


@pytest.mark.parametrize(("name", "timestep", "message"), [("bullet", 0.002, "known: mujoco"), ("mujoco", 0.1, "0.02")])
def test_what_cannot_be_made_is_refused(name: str, timestep: float, message: str) -> None:
    """An unknown engine, a step that no physics takes."""
    with pytest.raises(StictionError, match=message):
        make_engine(name, Body.nominal(find_robot("go1")), flat(), timestep)


def test_a_missing_package_is_named_with_what_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A traceback would not tell what to install."""
    monkeypatch.setitem(sys.modules, "sapien", None)
    missing = missing_engine("physx", find_robot("go1"))
    assert missing is not None and "the package sapien" in missing and "[engines]" in missing
