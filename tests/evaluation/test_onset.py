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
    """Return a condition; axes are 10, but for f/kp and f/τ_max, at the torque limit."""
    factors = dict.fromkeys(AXES, (10.0,) * len(onsets)) | {
        "torque_limit": (1.0,) * len(onsets),
        "dead_band_mean": (softness,) * len(onsets),
    }
    still = tuple(2 * onset for onset in onsets)
    return OnsetCondition(robot, onsets, onsets, still, onsets, factors)


TWO = (condition("saturn_lite", (0.1, 0.2), 0.3), condition("saturn_lite@kp=2", (0.3,), 0.4))
OTHER = (condition("spot", (0.4,), 0.7),)
EVIDENCE = OnsetEvidence("torque_limit", False, 1.0, "torque_mean", TWO, OTHER, "stiction study onset", "1")
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
    # 0.8 of 0.9 is 0.72, nine tenths of the way.
    walked = {"onset": pytest.approx(0.09), "standstill": None, "free": 0.9, "to": 0.1}
    assert walked_onset(rows) == walked
    # Half of 0.9 is 0.45: from 0.7 at 10 % to 0.2 at 40 % half way, in the logarithm.
    fallen = walked_onset([*rows, row(0.4, "vx=1", (0.2, 0, 0))])
    assert fallen == walked | {"standstill": pytest.approx(0.2), "to": 0.4}
    nothing = {"onset": None, "standstill": None, "free": None, "to": 0.1}
    assert walked_onset(rows[:1]) == nothing | {"free": 0.9, "to": 0.0}
    assert walked_onset(rows[1:]) == nothing, "nothing without friction"
    assert walked_onset([]) == nothing | {"to": None}
    assert walked_onset([row(level, "vx=1", (0.1, 0, 0)) for level in (0.0, 0.1)]) == nothing | {"free": 0.0}
    both = [row(0.0, "vx=1,wz=1", (1.0, 0, 0.5)), row(0.1, "vx=1,wz=1", (1.0, 0, 0.35))]
    assert walked_onset(both)["onset"] == pytest.approx(0.2 / 0.3 * 0.1)


def test_a_prediction_is_the_middle_of_the_conditions_on_their_axis() -> None:
    """Standstills of 3 and 6 on an axis, single policies from 2 to 8; the mean torque of 5 N m is its unit."""
    predicted = predict_standstill(BUNDLE.contract, FIVES, EVIDENCE)
    factor = (BUNDLE.contract.array("torque_limit") / 5.0).mean()
    assert [predicted.level, predicted.least, predicted.most] == pytest.approx([4.5 / factor, 2 / factor, 8 / factor])
    assert predicted.policies == 4 and predicted.outside == ""
    assert predicted.text.endswith(" %, the range of 4 policies), by f / rms of torque, mean")


def test_what_did_not_walk_is_called_an_extrapolation() -> None:
    """The nearest condition is named for another robot, and for this one with gains that nobody walked with."""
    birds = tuple(replace(each, robot=f"go1{each.robot[11:]}") for each in TWO)
    outside = predict_standstill(BUNDLE.contract, FIVES, replace(EVIDENCE, conditions=birds)).outside
    assert "no such robot walked with such gains; Go1 with kp × 2, the nearest, lost it at 60 %" in outside
    stiff = predict_standstill(BUNDLE.contract, FIVES, replace(EVIDENCE, conditions=TWO[1:]))
    assert stiff.text.endswith("; Saturn Lite with kp × 2, the nearest, lost it at 60 %")


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
    predicted = asdict(Prediction(0.1, 0.05, 0.2, 9, "torque_limit", ""))
    walks = {
        "p": {"onset": 0.12, "standstill": None, "free": 0.9, "to": 0.2},
        "q": {"onset": None, "standstill": None, "free": None, "to": None},
        "r": {"onset": None, "standstill": None, "free": None, "to": 0.5},
        "s": {"onset": None, "standstill": None, "free": 0.0, "to": 0.5},
    }
    lines = onset_lines({policy: {"predicted": predicted, "walked": walked} for policy, walked in walks.items()})
    text = "half of its speed is lost at 10 % friction (5 to 20 %, the range of 9 policies), by f / τ_max."
    worst = "some command under 80 % of its speed without friction:"
    assert lines[0].endswith(f"{text} Walked: not up to 20 %; {worst} at 12 %.")
    assert lines[1].endswith(text)
    assert f"Walked: not known, 0 % was not walked; {worst} not known" in lines[2]
    assert f"Walked: it stands without friction; {worst} it stands" in lines[3]


def test_evidence_that_is_damaged_is_refused(tmp_path: Path) -> None:
    """Rejects evidence with a missing or wrong field, or an unknown axis."""
    path = tmp_path / "onset.json"
    for text in ("{}", '{"schema_version": 1, "axis": 3}', '{"schema_version": 9}', "["):
        path.write_text(text)
        with pytest.raises(StictionError, match="onset"):
            read_onsets(path)
