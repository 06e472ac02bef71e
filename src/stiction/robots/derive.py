"""From a robot's file and the lines of its `robot.yaml` to a `Robot`; every value says where it came from.

What nobody said follows rules of the field:

* kp = armature (2π · 10 Hz)² and kd = 2 · 2 · armature · 2π · 10 Hz: the motor alone would swing at 10 Hz, damped twice
  critically; the armature is the median of its kind of joint, so that left and right get the same gains;
* action scale = 0.25 torque limit / kp: an action of one asks for a quarter of the motor's torque;
* feet are the outermost links that touch the ground in the pose; two by two from front to rear they make the tripod or
  the trot, where there are four or six;
* what touches the ground are feet, and a box for the trunk.

A friction that stands in a file is a claim of unknown origin, mostly a number that calms a simulation: it is reported
and not taken. What was measured is said in `robot.yaml`, or found by `stiction identify`.
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
"""Of the motor under its gains: natural frequency [Hz], damping ratio. mjlab's rule."""

TORQUE_SHARE = 0.25
"""Share of the torque limit that an action of one asks for. mjlab's rule."""

FREE_RANGE = 2 * math.pi
"""Limits of a joint that has none [rad], either way."""

TOUCHING = 0.03
"""A link touches the ground where its lowest point is within this of the robot's [m]."""

SOLE = 0.01
"""Shapes that reach within this of the lowest point of their link are its foot [m]."""

STANDING_KEYS = ("home", "standing", "stand")
"""Keyframes that are taken for the standing pose where nothing is said."""


def derive(source: Source, said: Description) -> Derived:
    """Return the robot of a file, with what its description says.

    Raises `RobotError` naming what is missing or contradicts itself, and what to say in `robot.yaml`.
    """
    model, origin = source.model, source.origin
    names = [model.joint(joint).name for joint in hinges(model)]
    _check_said(model, said, names)
    origins: list[Origin] = []
    angles = {joint: _angle(model, joint, said, origins) for joint in hinges(model)}
    held = {
        model.joint(joint).name: angle
        for joint, angle in angles.items()
        if said.of_joint(model.joint(joint).name, "action") is False
    }
    if len(held) == len(names):
        raise RobotError(f"{said.source}: action is false for every joint; expected one that the policy moves")
    anatomy = dissect(model, said.base, origin)
    for part in (anatomy.base, *anatomy.links):
        if part.mass <= 0:
            raise RobotError(f"{origin}: the link {part.name!r} has no mass; give its body an inertia")
    typical = _typical_armatures(model, anatomy, said)
    joints = tuple(_joint(model, number, angles[number], typical, said, origins) for number in anatomy.joints)
    base = _base(anatomy.base, said, origins)
    poses = tree_poses(anatomy.links, np.array([joint.default_position for joint in joints]))
    feet, lowest = _feet(model, anatomy, said, poses, origins)
    links = tuple(_link(part, feet, number, said) for number, part in enumerate(anatomy.links))
    feet = _grouped(feet, said, poses, origins)
    _check_names(links, joints, feet, origin)
    mirror_names = None
    if said.mirror is not None:
        mirror_names = tuple(said.mirror.get(joint.name, joint.name) for joint in joints) if said.mirror else ()
    robot = Robot(
        name=said.name or _name(source.name),
        base=base,
        links=links,
        joints=joints,
        feet=feet,
        standing_height=-lowest,
        vendor=said.vendor_of(tuple(names)),
        mirror_names=mirror_names,
        gait_period=said.gait_period,
    )
    origins.append(Origin("robot", "standing height", f"{-lowest:.4g} m", "feet on the ground in the pose"))
    notes = source.notes + _frictions(model, anatomy, said) + _limitless(model, anatomy, said)
    return Derived(hold(robot, held), tuple(origins), notes)


RESERVED = {"link": ("world", "base"), "joint": ("root",), "foot": ("base", "floor")}
"""Names that every simulated robot has, of its own body, joint and shapes."""


def _check_names(links: Sequence[Link], joints: Sequence[Joint], feet: Sequence[Foot], origin: str) -> None:
    """Refuse names that two things would have in the model that is simulated."""
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
    """Return a name that a file can have."""
    return re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_").lower() or "robot"


