"""Domain randomisation: every row of the paper's Table II, drawn anew for a robot at each of its resets.

Each draw is relative to the *nominal* value, never to the last one, so nothing drifts. What is drawn is kept in
`Draws`: the privileged observation is read from it, and the audit compares it with how the robot then moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from stiction.formats.friction import has_coefficient
from stiction.locomotion.config import RandomizationCfg
from stiction.locomotion.friction import FrictionCfg, Mixture, friction_share
from stiction.locomotion.privileged import privileged_observation
from stiction.robots.spec import RobotSpec
from stiction.sim.actuator import NetMotors
from stiction.sim.fleet import Fleet
from stiction.sim.friction import joint_friction


@dataclass(frozen=True)
class NominalJoints:
    """Joint physics that multipliers refer to, each of shape (joints,)."""

    armature: np.ndarray
    """Rotor inertia [kg m²]."""
    damping: np.ndarray
    """Viscous friction [N m s/rad]."""
    frictionloss: np.ndarray
    """Dry friction [N m]; of the laws `load` and `effort`, the coefficient [-]."""


def nominal_joints(
    fleet: Fleet, friction: FrictionCfg, identified: dict[str, np.ndarray] | None = None
) -> NominalJoints:
    """Return the robot's own joints, overridden by an identification, its friction overridden by the level.

    Of the laws with a coefficient, every joint has the same one, and none where no level is named.

    `identified`: `armature`, `damping`, `frictionloss`, each (joints,), NaN where not identified.
    """
    values = {name: fleet.spec.joint_values(name) for name in ("armature", "damping", "frictionloss")}
    for name, value in (identified or {}).items():
        values[name] = np.where(np.isnan(value), values[name], value)
    if has_coefficient(friction.law):
        values["frictionloss"] = np.full(fleet.spec.num_joints, friction.level or 0.0)
    elif friction.level is not None:
        values["frictionloss"] = friction.level * fleet.torque_limit
    return NominalJoints(**values)


def friction_angle(cfg: FrictionCfg, nominal: NominalJoints, robot: RobotSpec) -> tuple[float, ...] | None:
    """Return f/kp [rad] of each joint's nominal friction, which `compensation` adds to the command; None otherwise."""
    if cfg.method != "compensation":
        return None
    return tuple((nominal.frictionloss / robot.joint_values("stiffness")).tolist())


@dataclass
class Draws:
    """What each robot has now, float32; multipliers unless a unit is given."""

    armature: torch.Tensor
    damping: torch.Tensor
    friction: torch.Tensor
    stiffness: torch.Tensor
    motor_strength: torch.Tensor
    """The five above: (N, joints)."""
    ground_friction: torch.Tensor
    payload: torch.Tensor
    """[kg]; both (N, 1)."""
    center_of_mass: torch.Tensor
    """Shift in the base frame [m], (N, 3)."""
    action_delay: torch.Tensor
    """[s], (N, 1)."""
    encoder_offset: torch.Tensor
    """[rad], (N, joints)."""


