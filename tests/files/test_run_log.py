"""The log of a run: whole parts, merged parts, a log that ended in the middle, and what identification gets of it."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deployed import CONTRACT, JOINTS, STANDING, state
from stiction.core.errors import FileError, LogError
from stiction.deploy.control import JointCommand, Limited
from stiction.deploy.runtime.channel import Channel, row_layout, socket_pair, targets_layout
from stiction.deploy.runtime.recorder import Parts, Rows, record
from stiction.deploy.runtime.runtime import row
from stiction.deploy.runtime.supervisor import Out, Stage
from stiction.files.run_log import (
    READINGS,
    RunLogHeader,
    check_empty,
    find_run_log,
    is_walk_log,
    joint_log,
    parts_of,
    read_run_log,
    read_walk_log,
    walk_log,
    write_run_header,
)
from stiction.files.tables import publish_npz
from stiction.identification.logs.opening import open_log

HEADER = RunLogHeader(
    robot="saturn_lite",
    joint_names=CONTRACT.joint_names,
    foot_names=tuple(f"foot_{n}" for n in range(6)),
    period=0.002,
    control_period=0.02,
    kp=CONTRACT.kp,
    kd=CONTRACT.kd,
    torque_limit=CONTRACT.torque_limit,
    policy="test",
    digest="0" * 64,
    armed=True,
)
ROWS, STEPS = row_layout(JOINTS, 6), targets_layout(CONTRACT)


def logged(number: int, stage: Stage = Stage.RUN) -> dict[str, object]:
    """Return the row of a reading whose every signal tells its number."""
    reading = state(number, 0.002 * number, joint_position=STANDING + 1e-3 * number)
    target = STANDING + 2e-3 * number
    command = JointCommand(target, np.array(HEADER.kp), np.array(HEADER.kd), np.full(JOINTS, 0.01 * number))
    out = Out(stage, command, target + 1.0, Limited(target, np.full(JOINTS, 2)))
    return row(reading, np.full(JOINTS, 0.5 * number), out, np.array([0.5, 0.0, 0.0]))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a log of 1000 readings, the first 100 of standing up, and 90 steps, written by the logger itself."""
    write_run_header(tmp_path, HEADER)
    ours, theirs = socket_pair()
    rows = Rows(Channel(ours, ROWS), ROWS)
    for number in range(1000):
        rows.reading(100.0 + 0.002 * number, logged(number, Stage.STAND if number < 100 else Stage.RUN))
        if number % 10 == 0 and number >= 100:
            rows.send(STEPS.pack(number, 100.0 + 0.002 * number, {"target": STANDING, "mode": 1.0}))
    rows.end()
    record(tmp_path, theirs, ROWS, STEPS, 10_000)
    assert rows.lost == 0
    ours.close()
    theirs.close()
    return tmp_path


def test_a_run_is_read_back_row_by_row(folder: Path) -> None:
    """A reading is lost, doubled, or another joint's."""
    log = read_run_log(folder)
    assert log.header == HEADER and log.notes == ()
    assert len(log.readings["time"]) == 1000 and len(log.steps["time"]) == 90
    np.testing.assert_allclose(log.readings["position"][:, 4], STANDING[4] + 1e-3 * np.arange(1000), atol=1e-6)
    np.testing.assert_allclose(log.readings["limited_by"], 2.0)
    np.testing.assert_allclose(log.readings["requested"] - log.readings["target"], 1.0, atol=1e-5)


def test_identification_gets_the_run_itself(folder: Path) -> None:
    """Standing up is taken for the run, or gains and limits are another joint's."""
    log = read_run_log(folder)
    joints = joint_log("run", log)
    assert len(joints.time) == 900 and joints.time[0] == 0.0
    name = CONTRACT.joint_names[5]
    signals, setup = joints.joints[name], joints.setup_of(name)
    assert (setup.kp, setup.kd, setup.torque_limit) == (CONTRACT.kp[5], CONTRACT.kd[5], CONTRACT.torque_limit[5])
    assert signals.torque is not None and signals.torque[0] == pytest.approx(50.0)
    walk = walk_log(log)
    assert walk.header.kp == CONTRACT.kp and len(walk) == 900
    assert walk.foot_contact is not None and walk.foot_contact.dtype == bool
    np.testing.assert_allclose(walk.velocity_command, np.tile([0.5, 0.0, 0.0], (900, 1)), atol=1e-7)  # type: ignore[arg-type]


def test_friction_fed_forward_is_a_target_ahead_to_identification(folder: Path) -> None:
    """1 N m at kp = 100 N m/rad is a target 0.01 rad ahead; an older log without the column was fed nothing."""
    log = read_run_log(folder)
    np.testing.assert_allclose(log.readings["forward"][100], 1.0, atol=1e-6)
    np.testing.assert_allclose(walk_log(log).joint_target[0], STANDING + 0.2 + 0.01, atol=1e-6)
    for part in folder.glob("readings-*.npz"):
        publish_npz(part, {name: values for name, values in np.load(part).items() if name != "forward"})
    np.testing.assert_allclose(read_walk_log(folder).joint_target[0], STANDING + 0.2, atol=1e-6)


