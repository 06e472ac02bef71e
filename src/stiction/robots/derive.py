"""Derivation of a `Robot` from its file and its `robot.yaml`, with the origin of every value.

Unstated values follow rules of the field:

* kp = armature (2π · 10 Hz)² and kd = 2 · 2 · armature · 2π · 10 Hz: the motor alone would swing at 10 Hz, damped twice
  critically; the armature is the median of its kind of joint, so that left and right get the same gains;
* action scale = 0.25 torque limit / kp: an action of one requests a quarter of the motor's torque;
* feet are the outermost links that touch the ground in the pose; two by two from front to rear they make the tripod or
  the trot, for four or six feet;
* contacts with the ground are those of the feet, and of a box for the trunk.

Friction in a file is of unknown origin, mostly a number that stabilises a simulation: it is reported and not taken.
Measured friction is stated in `robot.yaml`, or estimated by `stiction identify`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace

import mujoco
import numpy as np

from stiction.core.errors import RobotError, unknown_name
from stiction.core.names import kind_of
from stiction.robots.anatomy import Anatomy, Part, dissect, hinges
from stiction.robots.description import Description
from stiction.robots.hold import hold
from stiction.robots.model import Base, Foot, Joint, Link, Robot, tree_poses
from stiction.robots.motors import armature, damping, gains, torque_limit
from stiction.robots.record import Derived, Origin
from stiction.robots.shapes import Contact, Shape, bounds, reach, vector
from stiction.robots.source import Source

FREQUENCY, DAMPING_RATIO = 10.0, 2.0
"""Natural frequency [Hz] and damping ratio of the motor under its gains. mjlab's rule."""

TORQUE_SHARE = 0.25
"""Share of the torque limit that an action of one requests. mjlab's rule."""

FREE_RANGE = 2 * math.pi
"""Limits of a joint without limits in its file [rad], either way."""

TOUCHING = 0.03
"""Tolerance of contact: a link touches the ground if its lowest point is this near to the robot's [m]."""

SOLE = 0.01
"""Tolerance of a foot: shapes this near to the lowest point of their link belong to its foot [m]."""

STANDING_KEYS = ("home", "standing", "stand")
"""Keyframes used as the standing pose by default."""


def derive(source: Source, description: Description) -> Derived:
    """Return the robot of a file and its description.

    Raises `RobotError` naming a missing or contradictory value, and the line for `robot.yaml`.
    """
    model, origin = source.model, source.origin
    names = [model.joint(joint).name for joint in hinges(model)]
    _check_patterns(model, description, names)
    origins: list[Origin] = []
    angles = {joint: _angle(model, joint, description, origins) for joint in hinges(model)}
    held = {
        model.joint(joint).name: angle
        for joint, angle in angles.items()
        if description.of_joint(model.joint(joint).name, "action") is False
    }
    if len(held) == len(names):
        raise RobotError(f"{description.source}: action is false for every joint; expected one that the policy moves")
    anatomy = dissect(model, description.base, origin)
    for part in (anatomy.base, *anatomy.links):
        if part.mass <= 0:
            raise RobotError(f"{origin}: the link {part.name!r} has no mass; give its body an inertia")
    typical = _typical_armatures(model, anatomy, description)
    joints = tuple(_joint(model, number, angles[number], typical, description, origins) for number in anatomy.joints)
    base = _base(anatomy.base, description, origins)
    poses = tree_poses(anatomy.links, np.array([joint.default_position for joint in joints]))
    feet, lowest = _feet(model, anatomy, description, poses, origins)
    links = tuple(_link(part, feet, number, description) for number, part in enumerate(anatomy.links))
    feet = _grouped(feet, description, poses, origins)
    _check_names(links, joints, feet, origin)
    mirror_names = None
    if description.mirror is not None:
        mirror_names = (
            tuple(description.mirror.get(joint.name, joint.name) for joint in joints) if description.mirror else ()
        )
    robot = Robot(
        name=description.name or _name(source.name),
        base=base,
        links=links,
        joints=joints,
        feet=feet,
        standing_height=-lowest,
        vendor=description.vendor_of(tuple(names)),
        mirror_names=mirror_names,
        gait_period=description.gait_period,
    )
    origins.append(Origin("robot", "standing height", f"{-lowest:.4g} m", "feet on the ground in the pose"))
    notes = source.notes + _frictions(model, anatomy, description) + _note_limitless(model, anatomy, description)
    return Derived(hold(robot, held), tuple(origins), notes)


