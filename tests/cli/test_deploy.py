"""`stiction deploy` on a virtual robot in a process of its own, as a user runs it; its times are generous."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from bundles import make_bundle, make_contract
from processes import is_alive, stiction, wait_until
from stiction.cli import deploy
from stiction.cli.main import main
from stiction.deploy.transports.link import Peers
from stiction.files.bundle import find_bundle, read_bundle
from stiction.files.joints import Estimate, JointRecord, JointsFile
from stiction.files.observation import proprioception
from stiction.files.plain import write_object
from stiction.files.run_log import RUN_STAGE, joint_log, read_run_log

POLICY = "saturn_lite-flat-deception-0.2"
PATIENT = ("--silence", "5", "--stale", "5", "--gap", "5", "--keep-minutes", "5", "--set", "safety.losses=1")
ON_STAND = ("--stand", "--robot-cell", "sensors", "--friction-level", "0")


def children(pid: int) -> list[int]:
    """Return the processes that a process has started."""
    pids = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid:
            pids.append(int(stat.parent.name))
    return pids


def test_a_run_ends_as_asked_and_leaves_report_and_log(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """A run that went well has status 1, no report, a watchdog that acted, or a log that nothing reads."""
    out = tmp_path / "run"
    words = ["deploy", POLICY, "--armed", "--duration", "3", "--out", str(out), *PATIENT, *ON_STAND]
    done = subprocess.run(stiction(*words), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "done: " in done.stdout and "lateness" in done.stdout
    report = json.loads((out / "report.json").read_text())
    # On a busy machine the recorder may miss some messages.
    assert report["stop"] is None and report["armed"] and report["log_lost"] < 70
    assert report["watchdog"] == {"acted": False}
    assert report["periods"] > 0 and {"p50", "p99", "p99_9", "max"} == report["lateness_ms"].keys()
    log = read_run_log(out / "log")
    assert len(joint_log("run", log).time) > 10
    assert len(log.steps["time"]) >= report["periods"]
    assert main(words) == 1
    again = capsys.readouterr().err
    assert "already" in again and again.count("\n") == 1


def test_friction_is_fed_forward_logged_and_reported(tmp_path: Path) -> None:
    """Feeds 75 % of f by the measured speed while the policy runs; report, settings and log say so."""
    contract = read_bundle(find_bundle(Path("saturn_lite-flat-none-0.2"))).contract
    friction = {"hip": 1.0, "thigh": 2.0, "shank": 3.0}
    records = {k: JointRecord(coulomb_friction=Estimate(f, 0.1, (f - 0.2, f + 0.2))) for k, f in friction.items()}
    file, out = tmp_path / "joints.json", tmp_path / "run"
    write_object(file, JointsFile(records).to_dict())
    words = ["deploy", "saturn_lite-flat-none-0.2", "--armed", "--command", "vx=0.4", "--duration", "1"]
    words += ["--forward", str(file), "--out", str(out), *PATIENT, *ON_STAND]
    done = subprocess.run(stiction(*words), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "friction fed forward: 75 % of hip 1, thigh 2, shank 3 N m\n" in done.stderr
    report, settings = (json.loads((out / name).read_text()) for name in ("report.json", "settings.json"))
    f = np.array([friction[kind] for kind in contract.kinds])
    assert report["forward"]["friction"] == dict(zip(contract.joint_names, f, strict=True))
    assert settings["settings"]["forward"] == str(file) and "forward" in settings["inputs"]
    log = read_run_log(out / "log").readings
    ran = log["stage"] == RUN_STAGE
    assert not log["forward"][~ran].any()
    # A reading that a newer one overtook is logged with the decision before it, as the row before has.
    decided = ran & (np.diff(log["forward"], axis=0, prepend=0.0) != 0.0).any(axis=1)
    fed, speed, error = log["forward"][decided], log["velocity"][decided], (log["target"] - log["position"])[decided]
    # At 0.2 rad/s all is fed in the direction of motion, unless the target is behind.
    fast = (np.abs(speed) > 0.2) & (speed * error > 0.0)
    right = np.isclose(fed[fast], (0.75 * f * np.sign(speed))[fast], atol=1e-5)
    # On a busy machine the row before may be lost.
    assert len(right) > 10 and right.mean() > 0.9


@pytest.mark.parametrize(
    ("fault", "message", "status"),
    [
        ("policy-kill", "policy gone: its ", 1),
        ("sigterm", "operator: SIGTERM", 128 + signal.SIGTERM),
        ("second-robot", "second robot: 2, allowed 1 (127.0.0.1:", 1),
        ("second-writer", "second writer: 1, allowed ", 1),
    ],
)
def test_a_fault_ends_in_one_line_and_its_status(tmp_path: Path, fault: str, message: str, status: int) -> None:
    """A dead policy, a signal, a second robot or writer: damping, one line, and status 1, or 128 and the signal."""
    out = tmp_path / "run"
    words = ["deploy", POLICY, "--armed", "--json", "--fault", f"{fault}@0.2", "--duration", "20", "--out", str(out)]
    done = subprocess.run(stiction(*words, *PATIENT, *ON_STAND), capture_output=True, text=True, check=False)
    assert done.returncode == status
    assert done.stderr.startswith("stiction deploy: stopped: ") and message in done.stderr
    assert done.stderr.count("\n") == 1
    report = json.loads(done.stdout)
    assert f"`{report['stop']['rule']}`" in (Path(__file__).parents[2] / "docs/safety.md").read_text()
    # The robot itself saw the damping frame, and no other's.
    assert report["virtual"]["damped"] > report["stop"]["time"] > report["faults"][fault]
    assert report["stage"] == "stopped" and report["damped_seconds"] >= 0.9


def test_a_supervisor_that_is_halted_does_not_walk_on(tmp_path: Path) -> None:
    """After 200 ms without a turn the robot is damped: not even patience with states and policy lets it walk on."""
    words = ["deploy", POLICY, "--armed", "--json", "--fault", "supervisor-halt@0.2", "--duration", "20"]
    words += ["--out", str(tmp_path / "run"), *PATIENT[:4], *ON_STAND, "--gap", "0.15"]
    done = subprocess.run(stiction(*words), capture_output=True, text=True, check=False)
    report = json.loads(done.stdout)
    # By whichever of the two looked first.
    assert done.returncode == 1 and report["stop"]["rule"] in ("supervisor halted", "supervisor silent")
    assert report["virtual"]["damped"] > report["faults"].get("supervisor-halt", 0.0)


def test_whoever_falls_silent_elsewhere_ends_the_run(tmp_path: Path) -> None:
    """A fault that is accepted and does nothing is called safe: the run went on without anybody."""
    words = ["deploy", POLICY, "--armed", "--json", "--fault", "heartbeat@0.5", "--duration", "60"]
    words += ["--out", str(tmp_path / "run"), "--keep-minutes", "0"]
    done = subprocess.run(stiction(*words, *PATIENT[:6], *ON_STAND), capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stderr
    report = json.loads(done.stdout)
    assert report["stop"]["rule"] == "operator", done.stderr
    # It had been heard until then: what is lost is counted from its last word.
    assert report["stop"]["time"] - report["faults"]["heartbeat"] > 0.5 - 0.06
    assert report["virtual"]["damped"] > report["faults"]["heartbeat"]


def test_without_arming_nothing_reaches_the_robot(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """A robot moves in a dry run."""
    out = tmp_path / "run"
    assert main(["deploy", POLICY, "--duration", "2", "--out", str(out), *PATIENT]) == 0
    assert "a dry run" in capsys.readouterr().err
    report = json.loads((out / "report.json").read_text())
    assert not report["armed"] and report["virtual"] == {}
    log = read_run_log(out / "log")
    assert not log.header.armed and report["periods"] > 0


@pytest.mark.skipif(sys.platform != "linux", reason="processes are looked for in /proc, which only Linux has")
@pytest.mark.parametrize("victim", ["supervisor", "watchdog"])
def test_a_run_of_which_a_process_is_killed_leaves_a_log_and_no_orphan(victim: str, tmp_path: Path) -> None:
    """After kill -9 all processes end, the log can be read, and a run without a watchdog is stopped."""
    out = tmp_path / "run"
    words = ["deploy", POLICY, "--armed", "--out", str(out), *PATIENT, *ON_STAND]
    process = subprocess.Popen(stiction(*words), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: len(list((out / "log").glob("readings-*.npz"))) >= 3, "no log came", 120.0)
    started = children(process.pid)
    assert len(started) == 4
    (watchdog,) = (pid for pid in started if b"runtime.watchdog" in Path(f"/proc/{pid}/cmdline").read_bytes())
    os.kill(process.pid if victim == "supervisor" else watchdog, signal.SIGKILL)
    # To its end of file: the watchdog has the same standard error.
    line = process.communicate()[1].splitlines()[-1]
    wait_until(lambda: not any(map(is_alive, started)), "a process outlived the supervisor")
    if victim == "supervisor":
        assert "the supervisor was silent; the watchdog damped the robot for" in line
    else:
        assert line == "stiction deploy: stopped: watchdog gone: its process has ended" and process.returncode == 1
    log = read_run_log(out / "log")
    assert len(log.readings["time"]) > 10
    time.sleep(0.05)


class Terminal(io.StringIO):
    """Terminal at which somebody has typed."""

    def isatty(self) -> bool:
        """Return True."""
        return True


@pytest.mark.parametrize(("typed", "readers"), [("Yes\n", 3), ("no\n", 1), ("\n", 1), ("", 1)])
def test_only_a_typed_yes_lets_further_programs_listen(
    typed: str, readers: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """Ctrl-D, the end of the input, is no, and no error of the program."""
    monkeypatch.setattr(sys, "stdin", Terminal(typed))
    link = Mock(peers=lambda: Peers(("robot",), ("robot's", "one", "two")))
    assert deploy._consent(Mock(armed=True, json=False, readers=1), link) == readers
    assert "3 programs read the commands" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--robot", "virtuel"], "did you mean 'virtual'"),
        (["--robot", "unitree-go"], "network interface"),
        (["--robot", "unitree-go:nowhere0", "--fault", "tilt@1"], "--fault requires --robot virtual"),
        (["--robot", "ros2:/x", "--engine", "ode"], "--engine requires --robot virtual"),
        (["--held.kp", "3"], "--held.kp requires --robot unitree-go:INTERFACE"),
        (["--gap", "0"], "gap: got 0.0"),
        (["--operator.heartbeat-timeout", "1"], "--operator.heartbeat-timeout requires --operator.heartbeat;"),
        (["--robot", "unitree-go:lo"], "maker's order"),
        (["--robot", "ros2"], "namespace"),
        (["--robot", "ros2:/x"], "rclpy"),
        (["--robot-seed", "-1"], "seed: got -1"),
        (["--realtime", "200"], "--realtime: got 200"),
        (["--fault", "tlit@1"], "did you mean 'tilt'"),
        (["--command", "vx=3"], "trained"),
        (["--ramp", "0.5"], "ramp"),
        (["--engine", "bullet"], "engine"),
        (["--friction-level", "9"], "friction level"),
        (
            ["--excitation", "nowhere.csv"],
            "no motion at nowhere.csv; expected a trajectory.csv; `stiction excite` designs",
        ),
        (["--expect-digest", "0" * 64], "digest"),
        (["--limits.slew", "0"], "slew"),
        (["--set", "safety.tilt=-1"], "tilt"),
    ],
)
def test_wrong_words_are_one_line_and_nothing_moves(
    tmp_path: Path, words: list[str], message: str, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A typing error is a traceback, or moves a robot with other settings than were meant."""

    def started(*_: object) -> None:
        raise AssertionError("the robot was started")

    monkeypatch.setattr("stiction.virtual.serve.virtual_robot", started)
    monkeypatch.setitem(sys.modules, "rclpy", None)
    assert main(["deploy", POLICY, "--armed", "--duration", "0.2", "--out", str(tmp_path / "run"), *words]) == 1
    err = capsys.readouterr().err
    assert message in err and err.count("\n") == 1, err


