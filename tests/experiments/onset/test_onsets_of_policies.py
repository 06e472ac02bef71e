"""The study of onsets: where a policy stops following, by hand, and the axis on which robots agree."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bundles import make_contract
from stiction.cli.main import main
from stiction.evaluation.onset import fast_commands, onset
from stiction.evaluation.summary import commands_for
from stiction.files.bundle import find_bundle, read_bundle
from stiction.files.onset import AXES, Motion, axes, read_onsets, shipped_onsets
from stiction.robots.catalog import find_robot
from stiction_experiments.onset import measure
from stiction_experiments.onset.measure import OnsetRow, ReachRow, reaches_of
from stiction_experiments.onset.page import (
    best_choice,
    choose,
    closest,
    conditions_of,
    evidence_of,
    ordered,
    predictions_sheet,
    report,
    spreads_of,
)


def a_row(robot: str, seed: int, at: float | None, dead_band: float, **changes) -> OnsetRow:
    """Return a policy that stops following at a friction; on all axes but f/kp it counts as its torque limit."""
    factors = dict.fromkeys(AXES, 1.0) | {"dead_band_worst": dead_band, "dead_band_mean": dead_band}
    row = OnsetRow(f"{robot}-s{seed}", robot, "none", seed, "0", 0.9, at, at, at, **factors)
    return replace(row, **changes)


def test_an_onset_by_hand() -> None:
    """From 0.9 at 2 % to 0.7 at 8 % it is 0.8 half way in the logarithm, at 4 %; from 0 on half way is half way."""
    assert onset({0.0: 1.0, 0.02: 0.9, 0.08: 0.7, 0.16: 0.9}) == pytest.approx(0.04)
    assert onset({0.0: 0.9, 0.01: 0.7}) == pytest.approx(0.005)
    assert onset({0.0: 0.9, 0.01: 0.8, 0.02: 0.6}) == pytest.approx(0.01)
    assert onset({0.0: 0.79, 0.01: 0.9}) is None and onset({0.0: 0.9, 0.64: 0.81}) is None


def test_the_worst_reach_is_of_any_command_and_may_be_over_that_without_friction() -> None:
    """0.6 of 0.75 without friction is 0.8 of what was reached there, and 0.5 of 1 is the worst of both."""
    rows = [
        ReachRow("p", level, command, reach, 0, 1.0)
        for level, command, reach in [(0.1, "vx=1", 0.6), (0.1, "wz=1", 0.5), (0.0, "vx=1", 0.75), (0.0, "wz=1", 1.0)]
    ]
    reach = reaches_of(rows)
    assert reach.worst == {0.0: 0.75, 0.1: 0.5} and reach.relative == pytest.approx({0.0: 1.0, 0.1: 0.5})
    assert reach.mean == pytest.approx({0.0: 1.0, 0.1: 0.65}) and not reach.walked_enough
    # A command that is not walked without friction either counts in the worst, and in no ratio.
    still = [ReachRow("p", level, "vy=1", reach, 0, 1.0) for level, reach in ((0.0, 0.1), (0.1, 0.0))]
    assert reaches_of(rows + still).mean == reach.mean and reaches_of(rows + still).worst[0.0] == 0.1
    assert reaches_of([*rows, ReachRow("p", 0.2, "vx=1", 0.3, 0, 1.0)]).walked_enough


def test_a_policy_that_was_walked_in_part_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """Levels that are there are not walked again, and no more than the policy needs."""
    walked: list[float] = []

    def walk(bundle: object, levels: tuple[float, ...], commands: object, threads: int) -> list[ReachRow]:
        walked.extend(levels)
        return [ReachRow("p", level, "vx=1", 1.0 - level, 0, 1.0) for level in levels]

    monkeypatch.setattr(measure, "reaches", walk)
    monkeypatch.setattr(measure, "GRID", (0.0, 0.1, 0.3, 0.45, 0.55, 0.6, 0.7, 0.8, 0.9))
    bundle = read_bundle(find_bundle(Path("saturn_lite-flat-none-0.2")))
    motion = Motion(*(np.ones(18) for _ in range(5)))
    monkeypatch.setattr(measure, "walk_motion", lambda *_: motion)
    row, rows = measure.walk_onset(bundle, [ReachRow("p", level, "vx=1", 1.0 - level, 0, 1.0) for level in (0.0, 0.1)])
    assert walked == [0.3, 0.45, 0.55] and len(rows) == 5
    assert row.standstill == pytest.approx(0.45 * (0.55 / 0.45) ** 0.5)


def test_axes_by_hand() -> None:
    """Two joints of 10 and 20 N m at kp 100: dead bands of 0.1 and 0.2 rad at the torque limit, and so on."""
    robot = find_robot("go1")
    kp, limit = np.array([100.0, 100.0]), np.array([10.0, 20.0])
    rms = (np.array([0.1, 0.4]), np.array([0.2, 0.1]), np.array([2.0, 5.0]))
    values = axes(robot, kp, limit, Motion(*rms, speed=np.array([1.0, 2.0]), power=np.array([3.0, 2.0])))
    assert values["dead_band_worst"] == pytest.approx(0.2) and values["dead_band_mean"] == pytest.approx(0.15)
    assert values["targets_worst"] == pytest.approx(1.0) and values["targets_mean"] == pytest.approx(0.75)
    assert values["motion_worst"] == pytest.approx(2.0) and values["motion_mean"] == pytest.approx(1.25)
    assert values["torque_worst"] == pytest.approx(5.0) and values["torque_mean"] == pytest.approx(4.5)
    assert values["weight_worst"] == pytest.approx(20 / (robot.mass * 9.81 * robot.standing_height))
    # At the torque limit friction takes 10 x 1 + 20 x 2 W, and the motors give 5.
    assert values["work"] == pytest.approx(10.0)
    assert set(values) == set(AXES)


def test_commands_of_half_the_range_count() -> None:
    """Counts all of the set of fifteen but slow walking and standing; the combined ones have half of an axis."""
    bundle = read_bundle(find_bundle(Path("saturn_lite-flat-none-0.2")))
    assert len(fast := fast_commands(commands_for([bundle]))) == 12 and not {"vx=0.2", "vx=-0.2", "stand"} & set(fast)
    slow = replace(
        bundle,
        contract=make_contract(command_range={"forward": (-0.4, 0.4), "sideways": (-0.3, 0.3), "turn": (-1.0, 1.0)}),
    )
    assert {"vx=0.25", "vx=-0.4", "vx=0.2,wz=0.5"} <= set(
        fast_commands(commands_for([slow]))
    ) and "vx=0.1" not in fast_commands(commands_for([slow]))


def test_the_axis_on_which_robots_agree() -> None:
    """Twice the gain, twice the friction: on f/τ_max the onsets are a factor of 2 apart, on f/kp they are one."""
    rows = [
        a_row(robot, seed, at * (1 + 0.01 * seed), dead_band)
        for robot, at, dead_band in [("saturn_lite", 0.1, 0.4), ("saturn_lite@kp=2", 0.2, 0.2)]
        for seed in (10, 11, 12)
    ]
    conditions = conditions_of([*rows, a_row("go1", 10, 0.3, 1.0), a_row("go2", 10, None, 1.0)])
    assert list(conditions) == ["saturn_lite", "saturn_lite@kp=2"], "one seed, and none with an onset"
    spreads = spreads_of(conditions)
    assert spreads["torque_limit"] == pytest.approx(2.0) and spreads["dead_band_mean"] == pytest.approx(1.0)
    choice = choose(conditions, samples=20)
    assert choice.axis == "dead_band_worst" and choice.again == 1.0 and choice.middle == pytest.approx(0.04 * 1.11)
    assert "within 2.00" in report(rows, [], {}).lead


def test_of_axes_that_are_near_the_one_of_less_knowledge_is_taken() -> None:
    """1.2 of f/τ_max beside 1.1 is within 10 %; 1.22 is not."""
    spreads = dict.fromkeys(AXES, 3.0) | {"torque_mean": 1.1}
    assert closest(spreads | {"torque_limit": 1.2}) == "torque_limit"
    assert closest(spreads | {"torque_limit": 1.22}) == "torque_mean"


def test_others_are_predicted() -> None:
    """A middle of 0.04 rad is 10 % of the torque limit at 0.4 rad a limit: the policy stopped at 8 %, 25 % too high.

    On an axis that is 1 at the limit a middle of 0.3 is 30 %, and nobody saw it stand.
    """
    rows = [a_row(robot, seed, 0.1, 0.4) for robot in ("saturn_lite", "go1") for seed in (10, 11)]
    other = a_row("g1", 3, None, 0.4, method="imported", reach=0.7, relative_onset=0.08)
    readings = {"relative_onset": ("dead_band_worst", 0.04), "standstill": ("work", 0.3)}
    sheet = predictions_sheet(ordered([replace(other, standstill=None), *rows]), readings)
    cells = ("10.0%", "8.0%", "+25%", "30.0%", "not seen", "–")
    assert sheet is not None and sheet.rows == (("g1-s3", "imported", "0.70", *cells),)
    assert predictions_sheet(rows, readings) is None


def test_the_command_walks_what_it_does_not_have(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """A policy is walked once; what is in the folder stays, is read again, and its page is drawn without a policy."""
    monkeypatch.setattr(measure, "GRID", (0.0, 0.64))
    monkeypatch.setattr(measure, "EPISODES", 1)
    monkeypatch.setattr(measure, "SECONDS", 3.5)
    out = ["--out", str(tmp_path / "onset")]
    assert main(["study", "onset", "saturn_lite-flat-none-0.2", *out]) == 0
    first = (tmp_path / "onset" / "onsets.csv").read_bytes(), (tmp_path / "onset" / "reach.csv").read_bytes()
    assert len(first[1].splitlines()) == 1 + 2 * 12
    monkeypatch.setattr(measure, "GRID", ())
    for again in (["saturn_lite-flat-none-0.2"], []):
        assert main(["study", "onset", *again, *out]) == 0
        assert first == tuple((tmp_path / "onset" / name).read_bytes() for name in ("onsets.csv", "reach.csv"))
    summary = json.loads((tmp_path / "onset" / "summary.json").read_text())
    assert "nothing is said yet" in summary["lead"]
    capsys.readouterr()
    assert main(["study", "onset", "--out", str(tmp_path / "empty")]) == 2
    assert "no policy given" in capsys.readouterr().err


def test_what_comes_with_the_package_is_what_the_study_wrote() -> None:
    """A prediction rests on rows that the study has replaced."""
    root = Path(__file__).parents[3]
    assert read_onsets(root / "results/onset/evidence.json") == shipped_onsets()


JITTERS = (("vx=1", 2.0), ("vx=-1", 4.0))


def test_evidence_is_of_the_reading_that_more_conditions_have() -> None:
    """Two robots have a relative onset, one of them no other: the relative one counts, on the axis where they agree."""
    rows = [
        replace(a_row(robot, seed, onset, factor), relative_onset=relative, standstill=relative)
        for robot, onset, factor, relative in (("saturn_lite", 0.1, 0.4, 0.1), ("go1", None, 0.8, 0.05))
        for seed in (10, 11)
    ]
    reaches = [ReachRow(row.policy, 0.0, command, 0.9, 0, jitter) for row in rows for command, jitter in JITTERS]
    choice = best_choice(rows)
    assert choice is not None
    own = {"relative_onset": 0.2, "standstill": 0.4}
    other = replace(rows[0], policy="spot", robot="spot", **own)
    apart = [other, replace(other, policy="told", method="told"), replace(other, policy="still", standstill=None)]
    reaches.append(replace(reaches[0], policy="spot"))
    provenance = {"command": "stiction study onset", "revision": "1"}
    evidence = evidence_of(choice, [*rows, *apart], reaches, provenance)
    assert [(one.robot, one.onsets, one.standstill) for one in evidence.others] == [("spot", (0.2,), (0.4,))]
    assert (evidence.axis, evidence.relative) == ("dead_band_worst", True)
    assert [(one.robot, one.onsets) for one in evidence.conditions] == [
        ("saturn_lite", (0.1, 0.1)),
        ("go1", (0.05, 0.05)),
    ]
    assert evidence.conditions[0].jitter == (3.0, 3.0)
    assert (evidence.standstill_axis, evidence.conditions[0].standstill) == ("work", (0.1, 0.1))
    assert evidence.middles(evidence.axis) == pytest.approx([0.04, 0.04])
