"""Fitting an Actuator Net to logs: what is refused, how runs are split, and what the errors are of."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to fit a net")

from stiction.core.errors import StictionError
from stiction.files.actuator import FILE, read_actuator
from stiction.files.log import JointSignals, Log, LogSetup, write_log
from stiction.files.walk import WalkHeader, WalkLog, write_walk
from stiction.joints.net import ActuatorCfg, predict
from stiction.learning.actuator import train_actuator, write_trained
from stiction.learning.actuator_data import check_runs, read_run, split_runs
from stiction.report.training import lead, write_actuator_page

HEADER = WalkHeader(
    robot="saturn_lite",
    joint_names=("FL_hip", "FL_shank", "FR_hip", "FR_shank"),
    foot_names=(),
    period=0.005,
    kp=(100.0,) * 4,
    kd=(2.5,) * 4,
    torque_limit=(25.0, 45.0, 25.0, 45.0),
    torque_source="motor_side",
    command="vx=-0.5",
)

CFG = ActuatorCfg(hidden=(8,), epochs=2, batch=64)


def write_run(path: Path, seed: int, samples: int = 60, **changes) -> Path:
    """Write a walking log whose torque is the PD law's, with some fields of its header changed; return its path."""
    generator = np.random.default_rng(seed)
    error, velocity = 0.05 * generator.standard_normal((samples, 4)), generator.standard_normal((samples, 4))
    log = WalkLog(
        header=replace(HEADER, **changes),
        time=np.arange(samples) * changes.get("period", 0.005),
        joint_position=np.zeros((samples, 4)),
        joint_velocity=velocity,
        joint_target=error,
        joint_torque=100 * error - 2.5 * velocity,
        angular_velocity=np.zeros((samples, 3)),
        quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (samples, 1)),
    )
    write_walk(path, log)
    return path


def test_a_log_that_does_not_say_where_torque_was_measured_is_refused(tmp_path: Path) -> None:
    """Friction would be counted twice or not at all, and nothing would look wrong."""
    with pytest.raises(StictionError, match=r"not declared.*torque_source, or log with evaluate --log-torque"):
        read_run(write_run(tmp_path / "walk.npz", 0, torque_source=None))
    old = write_run(tmp_path / "old.npz", 0)
    with np.load(old) as archive:
        content = {name: archive[name] for name in archive.files}
    header = json.loads(str(content["header"]))
    del header["torque_source"]
    np.savez(old, **content | {"header": np.array(json.dumps(header))})
    with pytest.raises(StictionError, match="not declared"):
        read_run(old)


def test_runs_are_split_whole(tmp_path: Path) -> None:
    """Windows of one run overlap: one in both parts would flatter the net. The order of the files does not matter."""
    runs = [read_run(write_run(tmp_path / f"{index}.npz", index)) for index in range(8)]
    training, validation = split_runs(runs, 0.25, seed=0)
    names = {run.name for run in training}, {run.name for run in validation}
    assert (len(training), len(validation)) == (6, 2) and not names[0] & names[1]
    again = split_runs(runs[::-1], 0.25, seed=0)
    assert [run.name for run in again[1]] == [run.name for run in validation]
    assert any({run.name for run in split_runs(runs, 0.25, seed)[1]} != names[1] for seed in range(1, 6))
    for share, kept in ((0.01, 1), (0.99, 7)):
        assert len(split_runs(runs, share, 0)[1]) == kept
    with pytest.raises(StictionError, match="at least two runs"):
        split_runs(runs[:1], 0.25, 0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"period": 0.004}, r"period 0\.004 s, a\.npz: 0\.005 s"),
        ({"torque_source": "output_side"}, "torque_source output_side, a.npz: motor_side"),
        ({"robot": "go1"}, "robot go1"),
        ({"kp": (90.0,) * 4}, "another kp"),
        ({"joint_names": ("a", "b", "c", "d")}, "other joints"),
    ],
)
def test_runs_that_disagree_are_refused(tmp_path: Path, change: dict, message: str) -> None:
    """One net has one period, one side and one controller."""
    runs = [read_run(write_run(tmp_path / "a.npz", 0)), read_run(write_run(tmp_path / "b.npz", 1, **change))]
    with pytest.raises(StictionError, match=message):
        check_runs(runs, 3)


