"""Onset of a policy: walked in an evaluation's rows, predicted from evidence, and marked as extrapolation."""

from __future__ import annotations

from dataclasses import replace
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
    axes,
    golden_motion,
    predict_onset,
    read_onsets,
)
from stiction.files.results import ResultRow
from stiction.report.following import onset_lines

BUNDLE = read_bundle(find_bundle(Path("saturn_lite-flat-none-0.2")))


def condition(robot: str, onsets: tuple[float, ...], softness: float) -> OnsetCondition:
    """Return a robot with six feet; every axis but f/kp is 10 at the torque limit."""
    factors = dict.fromkeys(AXES, (10.0,) * len(onsets)) | {"dead_band_mean": (softness,) * len(onsets)}
    return OnsetCondition(robot, 6, onsets, onsets, onsets, factors)


TWO = (condition("a", (0.1, 0.2), 0.3), condition("b", (0.3,), 0.4))
EVIDENCE = OnsetEvidence("torque_limit", False, 1.0, TWO, "stiction study onset", "1")


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
    assert walked_onset(rows, relative=False) == (pytest.approx(0.05), 0.1)
    # 0.8 of 0.9 is 0.72, nine tenths of the way.
    assert walked_onset(rows, relative=True) == (pytest.approx(0.09), 0.1)
    assert walked_onset(rows[:1], relative=False) == (None, 0.0)
    assert walked_onset(rows[1:], relative=False) == (None, 0.1), "nothing without friction"
    assert walked_onset([], relative=False) == (None, None)
    both = [row(0.0, "vx=1,wz=1", (1.0, 0, 0.5))]
    assert walked_onset([*both, row(0.1, "vx=1,wz=1", (1.0, 0, 0.35))], relative=True)[0] == pytest.approx(
        0.2 / 0.3 * 0.1
    )


def test_a_prediction_is_the_middle_of_the_conditions_on_their_axis() -> None:
    """Middles of 1.5 and 3 on an axis that is 1 at the torque limit."""
    predicted = predict_onset(BUNDLE.contract, None, EVIDENCE)
    assert predicted is not None
    assert (predicted.level, predicted.least, predicted.most, predicted.outside) == (2.25, 1.5, 3.0, "")
    # A torque in walking is not known without a walk.
    assert predict_onset(BUNDLE.contract, None, replace(EVIDENCE, axis="torque_mean")) is None
    torque = np.full(18, 5.0)
    motion = Motion(torque, torque, torque, torque, torque)
    predicted = predict_onset(BUNDLE.contract, motion, replace(EVIDENCE, axis="torque_mean"))
    assert predicted is not None
    assert predicted.level == pytest.approx(2.25 / (BUNDLE.contract.array("torque_limit") / 5.0).mean())


def test_what_no_robot_like_it_has_walked_is_called_an_extrapolation() -> None:
    """A robot with other feet, or with softer gains than any that walked."""
    birds = tuple(replace(each, feet=2) for each in TWO)
    predicted = predict_onset(BUNDLE.contract, None, replace(EVIDENCE, conditions=birds))
    assert predicted is not None
    assert "2 feet walked, this one has 6" in predicted.outside and "the nearest that walked, a" in predicted.outside
    stiff = tuple(condition(each.robot, each.onsets, 0.01) for each in TWO)
    predicted = predict_onset(BUNDLE.contract, None, replace(EVIDENCE, conditions=stiff))
    assert predicted is not None and "τ_max/kp was 0.01 to 0.01 rad, and is 0.32" in predicted.text


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
    """A policy that follows at every level has no walked onset; the line names the last level."""
    predicted = {"level": 0.1, "least": 0.05, "most": 0.2, "axis": "torque_limit", "relative": False, "outside": ""}
    lines = onset_lines(
        {
            "p": {"predicted": predicted, "walked": 0.12, "walked_to": 0.2},
            "q": {"predicted": predicted, "walked": None, "walked_to": 0.2},
            "r": {"predicted": None, "walked": 0.1, "walked_to": 0.2},
        }
    )
    assert len(lines) == 2 and lines[0].endswith("at 10 % of the torque limit (5 to 20 %), by f / τ_max. Walked: 12 %.")
    assert lines[1].endswith("Walked: not up to 20 %.")


def test_evidence_that_is_damaged_is_refused(tmp_path: Path) -> None:
    """Rejects evidence with a missing or wrong field, or an unknown axis."""
    path = tmp_path / "onset.json"
    for text in ("{}", '{"schema_version": 1, "axis": 3}', '{"schema_version": 9}', "["):
        path.write_text(text)
        with pytest.raises(StictionError, match="onset"):
            read_onsets(path)
