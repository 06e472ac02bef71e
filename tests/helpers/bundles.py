"""Makes policy bundles by hand, a random linear network on a shipped robot, without torch and without physics."""

from __future__ import annotations

import hashlib
import json
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stiction.deploy.control import ControlLoop
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import load_policy
from stiction.deploy.wear import BODY_MOMENTS, JOINT_MOMENTS
from stiction.files.bundle import listed, write_bundle
from stiction.files.contract import Contract
from stiction.files.contract_rules import IMPORTED
from stiction.files.contract_training import ERAS, FRICTION_RANGES
from stiction.files.golden import Golden
from stiction.files.observation import proprioception
from stiction.files.wear import WearCalibration, WearModel
from stiction.joints.pd import controller_torque
from stiction.robots.catalog import find_robot
from stiction.robots.model import Robot

RANGES = FRICTION_RANGES | {IMPORTED: (0.0, 0.0)}

SENSORS = ("quaternion", "angular_velocity", "joint_position", "joint_velocity")


def make_contract(robot: str | Robot = "saturn_lite", **changes) -> Contract:
    """Return a valid contract for a shipped robot, or one that goes with it, with some fields changed."""
    spec = find_robot(robot) if isinstance(robot, str) else robot
    per_joint = {
        "kp": "kp",
        "kd": "kd",
        "standing": "default_position",
        "lower": "lower",
        "upper": "upper",
        "torque_limit": "torque_limit",
        "armature": "armature",
        "damping": "damping",
    }
    values = {
        "robot": spec.name,
        "anatomy": None if isinstance(robot, str) else robot,
        "terrain": "flat",
        "method": "none",
        "seed": 0,
        "friction_law": "coulomb",
        "friction_level": 0.2,
        "joint_names": spec.joint_names,
        "control_period": 0.02,
        "decimation": 4,
        "physics_timestep": 0.005,
        **{field: tuple(spec.joint_values(name).tolist()) for field, name in per_joint.items()},
        "observation": proprioception(spec.num_joints),
        "action_scale": spec.action_scale,
        "action_clip": 4.0,
        "revision": "0000000",
        "command": "made by a test",
    }
    values |= changes
    values.setdefault("phases", None if values["anatomy"] is None else 1)
    values.setdefault(
        "friction_range", tuple(values["friction_level"] * end for end in RANGES.get(values["method"], (0.0, 0.0)))
    )
    friction = tuple(values["friction_level"] * limit for limit in values["torque_limit"])
    return Contract(**({"friction": friction} | values))


def with_limits(robot: Robot, name: str, lower: float, upper: float) -> Robot:
    """Return a robot of another name whose joints all have these limits [rad]."""
    joints = tuple(replace(joint, lower=lower, upper=upper) for joint in robot.joints)
    return replace(robot, name=name, joints=joints)


def aged(contract: Contract, field: str) -> dict[str, Any]:
    """Return the JSON object of a contract from before a field existed: without it and all that came with or later."""
    data = json.loads(contract.to_json())
    era = next(number for number, names in enumerate(ERAS) if field in names)
    return {name: value for name, value in data.items() if not any(name in names for names in ERAS[era:])}


def make_network(contract: Contract, seed: int = 0, gain: float = 0.02) -> bytes:
    """Return an ONNX network, action = W observation, with random weights of the given size."""
    onnx = pytest.importorskip(
        "onnx", reason="the package onnx, of the extra 'train', is needed to make a test network"
    )
    generator, size = np.random.default_rng(seed), contract.observation.size
    weights = (gain * generator.standard_normal((size, contract.num_joints))).astype(np.float32)
    more = {"velocity": generator.standard_normal((size, 2)).astype(np.float32)} if contract.estimates_velocity else {}
    return linear_network(onnx, weights, more=more)


def linear_network(
    onnx,
    weights: np.ndarray,
    inputs: str = "observation",
    batch: str | int = "batch",
    more: dict[str, np.ndarray] | None = None,
) -> bytes:
    """Return an ONNX network with one matrix product for its action, and one for each of `more` outputs."""
    port, outputs = onnx.helper.make_tensor_value_info, {"action": weights} | (more or {})
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("MatMul", [inputs, f"weights_{name}"], [name]) for name in outputs],
        "linear",
        [port(inputs, onnx.TensorProto.FLOAT, [batch, weights.shape[0]])],
        [port(name, onnx.TensorProto.FLOAT, [batch, values.shape[1]]) for name, values in outputs.items()],
        [onnx.numpy_helper.from_array(values, f"weights_{name}") for name, values in outputs.items()],
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 18)], ir_version=10)
    return model.SerializeToString()


