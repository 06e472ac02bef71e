"""MuJoCo: `frictionloss`, `damping` and `armature`, with solver settings under which the friction really holds.

`frictionloss` is a soft constraint: its limit is exact, but below it the joint creeps at
v = (τ/J) (1 - d0)/d0 · timeconst/2. With MuJoCo's defaults that is a visible drift, so the settings are always written.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stiction.core.errors import ConfigurationError, FileError
from stiction.exchange.physics import Conversion, JointPhysics, check_axis, headline, known, notes_of, number, one_line
from stiction.exchange.urdf import Edit, Markup, Tag, parse_markup, read_model, set_attributes, xml_comment
from stiction.robots.physics import LEAST_ITERATIONS, LEAST_LS_ITERATIONS, budget_objection, friction_row

SLIDE_NOTE = (
    "of a slide joint on a body of the world, the friction row counts the body's mass and leaves armature out: where "
    'that is the larger part, friction brakes with a small share of its value, unless <flag diagexact="enable"/> is set'
)
"""Measured: 0.5 of 10 N at 1 kg of armature and 1 mg of body; 10 N with the flag (MuJoCo 4.0.0)."""

ROTOR_NOTE = "if the actuators of these joints have armature or damping, set both to 0: MuJoCo adds them to the joint's"

TIMESTEP = 0.002
"""Default timestep of MuJoCo [s], where a model has none."""

LARGE_DAMPING = 3.0
"""Ratio of a model's damping to the identified one above which it probably stands for more than friction."""

NOT_KINEMATIC = frozenset({"default", "equality", "tendon", "actuator", "sensor"})
"""Sections whose `joint` elements are not joints of the tree."""

ACTUATORS = frozenset(
    [
        "general",
        "motor",
        "position",
        "velocity",
        "intvelocity",
        "pid",
        "dcmotor",
        "damper",
        "cylinder",
        "muscle",
        "orientation",
    ]
)
"""Elements of `<actuator>`; a default of any of them gives armature, damping and gear to all."""

MOST_FILES = 64
"""Most files that a model includes."""

BUDGET = {"iterations": (LEAST_ITERATIONS, 100), "ls_iterations": (LEAST_LS_ITERATIONS, 50)}
"""Attribute of `<option>` -> least value under which friction holds, and MuJoCo's default."""

Defaults = dict[str, tuple[dict[str, str], str | None]]
"""Default class -> attributes of one kind of element, and the class around it."""


def joint_attributes(joint: JointPhysics, timestep: float) -> dict[str, str]:
    """Return the MJCF attributes of one joint; `timestep` [s] sets how stiff dry friction may be."""
    values = known(damping=joint.damping, frictionloss=joint.friction, armature=joint.armature)
    if joint.friction is not None:
        for name, row in zip(("solreffriction", "solimpfriction"), friction_row(timestep), strict=True):
            values[name] = " ".join(map(number, row))
    return values


def mujoco_snippet(joints: list[JointPhysics], timestep: float | None) -> Conversion:
    """Return default classes, one a joint, to paste into a model's `<default>`."""
    step = timestep or TIMESTEP
    notes = _notes(joints, step)
    lines = []
    for joint in joints:
        tag = set_attributes(b"<joint/>", joint_attributes(joint, step)).decode()
        lines.append(f'  <default class="{_class_name(joint.name)}">\n    {tag}\n  </default>')
    notes.append(ROTOR_NOTE)
    told = [headline(joints)]
    text = xml_comment(told) + "<default>\n" + "\n".join(lines) + "\n</default>\n"
    return Conversion.of(text, joints, notes, told)


def model_joints(markup: Markup) -> dict[str, Tag]:
    """Return the named joints of the kinematic tree; raise `StictionError` for a file that is not MJCF."""
    if markup.tags[0].name not in ("mujoco", "mujocoinclude"):
        raise FileError(f"the model's root is <{markup.tags[0].name}>; expected <mujoco>")
    joints: dict[str, Tag] = {}
    for tag in markup.tags:
        name = tag.attributes.get("name")
        if tag.name == "joint" and name and not tag.inside & NOT_KINEMATIC:
            joints[name] = tag
    return joints


