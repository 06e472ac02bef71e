"""Clips of the comparison: some methods in the simulator of the training, and beside it on a virtual robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from stiction.evaluation.policies import BEHIND_GEAR, method_of
from stiction.files.bundle import Bundle
from stiction.report.page import Section, file_uri, paragraph, picture, row
from stiction.robots.model import Robot
from stiction.virtual.cases import FIRST_REPORTED

METHODS = ("none", BEHIND_GEAR, "actuator", "direct", "deception")
"""Training methods that are shown."""

LEVEL, COMMAND = 0.2, "vx=0.5"

TITLE = f"How it looks: {COMMAND.removeprefix('vx=')} m/s commanded, {100 * LEVEL:g} % friction"

NOTE = (
    "Left: the robot of the data sheet in MuJoCo, the simulator of the training. Right: a virtual robot in PhysX, with "
    "joints, delays and sensors of its own; its motion is shown in the same renderer. A clip is one walk of one "
    "policy: what counts is in the tables."
)

ALONE = (
    "The robot of the data sheet in MuJoCo, the simulator of the training: these clips do not show transfer. Those on "
    "the virtual robot need PhysX, which comes with the extra `engines`."
)


@dataclass(frozen=True)
class ClipPair:
    """Animated images of one policy."""

    method: str
    policy: str
    """Name of the bundle."""
    trained: Path
    """In the simulator of the training."""
    robot: Path | None
    """On a virtual robot; None where that could not be had."""


def render(
    bundles: Sequence[Bundle], folders: Mapping[str, Path], out: Path, spec: Robot, say: Callable[[str], None]
) -> list[ClipPair]:
    """Render clips of the first policy of each of `METHODS`; without OpenGL or PhysX say so once and go on.

    Args:
        bundles: the policies.
        folders: bundle -> its folder.
        out: for the clips.
        spec: their robot.
        say: prints a line.

    """
    from stiction.engines.catalog import what_is_missing
    from stiction.evaluation.clip import ClipError
    from stiction_experiments.replication.filmed import ENGINE, record_clip

    if why := what_is_missing(ENGINE, spec):
        say(f"no clips on the virtual robot: {why}")
    clips: list[ClipPair] = []
    for method in METHODS:
        name = next((b.name for b in bundles if method_of(b.contract) == method and b.contract.terrain == "flat"), None)
        if name is not None:
            asked = folders[name], LEVEL, COMMAND
            try:
                trained = record_clip(*asked, out / f"{name}.webp")
                robot = None if why else record_clip(*asked, out / f"{name}-robot.webp", robot=FIRST_REPORTED)
            except ClipError as error:
                say(str(error))
                return clips
            clips.append(ClipPair(method, name, trained, robot))
    return clips


def clip_sections(clips: Sequence[ClipPair]) -> list[Section]:
    """Return the section with the clips; none where there are none."""
    if not clips:
        return []
    blocks = [paragraph(NOTE if any(clip.robot for clip in clips) else ALONE)]
    for clip in clips:
        named = f"{clip.method} ({clip.policy})"
        shown = [picture(file_uri(clip.trained), f"{named}: MuJoCo, the simulator of the training")]
        if clip.robot:
            shown.append(picture(file_uri(clip.robot), f"{named}: virtual robot, PhysX"))
        blocks.append(row(*shown))
    return [Section(TITLE, tuple(blocks))]
