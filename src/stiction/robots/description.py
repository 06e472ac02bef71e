"""`robot.yaml`: the few lines that say of a robot what its MuJoCo or URDF file does not.

    model: robot.xml                    # or robot.urdf; beside this file
    joints:                             # regular expressions of whole names; for each field the first match wins
      .*_(thigh|hip)_joint: {torque_limit: 23.7, armature: 0.0054}
      .*: {torque_limit: 35.5, armature: 0.012, kp: 40, kd: 1}
    pose: {.*_thigh_joint: 0.9, .*_calf_joint: -1.8}

All that is not said is derived from the file or by a rule (`derive`); `FIELDS` and `JOINT_FIELDS` list what can be
said. Such a file comes from others: it is small, names no code, and cannot make the reader slow.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from stiction.core.errors import RobotError, unknown_name
from stiction.core.yaml_files import Values, read_yaml
from stiction.robots.model import Robot, Vendor

TAKE = Values(RobotError)

MOST_REPETITIONS = 4
"""Maximum of `*`, `+`, `?` and `{}`, and of groups, in one regular expression: its time grows with the length of the
name to this power."""

JOINT_FIELDS = {
    "torque_limit": "largest torque at the joint [N m]",
    "armature": "rotor inertia at the joint [kg m²]",
    "damping": "viscous friction [N m s/rad]",
    "frictionloss": "dry friction that was measured [N m]",
    "kp": "proportional gain [N m/rad]",
    "kd": "derivative gain [N m s/rad]",
    "lower": "lower limit [rad]",
    "upper": "upper limit [rad]",
    "action_scale": "angle per unit of action [rad]",
    "kind": "what the joint is in every leg alike",
    "action": "false: the policy does not move it, it is held in the pose",
}
"""Settings of a joint, and their meaning."""

FIELDS = {
    "model": "the robot's MuJoCo (.xml) or URDF (.urdf) file, beside this one",
    "name": "the robot's name, as in file names",
    "joints": "regular expression of joint names -> fields of joints",
    "pose": "regular expression of joint names -> angle in the standing pose [rad]",
    "keyframe": "name of the keyframe of the file that is the standing pose",
    "base": "body that floats",
    "feet": "bodies or geometries that are the feet, in the order that they shall have",
    "groups": "two lists of feet: those that step together",
    "mirror": "joint -> its left-right image; or none: the robot has no mirror",
    "collision": "feet (default: feet and a box for the trunk touch the ground), or file (all that the file says)",
    "gait_period": "time of one stride [s], of which a clock tells the policy: what a biped wants",
    "vendor": "order: joints in the maker's order; sign: expression -> +1 or -1; offset: expression -> angle [rad]",
}
"""Settings of a robot, and their meaning."""


@dataclass(frozen=True)
class Description:
    """Contents of a `robot.yaml`; everything but `model` is optional, and that too where a file is named."""

    model: str | None = None
    name: str | None = None
    joints: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    pose: Mapping[str, float] = field(default_factory=dict)
    keyframe: str | None = None
    base: str | None = None
    feet: tuple[str, ...] = ()
    groups: tuple[tuple[str, ...], ...] = ()
    mirror: Mapping[str, str] | None = None
    """None: not stated; empty: no mirror."""
    collision: str = "feet"
    gait_period: float | None = None
    vendor: Mapping[str, Any] = field(default_factory=dict)
    source: str = "robot.yaml"
    """Source of the values, for messages."""

    def of_joint(self, joint: str, name: str) -> Any:
        """Return one field of a joint, or None."""
        return next(
            (entry[name] for pattern, entry in self.joints.items() if name in entry and re.fullmatch(pattern, joint)),
            None,
        )

    def angle(self, joint: str) -> float | None:
        """Return a joint's angle in the standing pose [rad], or None."""
        return first_match(self.pose, joint)

    def vendor_of(self, joints: tuple[str, ...]) -> Vendor | None:
        """Return the maker's protocol of these joints, or None.

        Raises `RobotError` where the order does not name each joint once.
        """
        if not self.vendor:
            return None
        order = tuple(self.vendor.get("order", joints))
        if sorted(order) != sorted(joints):
            odd = sorted(set(order) ^ set(joints)) or sorted(name for name in order if order.count(name) > 1)
            raise RobotError(
                f"{self.source}: vendor.order names {odd} wrongly; expected every joint once: {list(joints)}"
            )
        sign, offset = self.vendor.get("sign", {}), self.vendor.get("offset", {})
        return Vendor(
            order,
            tuple(1.0 if (number := first_match(sign, name)) is None else number for name in order),
            tuple(first_match(offset, name) or 0.0 for name in order),
        )


