"""What the task asks of its robots, in torch; and the NumPy fleet, on the host, as such.

`sim.torch_fleet` is the other one: it keeps everything on the device of MuJoCo Warp.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
import torch

from stiction.joints.friction import Law
from stiction.robots.model import Robot
from stiction.sim.chosen import numbered
from stiction.sim.fleet import Fleet
from stiction.sim.friction import JointFriction
from stiction.sim.net_motors import NetMotors


def to_tensor(array: np.ndarray) -> torch.Tensor:
    """Return a float32 copy of a live float64 array of the simulation."""
    return torch.from_numpy(array.astype(np.float32))


class TaskFleet(Protocol):
    """N robots on one clock. What is read is a copy; robots are chosen as `sim.chosen` says."""

    spec: Robot
    num_envs: int
    timestep: float
    standing: np.ndarray
    torque_limit: np.ndarray
    nominal_kp: np.ndarray
    nominal_kd: np.ndarray
    home: torch.device
    """Where its tensors are."""
    blown_up: Any
    """How often each robot blew up, (N,)."""

    @property
    def base_angular_velocity(self) -> torch.Tensor:
        """Rates of the base in its own frame [rad/s], (N, 3)."""
        ...

    @property
    def base_linear_velocity(self) -> torch.Tensor:
        """Velocity of the base's origin in the base frame [m/s], (N, 3)."""
        ...

    @property
    def base_quaternion(self) -> torch.Tensor:
        """Orientation of the base, w, x, y, z, (N, 4)."""
        ...

    @property
    def height(self) -> torch.Tensor:
        """Height of the base above the ground under it [m], (N,)."""
        ...

    @property
    def joint_position(self) -> torch.Tensor:
        """Angles of the joints [rad], (N, joints)."""
        ...

    @property
    def joint_velocity(self) -> torch.Tensor:
        """Speeds of the joints [rad/s], (N, joints)."""
        ...

    @property
    def torque(self) -> torch.Tensor:
        """Torque of the motors [N m], (N, joints)."""
        ...

    @property
    def foot_contact(self) -> torch.Tensor:
        """Whether each foot carries load, (N, feet) bool."""
        ...

    def fallen(self) -> torch.Tensor:
        """Return whether each robot lies or is about to, (N,) bool."""
        ...

    def set_targets(self, targets: torch.Tensor) -> None:
        """Set the joint targets of every robot [rad], (N, joints)."""
        ...

    def step(self) -> torch.Tensor:
        """Advance one control period; return which robots blew up, (N,) bool, reset to standing."""
        ...

    def push(self, velocity: torch.Tensor, which: torch.Tensor) -> None:
        """Add `velocity` [m/s] to the horizontal velocity of the bases `which` in the world, (len(which), 2)."""
        ...

    def give(self, values: Mapping[str, torch.Tensor], which: torch.Tensor) -> None:
        """Give the robots `which` what `Randomizer.apply` has drawn, and recompute what derives from it."""
        ...

    def reset(
        self,
        which: torch.Tensor,
        offset: torch.Tensor | None = None,
        heading: torch.Tensor | None = None,
        velocity: torch.Tensor | None = None,
    ) -> None:
        """Stand the robots `which` at their starts, `offset` [rad] from the standing pose, (len(which), joints).

        `heading` [rad], (len(which),); `velocity`: of the base, (len(which), 6), linear in the world and angular in its
        own frame.
        """
        ...

    def state(self) -> dict[str, Any]:
        """Return a copy of the simulation's state, for a checkpoint."""
        ...

    def load_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Restore what `state` returned."""
        ...


def copied(name: str) -> Any:
    """Return the property that copies an array of `Fleet` into a tensor."""
    return property(lambda self: to_tensor(getattr(self.fleet, name)))


class HostFleet(TaskFleet):
    """`Fleet`, with the friction of its joints and what gives their torque."""

    def __init__(self, fleet: Fleet, laws: tuple[Law, ...], motors: NetMotors | None = None) -> None:
        """Begin without friction; `motors`: those of an Actuator Net, in place of the PD law."""
        self.fleet, self.motors, self.home = fleet, motors, torch.device("cpu")
        self.law = JointFriction(fleet, *laws)
        self.spec, self.num_envs, self.timestep = fleet.spec, fleet.num_envs, fleet.timestep
        self.standing, self.torque_limit = fleet.standing, fleet.torque_limit
        self.nominal_kp, self.nominal_kd = fleet.nominal_kp, fleet.nominal_kd
        self.blown_up = fleet.blown_up
        self.start: np.ndarray | None = None
        """Where the robots of the next reset begin, elsewhere than at the origin, (n, 2) [m]."""

    base_angular_velocity = copied("base_angular_velocity")
    base_linear_velocity = copied("base_linear_velocity")
    base_quaternion = copied("base_quaternion")
    joint_position = copied("joint_position")
    joint_velocity = copied("joint_velocity")
    torque = copied("torque")

    @property
    def height(self) -> torch.Tensor:
        """See `TaskFleet`."""
        return to_tensor(self.fleet.base_position[:, 2] - self.fleet.ground)

    @property
    def foot_contact(self) -> torch.Tensor:
        """See `TaskFleet`."""
        return torch.from_numpy(self.fleet.foot_contact)

    def fallen(self) -> torch.Tensor:
        """See `TaskFleet`."""
        return torch.from_numpy(self.fleet.fallen())

    def set_targets(self, targets: torch.Tensor) -> None:
        """See `TaskFleet`."""
        self.fleet.set_targets(targets.numpy())

    def step(self) -> torch.Tensor:
        """See `TaskFleet`."""
        blown_up = torch.zeros(self.num_envs, dtype=torch.bool)
        blown_up[self.fleet.step()] = True
        return blown_up

    def push(self, velocity: torch.Tensor, which: torch.Tensor) -> None:
        """See `TaskFleet`."""
        ids, velocity = numbered(which, velocity)
        self.fleet.push(velocity.double().numpy(), ids.numpy())

    def give(self, values: Mapping[str, torch.Tensor], which: torch.Tensor) -> None:
        """See `TaskFleet`."""
        names, fleet = list(values), self.fleet
        ids, *rows = numbered(which, *values.values())
        robots, given = ids.numpy(), {name: row.numpy() for name, row in zip(names, rows, strict=True)}
        fleet.armature[robots] = given["armature"]
        fleet.damping[robots] = given["damping"]
        levels = [given[name] for name in ("frictionloss", "load_coefficient") if name in given]
        self.law.set_level(*levels, ids=robots)
        if self.motors is None:
            fleet.set_gains(given["kp"], given["kd"], robots)
            fleet.delay[robots] = given["delay"]
        else:
            self.motors.strength[robots] = given["motor_strength"]
        fleet.set_ground_friction(given["ground_friction"][:, 0], robots)
        if "contact_time" in given:
            fleet.set_contact_time(given["contact_time"][:, 0], robots)
        fleet.base_mass[robots] = given["base_mass"]
        fleet.base_com[robots] = given["base_com"]
        # Last: it derives constants from the masses and armatures above.
        fleet.set_const(robots)

    def reset(
        self,
        which: torch.Tensor,
        offset: torch.Tensor | None = None,
        heading: torch.Tensor | None = None,
        velocity: torch.Tensor | None = None,
    ) -> None:
        """See `TaskFleet`; `start` holds for this once."""
        values = {"joint_position": offset, "heading": heading, "velocity": velocity}
        known = {name: value for name, value in values.items() if value is not None}
        ids, *rows = numbered(which, *known.values())
        given = {name: row.double().numpy() for name, row in zip(known, rows, strict=True)}
        if offset is not None:
            given["joint_position"] = self.standing + given["joint_position"]
        start, self.start = self.start, None
        self.fleet.reset(ids.numpy(), **given, position=start)

    def state(self) -> dict[str, Any]:
        """See `TaskFleet`."""
        return self.fleet.simulation.state()

    def load_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """See `TaskFleet`."""
        self.fleet.simulation.load_state({name: value.numpy() for name, value in state.items()})