class Randomizer:
    """Draws parameters and writes them into a fleet."""

    def __init__(
        self,
        fleet: Fleet,
        cfg: RandomizationCfg,
        friction: FrictionCfg,
        nominal: NominalJoints,
        motors: NetMotors | None = None,
    ) -> None:
        """Remember the nominal robot. Nothing is drawn before the first `draw`. `motors`: those of an Actuator Net."""
        self.motors = motors
        if motors is not None:
            cfg = cfg.with_net(motors.holds_friction)
        if motors is not None and motors.holds_friction:
            zero = np.zeros_like(nominal.damping)
            nominal = NominalJoints(nominal.armature, damping=zero, frictionloss=zero)
        self.fleet, self.cfg, self.friction, self.nominal = fleet, cfg, friction, nominal
        self.mixture = friction.schedule[0].mixture
        self.law = joint_friction(fleet, friction.joint_law)
        share = friction_share(friction.law, nominal.frictionloss, fleet.spec)
        self.nominal_share = torch.from_numpy(share).float()
        self.base_mass = fleet.spec.base.mass
        cfg.check_robot(fleet.spec)
        size = np.array(fleet.spec.base.size)
        self.com_axes = torch.from_numpy(size / size[0]).float()
        num, joints = fleet.num_envs, fleet.spec.num_joints
        widths = {"ground_friction": 1, "payload": 1, "center_of_mass": 3, "action_delay": 1}
        names = Draws.__dataclass_fields__
        self.draws = Draws(**{name: torch.zeros(num, widths.get(name, joints)) for name in names})

    def draw(self, ids: torch.Tensor, generator: torch.Generator) -> None:
        """Draw every parameter of the robots `ids` and write it into the fleet."""
        cfg, num = self.cfg, len(ids)

        def uniform(span: tuple[float, float], like: torch.Tensor) -> torch.Tensor:
            return span[0] + (span[1] - span[0]) * torch.rand(num, like.shape[1], generator=generator)

        new = {
            name: uniform(getattr(cfg, name), value) for name, value in vars(self.draws).items() if name != "friction"
        }
        new["friction"] = self._draw_friction(num, generator)
        new["center_of_mass"] = new["center_of_mass"] * self.com_axes
        step = self.fleet.timestep
        new["action_delay"] = (new["action_delay"] / step).round() * step
        for name, value in new.items():
            getattr(self.draws, name)[ids] = value
        self.apply(ids)

    def _draw_friction(self, num: int, generator: torch.Generator) -> torch.Tensor:
        """Return multipliers of the nominal friction from the stage's mixture, (num, joints)."""
        size = (num, self.draws.friction.shape[1])
        weight, low, high = torch.tensor(self.mixture).unbind(-1)
        share = torch.rand(size, generator=generator)
        part = torch.zeros(size, dtype=torch.long)
        if len(weight) > 1:
            part = torch.multinomial(weight, size[0] * size[1], True, generator=generator).view(size)
        multiplier = low[part] + (high - low)[part] * share
        return multiplier if self.friction.per == "joint" else multiplier[:, :1].expand(size)

    def enter(self, mixture: Mixture, generator: torch.Generator) -> None:
        """Begin a stage of the schedule: every robot's friction is drawn anew, and nothing else."""
        self.mixture = mixture
        self.draws.friction = self._draw_friction(self.fleet.num_envs, generator).clone()
        self.apply(torch.arange(self.fleet.num_envs))

    def apply(self, ids: torch.Tensor) -> None:
        """Write the draws of the robots `ids` into the fleet and recompute what derives from them."""
        fleet, nominal, rows = self.fleet, self.nominal, ids.numpy()
        values = {name: tensor[ids].double().numpy() for name, tensor in vars(self.draws).items()}
        fleet.armature[rows] = values["armature"] * nominal.armature
        fleet.damping[rows] = values["damping"] * nominal.damping
        self.law.set_level(values["friction"] * nominal.frictionloss, rows)
        strength = values["motor_strength"]
        if self.motors is None:
            fleet.set_gains(strength * values["stiffness"] * fleet.nominal_kp, strength * fleet.nominal_kd, rows)
            fleet.delay[rows] = values["action_delay"]
        else:
            self.motors.strength[rows] = strength
        fleet.set_ground_friction(values["ground_friction"][:, 0], rows)
        fleet.base_mass[rows] = self.base_mass + values["payload"][:, 0]
        fleet.base_com[rows] = values["center_of_mass"]
        fleet.set_const(rows)

    def friction_share(self) -> torch.Tensor:
        """Return the dry friction of every joint as a fraction of its torque limit, shape (N, joints)."""
        return self.draws.friction * self.nominal_share

    def privileged(self) -> torch.Tensor:
        """Return o_priv of every robot, shape (N, 2 + 3 joints); see `privileged_observation`."""
        d = self.draws
        return privileged_observation(d.payload, d.ground_friction, d.armature, d.damping, self.friction_share())
