"""Consistency of a contract's record of its training, and with the settings that it repeats."""

from __future__ import annotations

import json
from typing import Any

import pytest

from bundles import aged, make_contract
from stiction.core.errors import BundleError
from stiction.files.contract import read_contract
from stiction.files.contract_training import DEFAULTS, ERAS
from stiction.robots.catalog import find_robot

ROBOT = find_robot("go2")

TOLD: dict[str, Any] = {
    "method": "deception",
    "action_clip": 5.0,
    "command_range": {"forward": (-0.8, 0.8), "sideways": (-0.3, 0.3), "turn": (-0.6, 0.6)},
    "phases": 2,
}


def written(**changes: Any) -> bytes:
    """Return the contract.json of a training of today, with some fields changed behind the writer's back."""
    made = make_contract("go2", anatomy=ROBOT, settings={"task.history": 11, "task.friction.level": 0.2}, **TOLD)
    return json.dumps(json.loads(made.to_json()) | changes).encode()


def test_defaults_of_settings_are_those_of_training() -> None:
    """Knows the default of today of each setting; else bundles of tomorrow are refused: add it, and keep the older."""
    identity = pytest.importorskip("stiction.learning.identity", reason="the extra 'train' is needed for its defaults")
    today = identity.defaults()
    assert {name: today[name] for name in DEFAULTS} == {name: values[-1] for name, values in DEFAULTS.items()}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"friction_range": [0.0, 0.0]}, "friction, by the method 'deception'"),
        ({"method": "none"}, "with method 'none'"),
        ({"friction_range": [0.3, 0.4]}, "task.friction.range"),
        ({"armature": [0.129] * 12}, "as 'armature'"),
        ({"damping": [0.5] * 12}, "as 'damping'"),
        ({"disturber": "force"}, "null with the method 'deception'"),
        ({"torque_source": "motor_side"}, "as 'actuator' is"),
        ({"imported": {"name": "net", "sha256": "0" * 64}}, "null with the method 'deception'"),
        ({"terrain": "unknown"}, "'imported', and with no other"),
        ({"terrain": "stairs"}, "by the setting 'task.terrain.kind'"),
        ({"phases": 1}, "by the setting 'student.iterations'"),
        ({"compensation_width": 0.5}, "0.05, as 'compensation' is null"),
        ({"decimation": 8, "physics_timestep": 0.0025}, "by the setting 'task.decimation'"),
        (
            {"command_range": {"forward": [-8, 8], "sideways": [-0.3, 0.3], "turn": [-0.6, 0.6]}},
            "task.commands.forward",
        ),
        ({"settings": {"task.friction.range": ["a", "b"]}}, "settings.task.friction.range"),
        ({"settings": {"task.friction.mixture": None}, "friction_range": [0.0, 1.0]}, "task.friction.range"),
        ({"settings": {"task.commands.turn": None}}, "settings.task.commands.turn"),
        ({"settings": {"task.friction.method": "imported"}, "method": "imported"}, "terrain"),
        ({"robot": "go1"}, "anatomy.name"),
        ({"target_limits": {"slew": 400.0, "margin": 0.02}}, "slew of at most 40"),
        ({"target_limits": {"slew": 40.0, "margin": 0.0}}, "margin of at least 0.02"),
        ({"phases": None}, "'phases' is null, and 'anatomy'"),
        ({"schema_version": 1}, "does not exist in schema version 1"),
    ],
)
def test_a_contract_that_contradicts_itself_is_refused(change: dict[str, Any], message: str) -> None:
    """Names the field, and what the rest of the contract says of it."""
    assert read_contract(written()).method == "deception"
    with pytest.raises(BundleError, match=message):
        read_contract(written(**change))


@pytest.mark.parametrize("era", ERAS)
def test_an_older_contract_lacks_all_that_came_later(era: tuple[str, ...]) -> None:
    """Reads a file from before a field; rejects one that has lost the field alone."""
    contract = make_contract("go2", anatomy=ROBOT)
    older = aged(contract, era[0])
    assert read_contract(json.dumps(older).encode()).joint_names == contract.joint_names
    lost = {name: value for name, value in json.loads(contract.to_json()).items() if name != era[0]}
    if era != ERAS[-1]:
        with pytest.raises(BundleError, match=f"'{era[0]}' is missing"):
            read_contract(json.dumps(lost).encode())
