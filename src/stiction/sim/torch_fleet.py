"""Fleet of torch tensors on the device of MuJoCo Warp, float32: nothing passes through the host.

It has the part of `sim.fleet.Fleet` that training on flat ground needs under Coulomb's law, and no more.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import mujoco
import torch
import warp as wp

from stiction.robots.mjcf import build_model, foot_geometries
from stiction.robots.model import DELAY_SAMPLES, FALLEN_HEIGHT, FALLEN_UP, Robot
from stiction.robots.physics import EXACT, PhysicsCfg
from stiction.sim.fleet import BASE_DOFS, CONTACT_FORCE
from stiction.sim.indexing import assign, to_mask
from stiction.sim.native import STATE
from stiction.sim.worlds import CONTACTS, Worlds

CHECK_INTERVAL = 32
"""Control steps between two checks of the room for contacts, each of which synchronises with the device."""

READ_FIELDS = ("qacc", "actuator_force", "sensordata")
"""Derived fields that the task reads: right after a reset they are the nominal robot's in the standing pose."""


def _copied(view: Callable[[TorchFleet], torch.Tensor]) -> Any:
    """Return the property that copies a view of a fleet, as of `HostFleet`."""
    return property(lambda self: view(self).clone())


class TorchFleet(Worlds):
    """Robots of one kind on a plane. Values read are copies; robots are selected as in `sim.indexing`."""

    def __init__(
        self,
        spec: Robot,
        num_envs: int,
        timestep: float,
        decimation: int,
        physics: PhysicsCfg = EXACT,
        device: str = "cpu",
        contacts: int = CONTACTS,
    ) -> None:
        """Build the robots in their standing pose, without dry friction.

        `decimation`: physics steps of `timestep` [s] in a control period; `device`: `cpu` or `cuda:0`; `contacts`: a
        robot.
        """
        super().__init__(build_model(spec, timestep, physics=physics), num_envs, device, contacts)
        self.spec, self.num_envs, self.timestep, self.decimation = spec, num_envs, timestep, decimation
        self.task_device = torch.device(wp.device_to_torch(self._device))
        self.standing, self.torque_limit = spec.joint_values("default_position"), spec.joint_values("torque_limit")
        self.nominal_kp, self.nominal_kd = spec.joint_values("kp"), spec.joint_values("kd")
        self._bind()
        self._bind_model()
        self.blown_up = torch.zeros(num_envs, dtype=torch.long, device=self.task_device)
        self._lacking = torch.zeros(num_envs, dtype=torch.int32, device=self.task_device)
        self._steps = 0
        self._saved: dict[str, torch.Tensor] = {}
        self._streams: dict[int, wp.Stream] = {}
        self.reset(torch.ones(num_envs, dtype=torch.bool, device=self.task_device))

    def _tensor(self, array: wp.array) -> torch.Tensor:
        """Return the tensor over one of Warp's arrays, (N, ...), on the same memory."""
        return wp.to_torch(array, requires_grad=False)

    def _bind(self) -> None:
        """Create the views of the data."""
        fields = {name: getattr(self._d, name) for name in STATE if name != "time"}
        self._state = {name: self._tensor(field) for name, field in fields.items() if field.size}
        self._results = {name: self._tensor(getattr(self._d, name)) for name in READ_FIELDS}
        self._start = {
            name: torch.tensor(getattr(self._standing, name)).float().to(self.task_device) for name in READ_FIELDS
        }
        self._qpos, self._qvel, self._targets = (self._state[name] for name in ("qpos", "qvel", "ctrl"))
        joints = self.spec.num_joints
        self._delayed_targets = self._state["history"].view(self.num, joints, -1)[..., -DELAY_SAMPLES:]
        self._keys, self._overflow = self._tensor(self._key), self._tensor(self._d.overflow)
        self._rest = torch.from_numpy(self.standing).to(self.task_device)

    def _bind_model(self) -> None:
        """Make the randomised fields per-robot, and create views of them."""
        values_of = {
            name: self._tensor(self._differ(f"dof_{name}")) for name in ("armature", "damping", "frictionloss")
        }
        self._joints = {name: values[:, BASE_DOFS:] for name, values in values_of.items()}
        self._joints["frictionloss"].zero_()
        self._gain, self._bias, self._delay = (
            self._tensor(self._differ(f"actuator_{name}")) for name in ("gainprm", "biasprm", "delay")
        )
        base = self.model.body("base").id
        self._base_mass = self._tensor(self._differ("body_mass"))[:, base]
        self._base_com = self._tensor(self._differ("body_ipos"))[:, base]
        feet = [self.model.geom(name).id for name in foot_geometries(self.spec)]
        friction, softness = (self._tensor(self._differ(f"geom_{name}")) for name in ("friction", "solref"))
        self._foot_friction = [friction[:, foot, 0] for foot in feet]
        self._contact_time = [softness[:, foot, 0] for foot in feet]

    def _undo(self) -> None:
        """Restore the state before the first run of some work."""
        wp.synchronize_device(self._device)
        for name, value in self._saved.items():
            self._state[name].copy_(value)
        torch.cuda.synchronize(self.task_device)

    def _run(self, what: str | int, work: Callable[[], None]) -> None:
        """Run Warp's work after torch's earlier work, and before its later work; the host waits for neither."""
        if not self._device.is_cuda:
            self._launch(what, work)
            return
        if what not in self._graphs:
            # The first run loads kernels and is undone, see `_launch`.
            self._saved = {name: value.clone() for name, value in self._state.items()}
            torch.cuda.synchronize(self.task_device)
        stream = torch.cuda.current_stream(self.task_device)
        if stream.cuda_stream not in self._streams:
            self._streams[stream.cuda_stream] = wp.stream_from_torch(stream)
        warp_stream, torch_stream = self._device.stream, self._streams[stream.cuda_stream]
        warp_stream.wait_stream(torch_stream)
        self._launch(what, work)
        torch_stream.wait_stream(warp_stream)

    def _choose(self, which: torch.Tensor) -> torch.Tensor:
        """Give the worlds `which` the key 0, all others none; return their mask."""
        mask = to_mask(which, self.num)
        self._keys.copy_(torch.where(mask, 0, -1))
        return mask

    base_angular_velocity = _copied(lambda fleet: fleet._qvel[:, 3:6])
    base_quaternion = _copied(lambda fleet: fleet._qpos[:, 3:7])
    height = _copied(lambda fleet: fleet._qpos[:, 2])
    joint_position = _copied(lambda fleet: fleet._qpos[:, 7:])
    joint_velocity = _copied(lambda fleet: fleet._qvel[:, BASE_DOFS:])
    torque = _copied(lambda fleet: fleet._results["actuator_force"])

    @property
    def base_linear_velocity(self) -> torch.Tensor:
        """Velocity of the base's origin in the base frame [m/s], (N, 3)."""
        w, axis, velocity = self._qpos[:, 3:4], self._qpos[:, 4:7], self._qvel[:, :3]
        return velocity + 2.0 * torch.cross(axis, torch.cross(axis, velocity, dim=-1) - w * velocity, dim=-1)

    @property
    def foot_contact(self) -> torch.Tensor:
        """True for each foot that carries load, (N, feet) bool."""
        return self._results["sensordata"][:, : len(self.spec.feet)] > CONTACT_FORCE

    def fallen(self) -> torch.Tensor:
        """Return whether each robot has fallen or is about to, (N,) bool."""
        up = 1.0 - 2.0 * self._qpos[:, 4:6].square().sum(-1)
        return (up < FALLEN_UP) | (self._qpos[:, 2] < FALLEN_HEIGHT * self.spec.standing_height)

    def set_targets(self, targets: torch.Tensor) -> None:
        """Set the joint targets of every robot [rad], (N, joints)."""
        self._targets.copy_(targets)

    def push(self, velocity: torch.Tensor, which: torch.Tensor) -> None:
        """Add `velocity` [m/s] to the horizontal velocity of the bases `which` in the world, (len(which), 2)."""
        before = self._qvel[:, :2] if which.dtype == torch.bool else self._qvel[which, :2]
        assign(self._qvel[:, :2], which, before + velocity)

    def set_parameters(self, values: Mapping[str, torch.Tensor], which: torch.Tensor) -> None:
        """Apply parameters to the robots `which`, as of `Randomizer.apply`, and recompute the derived constants."""
        for name, field in self._joints.items():
            assign(field, which, values[name])
        assign(self._gain[..., 0], which, values["kp"])
        assign(self._bias[..., 1], which, -values["kp"])
        assign(self._bias[..., 2], which, -values["kd"])
        assign(self._delay, which, values["delay"])
        for foot in self._foot_friction:
            assign(foot, which, values["ground_friction"][:, 0])
        for foot in self._contact_time if "contact_time" in values else ():
            assign(foot, which, values["contact_time"][:, 0])
        assign(self._base_mass, which, values["base_mass"])
        assign(self._base_com, which, values["base_com"])
        self._choose(which)
        self._run("constants", self._derive)

    def reset(
        self,
        which: torch.Tensor,
        offset: torch.Tensor | None = None,
        heading: torch.Tensor | None = None,
        velocity: torch.Tensor | None = None,
    ) -> None:
        """Stand the robots `which` at the origin, `offset` [rad] from the standing pose, delay lines filled.

        `heading` [rad], (len(which),); `velocity`: of the base, linear in the world and angular in the base frame.
        """
        mask = self._choose(which)
        self._run("reset", self._stand)
        for name, view in self._results.items():
            assign(view, mask, self._start[name])
        assign(self._targets, mask, self._rest)
        assign(self._delayed_targets, mask, self._rest[:, None])
        if offset is not None:
            assign(self._qpos[:, 7:], which, self._rest + offset.double())
        if heading is not None:
            half, zero = heading.double() / 2, torch.zeros_like(heading, dtype=torch.float64)
            assign(self._qpos[:, 3:7], which, torch.stack((half.cos(), zero, zero, half.sin()), -1))
        if velocity is not None:
            assign(self._qvel[:, :BASE_DOFS], which, velocity)

    def step(self) -> torch.Tensor:
        """Advance one control period; return the mask of robots that blew up, (N,) bool: counted, and reset to
        standing.

        Raises `StictionError` where a robot had more contacts than the room for them.
        """
        self._run(self.decimation, lambda: self._advance(self.decimation))
        self._lacking |= self._overflow
        self._steps += 1
        if self._steps % CHECK_INTERVAL == 0:
            self.check()
        sizes = [view.abs().sum(-1) for view in (self._qpos, self._qvel, self._results["qacc"])]
        # Not `>=`: with NaN every comparison is false.
        blown_up = ~(torch.stack(sizes) < mujoco.mjMAXVAL).all(0)
        self.blown_up += blown_up
        # On a GPU nobody waits to learn whether there are any.
        if blown_up.is_cuda or blown_up.any():
            self.reset(blown_up)
        return blown_up

    def check(self) -> None:
        """Wait for the device; raise `StictionError` where a robot had more contacts than the room for them."""
        self._check_room(self._lacking.cpu().numpy())

    def state(self) -> dict[str, torch.Tensor]:
        """Return a copy of the complete state of the next step, for a checkpoint."""
        self.check()
        return {name: value.clone() for name, value in self._state.items()}

    def load_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Restore a `state`."""
        for name, value in self._state.items():
            value.copy_(state[name].view(value.shape))
