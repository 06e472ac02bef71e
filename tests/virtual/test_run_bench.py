"""The loop's first half on a clock of its own: a motion under the supervisor, its log, and the friction in it."""

from __future__ import annotations

import json
import socket
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stiction.cli import loop
from stiction.cli.loop import JointRow, compared, friction_in, shares
from stiction.core.errors import FileError, StictionError
from stiction.deploy.runtime.channel import row_layout
from stiction.deploy.runtime.config import SupervisorCfg
from stiction.deploy.runtime.motion import Motion
from stiction.deploy.runtime.runtime import row
from stiction.deploy.runtime.supervisor import Supervisor
from stiction.deploy.transports.udp import LOOPBACK, UdpLink
from stiction.files.bundle import find_bundle, read_bundle
from stiction.files.joints import Estimate, Finding, JointRecord, JointsFile
from stiction.files.run_log import RunLog, RunLogHeader, joint_log
from stiction.identification.pipeline import identify_log
from stiction.robots.catalog import find_robot
from stiction.virtual.hidden import draw
from stiction.virtual.robot import PERIOD
from stiction.virtual.serve import RobotProcess, VirtualCfg

ROBOT = find_robot("saturn_lite")
CONTRACT = read_bundle(find_bundle(Path("saturn_lite-flat-none-0.2"))).contract
SEED, JOINT = 3, "FL_shank"


def played(tmp_path: Path) -> RunLog:
    """Return the log of 7 s in which all shanks of a robot on its stand move, first slowly, then fast."""
    time = np.arange(0.0, 7.0, 0.01)
    slow = 0.8 * (2.0 * np.abs(2.0 * np.mod(0.25 * time + 0.25, 1.0) - 1.0) - 1.0)
    fast = 0.6 * np.sin(3.8 * time) + 0.25 * np.sin(11.0 * time)
    swing = np.where(time < 4.0, slow, fast * np.clip(time - 4.0, 0.0, 1.0))
    file = tmp_path / "trajectory.csv"
    file.write_text("time,target.shank\n" + "".join(f"{t},{-1.5 + s}\n" for t, s in zip(time, swing, strict=True)))
    file.with_suffix(".json").write_text(json.dumps({"kp": 15.0, "kd": 0.97}))
    motion = Motion(file, CONTRACT)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.bind((LOOPBACK, 0))
        port.setblocking(False)
        robot = RobotProcess(ROBOT, VirtualCfg(seed=SEED, level="0.1", stand=True), port)
        link = UdpLink(port.getsockname(), ROBOT.joint_names, ROBOT.foot_names, PERIOD)
        link.hello()
        supervisor = Supervisor(CONTRACT, SupervisorCfg(armed=True), PERIOD, 0.0, motion)
        rows, last, now = [], None, 0.0
        while not supervisor.ended:
            robot.period()
            now += PERIOD
            for state in link.receive():
                out = supervisor.state(state, now)
                if out.command is not None:
                    supervisor.sent(link.send(out.command), now)
                if last is not None:
                    rows.append(row(last[0], state.joint_torque, last[1], np.zeros(3)))
                last = state, out
        assert supervisor.stop_record is None, supervisor.stop_record
        link.close()
    layout = row_layout(ROBOT.num_joints, len(ROBOT.foot_names))
    values = np.array([layout.unpack(layout.pack(1, 0.0, one)).values for one in rows])  # type: ignore[union-attr]
    readings = {name: np.squeeze(values[:, place]) for name, place in layout.places.items()}
    per_joint = {name: tuple(map(float, getattr(motion, name))) for name in ("kp", "kd")}
    header = RunLogHeader(
        robot="saturn_lite",
        joint_names=ROBOT.joint_names,
        foot_names=ROBOT.foot_names,
        period=PERIOD,
        control_period=0.02,
        torque_limit=CONTRACT.torque_limit,
        policy="",
        digest="",
        armed=True,
        walking_kp=CONTRACT.kp,
        **per_joint,
    )
    return RunLog(header, readings | {"time": readings["robot_time"]}, {})


