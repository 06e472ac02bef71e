"""Friction that grows with load is fed forward where a bench identified it, plus the part that does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bundles import make_bundle, make_contract, make_network
from stiction.core.errors import StictionError
from stiction.evaluation import benches as benches_module
from stiction.evaluation.benches import forward_walks
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.grid import GridCfg, Unit, Walk, walk_unit
from stiction.files.bundle import Bundle, read_bundle
from stiction.files.joints import Estimate, JointRecord, JointsFile
from stiction.joints.compensation import parse_compensation
from stiction.robots.catalog import find_robot
from stiction.virtual import bench as bench_module
from stiction.virtual.bench import Bench

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

SPEC = find_robot("saturn_lite")
BASE = EvaluationCfg((0.2,), ("vx=0.5",), episodes=1, seconds=1.5, settle=0.5)
WAYS = ("error", "reference", "measured-motor")
GRID = GridCfg(
    BASE, ("mujoco-alone+all",), robots=(3,), robot_levels=("bench+0.05",), forward=("still",), forward_by=WAYS
)


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """A bundle whose network hardly moves: the robot stands."""
    contract = make_contract()
    return read_bundle(make_bundle(tmp_path_factory.mktemp("b") / "still", contract, make_network(contract, gain=1e-3)))


def exactly(value: float) -> Estimate:
    """Return an estimate with a narrow interval."""
    return Estimate(value, 0.01, (value - 0.02, value + 0.02))


PLAIN = JointRecord(coulomb_friction=exactly(2.0))
LOADED = replace(
    PLAIN,
    load_coefficient=exactly(0.06),
    friction_law={
        "law": "load",
        "regressor": "gravity",
        "parameters": {"coulomb_friction": exactly(1.5).to_dict()},
        "over_strength": False,
    },
)
"""2 N m on the bench, of which 1.5 N m do not grow with load."""


def set_records(monkeypatch: pytest.MonkeyPatch, **records: JointRecord) -> None:
    """Let every bench identify the record of each kind of joint, or of a joint by its name."""

    def make(bench: Bench, folder: Path, workers: int) -> None:
        folder.mkdir(parents=True)
        joints = {joint.name: records.get(joint.name, records[joint.kind]) for joint in SPEC.joints}
        JointsFile(joints).write(folder / "joints.json")

    monkeypatch.setattr(bench_module, "identify_on_bench", make)
    monkeypatch.setattr(benches_module, "has_entry", lambda folder, key: (folder / "joints.json").is_file())


def fed(walk: Walk, torque: float) -> np.ndarray:
    """Return the friction fed at a fast joint whose gains command a torque [N m], shape (J,)."""
    assert walk.forward is not None and walk.forward_load is not None
    way = parse_compensation(walk.forward_by)
    controller = way.controller(np.array(walk.forward), 0.002, load=np.array(walk.forward_load))
    return controller.torque(np.zeros(18), np.zeros(18), np.full(18, 3.0), torque)


def test_a_bench_that_found_a_coefficient_has_it_fed_but_not_by_the_error(
    still: Bundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By measured-motor at 20 N m 0.75 (1.5 + 0.06 · 20) = 2.025 N m, 0.9 of it from load; hips have 0.75 · 2."""
    set_records(monkeypatch, hip=PLAIN, thigh=LOADED, shank=LOADED)
    by_error, by_reference, in_motor = forward_walks([still], GRID, tmp_path)
    assert by_error.forward == (2.0,) * 18 and by_error.forward_load is None
    assert by_reference.forward == in_motor.forward == (2.0, 1.5, 1.5) * 6
    assert by_reference.forward_load == in_motor.forward_load == (0.0, 0.06, 0.06) * 6
    for torque in (20.0, -20.0):
        np.testing.assert_allclose(fed(in_motor, torque), (1.5, 2.025, 2.025) * 6)
        np.testing.assert_allclose(fed(in_motor, torque) - fed(in_motor, 0.0), (0.0, 0.9, 0.9) * 6)


def test_a_joint_that_was_not_identified_is_fed_the_mean_coefficient_of_its_kind(
    still: Bundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Four shanks with 0.06 and one without a coefficient: 4/5 of 0.06 per torque, and (4 · 1.5 + 2)/5 N m."""
    set_records(monkeypatch, hip=PLAIN, thigh=PLAIN, shank=LOADED, FL_shank=JointRecord(), FR_shank=PLAIN)
    walk = forward_walks([still], GRID, tmp_path)[1]
    assert walk.forward is not None and walk.forward_load is not None
    first, second = (SPEC.joint_names.index(name) for name in ("FL_shank", "FR_shank"))
    assert (walk.forward[first], walk.forward_load[first]) == pytest.approx((1.6, 0.048))
    assert (walk.forward[second], walk.forward_load[second]) == (2.0, 0.0)


@pytest.mark.parametrize(("way", "counts"), [("error", False), ("reference", True), ("measured-motor", True)])
def test_the_coefficient_reaches_the_joints_of_a_virtual_robot(still: Bundle, way: str, counts: bool) -> None:
    """A loaded robot stands differently, except for a way without load."""
    walk = Walk("still", GRID.simulators[0], "real", "bench+0.05", "flat", "vx=0.5", 0, 3, (1.0,) * 18, way)
    pair = (walk, replace(walk, forward_load=(0.05,) * 18))
    plain, loaded = (walk_unit(still, Unit((walk,)), GRID)[0] for walk in pair)
    assert (plain != loaded) == counts


@pytest.mark.parametrize(("law", "ways"), [("effort", ("reference", "error")), ("load", ("reference",))])
def test_a_coefficient_that_a_way_cannot_feed_is_refused(law: str, ways: tuple[str, ...]) -> None:
    """Rejects a coefficient of the law `load`, which multiplies unmeasured forces, and the way `error`."""
    with pytest.raises(StictionError, match=f"under the law {law}: it has a coefficient .* effort by reference"):
        GridCfg(replace(BASE, friction_law=law), ("mujoco",), forward=("still",), forward_by=ways)