def joint_kinds(markup: Markup) -> dict[str, tuple[str, bool]]:
    """Return name -> type of a joint (`hinge`, `slide`, `ball`, `free`), and True if an actuator drives it.

    An actuator drives it itself, or by a fixed tendon; where the file has no actuators, all joints count as driven.
    """
    defaults, actuators = _defaults(markup, {"joint"}), _actuators(markup)
    driven = {tag.attributes.get(key) for tag in actuators for key in ("joint", "jointinparent")}
    pulled = {tag.attributes["tendon"] for tag in actuators if "tendon" in tag.attributes}
    for tag in markup.tags:
        if tag.name == "joint" and tag.parent is not None and markup.tags[tag.parent].attributes.get("name") in pulled:
            driven.add(tag.attributes.get("joint"))
    return {
        name: (_inherited(markup, tag, "type", defaults) or "hinge", not actuators or name in driven)
        for name, tag in model_joints(markup).items()
    }


def included_joints(markup: Markup, path: Path) -> dict[str, list[str]]:
    """Return name of a file that a model includes -> the joints in it; missing files are left out."""
    included: dict[str, list[str]] = {}
    left = [markup]
    while left:
        for tag in left.pop().tags:
            name = tag.attributes.get("file", "")
            # MuJoCo looks next to the first file.
            if tag.name == "include" and name not in included and (path.parent / name).is_file():
                if len(included) == MOST_FILES:
                    raise FileError(f"{path.name} includes more than {MOST_FILES} files; expected a robot")
                left.append(parse_markup(read_model(path.parent / name), name))
                included[name] = list(model_joints(left[-1]))
    return {name: joints for name, joints in included.items() if joints}


def patch_mujoco(
    markup: Markup, joints: list[JointPhysics], timestep: float | None, passive: Sequence[str] = ()
) -> Conversion:
    """Return the model with the attributes of `joints` set, and a comment after the root tag; the rest as it was.

    Armature and damping at the actuators of these joints become 0, since MuJoCo adds them up, and a solver's budget
    under which friction slips is raised. timestep [s]: of the simulation, where it is not the model's; passive: joints
    that a pattern passed over. Raises `StictionError` for a joint that is not a hinge (or, for a linear axis, not a
    slide).
    """
    tree, defaults = model_joints(markup), _defaults(markup, {"joint"})
    step = timestep or _timestep(markup)
    told = [headline(joints)]
    edits = _budget_edits(markup, told)
    rotors, zeroed = _Rotors.of(markup), dict[str, list[str]]()
    notes = _notes(joints, step) + ([] if rotors.actuators else [ROTOR_NOTE])
    if passive:
        told.append(f"left as they are, as no actuator drives them: {', '.join(passive)}; a pair may name one in full")
    # A single number would leave the powers of a default class as they are.
    powers = any(len(tag.attributes.get("damping", "").split()) > 1 for tag in markup.tags if tag.name == "joint")
    for joint in joints:
        tag = tree[joint.name]
        kind = _inherited(markup, tag, "type", defaults) or "hinge"
        check_axis(joint, kind, ("slide",) if joint.record.axis == "linear" else ("hinge",))
        values = joint_attributes(joint, step)
        if "damping" in values and powers:
            values["damping"] += " 0 0"
        # On the joint itself, over the values of its classes.
        edits.append(markup.set_attributes(tag, values))
        damping = _float(_inherited(markup, tag, "damping", defaults) or "0")
        for actuator in rotors.driving(joint.name):
            zeros, taken = rotors.without(actuator, joint)
            damping += taken
            edits += [markup.set_attributes(actuator, zeros)] if zeros else []
            for name in zeros:
                zeroed.setdefault(name, []).append(joint.name)
        if joint.damping is not None and damping > LARGE_DAMPING * joint.damping:
            told.append(
                f"{joint.name}: the model's damping was {number(damping)}, now {number(joint.damping)}: if it stood "
                "for the controller's kd, give that to the actuator (kv)"
            )
    told += [
        f"{name} at the actuators of {', '.join(dict.fromkeys(names))} is 0 now: MuJoCo adds it, times gear squared, "
        "to the joint's, which has what was identified"
        for name, names in zeroed.items()
    ]
    told = [one_line(note) for note in told]
    return Conversion.of(markup.edited(edits, told), joints, notes + told[1:], told)


def _budget_edits(markup: Markup, told: list[str]) -> list[Edit]:
    """Return the changes of `<option>` for the solver's budget that friction needs, and add a note on them."""
    options = [tag for tag in markup.tags if tag.name == "option"]
    stated = {key: tag.attributes[key] for tag in options for key in BUDGET if key in tag.attributes}
    had = [int(np.nan_to_num(_float(stated.get(key, str(default))))) for key, (_, default) in BUDGET.items()]
    if (objection := budget_objection(*had)) is None:
        return []
    told.append(f"{objection}: <option> has that now; a file that includes this one must not lower it")
    edits = []
    for tag in options:
        low = {k: str(least) for k, (least, _) in BUDGET.items() if _float(tag.attributes.get(k, "inf")) < least}
        edits += [markup.set_attributes(tag, low)] if low else []
    return edits