def first_match(entries: Mapping[str, float], name: str) -> float | None:
    """Return the value of the first expression that matches a whole name, or None."""
    return next((value for pattern, value in entries.items() if re.fullmatch(pattern, name)), None)


def read_description(path: Path) -> Description:
    """Return the contents of a `robot.yaml`.

    Raises `RobotError` naming the invalid entry.
    """
    return describe(read_yaml(path, "a robot.yaml", RobotError), str(path))


def files_of(path: Path) -> tuple[Path, ...]:
    """Return a robot's file, and the model that a `robot.yaml` names. Errors: `read_description`."""
    if path.suffix.lower() in (".xml", ".urdf", ".json"):
        return (path,)
    return path, path.parent / (read_description(path).model or "")


def describe(content: Any, source: str) -> Description:
    """Return the description in a mapping, as YAML gives it; `source`: its origin, for messages.

    Raises `RobotError` naming the invalid entry.
    """
    entries = TAKE.mapping(content, f"{source}: the file")
    for name in entries:
        if name not in FIELDS:
            raise RobotError(f"{source}: {unknown_name('field', str(name), FIELDS)}")
    if "pose" in entries and "keyframe" in entries:
        raise RobotError(f"{source}: both pose and keyframe say how the robot stands; expected one of them")
    collision = entries.get("collision", "feet")
    if collision not in ("feet", "file"):
        raise RobotError(f"{source}: collision is {collision!r}; expected feet or file")
    if not re.fullmatch(r"\w[\w.-]*", name := TAKE.word(entries.get("name", "robot"), f"{source}: name")):
        raise RobotError(f"{source}: name is {name!r}; expected letters, digits, and . _ - between them")
    return Description(
        **{
            name: TAKE.word(entries[name], f"{source}: {name}")
            for name in ("model", "name", "keyframe", "base")
            if name in entries
        },
        joints=_joints(entries.get("joints", {}), source),
        pose=_by_name(entries.get("pose", {}), "pose", source),
        feet=TAKE.names(entries.get("feet", []), f"{source}: feet"),
        groups=tuple(
            TAKE.names(group, f"{source}: groups")
            for group in TAKE.sequence(entries.get("groups", []), f"{source}: groups")
        ),
        mirror=_mirror(entries.get("mirror"), source),
        collision=collision,
        gait_period=TAKE.number(period, f"{source}: gait_period") if (period := entries.get("gait_period")) else None,
        vendor=_vendor(entries.get("vendor", {}), source),
        source=source,
    )


def check_pattern(pattern: str, source: str) -> str:
    """Return a valid regular expression that is fast on every name.

    Raises `RobotError` for an invalid one, or one that could be slow: nested repetitions take exponential time.
    """
    # What is escaped or in a set is one character, and repeats nothing.
    plain = re.sub(r"\\.|\[(?:\\.|[^\]\\])*\]", "x", pattern)
    # What may be there or not doubles the ways through, and so does each choice of a group; `(?` begins a group.
    repeated, groups = len(re.findall(r"(?<!\()[*+{?]", plain)), plain.count("(")
    if len(pattern) > 200 or re.search(r"\)[*+{]", plain) or repeated > MOST_REPETITIONS or groups > MOST_REPETITIONS:
        raise RobotError(
            f"{source}: the expression {pattern[:60]!r} could be slow; expected at most {MOST_REPETITIONS} "
            f"repetitions, none of them of a group, and at most {MOST_REPETITIONS} groups"
        )
    try:
        re.compile(pattern)
    except re.error as error:
        raise RobotError(f"{source}: {pattern!r} is not a regular expression: {error}") from error
    return pattern