def test_the_runtimes_log_tells_the_robots_own_friction(tmp_path: Path) -> None:
    """Between motion and log the runtime shifts, mixes up or clips something, and the friction found is another."""
    log = joint_log("bench", played(tmp_path))
    assert [name for name in log.joints] == [name for name in ROBOT.joint_names if name.endswith("shank")]
    assert any("left out" in note for note in log.notes)
    one = replace(log, joints={JOINT: log.joints[JOINT]})
    record = identify_log(one, workers=1)[0][JOINT].record
    hidden, number = draw(ROBOT, SEED), ROBOT.joint_names.index(JOINT)
    own = 0.1 * ROBOT.joint_values("torque_limit")[number] * hidden.friction.share[number]
    friction = record.coulomb_friction
    assert friction is not None and friction.interval95 is not None
    # A motor's own torque tells f/k.
    assert friction.interval95[0] <= own / hidden.motors.strength[number] <= friction.interval95[1]
    assert friction.value == pytest.approx(own / hidden.motors.strength[number], rel=0.06)
    # Played at a kp of 15, it is judged by that with which the robot walks, and as a robot of its name.
    holding, walking = record.holding_friction or friction, CONTRACT.kp[number]
    assert record.kp == 15.0 and record.dead_band is not None
    assert record.dead_band.value == pytest.approx(holding.value / walking)
    assert log.robot == "saturn_lite" and record.used_kp == walking


def test_what_agrees_is_counted_by_hand(tmp_path: Path) -> None:
    """An interval that misses counts as one that holds, or one that was not found as one that misses."""
    no = Finding("clipped", "seen", "remedy")
    records = {
        "a": JointRecord(coulomb_friction=Estimate(1.0, 0.1, (0.8, 1.2))),
        "b": JointRecord(coulomb_friction=Estimate(2.0, 0.05, (1.9, 2.1)), findings=(no,)),
        "c": JointRecord(),
    }
    JointsFile(records).write(tmp_path / "joints.json")
    bench = friction_in(tmp_path / "joints.json")
    assert bench == {"a": (0.8, 1.2)}
    rows = compared({"a": 1.1, "b": 2.0}, bench, {"a": (1.2, 1.3), "b": (1.0, 3.0)})
    assert rows == [
        JointRow("a", 1.1, "0.8 to 1.2", "1.2 to 1.3", True, False),
        JointRow("b", 2.0, "", "1 to 3", None, True),
    ]
    assert shares(rows) == {"bench_holds": [1, 1], "walk_holds": [1, 2]}
    with pytest.raises(FileError, match=r"expected the joints\.json of identify"):
        friction_in(tmp_path / "nowhere.json")


def report(rule: str | None = None, idle: float = 0.2, policy: float = 0.5) -> dict[str, Any]:
    """Return a run's end and its times [ms]."""
    stop = None if rule is None else {"rule": rule}
    return {"stop": stop, "probe_ms": {"p99": idle}, "lateness_ms": {"p99": policy}}


def test_a_run_on_a_busy_machine_is_made_again_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The demo ends on a machine that does other work, or tries for ever, or throws a run away."""
    ran, reports = [], [report("stale state"), report("policy silent"), report()]

    def run(*words: object) -> int:
        ran.append(words)
        out = Path(str(words[-1]))
        out.mkdir()
        made = reports[len(ran) - 1]
        (out / "report.json").write_text(json.dumps(made))
        return int(made["stop"] is not None)

    monkeypatch.setattr(loop, "_status", run)
    loop._deploy(tmp_path / "walk", "--armed")
    assert len(ran) == 3 and sorted(path.name for path in tmp_path.iterdir()) == ["walk", "walk-late1", "walk-late2"]
    ran.clear()
    with monkeypatch.context() as patched, pytest.raises(StictionError, match="too busy"):
        patched.setattr(loop, "TRIES", 2)
        loop._deploy(tmp_path / "bench")
    reports[0] = report("tilt")
    ran.clear()
    with pytest.raises(StictionError, match="ended with status 1"):
        loop._deploy(tmp_path / "other")
    assert len(ran) == 1