def _check_said(model: mujoco.MjModel, said: Description, names: Sequence[str]) -> None:
    """Refuse expressions that match no joint: a name that is misspelt would be a value that is not taken."""
    for where, patterns in (
        ("joints", said.joints),
        ("pose", said.pose),
        ("vendor.sign", said.vendor.get("sign", {})),
        ("vendor.offset", said.vendor.get("offset", {})),
    ):
        for pattern in patterns:
            if not any(re.fullmatch(pattern, name) for name in names):
                raise RobotError(f"{said.source}: {where}: {unknown_name('joint', pattern, names)}")
    for name in said.mirror or {}:
        if name not in names:
            raise RobotError(f"{said.source}: mirror: {unknown_name('joint', name, names)}")


def _angle(model: mujoco.MjModel, joint: int, said: Description, origins: list[Origin]) -> float:
    """Return a joint's angle in the standing pose [rad]."""
    name, address = model.joint(joint).name, int(model.jnt_qposadr[joint])
    keys = [model.key(number).name for number in range(model.nkey)]
    if said.keyframe is not None and said.keyframe not in keys:
        raise RobotError(f"{said.source}: {unknown_name('keyframe', said.keyframe, keys)}")
    key = said.keyframe or next((key for key in STANDING_KEYS if key in keys and not said.pose), None)
    if (angle := said.angle(name)) is not None:
        where = said.source
    elif key is not None:
        angle, where = float(model.key(key).qpos[address]), f"file: keyframe {key!r}"
    else:
        low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-FREE_RANGE, FREE_RANGE)
        angle, where = 0.0, "rule: zero"
        if not low < angle < high:
            angle, where = float(low + high) / 2, "rule: middle of the limits, which leave zero out"
    if abs(angle) > 2 * math.pi:
        raise RobotError(f"{said.source}: joint {name!r} stands at {angle:g} rad; is that in degrees?")
    origins.append(Origin(name, "default_position", f"{angle:.4g} rad", where))
    return angle


def _kind(name: str, said: Description) -> str:
    """Return the kind of a joint."""
    return str(said.of_joint(name, "kind") or kind_of(name))


def _armature(model: mujoco.MjModel, number: int, said: Description) -> float:
    """Return the armature of a joint [kg m²], 0 where neither description nor model states one."""
    given = said.of_joint(model.joint(number).name, "armature")
    return armature(model, number) if given is None else float(given)


def _place(model: mujoco.MjModel, number: int) -> str:
    """Return where the armature of a joint stands."""
    own = float(model.dof_armature[model.jnt_dofadr[number]])
    if armature(model, number) == own:
        return "file"
    return "file: joint, and actuator times gear²" if own else "file: actuator times gear²"


def _typical_armatures(model: mujoco.MjModel, anatomy: Anatomy, said: Description) -> dict[str, float]:
    """Return the median armature of each kind of joint [kg m²]."""
    found: dict[str, list[float]] = {}
    for number in anatomy.joints:
        found.setdefault(_kind(model.joint(number).name, said), []).append(_armature(model, number, said))
    return {kind: float(np.median(values)) for kind, values in found.items()}


Take = Callable[[str, str, float, str], float]
"""Field, unit, value by rule and why -> the value that was said, or that; its origin is written down."""


def _joint(
    model: mujoco.MjModel,
    number: int,
    angle: float,
    typical: Mapping[str, float],
    said: Description,
    origins: list[Origin],
) -> Joint:
    """Return one driven joint with everything that is known of it; `typical`: armature of each kind of joint."""
    name = model.joint(number).name
    kind = _kind(name, said)

    def take(field: str, unit: str, rule: float, why: str) -> float:
        given = said.of_joint(name, field)
        value, where = (float(given), said.source) if given is not None else (rule, why)
        origins.append(Origin(name, field, f"{value:.4g} {unit}".strip(), where))
        return value

    limited = bool(model.jnt_limited[number])
    low, high = (float(value) for value in model.jnt_range[number]) if limited else (-FREE_RANGE, FREE_RANGE)
    if said.of_joint(name, "action") is False:
        # Nothing drives it, and it is gone when the robot is complete: its motor need not be known.
        return Joint(name, kind, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0, min(low, angle - 1), max(high, angle + 1), angle, 1.0)
    torque, rotor = _motor(model, number, take, said)
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
        raise RobotError(f"{said.source}: kp of joint {name!r} is {kp:g}; expected a positive number")
    why = "file" if limited else "rule: a turn, as the file has no limits"
    origins.append(Origin(name, "kind", kind, said.source if said.of_joint(name, "kind") else "rule: the name"))
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


