"""The log that identification needs, designed before the robot is touched: `stiction excite` in Python."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from stiction.api.options import options_of, public
from stiction.api.result import Progress, Result, html_table, silent
from stiction.core.errors import ConfigurationError, RobotError, unknown_name
from stiction.core.records import header, texts
from stiction.files.design import ExcitationDesign, Predicted, percent
from stiction.files.log import Log, write_log
from stiction.files.plain import write_object
from stiction.files.tables import write_arrays
from stiction.identification.excite.plan import Excitation, design_excitation
from stiction.identification.excite.setup import ExciteSetup
from stiction.robots.model import Joint


@dataclass(frozen=True, repr=False)
class Designed(Result):
    """A motion to play back, and how well its log will show inertia and friction."""

    excitation: Excitation
    """The whole design."""

    @property
    def design(self) -> ExcitationDesign:
        """Content of `design.json`: gains, limits, speeds and angles reached, predicted deviations, advice."""
        return self.excitation.record

    @property
    def time(self) -> np.ndarray:
        """Instants of the trajectory [s], shape (T,)."""
        return self.excitation.trajectory.time

    @property
    def target(self) -> np.ndarray:
        """Position to ask the controller for at each of them [rad], shape (T,)."""
        return self.excitation.signals.target

    @property
    def trajectory(self) -> Log:
        """Trajectory as a log, with gains and limits, for `write_log`."""
        return self.excitation.trajectory

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings to read before the trajectory is played, one sentence each."""
        return self.design.warnings

    def simulate(self, seed: int = 0) -> Log:
        """Return the log that a joint as guessed would give, with noise of sensors like small geared actuators.

        For trying what follows before there is a robot. seed: of the noise.
        """
        from stiction.identification.example import Motor, Played, example_log
        from stiction.joints.friction import Coulomb
        from stiction.joints.pd import PDGains
        from stiction.joints.simulate import Joint as Simulated

        setup, gains = self.design.setup, self.design.gains
        joint = Simulated(setup["inertia"], setup["viscous"], Coulomb(setup["coulomb"]))
        motor = Motor(self.design.joint, joint, PDGains(gains["kp"], gains["kd"], self.design.limits["torque"]))
        log = example_log(motor, Played(self.time, self.target), seed=seed)
        return replace(log, joints={self.design.joint: log.joint(None)[1]})

    def lines(self) -> Sequence[str]:
        """Return how to run it, and what it will tell."""
        gains, design = self.design.gains, self.design
        return (
            f"{design.joint}: play {design.duration:g} s at {design.setup['rate']:g} Hz with kp {gains['kp']:g} and kd "
            f"{gains['kd']:g}",
            design.advice,
            f"largest relative deviation to expect, over the range of guesses: {percent(design.worst)}",
        )

    def to_dict(self) -> dict[str, Any]:
        """Return what `stiction excite --json` prints, and `design.json` holds."""
        return self.design.to_dict()

    def table(self) -> Markup:
        """Return what is predicted of each parameter."""
        return html_table(header(Predicted), map(texts, self.design.predicted))

    def write(self, folder: Path) -> None:
        """Write trajectory.csv with its sidecar, design.json, design.npz and report.html."""
        from stiction.report.excitation import write_excitation_page

        write_log(folder / "trajectory.csv", self.trajectory)
        write_arrays(folder / "design.npz", self.excitation.signals)
        write_object(folder / "design.json", self.to_dict())
        write_excitation_page(folder)


@public
def excite(
    *,
    robot: str | Path | None = None,
    joint: str = "joint",
    torque_limit: float | None = None,
    position_limits: tuple[float, float] | None = None,
    duration: float = 20.0,
    rate: float = 500.0,
    seed: int = 0,
    progress: Progress = silent,
    out: str | Path | None = None,
    **options: Any,
) -> Designed:
    """Design a motion of a joint, within its limits, whose log shows inertia and friction well.

    Args:
        robot: a shipped robot, a file, or `module:NAME`, which runs that module; its joint fills in gains and limits.
        joint: name of the joint, or its kind.
        torque_limit: largest torque of the motor, at the joint [N m].
        position_limits: lowest and highest angle [rad].
        duration: length of the log [s].
        rate: samples per second [Hz].
        seed: of the search.
        progress: called with the name of the work and the share of it that is done.
        out: folder for trajectory.csv, design.json, design.npz and report.html; by default nothing is written.
        options: every other field of `ExciteSetup`: `kp`, `kd`, `speed_limit`, `inertia`, ...; the flags of the verb.

    Raises `StictionError` where friction holds the joint, or no motion fits the limits.

    >>> import stiction
    >>> stiction.excite(robot="saturn_lite", joint="shnk")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    stiction.core.errors.RobotError: robot 'saturn_lite': unknown joint 'shnk'; did you mean 'shank'? known: ...

    """
    named = {"torque_limit": torque_limit, "position_limits": position_limits}
    setup = options_of(ExciteSetup, named | options | {"duration": duration, "rate": rate, "seed": seed}, excite)
    designed = design(setup, joint, None if robot is None else str(robot), "stiction.excite(...)", progress)
    if out is not None:
        designed.save(out)
    return designed


def design(setup: ExciteSetup, joint: str, robot: str | None, command: str, progress: Progress = silent) -> Designed:
    """Design the log of one joint; `command`: by which it was asked for, see `excite` for the rest."""
    if not joint.strip() or any(mark in joint for mark in ',"\r\n'):
        raise ConfigurationError(f"--joint {joint!r}: expected a name without commas, quotes and line breaks: FL_shank")
    filled = setup.filled(robot_joint(robot, joint) if robot else None)
    return Designed(design_excitation(filled, joint, command, progress))


def robot_joint(robot: str, joint: str) -> Joint:
    """Return a robot's joint by its name, or the first of a kind; raise `RobotError` if it has none such."""
    from stiction.robots.catalog import find_robot

    spec = find_robot(robot)
    for candidate in spec.joints:
        if joint in (candidate.name, candidate.kind):
            return candidate
    raise RobotError(f"robot {spec.name!r}: {unknown_name('joint', joint, (*spec.joint_kinds, *spec.joint_names))}")


__all__ = ["Designed", "design", "excite", "robot_joint"]
