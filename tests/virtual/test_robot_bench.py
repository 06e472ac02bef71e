"""The bench: what its log is, and that identification finds the robot in it."""

from pathlib import Path

import numpy as np
import pytest

from hinges import Hinges
from stiction.files.joints import JointsFile
from stiction.files.log import read_setup, write_log
from stiction.identification.logs import open_log
from stiction.identification.pipeline import identify_joint
from stiction.robots.catalog import find_robot
from stiction.task.randomization import identified_joints
from stiction.virtual.bench import MOTION, BenchCfg, bench_log
from stiction.virtual.cases import Case, parse_level
from stiction.virtual.hidden import draw
from stiction.virtual.trial import World

SPEC = find_robot("saturn_lite")


def bench(kind, case: Case, cfg: BenchCfg, seed: int = 0):
    """Return the log of a robot on its bench, in an engine of some kind."""
    return bench_log(World(kind).on_bench(case, SPEC, np.random.default_rng(seed)).handle, SPEC, cfg)


def test_the_log_holds_what_a_person_could_have_logged_and_nothing_of_the_truth(tmp_path: Path) -> None:
    """Robots of different seeds have the same sidecar, byte for byte, and columns that every robot has."""
    sidecars = []
    for seed in (1, 2):
        log = bench(Hinges, Case(seed, "all", parse_level("bench+0.02")), BenchCfg(("shank",), 4.0))
        write_log(tmp_path / f"{seed}.npz", log)
        sidecars.append((tmp_path / f"{seed}.json").read_bytes())
        read = open_log(tmp_path / f"{seed}.npz")
        assert set(read.joints) == {name for name in SPEC.joint_names if name.endswith("shank")}
        with np.load(tmp_path / f"{seed}.npz") as arrays:
            assert {name.partition(".")[0] for name in arrays} == {"time", "position", "velocity", "target", "torque"}
    assert sidecars[0] == sidecars[1]
    setup = read_setup(tmp_path / "1.npz").of_joint("FL_shank")
    assert (setup.torque_limit, setup.kp, setup.kd) == (45.0, 100.0, 2.5)
    assert (setup.torque_source, setup.test_condition, setup.axis) == ("motor_side", "in_air", "rotary")


def test_only_the_kind_that_is_logged_is_moved_and_it_follows_its_target() -> None:
    """Torque of a row is what acts from that row on, angle what was known when its target was sent."""
    robot = World(Hinges).on_bench(Case(0, "nominal", parse_level("0")), SPEC, np.random.default_rng(0))
    seen: list[np.ndarray] = []
    inner = robot.handle.exchange

    class Spy:
        joint_names, period, read = robot.handle.joint_names, robot.handle.period, robot.handle.read

        def exchange(self, command):
            seen.append(command.target)
            return inner(command)

    log = bench_log(Spy(), SPEC, BenchCfg(("thigh",), 4.0))
    targets, standing = np.array(seen), SPEC.joint_values("default_position")
    moved = np.ptp(targets, axis=0) > 0
    assert [name.partition("_")[2] for name, yes in zip(SPEC.joint_names, moved, strict=True) if yes] == ["thigh"] * 6
    np.testing.assert_allclose(targets[0], standing)
    signals = log.joints["MR_thigh"]
    assert len(log.time) == 2000 and np.ptp(signals.target) > 1.8 * MOTION.slow_amplitude
    assert np.sqrt(np.mean((signals.position - signals.target) ** 2)) < 0.1 * np.ptp(signals.target)
    # (M + I) q'' + B q' over one period, by differences of what was logged.
    step = robot.handle.period
    speed, change = signals.velocity[:-1], np.diff(signals.velocity) / step
    np.testing.assert_allclose((0.01 + 0.0145) * change + 0.0704 * speed, signals.torque[:-1], atol=0.03)


def test_friction_and_inertia_are_found_where_they_were_put() -> None:
    """In MuJoCo, with real sensors and delays: else training would start from joints that are not the robot's."""
    pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed for the bench")
    from stiction.engines.mujoco_engine import MujocoEngine
    from stiction.sim.fleet import Fleet

    log = bench(MujocoEngine, Case(3, "friction+sensors+delays", parse_level("0.05")), BenchCfg(("shank",), 8.0))
    links, limit = Fleet(SPEC, 1).link_inertia(), SPEC.joint_values("torque_limit")
    for name in ("FL_shank", "ML_shank", "RR_shank"):
        record = identify_joint(log, name).record
        true = 0.05 * 45.0 * draw(SPEC, 3).friction.share[SPEC.joint_names.index(name)]
        low, high = record.coulomb_friction.interval95
        assert low <= true <= high and high - low < 0.05 * true
        assert record.friction_ratio.value == pytest.approx(true / 45.0, rel=0.02)
        assert record.inertia.value == pytest.approx(0.0145 + links[2], rel=0.05)
    trained = identified_joints(JointsFile({"RR_shank": record}), SPEC.joint_names, links, limit)
    assert trained.frictionloss[-1] == record.coulomb_friction.value and trained.frictionloss[2] is None
    assert trained.armature[-1] == pytest.approx(0.0145, rel=0.1)


def test_a_robot_without_friction_is_identified_as_one_without() -> None:
    """Cells without friction could not be benched: their estimates scatter about zero, and half of them are below."""
    pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed for the bench")
    from stiction.engines.mujoco_engine import MujocoEngine

    log = bench(MujocoEngine, Case(3, "sensors+delays", parse_level("0")), BenchCfg(("shank",), 5.0))
    records = [identify_joint(log, name).record for name in log.joints]
    inside = [r.coulomb_friction.interval95[0] <= 0 <= r.coulomb_friction.interval95[1] for r in records]
    assert sum(inside) >= 5 and min(r.coulomb_friction.value for r in records) < 0
    assert all(abs(r.friction_ratio.value) < 1e-3 for r in records)
    assert all("friction_reaches_zero" in {one.reason for one in r.objections} for r in records if r.objections)
    assert sum(bool(r.objections) for r in records) >= 5
