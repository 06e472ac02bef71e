"""The simulators that there are, and the way from a `joints.json` to each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Literal

from stiction.formats.errors import StictionError
from stiction.formats.joints import JointsFile
from stiction.identify.convert.isaaclab import isaaclab_snippet
from stiction.identify.convert.mapping import map_joints, parse_joint_map
from stiction.identify.convert.markup import parse_markup, read_model
from stiction.identify.convert.mujoco import model_joints, mujoco_snippet, patch_mujoco
from stiction.identify.convert.physics import Conversion, JointPhysics, joint_physics
from stiction.identify.convert.urdf import patch_urdf, urdf_joints, urdf_snippet
from stiction.identify.convert.webots import patch_webots, webots_joints, webots_snippet

Target = Literal["mujoco", "urdf", "isaaclab", "webots"]


@dataclass(frozen=True)
class ConvertOptions:
    """How to convert."""

    model: Path | None = None
    """A model to put the values into; None for a snippet to paste."""
    joint_map: tuple[str, ...] = ()
    """RECORDED=MODEL pairs."""
    timestep: float | None = None
    """Physics step [s], for MuJoCo's solver settings; None for the model's own."""
    assumed_load: float | None = None
    """|F| + |T| on the joint [N + N m], for coefficients of the older PhysX."""

    def check(self, to: Target) -> None:
        """Raise `StictionError` for numbers without meaning, and for options that the target would ignore."""
        for name in ("timestep", "assumed_load"):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and value > 0):
                raise StictionError(f"{name} {value}: expected a positive number")
        needed = {"timestep": ("mujoco",), "assumed_load": ("isaaclab",), "model": ("mujoco", "urdf", "webots")}
        for name, targets in needed.items():
            if getattr(self, name) is not None and to not in targets:
                raise StictionError(f"--{name.replace('_', '-')} is for --to {', '.join(targets)}; leave it out")
        wild = [pair for pair in self.joint_map if set("*?[") & set(pair)]
        if wild and self.model is None and to != "isaaclab":
            raise StictionError(f"--joint-map {wild[0]!r}: wildcards need a --model whose joints they can match")


def convert(file: JointsFile, to: Target, options: ConvertOptions | None = None) -> Conversion:
    """Return a `joints.json` in the form that a simulator reads.

    Raises `StictionError` for a model that cannot be read or does not fit, and for records that hold nothing.
    """
    options = options or ConvertOptions()
    options.check(to)
    pairs = parse_joint_map(options.joint_map)
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
