"""The policy as it runs on a robot: observation builder, network (onnxruntime), joint targets.

An ONNX file is a protocol-buffer message: a sequence of (field number, wire type, value). Only the few messages that
can contain a tensor are followed; the field numbers are those of onnx.proto.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import onnxruntime

from stiction.core.errors import BundleError, PolicyError
from stiction.deploy.observation import ObservationBuilder, Sensors
from stiction.formats.contract import Contract
from stiction.joints.pd import compensated

NESTED = {
    "model": {7: "graph", 20: "training", 25: "function"},
    "training": {1: "graph", 2: "graph"},
    "function": {7: "node", 11: "attribute"},
    "graph": {1: "node", 5: "tensor", 15: "sparse"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse", 23: "sparse"},
    "sparse": {1: "tensor", 2: "tensor"},
    "tensor": {},
}
"""Message -> field number -> message within it, as far as tensors can hide there."""

TENSOR_NAME, TENSOR_EXTERNAL_DATA, TENSOR_LOCATION = 8, 13, 14

MAX_DEPTH = 32
"""Deepest nesting that is followed: graphs within attributes of graphs."""


def external_tensors(data: bytes) -> list[str]:
    """Return the names of the tensors that the ONNX model `data` keeps in other files; empty for a whole model.

    Raises `BundleError`: the bytes are not a protocol-buffer message.
    """
    return list(_search(memoryview(data), "model", 0))


def _search(data: memoryview, message: str, depth: int) -> Iterator[str]:
    """Yield the names of external tensors within one message."""
    if depth > MAX_DEPTH:
        raise BundleError(
            f"policy.onnx is nested deeper than {MAX_DEPTH} messages; it is not a network that is run here"
        )
    name, external = "", False
    for field, value in _fields(data):
        if message == "tensor":
            if field == TENSOR_NAME and isinstance(value, memoryview):
                name = bytes(value).decode("utf-8", "replace")
            external |= field == TENSOR_EXTERNAL_DATA or (field == TENSOR_LOCATION and value != 0)
        elif (inner := NESTED[message].get(field)) and isinstance(value, memoryview):
            yield from _search(value, inner, depth + 1)
    if external:
        yield name


def _fields(data: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """Yield (field number, value) of a message; the value is a number or the bytes of a field with a length."""
    position = 0
    while position < len(data):
        key, position = _varint(data, position)
        field, wire = key >> 3, key & 7
        if wire == 0:
            value, position = _varint(data, position)
            yield field, value
            continue
        if wire == 2:
            length, position = _varint(data, position)
        elif wire in (1, 5):
            length = 8 if wire == 1 else 4
        else:
            raise BundleError(f"policy.onnx is not an ONNX file: wire type {wire}; export the bundle again")
        if field == 0 or position + length > len(data):
            raise BundleError("policy.onnx is not an ONNX file, or it is cut off; export the bundle again")
        yield field, data[position : position + length]
        position += length


def _varint(data: memoryview, position: int) -> tuple[int, int]:
    """Return a base-128 number and the position after it."""
    value, shift = 0, 0
    while position < len(data) and shift < 70:
        byte = data[position]
        value |= (byte & 0x7F) << shift
        position, shift = position + 1, shift + 7
        if byte < 0x80:
            return value, position
    raise BundleError("policy.onnx is not an ONNX file, or it is cut off; export the bundle again")


INPUT, OUTPUT = "observation", "action"
"""Names of the network's one input and one output."""


