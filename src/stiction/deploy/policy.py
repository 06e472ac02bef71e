"""Policy as it runs on a robot: observation builder, network (onnxruntime), joint targets."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from stiction.core.errors import BundleError, PolicyError
from stiction.deploy.network_file import FLOAT, Port, read_network
from stiction.deploy.observation import ObservationBuilder, Sensors
from stiction.deploy.operators import VELOCITY_SIZE, check_network
from stiction.files.contract import Contract
from stiction.joints.compensation import compensated

# From release 1.29 on its wheels keep an identifier of the machine, and send their maker an account of every session,
# unless this variable says otherwise when they are loaded. A robot does not do that unasked.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
import onnxruntime

INPUT, OUTPUT, VELOCITY = "observation", "action", "velocity"
"""Names of the network's input and outputs; the second output is present where the contract corrects commands."""

UNIT_ERROR = 0.05
"""Largest difference of a quaternion's length from 1: orientation filters keep it within 0.001, and one of them sends
16-bit integers; all zeros, of an IMU that has not started, would count as level."""


class Network:
    """ONNX network, run by onnxruntime on one CPU thread: observation (N, size) -> action (N, J), float32."""

    def __init__(self, model: bytes, observation_size: int, num_actions: int, estimates: bool = False) -> None:
        """Load the network from its bytes, once its file, every operator, size and its work are known to be in bounds.

        estimates: True if it has the output velocity. Raises `BundleError`, see `check_model`.
        """
        check_model(model, observation_size, num_actions, estimates)
        self._outputs = [OUTPUT, VELOCITY] if estimates else [OUTPUT]
        self._session = open_session(model)

    def run(self, observation: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Return the actions, (N, J), and the velocity of the base [m/s], (N, 2), or None, all float32.

        observation: float32, shape (N, size). Raises `PolicyError`: the network fails on an input of the right shape,
        or returns a value that is not finite.
        """
        try:
            outputs = self._session.run(self._outputs, {INPUT: observation})
        except Exception as error:  # Of a class for each status code, see `open_session`.
            raise PolicyError(f"policy.onnx failed on an observation of shape {observation.shape}: {error}") from error
        for output in outputs:
            if not np.isfinite(output).all():
                raise PolicyError("policy.onnx returned an action that is not finite; do not run this policy")
        return outputs[0], outputs[1] if len(outputs) > 1 else None

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Return the actions alone; see `run`."""
        return self.run(observation)[0]


def check_model(model: bytes, observation_size: int, num_actions: int, estimates: bool = False) -> int:
    """Return the multiplications of a network in one step of one robot; nothing is run for it.

    Raises `BundleError`: an unsupported network, see `read_network` and `check_network`, or one with other
    inputs and outputs than (batch, observation_size), (batch, num_actions) and, if it `estimates`, (batch, 2).
    """
    file = read_network(model)
    _check_port("input", file.input, INPUT, observation_size)
    _check_port("output", file.output, OUTPUT, num_actions)
    if estimates and file.velocity is not None:
        _check_port("output", file.velocity, VELOCITY, VELOCITY_SIZE)
    elif estimates or file.velocity is not None:
        raise BundleError(
            f"policy.onnx has {1 + (file.velocity is not None)} outputs; expected {1 + estimates}, as the contract's "
            "command_correction says; export the bundle again"
        )
    return check_network(file, observation_size, num_actions)


def open_session(model: bytes) -> onnxruntime.InferenceSession:
    """Return a network, ONNX that was checked, ready to run on one CPU thread.

    Raises `BundleError`: onnxruntime does not take it.
    """
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    # Without this it would parse the unchecked bytes as its own format.
    options.add_session_config_entry("session.load_model_format", "ONNX")
    try:
        return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime raises a different class for each of its status codes
        raise BundleError(f"policy.onnx cannot be loaded: {error}; export the bundle again") from error


def _check_port(side: str, port: Port, name: str, size: int) -> None:
    if (port.name, port.kind, port.shape) != (name, FLOAT, (None, size)):
        raise BundleError(
            f"policy.onnx has the {side} {port.name!r}, type {port.kind}, shape {port.shape}; expected {name!r}, "
            f"float32 (type {FLOAT}), shape (batch, {size})"
        )


@dataclass(frozen=True)
class PolicyStep:
    """Result of one step of the policy."""

    observation: np.ndarray
    """Input of the network, float32, shape (*batch, size)."""
    action: np.ndarray
    """Output of the network after clipping, float32, shape (*batch, J)."""
    target: np.ndarray
    """Joint targets [rad], shape (*batch, J)."""
    velocity: np.ndarray | None = None
    """Estimated velocity of the base, forward and sideways [m/s], float32, shape (*batch, 2); None: not estimated."""


class Policy:
    """Sensors and command in, joint targets out; holds the history and the last action of every robot.

    This is the fast one, for simulators and batches: it knows no time and no names, and rejects only invalid numbers.
    On a machine use `deploy.robot_policy.RobotPolicy`, which asks for both.
    """

    def __init__(
        self,
        contract: Contract,
        network: Network,
        batch: tuple[int, ...] = (),
        known_friction: np.ndarray | None = None,
    ) -> None:
        """Start with an empty history; batch: `()` or `(N,)`; known_friction: see `ObservationBuilder`."""
        self.contract, self._network, self._batch = contract, network, batch
        self._standing, self._scale = contract.array("standing"), contract.scale
        self._clip = np.float32(contract.action_clip)
        known = contract.known_friction_array if known_friction is None else known_friction
        self._builder = ObservationBuilder(
            contract.observation, self._standing, batch, known, contract.scale, contract.control_period
        )
        self._last_action = np.zeros((*batch, contract.num_joints), dtype=np.float32)

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget the history and the last action of the robots in `mask` (bool, the batch's shape), or of all."""
        chosen = np.ones(self._batch, dtype=bool) if mask is None else np.asarray(mask, dtype=bool)
        self._builder.reset(chosen)
        self._last_action = np.where(chosen[..., None], np.float32(0.0), self._last_action)

    def take_over(self, last_action: np.ndarray) -> None:
        """Replace the last step's action in the history by `last_action`, clipped, shape (*batch, J)."""
        self._last_action = np.array(last_action, dtype=np.float32).reshape(self._last_action.shape)

    def step(self, sensors: Sensors, command: np.ndarray) -> PolicyStep:
        """Advance by one control period; the returned arrays are the caller's own, to write into as well.

        command: forward, sideways [m/s], turn [rad/s], shape (*batch, 3). Raises `PolicyError`: a sensor or the command
        is not finite, a quaternion is not of unit length, or contract and caller lack the observed friction.
        """
        _check_reading(sensors, command)
        observation = self._builder.step(sensors, command, self._last_action)
        unclipped, velocity = self._network.run(np.atleast_2d(observation))
        action = np.minimum(np.maximum(unclipped.reshape(self._last_action.shape), -self._clip), self._clip)
        self._last_action = action.copy()
        target = self._standing + self._scale * action.astype(np.float64)
        if self.contract.compensation is not None:
            angle, push = self.contract.array("compensation"), self.contract.push
            target = compensated(target, sensors.joint_position, sensors.joint_velocity, angle, push)
        return PolicyStep(observation, action, target, None if velocity is None else velocity.reshape(*self._batch, -1))


def _check_reading(sensors: Sensors, command: np.ndarray) -> None:
    """Reject an invalid reading of any robot of a batch; see `Policy.step`."""
    signals = sensors.arrays() | {"command": command}
    # One pass over all of it in the usual case; the name is searched only where something is wrong.
    if not np.isfinite(np.concatenate(list(signals.values()), axis=None)).all():
        name = next(name for name, value in signals.items() if not np.isfinite(value).all())
        kind = "command" if name == "command" else f"sensor {name!r}"
        raise PolicyError(f"the {kind} is not finite (NaN or infinite); stop the robot and find out why")
    square = np.square(sensors.quaternion).sum(axis=-1)
    # The square of a length is off by twice as much, to first order.
    if not (off := np.abs(square - 1.0)).max() < 2 * UNIT_ERROR:
        raise PolicyError(
            f"a quaternion has the length {np.sqrt(np.ravel(square)[np.argmax(off)]):.3g}; expected an orientation, of "
            "length 1 (w, x, y, z)"
        )


def load_policy(
    contract: Contract, model: bytes, batch: tuple[int, ...] = (), known_friction: np.ndarray | None = None
) -> Policy:
    """Return the policy of a bundle's contract and network; see `Policy` and `Network` for shapes and errors."""
    network = Network(model, contract.observation.size, contract.num_joints, contract.estimates_velocity)
    return Policy(contract, network, batch, known_friction)