def test_a_run_is_opened_by_its_folder_as_what_it_is(folder: Path) -> None:
    """`identify RUN` takes a played motion for a walk, a walk for a motion, or only the folder within."""
    run = folder.parent / "run"
    run.mkdir()
    folder.rename(run / "log")
    assert is_walk_log(run) and is_walk_log(run / "log") and find_run_log(run) == run / "log"
    assert len(read_walk_log(run)) == 900
    write_run_header(run / "log", replace(HEADER, policy="", digest=""))
    assert not is_walk_log(run)
    assert set(open_log(run).joints) == set(CONTRACT.joint_names)
    assert len(open_log(run, begin=0.5).time) == 650
    with pytest.raises(LogError, match="a log of a run, which says it itself; leave names out"):
        open_log(run, names=("a",))
    assert not is_walk_log(folder / "nothing") and find_run_log(folder) is None


def test_a_walk_is_the_longest_part_without_a_gap(folder: Path) -> None:
    """Readings that the supervisor had no time for are bridged, and a velocity is made of the jump."""
    log = read_run_log(folder)
    keep = np.ones(1000, dtype=bool)
    keep[[300, 700]] = False
    readings = {name: values[keep] for name, values in log.readings.items()}
    walk = walk_log(replace(log, readings=readings))
    assert len(walk) == 399
    np.testing.assert_allclose(walk.joint_position[0, 0], STANDING[0] + 0.301, atol=1e-6)


def test_a_minute_becomes_one_file_and_covered_parts_do_not_count(tmp_path: Path) -> None:
    """A merged minute and a part that a crash left beside it count twice."""
    write_run_header(tmp_path, HEADER)
    parts = Parts(tmp_path, READINGS, ROWS, 10_000)
    copied = tmp_path.parent / "kept.npz"
    for number in range(121):
        parts.add(float(number), ROWS.unpack(ROWS.pack(1, 0.0, logged(number))).values)  # type: ignore[union-attr]
        parts.flush()
        if number == 5:
            shutil.copy(tmp_path / "readings-000005-000005.npz", copied)
    shutil.copy(copied, tmp_path / "readings-000005-000005.npz")
    names = sorted(path.name for path in tmp_path.glob("*.npz"))
    assert names == ["readings-000000-000119.npz", "readings-000005-000005.npz", "readings-000120-000120.npz"]
    assert [name for *_, name in parts_of(names, READINGS)] == [names[0], names[2]]
    np.testing.assert_array_equal(read_run_log(tmp_path).readings["time"], np.arange(121.0))


def test_the_oldest_parts_go(tmp_path: Path) -> None:
    """A robot's disk fills up."""
    parts = Parts(tmp_path, READINGS, ROWS, keep=7)
    for number in range(30):
        parts.add(float(number), np.zeros(ROWS.size))
        parts.flush()
    kept = parts_of((path.name for path in tmp_path.iterdir()), READINGS)
    assert [first for first, *_ in kept] == list(range(23, 30))


def test_a_gap_is_said_and_damage_refused(folder: Path) -> None:
    """A log that lacks half a second is taken for whole; a part that is there twice, or a cut one, is read."""
    (first,) = sorted(folder.glob("readings-*.npz"))
    log = read_run_log(folder)
    with np.load(first) as arrays:
        later = {name: arrays[name] for name in arrays.files}
    extra = folder / "readings-000009-000009.npz"
    shutil.copy(first, extra)
    with pytest.raises(LogError, match="not in the order of their time"):
        read_run_log(folder)
    np.savez(extra, **later | {"time": later["time"] + 4.5})
    longer = read_run_log(folder)
    assert longer.notes == ("8 half seconds of the log's readings are not there",)
    assert len(longer.readings["time"]) == 2000
    content = first.read_bytes()
    extra.write_bytes(content[: len(content) // 2])
    with pytest.raises(LogError):
        read_run_log(folder)
    np.savez(extra, time=np.zeros(3), position=np.zeros((3, 2)))
    with pytest.raises(LogError, match="differ"):
        read_run_log(folder)
    extra.unlink()
    assert len(read_run_log(folder).readings["time"]) == len(log.readings["time"])
    (folder / "log.json").write_text('{"schema": "something else"}')
    with pytest.raises(LogError, match="stiction-run-log"):
        read_run_log(folder)


def test_two_runs_do_not_share_a_log(tmp_path: Path) -> None:
    """A second run writes into the log of the first."""
    write_run_header(tmp_path, replace(HEADER, armed=False))
    with pytest.raises(FileError, match="already"):
        check_empty(tmp_path)
