"""Recording of golden vectors: one robot walks in MuJoCo; its sensors and its policy's answers are stored. No torch."""

from __future__ import annotations

import numpy as np

from stiction.core.provenance import seed_streams
from stiction.deploy.control import Driver
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import PolicyStep
from stiction.evaluation.rollout import Rollout
from stiction.files.contract import Contract
from stiction.files.golden import BEYOND, SENSED, Golden, clips
from stiction.joints.pd import controller_torque
from stiction.robots.model import Robot
from stiction.virtual.drive import drive

STEPS = 600
"""Number of recorded steps: 12 s at 50 Hz."""

RESET_EVERY, COMMAND_EVERY = 200, 50

"""Steps between two resets, and between two new commands."""
COMMAND_BOUND = (0.6, 0.3, 0.6)
"""Half-widths of the random commands: forward, sideways [m/s], turn [rad/s]."""


EXTREME_STEPS = 24
"""Number of recorded steps with readings beyond any walk, after those of the walk."""

EXTREME_SHARES = (0.0, 0.25, 0.5, 1.0)
"""Share of the joints at their clips in such a step, in turn; at least one joint."""


def record_golden(contract: Contract, policy: Driver, spec: Robot, seed: int = 0) -> Golden:
    """Drive one robot with the contract's nominal joints; return its readings and its policy's answers.

    policy: for one robot. After the walk and one more reset, the readings drive observation, action and torque to their
    limits.
    """
    streams = seed_streams(seed, ["golden noise", "golden commands", "golden extremes"])
    noise = [streams["golden noise"]]
    rollout = Rollout(contract, policy, spec, contract.array("friction")[None], noise, law=contract.law)
    bound = np.array(COMMAND_BOUND)
    steps: list[tuple[Sensors, PolicyStep]] = []
    total = STEPS + EXTREME_STEPS
    resets, commands = np.zeros(total, dtype=bool), np.zeros((total, 3))
    needs_reset = False

    def command(t: int) -> np.ndarray:
        resets[t] = t % RESET_EVERY == 0 or needs_reset
        if resets[t]:
            rollout.reset(np.array([0]))
        fresh = t % COMMAND_EVERY == 0
        commands[t] = streams["golden commands"].uniform(-bound, bound) if fresh else commands[t - 1]
        return commands[t : t + 1]

    for step in drive(rollout, command, STEPS):
        steps.append((step.sensors, step.policy))
        # The reset is made, and recorded, at the next step: the policy's answer in this step stays.
        needs_reset = bool(rollout.truth().fallen[0])
    rollout.loop.reset()
    resets[STEPS] = True
    for t in range(STEPS, total):
        seen = steps[t % RESET_EVERY][0]
        sensors, commands[t] = extreme_reading(contract, seen, commands[t - 1], t, streams["golden extremes"])
        steps.append((sensors, rollout.loop.act(sensors, commands[t : t + 1])))
    sensed = [sensors.arrays() for sensors, _ in steps]
    arrays = {name: np.concatenate([each[name] for each in sensed]) for name in sensed[0]}
    arrays |= {
        name: np.concatenate([getattr(step, name) for _, step in steps]) for name in ("observation", "action", "target")
    }
    motors = (spec.joint_values(name) for name in ("kp", "kd", "torque_limit"))
    torque = controller_torque(arrays["target"], arrays["joint_position"], arrays["joint_velocity"], *motors)
    time = np.arange(total) * contract.control_period
    walked = np.arange(total) < STEPS
    return Golden(np.array(contract.joint_names), time, resets, commands, **arrays, torque=torque, walked=walked)


def extreme_reading(
    contract: Contract, walked: Sensors, command: np.ndarray, step: int, generator: np.random.Generator
) -> tuple[Sensors, np.ndarray]:
    """Return a reading and a command at a step, with some entries beyond the clips of the observation.

    Every fourth step all joints and the base are beyond. walked: a reading of one robot, shapes (1, ...), for the rest.
    """
    share, rest = EXTREME_SHARES[step % len(EXTREME_SHARES)], contract.array("standing")
    readings = {name: value.copy() for name, value in walked.arrays().items()} | {"command": command[None]}
    if share == 1.0:
        quaternion = generator.standard_normal(4)
        readings["quaternion"] = (quaternion / np.linalg.norm(quaternion))[None]
    for term in contract.observation.terms:
        whole = term.name in ("angular_velocity", "command")
        if term.name not in SENSED or not clips(contract, term) or (whole and share < 1.0):
            continue
        chosen = generator.random(term.size) < share
        chosen[generator.integers(term.size)] = True
        side = generator.choice((-1.0, 1.0), term.size) * BEYOND * term.clips / term.scales
        side = side + rest if term.offset == "standing" else side
        readings[term.name] = np.where(chosen, side, readings[term.name])
    turned = readings.pop("command")[0]
    return Sensors(**readings), turned