@pytest.fixture
def motion(tmp_path: Path) -> str:
    """A motion of 2 s of one joint."""
    file = tmp_path / "trajectory.csv"
    file.write_text("time,target.FL_hip\n0,0\n1,0.1\n2,0\n")
    return str(file)


@pytest.mark.parametrize(
    "words",
    [
        ["--command", "vx=0.5"],
        ["--operator.command-from", "127.0.0.1:9000"],
        ["--fault", "policy-kill@1"],
    ],
)
def test_what_is_of_a_policy_is_refused_beside_a_motion(
    tmp_path: Path, motion: str, words: list[str], capsys: pytest.CaptureFixture
) -> None:
    """A command moves nothing, and a robot that is told to hold still is stopped for joints that stand."""
    arguments = ["deploy", POLICY, "--stand", "--armed", "--excitation", motion, "--out", str(tmp_path / "run"), *words]
    assert main(arguments) == 1
    err = capsys.readouterr().err
    refused = words[0] if words[0] != "--fault" else f"--fault {words[1].partition('@')[0]}"
    assert f"--excitation and {refused} exclude each other" in err
    assert err.count("\n") == 1 and not (tmp_path / "run").exists()


def test_a_motion_is_cut_by_the_duration(tmp_path: Path, motion: str, capsys: pytest.CaptureFixture) -> None:
    """Whoever bounds a first motion gets all of it."""
    words = ["deploy", POLICY, "--stand", "--armed", "--excitation", motion, "--stale", "5", "--gap", "5"]
    words += ["--keep-minutes", "0", "--duration", "0.5", "--out", str(tmp_path / "cut")]
    assert main(words) == 0
    assert "done: the first 0.5 s of a motion of 2 s, cut by --duration" in capsys.readouterr().out
    report = json.loads((tmp_path / "cut" / "report.json").read_text())
    assert report["motion"] == {"seconds": 2.0, "played": 0.5} and report["stop"] is None


