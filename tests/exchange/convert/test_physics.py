"""Parameters of a simulated joint from a record: each counted once, none invented, omissions noted."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from motors import motor, number
from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.exchange.physics import beyond_coulomb, headline, joint_physics
from stiction.files.joints import Estimate, JointRecord

DOCS = Path(__file__).parents[3] / "docs"


def test_a_bare_motor_gives_everything() -> None:
    """A bare motor has the rotor's inertia; its friction is still a lower bound for the leg."""
    physics = joint_physics("shank", motor(), "FL_calf")
    assert (physics.name, physics.recorded) == ("FL_calf", "shank")
    assert (physics.friction, physics.damping, physics.armature) == (0.4, 0.07, 0.03)
    assert len(physics.notes) == 1 and "lower bound" in physics.notes[0]
    assert joint_physics("shank", motor(test_condition="loaded", inertia=None)).notes[0].startswith("inertia not known")


@pytest.mark.parametrize(
    ("condition", "message"), [("in_air", "includes the link's"), ("loaded", "loaded"), (None, "no stated condition")]
)
def test_inertia_with_links_in_it_is_no_armature(condition: str | None, message: str) -> None:
    """The simulator adds the links itself."""
    physics = joint_physics("shank", motor(test_condition=condition))
    assert physics.armature is None
    assert any(message in note and "0.03" in note and "armature left out" in note for note in physics.notes)


def test_what_is_null_is_named_with_what_is_known_instead() -> None:
    """A log without torque: combinations and ratios."""
    known = {"combinations": {"viscous_friction + k kd": number(0.6)}, "friction_ratio": number(0.01)}
    record = motor(inertia=None, viscous_friction=None, **known)
    notes = " ".join(joint_physics("shank", record).notes)
    assert "viscous friction and inertia not known" in notes and "viscous_friction + k kd = 0.6" in notes
    assert "friction over torque limit" not in notes
    nothing = JointRecord(friction_ratio=number(0.01), combinations={"f/k": number(0.45)})
    with pytest.raises(StictionError, match=r"'shank' holds nothing.*f/k = 0.45, friction over torque limit = 0.01"):
        joint_physics("shank", nothing)


def test_richer_laws_are_not_lost_without_a_word() -> None:
    """Static friction, Stribeck, load, an offset that is sure: each is named, unless the simulator holds it."""
    parameters = {name: number(0.4).to_dict() for name in ("coulomb_friction", "viscous_friction")}
    record = motor(
        static_friction=number(0.5),
        stribeck_velocity=number(0.1),
        load_coefficient=number(0.02),
        offset=number(0.05),
        friction_law={"law": "stribeck", "parameters": parameters},
    )
    assert len(beyond_coulomb(record)) == 5
    assert "static_friction 0.5 is not represented, breakaway over moving: 1.25 (" in beyond_coulomb(record)[0]
    assert not any("static_friction" in note for note in beyond_coulomb(record, frozenset({"static_friction"})))
    assert beyond_coulomb(motor(offset=Estimate(0.01, 0.1, (-0.2, 0.2)), friction_law={"law": "coulomb"})) == []


def test_the_headline_names_a_page_and_what_all_records_lack_once() -> None:
    """A dozen servos, none with an inertia of the rotor, two of them with friction at rest: one short line."""
    rises = {"static_friction": number(0.5), "stribeck_velocity": number(0.1)}
    joints = [
        joint_physics(f"servo_{n}", motor(test_condition="loaded", **(rises if n < 2 else {}))) for n in range(12)
    ]
    line = headline(joints)
    assert "armature (all 12), static_friction (servo_0, servo_1), stribeck_velocity (servo_0" in line
    (page,) = re.findall(r'the page "(.*)" of the documentation$', line)
    assert f"# {page}" in (DOCS / "trainers.md").read_text().splitlines() and len(line) < 240
    legs = [joint_physics("shank", motor(test_condition="loaded"), leg) for leg in ("FL", "FR")]
    assert "armature (shank);" in headline(legs)


@pytest.mark.parametrize("verb", ["convert", "import", "deploy"])
def test_pages_that_help_names_exist(verb: str, capsys: pytest.CaptureFixture) -> None:
    """The wheel has no docs/: a page has its title."""
    with pytest.raises(SystemExit):
        main([verb, "--help-all"])
    told = " ".join(capsys.readouterr().out.split())
    titles = [line for page in DOCS.glob("*.md") for line in page.read_text().splitlines() if line.startswith("# ")]
    (title,) = re.findall(r'[Tt]he page "(.*?)" of the documentation', told)
    assert any(line.startswith(f"# {title}") for line in titles) and "docs/" not in told


def test_of_a_stribeck_joint_the_laws_own_friction_is_taken() -> None:
    """A Stribeck joint has its law's friction: the best symmetric fit of one may have negative viscous friction."""
    law = {"law": "stribeck", "parameters": {"coulomb_friction": number(0.44).to_dict()}}
    law["parameters"]["viscous_friction"] = number(0.07).to_dict()
    record = motor(
        viscous_friction=number(-0.2), coulomb_friction=number(0.6), static_friction=number(0.7), friction_law=law
    )
    physics = joint_physics("shank", record)
    assert (physics.friction, physics.damping) == (0.44, 0.07)
    assert any("its Coulomb and viscous part" in note for note in beyond_coulomb(record))
