"""Which simulators an identification can be converted for, and which record each joint of a model takes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Literal

from stiction.core.effects import check_effects, flag_of, needs, requirement
from stiction.core.errors import ConfigurationError, FileError
from stiction.exchange.isaaclab import isaaclab_snippet
from stiction.exchange.mjlab.lines import joints_lines, training_lines
from stiction.exchange.mujoco import included_joints, joint_kinds, mujoco_snippet, patch_mujoco
from stiction.exchange.physics import Conversion, JointPhysics, Which, joint_physics
from stiction.exchange.randomization import FRAMEWORKS, randomization_term, recipe_of
from stiction.exchange.urdf import TYPES, Markup, parse_markup, patch_urdf, read_model, urdf_joints, urdf_snippet
from stiction.exchange.webots_joints import patch_webots, webots_joints, webots_snippet
from stiction.files.joint_map import MOST_NAMES, map_joints, parse_joint_map
from stiction.files.joints import JointsFile, load_joints, read_training

Target = Literal["mujoco", "urdf", "isaaclab", "webots", "mjlab", "legged_gym"]

NOMINAL: tuple[Target, ...] = ("mujoco", "urdf", "isaaclab", "webots", "mjlab")
"""What takes the values of a `joints.json`; the range of a `training.json` goes to mjlab and `FRAMEWORKS`."""


@dataclass(frozen=True, kw_only=True)
class ConvertOptions:
    """What to convert to, and how."""

    to: Target
    """The simulator, or format. Of a joints.json its values: mujoco, urdf, isaaclab, webots, mjlab; of a training.json
    the range to train with: mjlab, isaaclab, legged_gym, mujoco."""
    model: Path | None = field(default=None, metadata=needs("--to mujoco, urdf or webots"))
    """A MJCF, URDF, PROTO or world to put the values into; it is not changed itself."""
    joint_map: tuple[str, ...] = ()
    """RECORDED=MODEL pairs, where names differ; MODEL may have wildcards if --model is given, and for mjlab. For
    isaaclab it is a regular expression."""
    timestep: float | None = field(default=None, metadata=needs("--to mujoco"))
    """Physics step [s] that MuJoCo's solver settings are for, where it is not the model's own."""
    assumed_load: float | None = field(default=None, metadata=needs("--to isaaclab or legged_gym"))
    """|F| + |T| on the joint [N + N m], for the coefficient of PhysX before 5.6, which is right at this load: beside
    the values, or in place of the range."""
    friction: Which = "moving"
    """Dry friction of a target with one number: that in motion, or what holds the joint at rest where that is more.
    Isaac Lab gets both; there it is for Newton and --assumed-load, which have one."""
    robot: str | None = None
    """Of a training.json: the robot whose joints and torque limits its shares are of; its name, robot.yaml, MJCF or
    URDF. By default the joints of the joints.json that lies beside it."""

    def check(self) -> None:
        """Raise `StictionError` for numbers without meaning, and for options that the target would ignore."""
        for name in ("timestep", "assumed_load"):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and value > 0):
                raise ConfigurationError(f"{name} {value}: expected a positive number")
        check_effects(self)
        wild = [pair for pair in self.joint_map if set("*?[") & set(pair)]
        if wild and self.model is None and self.to not in ("isaaclab", "mjlab"):
            raise ConfigurationError(f"--joint-map {wild[0]!r}: wildcards need a --model whose joints they can match")


def convert(file: JointsFile, options: ConvertOptions, path: Path = Path("joints.json")) -> Conversion:
    """Return a `joints.json` in the form that a simulator reads; path: of the file, for mjlab, which reads it itself.

    Raises `StictionError` for a model that cannot be read or does not fit, and for records that hold nothing.
    """
    options.check()
    if options.to not in NOMINAL:
        raise ConfigurationError(
            f"--to {options.to} writes the range of a training.json; the values of a joints.json go to "
            f"{', '.join(NOMINAL)}"
        )
    if options.robot is not None:
        raise ConfigurationError(requirement("--robot", "a training.json"))
    to, pairs = options.to, parse_joint_map(options.joint_map)
    if options.model is not None:
        data, where = read_model(options.model), options.model.name
        if to == "webots":
            return patch_webots(
                data, where, _joints(file, pairs, list(webots_joints(data, where)), which=options.friction)
            )
        markup = parse_markup(data, where)
        return (
            _into_mujoco(file, pairs, markup, options) if to == "mujoco" else _into_urdf(file, pairs, markup, options)
        )
    if to == "isaaclab":
        return isaaclab_snippet(_joints(file, pairs, None), options.assumed_load, options.friction)
    joints = _joints(file, pairs, None, which=options.friction)
    if to == "mjlab":
        return joints_lines(path, joints, pairs, options.friction)
    if to == "mujoco":
        return mujoco_snippet(joints, options.timestep)
    return urdf_snippet(joints) if to == "urdf" else webots_snippet(joints)


def _into_urdf(
    file: JointsFile, pairs: Sequence[tuple[str, str]], markup: Markup, options: ConvertOptions
) -> Conversion:
    """Return a URDF with the records of its joints; patterns take those that move as their record's axis."""
    kinds = {name: tag.attributes.get("type", "") for name, tag in urdf_joints(markup).items()}

    def takes(record: str, joint: str) -> bool:
        return kinds[joint] in TYPES[file.joints[record].axis]

    return patch_urdf(markup, _joints(file, pairs, list(kinds), takes, options.friction))