class Network:
    """A network in ONNX, run by onnxruntime on one CPU thread: observation (N, size) -> action (N, J), float32."""

    def __init__(self, model: bytes, observation_size: int, num_actions: int) -> None:
        """Load the network from its bytes and check its input and output.

        Raises `BundleError`: not a model, tensors in other files, or other inputs and outputs than the contract needs.
        """
        if outside := external_tensors(model):
            raise BundleError(
                f"policy.onnx keeps {len(outside)} tensors in other files ({outside[0]!r}); expected none"
            )
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        try:
            self._session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime raises a different class for each of its status codes
            raise BundleError(f"policy.onnx cannot be loaded: {error}; export the bundle again") from error
        _check_port("input", self._session.get_inputs(), INPUT, observation_size)
        _check_port("output", self._session.get_outputs(), OUTPUT, num_actions)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Return the actions, float32, shape (N, J), for observations, float32, shape (N, size).

        Raises `PolicyError`: the network fails on an input of the right shape, or returns what is not finite.
        """
        try:
            action = self._session.run([OUTPUT], {INPUT: observation})[0]
        except Exception as error:  # as above
            raise PolicyError(f"policy.onnx failed on an observation of shape {observation.shape}: {error}") from error
        if not np.isfinite(action).all():
            raise PolicyError("policy.onnx returned an action that is not finite; do not run this policy")
        return action


def _check_port(kind: str, ports: list, name: str, size: int) -> None:
    """Check that there is one port of the given name, float32, with a free batch and the given size."""
    found = [(port.name, port.type, list(port.shape)) for port in ports]
    free_batch = len(found) == 1 and len(found[0][2]) == 2 and not isinstance(found[0][2][0], int)
    if not free_batch or found[0][:2] != (name, "tensor(float)") or found[0][2][1] != size:
        raise BundleError(f"policy.onnx has the {kind} {found}; expected one {name!r}, float32, shape (batch, {size})")


@dataclass(frozen=True)
class PolicyStep:
    """What one step of the policy computed."""

    observation: np.ndarray
    """Input of the network, float32, shape (*batch, size)."""
    action: np.ndarray
    """Output of the network after clipping, float32, shape (*batch, J)."""
    target: np.ndarray
    """Joint targets [rad], shape (*batch, J)."""


class Policy:
    """Sensors and command in, joint targets out; holds the history and the last action of every robot."""

    def __init__(
        self,
        contract: Contract,
        network: Network,
        batch: tuple[int, ...] = (),
        known_friction: np.ndarray | None = None,
    ) -> None:
        """Start with an empty history.

        Args:
            contract: what the policy expects.
            network: what it computes.
            batch: `()` for one robot or `(N,)`.
            known_friction: see `ObservationBuilder`, also for errors; by default what the contract says.

        """
        self.contract, self._network, self._batch = contract, network, batch
        self._standing, self._scale = contract.array("standing"), contract.scale
        known = contract.known_friction_array if known_friction is None else known_friction
        self._builder = ObservationBuilder(contract.observation, self._standing, batch, known, contract.scale)
        self._last_action = np.zeros((*batch, contract.num_joints), dtype=np.float32)

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget the history and the last action of the robots in `mask` (bool, the batch's shape), of all without."""
        chosen = np.ones(self._batch, dtype=bool) if mask is None else np.asarray(mask, dtype=bool)
        self._builder.reset(chosen)
        self._last_action = np.where(chosen[..., None], np.float32(0.0), self._last_action)

    def take_over(self, last_action: np.ndarray) -> None:
        """Go on as if the last step's action had been `last_action`, clipped, shape (*batch, J)."""
        self._last_action = np.asarray(last_action, dtype=np.float32).reshape(self._last_action.shape)

    def step(self, sensors: Sensors, command: np.ndarray) -> PolicyStep:
        """Advance by one control period.

        Args:
            sensors: what the robots measure now.
            command: commanded velocity, forward, sideways [m/s], turn [rad/s], shape (*batch, 3).

        Raises:
            PolicyError: a sensor or the command is NaN or infinite.
            StictionError: the policy is told the friction of its joints, and neither contract nor caller says it.

        """
        for name, value in {**vars(sensors), "command": command}.items():
            if not np.isfinite(value).all():
                kind = "command" if name == "command" else f"sensor {name!r}"
                raise PolicyError(f"the {kind} is not finite (NaN or infinite); stop the robot and find out why")
        observation = self._builder.step(sensors, command, self._last_action)
        clip = np.float32(self.contract.action_clip)
        action = np.clip(self._network(np.atleast_2d(observation)), -clip, clip).reshape(self._last_action.shape)
        self._last_action = action
        target = self._standing + self._scale * action.astype(np.float64)
        if self.contract.compensation is not None:
            angle = self.contract.array("compensation")
            target = compensated(target, sensors.joint_position, angle, self.contract.compensation_width)
        return PolicyStep(observation, action, target)


def load_policy(
    contract: Contract,
    model: bytes,
    batch: tuple[int, ...] = (),
    known_friction: np.ndarray | None = None,
) -> Policy:
    """Return the policy of a bundle's contract and network; see `Policy` and `Network` for shapes and errors."""
    return Policy(contract, Network(model, contract.observation.size, contract.num_joints), batch, known_friction)
