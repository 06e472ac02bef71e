"""Every shipped policy of flat ground starts from exactly the standing pose, measured without error."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to walk")

from stiction.deploy.policy import load_policy
from stiction.evaluation.rollout import Rollout, friction_at
from stiction.files.bundle import read_bundle, shipped_bundles
from stiction.files.contract import robot_of
from stiction.files.following import COMMAND_SET
from stiction.files.velocity import STAND, parse_command
from stiction.task.config import NoiseCfg

COMMANDS = [parse_command(text) for text in COMMAND_SET if text != STAND]


class Exact:
    """A generator that draws no error: joints begin in the standing pose itself."""

    def uniform(self, low: float, high: float, width: int) -> np.ndarray:
        """Return the middle."""
        return np.full(width, 0.5 * (low + high))


@pytest.mark.parametrize(
    ("method", "levels"), [("deception", (0.0, 0.1, 0.24)), ("direct", (0.0, 0.1, 0.24)), ("none", (0.0,))]
)
def test_every_command_is_begun_from_exactly_the_standing_pose(method: str, levels: tuple[float, ...]) -> None:
    """A state that is its own mirror image gives a symmetric action, which is no step; `none` knows no friction."""
    bundle = read_bundle(shipped_bundles()[f"saturn_lite-flat-{method}-0.2"])
    contract, count = bundle.contract, len(COMMANDS)
    asked = np.tile([command.velocity for command in COMMANDS], (len(levels), 1))
    policy, still = load_policy(contract, bundle.policy, (len(asked),)), cast(np.random.Generator, Exact())
    friction = friction_at(contract, np.repeat(levels, count))
    rollout = Rollout(contract, policy, robot_of(contract), friction, [still], noise=NoiseCfg(0, 0, 0, 0))
    assert np.ptp(rollout.fleet.joint_position, axis=0).max() == 0.0
    periods = round(1.0 / contract.control_period)
    velocity = np.zeros_like(asked)
    for period in range(2 * periods):
        rollout.step(asked)
        truth = rollout.truth()
        assert not truth.fallen.any()
        velocity += truth.velocity / periods * (period >= periods)
    reached = np.divide(velocity, asked, out=np.ones_like(asked), where=asked != 0.0).min(axis=1)
    slow = {
        f"{COMMANDS[robot % count].label} at {levels[robot // count]:.0%}": round(float(reached[robot]), 2)
        for robot in np.flatnonzero(reached < 0.5)
    }
    assert not slow
