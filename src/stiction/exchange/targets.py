"""Targets of a conversion, and the choice of the record for each joint of a model."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from string import Template
from typing import Literal

from stiction.core.effects import check_effects, excludes, flag_of, needs, requirement
from stiction.core.errors import ConfigurationError, FileError
from stiction.exchange.isaaclab import isaaclab_snippet
from stiction.exchange.mjlab.lines import joints_lines, training_lines
from stiction.exchange.mujoco import included_joints, joint_kinds, mujoco_snippet, patch_mujoco
from stiction.exchange.physics import PAGE, Conversion, JointPhysics, Which, headline, joint_physics, notes_of
from stiction.exchange.randomization import Recipe, recipe_of
from stiction.exchange.trainer_texts import (
    COEFFICIENT,
    GENESIS,
    ISAACLAB,
    LEGGED_GYM,
    MUJOCO,
    PLAYGROUND,
    Tables,
    trainer_text,
)
from stiction.exchange.urdf import TYPES, Markup, parse_markup, patch_urdf, read_model, urdf_joints, urdf_snippet
from stiction.exchange.webots_joints import patch_webots, webots_joints, webots_snippet
from stiction.files.bam import bam_of_record, load_joints
from stiction.files.joint_map import MOST_NAMES, map_joints, parse_joint_map
from stiction.files.joints import JointsFile, read_training
from stiction.files.plain import object_text

Target = Literal[
    "mujoco",
    "urdf",
    "webots",
    "mjlab",
    "isaaclab",
    "isaaclab_newton",
    "playground",
    "legged_gym",
    "genesis",
    "bam",
    "joints",
]


ISAAC_LAB = ("isaaclab", "isaaclab_newton")
"""Targets whose patterns of joint names are regular expressions."""

OWN_PATTERNS = (*ISAAC_LAB, "mjlab")
"""Targets whose trainer matches patterns of joint names itself."""


def _has_one_number(options: ConvertOptions) -> bool:
    """Return True if the target has one number for friction at rest and in motion."""
    return options.to not in ("bam", "joints") and (options.to != "isaaclab" or options.assumed_load is not None)


@dataclass(frozen=True, kw_only=True)
class ConvertOptions:
    """Target of a conversion, and its options."""

    to: Target
    """The simulator, trainer or format. All take the values of a joints.json; the range of a training.json goes to the
    simulators and trainers, but for urdf and webots. bam writes BAM's file of each joint, joints a joints.json."""
    model: Path | None = field(default=None, metadata=needs("--to mujoco, urdf or webots"))
    """A MJCF, URDF, PROTO or world to put the values into; it is not changed itself."""
    joint_map: tuple[str, ...] = ()
    """RECORDED=MODEL pairs, where names differ; MODEL may have wildcards with --model or --robot, and for mjlab. For
    isaaclab it is a regular expression."""
    timestep: float | None = field(default=None, metadata=needs("--to mujoco"))
    """Physics step [s] that MuJoCo's solver settings are for, where it is not the model's own."""
    assumed_load: float | None = field(default=None, metadata=needs("--to isaaclab or legged_gym"))
    """Assumed |F| + |T| on the joint [N + N m], for the coefficient of PhysX before 5.6, right at this load only: in
    addition to the values, or in place of the range."""
    friction: Which = field(default="moving", metadata=needs("a --to with one number for friction", _has_one_number))
    """Dry friction of a target with one number: that in motion, or what holds the joint at rest where that is more.
    bam, joints and Isaac Lab on PhysX get both; for isaaclab it is for --assumed-load."""
    robot: str | None = field(default=None, metadata=excludes("--model"))
    """Robot, by its name, robot.yaml, MJCF or URDF. Of a training.json: the one whose joints and torque limits its
    shares are of, by default the joints of the joints.json that lies beside it. Of a joints.json: the one whose joints
    the wildcards of --joint-map match."""

    def check(self) -> None:
        """Raise `StictionError` for numbers without meaning, and for options that the target ignores."""
        for name in ("timestep", "assumed_load"):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and value > 0):
                raise ConfigurationError(f"{name} {value}: expected a positive number")
        check_effects(self)
        for pair in self.joint_map if self.to in ISAAC_LAB else ():
            try:
                re.compile(pair.partition("=")[2])
            except re.error as error:
                raise ConfigurationError(
                    f"--joint-map {pair!r}: Isaac Lab takes a regular expression: {error}; expected one, such as "
                    "shank=.*_calf_joint"
                ) from error
        wild = [pair for pair in self.joint_map if set("*?[") & set(pair)]
        if wild and self.model is None and self.robot is None and self.to not in OWN_PATTERNS:
            files = " or --model FILE" if self.to in ("mujoco", "urdf", "webots") else ""
            raise ConfigurationError(
                f"--joint-map {wild[0]!r}: wildcards need joints to match; add --robot NAME{files}, or name each joint,"
                " as in --joint-map shank=FL_calf_joint shank=FR_calf_joint"
            )