def _motor(model: mujoco.MjModel, number: int, take: Take, said: Description) -> tuple[float, float]:
    """Return torque limit [N m] and armature [kg m²] of a joint, without which nothing can be simulated."""
    name = model.joint(number).name
    limit, where = torque_limit(model, number)
    torque = take("torque_limit", "N m", limit, where)
    if not torque > 0:
        raise RobotError(
            f"joint {name!r} has no torque limit in the file (neither forcerange, nor a motor's ctrlrange, nor "
            f"actuatorfrcrange or effort); say in {said.source}: joints: {{{name}: {{torque_limit: ...}}}} [N m]"
        )
    rotor = take("armature", "kg m²", _armature(model, number, said), _place(model, number))
    if not rotor > 0:
        raise RobotError(
            f"joint {name!r} has no armature in the file, its own or its actuator's, and without the rotor's inertia "
            f"neither friction nor gains mean anything; say in {said.source}: joints: {{{name}: {{armature: ...}}}} "
            "(the rotor's inertia times the gear ratio squared [kg m²], from the motor's data sheet or from stiction "
            "identify)"
        )
    return torque, rotor


def _base(part: Part, said: Description, origins: list[Origin]) -> Base:
    """Return the trunk, with the box that stands for it."""
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
    seen = tuple(replace(shape, contact="ground") for shape in part.touched) if said.collision == "file" else (box,)
    origins.append(Origin("base", "box", " x ".join(f"{extent:.3g}" for extent in size) + " m", where))
    return Base(part.mass, part.com, part.inertia, seen or (box,), size, middle)


Poses = tuple[np.ndarray, np.ndarray]
"""Where the frames of all links are on the base in the standing pose: positions, rotations."""


def _lowest(shapes: Sequence[Shape], poses: Poses, link: int) -> float:
    """Return the height of the lowest point of shapes of one link, over the base's frame [m]."""
    down = poses[1][link].T @ np.array([0.0, 0.0, -1.0])
    return float(poses[0][link][2] - max(reach(shape, down) for shape in shapes))


def _feet(
    model: mujoco.MjModel, anatomy: Anatomy, said: Description, poses: Poses, origins: list[Origin]
) -> tuple[tuple[Foot, ...], float]:
    """Return the feet, and the height of the lowest point of them over the base's frame [m]."""
    chosen = _said_feet(model, anatomy, said) if said.feet else _leaves(anatomy, poses)
    if not chosen:
        raise RobotError(
            f"{said.source}: no outermost link has a shape to touch the ground with; name the feet (feet: [...]), "
            "bodies or geometries with a shape"
        )
    feet: list[Foot] = []
    for name, link, shapes in chosen:
        height = _lowest(shapes, poses, link)
        sole = [shape for shape in shapes if _lowest([shape], poses, link) < height + SOLE]
        low, high = bounds(sole, poses[1][link])
        middle = poses[1][link].T @ ((low + high) / 2)
        down = tuple(replace(shape, contact="ground") for shape in sole)
        if any(other.link == link and other.shapes == down for other in feet):
            raise RobotError(f"{said.source}: feet: {name!r} is the same as another foot; expected each once")
        feet.append(Foot(name, link, vector(middle), float(high[2] - low[2]) / 2, down))
    lowest = min(_lowest(foot.shapes, poses, foot.link) for foot in feet)
    where = said.source if said.feet else "rule: outermost links that touch the ground in the pose"
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


def _said_feet(model: mujoco.MjModel, anatomy: Anatomy, said: Description) -> list[tuple[str, int, tuple[Shape, ...]]]:
    """Return name, link and shapes of the feet that were named: bodies or geometries."""
    found: list[tuple[str, int, tuple[Shape, ...]]] = []
    bodies = {model.body(body).name: number for number, part in enumerate(anatomy.links) for body in part.bodies}
    geoms = {
        model.geom(geom).name: (number, shape)
        for number, part in enumerate(anatomy.links)
        for geom, shape in zip(part.geoms, part.touched, strict=True)
    }
    for name in said.feet:
        if name in geoms:
            number, shape = geoms[name]
            found.append((name, number, (shape,)))
        elif name in bodies:
            part = anatomy.links[bodies[name]]
            body = model.body(name).id
            own = tuple(
                shape for geom, shape in zip(part.geoms, part.touched, strict=True) if model.geom_bodyid[geom] == body
            )
            if not (shapes := own or part.touched or part.shapes):
                raise RobotError(f"{said.source}: feet: the body {name!r} has no shape to touch the ground with")
            found.append((name, bodies[name], shapes))
        else:
            raise RobotError(
                f"{said.source}: feet: {unknown_name('body or geometry', name, [*bodies, *filter(None, geoms)])}"
            )
    return found


