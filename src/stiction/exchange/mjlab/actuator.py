"""Actuator of mjlab with the identified friction law: its bound is written before every physics step.

    f = b_c + (b_s - b_c) exp(-|θ'/v_s|^α) + c_τ |τ| + c_l |τ_e|

with the motor's torque τ and the torque τ_e that reaches the joint from outside in the step before: contacts, weight.
MuJoCo's solver holds the joint up to that bound, and brakes by it in motion; viscous friction is the joint's damping.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
from mjlab.actuator import BuiltinPdActuatorCfg, BuiltinPositionActuatorCfg
from mjlab.actuator.pd_actuator import IdealPdActuator, IdealPdActuatorCfg
from mjlab.managers.event_manager import EventTermCfg, requires_model_fields

from stiction.core.errors import ConfigurationError
from stiction.exchange.mjlab.rows import stiffen_rows, warn_of_budget
from stiction.exchange.physics import JointPhysics


@dataclass(kw_only=True)
class IdentifiedActuatorCfg(IdealPdActuatorCfg):
    """PD control, and dry friction that depends on speed, motor torque and load; `friction_law_event` goes with it."""

    coulomb_friction: float
    """Dry friction in motion, b_c [N m]."""
    static_friction: float | None = None
    """Dry friction at rest, b_s [N m]; None where it is that in motion."""
    stribeck_velocity: float = 0.1
    """Speed at which 63 % of the excess at rest is gone, v_s [rad/s]."""
    exponent: float = 2.0
    """Exponent of the fall, α [1]."""
    torque_coefficient: float = 0.0
    """Friction per torque of the motor, c_τ [1]."""
    load_coefficient: float = 0.0
    """Friction per torque from outside, c_l [1]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("coulomb_friction", "torque_coefficient", "load_coefficient"):
            if getattr(self, name) < 0.0:
                raise ConfigurationError(f"IdentifiedActuatorCfg: got {name} {getattr(self, name)}, expected 0 or more")
        if self.at_rest < self.coulomb_friction or not (self.stribeck_velocity > 0 and self.exponent > 0):
            raise ConfigurationError(
                f"IdentifiedActuatorCfg: got static friction {self.at_rest}, Stribeck velocity "
                f"{self.stribeck_velocity}, exponent {self.exponent}, expected at least coulomb_friction, "
                "and positive numbers"
            )
        if self.frictionloss is not None:
            raise ConfigurationError("IdentifiedActuatorCfg: got frictionloss, expected coulomb_friction in its place")

    @property
    def at_rest(self) -> float:
        """Dry friction at rest [N m]."""
        return self.coulomb_friction if self.static_friction is None else self.static_friction

    def build(self, entity: Any, target_ids: list[int], target_names: list[str]) -> IdentifiedActuator:
        """Return the actuator; mjlab calls this."""
        return IdentifiedActuator(self, entity, target_ids, target_names)


class IdentifiedActuator(IdealPdActuator[IdentifiedActuatorCfg]):
    """Actuator of `IdentifiedActuatorCfg`; all tensors are of shape (num_envs, joints)."""

    def edit_spec(self, spec: Any, target_names: list[str]) -> None:
        """Add motors, and a row of friction to each joint, whose bound is set at each step."""
        super().edit_spec(spec, target_names)
        for joint in spec.joints:
            if joint.name in target_names:
                joint.frictionloss = max(self.cfg.at_rest, 1e-6)

    def initialize(self, mj_model: Any, model: Any, data: Any, device: str) -> None:
        """Find the joints among the model's degrees of freedom."""
        super().initialize(mj_model, model, data, device)
        joints = self.entity.indexing.joint_ids[self.target_ids].tolist()
        self.dofs = self.target_ids.new_tensor([int(mj_model.jnt_dofadr[joint]) for joint in joints])
        self.model, self.data = model, data

    def compute(self, cmd: Any) -> Any:
        """Return the torque of the PD law, clipped [N m], and write the bound of friction of this physics step."""
        torque = super().compute(cmd)
        friction = self.model.dof_frictionloss
        if friction.shape[0] > 1 and friction.stride(0) == 0:
            raise ConfigurationError(
                "IdentifiedActuator: got one friction for all robots; add cfg.events |= friction_law_event()"
            )
        friction[:, self.dofs] = self.bound(cmd.vel, torque)
        return torque

    def bound(self, velocity: Any, torque: Any) -> Any:
        """Return the largest torque of friction [N m]; velocity [rad/s], torque of the motor [N m]."""
        cfg = self.cfg
        excess = cfg.at_rest - cfg.coulomb_friction
        bound = cfg.coulomb_friction + excess * (-((velocity / cfg.stribeck_velocity).abs() ** cfg.exponent)).exp()
        if cfg.torque_coefficient:
            bound = bound + cfg.torque_coefficient * torque.abs()
        if cfg.load_coefficient:
            bound = bound + cfg.load_coefficient * self.load().abs()
        return bound

    def load(self) -> Any:
        """Return the torque from outside in the last physics step [N m]: weight and contacts."""
        data = self.data
        rows = data.efc.type[...]
        ours = rows == int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
        # Rows behind the last one of a world are of earlier steps.
        ours &= rows.new_tensor(range(rows.shape[1])) < data.nefc[...].unsqueeze(-1)
        force = data.efc.force[...] * ours
        friction = data.qfrc_constraint[...].new_zeros(data.qfrc_constraint.shape)
        friction.scatter_add_(1, (data.efc.id[...] * ours).long(), force)
        outside = data.qfrc_constraint[...] - friction - data.qfrc_bias[...]
        return outside[:, self.dofs]


