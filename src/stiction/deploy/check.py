"""Checks a policy bundle as a robot's computer can: with onnxruntime and NumPy alone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stiction.core.errors import BundleError, RobotError
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import Policy, PolicyStep, load_policy
from stiction.deploy.wear import WearMonitor
from stiction.formats.bundle import Bundle, Golden, read_bundle
from stiction.formats.contract import Contract
from stiction.robots.catalog import find_robot
from stiction.robots.model import Robot


def robot_of(contract: Contract, robot: str | None = None) -> Robot:
    """Return the robot that a contract was made for, checked against it.

    It is the contract's own; of an older bundle the shipped one of its name. `robot` names another one to use in its
    place: a path, or `package.module:NAME`, which runs that module.

    Raises `StictionError`: the robot is unknown, or its joints or torque limits are not those of the contract.
    """
    if robot is None and contract.anatomy is not None:
        return contract.anatomy
    if robot is None and not contract.robot.partition("@")[0].isidentifier():
        raise RobotError(
            f"the bundle is for the robot {contract.robot!r}, which is not a shipped one; "
            "if you trust that module, name it with --robot"
        )
    spec = find_robot(robot or contract.robot)
    if spec.joint_names != contract.joint_names:
        raise RobotError(f"robot {spec.name!r} has the joints {spec.joint_names}, the bundle {contract.joint_names}")
    if not np.allclose(spec.joint_values("torque_limit"), contract.array("torque_limit")):
        raise RobotError(
            f"robot {spec.name!r} has other torque limits than the bundle; name the right one with --robot"
        )
    return spec


OF_CONTRACT = ("robot", "method", "friction_law", "friction_level", "known_friction")
"""What the summary of a check says of the contract."""

TOLERANCE = 1e-5
"""Largest difference between the recording and the replay, in units of observation and action and in rad."""


@dataclass(frozen=True)
class BundleCheck:
    """A bundle that passed every check."""

    bundle: Bundle
    """The bundle, as it was read and hashed."""
    steps: int
    """Golden steps that were replayed."""
    observation_error: float
    """Largest difference of the observation [-]."""
    action_error: float
    """Largest difference of the action [-]."""
    target_error: float
    """Largest difference of the joint target [rad]."""

    def summary(self) -> dict:
        """Return plain data for `--json`; `wear`: what the wear monitor estimates the friction of: joints, `level`."""
        contract, wear = self.bundle.contract, self.bundle.wear
        return {
            "ok": True,
            "bundle": self.bundle.name,
            "digest": self.bundle.digest,
            "size": self.bundle.size,
            **{name: getattr(contract, name) for name in OF_CONTRACT},
            "wear": [] if wear is None else [t for t, known in zip(wear.targets, wear.told, strict=True) if known],
            "steps": self.steps,
            "tolerance": TOLERANCE,
            "observation_error": self.observation_error,
            "action_error": self.action_error,
            "target_error": self.target_error,
        }


def check_bundle(path: Path | str) -> BundleCheck:
    """Read a bundle, load its network and replay its golden vectors; return what was found.

    Raises `StictionError`: the first thing that is wrong: files, checksums, contract, network, or the replay.
    """
    bundle = read_bundle(path)
    policy = load_policy(bundle.contract, bundle.policy)
    if bundle.wear is not None:
        WearMonitor(bundle.contract, bundle.wear)
    replayed = replay(policy, bundle.golden)
    errors = {
        name: float(np.abs(getattr(replayed, name).astype(np.float64) - getattr(bundle.golden, name)).max())
        for name in ("observation", "action", "target")
    }
    for name, error in errors.items():
        if not error <= TOLERANCE:  # also catches NaN
            raise BundleError(
                f"{path}: the replay differs from golden.npz by {error:.3g} in the {name}, more than {TOLERANCE:g}: "
                "policy, contract and golden vectors do not belong together; get the bundle again"
            )
    return BundleCheck(bundle, len(bundle.golden), *errors.values())


def replay(policy: Policy, golden: Golden) -> PolicyStep:
    """Run the policy over the recorded sensors, step by step; return every step's outputs, shapes (T, ...).

    The last action that enters each observation is the recorded one, like every other input: two runtimes that round
    differently would otherwise drift apart over the steps, and the tolerance would have to allow for it.
    """
    steps = []
    for t in range(len(golden)):
        if golden.reset[t]:
            policy.reset()
        sensors = Sensors(
            golden.quaternion[t], golden.angular_velocity[t], golden.joint_position[t], golden.joint_velocity[t]
        )
        steps.append(policy.step(sensors, golden.command[t]))
        policy.take_over(golden.action[t])
    return PolicyStep(*(np.stack([getattr(s, name) for s in steps]) for name in ("observation", "action", "target")))