def _link(part: Part, feet: Sequence[Foot], number: int, said: Description) -> Link:
    """Return a link with its shapes: those of a foot's link catch on obstacles, others are seen or as the file says."""
    # By what they are: shapes of feet were copied with another contact, and are not the same objects.
    foot = {(shape.kind, shape.position, shape.size) for item in feet if item.link == number for shape in item.shapes}
    rest = [shape for shape in part.touched or part.shapes if (shape.kind, shape.position, shape.size) not in foot]
    contact: Contact = "ground" if said.collision == "file" else "obstacles" if foot else "nothing"
    shapes = tuple(replace(shape, contact=contact if part.touched else "nothing") for shape in rest)
    return Link(**{item.name: getattr(part, item.name) for item in fields(Link)} | {"shapes": shapes})


def _grouped(feet: tuple[Foot, ...], said: Description, poses: Poses, origins: list[Origin]) -> tuple[Foot, ...]:
    """Return the feet with their contact groups, where they have any."""
    names = [foot.name for foot in feet]
    if said.groups:
        if len(said.groups) != 2 or sorted(name for group in said.groups for name in group) != sorted(names):
            raise RobotError(
                f"{said.source}: groups are {[list(group) for group in said.groups]}; expected two lists that name "
                f"each foot once: {', '.join(names)}"
            )
        origins.append(Origin("feet", "groups", str([list(group) for group in said.groups]), said.source))
        return tuple(replace(foot, group=0 if foot.name in said.groups[0] else 1) for foot in feet)
    places = np.array([poses[0][foot.link] + poses[1][foot.link] @ np.array(foot.position) for foot in feet])
    left, right = (
        sorted(np.flatnonzero(side * places[:, 1] > 0).tolist(), key=lambda foot: -places[foot, 0]) for side in (1, -1)
    )
    if len(feet) not in (4, 6) or len(left) != len(right):
        origins.append(Origin("feet", "groups", "none", f"rule: none for {len(feet)} feet"))
        return feet
    group = {foot: row % 2 for row, foot in enumerate(left)} | {foot: 1 - row % 2 for row, foot in enumerate(right)}
    found = [[names[foot] for foot in sorted(group) if group[foot] == value] for value in (0, 1)]
    origins.append(Origin("feet", "groups", str(found), "rule: tripod or trot, from front to rear"))
    return tuple(replace(foot, group=group[number]) for number, foot in enumerate(feet))


def _limitless(model: mujoco.MjModel, anatomy: Anatomy, said: Description) -> tuple[str, ...]:
    """Return which joints have no limits, or such as MuJoCo takes for none: a range of zero, or from high to low."""
    names = [model.joint(joint).name for joint in anatomy.joints if not model.jnt_limited[joint]]
    free = [name for name in names if said.of_joint(name, "lower") is None or said.of_joint(name, "upper") is None]
    free = [name for name in free if said.of_joint(name, "action") is not False]
    if not free:
        return ()
    found = ", ".join(free[:6]) + (f" and {len(free) - 6} more" if len(free) > 6 else "")
    return (f"the file has no limits that hold for {found}; a turn either way is taken: say lower and upper",)


def _frictions(model: mujoco.MjModel, anatomy: Anatomy, said: Description) -> tuple[str, ...]:
    """Return what the file claims of friction and was not taken."""
    notes = []
    for field, unit in (("frictionloss", "N m"), ("damping", "N m s/rad")):
        claims: dict[str, str] = {}
        for joint in anatomy.joints:
            name = model.joint(joint).name
            value, grows = float(model.dof_frictionloss[model.jnt_dofadr[joint]]), False
            if field == "damping":
                value, grows = damping(model, joint)
            if (value > 0 or grows) and said.of_joint(name, field) is None:
                claims.setdefault(kind_of(name), f"{value:.4g}" + (" and powers of the speed" if grows else ""))
        if claims:
            listed = ", ".join(f"{kind} {value}" for kind, value in claims.items())
            notes.append(
                f"the file claims {field} ({listed} {unit}) and does not say who measured it; it is not taken: "
                f"identify it, or say {field} in robot.yaml"
            )
    return tuple(notes)
