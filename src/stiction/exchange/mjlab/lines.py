"""Lines to add to a user's task in mjlab; they call `stiction.mjlab`, which warns of what it leaves out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from stiction.exchange.physics import Conversion, JointPhysics, Which, notes_of, one_line
from stiction.exchange.randomization import recipe_of

CAVEATS = "in mjlab's environment, where its cfg is made; docs/trainers.md says which value goes where"


def joints_lines(
    path: Path, joints: list[JointPhysics], pairs: Sequence[tuple[str, str]], which: Which = "moving"
) -> Conversion:
    """Return the lines that put a `joints.json` into an mjlab robot.

    path: of the file; joints: physics of its records; pairs: record and joint where their names differ; which: friction
    of MuJoCo's one number.
    """
    joint_map = tuple("=".join(pair) for pair in pairs)
    more = f", joint_map={joint_map!r}" if joint_map else ""
    text = _text("with_joints", f"with_joints(cfg, {path.as_posix()!r}{more}{_friction(which)})")
    return Conversion.of(text, joints, notes_of(joints, CAVEATS), [CAVEATS])


def training_lines(path: Path, training: dict[str, Any], which: Which = "moving") -> Conversion:
    """Return the lines that draw the range of a `training.json` in mjlab; raise `FileError` where it has none."""
    notes = [*recipe_of(training, {"robot": 1.0}, which).notes, CAVEATS]
    text = _text("friction_events", f"cfg.events |= friction_events({path.as_posix()!r}{_friction(which)})")
    return Conversion(text, {}, tuple(one_line(note) for note in notes), (CAVEATS,))


def _friction(which: Which) -> str:
    """Return the argument for friction at rest."""
    return ', friction="static"' if which == "static" else ""


def _text(name: str, line: str) -> str:
    """Return a script of an import, a line, and a comment on its place."""
    return f"# {CAVEATS}\nfrom stiction.mjlab import {name}\n\n{line}\n"