RESERVED = {"link": ("world", "base"), "joint": ("root",), "foot": ("base", "floor")}
"""Names that every simulated robot uses for its body, joint and shapes."""


def _check_names(links: Sequence[Link], joints: Sequence[Joint], feet: Sequence[Foot], origin: str) -> None:
    """Reject names that are not unique in the simulated model."""
    named: tuple[tuple[str, list[str]], ...] = (
        ("link", [link.name for link in links]),
        ("joint", [joint.name for joint in joints]),
        ("foot", [name for foot in feet for name in foot.geometry_names]),
        ("foot", [foot.name.removesuffix("_foot") for foot in feet]),
    )
    for kind, names in named:
        for name in names:
            if name in RESERVED[kind] or names.count(name) > 1:
                raise RobotError(
                    f"{origin}: the {kind} {name!r} has a name that something else has in the simulated model; give it "
                    f"another one in the file (taken: {', '.join(RESERVED[kind])})"
                )


def _name(name: str) -> str:
    """Return a name that is valid for a file."""
    return re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_").lower() or "robot"


def _check_patterns(model: mujoco.MjModel, description: Description, names: Sequence[str]) -> None:
    """Reject expressions that match no joint: the value of a misspelt name would be ignored."""
    for where, patterns in (
        ("joints", description.joints),
        ("pose", description.pose),
        ("vendor.sign", description.vendor.get("sign", {})),
        ("vendor.offset", description.vendor.get("offset", {})),
    ):
        for pattern in patterns:
            if not any(re.fullmatch(pattern, name) for name in names):
                raise RobotError(f"{description.source}: {where}: {unknown_name('joint', pattern, names)}")
    for name in description.mirror or {}:
        if name not in names:
            raise RobotError(f"{description.source}: mirror: {unknown_name('joint', name, names)}")


def _angle(model: mujoco.MjModel, joint: int, description: Description, origins: list[Origin]) -> float:
    """Return a joint's angle in the standing pose [rad]."""
    name, address = model.joint(joint).name, int(model.jnt_qposadr[joint])
    keys = [model.key(number).name for number in range(model.nkey)]
    if description.keyframe is not None and description.keyframe not in keys:
        raise RobotError(f"{description.source}: {unknown_name('keyframe', description.keyframe, keys)}")
    key = description.keyframe or next((key for key in STANDING_KEYS if key in keys and not description.pose), None)
    if (angle := description.angle(name)) is not None:
        where = description.source
    elif key is not None:
        angle, where = float(model.key(key).qpos[address]), f"file: keyframe {key!r}"
    else:
        low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-FREE_RANGE, FREE_RANGE)
        angle, where = 0.0, "rule: zero"
        if not low < angle < high:
            angle, where = float(low + high) / 2, "rule: middle of the limits, which leave zero out"
    if abs(angle) > 2 * math.pi:
        raise RobotError(f"{description.source}: joint {name!r} stands at {angle:g} rad; is that in degrees?")
    origins.append(Origin(name, "default_position", f"{angle:.4g} rad", where))
    return angle


def _kind(name: str, description: Description) -> str:
    """Return the kind of a joint."""
    return str(description.of_joint(name, "kind") or kind_of(name))


def _armature(model: mujoco.MjModel, number: int, description: Description) -> float:
    """Return the armature of a joint [kg m²], 0 where neither description nor model has one."""
    value = description.of_joint(model.joint(number).name, "armature")
    return armature(model, number) if value is None else float(value)


def _place(model: mujoco.MjModel, number: int) -> str:
    """Return the source of a joint's armature."""
    inertia = float(model.dof_armature[model.jnt_dofadr[number]])
    if armature(model, number) == inertia:
        return "file"
    return "file: joint, and actuator times gear²" if inertia else "file: actuator times gear²"


def _typical_armatures(model: mujoco.MjModel, anatomy: Anatomy, description: Description) -> dict[str, float]:
    """Return the median armature of each kind of joint [kg m²]."""
    by_kind: dict[str, list[float]] = {}
    for number in anatomy.joints:
        by_kind.setdefault(_kind(model.joint(number).name, description), []).append(
            _armature(model, number, description)
        )
    return {kind: float(np.median(values)) for kind, values in by_kind.items()}


Take = Callable[[str, str, float, str], float]
"""Function of field, unit, default value and its rule -> the stated value, or the default; its origin is recorded."""


