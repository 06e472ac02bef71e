"""Replay of a walk: files of others are read and refused, and friction that is right leaves no error."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiction.core.errors import FileError
from stiction.files.joints import Estimate, JointRecord
from stiction.robots.catalog import find_robot
from stiction_experiments.peers.walks import (
    BEFORE,
    STEP,
    UNITREE,
    WALKED,
    Friction,
    History,
    error_row,
    identified_friction,
    read_history,
    replay,
)

ROBOT = find_robot("go2")

STAND = np.tile([0.0, 0.8, -1.6], 4)
"""Angles of a Go2 that stands [rad]."""


def friction(level: float, name: str = "some") -> Friction:
    """Return the same dry friction of all joints [N m]."""
    return Friction(name, np.full(12, level), np.full(12, 0.1))


@pytest.fixture(scope="module")
def walk() -> History:
    """Return what a simulated Go2 with 1 N m of dry friction does while it treads on the spot at 2 Hz."""
    target_time = np.arange(-BEFORE - 0.02, WALKED + 0.1, 0.02)
    lift = np.where(target_time > 0, np.sin(4 * np.pi * target_time), 0.0)[:, None]
    target = STAND + 0.1 * lift * np.tile([0.0, 1.0, -2.0], 4) * np.repeat([1, -1, -1, 1], 3)
    blank = History("walk", "", np.array([-9.0, 9.0]), np.tile(STAND, (2, 1)), target_time, target)
    angles = replay(blank, ROBOT, friction(1.0))
    time = np.arange(-BEFORE, WALKED, STEP) + STEP
    return replace(blank, time=np.concatenate([[-BEFORE], time]), position=np.concatenate([STAND[None], angles]))


def test_right_friction_leaves_no_error(walk: History) -> None:
    """The friction with which a walk was made replays it; none is off by over ten milliradians."""
    assert error_row(walk, ROBOT, friction(1.0)).error < 1e-9
    bare = error_row(walk, ROBOT, Friction("none", np.zeros(12), np.zeros(12)))
    assert bare.error > 0.01
    # The mean square over all joints is that of their kinds.
    assert bare.error**2 == pytest.approx((bare.hip**2 + bare.thigh**2 + bare.calf**2) / 3)


def write(folder: Path, angles: np.ndarray, targets: np.ndarray, period: int = 10_000_000) -> Path:
    """Write a log of these angles and targets [rad], a row each `period` [ns], stamps from 1970."""
    stamps = 1_764_707_760_000_000_000 + period * np.arange(len(angles))
    tables = (("state", np.hstack([angles, np.zeros((len(angles), 24))])), ("command", targets))
    for name, table in tables:
        lines = [",".join([str(stamp), *map(repr, line)]) for stamp, line in zip(stamps.tolist(), table.tolist())]
        (folder / f"{name}_history.csv").write_text("\n".join(lines) + "\n")
    return folder


def test_a_log_is_read_from_its_first_step_on(tmp_path: Path) -> None:
    """Targets that first move in row 200 of 10 ms put the walk's zero there, to the nanosecond."""
    targets = np.tile(np.arange(12.0), (600, 1))
    targets[200:, 3] += 0.1
    history = read_history(write(tmp_path, targets + 0.5, targets), ROBOT)
    assert history.time[200] == 0.0 and history.time[0] == pytest.approx(-2.0, abs=1e-9)
    order = [UNITREE.index(name.removesuffix("_joint")) for name in ROBOT.joint_names]
    assert history.position[0].tolist() == (np.array(order) + 0.5).tolist()


@pytest.mark.parametrize(
    ("moved", "rows", "text", "message"),
    [
        (None, 600, "", "never move"),
        (5, 600, "", "expected -1 to 3.5 s"),
        (200, 600, "1,2,nan\n", "number of columns|expected numbers"),
    ],
)
def test_what_is_no_walk_is_refused(tmp_path: Path, moved: int | None, rows: int, text: str, message: str) -> None:
    """Targets at rest, a walk without the stand before it, and rows of other lengths."""
    targets = np.zeros((rows, 12))
    targets[moved if moved is not None else rows :] += 0.1
    folder = write(tmp_path, targets, targets)
    if text:
        (folder / "state_history.csv").write_text("1,2\n" + text)
    with pytest.raises(FileError, match=message):
        read_history(folder, ROBOT)


def test_friction_in_the_air_is_less_the_damping_of_the_controller() -> None:
    """(B + k kd)/k of 1.7 under kd 1.5 leaves 0.2 N m s/rad."""

    def estimate(value: float) -> Estimate:
        return Estimate(value, 0.01, (value - 0.02, value + 0.02))

    record = JointRecord(kd=1.5, combinations={"f/k": estimate(0.3), "(B + k·kd)/k": estimate(1.7)})
    names = [name.removesuffix("_joint") for name in ROBOT.joint_names]
    joints = identified_friction(dict.fromkeys(names, record), ROBOT)
    assert joints.dry == pytest.approx(0.3) and joints.viscous == pytest.approx(0.2)