def test_what_is_no_bundle_is_refused_before_a_folder_is_made(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Refuses a folder that is not a policy bundle, and creates no output folder."""
    (tmp_path / "other").mkdir()
    assert main(["deploy", str(tmp_path / "other"), "--out", str(tmp_path / "run")]) == 1
    assert "is not a policy bundle" in capsys.readouterr().err and not (tmp_path / "run").exists()


def test_a_report_is_not_written_over_unasked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """The report of another run is gone, or the robot has walked before the refusal."""
    file = tmp_path / "report.json"
    file.write_text("mine")
    runs = {"stop": None, "end": "done", "log": None, "log_end": None}
    monkeypatch.setattr(deploy, "_planned", lambda *_: lambda: runs)
    words = ["deploy", POLICY, "--json", "--report", str(file), "--out", str(tmp_path / "run")]
    assert main(words) == 1 and file.read_text() == "mine"
    error = capsys.readouterr().err
    assert "report.json exists already; choose another --report, or add --overwrite" in error
    assert not (tmp_path / "run").exists()
    assert main([*words, "--overwrite"]) == 0 and json.loads(file.read_text()) == runs


def test_a_policy_that_is_told_its_friction_says_whose_and_gets_none_forward(tmp_path: Path, capsys) -> None:
    """Told all of it while three quarters are fed forward it would answer friction that is no longer there."""
    told = {"hip": 0.2, "thigh": 0.2, "shank": 0.2}
    contract = make_contract(observation=proprioception(18, known_kinds=3), known_friction=told)
    path = make_bundle(tmp_path / "told", contract)
    words = ["deploy", str(path), "--duration", "0.1", "--out", str(tmp_path / "run"), *PATIENT]
    joints = tmp_path / "joints.json"
    joints.write_text("{}")
    assert main([*words, "--forward", str(joints)]) == 1
    assert "--forward: this policy is told its joints' friction and answers it" in capsys.readouterr().err
    main(words)
    assert "stiction export RUN --joints joints.json tells it the bench's" in capsys.readouterr().err