def _joint(
    model: mujoco.MjModel,
    number: int,
    angle: float,
    typical: Mapping[str, float],
    description: Description,
    origins: list[Origin],
) -> Joint:
    """Return one driven joint with all its values; `typical`: armature of each kind of joint."""
    name = model.joint(number).name
    kind = _kind(name, description)

    def take(field: str, unit: str, rule: float, why: str) -> float:
        stated = description.of_joint(name, field)
        value, where = (float(stated), description.source) if stated is not None else (rule, why)
        origins.append(Origin(name, field, f"{value:.4g} {unit}".strip(), where))
        return value

    limited = bool(model.jnt_limited[number])
    low, high = (float(value) for value in model.jnt_range[number]) if limited else (-FREE_RANGE, FREE_RANGE)
    if description.of_joint(name, "action") is False:
        # Nothing drives it, and it is gone when the robot is complete: its motor need not be known.
        return Joint(name, kind, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0, min(low, angle - 1), max(high, angle + 1), angle, 1.0)
    torque, rotor = _motor(model, number, take, description)
    kp_file, kd_file = gains(model, number)
    omega = 2 * math.pi * FREQUENCY
    kp = take(
        "kp",
        "N m/rad",
        kp_file or typical[kind] * omega**2,
        "file: position actuator" if kp_file else f"rule: armature (2π {FREQUENCY:g} Hz)²",
    )
    rule = 2 * DAMPING_RATIO * typical[kind] * omega
    kd = take(
        "kd",
        "N m s/rad",
        kd_file or rule,
        "file: position actuator" if kd_file else f"rule: damping ratio {DAMPING_RATIO:g}",
    )
    if not kp > 0:
        raise RobotError(f"{description.source}: kp of joint {name!r} is {kp:g}; expected a positive number")
    why = "file" if limited else "rule: a turn, as the file has no limits"
    origins.append(
        Origin(name, "kind", kind, description.source if description.of_joint(name, "kind") else "rule: the name")
    )
    return Joint(
        name=name,
        kind=kind,
        torque_limit=torque,
        armature=rotor,
        damping=take("damping", "N m s/rad", 0.0, "rule: none until it is measured"),
        frictionloss=take("frictionloss", "N m", 0.0, "rule: none until it is measured"),
        kp=kp,
        kd=kd,
        lower=take("lower", "rad", low, why),
        upper=take("upper", "rad", high, why),
        default_position=angle,
        action_scale=take(
            "action_scale", "rad", TORQUE_SHARE * torque / kp, f"rule: {TORQUE_SHARE:g} torque_limit / kp"
        ),
    )


def _motor(model: mujoco.MjModel, number: int, take: Take, description: Description) -> tuple[float, float]:
    """Return torque limit [N m] and armature [kg m²] of a joint, without which it cannot be simulated."""
    name = model.joint(number).name
    limit, where = torque_limit(model, number)
    torque = take("torque_limit", "N m", limit, where)
    if not torque > 0:
        raise RobotError(
            f"joint {name!r} has no torque limit in the file (neither forcerange, nor a motor's ctrlrange, nor "
            f"actuatorfrcrange or effort); say in {description.source}: joints: {{{name}: {{torque_limit: ...}}}} [N m]"
        )
    rotor = take("armature", "kg m²", _armature(model, number, description), _place(model, number))
    if not rotor > 0:
        raise RobotError(
            f"joint {name!r} has no armature in the file, its own or its actuator's, and without the rotor's inertia "
            f"neither friction nor gains mean anything; add to {description.source}: joints: {{{name}: {{armature: "
            "...}}} (the rotor's inertia times the gear ratio squared [kg m²], from the motor's data sheet or from "
            "stiction identify)"
        )
    return torque, rotor


def _base(part: Part, description: Description, origins: list[Origin]) -> Base:
    """Return the trunk, with its box."""
    shapes = part.touched or part.shapes
    if shapes:
        low, high = bounds(shapes)
        where = "file: what it touches with" if part.touched else "file: what is seen of it"
    else:
        x, y, z = part.inertia[:3]
        half = np.sqrt(np.maximum(6.0 / part.mass * np.array([y + z - x, x + z - y, x + y - z]), 1e-4)) / 2
        low, high, where = np.array(part.com) - half, np.array(part.com) + half, "rule: the box of equal inertia"
    size, middle = vector(high - low), vector((high + low) / 2)
    box = Shape("box", vector((high - low) / 2), middle, contact="ground")
    seen = (
        tuple(replace(shape, contact="ground") for shape in part.touched) if description.collision == "file" else (box,)
    )
    origins.append(Origin("base", "box", " x ".join(f"{extent:.3g}" for extent in size) + " m", where))
    return Base(part.mass, part.com, part.inertia, seen or (box,), size, middle)


