"""Policies of others, made by hand: a small network in ONNX with metadata, and what files say of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from stiction.deploy.network_file import FLOAT, NetworkFile, Node, Port
from stiction.exchange.policies.onnx_file import constant, write_network
from stiction.robots.catalog import find_robot

ROBOT = "go2"
JOINTS = find_robot(ROBOT).joint_names


def network(
    inputs: int,
    outputs: int = 12,
    metadata: Mapping[str, str] | None = None,
    names: tuple[str, str] = ("obs", "actions"),
    batch: int | None = None,
    seed: int = 0,
) -> bytes:
    """Return tanh(W observation) in ONNX, with ports of these names and a batch that is fixed where it is given."""
    weights = 0.1 * np.random.default_rng(seed).standard_normal((inputs, outputs))
    nodes = (Node("MatMul", (names[0], "w"), ("h",), {}), Node("Tanh", ("h",), (names[1],), {}))
    held = {"w": constant("w", weights.astype(np.float32))}
    ports = (Port(names[0], FLOAT, (batch, inputs)), Port(names[1], FLOAT, (batch, outputs)))
    return write_network(NetworkFile(nodes, held, *ports), 13, 8, metadata)


def numbers(value: float, count: int = 12) -> str:
    """Return a number over and over, as mjlab writes lists."""
    return ",".join([f"{value:.3f}"] * count)


MJLAB = {
    "run_path": "local",
    "joint_names": ",".join(JOINTS),
    "joint_stiffness": numbers(25.0),
    "joint_damping": numbers(0.6),
    "default_joint_pos": ",".join(["0.000", "0.900", "-1.800"] * 4),
    "command_names": "twist",
    "observation_names": "base_ang_vel,projected_gravity,joint_pos,joint_vel,actions,command",
    "observation_terms_scale": "1.000,1.000,1.000,0.050,1.000,2.000;2.000;0.250",
    "observation_terms_flatten_history_dim": "True,True,True,True,True,True",
    "observation_terms_history_length": "0,3,0,0,2,0",
    "observation_terms_clip": "-10.000;10.000,-inf;inf,-inf;inf,-inf;inf,-inf;inf,-inf;inf",
    "action_scale": numbers(0.25),
}
"""mjlab's metadata of a policy of the Go2: 3 + 3 x 3 + 12 + 12 + 2 x 12 + 3 = 63 numbers."""


def written(path: Path, content: bytes | str) -> Path:
    """Write a file and return its path."""
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path
