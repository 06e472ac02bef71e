"""Clips of the comparison: every method in the simulator of the training, and beside it on a virtual robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from stiction.report.page import Section, file_uri, paragraph, picture, row

CLIPS_TITLE = "How it looks: 0.5 m/s commanded, 20 % friction"

CLIPS_NOTE = (
    "Left: the robot of the data sheet in MuJoCo, the simulator of the training. Right: a virtual robot in PhysX, with "
    "joints, delays and sensors of its own; its motion is shown in the same renderer. A clip is one walk of one "
    "policy: what counts is in the tables."
)

ALONE = (
    "The robot of the data sheet in MuJoCo, the simulator of the training: these clips do not show transfer. Those on "
    "the virtual robot need PhysX, `pip install 'stiction[engines]'`."
)


@dataclass(frozen=True)
class ClipPair:
    """Animated images of one policy."""

    method: str
    """Training method."""
    policy: str
    """Name of the bundle."""
    trained: Path
    """In the simulator of the training."""
    robot: Path | None
    """On a virtual robot; None where that could not be had."""


def clip_sections(clips: Sequence[ClipPair]) -> list[Section]:
    """Return the section with the clips; none where there are none."""
    if not clips:
        return []
    rows = [row(*_pictures(clip)) for clip in clips]
    note = CLIPS_NOTE if any(clip.robot for clip in clips) else ALONE
    return [Section(CLIPS_TITLE, (paragraph(note), *rows))]


def _pictures(clip: ClipPair) -> list[Markup]:
    """Return the images of one policy."""
    named = f"{clip.method} ({clip.policy})"
    shown = [picture(file_uri(clip.trained), f"{named}: MuJoCo, the simulator of the training")]
    return shown + ([picture(file_uri(clip.robot), f"{named}: virtual robot, PhysX")] if clip.robot else [])
