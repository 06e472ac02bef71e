"""MuJoCo: `frictionloss`, `damping` and `armature`, with solver settings under which the friction really holds.

`frictionloss` is a soft constraint: its limit is exact, but below it the joint creeps at
v = (τ/J) (1 - d0)/d0 · timeconst/2. With MuJoCo's defaults that is a visible drift, so the settings are always written.
"""

from __future__ import annotations

from stiction.core.errors import ConfigurationError, FileError
from stiction.exchange.physics import Conversion, JointPhysics, check_axis, known, notes_of, number, one_line
from stiction.exchange.urdf import Edit, Markup, Tag, set_attributes, xml_comment
from stiction.robots.physics import FRICTION_D0

SOLIMP = (FRICTION_D0, FRICTION_D0, 0.001, 0.5, 2)
"""Impedance of the dry-friction constraint, as `solimpfriction` has it."""

TIMESTEP = 0.002
"""MuJoCo's own default [s], where a model has none."""

LARGE_DAMPING = 3.0
"""A model's damping this many times the identified one probably stands for more than friction."""

NOT_KINEMATIC = frozenset({"default", "equality", "tendon", "actuator", "sensor"})
"""Sections whose `joint` elements are no joints of the tree."""

Defaults = dict[str, tuple[dict[str, str], str | None]]
"""Default class -> attributes of its `joint`, and the class around it."""


def joint_attributes(joint: JointPhysics, timestep: float) -> dict[str, str]:
    """Return the MJCF attributes of one joint; `timestep` [s] sets how stiff dry friction may be."""
    values = known(damping=joint.damping, frictionloss=joint.friction, armature=joint.armature)
    if joint.friction is not None:
        # The stiffest that there is: MuJoCo raises a time constant below two timesteps to that (refsafe).
        values["solreffriction"] = f"{number(2 * timestep)} 1"
        values["solimpfriction"] = " ".join(map(str, SOLIMP))
    return values


def mujoco_snippet(joints: list[JointPhysics], timestep: float | None) -> Conversion:
    """Return default classes, one a joint, to paste into a model's `<default>`."""
    step = timestep or TIMESTEP
    notes = _notes(joints, step)
    lines = []
    for joint in joints:
        tag = set_attributes(b"<joint/>", joint_attributes(joint, step)).decode()
        lines.append(f'  <default class="{_class_name(joint.name)}">\n    {tag}\n  </default>')
    text = xml_comment(notes) + "<default>\n" + "\n".join(lines) + "\n</default>\n"
    return Conversion.of(text, joints, notes)


def model_joints(markup: Markup) -> dict[str, Tag]:
    """Return the named joints of the kinematic tree; raise `StictionError` for what is no MJCF."""
    if markup.tags[0].name not in ("mujoco", "mujocoinclude"):
        raise FileError(f"the model's root is <{markup.tags[0].name}>; expected <mujoco>")
    found: dict[str, Tag] = {}
    for tag in markup.tags:
        name = tag.attributes.get("name")
        if tag.name == "joint" and name and not tag.inside & NOT_KINEMATIC:
            found[name] = tag
    return found


def patch_mujoco(markup: Markup, joints: list[JointPhysics], timestep: float | None) -> Conversion:
    """Return the model with the attributes of `joints` set, and a comment after the root tag; the rest as it was.

    timestep [s]: of the simulation, where it is not the model's. Raises `StictionError` for a joint that is not a hinge
    (or, for a linear axis, not a slide).
    """
    tree, defaults = model_joints(markup), _defaults(markup)
    step = timestep or _timestep(markup)
    notes = _notes(joints, step)
    edits: list[Edit] = []
    for joint in joints:
        tag = tree[joint.name]
        kind = _inherited(markup, tag, "type", defaults) or "hinge"
        check_axis(joint, kind, ("slide",) if joint.record.axis == "linear" else ("hinge",))
        before = _inherited(markup, tag, "damping", defaults)
        if joint.damping is not None and before is not None and _float(before) > LARGE_DAMPING * joint.damping:
            notes.append(
                f"{joint.name}: the model's damping was {before}, now {number(joint.damping)}: if it stood for the "
                "controller's kd, give that to the actuator (kv)"
            )
        # On the joint itself, over whatever its classes say.
        edits.append(markup.set_attributes(tag, joint_attributes(joint, step)))
    notes = [one_line(note) for note in notes]
    return Conversion.of(markup.edited(edits, notes), joints, notes)


def _notes(joints: list[JointPhysics], timestep: float) -> list[str]:
    """Say what holds for all joints, then what was left out of each."""
    return notes_of(
        joints,
        f"solreffriction is twice a timestep of {number(timestep)} s: change both together",
        'integrate with <option integrator="implicitfast"/>; for no creep at all, noslip_iterations="3"',
        "damping here is the joint's own; the controller's kd belongs to the actuator",
    )


def _class_name(name: str) -> str:
    """Return the name of a default class; names that XML would have to escape are refused."""
    if set(name) & set("<>&\"'"):
        raise ConfigurationError(
            f"joint name {name!r} does not fit an XML attribute; map it, --joint-map RECORDED=MODEL"
        )
    return f"{one_line(name)}_identified"


def _timestep(markup: Markup) -> float:
    """Return the model's timestep [s], MuJoCo's default where it has none."""
    steps = [tag.attributes["timestep"] for tag in markup.tags if tag.name == "option" and "timestep" in tag.attributes]
    step = _float(steps[-1]) if steps else TIMESTEP
    if not 0 < step < 1:
        raise FileError(f"the model's timestep is {steps[-1]!r}; expected seconds below 1, or give --timestep")
    return step


def _defaults(markup: Markup) -> Defaults:
    """Return the joint attributes of every default class."""
    found: Defaults = {}
    for tag in markup.tags:
        inside = next((up for up in markup.ancestors(tag) if up.name == "default"), None)
        if tag.name == "default":
            around = None if inside is None else inside.attributes.get("class", "main")
            found.setdefault(tag.attributes.get("class", "main"), ({}, around))
        elif tag.name == "joint" and inside is not None:
            found[inside.attributes.get("class", "main")][0].update(tag.attributes)
    return found


def _inherited(markup: Markup, tag: Tag, attribute: str, defaults: Defaults) -> str | None:
    """Return an attribute of a joint: its own, else that of its default class, else that of the class around it."""
    if attribute in tag.attributes:
        return tag.attributes[attribute]
    # A joint's own class, else the nearest `childclass` around it, as MuJoCo looks them up.
    child = (up.attributes["childclass"] for up in markup.ancestors(tag) if "childclass" in up.attributes)
    name: str | None = tag.attributes.get("class") or next(child, "main")
    while name is not None:
        own, around = defaults.get(name, ({}, None if name == "main" else "main"))
        if attribute in own:
            return own[attribute]
        name = around
    return None


def _float(text: str) -> float:
    """Return the first number of an attribute; nan where there is none."""
    try:
        return float(text.split()[0])
    except (ValueError, IndexError):
        return float("nan")