Poses = tuple[np.ndarray, np.ndarray]
"""Frames of all links on the base in the standing pose: positions, rotations."""


def _lowest(shapes: Sequence[Shape], poses: Poses, link: int) -> float:
    """Return the height of the lowest point of shapes of one link, above the base's frame [m]."""
    down = poses[1][link].T @ np.array([0.0, 0.0, -1.0])
    return float(poses[0][link][2] - max(reach(shape, down) for shape in shapes))


def _feet(
    model: mujoco.MjModel, anatomy: Anatomy, description: Description, poses: Poses, origins: list[Origin]
) -> tuple[tuple[Foot, ...], float]:
    """Return the feet, and the height of their lowest point above the base's frame [m]."""
    chosen = _named_feet(model, anatomy, description) if description.feet else _leaves(anatomy, poses)
    if not chosen:
        raise RobotError(
            f"{description.source}: no outermost link has a contact shape; name the feet (feet: [...]), bodies or "
            "geometries with a shape"
        )
    feet: list[Foot] = []
    for name, link, shapes in chosen:
        height = _lowest(shapes, poses, link)
        sole = [shape for shape in shapes if _lowest([shape], poses, link) < height + SOLE]
        low, high = bounds(sole, poses[1][link])
        middle = poses[1][link].T @ ((low + high) / 2)
        down = tuple(replace(shape, contact="ground") for shape in sole)
        if any(other.link == link and other.shapes == down for other in feet):
            raise RobotError(f"{description.source}: feet: {name!r} is the same as another foot; expected each once")
        feet.append(Foot(name, link, vector(middle), float(high[2] - low[2]) / 2, down))
    lowest = min(_lowest(foot.shapes, poses, foot.link) for foot in feet)
    where = description.source if description.feet else "rule: outermost links that touch the ground in the pose"
    origins.extend(Origin(foot.name, "foot", f"{len(foot.shapes)} shapes", where) for foot in feet)
    return tuple(feet), lowest


def _leaves(anatomy: Anatomy, poses: Poses) -> list[tuple[str, int, tuple[Shape, ...]]]:
    """Return name, link and shapes of the outermost links that touch the ground in the pose."""
    carriers = {part.parent for part in anatomy.links}
    shaped = [
        (part.tip or part.name, number, part.touched or part.shapes)
        for number, part in enumerate(anatomy.links)
        if number not in carriers and part.shapes
    ]
    if not shaped:
        return []
    heights = [_lowest(shapes, poses, link) for _, link, shapes in shaped]
    for number, part in enumerate(anatomy.links):
        if number not in carriers and not part.shapes and poses[0][number][2] < min(heights):
            raise RobotError(
                f"the outermost link {part.name!r} has no shape, or its mesh was left out, and reaches below "
                f"{', '.join(repr(name) for name, _, _ in shaped)}: it may be the foot; supply its shape, or name the "
                "feet (feet: [...])"
            )
    return [leaf for leaf, height in zip(shaped, heights, strict=True) if height < min(heights) + TOUCHING]


def _named_feet(
    model: mujoco.MjModel, anatomy: Anatomy, description: Description
) -> list[tuple[str, int, tuple[Shape, ...]]]:
    """Return name, link and shapes of the feet in the description: bodies or geometries."""
    feet: list[tuple[str, int, tuple[Shape, ...]]] = []
    bodies = {model.body(body).name: number for number, part in enumerate(anatomy.links) for body in part.bodies}
    geoms = {
        model.geom(geom).name: (number, shape)
        for number, part in enumerate(anatomy.links)
        for geom, shape in zip(part.geoms, part.touched, strict=True)
    }
    for name in description.feet:
        if name in geoms:
            number, shape = geoms[name]
            feet.append((name, number, (shape,)))
        elif name in bodies:
            part = anatomy.links[bodies[name]]
            body = model.body(name).id
            foot_shapes = tuple(
                shape for geom, shape in zip(part.geoms, part.touched, strict=True) if model.geom_bodyid[geom] == body
            )
            if not (shapes := foot_shapes or part.touched or part.shapes):
                raise RobotError(f"{description.source}: feet: the body {name!r} has no shape to touch the ground with")
            feet.append((name, bodies[name], shapes))
        else:
            raise RobotError(
                f"{description.source}: feet: {unknown_name('body or geometry', name, [*bodies, *filter(None, geoms)])}"
            )
    return feet


