"""All joints of a log: in order, alike on one core and on several, each refused or identified for itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from shanks import GO1
from stiction.core.errors import StictionError
from stiction.core.provenance import THREADS_VARIABLE
from stiction.files.joints import REFUSED
from stiction.files.log import JointSignals, Log
from stiction.identification.example import SATURN_LITE, Excitation, example_log
from stiction.identification.pipeline import identify_joint, identify_log

SHORT = Excitation(duration=8.0)


def signals(seed: int = 0, motor=SATURN_LITE) -> JointSignals:
    """Return the signals of a simulated joint."""
    return example_log(motor, SHORT, seed=seed).joints["shank"]


def robot(**joints: JointSignals) -> Log:
    """Return a log of several joints under Saturn Lite's gains."""
    return replace(example_log(SATURN_LITE, SHORT), source="robot.csv", joints=joints)


def stuck() -> JointSignals:
    """Return the signals of a joint at rest."""
    moving = signals()
    return replace(moving, position=np.zeros_like(moving.position))


@pytest.fixture
def serial(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the work in this process: to start others takes longer than the joints do."""
    monkeypatch.setenv(THREADS_VARIABLE, "1")


def test_several_processes_give_exactly_what_one_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every number and rejection is equal, and in the order of the log."""
    log = robot(zeta=signals(1), mid=stuck(), alpha=signals(2, GO1), beta=signals(3))
    results, reported = [], []
    for threads in ("1", "2"):
        monkeypatch.setenv(THREADS_VARIABLE, threads)
        heard: list[str] = []
        results.append(identify_log(log, done=heard.append))
        reported.append(sorted(heard))
    (alone, refused), (together, also) = results
    assert list(alone) == list(together) == ["zeta", "alpha", "beta"]
    for name, one in alone.items():
        assert one.record == together[name].record, name
        for field in ("time", "position", "fitted_torque", "simulated_torque", "used"):
            np.testing.assert_array_equal(getattr(one.fit, field), getattr(together[name].fit, field))
    assert list(refused) == ["mid"] and refused == also
    assert reported == [["alpha", "beta", "zeta"]] * 2


@pytest.mark.usefixtures("serial")
def test_a_refused_joint_says_why_and_stops_nobody() -> None:
    """The record of a rejected joint has one warning with the reason; the other joints are identified."""
    results, refused = identify_log(robot(hip=stuck(), knee=signals(1)))
    assert list(results) == ["knee"] and list(refused) == ["hip"]
    assert refused["hip"].coulomb_friction is None and len(refused["hip"].warnings) == 1
    assert refused["hip"].warnings[0].startswith(REFUSED + "robot.csv: ")
    # Where no joint can be identified there is nothing to write: the first reason is raised.
    log = robot(hip=stuck(), knee=replace(stuck(), torque=None, target=None))
    raised = []
    for names in ((), ("hip",)):
        with pytest.raises(StictionError, match=r"robot\.csv") as caught:
            identify_joint(log, *names) if names else identify_log(log)
        raised.append(str(caught.value))
    assert raised[0] == raised[1]


@pytest.mark.usefixtures("serial")
def test_repeats_go_with_their_joint() -> None:
    """Each joint is compared with the same joint of the repeat, and agrees with it."""
    log = robot(hip=signals(1), knee=signals(2, GO1))
    results, _ = identify_log(log, repeats=(robot(knee=signals(12, GO1), hip=signals(11)),))
    for name in ("hip", "knee"):
        labels = {item["label"]: item for item in results[name].record.diagnostics["comparisons"]}
        assert labels["repeat 1"]["disputed"] == [], name