@dataclass(frozen=True)
class Source:
    """Identified joints, with the file that they come from and its options."""

    joints: list[JointPhysics]
    path: Path
    pairs: tuple[tuple[str, str], ...]
    options: ConvertOptions


@dataclass(frozen=True)
class TargetSpec:
    """Writers of one target; None for an input that it does not take."""

    values: Callable[[Source], Conversion]
    """Writer of the values of a `joints.json`."""
    ranges: Callable[[Recipe, ConvertOptions], Conversion] | None = None
    """Writer of the range of a `training.json`."""
    both: bool = False
    """True if it has friction at rest and in motion apart."""


def _values_of(template: Template) -> Callable[[Source], Conversion]:
    """Return the writer of values into the text of a trainer."""

    def write(source: Source) -> Conversion:
        tables = Tables(
            {joint.name: (joint.friction, joint.friction) for joint in source.joints if joint.friction is not None},
            {joint.name: joint.damping for joint in source.joints if joint.damping is not None},
            {joint.name: joint.armature for joint in source.joints if joint.armature is not None},
        )
        if not tables.friction:
            raise FileError(f"{source.path.name} has no dry friction that may be used; --to mujoco takes the rest")
        if source.options.assumed_load is not None:
            load = source.options.assumed_load
            tables = Tables({name: (low / load, high / load) for name, (low, high) in tables.friction.items()})
        told = [headline(source.joints)]
        chosen = template if source.options.assumed_load is None else COEFFICIENT
        text = f"# {told[0]}\n\n{trainer_text(chosen, tables)}"
        return Conversion.of(text, source.joints, notes_of(source.joints), told)

    return write


def _ranges_of(template: Template, newton: bool = False) -> Callable[[Recipe, ConvertOptions], Conversion]:
    """Return the writer of ranges into the text of a trainer; newton: True for Isaac Lab on Newton."""

    def write(recipe: Recipe, options: ConvertOptions) -> Conversion:
        apart = template is ISAACLAB and options.assumed_load is None
        factor = 1.0 if apart else recipe.alone / (options.assumed_load or 1.0)
        spans = {name: (factor * span.low, factor * span.high) for span in recipe.ranges for name in span.joints}
        tables = Tables(spans, moving=recipe.moving if apart else (1.0, 1.0), together=recipe.together)
        if newton:
            drawn = "rest" if options.friction == "static" else "moving"
            tables = replace(tables, written=f"joint_friction_coeff={drawn}")
        told = f"{recipe.notes[0]}; what it rests on, and what to mind: {PAGE}"
        chosen = COEFFICIENT if template is LEGGED_GYM and options.assumed_load is not None else template
        text = f"# {told}\n\n{trainer_text(chosen, tables)}"
        return Conversion(text, {name: name for name in spans}, recipe.notes, (told,))

    return write


def _bam_files(source: Source) -> Conversion:
    """Return a parameter file of BAM for each joint."""
    texts = {joint.name: object_text(bam_of_record(joint.recorded, joint.record)) for joint in source.joints}
    told = ["BAM's friction under load is of |external - motor torque|, at rest twice the motor's: half of ours"]
    loaded = any(joint.record.load_coefficient is not None for joint in source.joints)
    names = {joint.name: joint.recorded for joint in source.joints}
    return Conversion(next(iter(texts.values())), names, (), tuple(told if loaded else ()), texts)


def _joints_file(source: Source) -> Conversion:
    """Return the records as one joints.json."""
    text = object_text(JointsFile({joint.name: joint.record for joint in source.joints}).to_dict())
    return Conversion.of(text, source.joints, [], [])


TARGETS: dict[Target, TargetSpec] = {
    "mujoco": TargetSpec(lambda s: mujoco_snippet(s.joints, s.options.timestep), _ranges_of(MUJOCO)),
    "urdf": TargetSpec(lambda s: urdf_snippet(s.joints)),
    "webots": TargetSpec(lambda s: webots_snippet(s.joints)),
    # Its range needs no torque limits: it has the robot. See `convert_training`.
    "mjlab": TargetSpec(lambda s: joints_lines(s.path, s.joints, s.pairs, s.options.friction)),
    "isaaclab": TargetSpec(
        lambda s: isaaclab_snippet(s.joints, s.options.assumed_load, s.options.friction),
        _ranges_of(ISAACLAB),
        both=True,
    ),
    "isaaclab_newton": TargetSpec(
        lambda s: isaaclab_snippet(s.joints, which=s.options.friction, newton=True), _ranges_of(ISAACLAB, newton=True)
    ),
    "playground": TargetSpec(_values_of(PLAYGROUND), _ranges_of(PLAYGROUND)),
    "legged_gym": TargetSpec(_values_of(LEGGED_GYM), _ranges_of(LEGGED_GYM)),
    "genesis": TargetSpec(_values_of(GENESIS), _ranges_of(GENESIS)),
    "bam": TargetSpec(_bam_files),
    "joints": TargetSpec(_joints_file),
}
"""Every target of `stiction convert`."""

