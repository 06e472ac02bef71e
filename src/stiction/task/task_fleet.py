"""Robots of the task, in torch: the NumPy fleet on the host, its motors, and the choice of the simulator of a training.

The task uses the same interface of `HostFleet` and of `sim.torch_fleet.TorchFleet`, which stays on the device of MuJoCo
Warp. Values read are copies; robots are selected as in `sim.indexing`.

Motors of an Actuator Net, in NumPy: gains and delays are the net's, and the simulator's delay is off. A motor strength
multiplies the net's output. Its torque is held over a step, so that damping is explicit. Friction: a net of motor-side
torque does not contain the joint's friction, which the simulation keeps; a net of output-side torque contains dry and
viscous friction, and the simulation's are zero. Rotor inertia is in neither.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

import mujoco
import numpy as np
import torch

from stiction.core.errors import EngineError
from stiction.files.method import find_method
from stiction.joints.friction import Law
from stiction.joints.net import ActuatorMemory, ActuatorNet
from stiction.sim.fleet import Fleet, JointFriction
from stiction.sim.indexing import to_ids
from stiction.sim.native import NativeSimulation, Simulation
from stiction.task.config import TaskCfg

if TYPE_CHECKING:
    from stiction.sim.torch_fleet import TorchFleet

TaskFleet: TypeAlias = "HostFleet | TorchFleet"


class NetMotors:
    """Motors of a fleet with the torque of an Actuator Net, from targets that are held over the control period."""

    def __init__(self, fleet: Fleet, net: ActuatorNet) -> None:
        """Replace the actuators and, if the net includes it, friction. Raises `FileError` for a net that does not
        match.
        """
        net.check_use(fleet.spec.name, fleet.spec.joint_names, fleet.torque_limit, fleet.timestep)
        self.net, self.memory = net, ActuatorMemory(net, fleet.num_envs)
        self.strength = np.ones((fleet.num_envs, fleet.spec.num_joints))
        """Delivered torque over the net's, shape (N, J); the torque limit stays."""
        self._command = fleet.drive_by_torque()
        if self.holds_friction:
            fleet.friction[:] = 0.0
            fleet.damping[:] = 0.0
        fleet.before_step.append(self._act)
        fleet.after_reset.append(self.memory.forget)

    @property
    def holds_friction(self) -> bool:
        """True if the joints' dry and viscous friction are in the net: the simulation's must then be zero."""
        return self.net.torque_source == "output_side"

    def _act(self, fleet: Fleet) -> None:
        """Set the torques of the coming physics step; the simulator clips them to the limits."""
        # A robot that blew up within the control period is reset at its end; until then its numbers are what they are.
        with np.errstate(invalid="ignore", over="ignore"):
            torque = self.memory.torque(fleet.targets, fleet.joint_position, fleet.joint_velocity)
            np.multiply(torque, self.strength, out=self._command)

    def state(self) -> dict[str, np.ndarray]:
        """Return the state of the next torque apart from the simulation and `strength`, copies, for a checkpoint."""
        return {"past": self.memory.past.copy(), "fresh": self.memory.fresh.copy()}

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Restore a `state`."""
        self.memory.past[...] = state["past"]
        self.memory.fresh[...] = state["fresh"]


def to_tensor(array: np.ndarray) -> torch.Tensor:
    """Return a float32 copy of a live float64 array of the simulation."""
    return torch.from_numpy(array.astype(np.float32))


def copied(name: str) -> Any:
    """Return the property that copies an array of `Fleet` into a tensor."""
    return property(lambda self: to_tensor(getattr(self.fleet, name)))


class HostFleet:
    """`Fleet`, with the friction of its joints and their motors."""

    def __init__(self, fleet: Fleet, laws: tuple[Law, ...], motors: NetMotors | None = None) -> None:
        """Start without friction; `motors`: those of an Actuator Net, in place of the PD law."""
        self.fleet, self.motors, self.task_device = fleet, motors, torch.device("cpu")
        self.law = JointFriction(fleet, *laws)
        self.spec, self.num_envs, self.timestep = fleet.spec, fleet.num_envs, fleet.timestep
        self.standing, self.torque_limit = fleet.standing, fleet.torque_limit
        self.nominal_kp, self.nominal_kd = fleet.nominal_kp, fleet.nominal_kd
        self.blown_up = fleet.blown_up
        self.start: np.ndarray | None = None
        """Starts of the next reset, if not the origin, (n, 2) [m]."""

    base_angular_velocity = copied("base_angular_velocity")
    base_linear_velocity = copied("base_linear_velocity")
    base_quaternion = copied("base_quaternion")
    joint_position = copied("joint_position")
    joint_velocity = copied("joint_velocity")
    torque = copied("torque")

    @property
    def height(self) -> torch.Tensor:
        """Height of the base above the ground under it [m], (N,)."""
        return to_tensor(self.fleet.base_position[:, 2] - self.fleet.ground)

    @property
    def foot_contact(self) -> torch.Tensor:
        """True for each foot that carries load, (N, feet) bool."""
        return torch.from_numpy(self.fleet.foot_contact)

    def fallen(self) -> torch.Tensor:
        """Return whether each robot has fallen or is about to, (N,) bool."""
        return torch.from_numpy(self.fleet.fallen())

    def set_targets(self, targets: torch.Tensor) -> None:
        """Set the joint targets of every robot [rad], (N, joints)."""
        self.fleet.set_targets(targets.numpy())

    def step(self) -> torch.Tensor:
        """Advance one control period; return the mask of robots that blew up, (N,) bool, reset to standing."""
        blown_up = torch.zeros(self.num_envs, dtype=torch.bool)
        blown_up[self.fleet.step()] = True
        return blown_up

    def push(self, velocity: torch.Tensor, which: torch.Tensor) -> None:
        """Add `velocity` [m/s] to the horizontal velocity of the bases `which` in the world, (len(which), 2)."""
        ids, velocity = to_ids(which, velocity)
        self.fleet.push(velocity.double().numpy(), ids.numpy())

    def set_parameters(self, values: Mapping[str, torch.Tensor], which: torch.Tensor) -> None:
        """Apply parameters of `Randomizer.apply` to the robots `which`, and recompute the derived constants."""
        names, fleet = list(values), self.fleet
        ids, *rows = to_ids(which, *values.values())
        robots, parameters = ids.numpy(), {name: row.numpy() for name, row in zip(names, rows, strict=True)}
        fleet.armature[robots] = parameters["armature"]
        fleet.damping[robots] = parameters["damping"]
        levels = [parameters[name] for name in ("frictionloss", "load_coefficient") if name in parameters]
        self.law.set_level(*levels, ids=robots, numbers=parameters)
        if self.motors is None:
            fleet.set_gains(parameters["kp"], parameters["kd"], robots)
            fleet.delay[robots] = parameters["delay"]
        else:
            self.motors.strength[robots] = parameters["motor_strength"]
        fleet.set_ground_friction(parameters["ground_friction"][:, 0], robots)
        if "contact_time" in parameters:
            fleet.set_contact_time(parameters["contact_time"][:, 0], robots)
        fleet.base_mass[robots] = parameters["base_mass"]
        fleet.base_com[robots] = parameters["base_com"]
        # Last: it derives constants from the masses and armatures above.
        fleet.set_const(robots)

    def reset(
        self,
        which: torch.Tensor,
        offset: torch.Tensor | None = None,
        heading: torch.Tensor | None = None,
        velocity: torch.Tensor | None = None,
    ) -> None:
        """Stand the robots `which` at their starts, `offset` [rad] from the standing pose, (len(which), joints).

        `heading` [rad]; `velocity`: of the base, (len(which), 6), linear in the world and angular in its frame.
        """
        values = {"joint_position": offset, "heading": heading, "velocity": velocity}
        known = {name: value for name, value in values.items() if value is not None}
        ids, *rows = to_ids(which, *known.values())
        start_values = {name: row.double().numpy() for name, row in zip(known, rows, strict=True)}
        if offset is not None:
            start_values["joint_position"] = self.standing + start_values["joint_position"]
        start, self.start = self.start, None
        self.fleet.reset(ids.numpy(), **start_values, position=start)

    def state(self) -> dict[str, Any]:
        """Return a copy of the simulation's state, for a checkpoint."""
        return self.fleet.simulation.state()

    def load_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Restore a `state`."""
        self.fleet.simulation.load_state({name: value.numpy() for name, value in state.items()})


@dataclass(frozen=True)
class Device:
    """Simulator and its torch device."""

    torch: str = "cpu"
    """Device of observations and actions."""
    backend: Callable[[mujoco.MjModel, int, int], Simulation] = NativeSimulation
    """Function that makes the batched simulation of a task on the host, from model, number and threads."""
    fleet: Callable[..., TaskFleet] | None = None
    """Function that makes the robots of a task on the device, from robot, number, physics step, decimation and
    `PhysicsCfg`; None: the task is on the host."""


CPU = Device()


def host_reason(task: TaskCfg, netted: bool = False) -> str | None:
    """Return why a task, or a net, must stay on the host, or None."""
    method = find_method(task.friction.method)
    lacking = {
        f"terrain {task.terrain.kind!r}": task.terrain.kind != "flat",
        f"the friction law {task.friction.law!r}": bool(task.friction.joint_law.spec.reads),
        "friction that grows with load": task.friction.load is not None,
        "an Actuator Net": netted,
        f"the method {method.name!r}": method.acts_on_fleet,
    }
    return " and ".join(name for name, is_used in lacking.items() if is_used) or None


def find_device(name: str, contacts: int, gpu: int = 0, on_host: bool = True) -> Device:
    """Return a device by its name; `contacts`: room for them, per robot; `on_host`: only the simulator is on it.

    Raises `StictionError` for a device missing on this machine, `ModuleNotFoundError` without the extra `gpu`.
    """
    if name == "cpu":
        return CPU
    from stiction.sim.torch_fleet import TorchFleet
    from stiction.sim.warp import WarpSimulation
    from stiction.sim.worlds import cuda_device

    def computing(where: str, device: str) -> Device:
        fleet = None if on_host else partial(TorchFleet, device=device, contacts=contacts)
        return Device(where, partial(WarpSimulation, device=device, contacts=contacts), fleet)

    if name == "warp-cpu":
        return computing("cpu", "cpu")
    device = cuda_device(gpu)
    if not torch.cuda.is_available():
        raise EngineError(
            f"torch {torch.__version__} finds no CUDA device, though MuJoCo Warp does; install a build of torch for "
            "your driver (https://pytorch.org), or train with --device cpu"
        )
    return computing("cuda", device)
