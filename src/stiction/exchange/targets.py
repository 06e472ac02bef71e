"""Which simulators a `joints.json` can be converted for, and which record each joint of a model takes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from math import isfinite
from pathlib import Path
from typing import Literal

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.exchange.isaaclab import isaaclab_snippet
from stiction.exchange.mujoco import model_joints, mujoco_snippet, patch_mujoco
from stiction.exchange.physics import Conversion, JointPhysics, joint_physics
from stiction.exchange.urdf import parse_markup, patch_urdf, read_model, urdf_joints, urdf_snippet
from stiction.exchange.webots_joints import patch_webots, webots_joints, webots_snippet
from stiction.formats.joints import JointsFile

MOST_NAMES = 12
"""Joints of a model that an error lists."""


def parse_joint_map(pairs: Iterable[str]) -> tuple[tuple[str, str], ...]:
    """Split RECORDED=MODEL pairs; raise `StictionError` for anything else."""
    found = []
    for pair in pairs:
        recorded, equals, model = pair.partition("=")
        if not (recorded and equals and model):
            raise ConfigurationError(f"--joint-map {pair!r}: expected RECORDED=MODEL, such as shank=FL_calf_joint")
        found.append((recorded, model))
    return tuple(found)


def map_joints(
    file: JointsFile, pairs: Sequence[tuple[str, str]], model: Sequence[str] | None = None
) -> dict[str, str]:
    """Return joint of the model -> record.

    A pair goes first; its right side may have wildcards (`*_calf_joint`) where a model is given. What no pair names is
    matched by name or kind, as in training: `FL_shank` takes the record `FL_shank`, else `shank`. Without a model,
    records keep their own names. Raises `StictionError` for a pair that matches nothing, a joint claimed by two
    records, and a record that finds no joint.
    """
    found: dict[str, str] = {}
    for recorded, pattern in pairs:
        if recorded not in file.joints:
            raise ConfigurationError(
                f"--joint-map {recorded}={pattern}: {unknown_name('record', recorded, file.joints)}"
            )
        names = [pattern] if model is None else [name for name in model if fnmatchcase(name, pattern)]
        if not names:
            raise ConfigurationError(f"--joint-map {recorded}={pattern}: {unknown_name('joint', pattern, model or ())}")
        for name in names:
            if found.setdefault(name, recorded) != recorded:
                raise ConfigurationError(
                    f"joint {name!r} is mapped to the records {found[name]!r} and {recorded!r}; choose one"
                )
    mapped = set(found.values())
    if model is None:
        return found | {name: name for name in file.joints if name not in mapped and name not in found}
    for name in model:
        key = file.key(name)
        if name not in found and key is not None and key not in {recorded for recorded, _ in pairs}:
            found[name] = key
    lost = [name for name in file.joints if name not in set(found.values())]
    if lost:
        raise ConfigurationError(
            f"no joint of the model takes the record {lost[0]!r}; name one, as in --joint-map {lost[0]}=JOINT; the "
            f"model has {_some(model)}"
        )
    return found


def _some(names: Iterable[str]) -> str:
    """List names, not too many."""
    listed = list(names)
    more = f" and {len(listed) - MOST_NAMES} more" if len(listed) > MOST_NAMES else ""
    return (", ".join(listed[:MOST_NAMES]) + more) or "none with a name"


Target = Literal["mujoco", "urdf", "isaaclab", "webots"]


@dataclass(frozen=True, kw_only=True)
class ConvertOptions:
    """What to convert to, and how."""

    to: Target
    """The simulator, or format."""
    model: Path | None = None
    """A MJCF, URDF, PROTO or world to put the values into; it is not changed itself."""
    joint_map: tuple[str, ...] = ()
    """RECORDED=MODEL pairs, where names differ; MODEL may have wildcards if --model is given. For isaaclab it is a
    regular expression."""
    timestep: float | None = None
    """Physics step [s] that MuJoCo's solver settings are for, where it is not the model's own."""
    assumed_load: float | None = None
    """|F| + |T| on the joint [N + N m]: also write the coefficient of PhysX before 5.6, which is right at this load."""

    def check(self) -> None:
        """Raise `StictionError` for numbers without meaning, and for options that the target would ignore."""
        for name in ("timestep", "assumed_load"):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and value > 0):
                raise ConfigurationError(f"{name} {value}: expected a positive number")
        needed = {"timestep": ("mujoco",), "assumed_load": ("isaaclab",), "model": ("mujoco", "urdf", "webots")}
        for name, targets in needed.items():
            if getattr(self, name) is not None and self.to not in targets:
                raise ConfigurationError(f"--{name.replace('_', '-')} is for --to {', '.join(targets)}; leave it out")
        wild = [pair for pair in self.joint_map if set("*?[") & set(pair)]
        if wild and self.model is None and self.to != "isaaclab":
            raise ConfigurationError(f"--joint-map {wild[0]!r}: wildcards need a --model whose joints they can match")


def convert(file: JointsFile, options: ConvertOptions) -> Conversion:
    """Return a `joints.json` in the form that a simulator reads.

    Raises `StictionError` for a model that cannot be read or does not fit, and for records that hold nothing.
    """
    options.check()
    to, pairs = options.to, parse_joint_map(options.joint_map)
    if options.model is not None:
        data, where = read_model(options.model), options.model.name
        if to == "webots":
            return patch_webots(data, where, _joints(file, pairs, list(webots_joints(data, where))))
        markup = parse_markup(data, where)
        names = model_joints(markup) if to == "mujoco" else urdf_joints(markup)
        joints = _joints(file, pairs, list(names))
        return patch_mujoco(markup, joints, options.timestep) if to == "mujoco" else patch_urdf(markup, joints)
    joints = _joints(file, pairs, None)
    if to == "mujoco":
        return mujoco_snippet(joints, options.timestep)
    if to == "isaaclab":
        return isaaclab_snippet(joints, options.assumed_load)
    return urdf_snippet(joints) if to == "urdf" else webots_snippet(joints)


def _joints(file: JointsFile, pairs: Sequence[tuple[str, str]], model: Sequence[str] | None) -> list[JointPhysics]:
    """Return the physics of every joint that a record is for."""
    mapped = map_joints(file, pairs, model)
    return [joint_physics(recorded, file.joints[recorded], name) for name, recorded in mapped.items()]
