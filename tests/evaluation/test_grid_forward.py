"""Friction fed forward counts as a separate policy, with friction that a bench can identify."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bundles import make_bundle, make_contract, make_network
from stiction.core.errors import StictionError
from stiction.evaluation import benches as benches_module
from stiction.evaluation.benches import forward_notes, forward_walks
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.grid import GridCfg
from stiction.evaluation.run import walk_grid
from stiction.evaluation.table import rows_of
from stiction.files.bam import load_joints
from stiction.files.bundle import Bundle, read_bundle
from stiction.files.joints import Estimate, JointRecord, JointsFile, refused
from stiction.robots.catalog import find_robot
from stiction.virtual import bench as bench_module
from stiction.virtual.bench import Bench
from stiction.virtual.hidden import draw

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

SPEC = find_robot("saturn_lite")
BASE = EvaluationCfg((0.0, 0.2), ("vx=0.5",), episodes=1, seconds=1.5, settle=0.5)
GRID = GridCfg(BASE, ("mujoco", "mujoco-alone"), forward=("still",), forward_by=("error",))


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """A bundle whose network hardly moves: the robot stands."""
    contract = make_contract()
    return read_bundle(make_bundle(tmp_path_factory.mktemp("b") / "still", contract, make_network(contract, gain=1e-3)))


@pytest.fixture
def benches(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Let benches identify 1 N m in the first joint, 2 in the second and so on; return the robots on a bench."""
    seen: list[str] = []

    def make(bench: Bench, folder: Path, workers: int) -> None:
        seen.append(bench.label)
        folder.mkdir(parents=True)
        estimates = [Estimate(float(n), 0.1, (n - 0.2, n + 0.2)) for n in range(1, SPEC.num_joints + 1)]
        JointsFile(dict(zip(SPEC.joint_names, map(record, estimates), strict=True))).write(folder / "joints.json")

    monkeypatch.setattr(bench_module, "identify_on_bench", make)
    monkeypatch.setattr(benches_module, "has_entry", lambda folder, key: (folder / "joints.json").is_file())
    return seen


def record(friction: Estimate) -> JointRecord:
    """Return a joint of which only the friction is known."""
    return JointRecord(coulomb_friction=friction)


def test_on_the_data_sheet_the_friction_is_the_laws_own(still: Bundle, tmp_path: Path) -> None:
    """20 % of 30, 30 and 45 N m, alone and in the batch."""
    walks = forward_walks([still], GRID, tmp_path)
    assert [(walk.simulator.engine, walk.level) for walk in walks] == [
        *(("mujoco", level) for level in ("0", "0.2")),
        *(("mujoco-alone", level) for level in ("0", "0.2")),
    ]
    assert walks[0].forward == (0.0,) * 18
    np.testing.assert_allclose(walks[1].forward, 0.2 * SPEC.joint_values("torque_limit"))
    assert (walks[1].name, walks[1].cell[0]) == ("still+forward", "still+forward")


def test_a_virtual_robot_gets_what_its_own_bench_found_and_is_put_there_once(
    still: Bundle, tmp_path: Path, benches: list[str]
) -> None:
    """Two robots at one level, two commands: two benches, no third one later, and never the true friction."""
    base = replace(BASE, commands=("vx=0.5", "stand"))
    cfg = GridCfg(base, ("mujoco-alone+all",), robots=(3, 4), robot_levels=("0.1",), forward=("still",))
    walks = forward_walks([still], cfg, tmp_path)
    assert len(walks) == 4 and {walk.forward for walk in walks} == {tuple(float(n) for n in range(1, 19))}
    assert benches == [f"saturn_lite--mujoco--all--0.1--{seed}" for seed in (3, 4)]
    truth = 0.1 * SPEC.joint_values("torque_limit") * draw(SPEC, 3).friction.share
    assert not np.isclose(truth, walks[0].forward, rtol=1e-3).any()
    assert forward_walks([still], cfg, tmp_path) == walks and len(benches) == 2


def hide(monkeypatch: pytest.MonkeyPatch, *ends: str) -> None:
    """Let the bench of robot 4 identify no joint whose name has one of these endings."""
    make = bench_module.identify_on_bench

    def make_some(bench: Bench, folder: Path, workers: int) -> None:
        make(bench, folder, workers)
        if bench.case.seed == 4:
            joints = dict(load_joints(folder / "joints.json").joints)
            nothing = refused("it hardly moves")
            JointsFile({n: nothing if n.endswith(ends) else old for n, old in joints.items()}).write(
                folder / "joints.json"
            )

    monkeypatch.setattr(bench_module, "identify_on_bench", make_some)


@pytest.fixture
def hidden(monkeypatch: pytest.MonkeyPatch, benches: list[str]) -> None:
    """Let the bench of robot 4 identify no joint."""
    hide(monkeypatch, "")


