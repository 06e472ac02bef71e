"""Python for Isaac Lab: parsed here, for Isaac Lab itself is not at hand."""

from __future__ import annotations

import ast

import pytest

from motors import joint, number
from stiction.exchange.isaaclab import isaaclab_snippet


def assigned(text: str) -> dict[str, ast.Dict]:
    """Return the dictionaries that a snippet assigns."""
    assignments = [node for node in ast.parse(text).body if isinstance(node, ast.Assign)]
    return {node.targets[0].id: node.value for node in assignments}  # type: ignore[attr-defined, misc]


def groups(text: str) -> dict[str, dict]:
    """Return each actuator group's arguments."""
    table = assigned(text)["IDENTIFIED_ACTUATORS"]
    return {
        ast.literal_eval(key): {word.arg: ast.literal_eval(word.value) for word in call.keywords}  # type: ignore[arg-type, attr-defined]
        for key, call in zip(table.keys, table.values)
    }


def test_friction_is_an_effort_at_rest_and_in_motion() -> None:
    """Coulomb friction is the same in both; a known static friction holds at rest; nulls are left out."""
    text = isaaclab_snippet(
        [joint(".*_calf_joint"), joint("hip", static_friction=number(0.6), viscous_friction=None, kp=None)]
    ).text
    actuators = groups(text)
    gains = {"stiffness": 20.0, "damping": 0.5, "armature": 0.03}
    friction = {"friction": 0.4, "dynamic_friction": 0.4, "viscous_friction": 0.07}
    assert actuators[".*_calf_joint"] == {"joint_names_expr": [".*_calf_joint"]} | gains | friction
    assert actuators["hip"]["friction"] == 0.6 and actuators["hip"]["dynamic_friction"] == 0.4
    assert "viscous_friction" not in actuators["hip"] and actuators["hip"]["stiffness"] is None


def test_friction_at_rest_is_never_below_that_in_motion() -> None:
    """PhysX asks for it; two estimates may disagree by their noise."""
    actuators = groups(isaaclab_snippet([joint("hip", static_friction=number(0.39))]).text)
    assert actuators["hip"]["friction"] == actuators["hip"]["dynamic_friction"] == 0.4


def test_a_coefficient_needs_a_load() -> None:
    """0.4 N m at |F| + |T| = 100 is 0.004; without a load none is invented."""
    without = isaaclab_snippet([joint("hip")])
    assert set(assigned(without.text)) == {"IDENTIFIED_ACTUATORS"}
    assert any("--assumed-load" in note for note in without.notes)
    snippet = isaaclab_snippet([joint("hip"), joint("knee", coulomb_friction=None)], 100.0)
    assert ast.literal_eval(assigned(snippet.text)["FRICTION_COEFFICIENTS"]) == {"hip": pytest.approx(0.004)}
    assert any("assumed load alone" in note for note in snippet.notes)


def test_a_coefficient_has_one_friction_and_efforts_have_both() -> None:
    """0.6 at rest and 0.4 in motion under 100 N + N m: by default the one in motion, by --friction static at rest."""
    for which, coefficient in (("moving", 0.004), ("static", 0.006)):
        snippet = isaaclab_snippet([joint("hip", static_friction=number(0.6))], 100.0, which)
        assert f"'hip': {coefficient:g}," in snippet.text and "motor: breakaway over moving: 1.5" in snippet.notes
        hip = groups(snippet.text)["hip"]
        assert (hip["friction"], hip["dynamic_friction"]) == (0.6, 0.4)


def test_newton_gets_one_friction() -> None:
    """Newton reads no dynamic friction: `friction` holds the one in motion; a note names the omitted one at rest.

    The torque limit is what the actuator clips at, on both backends.
    """
    snippet = isaaclab_snippet([joint("hip", static_friction=number(0.6), torque_limit=45.0)], newton=True)
    hip = groups(snippet.text)["hip"]
    assert hip["friction"] == 0.4 and "dynamic_friction" not in hip and hip["effort_limit"] == 45.0
    assert "left out: static_friction (motor)" in snippet.text.splitlines()[0]
    assert groups(isaaclab_snippet([joint("hip", torque_limit=45.0)]).text)["hip"]["effort_limit"] == 45.0
