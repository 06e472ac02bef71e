"""Identified armature, dry and viscous friction in the actuators and the model of an mjlab robot.

mjlab's actuator configurations hold one value for all their joints, None keeps the model's, and those of XML actuators
are ignored without a word. So values go into the model, which every kind of actuator respects, and into a configuration
where its joints agree. Actuators are not split, and their order stays, but for those that get a friction law.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from mjlab.actuator.actuator import TransmissionType

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.exchange.mjlab.actuator import friction_law_event, with_law
from stiction.exchange.mjlab.motors import KINDS
from stiction.exchange.mjlab.rows import with_budget
from stiction.exchange.physics import RICHER, JointPhysics, Which, check_axis, joint_physics, notes_of
from stiction.files.bam import load_joints
from stiction.files.joint_map import map_joints, parse_joint_map
from stiction.robots.physics import friction_row


def with_joints(
    cfg: Any,
    joints: str | Path,
    *,
    joint_map: str | Sequence[str] = (),
    entity: str = "robot",
    friction: Which | Literal["law"] = "moving",
) -> Any:
    """Put identified joints into an environment's robot, and the solver budget under which their friction holds.

    Args:
        cfg: mjlab's `ManagerBasedRlEnvCfg`; it is changed, and returned. Its robot's own configuration, which others
            may share, is copied.
        joints: the `joints.json` of `stiction identify`.
        joint_map: RECORDED=MODEL pairs where names differ; MODEL may have wildcards, `shank=*_calf_joint`.
        entity: name of the robot among the scene's entities.
        friction: dry friction in motion (`moving`), or at rest where that is more (`static`): MuJoCo has one number.
            `law` writes that number at each physics step, by speed, motor torque and load as identified: an
            `IdentifiedActuatorCfg` takes the place of the actuators of these joints.

    Quantities that were not identified keep their value; each is named in a `UserWarning`. Gains stay as they are.

    Raises `StictionError` for a fit that is not valid, a record without a joint, and a configuration of another kind.

    """
    robot = robot_of(cfg, entity)
    spec = robot.spec_fn()
    kinds = {_short(joint.name): joint.type.name for joint in spec.joints if joint.type.name in KINDS}
    driven = {name for actuator in robot.articulation.actuators for name in targets(actuator, kinds)}
    file = load_joints(Path(joints))

    def takes(record: str, joint: str) -> bool:
        return joint in driven and KINDS[kinds[joint]] == file.joints[record].axis

    pairs = parse_joint_map((joint_map,) if isinstance(joint_map, str) else joint_map)
    names = map_joints(file, pairs, list(kinds), takes)
    by_law = friction == "law"
    which = "moving" if friction == "law" else friction
    physics = {name: joint_physics(record, file.joints[record], name, which) for name, record in names.items()}
    for joint in physics.values():
        check_axis(joint, KINDS[kinds[joint.name]], (joint.record.axis,))
    for note in _notes(physics.values(), by_law):
        warnings.warn(f"{Path(joints).name}: {note}", stacklevel=2)

    values = {name: _values(joint) for name, joint in physics.items()}
    actuators = tuple(
        part
        for actuator in robot.articulation.actuators
        for part in (
            with_law(actuator, targets(actuator, kinds), physics)
            if by_law
            else [_identified(actuator, targets(actuator, kinds), values)]
        )
    )
    edited = partial(_edited_spec, robot.spec_fn, values, cfg.sim.mujoco.timestep)
    robot = replace(robot, spec_fn=edited, articulation=replace(robot.articulation, actuators=actuators))
    cfg.scene = replace(cfg.scene, entities={**cfg.scene.entities, entity: robot})
    # `friction_events` may give all of them friction.
    cfg.sim = with_budget(cfg.sim, len(driven))
    if by_law:
        cfg.events |= friction_law_event()
    return cfg


LAWS_OF_ACTUATOR = (None, "coulomb", "stribeck", "breakaway", "load", "effort")
"""Friction laws of records that `IdentifiedActuatorCfg` has."""


def _notes(joints: Iterable[JointPhysics], by_law: bool) -> list[str]:
    """Return notes on the values left out of each record; by_law: True for the actuator with the friction law."""
    told = []
    for joint in joints:
        if by_law and (joint.record.friction_law or {}).get("law") in LAWS_OF_ACTUATOR:
            joint = replace(joint, record=replace(joint.record, friction_law=None))
        told.append(joint)
    return notes_of(told, represented=frozenset(RICHER if by_law else ()))[1:]


def robot_of(cfg: Any, entity: str) -> Any:
    """Return the configuration of an environment's robot; raise `ConfigurationError` where there is none."""
    if not (hasattr(cfg, "scene") and hasattr(cfg, "sim")):
        raise ConfigurationError(
            f"with_joints: got {type(cfg).__name__}, expected the environment's ManagerBasedRlEnvCfg, whose solver "
            "budget is raised with the robot's friction; call it where that is made"
        )
    if entity not in cfg.scene.entities:
        raise ConfigurationError(f"with_joints: {unknown_name('entity', entity, cfg.scene.entities)}")
    robot = cfg.scene.entities[entity]
    if robot.articulation is None or getattr(robot, "variants", None):
        raise ConfigurationError(
            f"entity {entity!r}: got {'mesh variants' if robot.articulation else 'no actuators'}, expected a robot "
            "with one spec_fn and an articulation; name another one with entity="
        )
    return robot


