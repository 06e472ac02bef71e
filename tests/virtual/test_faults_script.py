"""`tools/faults.py`: its table after a kill, and the outcomes that it counts."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from bundles import make_contract
from processes import wait_until
from stiction.deploy.transports.link import RobotState
from stiction.deploy.transports.udp import LOOPBACK, UdpLink
from stiction.virtual.robot import PERIOD

SCRIPTS = Path(__file__).parents[2] / "tools"
HEAD = "fault,trial,rule,joint,status,detected_ms,bus_ms,good_ms,fault_ms,probe_ms\n"
ROWS = (
    "tilt,0,orientation jump,,1,2.0,0.5,3.0,2.5,0.2\n"
    "tilt,1,orientation jump,,1,2.0,25.0,70.0,27.0,0.9\n"
    "tilt,2,before the fault: stale state,,1,,,,,4.0\n"
    "policy-kill,0,policy gone,,1,2.0,1.0,,3.0,0.2\n"
    "second-writer,0,none,,0,,,,,0.2\n"
)


def test_a_kill_in_the_middle_of_a_line_costs_that_line_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hours of trials are lost, or half a line becomes a trial; a run ended by its machine counts as a fault found."""
    monkeypatch.syspath_prepend(str(SCRIPTS))
    import faults

    file = tmp_path / "faults.csv"
    file.write_text(HEAD + ROWS + "tilt,3,orie")
    rows = faults.whole_rows(file)
    assert len(rows) == 5 and file.read_text() == HEAD + ROWS
    lines = faults.table(rows).splitlines()
    tilt = next(line for line in lines if line.startswith("| `tilt`"))
    # Two trials, both damped; half of them in time; one quiet; one run that ended before.
    expected = "| `tilt` | 2 | 2 | orientation jump | 12.8 (25.0), 1 of 2 | 36.5 (70.0), 1 of 2 | 14.8 (27.0) | 1 | 1 |"
    assert tilt == expected
    everything, quiet = lines[-2:]
    assert "damped 3 of 4" in everything and "of detection 2 of 3" in everything and "SIGKILL 1 of 1" in everything
    assert "damped 2 of 3" in quiet and "state 1 of 1" in quiet
    sys.modules.pop("faults")


def test_the_robot_of_the_trials_of_stops_numbers_its_states(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of its states is a new one for the link: a run on it begins."""
    monkeypatch.syspath_prepend(str(SCRIPTS))
    import stop_trials

    contract = make_contract()
    robot = stop_trials.Child(lambda: stop_trials.udp_robot(contract, 0, lossy=False, realtime=False))
    feet = contract.anatomy.foot_names if contract.anatomy else ()
    link = UdpLink((LOOPBACK, json.loads(robot.line())["port"]), contract.joint_names, feet, PERIOD)
    link.hello()
    states: list[RobotState] = []
    wait_until(lambda: bool(states.extend(link.receive()) or len(states) >= 5), "no new states come", 300.0)
    link.close()
    assert robot.end()[0] == 0 and link.arrivals.counts.twice == 0
    sys.modules.pop("stop_trials")


TRIAL = """import json, sys
from pathlib import Path
sys.path.insert(0, ".")  # Not there by itself where PYTHONSAFEPATH is set.
import stop_trials as of

print(json.dumps(of.attempt("signal SIGTERM", 0, of.prepare(Path(sys.argv[1])), 0, of.PATIENT)))
"""


def test_a_trial_of_a_stop_ends_with_the_report_of_its_run(tmp_path: Path) -> None:
    """A run on the stand-in for the robot goes through the whole program, to its last line."""
    words = [sys.executable, "-c", TRIAL, str(tmp_path)]
    done = subprocess.run(words, cwd=SCRIPTS, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    row = json.loads(done.stdout.splitlines()[-1])
    assert "unforeseen" not in row["line"] and row["outcome"] != "stiff" and "probe_ms" in row