def _link(part: Part, feet: Sequence[Foot], number: int, description: Description) -> Link:
    """Return a link with its shapes: those of a foot's link catch on obstacles, others are visible only or as in the
    file.
    """
    # By what they are: shapes of feet were copied with another contact, and are not the same objects.
    foot = {(shape.kind, shape.position, shape.size) for item in feet if item.link == number for shape in item.shapes}
    rest = [shape for shape in part.touched or part.shapes if (shape.kind, shape.position, shape.size) not in foot]
    contact: Contact = "ground" if description.collision == "file" else "obstacles" if foot else "nothing"
    shapes = tuple(replace(shape, contact=contact if part.touched else "nothing") for shape in rest)
    return Link(**{item.name: getattr(part, item.name) for item in fields(Link)} | {"shapes": shapes})


def _grouped(feet: tuple[Foot, ...], description: Description, poses: Poses, origins: list[Origin]) -> tuple[Foot, ...]:
    """Return the feet with their contact groups, if any."""
    names = [foot.name for foot in feet]
    if description.groups:
        if len(description.groups) != 2 or sorted(name for group in description.groups for name in group) != sorted(
            names
        ):
            raise RobotError(
                f"{description.source}: groups are {[list(group) for group in description.groups]}; expected two lists "
                f"that name each foot once: {', '.join(names)}"
            )
        origins.append(Origin("feet", "groups", str([list(group) for group in description.groups]), description.source))
        return tuple(replace(foot, group=0 if foot.name in description.groups[0] else 1) for foot in feet)
    places = np.array([poses[0][foot.link] + poses[1][foot.link] @ np.array(foot.position) for foot in feet])
    left, right = (
        sorted(np.flatnonzero(side * places[:, 1] > 0).tolist(), key=lambda foot: -places[foot, 0]) for side in (1, -1)
    )
    if len(feet) not in (4, 6) or len(left) != len(right):
        origins.append(Origin("feet", "groups", "none", f"rule: none for {len(feet)} feet"))
        return feet
    group = {foot: row % 2 for row, foot in enumerate(left)} | {foot: 1 - row % 2 for row, foot in enumerate(right)}
    groups = [[names[foot] for foot in sorted(group) if group[foot] == value] for value in (0, 1)]
    origins.append(Origin("feet", "groups", str(groups), "rule: tripod or trot, from front to rear"))
    return tuple(replace(foot, group=group[number]) for number, foot in enumerate(feet))


def _note_limitless(model: mujoco.MjModel, anatomy: Anatomy, description: Description) -> tuple[str, ...]:
    """Return a note on joints without limits, or with limits that MuJoCo ignores: a range of zero, or from high to
    low.
    """
    names = [model.joint(joint).name for joint in anatomy.joints if not model.jnt_limited[joint]]
    free = [
        name
        for name in names
        if description.of_joint(name, "lower") is None or description.of_joint(name, "upper") is None
    ]
    free = [name for name in free if description.of_joint(name, "action") is not False]
    if not free:
        return ()
    listed = ", ".join(free[:6]) + (f" and {len(free) - 6} more" if len(free) > 6 else "")
    return (f"the file has no limits that hold for {listed}; a turn either way is taken: say lower and upper",)


def _frictions(model: mujoco.MjModel, anatomy: Anatomy, description: Description) -> tuple[str, ...]:
    """Return notes on friction in the file, which is not taken."""
    notes = []
    for field, unit in (("frictionloss", "N m"), ("damping", "N m s/rad")):
        claims: dict[str, str] = {}
        for joint in anatomy.joints:
            name = model.joint(joint).name
            value, grows = float(model.dof_frictionloss[model.jnt_dofadr[joint]]), False
            if field == "damping":
                value, grows = damping(model, joint)
            if (value > 0 or grows) and description.of_joint(name, field) is None:
                claims.setdefault(kind_of(name), f"{value:.4g}" + (" and powers of the speed" if grows else ""))
        if claims:
            listed = ", ".join(f"{kind} {value}" for kind, value in claims.items())
            notes.append(
                f"the file claims {field} ({listed} {unit}) and does not say who measured it; it is not taken: "
                f"identify it, or say {field} in robot.yaml"
            )
    return tuple(notes)
