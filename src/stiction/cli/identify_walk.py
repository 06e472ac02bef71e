"""`stiction identify walk`: find the friction of a walking robot's joints from its log."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from stiction.cli.identified import (
    ODD,
    RESULTS,
    USUAL,
    ReadOptions,
    WriteOptions,
    keep_inputs,
    log_inputs,
    memory_of,
    print_results,
    status_of,
)
from stiction.core.effects import flag_of
from stiction.core.errors import ConfigurationError, RobotError
from stiction.core.flags import ARGUMENT
from stiction.core.memory import limit_memory
from stiction.core.options import read_options
from stiction.core.records import part_of
from stiction.files.run_log import is_walk_log
from stiction.files.settings import check_settings, results_folder
from stiction.identification.setup import IdentifySetup
from stiction.identification.walking.setup import RobotLogSetup, WalkSetup
from stiction.report.terminal import Terminal

if TYPE_CHECKING:
    from stiction.files.inputs import Inputs

VERB = "identify walk"
"""Words that the options are of."""

DESCRIPTION = """Find the friction of a walking robot's joints in its log: unloaded friction from legs in swing,
and what load adds to it from the body in stance, where the robot's masses are declared known. The log is one of
evaluate --log, or has columns of its own; then name the robot, and have an IMU beside the joints, 200 Hz or more. Base
position and velocity are not needed, and of load nothing is told then. Writes joints.json, fit.npz, training.json and
report.html.

Examples:
  stiction identify walk walk.csv --robot robot.xml --torque-source motor_side
  stiction identify walk stiction-deploy/log
  stiction identify walk logs/walk.npz --mass-known"""

GROUPS = {"usually needed": (*USUAL, "--mass-known"), "odd logs": (*ODD, "--joint-map")}
"""The options for walks that people use."""

DECLARED = ("kp", "kd", "torque_limit", "torque_source", "torque_scale", "position_scale")
"""Settings of the motors that may be declared for the log of a walk."""


@dataclass(frozen=True, kw_only=True)
class WalkOptions(WriteOptions, ReadOptions, WalkSetup, RobotLogSetup):
    """Options for the log of a walk; those on columns, time and motors are for logs that are not of evaluate --log."""

    log: Annotated[Path, ARGUMENT]
    """The log: of evaluate --log, or one with columns of its own, of any kind that identify reads."""
    robot: str | None = None
    """The robot, with its masses and link lengths: a MuJoCo or URDF file, a robot.yaml, or the name of a shipped one;
    by default the shipped one that a log of evaluate --log names."""
    kp: float | None = None
    """Proportional gain of the joint controllers during the walk [N m/rad]; the sidecar can say it joint by joint."""
    kd: float | None = None
    """Derivative gain [N m s/rad]."""
    torque_limit: float | None = None
    """Largest torque of the motors [N m]; by default the robot's."""
    torque_source: Literal["motor_side", "output_side"] | None = None
    """Place of the torque measurement: motor_side is current or command, output_side a sensor behind the gear."""
    torque_scale: float | None = None
    """N m per unit of the torque column."""
    position_scale: float | None = None
    """rad per unit of position, velocity and target."""


def identify_walk(arguments: list[str]) -> int:
    """Identify the log of a walk; return the exit status."""
    options = read_options(WalkOptions, arguments, f"stiction {VERB}", DESCRIPTION, groups=GROUPS)
    from stiction.files.run_log import read_walk_log
    from stiction.files.walk import write_walk_fit
    from stiction.identification.verdict import write_proposal
    from stiction.identification.walking import pipeline
    from stiction.identification.walking.foreign import foreign_walk
    from stiction.identification.walking.walk import Walk
    from stiction.report.walking import write_walking_page
    from stiction.robots.catalog import find_robot

    keep_inputs(options.log, options.out)
    command = shlex.join(["stiction", *VERB.split(), *arguments])
    # As above, before anything is read.
    inputs: Inputs = {**log_inputs(options, [options.log]), "robot": options.robot}
    check_settings(options.out, VERB, options, RESULTS, inputs)
    setup = part_of(WalkSetup, options)
    with limit_memory(memory_of(options.memory_limit)), Terminal(stderr=True).status("reading, fitting"):
        if is_walk_log(options.log):
            _refuse_declared(options)
            recorded = read_walk_log(options.log)
            name = options.robot or recorded.header.robot
            if options.robot is None and not name.isidentifier():
                raise RobotError(f"the log is of the robot {name!r}, not a shipped one; name it: --robot")
            walk = Walk(recorded, find_robot(name), setup)
        else:
            log = options.open(options.log, body=True)
            if options.robot is None:
                raise RobotError(f"{log.source}: of which robot is this walk? Its masses and lengths: --robot FILE")
            declared = IdentifySetup(**{name: getattr(options, name) for name in DECLARED})
            walk = foreign_walk(log, find_robot(options.robot), declared, part_of(RobotLogSetup, options), setup)
        result = pipeline.identify_walk(walk)
        with results_folder(options.out, VERB, options, RESULTS, inputs):
            result.joints.write(options.out / "joints.json")
            write_proposal(options.out, result.joints)
            write_walk_fit(options.out / "fit.npz", result.fit)
            if options.page:
                write_walking_page(options.out, command)
    print_results(options, result.joints, command)
    return status_of(result.joints)


def _refuse_declared(options: WalkOptions) -> None:
    """Refuse what a log of our own form says itself."""
    names = [item.name for part in (ReadOptions, RobotLogSetup) for item in fields(part)] + list(DECLARED)
    for name in names:
        if getattr(options, name) not in (None, ()):
            raise ConfigurationError(
                f"{flag_of(name)} with {options.log.name}, a log of evaluate --log, which says that itself: "
                "leave it out"
            )