def _actuators(markup: Markup) -> list[Tag]:
    """Return the actuators of a model."""
    return [tag for tag in markup.tags if tag.name in ACTUATORS and "actuator" in tag.inside]


@dataclass(frozen=True)
class _Rotors:
    """Armature and damping of actuators; at the joint they count gear squared times."""

    markup: Markup
    actuators: list[Tag]
    defaults: Defaults
    powers: bool
    """True if any damping has powers of the speed."""

    @classmethod
    def of(cls, markup: Markup) -> _Rotors:
        """Return the rotors of a model."""
        powers = any(len(tag.attributes.get("damping", "").split()) > 1 for tag in markup.tags if tag.name in ACTUATORS)
        return cls(markup, _actuators(markup), _defaults(markup, ACTUATORS), powers)

    def driving(self, joint: str) -> list[Tag]:
        """Return the actuators that drive a joint."""
        return [
            tag for tag in self.actuators if joint in (tag.attributes.get(key) for key in ("joint", "jointinparent"))
        ]

    def without(self, tag: Tag, joint: JointPhysics) -> tuple[dict[str, str], float]:
        """Return the attributes that remove from an actuator what its joint has now, and the damping removed."""
        zeros, gone = {}, 0.0
        for name, value in (("armature", joint.armature), ("damping", joint.damping)):
            had = _inherited(self.markup, tag, name, self.defaults)
            if value is None or had is None or not (any(map(_float, had.split())) or self.powers):
                continue
            zeros[name] = "0 0 0" if name == "damping" and self.powers else "0"
            if name == "damping":
                gone = _float(_inherited(self.markup, tag, "gear", self.defaults) or "1") ** 2 * _float(had)
        return zeros, gone


def _notes(joints: list[JointPhysics], timestep: float) -> list[str]:
    """Return notes that hold for all joints, then on the values left out of each."""
    linear = [joint for joint in joints if joint.record.axis == "linear"]
    return notes_of(
        joints,
        *((SLIDE_NOTE,) if linear else ()),
        f"the rows hold with iterations {LEAST_ITERATIONS} and ls_iterations {LEAST_LS_ITERATIONS} of <option> or more "
        "(MuJoCo's own: 100 and 50); with 10 and 20 a joint slips at 0.8 of its friction",
        f"solreffriction is twice a timestep of {number(timestep)} s: change both together",
        'integrate with <option integrator="implicitfast"/>; for no creep at all, noslip_iterations="3"',
        "damping here is the joint's own; the controller's kd belongs to the actuator",
    )


def _class_name(name: str) -> str:
    """Return the name of a default class; reject names that XML would have to escape."""
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


def _defaults(markup: Markup, names: Container[str]) -> Defaults:
    """Return the attributes that every default class gives the elements called `names`."""
    classes: Defaults = {}
    for tag in markup.tags:
        inside = next((up for up in markup.ancestors(tag) if up.name == "default"), None)
        if tag.name == "default":
            around = None if inside is None else inside.attributes.get("class", "main")
            classes.setdefault(tag.attributes.get("class", "main"), ({}, around))
        elif tag.name in names and inside is not None:
            classes[inside.attributes.get("class", "main")][0].update(tag.attributes)
    return classes


def _inherited(markup: Markup, tag: Tag, attribute: str, defaults: Defaults) -> str | None:
    """Return an attribute of a joint: its own, else that of its default class, else that of the class around it."""
    if attribute in tag.attributes:
        return tag.attributes[attribute]
    # A joint's own class, else the nearest `childclass` around it, as MuJoCo looks them up.
    child = (up.attributes["childclass"] for up in markup.ancestors(tag) if "childclass" in up.attributes)
    name: str | None = tag.attributes.get("class") or next(child, "main")
    while name is not None:
        values, around = defaults.get(name, ({}, None if name == "main" else "main"))
        if attribute in values:
            return values[attribute]
        name = around
    return None


def _float(text: str) -> float:
    """Return the first number of an attribute; nan where there is none."""
    try:
        return float(text.split()[0])
    except (ValueError, IndexError):
        return float("nan")
