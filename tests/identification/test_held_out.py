"""Prediction of a part of a log, or of another log, by models that have not seen it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from held import sampled_log
from stiction.files.joints import JointRecord
from stiction.identification.held_out import HORIZONS, HeldOut, Prediction, prediction_text, predictions_text
from stiction.identification.pipeline import identify_joint


def errors(record: JointRecord) -> dict[str, dict]:
    """Return model -> its errors."""
    return {one["model"]: one for one in record.diagnostics["held_out"]["predictions"]}


def test_the_last_part_of_a_log_is_predicted_by_its_first() -> None:
    """To the encoder's steps of 0.1 mrad in its loop; a joint without friction is off by a hundred times as much."""
    record = identify_joint(sampled_log(0.3, 0.3)).record
    assert record.diagnostics["held_out"]["source"] == "last 30% of held"
    assert record.diagnostics["held_out"]["seconds"] == pytest.approx(9.0, abs=0.01)
    chosen, none = errors(record)["chosen"], errors(record)["no friction"]
    assert chosen["closed_loop"] < 1e-4 and none["closed_loop"] > 1e-2
    assert chosen["torque"] < 0.05 < none["torque"]
    # Driven by the logged torque alone nothing holds the joint, and errors grow with time.
    assert len(chosen["open_loop"]) == len(HORIZONS) and list(chosen["open_loop"]) == sorted(chosen["open_loop"])
    assert chosen["open_loop"][1] < 0.05 * none["open_loop"][1]


def test_friction_at_rest_predicts_what_one_friction_does_not() -> None:
    """Static friction of 1 N m and 0.3 in motion predict the held-out part; one Coulomb friction does not."""
    predicted = errors(identify_joint(sampled_log(1.0, 0.3)).record)
    assert predicted["chosen"]["closed_loop"] < 0.05 * predicted["coulomb"]["closed_loop"]


def test_another_log_is_predicted_where_it_is_given() -> None:
    """The same joint again passes; a joint without friction is predicted no better by friction, and the fit falls."""
    log = sampled_log(0.3, 0.3)
    again = replace(sampled_log(0.3, 0.3, seed=2, seconds=12.0), source="again")
    record = identify_joint(log, held_out=again).record
    assert record.diagnostics["held_out"]["source"] == "again" and record.objections == ()
    free = replace(sampled_log(0.0, 0.0, seconds=12.0), source="free")
    objections = identify_joint(log, held_out=free).record.objections
    assert [one.reason for one in objections] == ["held_out"]
    assert "free is predicted no better than by a joint without friction" in objections[0].seen


def test_errors_in_words_by_hand() -> None:
    """A thousandth of a radian is 0.057 degrees; a linear axis is told in millimetres; without a loop over 0.5 s."""
    pair = (Prediction("chosen", 1e-3, (None,) * 3, None), Prediction("no friction", 2e-2, (None,) * 3, None))
    held = HeldOut("log", 9.0, pair)
    assert prediction_text(held.to_dict(), "rotary") == "0.057° in closed loop, no friction 1.1°"
    assert prediction_text(held.to_dict(), "linear") == "1 mm in closed loop, no friction 20 mm"
    assert not held.fails and HeldOut("log", 9.0, (replace(pair[0], closed_loop=0.03), pair[1])).fails
    opened = HeldOut("log", 9.0, tuple(replace(one, closed_loop=None, open_loop=(0.1, 0.2, 0.3)) for one in pair))
    assert prediction_text(opened.to_dict(), "rotary").startswith("11° over 0.5 s from a restart")
    records = {name: JointRecord(diagnostics={"held_out": held.to_dict()}) for name in ("one", "two")}
    expected = "held out, of 2 joints: 0.057° to 0.057° in closed loop, without friction 1.1° to 1.1°"
    assert predictions_text(records) == expected and predictions_text({"one": JointRecord()}) == ""
