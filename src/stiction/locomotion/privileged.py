"""The privileged observation as a pure function: of what training drew, and of what an evaluation set."""

from __future__ import annotations

import numpy as np
import torch

PAYLOAD_UNIT, MULTIPLIER_UNIT, FRICTION_UNIT = 3.0, 0.2, 0.1
"""What an entry of 1 stands for: 3 kg of payload, a multiplier of 1.2, dry friction of 0.1 of the torque limit."""

PRIVILEGED_TERMS = (
    ("payload", "robot"),
    ("ground_friction", "robot"),
    ("armature", "joint"),
    ("damping", "joint"),
    ("friction", "joint"),
)
"""What o_priv holds, in its order: one entry a robot, or one for each joint."""


def privileged_observation(
    payload: torch.Tensor,
    ground_friction: torch.Tensor,
    armature: torch.Tensor,
    damping: torch.Tensor,
    friction: torch.Tensor,
) -> torch.Tensor:
    """Return o_priv = {m_b, f_g, I_j, B_j, f_j}, shape (N, 2 + 3 joints), each entry near unit size.

    Args:
        payload: mass added to the trunk [kg], shape (N, 1).
        ground_friction: multiplier of the sliding friction, shape (N, 1).
        armature: multiplier of each joint's rotor inertia, shape (N, joints).
        damping: multiplier of each joint's viscous friction, shape (N, joints).
        friction: dry friction of each joint as a fraction of its torque limit, see `friction_share`, shape (N, joints).

    """
    return torch.cat(
        (
            payload / PAYLOAD_UNIT,
            ground_friction - 1.0,
            (armature - 1.0) / MULTIPLIER_UNIT,
            (damping - 1.0) / MULTIPLIER_UNIT,
            friction / FRICTION_UNIT,
        ),
        -1,
    )


def nominal_privileged(friction: np.ndarray) -> torch.Tensor:
    """Return o_priv of robots that are nominal in all but their joints' dry friction, shape (N, 2 + 3 joints), float32.

    friction: as a fraction of the torque limit, see `friction_share`, shape (N, joints).
    """
    share = torch.from_numpy(np.asarray(friction, dtype=np.float32))
    one, column = torch.ones_like(share), torch.ones(len(share), 1)
    return privileged_observation(0.0 * column, column, one, one, share)
