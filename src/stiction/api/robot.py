"""Robots: shipped ones by name, your own from MJCF, URDF or `robot.yaml`, and the checks on them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from stiction.api.options import public
from stiction.api.result import Result, html_table
from stiction.robots.catalog import find_derived, find_robot, robot_names
from stiction.robots.model import Robot


@dataclass(frozen=True, repr=False)
class RobotCheck(Result):
    """Findings of the checks of a robot, usable if `ok`."""

    robot: Robot
    """The robot."""
    findings: tuple[Any, ...]
    """Findings, each with `check`, `state` (`good`, `note`, `bad`), `text`, and `mend`, the change that resolves it."""
    notes: tuple[str, ...] = ()
    """Parts of the file left out, corrected or not trusted on reading, one sentence each."""

    @property
    def bad(self) -> tuple[Any, ...]:
        """The findings to be mended before the robot is used."""
        return tuple(finding for finding in self.findings if finding.state == "bad")

    @property
    def ok(self) -> bool:
        """True if the robot can be used."""
        return not self.bad

    def __iter__(self) -> Iterator[Any]:
        """Iterate over the findings."""
        return iter(self.findings)

    def lines(self) -> Sequence[str]:
        """Return what it is, whether it can be used, and what to mend first."""
        robot = self.robot
        first = (
            f"{robot.name}: {robot.mass:.4g} kg, {robot.num_joints} joints, stands {robot.standing_height:.3g} m high"
        )
        if self.ok:
            noted = sum(finding.state == "note" for finding in self.findings) + len(self.notes)
            return first, f"It can be used; {noted} to be known"
        worst = self.bad[0]
        failures = f"fails {len(self.bad)} of {len(self.findings)} checks; first, {worst.check}: {worst.text}"
        return first, failures, f"What mends it: {worst.mend}"

    def to_dict(self) -> dict[str, Any]:
        """Return what `stiction robot check --json` prints."""
        content = {"robot": self.robot.name, "ok": self.ok, "notes": self.notes}
        return content | {"findings": [asdict(finding) for finding in self.findings]}

    def table(self) -> Markup:
        """Return a row a finding."""
        rows = [(one.check, one.state, one.text, one.mend if one.state != "good" else "") for one in self.findings]
        return html_table(
            ("check", "", "found", "what mends it"), [*rows, *(("file", "note", n, "") for n in self.notes)]
        )

    def write(self, folder: Path) -> None:
        """Write robot.png, robot.yaml (complete) and robot.xml, what is simulated."""
        write_model(self.robot, folder)


MODEL_FILES = ("robot.xml", "robot.yaml", "robot.png")
"""Files that `write_model` writes."""


def write_model(robot: Robot, folder: Path) -> None:
    """Write `MODEL_FILES` into a folder that exists."""
    from stiction.core.files import write_text
    from stiction.robots.description import complete_text
    from stiction.robots.mjcf import build
    from stiction.robots.picture import draw

    write_text(folder / "robot.xml", build(robot).to_xml())
    write_text(folder / "robot.yaml", complete_text(robot, "robot.xml"))
    draw(robot, folder / "robot.png")


def list_robots() -> list[str]:
    """Return the names of the robots that come with the package.

    >>> import stiction
    >>> "go1" in stiction.list_robots()
    True

    """
    return list(robot_names())


@public
def load_robot(robot: str | Path) -> Robot:
    """Return a robot: a shipped one by its name, or one's own from a file.

    robot: a name of `list_robots`; a MuJoCo (.xml) or URDF (.urdf) file; a `robot.yaml` beside one, or a `robot.json`;
    or `package.module:NAME`, which runs that module. A file names no code. It needs the extra `sim` for files.

    Raises `RobotError`: there is no such robot, or its file does not say enough, and what to say.

    >>> import stiction
    >>> robot = stiction.load_robot("go1")
    >>> robot.num_joints, robot.joint_names[0]
    (12, 'FR_hip_joint')
    >>> stiction.load_robot("go3")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    stiction.core.errors.RobotError: unknown robot 'go3'; did you mean 'go2'? known: ...

    """
    return find_robot(str(robot))


@public
def check_robot(robot: Robot | str | Path) -> RobotCheck:
    """Check a robot before it is trusted: masses, inertias, limits, motors, pose, feet, mirror, and that it stands.

    robot: what `load_robot` takes or returns. It needs the extra `sim`. Raises `RobotError` where it cannot be read;
    what the checks find is returned, not raised.

    >>> import stiction
    >>> stiction.check_robot("go1").ok
    True

    """
    from stiction.robots.check import check_robot as findings_of

    if isinstance(robot, Robot):
        return RobotCheck(robot, findings_of(robot))
    derived = find_derived(str(robot))
    return RobotCheck(derived.robot, findings_of(derived.robot), derived.notes)


__all__ = ["RobotCheck", "check_robot", "list_robots", "load_robot", "write_model"]
