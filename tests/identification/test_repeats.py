"""Repeats, torque that the controller adds, and what a log with other joints in motion is told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from markupsafe import escape

from stiction.core.errors import LogError
from stiction.files.joints import JointsFile
from stiction.files.log import JointSignals, Log
from stiction.identification.checks import other_moving_joints
from stiction.identification.example import SATURN_LITE, Excitation, example_log
from stiction.identification.findings import repeat_lines
from stiction.identification.held_out import prediction_text
from stiction.identification.pipeline import identify_joint, identify_log
from stiction.identification.setup import IdentifySetup
from stiction.report.identification import agreement
from stiction.report.identified import glance_of

SHORT = Excitation(duration=8.0)


def shank(log: Log) -> JointSignals:
    """Return the only joint's signals."""
    return log.joints["shank"]


def changed(log: Log, **signals: np.ndarray | None) -> Log:
    """Return the log with other signals."""
    return replace(log, joints={"shank": replace(shank(log), **signals)})


def test_a_repeat_is_a_line_and_a_bad_one_a_warning() -> None:
    """Another log of the joint is predicted as well as its own; one with twice the torque is not, and costs nothing."""
    log = example_log(SATURN_LITE, SHORT)
    good = replace(example_log(SATURN_LITE, SHORT, seed=1), source="good")
    bad = replace(changed(good, torque=2.0 * np.asarray(shank(good).torque)), source="bad")
    short = replace(good, source="short", time=good.time[:50])
    short = changed(short, **{name: row[:50] for name, row in vars(shank(good)).items() if row is not None})
    record = identify_joint(log, repeats=(good, bad, short)).record
    alone = identify_joint(log).record
    assert record.coulomb_friction == alone.coulomb_friction and record.objections == ()
    lines = repeat_lines(record)
    assert lines[0].startswith("repeat good: ") and "agree" in lines[0] and "times the fit's own" in lines[0]
    assert "do not" in lines[1] and lines[2].startswith("repeat short: not used: short: 50 samples")
    verdict = {"answer": "no", "step": "", "assumes": [], "lines": ["a", "b", "c"]}
    told = replace(record, diagnostics=record.diagnostics | {"verdict": verdict})
    glance = glance_of(JointsFile({"shank": told}), Path("out"))
    assert glance is not None and glance.notes == tuple(lines)
    held = prediction_text(record.diagnostics["held_out"], "rotary")
    assert escape(f"held out: {held}.") in "".join(agreement(record))
    texts = [text for text in record.warnings if "the repeat " in text]
    assert len(texts) == 2 and texts[0].startswith("the repeat bad is predicted badly: 5") and "short" in texts[1]


def test_feedforward_belongs_to_the_controller() -> None:
    """Pulses that the controller adds are in the torque already; without their column the gains seem wrong."""
    time, target = SHORT.target()
    pulses = 1.5 * np.sign(np.sin(2 * np.pi * 0.7 * time))
    kp = SATURN_LITE.gains.kp
    pushed = _followed(target + pulses / kp)
    blind = identify_joint(changed(pushed, target=target)).record
    assert blind.diagnostics["controller_mismatch"] > 0.15 and blind.diagnostics["output_error"] is None
    log = changed(pushed, target=target, feedforward=pulses / 3.0)
    result = identify_joint(log, setup=IdentifySetup(feedforward_scale=3.0))
    assert result.record.diagnostics["controller_mismatch"] < 0.06 and result.record.objections == ()
    assert result.record.coulomb_friction.value == pytest.approx(0.442, rel=0.03)
    assert result.record.diagnostics["output_error"]["coulomb_friction"]["value"] == pytest.approx(0.442, rel=0.03)
    np.testing.assert_allclose(result.fit.target, target, atol=1e-12)
    positions = identify_joint(changed(log, torque=None), setup=IdentifySetup(feedforward_scale=3.0)).record
    assert positions.combinations["f/k"].value == pytest.approx(0.442, rel=0.03)
    with_no_loop = identify_joint(replace(log, setup=replace(log.setup, kp=None))).record
    assert any("feedforward has no effect" in text for text in with_no_loop.warnings)


def _followed(target: np.ndarray) -> Log:
    """Return a log whose controller followed another target than the excitation's."""
    from stiction.joints.simulate import simulate

    log, rng = example_log(SATURN_LITE, SHORT), np.random.default_rng(0)
    motion = simulate(SATURN_LITE.joint, SATURN_LITE.gains, 0.002, target, position=float(target[0]))
    noise = rng.standard_normal((2, len(target)))
    return changed(
        log, target=target, position=motion.position + 1e-5 * noise[0], torque=motion.torque + 0.02 * noise[1]
    )


def test_a_joint_that_others_disturb_is_not_told_to_move_faster() -> None:
    """The message names the other moving joints, not poor excitation."""
    time = np.arange(0, 20, 0.002)
    rng = np.random.default_rng(0)
    position = 0.25 * np.abs((time % 2.0) - 1.0) + 1e-7 * rng.standard_normal(len(time))
    torque = 0.4 * np.sign((time % 2.0) - 1.0) + 0.01 * rng.standard_normal(len(time))
    poor = JointSignals(position=position, torque=torque)
    hip, rod = JointSignals(position=2 * position), JointSignals(position=0 * time)
    log = Log("walk", time, {"knee": poor, "hip": hip, "rod": rod})
    assert other_moving_joints(log, "knee") == ("hip",)
    with pytest.raises(LogError, match=r"walk: joint 'knee': .*: other joints move in this log \(hip\)") as caught:
        identify_log(log, joints=("knee",), workers=1)
    assert "excitation too poor" not in str(caught.value)
    with pytest.raises(LogError, match=r"joint 'knee': excitation too poor: .*; use at least two frequencies"):
        identify_joint(replace(log, joints={"knee": poor}))
