"""Makes Actuator Nets by hand: a net without hidden layers is a linear law, and can be a PD law exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stiction.joints.net import ActuatorNet, weight_groups
from stiction.robots.catalog import find_robot


def pd_net(robot: str = "saturn_lite", kp: float = 1.0, kd: float = 1.0, **changes) -> ActuatorNet:
    """Return a net that is the PD law of a robot, its gains times `kp` and `kd`, with some fields changed.

    H = 3: eight inputs, e_t to e_{t-3} and θ'_t to θ'_{t-3}, of which it uses the first of either.
    """
    spec = find_robot(robot)
    limits, groups = spec.joint_values("torque_limit"), weight_groups(spec.joint_names, "kind")
    layers = []
    for group in groups:
        joint = spec.joint_names.index(group[0])
        weight = np.zeros((1, 8), np.float32)
        weight[0, 0] = kp * spec.joint_values("kp")[joint] / limits[joint]
        weight[0, 4] = -kd * spec.joint_values("kd")[joint] / limits[joint]
        layers.append(((weight, np.zeros(1, np.float32)),))
    net = ActuatorNet(
        robot=spec.name,
        joint_names=spec.joint_names,
        torque_limit=tuple(limits.tolist()),
        groups=groups,
        inputs="default",
        history=3,
        period=0.005,
        torque_source="motor_side",
        layers=tuple(layers),
        training={"a.npz": "0" * 64},
        validation={"b.npz": "1" * 64},
        loss={"training": 0.0, "validation": 0.0},
        seed=0,
        revision="0000000",
        command="made by a test",
    )
    return replace(net, **changes)
