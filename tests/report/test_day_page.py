"""`stiction report --bench`: numbers of a day worked out by hand, what it lacks, what it refuses, and a virtual day."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deployed import CONTRACT, JOINTS
from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.core.records import read_rows, write_rows
from stiction.files.joints import Estimate, JointRecord, JointsFile
from stiction.files.plain import write_object
from stiction.files.results import ResultRow, write_results
from stiction.files.run_log import LOG, READINGS, RunLogHeader, part_name, write_run_header
from stiction.files.tables import publish_npz
from stiction.report import bench
from stiction.report.bench import SHEET, BenchRow, SheetRow, bench_rows, missing, read_day, write_bench

HEADER = RunLogHeader(
    robot="saturn_lite",
    joint_names=CONTRACT.joint_names,
    foot_names=(),
    period=0.002,
    control_period=0.02,
    kp=CONTRACT.kp,
    kd=CONTRACT.kd,
    torque_limit=CONTRACT.torque_limit,
    policy="none",
    digest="1" * 64,
    armed=True,
)


def made_run(
    day: Path, run: str, command: tuple[float, float, float] = (0.5, 0.0, 0.0), pace: float = 1.0, **report: object
) -> Path:
    """Write a run of 501 readings, one second, and return its folder.

    Joints are 0.03 rad behind their targets, and their velocity changes by 0.1 rad/s from each control step to the
    next: 5 rad/s². The base turns at 0.4 rad/s. pace: seconds of the robot in that second.
    """
    folder = day / run
    (folder / LOG).mkdir(parents=True)
    policy = str(report.pop("policy", "none"))
    header = replace(HEADER, policy=policy, digest=str(report.pop("digest", HEADER.digest)))
    write_run_header(folder / LOG, header)
    number = np.arange(501)
    swing = np.repeat(0.1 * (number // 10 % 2)[:, None], JOINTS, axis=1)
    three = np.zeros((501, 3))
    arrays = {name: np.zeros((501, JOINTS)) for name in ("torque", "position")}
    arrays |= {
        "time": 0.002 * number,
        "robot_time": 0.002 * pace * number,
        "stage": np.full(501, 2.0),
        "velocity": swing,
    }
    arrays |= {"target": np.full((501, JOINTS), 0.03), "acceleration": three, "foot_contact": np.zeros((501, 0))}
    arrays |= {"angular_velocity": np.tile([0.0, 0.0, 0.4], (501, 1)), "velocity_command": np.tile(command, (501, 1))}
    arrays |= {"quaternion": np.tile([1.0, 0.0, 0.0, 0.0], (501, 1))}
    publish_npz(folder / LOG / part_name(READINGS, 0, 1), arrays, compressed=True)
    content = {"bundle": policy, "digest": header.digest, "armed": True, "stop": None, "lateness_judged": "well"}
    (folder / "report.json").write_text(json.dumps(content | report))
    return folder


def joints(day: Path, condition: str, *values: float) -> None:
    """Write an identification whose joints have friction [N m], each within 0.1."""
    estimates = [Estimate(value, 0.05, (value - 0.1, value + 0.1)) for value in values]
    records = {name: JointRecord(coulomb_friction=one) for name, one in zip("abc", estimates, strict=False)}
    (day / condition / "identified").mkdir(parents=True)
    write_object(day / condition / "identified/joints.json", JointsFile(records).to_dict())


def predicted(day: Path, condition: str, policy: str, ratio: float, command: str = "vx=0.5") -> Path:
    """Write the results of an evaluation."""
    row = ResultRow(
        *(policy, "none", 0, "mujoco", "coulomb", 0.1, "flat", command),
        **dict.fromkeys(("steps_climbed", "cost_of_transport", "tripod_share", "flight_share"), None),
        **{"speed_ratio": ratio, "tracking_error": 0.1, "fall_rate": 0.0, "distance": 1.0, "joint_jitter": 9.0},
        episodes=1,
    )
    (day / condition / "predicted").mkdir(parents=True, exist_ok=True)
    write_results(day / condition / "predicted/results.csv", [row])
    return day / condition / "predicted"


@pytest.fixture
def day(tmp_path: Path) -> Path:
    """A day of one policy and two conditions: two walks and a stop without clamps, a turn with them, a dry run."""
    day = tmp_path / "day"
    for run in ("none-1", "none-2"):
        made_run(day, f"plain/{run}")
    made_run(day, "plain/none-3", stop={"rule": "tilt"})
    made_run(day, "clamped/none-1", (0.0, 0.0, 0.5))
    made_run(day, "clamped/dry", armed=False)
    joints(day, "plain", 0.3, 0.5)
    predicted(day, "plain", "none", 0.75)
    # 4 m in 10 s and, in the log's own second, 0.3 m: 0.8 and 0.6 of 0.5 m/s.
    write_rows(day / SHEET, [SheetRow("plain/none-1", 4.0, 10.0), SheetRow("plain/none-2", 0.3, robot="B42")])
    return day


def test_a_day_by_hand(day: Path) -> None:
    """Ratios, spread, jitter, tracking, stops and friction are those of the log, the sheet and the identification."""
    walked, turned = bench_rows(read_day(day))
    assert (walked.policy, walked.condition, walked.command) == ("none", "plain", "vx=0.5")
    assert (walked.runs, walked.measured, walked.stops, walked.predicted) == (3, 2, "tilt 1", 0.75)
    assert walked.reached == pytest.approx(0.7) and walked.spread == pytest.approx(np.sqrt(0.02))
    assert walked.jitter == pytest.approx(5.0) and walked.tracking == pytest.approx(0.03)
    assert (walked.friction, walked.friction_low, walked.friction_high) == pytest.approx((0.4, 0.3, 0.5))
    assert turned.reached == pytest.approx(0.8) and turned.spread is None and turned.friction is None


def test_the_page_says_what_is_missing_and_keeps_what_was_written_by_hand(
    day: Path, capsys: pytest.CaptureFixture
) -> None:
    """A comparison with holes is not read as a whole one, and a second call loses no note."""
    made_run(day, "clamped/none-2")
    assert main(["report", "--bench", str(day)]) == 0
    output = " ".join(capsys.readouterr().out.split())
    page = (day / bench.PAGE).read_text()
    for lack in (
        "no second policy: nothing to compare",
        "none, plain, wz=0.5: not walked",
        "none, clamped, wz=0.5: 1 of 3 runs",
        "none, clamped, vx=0.5: no prediction",
        "clamped: no friction identified",
        "clamped/none-2: no distance in sheet.csv",
        "clamped/dry: a dry run, left out",
    ):
        assert lack in output and lack in page
    assert len(read_rows(day / bench.TABLE, BenchRow)) == 3
    sheet = {row.run: row for row in read_rows(day / SHEET, SheetRow)}
    assert sheet["plain/none-2"] == SheetRow("plain/none-2", 0.3, robot="B42") and "clamped/none-2" in sheet
    assert "clamped/dry" not in sheet
    before = (day / SHEET).read_bytes()
    assert main(["report", "--bench", str(day)]) == 0 and (day / SHEET).read_bytes() == before


def test_a_day_that_lacks_nothing(tmp_path: Path) -> None:
    """Two policies, two conditions, three measured walks a cell, each predicted and identified: nothing is missing."""
    day = tmp_path / "day"
    for condition in ("plain", "clamped"):
        for policy in ("none", "deception"):
            for number in range(3):
                virtual = {"moved": [0.5, 9.0]}
                digest = "1" * 64 if policy == "none" else "2" * 64
                made_run(day, f"{condition}/{policy}-{number}", policy=policy, digest=digest, virtual=virtual)
        joints(day, condition, 0.3)
        rows = [bench.read_rows(predicted(day, condition, name, 1.0) / "results.csv", ResultRow)[0]
                for name in ("none", "deception")]  # fmt: skip
        write_results(day / condition / "predicted/results.csv", rows)
    bench_day = read_day(day)
    rows = bench_rows(bench_day)
    # A virtual robot went half a metre forward in its second; what it drifted sideways is not along the command.
    assert missing(bench_day, rows) == [] and [row.reached for row in rows] == pytest.approx([1.0] * 4)
    assert "differ by 0.00 on average" in bench.lead(rows, [])


FED = {"way": "measured", "share": 0.75, "friction": dict.fromkeys(CONTRACT.joint_names, 2.0), "load": {}}


def test_runs_with_friction_fed_forward_are_a_policy_of_their_own(day: Path) -> None:
    """Two walks with feed-forward join neither those without nor their prediction; another f is refused."""
    for run in ("plain/fed-1", "plain/fed-2"):
        made_run(day, run, forward=FED, virtual={"moved": [0.4, 0.0]})
    predicted(day, "fed", "none+measured", 0.9).rename(day / "plain/fed")
    fed = next(row for row in bench_rows(read_day(day)) if row.policy == "none+measured")
    assert (fed.condition, fed.runs, fed.predicted) == ("plain", 2, 0.9) and fed.reached == pytest.approx(0.8)
    plain = bench_rows(read_day(day))[0]
    assert (plain.policy, plain.runs, plain.predicted) == ("none", 3, 0.75) and plain.reached == pytest.approx(0.7)
    made_run(day, "plain/fed-3", forward=FED | {"friction": {}})
    with pytest.raises(StictionError, match="plain/fed-3: got other friction fed forward"):
        read_day(day)


@pytest.mark.parametrize(("pace", "measured"), [(0.94, 2), (0.96, 3), (1.04, 3), (1.06, 2)])
def test_a_robot_with_a_time_of_its_own_is_not_counted(day: Path, pace: float, measured: int) -> None:
    """A virtual robot that a busy machine made slow went 0.5 m in fewer of its own seconds, by a quicker policy."""
    made_run(day, "plain/none-4", pace=pace, virtual={"moved": [0.5, 0.0]})
    made_run(day, "plain/none-5", pace=pace, stop={"rule": "tilt"})
    bench_day = read_day(day)
    walked, _ = rows = bench_rows(bench_day)
    assert (walked.runs, walked.measured) == (5, measured)
    told = [line for line in missing(bench_day, rows) if "not counted" in line]
    assert len(told) == (0 if measured == 3 else 2) and all(f"at {pace:.2f} of" in line for line in told)


def edited(file: str, change: Callable[[bytes], bytes]) -> Callable[[Path], object]:
    """Return what changes a file of the day."""
    return lambda day: (day / file).write_bytes(change((day / file).read_bytes()))


def other(day: Path) -> None:
    """Write an evaluation of another bundle of the name."""
    settings = {"inputs": {"bundles": {"x": "2" * 64 + "  none"}}}
    (day / "plain/predicted/settings.json").write_text(json.dumps(settings))


DAMAGE: dict[str, tuple[Callable[[Path], object], str]] = {
    "log cut off": (edited(f"plain/none-1/{LOG}/{part_name(READINGS, 0, 1)}", lambda data: data[:-900]), "readings-"),
    "no log": (edited(f"plain/none-1/{LOG}/log.json", lambda data: b"{}"), "log.json"),
    "report of another run": (lambda day: made_run(day, "plain/x", bundle="else"), "report.json of another run"),
    "report no object": (edited("plain/none-1/report.json", lambda data: b"[]"), "report"),
    "stop without a rule": (lambda day: made_run(day, "plain/x", stop=3), "report.json of another run"),
    "forward no object": (lambda day: made_run(day, "plain/x", forward=3), "report.json of another run"),
    "two policies of a name": (lambda day: made_run(day, "plain/x", digest="2" * 64), "another 'none' than elsewhere"),
    "evaluation of another": (other, "another 'none' than the one that walked"),
    "joints.json": (edited("plain/identified/joints.json", lambda data: b"{"), "not JSON"),
    "sheet": (edited(SHEET, lambda data: data.replace(b"4", b"far")), "distance is 'far'"),
    "sheet twice": (edited(SHEET, lambda data: data + b"plain/none-1,,,,\n"), "two lines of one run"),
    "no time": (edited(SHEET, lambda data: data.replace(b"10", b"0")), "walk of 0 s"),
    "large sheet": (edited(SHEET, lambda data: data + b"," * bench.MOST_BYTES), f"over {bench.MOST_BYTES} bytes"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_what_is_damaged_or_mixed_up_is_refused_in_one_line(
    day: Path, name: str, capsys: pytest.CaptureFixture
) -> None:
    """A damaged run is not left out in silence, and nothing is written over."""
    damage, message = DAMAGE[name]
    damage(day)
    assert main(["report", "--bench", str(day)]) == 1
    errors = capsys.readouterr().err
    assert message in errors and errors.count("\n") == 1 and not (day / bench.PAGE).exists()


def test_a_second_prediction_of_a_cell_is_refused(day: Path) -> None:
    """Refuses a second prediction of one condition and policy."""
    predicted(day, "plain", "none", 1.0).rename(day / "plain/again")
    predicted(day, "plain", "none", 0.5)
    with pytest.raises(StictionError, match="second prediction of plain, none"):
        read_day(day)


def test_a_folder_that_is_no_day_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """A folder without runs, with too many, or none at all, is one line."""
    (tmp_path / "a/b").mkdir(parents=True)
    (tmp_path / "a/c").mkdir()
    for words, message in ((["--bench", str(tmp_path)], "no armed run"), ([], "expected the folder of a day")):
        assert main(["report", *words]) == 1 and message in capsys.readouterr().err
    assert main(["report", "--bench", str(tmp_path / "none")]) == 1 and "no folder" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()
    monkeypatch.setattr(bench, "MOST_FOLDERS", 1)
    assert main(["report", "--bench", str(tmp_path)]) == 1 and "more than 1 results" in capsys.readouterr().err


@pytest.mark.slow
def test_a_day_on_a_virtual_robot(tmp_path: Path) -> None:
    """The page needs only what `deploy` writes."""
    policy = "saturn_lite-flat-deception-0.2"
    words = ["deploy", policy, "--armed", "--command", "vx=0.4", "--duration", "1", "--json", "--robot-cell", "sensors"]
    words += [
        "--stand",
        "--friction-level",
        "0",
        "--stale",
        "5",
        "--gap",
        "5",
        "--silence",
        "5",
        "--set",
        "safety.losses=1",
    ]
    assert main([*words, "--out", str(tmp_path / "day/plain/first")]) == 0
    rows, lacking = write_bench(tmp_path / "day")
    slow = [line for line in lacking if "not counted" in line]
    measured = 1 - len(slow)
    assert [(row.policy, row.command, row.runs, row.measured) for row in rows] == [(policy, "vx=0.4", 1, measured)]
    # On a stand, where a busy machine lets no robot fall, it goes nowhere.
    assert (
        (slow or rows[0].reached == pytest.approx(0.0, abs=0.01))
        and rows[0].jitter > 0
        and "no second policy: nothing to compare" in lacking
    )