def _joints(value: Any, source: str) -> dict[str, dict[str, Any]]:
    """Return the settings of joints, by expression."""
    settings: dict[str, dict[str, Any]] = {}
    for pattern, entry in TAKE.mapping(value, f"{source}: joints").items():
        where = f"joints: {pattern}"
        entries = settings[check_pattern(pattern, source)] = dict(TAKE.mapping(entry, f"{source}: {where}"))
        for name, item in entries.items():
            if name not in JOINT_FIELDS:
                raise RobotError(f"{source}: {where}: {unknown_name('field', name, JOINT_FIELDS)}")
            if name == "action":
                if not isinstance(item, bool):
                    raise RobotError(f"{source}: {where}: action is {item!r}; expected true or false")
            elif name == "kind":
                entries[name] = TAKE.word(item, f"{source}: {where}: kind")
            else:
                entries[name] = TAKE.number(item, f"{source}: {where}: {name}")
    return settings


def _mirror(value: Any, source: str) -> dict[str, str] | None:
    """Return the mirror."""
    if value is None or value == "none":
        return None if value is None else {}
    pairs = {
        name: TAKE.word(other, f"{source}: mirror: {name}")
        for name, other in TAKE.mapping(value, f"{source}: mirror").items()
    }
    return pairs | {other: name for name, other in pairs.items()}


def _vendor(value: Any, source: str) -> dict[str, Any]:
    """Return the maker's protocol."""
    entries = TAKE.mapping(value, f"{source}: vendor")
    settings: dict[str, Any] = {}
    for name, item in entries.items():
        if name == "order":
            settings[name] = TAKE.names(item, f"{source}: vendor.order")
        elif name in ("sign", "offset"):
            settings[name] = _by_name(item, f"vendor.{name}", source)
        else:
            raise RobotError(f"{source}: vendor: {unknown_name('field', name, ('order', 'sign', 'offset'))}")
    for pattern, number in settings.get("sign", {}).items():
        if abs(number) != 1:
            raise RobotError(f"{source}: vendor.sign: {pattern} is {number:g}; expected 1 or -1")
    return settings


def _by_name(value: Any, where: str, source: str) -> dict[str, float]:
    """Return numbers by expression."""
    entries = TAKE.mapping(value, f"{source}: {where}").items()
    return {check_pattern(name, source): TAKE.number(item, f"{source}: {where}: {name}") for name, item in entries}


def complete_text(robot: Robot, model: str) -> str:
    """Return the complete `robot.yaml` of a robot; `model`: path of its file, relative to it."""
    joints = {
        re.escape(joint.name).replace("\\-", "-"): {
            name: _rounded(getattr(joint, name)) for name in JOINT_FIELDS if name != "action"
        }
        for joint in robot.joints
    }
    pose = {joint.name: _rounded(joint.default_position) for joint in robot.joints}
    content: dict[str, Any] = {
        "model": model,
        "name": robot.name,
        "feet": list(robot.foot_names),
        "joints": joints,
        "pose": {re.escape(name): angle for name, angle in pose.items()},
    }
    if robot.feet[0].group is not None:
        content["groups"] = [[foot.name for foot in robot.feet if foot.group == number] for number in (0, 1)]
    if robot.mirror_names is not None:
        content["mirror"] = (
            dict(zip(robot.joint_names, robot.mirror_names, strict=True)) if robot.mirror_names else "none"
        )
    if robot.gait_period is not None:
        content["gait_period"] = robot.gait_period
    if robot.vendor is not None:
        rows = zip(robot.vendor.order, robot.vendor.sign, robot.vendor.offset, strict=True)
        known = [row for row in rows if row[0] in robot.joint_names]
        content["vendor"] = {
            "order": [name for name, _, _ in known],
            "sign": {re.escape(name): int(sign) for name, sign, _ in known},
            "offset": {re.escape(name): offset for name, _, offset in known},
        }
    # The model has no joint where one is held: what is said of those is a comment.
    angles = {joint.name: _rounded(joint.position) for joint in robot.held}
    held: dict[str, Any] = {"held": angles} if angles else {}
    if angles and robot.vendor is not None:
        held["order of the maker, held joints too"] = list(robot.vendor.order)
    remarks = _yaml(held).splitlines() if held else []
    return "".join(f"# {line}\n" for line in remarks) + _yaml(content)


def _yaml(content: Mapping[str, Any]) -> str:
    """Return the YAML of a mapping."""
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120, allow_unicode=True)


def _rounded(value: Any) -> Any:
    """Return a number with seven digits."""
    return float(f"{value:.7g}") if isinstance(value, float) else value
