"""A log of a robot of mjlab, identified: the friction that was put in comes back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("mjlab", reason="the package mjlab is not installed here; `make test-mjlab` makes its environment")

import numpy as np
from mjlab.managers.recorder_manager import RecorderTermCfg

import stiction
from mjlab_leg import KD, KP, PERIOD, leg_cfg, made
from motors import motor, number
from stiction.core.errors import StictionError
from stiction.files.joints import JointsFile
from stiction.mjlab import StictionLog, with_joints


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("friction", ["moving", "law"])
def test_what_was_put_in_is_identified_from_the_log(tmp_path: Path, friction: str) -> None:
    """Friction of both joints lies in its 95 % interval, from CSV with what that rounds.

    Put in as MuJoCo's one number, and by the law at each physics step, where the hip has 1.6 N m at rest.
    """
    hip = motor(coulomb_friction=number(1.1), viscous_friction=number(0.2))
    if friction == "law":
        hip = replace(hip, static_friction=number(1.6), stribeck_velocity=number(0.3))
    JointsFile({"shank": motor(coulomb_friction=number(0.442)), "hip": hip}).write(tmp_path / "joints.json")
    cfg = with_joints(leg_cfg(), tmp_path / "joints.json", friction=friction)
    assert friction == "moving" or "friction_law" in cfg.events
    paths = [tmp_path / "leg.csv", tmp_path / "leg.npz"]
    for path in paths:
        params = {"path": path, "test_condition": "bare_motor"}
        cfg.recorders[path.name] = RecorderTermCfg(func=StictionLog, params=params)
    env = made(cfg)
    for time in np.arange(400) * 4 * PERIOD:
        slow, fast = 0.6 * np.sin(2 * np.pi * 0.4 * time), 0.2 * np.sin(2 * np.pi * 1.7 * time)
        env.step(env.sim.data.qpos.new_full((2, 2), slow + fast))
    env.close()
    log, other = (stiction.load_log(path) for path in paths)
    assert len(log.time) == 1600 and log.time[1] == PERIOD
    np.testing.assert_allclose(other.joints["hip_joint"].torque, log.joints["hip_joint"].torque, rtol=1e-6)
    setup = log.setup_of("shank_joint")
    assert (setup.kp, setup.kd, setup.torque_limit, setup.torque_source) == (KP, KD, 45.0, "motor_side")
    result = stiction.identify(log)
    for name, dry, viscous in (("shank_joint", 0.442, 0.07), ("hip_joint", 1.1, 0.2)):
        record = result[name]
        known = {"coulomb_friction": dry, "viscous_friction": viscous}
        if friction == "law" and name == "hip_joint":
            known["static_friction"] = 1.6
        for quantity, put_in in known.items():
            low, high = getattr(record, quantity).interval95
            # Where rest and motion are told apart, what brakes in motion is known less well.
            assert low <= put_in <= high, (name, quantity, low, high)
            assert high - low < (0.4 if "static_friction" in known else 0.06) * put_in, (name, quantity, low, high)
        # implicitfast takes the speed of the end of a step for kd; a torque that is computed has that of its begin.
        integrator = (0.5 if friction == "moving" else -0.5) * KD * PERIOD
        assert record.inertia.value == pytest.approx(0.03 + 0.0045 + integrator, rel=0.02), name
        assert not record.objections


def test_the_target_is_the_one_that_the_actuator_got(tmp_path: Path) -> None:
    """Two steps late: kp (target - angle) - kd speed is then the torque; a lag that varies has no one target."""
    cfg = leg_cfg(decimation=1)
    for actuator in cfg.scene.entities["robot"].articulation.actuators:
        actuator.delay_min_lag = actuator.delay_max_lag = 2
    cfg.recorders["log"] = RecorderTermCfg(func=StictionLog, params={"path": tmp_path / "leg.npz"})
    env = made(cfg)
    rng = np.random.default_rng(0)
    for _ in range(40):
        env.step(env.sim.data.qpos.new_tensor(0.3 * rng.standard_normal((2, 2))))
    env.close()
    joint = stiction.load_log(tmp_path / "leg.npz").joints["shank_joint"]
    np.testing.assert_allclose(
        joint.torque[3:], (KP * (joint.target - joint.position) - KD * joint.velocity)[3:], atol=1e-3
    )
    cfg.scene.entities["robot"].articulation.actuators[0].delay_min_lag = 0
    with pytest.raises(StictionError, match=r"joint 'hip_joint': got a command delay that varies"):
        made(cfg)


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    """Before anything is simulated."""
    for params, message in (
        ({"path": tmp_path / "leg.mcap"}, r"got leg.mcap, expected a file that ends in .csv, .npz, .parquet"),
        ({"path": tmp_path / "leg.csv", "world": 2}, r"got world 2, expected 0 to 1"),
        ({"path": tmp_path / "leg.csv", "seconds": 0.0}, r"got 0.0 seconds, expected a positive number"),
    ):
        cfg = leg_cfg()
        cfg.recorders["log"] = RecorderTermCfg(func=StictionLog, params=params)
        with pytest.raises(StictionError, match=message):
            made(cfg)


def test_a_log_ends_where_its_robot_is_reset(tmp_path: Path) -> None:
    """A log ends at a reset; a log that is long enough is written before the environment closes."""
    cfg = leg_cfg(decimation=2)
    paths = [tmp_path / "reset.csv", tmp_path / "logs" / "long.csv"]
    for path, seconds in zip(paths, (60.0, 0.05), strict=True):
        params = {"path": path, "seconds": seconds, "world": 1}
        cfg.recorders[path.stem] = RecorderTermCfg(func=StictionLog, params=params)
    env = made(cfg)
    for _ in range(10):
        env.step(env.sim.data.qpos.new_zeros(2, 2))
    assert paths[1].exists() and not paths[0].exists()
    assert stiction.load_log(paths[1]).setup_of("hip_joint").test_condition == "in_air"
    env.reset()
    assert paths[0].exists()
    env.step(env.sim.data.qpos.new_zeros(2, 2))
    env.close()
    assert [len(stiction.load_log(path).time) for path in paths] == [20, 10]
