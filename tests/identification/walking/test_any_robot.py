"""Walks of robots with other legs than a hexapod's: friction comes out as it went in, to the last digits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to identify a walk")

import balanced
from stiction.core.errors import StictionError
from stiction.files.walk import write_walk_fit
from stiction.identification.walking.pipeline import identify_walk
from stiction.identification.walking.setup import WalkSetup
from stiction.identification.walking.stance import ground_arms
from stiction.identification.walking.walk import Walk
from stiction.report.walking import write_walking_page
from stiction.robots.catalog import find_robot
from stiction.robots.hold import hold
from stiction.robots.model import Robot

CRAWL = [[1, 2, 3], [0, 1, 2, 3], [0, 2, 3], [0, 1, 2, 3], [0, 1, 3], [0, 1, 2, 3], [0, 1, 2]]
STEPS = [[0, 1], [0], [0, 1], [1]]


def planar_go2() -> Robot:
    """Return a Go2 that cannot move its legs sideways: two joints a leg."""
    go2 = find_robot("go2")
    return hold(go2, {name: 0.0 for name in go2.joint_names if "hip" in name})


def branching_go2() -> Robot:
    """Return a Go2 whose first hip carries all other legs too, as a waist does."""
    go2 = find_robot("go2")
    return replace(go2, links=(go2.links[0], *(replace(link, parent=max(link.parent, 0)) for link in go2.links[1:])))


def friction_of(spec: Robot) -> dict[str, tuple[float, float, float]]:
    """Return B, b and c that differ by kind."""
    return {kind: (0.05 + 0.02 * n, 0.5 + 0.3 * n, 0.05 + 0.02 * n) for n, kind in enumerate(spec.joint_kinds)}


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("spec", "order"),
    [(find_robot("go2"), CRAWL), (planar_go2(), CRAWL), (branching_go2(), CRAWL), (find_robot("g1"), STEPS)],
    ids=["go2", "two joints a leg", "a joint for all legs", "g1"],
)
def test_friction_under_load_is_found_on_any_legs(spec: Robot, order: list[list[int]], tmp_path: Path) -> None:
    """Balls and soles, two, three and six joints a leg: masses, centres, Jacobians and what joints do not feel."""
    friction = friction_of(spec)
    result = identify_walk(Walk(balanced.walk(spec, order, friction), spec, WalkSetup(mass_known=True)))
    assert result.load.refusal == ""
    for kind, truth in friction.items():
        law = [
            result.load.laws[kind][name].value for name in ("viscous_friction", "coulomb_friction", "load_coefficient")
        ]
        np.testing.assert_allclose(law, truth, rtol=1e-5)
        armature = spec.joints[spec.joints_of(kind)[0]].armature
        assert result.load.laws[kind]["armature"].value == pytest.approx(armature, rel=1e-5)
    assert {record.diagnostics["kind"] for record in result.joints.joints.values()} == set(spec.joint_kinds)
    result.joints.write(tmp_path / "joints.json")
    write_walk_fit(tmp_path / "fit.npz", result.fit)
    assert all(f">{kind}</t" in write_walking_page(tmp_path).read_text() for kind in spec.joint_kinds)


@pytest.mark.parametrize(("spec", "count"), [(branching_go2(), 0), (planar_go2(), 4)])
def test_rounding_is_no_effort_of_the_ground(spec: Robot, count: int) -> None:
    """Three joints feel all of a ball's force, also where legs share one; two leave a direction of each foot."""
    walk = Walk(balanced.walk(spec, CRAWL, friction_of(spec), seconds=2.0), spec)
    arms, hidden = ground_arms(walk)
    assert arms.shape == (400, 6, spec.num_joints) and hidden.shape == (400, 6, count)


def test_a_limb_without_a_foot_always_swings() -> None:
    """The sixth leg of a hexapod on five feet always swings: its friction is identified, its load is not asked for."""
    hexapod = find_robot("saturn_lite")
    spec = replace(hexapod, feet=hexapod.feet[:5])
    friction = {kind: (0.07, 1.0, 0.0) for kind in spec.joint_kinds}
    log = balanced.walk(spec, [[0, 3, 4], [0, 1, 2, 3], [1, 2, 4]], friction, seconds=8.0)
    record = identify_walk(Walk(log, spec)).joints.record("RR_shank")
    assert record.coulomb_friction is not None
    assert record.coulomb_friction.value == pytest.approx(1.0, rel=1e-3)
    arm = replace(spec, joints=tuple(replace(j, kind=f"arm_{j.kind}") if "RR" in j.name else j for j in spec.joints))
    friction |= {f"arm_{kind}": law for kind, law in friction.items()}
    log = balanced.walk(arm, [[0, 3, 4], [1, 2, 4]], friction, 8.0)
    load = identify_walk(Walk(log, arm, WalkSetup(mass_known=True))).load
    assert set(load.laws) == {"hip", "thigh", "shank"}
    assert "never loads them" in load.refused["arm_shank"]


def test_contacts_of_other_feet_are_refused() -> None:
    """Rejects contacts whose legs have another order."""
    spec = find_robot("go2")
    log = balanced.walk(spec, CRAWL, friction_of(spec), seconds=1.0)
    swapped = replace(log.header, foot_names=log.header.foot_names[::-1])
    with pytest.raises(StictionError, match=r"the log has the feet .*, robot 'go2' "):
        Walk(replace(log, header=swapped), spec)
