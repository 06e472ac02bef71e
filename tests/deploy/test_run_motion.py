"""A designed motion as the source of a run's targets."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deployed import CONTRACT, SHORT, STANDING, Run
from stiction.core.errors import LogError
from stiction.deploy.runtime.motion import Motion
from stiction.deploy.runtime.report import Timing, summary
from stiction.deploy.runtime.supervisor import Stage

KIND = "hip"
HIPS = [number for number, kind in enumerate(CONTRACT.kinds) if kind == KIND]


def write(path: Path, text: str, **sidecar: float) -> Path:
    """Write a trajectory and its sidecar."""
    path.write_text(text)
    if sidecar:
        path.with_suffix(".json").write_text(json.dumps(sidecar))
    return path


def test_all_joints_of_a_kind_move_and_the_others_stand(tmp_path: Path) -> None:
    """The motion moves another joint, at the gains of training in place of the design's."""
    file = write(tmp_path / "trajectory.csv", f"time,target.{KIND}\n0,0.1\n0.5,0.3\n1,0.1\n", kp=20.0, kd=0.5)
    motion = Motion(file, CONTRACT)
    assert motion.seconds == 1.0
    for elapsed, angle in ((0.0, 0.1), (0.25, 0.2), (0.5, 0.3), (0.75, 0.2), (9.0, 0.1)):
        expected = STANDING.copy()
        expected[HIPS] = angle
        np.testing.assert_allclose(motion.target(elapsed), expected, atol=1e-12)
    assert (motion.kp[HIPS] == 20.0).all() and (motion.kd[HIPS] == 0.5).all()
    others = np.setdiff1d(np.arange(CONTRACT.num_joints), HIPS)
    np.testing.assert_array_equal(motion.kp[others], CONTRACT.array("kp")[others])


def test_a_run_plays_the_motion_from_its_first_target_to_its_end(tmp_path: Path) -> None:
    """The robot jumps to the motion's start, or the motion goes on for ever."""
    file = write(tmp_path / "trajectory.csv", f"time,target.{KIND}\n0,0.2\n0.4,0.4\n", kp=20.0)
    run = Run(SHORT, Motion(file, CONTRACT)).until(Stage.DONE)
    played = [out for out in run.outs if out.stage is Stage.RUN]
    assert len(played) == pytest.approx(200, abs=3)
    assert played[0].command is not None and played[-1].command is not None
    assert played[0].command.target[HIPS[0]] == pytest.approx(0.2, abs=0.01)
    assert played[-1].command.target[HIPS[0]] == pytest.approx(0.4, abs=0.01)
    assert played[0].command.kp[HIPS[0]] == 20.0
    assert all(out.command is None or not out.command.kp.any() for out in run.outs if out.stage is Stage.DAMP)


@pytest.mark.parametrize(
    ("duration", "played", "end"),
    [
        (0.1, 0.1, "done: the first 0.1 s of a motion of 0.4 s, cut by --duration"),
        (1.0, 0.4, "done: a motion of 0.4 s"),
        (None, 0.4, "done: a motion of 0.4 s"),
    ],
)
def test_a_motion_ends_with_the_smaller_of_its_length_and_the_duration(
    tmp_path: Path, duration: float | None, played: float, end: str
) -> None:
    """A motion ends with the smaller of its length and the duration, and the report names the cut."""
    file = write(tmp_path / "trajectory.csv", f"time,target.{KIND}\n0,0.2\n0.4,0.4\n")
    run = Run(replace(SHORT, duration=duration), Motion(file, CONTRACT)).until(Stage.DONE)
    outs = [out for out in run.outs if out.stage is Stage.RUN]
    assert len(outs) == pytest.approx(played / 0.002, abs=3)
    assert all(out.command is None or not out.command.kp.any() for out in run.outs if out.stage is Stage.DAMP)
    report = summary(run.supervisor, Timing(), {})
    assert report["end"] == end and report["motion"] == pytest.approx({"seconds": 0.4, "played": played})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,target.hip\n0,0\n1,3.0\n", "limits"),
        ("time,target.hip\n0,0\n1,nan\n", "limits"),
        ("time,target.elbow\n0,0\n1,0.1\n", "unknown joint 'elbow'"),
        ("time,position.hip\n0,0\n1,0.1\n", "no target"),
        ("target.hip\n0\n0.1\n", "time"),
        ("time,target.hip\n0,0\n0,0.1\n", "time must increase"),
        ("time,target.hip\n0,0\n9999,0.1\n", "end before 1800 s"),
    ],
)
def test_what_is_no_motion_of_this_robot_is_refused(tmp_path: Path, text: str, message: str) -> None:
    """A trajectory of another joint, in degrees, or cut off, is played."""
    with pytest.raises(LogError, match=message):
        Motion(write(tmp_path / "trajectory.csv", text), CONTRACT)
