"""Onset of a policy: walked in an evaluation's rows, predicted from evidence, and marked as extrapolation."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.evaluation.onset import walked_onset
from stiction.files.bundle import find_bundle, read_bundle
from stiction.files.contract import robot_of
from stiction.files.onset import (
    AXES,
    Motion,
    OnsetCondition,
    OnsetEvidence,
    Prediction,
    axes,
    golden_motion,
    predict_standstill,
    read_onsets,
)
from stiction.files.results import ResultRow
from stiction.report.following import onset_lines

BUNDLE = read_bundle(find_bundle(Path("saturn_lite-flat-none-0.2")))


def condition(robot: str, onsets: tuple[float, ...], softness: float) -> OnsetCondition:
    """Return a robot with six feet; every axis but f/kp is 10 at the torque limit."""
    factors = dict.fromkeys(AXES, (10.0,) * len(onsets)) | {"dead_band_mean": (softness,) * len(onsets)}
    still = tuple(2 * onset for onset in onsets)
    return OnsetCondition(robot, 6, onsets, onsets, still, onsets, factors)


TWO = (condition("a", (0.1, 0.2), 0.3), condition("b", (0.3,), 0.4))
EVIDENCE = OnsetEvidence("torque_limit", False, 1.0, "torque_mean", TWO, "stiction study onset", "1")
FIVES = Motion(*[np.full(18, 5.0)] * 5)


def row(level: float, command: str, velocity: tuple[float, float, float], **changes) -> ResultRow:
    """Return a row in which a policy reached a mean velocity."""
    vx, vy, wz = velocity
    told = ResultRow(
        *("p", "none", 0, "mujoco", "coulomb", level, "flat", command, None, 0.0, 0.0, 1.0, None, None, 1.0),
        *(None, None, 1),
        mean_vx=vx,
        mean_vy=vy,
        mean_wz=wz,
    )
    return replace(told, **changes)


def test_an_onset_by_the_rows_of_an_evaluation() -> None:
    """0.9 at 0 and 0.7 at 10 % is 0.8 half way; slow commands, other engines and laws do not count."""
    rows = [row(0.0, "vx=1", (0.9, 0, 0)), row(0.1, "vx=1", (0.7, 0, 0)), row(0.1, "vx=0.2", (0.0, 0, 0))]
    rows += [row(0.05, "vx=1", (0, 0, 0), engine="physx"), row(0.05, "vx=1", (0, 0, 0), friction_law="load")]
    walked = {"onset": pytest.approx(0.05), "standstill": None, "to": 0.1}
    assert walked_onset(rows, relative=False) == walked
    # 0.8 of 0.9 is 0.72, nine tenths of the way.
    assert walked_onset(rows, relative=True) == walked | {"onset": pytest.approx(0.09)}
    # Half of 0.9 is 0.45: from 0.7 at 10 % to 0.2 at 40 % half way, in the logarithm.
    fallen = walked_onset([*rows, row(0.4, "vx=1", (0.2, 0, 0))], relative=False)
    assert fallen == walked | {"standstill": pytest.approx(0.2), "to": 0.4}
    nothing = {"onset": None, "standstill": None, "to": 0.1}
    assert walked_onset(rows[:1], relative=False) == nothing | {"to": 0.0}
    assert walked_onset(rows[1:], relative=False) == nothing, "nothing without friction"
    assert walked_onset([], relative=False) == nothing | {"to": None}
    both = [row(0.0, "vx=1,wz=1", (1.0, 0, 0.5)), row(0.1, "vx=1,wz=1", (1.0, 0, 0.35))]
    assert walked_onset(both, relative=True)["onset"] == pytest.approx(0.2 / 0.3 * 0.1)


def test_a_prediction_is_the_middle_of_the_conditions_on_their_axis() -> None:
    """Standstills of 3 and 6 on an axis; the mean torque of 5 N m is its unit."""
    predicted = predict_standstill(BUNDLE.contract, FIVES, EVIDENCE)
    factor = (BUNDLE.contract.array("torque_limit") / 5.0).mean()
    assert [predicted.level, predicted.least, predicted.most] == pytest.approx([4.5 / factor, 3 / factor, 6 / factor])
    assert predicted.outside == "" and predicted.text.endswith("of the torque limit, by f / rms of torque, mean")


def test_what_no_robot_like_it_has_walked_is_called_an_extrapolation() -> None:
    """A robot with other feet, or with softer gains than any that walked."""
    birds = tuple(replace(each, feet=2) for each in TWO)
    outside = predict_standstill(BUNDLE.contract, FIVES, replace(EVIDENCE, conditions=birds)).outside
    assert "2 feet walked, this one has 6" in outside and "the nearest that walked, a" in outside
    stiff = tuple(condition(each.robot, each.onsets, 0.01) for each in TWO)
    predicted = predict_standstill(BUNDLE.contract, FIVES, replace(EVIDENCE, conditions=stiff))
    assert "τ_max/kp was 0.01 to 0.01 rad, and is 0.32" in predicted.text


def test_a_recording_with_friction_predicts_nothing_of_motion() -> None:
    """A recording with friction gives no prediction from motion."""
    assert golden_motion(BUNDLE.golden, BUNDLE.contract) is None
    free = replace(BUNDLE.contract, friction=(0.0,) * 18, friction_level=0.0)
    motion, walked = golden_motion(BUNDLE.golden, free), BUNDLE.golden.walked
    assert motion is not None
    assert motion.torque == pytest.approx(np.sqrt(np.square(BUNDLE.golden.torque[walked]).mean(axis=0)))
    factors = axes(robot_of(free), free.array("kp"), free.array("torque_limit"), motion)
    assert all(value > 0 for value in factors.values())


def test_the_line_of_a_policy_has_what_was_predicted_and_what_was_walked() -> None:
    """A friction that no walk showed is named by the last level; without walks nothing is said of them."""
    predicted = asdict(Prediction(0.1, 0.05, 0.2, "torque_limit", ""))
    walks = {
        "p": {"onset": 0.12, "standstill": None, "to": 0.2},
        "q": {"onset": None, "standstill": None, "to": None},
    }
    lines = onset_lines({policy: {"predicted": predicted, "walked": walked} for policy, walked in walks.items()})
    text = "friction: half of its speed is gone at 10 % (5 to 20 %) of the torque limit, by f / τ_max."
    assert lines[0].endswith(f"{text} Walked: not up to 20 %; some command under 80 %: 12 %.")
    assert lines[1].endswith(text)


def test_evidence_that_is_damaged_is_refused(tmp_path: Path) -> None:
    """Rejects evidence with a missing or wrong field, or an unknown axis."""
    path = tmp_path / "onset.json"
    for text in ("{}", '{"schema_version": 1, "axis": 3}', '{"schema_version": 9}', "["):
        path.write_text(text)
        with pytest.raises(StictionError, match="onset"):
            read_onsets(path)
