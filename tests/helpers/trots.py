"""Walks of simulated robots of known friction as strangers log them: sampled, in their columns, nothing of the truth.

Physics and motor controllers run at 1 kHz; targets come at 50 Hz, from an open-loop trot (Go2, `studies.flags.trot`) or
a trained policy (hexapod).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to have a robot walk")

from stiction.deploy.policy import load_policy
from stiction.evaluation.rollout import Rollout
from stiction.evaluation.walk_logs import record_motion
from stiction.robots.catalog import find_robot
from stiction_experiments.flags.trot import (
    ARMATURE,
    DAMPING,
    IMU,
    KD,
    KP,
    TIMESTEP,
    Walked,
    at_imu,
    limits,
    opened,
    sampled,
    trot,
)
from walks import walking_bundle

__all__ = ["ARMATURE", "DAMPING", "IMU", "KD", "KP", "Walked", "limits", "opened", "sampled", "trot"]

GO2, HEXAPOD = find_robot("go2"), find_robot("saturn_lite")


def hexapods(friction: np.ndarray, command: tuple[float, float, float], seconds: float, seed: int = 0) -> list[Walked]:
    """Return walks of hexapods whose joints have dry friction [N m], shape (N, 18); those that fell are left out."""
    bundle = walking_bundle()
    contract = replace(bundle.contract, physics_timestep=TIMESTEP, decimation=20)
    generators = [np.random.default_rng([seed, index]) for index in range(len(friction))]
    rollout = Rollout(contract, load_policy(contract, bundle.policy, (len(friction),)), HEXAPOD, friction, generators)
    steps = round(seconds / contract.control_period)
    walks = []
    for truth in record_motion(rollout, contract.array("kd"), np.tile(command, (len(friction), 1)), steps):
        if truth is None or len(truth["time"]) < steps * 20:
            continue
        rate = truth["angular_velocity"]
        turning = np.gradient(rate, TIMESTEP, axis=0)
        force = np.stack([at_imu(*row) for row in zip(truth["specific_force"], rate, turning, strict=True)])
        names = ("joint_position", "joint_velocity", "joint_target", "joint_torque", "quaternion")
        walks.append(Walked(*(truth[name] for name in names), rate, force, truth["foot_contact"].astype(float)))
    return walks