RANGES = tuple(name for name, spec in TARGETS.items() if spec.ranges)
"""Targets whose range is drawn by a text of ours; mjlab's is drawn by `stiction.mjlab`."""


def convert(file: JointsFile, options: ConvertOptions, path: Path = Path("joints.json")) -> Conversion:
    """Return a `joints.json` in the form that a simulator reads; path: its file, for mjlab, which reads it itself.

    Raises `StictionError` for a model that cannot be read or does not fit, and for records without usable values.
    """
    options.check()
    to, pairs = options.to, parse_joint_map(options.joint_map)
    if options.robot is not None and to in OWN_PATTERNS:
        raise ConfigurationError(
            f"--robot: got a joints.json and --to {to}, which matches names of joints itself; remove --robot"
        )
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
    spec, names = TARGETS[to], None
    if options.robot is not None:
        from stiction.robots.catalog import find_robot

        names = find_robot(options.robot).joint_names
    joints = _joints(file, pairs, names, which="moving" if spec.both else options.friction)
    return spec.values(Source(joints, path, pairs, options))


def _into_urdf(
    file: JointsFile, pairs: Sequence[tuple[str, str]], markup: Markup, options: ConvertOptions
) -> Conversion:
    """Return a URDF with the records of its joints; patterns take joints that move as their record's axis."""
    kinds = {name: tag.attributes.get("type", "") for name, tag in urdf_joints(markup).items()}

    def takes(record: str, joint: str) -> bool:
        return kinds[joint] in TYPES[file.joints[record].axis]

    return patch_urdf(markup, _joints(file, pairs, list(kinds), takes, options.friction))


def _into_mujoco(
    file: JointsFile, pairs: Sequence[tuple[str, str]], markup: Markup, options: ConvertOptions
) -> Conversion:
    """Return an MJCF with the records of its joints; patterns take driven joints that move as their axis.

    Raises `StictionError`, also where the joints stand in a file that this one includes.
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
        for name, included in included_joints(markup, options.model).items():
            more = f" and {len(included) - MOST_NAMES} more" if len(included) > MOST_NAMES else ""
            raise ConfigurationError(
                f"{error}; {options.model.name} includes {name}, which has {', '.join(included[:MOST_NAMES])}{more}: "
                f"give --model {options.model.parent / name}"
            ) from error
        raise
    return patch_mujoco(markup, joints, options.timestep, [*passive])


def convert_training(path: Path, options: ConvertOptions) -> Conversion:
    """Return the range of a `training.json` as a framework draws it.

    Raises `StictionError` for a proposal without a range, an unknown torque limit, and options that would be
    ignored.
    """
    options.check()
    for name in ("model", "timestep", "joint_map"):
        if getattr(options, name) not in (None, ()):
            raise ConfigurationError(requirement(flag_of(name), "a joints.json"))
    if options.to == "mjlab":
        # It has the robot, and so the torque limits.
        if options.robot is not None:
            raise ConfigurationError(requirement("--robot", f"--to {', '.join(RANGES)}"))
        return training_lines(path, read_training(path), options.friction)
    if (write := TARGETS[options.to].ranges) is None:
        raise ConfigurationError(
            f"--to {options.to} takes the values of a joints.json; the range of a training.json goes to "
            f"mjlab, {', '.join(RANGES)}"
        )
    recipe = recipe_of(read_training(path), torque_limits(path, options.robot), options.friction)
    return write(recipe, options)


def torque_limits(path: Path, robot: str | None) -> dict[str, float]:
    """Return the torque limits [N m] of the joints that a `training.json` is for: of a robot, or identified ones."""
    if robot is not None:
        from stiction.robots.catalog import find_robot

        spec = find_robot(robot)
        return dict(zip(spec.joint_names, spec.joint_values("torque_limit").tolist(), strict=True))
    joints_file = path.parent / "joints.json"
    if not joints_file.is_file():
        raise FileError(
            f"{path.name} proposes shares of torque limits, and no joints.json with limits lies beside it; give --robot"
        )
    limits = {name: record.torque_limit for name, record in load_joints(joints_file).joints.items()}
    known = {name: limit for name, limit in limits.items() if limit is not None}
    if len(known) < len(limits):
        missing = next(name for name in limits if name not in known)
        raise FileError(f"joint {missing!r} has no torque limit in {joints_file.name}; give --robot")
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