def with_law(actuator: Any, names: Sequence[str], physics: dict[str, JointPhysics]) -> list[Any]:
    """Return an actuator configuration as one with the friction law for each record of its joints, and the rest.

    names: joints of the actuator; physics: identified values by joint. Gains, limit and delay stay.

    Raises `ConfigurationError` for an actuator without gains, and a record without dry friction.
    """
    groups: dict[str | None, list[str]] = {}
    for name in names:
        groups.setdefault(physics[name].recorded if name in physics else None, []).append(name)
    if not groups.keys() - {None}:
        return [actuator]
    if type(actuator) not in WITH_GAINS:
        raise ConfigurationError(
            f"the friction law of joint {names[0]!r}: got {type(actuator).__name__}, expected "
            f"{', '.join(kind.__name__ for kind in WITH_GAINS)}, whose gains it takes"
        )
    fields = {name: getattr(actuator, name) for name in ("stiffness", "damping", "armature", "viscous_damping")}
    fields |= {name: value for name, value in vars(actuator).items() if name.startswith("delay_")}
    if actuator.effort_limit is not None:
        fields["effort_limit"] = actuator.effort_limit
    parts = []
    for record, joints in groups.items():
        # Alone, it keeps its own patterns.
        exact = tuple(map(re.escape, joints)) if len(groups) > 1 else actuator.target_names_expr
        if record is None:
            parts.append(replace(actuator, target_names_expr=exact))
        else:
            law = fields | law_of(physics[joints[0]]) | {"target_names_expr": exact}
            parts.append(IdentifiedActuatorCfg(**law))
    return parts


WITH_GAINS = (BuiltinPositionActuatorCfg, BuiltinPdActuatorCfg, IdealPdActuatorCfg)
"""Kinds of mjlab's actuators that the one with the friction law can replace."""


def law_of(joint: JointPhysics) -> dict[str, float]:
    """Return the identified values of a joint, by the field of `IdentifiedActuatorCfg`.

    Raises `ConfigurationError` for a record without dry friction.
    """
    record, law = joint.record, joint.record.friction_law or {}
    unloaded = record.unloaded_friction
    coulomb = joint.friction if unloaded is None else max(0.0, unloaded.value)
    if coulomb is None:
        told = "; ".join(joint.notes)
        raise ConfigurationError(f"record {joint.recorded!r}: got no dry friction, expected one; {told}")
    numbers = {"coulomb_friction": coulomb}
    numbers |= {} if joint.damping is None else {"viscous_damping": joint.damping}
    numbers |= {} if joint.armature is None else {"armature": joint.armature}
    if record.static_friction is not None:
        numbers["static_friction"] = max(coulomb, record.static_friction.value)
        # Friction that gives way all at once has no such speed.
        numbers["stribeck_velocity"] = 1e-2 if record.stribeck_velocity is None else record.stribeck_velocity.value
        numbers["exponent"] = law.get("bam", {}).get("alpha", 2.0)
    if record.load_coefficient is not None:
        kind = "torque_coefficient" if record.load_regressor == "motor_torque" else "load_coefficient"
        numbers[kind] = max(0.0, record.load_coefficient.value)
    return numbers


def driven_by_law(asset: Any) -> list[str]:
    """Return the joints of an mjlab entity whose friction follows a law."""
    return [
        name
        for actuator in asset.actuators
        if isinstance(actuator, IdentifiedActuator)
        for name in actuator.target_names
    ]


def friction_law_event() -> dict[str, Any]:
    """Return the event that gives each robot a friction of its own, for `cfg.events`."""
    return {"friction_law": EventTermCfg(func=prepare_friction_law, mode="startup")}


@requires_model_fields("dof_frictionloss", "dof_solref", "dof_solimp")
def prepare_friction_law(env: Any, env_ids: Any) -> None:
    """Make the rows of friction of every `IdentifiedActuator` as stiff as the timestep allows."""
    warn_of_budget(env)
    for asset in env.scene.entities.values():
        for actuator in asset.actuators:
            if isinstance(actuator, IdentifiedActuator):
                stiffen_rows(env, slice(None), actuator.dofs)
