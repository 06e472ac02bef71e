"""Records golden vectors: one robot walks in MuJoCo, and what it measured and its policy answered is kept. No torch."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from stiction.core.provenance import seed_streams
from stiction.deploy.policy import PolicyStep
from stiction.evaluate.rollout import Driver, Rollout, RolloutStep
from stiction.formats.contract import Contract
from stiction.formats.golden import Golden
from stiction.joints.pd import controller_torque
from stiction.robots.model import Robot

STEPS = 600
"""Recorded steps: 12 s at 50 Hz."""

RESET_EVERY, COMMAND_EVERY = 200, 50
"""Steps between resets, and between new commands."""

COMMAND_BOUND = (0.6, 0.3, 0.6)
"""Half-widths of the random commands: forward, sideways [m/s], turn [rad/s]."""


def record_golden(contract: Contract, policy: Driver, spec: Robot, seed: int = 0) -> Golden:
    """Drive one robot with the contract's nominal joints and return what it measured and what the policy computed.

    policy: a batch of one; seed: of noise, initial states and commands.
    """
    streams = seed_streams(seed, ["golden noise", "golden commands"])
    noise = [streams["golden noise"]]
    rollout = Rollout(contract, policy, spec, contract.array("friction")[None], noise, law=contract.law)
    bound = np.array(COMMAND_BOUND)
    steps: list[RolloutStep] = []
    resets, commands = np.zeros(STEPS, dtype=bool), np.zeros((STEPS, 3))
    needs_reset = False
    for t in range(STEPS):
        resets[t] = t % RESET_EVERY == 0 or needs_reset
        if resets[t]:
            rollout.reset(np.array([0]))
        fresh = t % COMMAND_EVERY == 0
        commands[t] = streams["golden commands"].uniform(-bound, bound) if fresh else commands[t - 1]
        steps.append(rollout.step(commands[t : t + 1]))
        needs_reset = bool(rollout.fleet.fallen()[0]) or len(steps[-1].blown_up) > 0
    sensed = [step.sensors.arrays() for step in steps]
    arrays = {name: np.concatenate([each[name] for each in sensed]) for name in sensed[0]}
    arrays |= {
        part.name: np.concatenate([getattr(step.policy, part.name) for step in steps]) for part in fields(PolicyStep)
    }
    motors = (spec.joint_values(name) for name in ("kp", "kd", "torque_limit"))
    torque = controller_torque(arrays["target"], arrays["joint_position"], arrays["joint_velocity"], *motors)
    time = np.arange(STEPS) * contract.control_period
    return Golden(np.array(contract.joint_names), time, resets, commands, **arrays, torque=torque)