def _into_mujoco(
    file: JointsFile, pairs: Sequence[tuple[str, str]], markup: Markup, options: ConvertOptions
) -> Conversion:
    """Return an MJCF with the records of its joints; patterns take those that are driven, and move as their axis.

    Raises `StictionError`, as where the joints stand in a file that this one includes.
    """
    kinds, passive = joint_kinds(markup), dict[str, None]()

    def takes(record: str, joint: str) -> bool:
        kind, driven = kinds[joint]
        fits = kind == ("slide" if file.joints[record].axis == "linear" else "hinge")
        if fits and not driven:
            passive[joint] = None
        return fits and driven

    try:
        joints = _joints(file, pairs, list(kinds), takes, options.friction)
    except ConfigurationError as error:
        assert options.model is not None
        for name, others in included_joints(markup, options.model).items():
            more = f" and {len(others) - MOST_NAMES} more" if len(others) > MOST_NAMES else ""
            raise ConfigurationError(
                f"{error}; {options.model.name} includes {name}, which has {', '.join(others[:MOST_NAMES])}{more}: "
                f"give --model {options.model.parent / name}"
            ) from error
        raise
    return patch_mujoco(markup, joints, options.timestep, [*passive])


def convert_training(path: Path, options: ConvertOptions) -> Conversion:
    """Return the range of a `training.json` as a framework draws it.

    Raises `StictionError` where it proposes nothing, where a torque limit is not known, and for options that would be
    ignored.
    """
    options.check()
    for name in ("model", "timestep", "joint_map"):
        if getattr(options, name) not in (None, ()):
            raise ConfigurationError(requirement(flag_of(name), "a joints.json"))
    if options.to == "mjlab":
        # It has the robot, and so the torque limits.
        if options.robot is not None:
            raise ConfigurationError(requirement("--robot", "--to isaaclab, legged_gym or mujoco"))
        return training_lines(path, read_training(path), options.friction)
    if options.to not in FRAMEWORKS:
        raise ConfigurationError(
            f"--to {options.to} takes the values of a joints.json; the range of a training.json goes to "
            f"mjlab, {', '.join(FRAMEWORKS)}"
        )
    recipe = recipe_of(read_training(path), torque_limits(path, options.robot), options.friction)
    return randomization_term(recipe, options.to, options.assumed_load)


def torque_limits(path: Path, robot: str | None) -> dict[str, float]:
    """Return the torque limits [N m] of the joints that a `training.json` is for: of a robot, or identified ones."""
    if robot is not None:
        from stiction.robots.catalog import find_robot

        spec = find_robot(robot)
        return dict(zip(spec.joint_names, spec.joint_values("torque_limit").tolist(), strict=True))
    beside = path.parent / "joints.json"
    if not beside.is_file():
        raise FileError(
            f"{path.name} proposes shares of torque limits, and no joints.json with limits lies beside it; give --robot"
        )
    limits = {name: record.torque_limit for name, record in load_joints(beside).joints.items()}
    known = {name: limit for name, limit in limits.items() if limit is not None}
    if len(known) < len(limits):
        missing = next(name for name in limits if name not in known)
        raise FileError(f"joint {missing!r} has no torque limit in {beside.name}; give --robot")
    return known


def _joints(
    file: JointsFile,
    pairs: Sequence[tuple[str, str]],
    model: Sequence[str] | None,
    takes: Callable[[str, str], bool] = lambda record, joint: True,
    which: Which = "moving",
) -> list[JointPhysics]:
    """Return the physics of every joint that a record is for; takes: see `map_joints`; which: friction it gets."""
    names = map_joints(file, pairs, model, takes)
    return [joint_physics(recorded, file.joints[recorded], name, which) for name, recorded in names.items()]
