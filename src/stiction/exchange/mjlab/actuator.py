"""An actuator of mjlab with the friction law that was identified: its bound is written before every physics step.

    f = b_c + (b_s - b_c) exp(-|θ'/v_s|^α) + c_τ |τ| + c_l |τ_e|

with the motor's torque τ and the torque τ_e that reaches the joint from outside in the step before: contacts, weight.
MuJoCo's solver holds the joint up to that bound, and brakes by it in motion; viscous friction is the joint's damping.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
from mjlab.actuator.pd_actuator import IdealPdActuator, IdealPdActuatorCfg
from mjlab.managers.event_manager import EventTermCfg, requires_model_fields

from stiction.core.errors import ConfigurationError
from stiction.exchange.mjlab.friction import stiffen_rows
from stiction.exchange.physics import joint_physics
from stiction.files.bam import load_joints


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
        """Return the actuator, as mjlab asks for it."""
        return IdentifiedActuator(self, entity, target_ids, target_names)


class IdentifiedActuator(IdealPdActuator[IdentifiedActuatorCfg]):
    """The actuator of `IdentifiedActuatorCfg`; all tensors are of shape (num_envs, joints)."""

    def edit_spec(self, spec: Any, target_names: list[str]) -> None:
        """Add motors, and a row of friction to each joint: its number is that of each step."""
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
        """Return the most that friction brakes or holds by [N m]; velocity [rad/s], torque of the motor [N m]."""
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


def identified_actuator(joints: str | Path, record: str, **fields: Any) -> IdentifiedActuatorCfg:
    """Return the actuator of a record of `joints.json`: friction law, viscous friction and armature.

    Args:
        joints: the `joints.json` of `stiction identify`, or a parameter file of BAM.
        record: name of the record.
        fields: the others of `IdentifiedActuatorCfg`: target_names_expr, stiffness, damping, effort_limit.

    Raises `StictionError` for a fit that is not valid or has no dry friction.

    """
    found = load_joints(Path(joints)).record(record)
    physics, law = joint_physics(record, found), found.friction_law or {}
    unloaded = found.unloaded_friction
    coulomb = physics.friction if unloaded is None else max(0.0, unloaded.value)
    if coulomb is None:
        raise ConfigurationError(f"record {record!r}: got no dry friction, expected one; {'; '.join(physics.notes)}")
    numbers: dict[str, Any] = {
        "coulomb_friction": coulomb,
        "viscous_damping": physics.damping,
        "armature": physics.armature,
    }
    if found.static_friction is not None:
        numbers["static_friction"] = max(coulomb, found.static_friction.value)
        # Friction that gives way all at once has no such speed.
        numbers["stribeck_velocity"] = 1e-2 if found.stribeck_velocity is None else found.stribeck_velocity.value
        numbers["exponent"] = law.get("bam", {}).get("alpha", 2.0)
    if found.load_coefficient is not None:
        kind = "torque_coefficient" if found.load_regressor == "motor_torque" else "load_coefficient"
        numbers[kind] = max(0.0, found.load_coefficient.value)
    return IdentifiedActuatorCfg(**numbers | fields)


def friction_law_event() -> dict[str, Any]:
    """Return the event that gives each robot friction of its own, for `cfg.events`."""
    return {"friction_law": EventTermCfg(func=prepare_friction_law, mode="startup")}


@requires_model_fields("dof_frictionloss", "dof_solref", "dof_solimp")
def prepare_friction_law(env: Any, env_ids: Any) -> None:
    """Make the rows of friction of every `IdentifiedActuator` as stiff as the timestep allows."""
    for asset in env.scene.entities.values():
        for actuator in asset.actuators:
            if isinstance(actuator, IdentifiedActuator):
                stiffen_rows(env.sim.model, slice(None), actuator.dofs, env.physics_dt)