def make_golden(contract: Contract, model: bytes, steps: int = 500, seed: int = 0) -> Golden:
    """Return golden vectors over random sensors, two resets and changing commands; arrays of the caller's own."""
    key = repr(contract), model, steps, seed
    if key not in _GOLDENS:
        _GOLDENS[key] = _step_through(contract, model, steps, seed)
    return deepcopy(_GOLDENS[key])


_GOLDENS: dict[tuple[str, bytes, int, int], Golden] = {}
"""Cache of `make_golden`: hundreds of tests use the same golden vectors, which take a policy many steps."""


def _step_through(contract: Contract, model: bytes, steps: int, seed: int) -> Golden:
    """Compute what `make_golden` returns."""
    generator = np.random.default_rng(seed)
    joints = contract.num_joints
    position = contract.array("standing") + 0.2 * generator.standard_normal((steps, joints))
    quaternion = np.array([1.0, 0.0, 0.0, 0.0]) + 0.1 * generator.standard_normal((steps, 4))
    golden = Golden(
        joint_names=np.array(contract.joint_names),
        time=np.arange(steps) * contract.control_period,
        reset=np.isin(np.arange(steps), [0, steps // 2]),
        command=np.repeat(generator.uniform(-0.5, 0.5, (steps // 100, 3)), 100, axis=0),
        quaternion=quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True),
        angular_velocity=generator.standard_normal((steps, 3)),
        joint_position=np.clip(position, contract.array("lower"), contract.array("upper")),
        joint_velocity=generator.standard_normal((steps, joints)),
        observation=np.zeros((steps, contract.observation.size), np.float32),
        action=np.zeros((steps, joints), np.float32),
        target=np.zeros((steps, joints)),
    )
    loop, outputs = ControlLoop(load_policy(contract, model), contract), []
    for t in range(steps):
        if golden.reset[t]:
            loop.reset()
        outputs.append(loop.act(Sensors(*(getattr(golden, name)[t] for name in SENSORS)), golden.command[t]))
    computed = {name: np.stack([getattr(o, name) for o in outputs]) for name in ("observation", "action", "target")}
    motors = (contract.array(name) for name in ("kp", "kd", "torque_limit"))
    torque = controller_torque(computed["target"], golden.joint_position, golden.joint_velocity, *motors)
    return replace(golden, **computed, torque=torque)


def repair_sums(folder: Path) -> None:
    """Write SHA256SUMS anew, as someone would who altered a file on purpose."""
    names = listed([path.name for path in folder.iterdir()])
    lines = [f"{hashlib.sha256((folder / name).read_bytes()).hexdigest()}  {name}\n" for name in names]
    (folder / "SHA256SUMS").write_text("".join(lines))


def make_bundle(path: Path, contract: Contract, model: bytes | None = None) -> Path:
    """Write a complete bundle that passes every check; return its path."""
    model = make_network(contract) if model is None else model
    return write_bundle(path, contract, model, make_golden(contract, model), "# Toy\n")


def make_wear(contract: Contract, **changes) -> WearModel:
    """A map that reads each joint's friction off the mean of e·sign(θ'), the level off the first joint's."""
    joints = contract.num_joints
    weights = np.zeros((JOINT_MOMENTS * joints + BODY_MOMENTS, joints + 1))
    weights[3 * joints : 4 * joints, :joints] = np.eye(joints)
    weights[3 * joints, joints] = 1.0
    values = {
        "joint_names": contract.joint_names,
        "window": 3,
        "center": (0.0,) * len(weights),
        "scale": (1.0,) * len(weights),
        "limit": 3.0,
        "weights": tuple(map(tuple, weights.tolist())),
        "intercept": (0.01,) * (joints + 1),
        "reach": (0.02,) * (joints + 1),
        "estimated": (True,) * joints + (True,),
        "determination": (0.9,) * (joints + 1),
        "coverage": (0.95,) * (joints + 1),
        "threshold": 0.5,
        "highest": 0.24,
        "unusual": 1.0,
        "student": "0" * 64,
    }
    return WearModel(**(values | changes))


def make_calibration(contract: Contract, **changes) -> WearCalibration:
    """Return a calibration of `make_wear`: 0.01 too low; the second joint's interval is as wide as the map."""
    targets = contract.num_joints + 1
    wide = (0.0, 0.15, *(0.0,) * (targets - 2))
    values = {
        "shift": (0.01,) * targets,
        "lower": tuple(-0.03 - more for more in wide),
        "upper": tuple(0.05 + more for more in wide),
        "held": (0.94,) * targets,
        "held_before": (0.1,) * targets,
        "robots": (500, 501),
        "tested": (1100,),
        "engine": "physx+all",
    }
    return WearCalibration(**(values | changes))
