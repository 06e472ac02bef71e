"""Logs of simulated walks: the evaluation's own episodes, as sensors with errors see them."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

import walks
from stiction.core.errors import StictionError
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.walk_logs import LogNoiseCfg, RecordCfg, measure_walk, record_motion, record_walks

SHORT = EvaluationCfg(friction_levels=(0.0, 0.2), commands=("vx=0.5", "stand"), episodes=2, seconds=3.0)


def test_a_log_for_each_level_command_and_robot() -> None:
    """Each log has its level, command and robot, and not the friction of its joints."""
    recorded = record_walks(walks.walking_bundle(), SHORT, RecordCfg(robots=2, seconds=1.0))
    labels = [(item.level, item.command, item.robot) for item in recorded]
    assert labels == [(level, name, robot) for level in (0.0, 0.2) for name in ("vx=0.5", "stand") for robot in (0, 1)]
    log = recorded[0].log
    assert log is not None
    assert (len(log), log.header.period, log.header.command) == (200, 0.005, "vx=0.5")
    assert "friction" not in json.dumps(asdict(log.header))
    assert recorded[0].file_name == "0--vx=0.5--0.npz"


def test_logging_does_not_change_the_walk() -> None:
    """The logged motion ends in the state of the evaluated one, physics step by step."""
    friction = np.tile(0.1 * walks.LIMITS, (2, 1))
    commands = np.array([walks.FORWARD, walks.CURVE])
    evaluated, logged = walks.start(friction), walks.start(friction)
    for _ in range(60):
        evaluated.step(commands)
    truths = record_motion(logged, walks.walking_bundle().contract.array("kd"), commands, 60)
    np.testing.assert_array_equal(logged.fleet.qpos, evaluated.fleet.qpos)
    assert truths[0] is not None
    assert truths[0]["joint_position"].shape == (240, 18)


def test_sensors_have_the_errors_that_are_stated() -> None:
    """The log's errors have the stated sizes: the grid of the encoder, and the noise of the rest."""
    truth = walks.walk(np.zeros((1, 18)), [walks.FORWARD], walks.NO_NOISE, seconds=5.0)[0]
    noise = LogNoiseCfg(specific_force_bias=0.2, joint_torque_zero=0.01)
    log = measure_walk(truth, noise, np.random.default_rng(0))
    steps = log.joint_position / noise.encoder_resolution
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert np.abs(log.joint_position - truth.joint_position).max() <= noise.encoder_resolution / 2 + 1e-9
    np.testing.assert_allclose((log.angular_velocity - truth.angular_velocity).std(), noise.angular_velocity, rtol=0.05)
    assert log.joint_torque is not None and truth.joint_torque is not None
    error = (log.joint_torque - truth.joint_torque) / walks.LIMITS
    np.testing.assert_allclose(error.std(axis=0), noise.joint_torque, rtol=0.15)
    assert 0.002 < np.abs(error.mean(axis=0)).max() < 0.011
    assert log.specific_force is not None and truth.specific_force is not None
    bias = (log.specific_force - truth.specific_force).mean(axis=0)
    assert 0.02 < np.abs(bias).max() < 0.21
    np.testing.assert_allclose(np.linalg.norm(log.quaternion, axis=1), 1.0)


def test_a_fall_ends_the_log() -> None:
    """A fall ends the log. This robot is pushed over after a second and a half."""
    rollout = walks.start(np.zeros((2, 18)))
    original, calls = rollout.step, []

    def step(command: np.ndarray):
        calls.append(1)
        if len(calls) == 75:
            rollout.fleet.qvel[0, 3] = 30.0
        return original(command)

    rollout.step = step  # type: ignore[method-assign]
    fallen, upright = record_motion(rollout, walks.walking_bundle().contract.array("kd"), np.zeros((2, 3)), 150)
    assert fallen is not None and upright is not None
    assert 300 <= len(fallen["time"]) < 400
    assert len(upright["time"]) == 600


@pytest.mark.parametrize("change", [{"robots": 0}, {"seconds": 0.5}, {"seconds": float("nan")}])
def test_what_cannot_be_recorded_is_refused(change: dict) -> None:
    """One line before any physics runs."""
    with pytest.raises(StictionError, match="expected"):
        replace(RecordCfg(), **change)


def test_negative_noise_is_refused() -> None:
    """Rejects negative noise."""
    with pytest.raises(StictionError, match="joint_torque"):
        LogNoiseCfg(joint_torque=-1.0)
