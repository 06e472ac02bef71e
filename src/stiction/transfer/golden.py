"""Records golden vectors: one robot in MuJoCo, with noise, friction, resets and changing commands.

`export` drives it with the policy as training computes it, so that a replay by the runtime compares the two.
"""

from __future__ import annotations

import numpy as np

from stiction.formats.contract import Contract
from stiction.formats.golden import Golden
from stiction.formats.reproducibility import seed_streams
from stiction.robots.spec import RobotSpec
from stiction.transfer.rollout import Driver, Moment, Rollout

STEPS = 600
"""Recorded steps: 12 s at 50 Hz."""

RESET_EVERY, COMMAND_EVERY = 200, 50
"""Steps between resets, and between new commands."""

COMMAND_BOUND = (0.6, 0.3, 0.6)
"""Half-widths of the random commands: forward, sideways [m/s], turn [rad/s]."""


def record_golden(contract: Contract, policy: Driver, spec: RobotSpec, seed: int = 0) -> Golden:
    """Drive one robot with the contract's nominal joints and return what it measured and what the policy made of it.

    Args:
        contract: what the policy expects.
        policy: what drives it, a batch of one, `TrainedPolicy` for a bundle to be shipped.
        spec: the robot.
        seed: seed of noise, initial states and commands.

    """
    streams = seed_streams(seed, ["golden noise", "golden commands"])
    noise = [streams["golden noise"]]
    rollout = Rollout(contract, policy, spec, contract.array("friction")[None], noise, law=contract.law)
    bound = np.array(COMMAND_BOUND)
    moments: list[Moment] = []
    resets, commands = np.zeros(STEPS, dtype=bool), np.zeros((STEPS, 3))
    needs_reset = False
    for t in range(STEPS):
        resets[t] = t % RESET_EVERY == 0 or needs_reset
        if resets[t]:
            rollout.reset(np.array([0]))
        fresh = t % COMMAND_EVERY == 0
        commands[t] = streams["golden commands"].uniform(-bound, bound) if fresh else commands[t - 1]
        moments.append(rollout.step(commands[t : t + 1]))
        needs_reset = bool(rollout.fleet.fallen()[0]) or len(moments[-1].blown_up) > 0
    return Golden(
        joint_names=np.array(contract.joint_names),
        time=np.arange(STEPS) * contract.control_period,
        reset=resets,
        command=commands,
        quaternion=np.concatenate([moment.sensors.quaternion for moment in moments]),
        angular_velocity=np.concatenate([moment.sensors.angular_velocity for moment in moments]),
        joint_position=np.concatenate([moment.sensors.joint_position for moment in moments]),
        joint_velocity=np.concatenate([moment.sensors.joint_velocity for moment in moments]),
        observation=np.concatenate([moment.policy.observation for moment in moments]),
        action=np.concatenate([moment.policy.action for moment in moments]),
        target=np.concatenate([moment.policy.target for moment in moments]),
    )
