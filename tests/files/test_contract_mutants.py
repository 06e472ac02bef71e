"""Mutants of a contract in which every field says something."""

from __future__ import annotations

import copy
import json
from typing import Any

import pytest

from bundles import make_contract
from stiction.core.errors import StictionError
from stiction.files.contract import read_contract
from stiction.files.observation import proprioception
from stiction.robots.catalog import find_robot


def whole() -> dict[str, Any]:
    """Return a contract in which every field says something."""
    contract = make_contract(
        "go1",
        anatomy=find_robot("go1"),
        observation=proprioception(12, known_kinds=3, slow_kept=0.98),
        known_friction={"hip": 0.1, "thigh": 0.1, "calf": 0.1},
        known_friction_file={"name": "joints.json", "sha256": "0" * 64},
        command_range={"forward": (-1.0, 1.0), "sideways": (-0.4, 0.4), "turn": (-1.0, 1.0)},
        compensation=(0.05,) * 12,
        compensation_speeds=(0.2, 0.3),
        target_limits={"slew": 40.0, "margin": 0.02},
        friction_law="stribeck",
        stribeck=(1.5, 0.1),
        action_scale=0.25,
        phases=2,
        method="of_others",
        friction_range=(0.16, 0.24),
        action_clip=5.0,
        settings={
            **{"teacher.quiet": 30, "symmetry": "network", "of_others.actor": [64, 32], "task.known-friction": True},
            **{f"task.commands.{name}": [-1.0, 1.0] for name in ("forward", "turn")},
            **{"task.commands.sideways": [-0.4, 0.4], "task.friction.method": "of_others"},
            "task.friction.law": "stribeck",
        },
    )
    return json.loads(contract.to_json())


MUTATIONS: list[tuple[str, Any]] = [
    ("schema_version", 3), ("schema_version", True), ("robot", ""), ("robot", 5), ("terrain", "moon"),
    ("method", "None"), ("method", ""), ("method", "a" * 41), ("disturber", "a b"),
    ("seed", -1), ("seed", "0"), ("phases", 3), ("control_period", 0),
    ("control_period", "0.02"), ("decimation", 4.5),
    ("kp", 50.0), ("kp", [1e8] * 12), ("kd", [None] * 12), ("torque_limit", [0] * 12), ("armature", ["0.01"] * 12),
    ("joint_names", ["a", "a"]), ("joint_names", "abc"), ("action_scale", 0), ("action_scale", [0.25, "a"]),
    ("action_clip", 1e9), ("action_offset", "zero"), ("quaternion_order", "xyzw"), ("compensation", 0.05),
    ("compensation_speeds", [0.2]), ("compensation_speeds", [0.2, 0]), ("compensation_speeds", 0.2),
    ("target_limits", {"slew": 40}), ("target_limits", {"slew": 0, "margin": 0}), ("target_limits", [40, 0.02]),
    ("friction_range", [0, 0.1, 0.2]), ("stribeck", [0.5, 0.1]), ("joints_file", {"name": "joints.json"}),
    ("joints_file", {"name": "j", "sha256": "zz"}), ("known_friction", {"hip": -0.1}), ("known_friction", [0.1]),
    ("command_range", {"forward": [0, 1]}), ("command_range", [[0, 1]] * 3),
    ("command_range", {"forward": [0, 1], "sideways": [0, 1], "turn": [0, 1e9]}), ("anatomy", {}), ("anatomy", "go1"),
    ("anatomy.joints.0.kp", "50"), ("anatomy.links.0.axis", [1, 0]), ("anatomy.feet.0.shapes.0.kind", "cone"),
    ("observation", []), ("observation.history_length", 0), ("observation.direction", "sideways"),
    ("observation.slow_kept", 1.0), ("observation.terms", []), ("observation.terms.0.name", "odometry"),
    ("observation.terms.0.name", None), ("joint_names", [None] * 12),
    ("observation.terms.0.size", 0), ("observation.terms.0.scale", 0), ("observation.terms.0.clip", "5"),
    ("observation.terms.0.frame", "world"), ("observation.terms.0.offset", "zero"), ("observation.terms.0.extra", 1),
    ("gravity", 9.81), ("settings", []), ("settings", "quiet"), ("settings", {"a": {"b": 1}}),
    ("settings", {"a": [[1]]}), ("settings", {"": 1}), ("settings", {"a" * 129: 1}), ("settings", {"a": "x" * 513}),
    ("settings", {"a": 1e301}), ("settings", {"a": [0] * 257}), ("settings", {str(n): n for n in range(513)}),
]  # fmt: skip


@pytest.mark.parametrize(("field", "value"), MUTATIONS)
def test_what_no_runtime_could_obey_is_refused(field: str, value: Any) -> None:
    """A robot would run on a contract that says nothing, or what no robot can do."""
    data = copy.deepcopy(whole())
    inner: Any = data
    *outer, last = field.split(".")
    for part in outer:
        inner = inner[int(part) if isinstance(inner, list) else part]
    inner[last] = value
    with pytest.raises(StictionError, match=outer[0] if outer else last.replace("_", "[_ ]")):
        read_contract(json.dumps(data).encode())