@pytest.mark.parametrize(
    ("ends", "hips", "exceptions"),
    [
        (("ML_hip",), 0.0, "except ML_hip (mean of its kind): coulomb_friction of joint 'ML_hip' is null"),
        (("_hip",), None, "except FL_hip, FR_hip, ML_hip, MR_hip, RL_hip, RR_hip (none): "),
    ],
)
def test_a_joint_that_was_not_identified_is_fed_what_its_kind_has(
    ends: tuple[str, ...],
    hips: float | None,
    exceptions: str,
    still: Bundle,
    tmp_path: Path,
    benches: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Hips are joints 1, 4, 7, 10, 13 and 16 of the bench's 1 to 18 N m: (1 + 4 + 10 + 13 + 16)/5, and 0 of none."""
    hide(monkeypatch, *ends)
    cfg = GridCfg(BASE, ("mujoco-alone+all",), robots=(4,), robot_levels=("0.1",), forward=("still",))
    (walk,) = forward_walks([still], cfg, tmp_path)
    expected = np.arange(1.0, 19.0)
    expected[6] = (1 + 4 + 10 + 13 + 16) / 5
    if hips is None:
        expected[::3] = 0.0
    np.testing.assert_allclose(walk.forward, expected)
    (note,) = forward_notes([still], cfg, tmp_path)
    assert note.startswith(f"feed-forward on saturn_lite--mujoco--all--0.1--4 is as identified, {exceptions}")


def test_a_robot_that_cannot_be_identified_is_left_out_and_named(still: Bundle, tmp_path: Path, hidden: None) -> None:
    """The walks of an unidentified robot are left out, with a note; those of the other robots are made."""
    cfg = GridCfg(BASE, ("mujoco-alone+all",), robots=(3, 4), robot_levels=("0.1",), forward=("still",))
    assert forward_notes([still], cfg, tmp_path) == []
    assert {walk.robot for walk in forward_walks([still], cfg, tmp_path)} == {3}
    (warning,) = forward_notes([still], cfg, tmp_path)
    assert warning.startswith("feed-forward skipped on saturn_lite--mujoco--all--0.1--4, no joint was identified")
    assert "'FL_hip' is null" in warning and warning.endswith("it hardly moves")
    (tmp_path / "saturn_lite--mujoco--all--0.1--4" / "joints.json").write_text("half")
    with pytest.raises(StictionError, match=r"joints\.json"):
        forward_walks([still], cfg, tmp_path)


def test_a_policy_with_friction_fed_forward_is_walked_and_named_beside_the_other(still: Bundle, tmp_path: Path) -> None:
    """At 20 % the robot stands differently with feed-forward; at 0 % it is the same to the last digit."""
    done = walk_grid([still], GRID, tmp_path)
    rows, details = rows_of(done, [still])
    batch, alone = ([row for row in rows if row.engine == name] for name in ("mujoco", "mujoco-alone"))
    assert batch[0].joint_jitter == batch[2].joint_jitter != batch[3].joint_jitter
    assert [(row.policy, row.method, row.friction_level) for row in alone] == [
        *(("still", still.contract.method, level) for level in (0.0, 0.2)),
        *(("still+forward", f"{still.contract.method}+forward", level) for level in (0.0, 0.2)),
    ]
    assert len(rows) == 8 and details[-1]["method"].endswith("+forward")
    assert alone[0].joint_jitter == alone[2].joint_jitter
    assert alone[1].joint_jitter != alone[3].joint_jitter


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"base": replace(BASE, action_delay=0.01), "engines": ("mujoco",)}, "remove one"),
        ({"forward_by": ("error", "error=1")}, "each once"),
        ({"forward_by": ("sign",)}, "unknown way"),
        ({"forward": ("still", "still")}, "each once"),
        ({"base": replace(BASE, friction_law="load")}, "no torque that could be fed"),
    ],
)
def test_where_nothing_can_be_fed_forward_it_is_refused(changes: dict, message: str) -> None:
    """Rejects conditions without a torque to feed; the message names the remedy."""
    with pytest.raises(StictionError, match=message):
        replace(GRID, **changes)


def test_policies_that_are_not_there_or_compensate_are_refused(still: Bundle, tmp_path: Path) -> None:
    """Rejects unknown policies and policies with compensation before any walk."""
    with pytest.raises(StictionError, match="unknown policy 'walker'; known: still"):
        forward_walks([still], replace(GRID, forward=("walker",)), tmp_path)
    compensating = replace(still, contract=make_contract(compensation=(0.1,) * 18))
    with pytest.raises(StictionError, match="already compensates"):
        forward_walks([compensating], GRID, tmp_path)
