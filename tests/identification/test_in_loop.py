"""Reasons for a loop without simulation, and its small cost to the user."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from carried import without_torque
from stiction.core.errors import StictionError
from stiction.identification import in_loop
from stiction.identification.checks import Uniform
from stiction.identification.closed_loop import START, ClosedLoop, LoopError
from stiction.identification.example import SATURN_LITE, example_log
from stiction.identification.in_loop import close_loop, controller, fit_in_loop
from stiction.identification.model import Model
from stiction.identification.output_error import OutputError
from stiction.identification.pipeline import identify_joint
from stiction.identification.regression import fit_rows
from stiction.identification.runs import make_run
from stiction.identification.setup import IdentifySetup
from stiction.joints.pd import PDGains

PAYLOAD = IdentifySetup(payload_mass=1.0, payload_distance=0.2, payload_angle=0.3)


def test_the_reason_is_what_happened(monkeypatch: pytest.MonkeyPatch) -> None:
    """A k below zero, several logs, gravity beside k, a simulation that cannot be done: four reasons, not one."""
    run = make_run(without_torque(example_log()), None, PAYLOAD)
    base = fit_rows(run.rows, run.model, strength_unknown=True)
    assert "a strength k of -" in (close_loop(run, base)[1].reason or "")
    base = replace(base, values=np.abs(base.values))
    several = replace(base, rows=replace(base.rows))
    assert "only several logs together" in (close_loop(run, several)[1].reason or "")
    hanging = fit_rows(run.rows, Model("coulomb", True), strength_unknown=True)
    assert "gravity on the link" in (close_loop(run, hanging)[1].reason or "")

    def refuse(*arguments: object, **words: object) -> OutputError:
        raise LoopError("output error is not done: the joint would run away")

    monkeypatch.setattr(in_loop, "fit_output_error", refuse)
    assert close_loop(run, base)[1].reason == "output error is not done: the joint would run away"


def test_parameters_that_the_simulation_does_not_tell_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The message names the parameters without information, not the gains."""
    run = make_run(example_log(), None, IdentifySetup())
    base = fit_rows(run.rows, run.model)
    estimate = close_loop(run, base)[1].symmetric
    assert estimate is not None
    blurred = replace(estimate, unidentified=("offset", "viscous_friction"))
    monkeypatch.setattr(in_loop, "fit_output_error", lambda *arguments, **words: blurred)
    reason = close_loop(run, base)[1].reason
    assert reason is not None and reason.endswith("does not tell viscous_friction")


def test_a_simulation_that_cannot_be_done_costs_the_joint_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a simulation, regression stands, with a warning and its reason."""
    monkeypatch.setattr("stiction.identification.closed_loop.simulate", _runs_away)
    record = identify_joint(example_log()).record
    assert record.coulomb_friction is not None and record.diagnostics["output_error"] is None
    assert "output error is not done: it runs away" in record.warnings
    run = make_run(example_log(), None, IdentifySetup())
    assert fit_in_loop(run, fit_rows(run.rows, run.model)) is None


def _runs_away(*arguments: object, **words: object) -> None:
    raise StictionError("it runs away")


@pytest.mark.filterwarnings("error")
def test_a_late_loop_without_friction_runs_away_and_is_no_number() -> None:
    """A gain of 1, 0.05 s late, on 0.004 kg m² makes damping −0.05: e^(6 t) for 40 s was 1e72 degrees."""
    time = 0.01 * np.arange(4000)
    signals = Uniform(time, 0.01, np.zeros(4000), None, np.sin(time), None)
    values = dict.fromkeys(START, 0.0) | {"inertia": 0.004, "viscous_friction": 0.0, "coulomb_friction": 0.0}
    loop = ClosedLoop(signals, PDGains(1.0, 0.0), Model("coulomb"), {"delay": 0.05, "offset": 0.0})
    with pytest.raises(LoopError, match="the simulated joint runs away"):
        loop.run(values)


def test_delays_that_no_joint_has_are_the_users_to_mend() -> None:
    """Rejects a declared delay that takes half of the inertia, with the allowed range."""
    with pytest.raises(StictionError, match=r"delays 0.50. s: with kd .* expected 0 to"):
        identify_joint(without_torque(example_log()), setup=IdentifySetup(velocity_delay=0.5))


@pytest.mark.parametrize(("lacking", "message"), [("kp", "no kp and kd"), ("target", "no target")])
def test_without_gains_or_target_there_is_no_loop(lacking: str, message: str) -> None:
    """A joint without a known controller is not simulated."""
    run = make_run(example_log(SATURN_LITE), None, IdentifySetup())
    changes = {"kp": {"setup": replace(run.setup, kp=None)}, "target": {"signals": replace(run.signals, target=None)}}
    with pytest.raises(LoopError, match=message):
        controller(replace(run, **changes[lacking]))
    base = fit_rows(run.rows, run.model)
    loop = close_loop(replace(run, **changes[lacking]), base)[1]
    assert loop.symmetric is None and loop.reason is not None and loop.reason.startswith(message)
    assert np.isfinite(base.values).all()