def targets(actuator: Any, names: Sequence[str] | dict[str, Any]) -> list[str]:
    """Return the joints that an actuator configuration is for, matched as mjlab does."""
    if actuator.transmission_type != TransmissionType.JOINT:
        return []
    return [name for name in names if any(re.fullmatch(pattern, name) for pattern in actuator.target_names_expr)]


def _values(joint: JointPhysics) -> dict[str, float]:
    """Return the identified values of a joint, by the field of mjlab's `ActuatorCfg`."""
    values = {"armature": joint.armature, "frictionloss": joint.friction, "viscous_damping": joint.damping}
    return {name: value for name, value in values.items() if value is not None}


def _identified(actuator: Any, names: Sequence[str], values: dict[str, dict[str, float]]) -> Any:
    """Return an actuator configuration with the values that all its joints share, and None where they differ.

    values: of each joint; the configuration's values for joints that were not identified are added to them, where they
    can stay in the configuration no longer.
    """
    changed: dict[str, float | None] = {}
    for field in ("armature", "frictionloss", "viscous_damping"):
        if not any(field in values.get(name, ()) for name in names):
            continue
        configured = getattr(actuator, field)
        each = {name: values.get(name, {}).get(field, configured) for name in names}
        changed[field] = each[names[0]] if len({*each.values()}) == 1 else None
        if changed[field] is None:
            for name, value in each.items():
                if value is not None:
                    values.setdefault(name, {})[field] = value
    return replace(actuator, **changed)


def _edited_spec(spec_fn: Any, values: dict[str, dict[str, float]], timestep: float) -> Any:
    """Return a robot's model with values in its joints, and rows of dry friction as stiff as a timestep [s] allows."""
    spec = spec_fn()
    for joint in spec.joints:
        of_joint = values.get(_short(joint.name), {})
        if "armature" in of_joint:
            joint.armature = of_joint["armature"]
        if "viscous_damping" in of_joint:
            joint.damping[0] = of_joint["viscous_damping"]
        if "frictionloss" in of_joint:
            joint.frictionloss = of_joint["frictionloss"]
            joint.solref_friction, joint.solimp_friction = friction_row(timestep)
    for actuator in spec.actuators:
        # MuJoCo adds an actuator's own to what its joint has.
        of_joint = values.get(_short(actuator.target), {})
        if "armature" in of_joint:
            actuator.armature = 0.0
        if "viscous_damping" in of_joint:
            actuator.damping[:] = 0.0
    return spec


def _short(name: str) -> str:
    """Return a joint's name without the prefix of an attached model, as mjlab shows it."""
    return name.split("/")[-1]