def test_a_run_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    """A copy under another name could be fitted and kept out at once."""
    first = write_run(tmp_path / "a.npz", 0)
    copy = tmp_path / "copy.npz"
    copy.write_bytes(first.read_bytes())
    with pytest.raises(StictionError, match="there twice"):
        check_runs([read_run(first), read_run(copy)], 3)
    with pytest.raises(StictionError, match="8 samples for a history of 3"):
        check_runs([read_run(write_run(tmp_path / "short.npz", 1, samples=8))], 3)


def test_a_canonical_log_is_a_run(tmp_path: Path) -> None:
    """Joints that were logged on a bench, gains and side in the sidecar; an undeclared side is refused too."""
    signals = {name: np.full(50, value) for name, value in (("position", 0.0), ("velocity", 1.0), ("target", 0.1))}
    joints = {name: JointSignals(**signals, torque=np.full(50, 7.5)) for name in ("hip", "shank")}
    setup = LogSetup(kp=100.0, kd=2.5, torque_limit=25.0, torque_source="output_side")
    write_log(tmp_path / "swing.csv", Log("swing", np.arange(50) * 0.002, joints, setup))
    run = read_run(tmp_path / "swing.csv")
    assert (run.joint_names, run.period, run.torque_source) == (("hip", "shank"), 0.002, "output_side")
    assert run.kd.tolist() == [2.5, 2.5] and run.torque.shape == (50, 2)
    write_log(tmp_path / "mute.csv", Log("mute", np.arange(50) * 0.002, joints, replace(setup, torque_source=None)))
    with pytest.raises(StictionError, match=r"not declared.*mute\.json"):
        read_run(tmp_path / "mute.csv")
    write_log(tmp_path / "bare.csv", Log("bare", np.arange(50) * 0.002, joints, replace(setup, kp=None)))
    with pytest.raises(StictionError, match="no kp of joint 'hip'"):
        read_run(tmp_path / "bare.csv")


def test_what_is_trained_says_what_it_was_trained_on(tmp_path: Path) -> None:
    """Period, side, hashes, split, errors; the law of a PD log errs by nothing; the same runs give the same net."""
    runs = [read_run(write_run(tmp_path / f"{index}.npz", index)) for index in range(4)]
    trained = train_actuator(runs, CFG, "a command")
    net, summary = trained.net, trained.summary
    assert (net.period, net.torque_source, net.robot) == (0.005, "motor_side", "saturn_lite")
    assert net.groups == (("FL_hip", "FR_hip"), ("FL_shank", "FR_shank"))
    assert sorted([*net.training, *net.validation]) == ["0.npz", "1.npz", "2.npz", "3.npz"] and len(net.validation) == 1
    assert net.training | net.validation == {run.name: run.sha256 for run in runs}
    (kept,) = [run for run in runs if run.name in net.validation]
    squares = (predict(net, *kept.signals) - kept.torque[net.history :]) ** 2 / kept.torque_limit**2
    assert summary["rmse"]["validation"]["net"] == pytest.approx(np.sqrt(squares.mean()), rel=1e-9)
    assert summary["rmse"]["validation"]["baseline"] < 1e-6 < summary["rmse"]["validation"]["net"]
    assert summary["commands"]["vx=-0.5"]["training"]["net"] == pytest.approx(summary["rmse"]["training"]["net"])
    assert summary["joints"]["FL_shank"]["coulomb"] == pytest.approx(0.0, abs=1e-5)
    assert "which is then the better model" in lead(summary)
    write_trained(tmp_path / "net", trained)
    again = train_actuator(runs[::-1], CFG, "a command")
    write_trained(tmp_path / "again", again)
    assert (tmp_path / "net" / FILE).read_bytes() == (tmp_path / "again" / FILE).read_bytes()
    assert read_actuator(tmp_path / "net").loss == net.loss
    page = write_actuator_page(tmp_path / "net").read_text()
    assert "keeps its own" in page and "FR_shank" in page and next(iter(net.validation)) in page
