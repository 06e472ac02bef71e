"""Golden vectors exercise what they are to vouch for: resets, a history that rolls over, every clip and limit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bundles import make_contract, make_golden, make_network
from stiction.core.errors import BundleError
from stiction.deploy.check import check_bundle
from stiction.deploy.policy import load_policy
from stiction.files.bundle import write_bundle
from stiction.files.contract import Contract, robot_of
from stiction.files.golden import Golden, exercise_of, read_golden, write_golden
from stiction.files.observation import ObservationLayout

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to record a walk")

from stiction.evaluation.golden import EXTREME_STEPS, STEPS, record_golden

CLIPS = ("clip of angular_velocity", "clip of command", "clip of joint_position", "clip of joint_velocity")


@pytest.fixture(scope="module")
def recorded() -> tuple[Contract, bytes, Golden]:
    """A contract, a network and what export records of both."""
    contract = make_contract("go1")
    model = make_network(contract)
    return contract, model, record_golden(contract, load_policy(contract, model, (1,)), robot_of(contract))


def test_a_new_recording_exercises_every_limit(recorded: tuple[Contract, bytes, Golden]) -> None:
    """A new recording reaches every clip and limit; older recordings reach none."""
    contract, model, golden = recorded
    exercise = exercise_of(golden, contract)
    assert exercise.missed == () and exercise.reached == (*CLIPS, "clip of the action", "torque limit")
    assert exercise.resets >= 3 and exercise.rolls_over
    # A reset in the middle fills the history with the frame of that step.
    frames = golden.observation.reshape(len(golden), contract.observation.history_length, -1)
    after = np.flatnonzero(golden.reset)[1:]
    assert (frames[after] == frames[after][:, -1:]).all() and not (frames[after - 1] == frames[after - 1][:, -1:]).all()
    plain = exercise_of(make_golden(contract, model), contract)
    assert {*CLIPS, "clip of the action"} == {*plain.missed} and plain.resets == 1


@pytest.mark.parametrize("change", [*CLIPS[:1], *CLIPS[2:], "action", "torque", "fill"])
def test_another_clip_does_not_pass(recorded: tuple[Contract, bytes, Golden], tmp_path: Path, change: str) -> None:
    """A replay with another clip fails: every clip is reached by the recording."""
    contract, model, golden = recorded
    terms = tuple(
        replace(term, clip=1.1 * term.clip) if term.name in change else term for term in contract.observation.terms
    )
    other = replace(contract, observation=ObservationLayout(terms))
    if change == "action":
        other = replace(contract, action_clip=1.1 * contract.action_clip)
    if change == "torque":
        other = replace(
            contract, torque_limit=tuple(1.01 * t for t in contract.torque_limit), friction_level=0.2 / 1.01
        )
    if change == "fill":
        golden = replace(golden, reset=golden.reset & (np.arange(len(golden)) < STEPS))
        other = contract
    with pytest.raises(BundleError, match=r"differs|torques of"):
        check_bundle(write_bundle(tmp_path / "forged", replace(other, robot="nobody"), model, golden, ""))


def test_made_up_readings_are_marked_and_few(recorded: tuple[Contract, bytes, Golden]) -> None:
    """Extreme readings are marked, so that a replay on a machine can leave them out, and are few."""
    contract, _, golden = recorded
    assert golden.walked is not None and not golden.walked[STEPS:].any() and golden.walked[:STEPS].all()
    assert len(golden) == STEPS + EXTREME_STEPS
    back, _ = read_golden(write_golden(golden, {}), contract)
    np.testing.assert_array_equal(back.walked, golden.walked)
    few = np.arange(len(golden)) < 500
    with pytest.raises(BundleError, match="80% of its steps were walked"):
        read_golden(write_golden(replace(golden, walked=few), {}), contract)
    with pytest.raises(BundleError, match="'walked' is float64"):
        read_golden(write_golden(replace(golden, walked=np.ones(len(golden))), {}), contract)
