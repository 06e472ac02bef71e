"""`stiction identify`: find the inertia and friction of a robot's joints from a log, with intervals."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from rich.console import Console

from stiction.cli.identified import show, show_limb, show_walk
from stiction.core.effects import excludes, flag_of, needs
from stiction.core.errors import ConfigurationError, LogError, RobotError, nearest
from stiction.core.flags import ARGUMENT, SETTING, flag
from stiction.core.memory import DEFAULT_LIMIT, limit_memory
from stiction.core.options import read_options, refuse
from stiction.core.records import part_of
from stiction.files.joints import JointsFile
from stiction.files.log import Log, LogSetup, sidecar_of
from stiction.files.plain import object_text
from stiction.files.run_log import is_walk_log
from stiction.files.settings import SETTINGS, check_settings, results_folder
from stiction.identification.limb.setup import LimbSetup
from stiction.identification.setup import IdentifySetup
from stiction.identification.walking.setup import RobotLogSetup, WalkSetup
from stiction.report.terminal import Terminal

if TYPE_CHECKING:
    from stiction.files.inputs import Inputs

DESCRIPTION = """Find the inertia, viscous and dry friction of joints from a log, with intervals; say if it matters, and
write joints.json, fit.npz, training.json and report.html.

The log is a table of text, NPZ, Parquet or JSON with columns time, position.<joint>, target.<joint>, torque.<joint>, or
others with a column mapping; the wide CSV of actuator-net scripts, LeRobot's, Unitree's and PlotJuggler's columns; a
bag of ROS (.mcap, .db3, .bag); PACE's .pt; MATLAB 5. Several logs are runs of the same joints and are fitted together.
With torque: inertia and friction in SI units. With positions and targets alone: what of them can be known, in units of
the motor's strength. Gains, torque limit and so on come from flags or from LOG.json beside the log, where each joint
may have its own; --init writes one to fill in. With --robot and a log in which all joints of a leg or an arm move,
its base held, they are found together, what each does to the others taken off by the robot's model. A walking log
(stiction evaluate --log) has options of its own, --robot, --mass-known and more: `stiction identify walk --help` lists
them. A walk whose joints and IMU are in columns of any name is read by `stiction identify walk LOG --robot FILE`.
Exit status 0 where results were written, those of a fit that is not valid too, which say so; 1 where none could be.

Examples:
  stiction identify log.csv --kp 30 --kd 0.5 --torque-limit 12 --test-condition in_air
  stiction identify log.csv --columns time=t position=q_{joint} target=des_{joint} torque=tau_{joint}
  stiction identify log.csv --init
  stiction identify leg.csv --robot robot.urdf
  stiction identify walk walk.csv --robot robot.xml"""

USUAL = ("--robot", "--kp", "--kd", "--torque-limit", "--torque-source", "--out", "--json")
ODD = ("--columns", "--names", "--torque-scale", "--position-scale", "--time-scale", "--rate", "--from", "--to")

GROUPS = {
    "usually needed": (*USUAL, "--test-condition", "--joint"),
    "odd logs": ("--init", *ODD, "--torque-column", "--join", "--repeat", "--held-out", "--axis"),
}
"""The options that people use."""

WALK_DESCRIPTION = """Find the friction of a walking robot's joints in its log: unloaded friction from legs in swing,
and what load adds to it from the body in stance, where the robot's masses are declared known. The log is one of
evaluate --log, or has columns of its own; then name the robot, and have an IMU beside the joints, 200 Hz or more. Base
position and velocity are not needed, and of load nothing is told then. Writes joints.json, fit.npz, training.json and
report.html.

Examples:
  stiction identify walk walk.csv --robot robot.xml --torque-source motor_side
  stiction identify walk stiction-deploy/log
  stiction identify walk logs/walk.npz --mass-known"""

WALK_GROUPS = {"usually needed": (*USUAL, "--mass-known"), "odd logs": (*ODD, "--joint-map")}
"""The options for walks that people use."""

WALK = "walk"
"""The word before a log that is one of a walk, in whatever form."""

PLAIN_WIDTH = 120
"""Columns of a table where nobody says how wide the terminal is."""

COUPLED = (
    "several joints were identified, each as if the others stood still: if they moved at once and are of one leg or "
    "arm, --robot FILE takes off what each does to the others"
)
"""What is said of a log with several joints and no robot."""

DECLARED = ("kp", "kd", "torque_limit", "torque_source", "torque_scale", "position_scale")
"""What may be declared of the motors in the log of a walk."""

RESULTS = ("joints.json", "fit.npz", "training.json", "report.html", SETTINGS)
"""What is written into --out."""


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """How a log is read that is not in our own form."""

    names: tuple[str, ...] = ()
    """Names of the joints, in order, for a log that only numbers them."""
    columns: tuple[str, ...] = ()
    """ROLE=NAME pairs for logs with other column names; roles: time, position, velocity, target, torque, disturbance
    (torque from outside), feedforward (torque that the controller adds, and that a torque column has in it already);
    position=q_{joint} or position=1,2,3 for several joints; state=TOPIC command=TOPIC for bags;
    of a walk also quaternion, gyroscope, accelerometer and foot_force, as quaternion=W,X,Y,Z, and imu=TOPIC."""
    time_scale: float | None = None
    """Seconds per unit of the time stamps, 1e-3 for milliseconds; by default found from them, and said."""
    begin: Annotated[float | None, flag("--from")] = None
    """Where to begin in the log, from its first stamp [s]."""
    end: Annotated[float | None, flag("--to")] = None
    """Where to end in the log, from its first stamp [s]."""
    rate: float | None = None
    """Samples per second of a log without time stamps [Hz]."""
    sidecar: Path | None = None
    """A sidecar that does not lie beside the log as LOG.json: gains, limits and so on, for all joints and for each."""

    def open(self, path: Path, joint: str | None = None, body: bool = False) -> Log:
        """Open a log. joint: name of the joint of a log without names; body: signals of the body are read, too."""
        from stiction.identification.logs import open_log, parse_columns

        columns, ends = parse_columns(self.columns), (self.begin, self.end)
        return open_log(path, columns, joint, self.names, self.rate, self.sidecar, self.time_scale, *ends, body=body)


@dataclass(frozen=True, kw_only=True)
class WriteOptions:
    """Where results go, and what reading and fitting may take."""

    out: Path = Path("identified")
    """Folder for joints.json, fit.npz, training.json and report.html."""
    overwrite: bool = False
    """Write over results in --out that are of other settings, or nobody knows of what."""
    json: bool = False
    """Print the machine-readable summary, and nothing else, on standard output."""
    page: Annotated[bool, SETTING] = True
    """Write report.html, which takes a second of drawing."""
    memory_limit: float = DEFAULT_LIMIT / 2**30
    """Memory that reading and fitting may take beyond the program's own [GiB]; a table may take a quarter of it."""


@dataclass(frozen=True, kw_only=True)
class IdentifyConfig(WriteOptions, ReadOptions, IdentifySetup, LimbSetup):
    """Options of the verb; those of `LimbSetup` count with --robot."""

    log: Annotated[tuple[Path, ...], ARGUMENT]
    """The log: .csv, .tsv, .txt (.gz), .npz, .parquet, .json, .jsonl, .mcap, .db3, .bag, .pt or .mat; or several
    runs of the same joints, which are fitted together."""
    join: bool = False
    """The logs are the parts of one log, in their order, not runs."""
    init: bool = field(
        default=False,
        metadata=excludes(but=("--joint", "--memory-limit", *(flag_of(item.name) for item in fields(LogSetup)))),
    )
    """Write the sidecar to fill in, with what the other flags say and what can be guessed from the log, and identify
    nothing."""
    joint: tuple[str, ...] = ()
    """Joints to identify, every one of the log's by default; the name to give the joint of a log without names."""
    robot: str | None = None
    """The robot whose leg or arm moves in the log, its base held: a MuJoCo or URDF file, a robot.yaml, or the name of a
    shipped one. All joints are then identified together, with the links' torques from the model."""
    repeat: tuple[Path, ...] = ()
    """Further logs of the same joints: repeats, hot and cold, with and without a payload. Each may have a sidecar."""
    held_out: Path | None = None
    """A log of the same joints that is predicted and not fitted, with a sidecar of its own; by default the last part of
    the log is."""
    repeat_columns: Annotated[tuple[str, ...], SETTING] = field(default=(), metadata=needs("--repeat"))
    """ROLE=NAME pairs that the repeats have and the log has not: disturbance=pulses, say."""


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
    """Where torque was measured: motor_side is current or command, output_side a sensor behind the gear."""
    torque_scale: float | None = None
    """N m per unit of the torque column."""
    position_scale: float | None = None
    """rad per unit of position, velocity and target."""


def main(arguments: list[str]) -> int:
    """Run the verb; return the exit status."""
    if arguments[:1] == [WALK]:
        return _identify_walk(arguments[1:])
    if any(is_walk_log(Path(text)) for text in arguments if not text.startswith("-")):
        return _identify_walk(arguments)
    config = read_options(IdentifyConfig, arguments, "stiction identify", DESCRIPTION, groups=GROUPS)
    # A misspelt `walk` would be taken for the name of a log.
    first = "".join(map(str, config.log[:1]))
    if "." not in first and (meant := nearest(first, [WALK])) and not Path(first).exists():
        refuse("stiction identify", f"no log at {first}{meant}")
    with limit_memory(memory_of(config.memory_limit)):
        return _identify_joints(config, shlex.join(["stiction", "identify", *arguments]))


def _identify_joints(config: IdentifyConfig, command: str) -> int:
    """Identify the joints of one log or of several, or of a whole limb; return the exit status. command: as typed."""
    from stiction.api.identification import identify_joints, identify_limb
    from stiction.identification.logs import join_logs
    from stiction.report.terminal import work_progress

    if not config.log:
        refuse("stiction identify", "no log given; expected one, or several runs of the same joints")
    if config.init:
        print(_start_sidecar(config))
        return 0
    held_out = [] if config.held_out is None else [config.held_out]
    for log in (*config.log, *config.repeat, *held_out):
        _keep_inputs(log, config.out)
    # Before anything is read: a folder of other results is refused at once, not after minutes of fitting.
    check_settings(config.out, _verb(config), config, RESULTS, _inputs(config))
    setup = part_of(IdentifySetup, config)
    joint = config.joint[0] if len(config.joint) == 1 else None
    first, *more = [config.open(path, joint) for path in config.log]
    if config.join:
        first, more = join_logs([first, *more]), []
    repeats = [_open_repeat(config, path, joint) for path in config.repeat]
    unseen = [_open_repeat(config, path, joint) for path in held_out]
    if config.robot is None:
        with work_progress() as progress:
            held = next(iter(unseen), None)
            found = identify_joints(first, setup, config.joint, repeats, more, progress=progress, held_out=held)
    else:
        limb = part_of(LimbSetup, config)
        with Terminal(stderr=True).status("fitting all joints at once"):
            found = identify_limb(first, config.robot, setup, limb, config.joint, [*repeats, *unseen], more)
    with results_folder(config.out, _verb(config), config, RESULTS, _inputs(config)):
        found.write(config.out, command, config.page)
    if config.robot is not None:
        _print_results(config, found.file, partial(show_limb, model_error=config.model_error))
        return _status(found.file)
    _print_results(config, found.file, show)
    if len(found.signals) > 1 and setup.test_condition != "bare_motor":
        Terminal(stderr=True).print(COUPLED, highlight=False, soft_wrap=True)
    return _status(found.file)


def _status(joints: JointsFile) -> int:
    """Return the exit status: 1 where the fit of a joint is not valid."""
    return int(any(record.objection_to("inertia") is not None for record in joints.joints.values()))


def _start_sidecar(config: IdentifyConfig) -> str:
    """Write the sidecar of a log, with what was declared; return what was guessed."""
    from stiction.identification.logs import parse_columns
    from stiction.identification.logs.sidecar import write_sidecar

    kept = {item.name for item in fields(LogSetup)} & {item.name for item in fields(IdentifyConfig)}
    if len(config.log) > 1:
        raise ConfigurationError(f"--init with {len(config.log)} logs; expected one: each has a sidecar of its own")
    if len(config.joint) > 1:
        raise ConfigurationError("--init writes the sidecar of all joints of a log; leave --joint out")
    part_of(IdentifySetup, config).check()
    declared: dict[str, Any] = {name: getattr(config, name) for name in kept}
    declared["columns"] = parse_columns(config.columns)
    return write_sidecar(config.log[0], LogSetup(**declared), *config.joint)


def _open_repeat(config: IdentifyConfig, path: Path, joint: str | None) -> Log:
    """Open a repeat or a held-out log, which is whole, and has a sidecar of its own."""
    from stiction.identification.logs import parse_columns

    columns = parse_columns(config.columns) | parse_columns(config.repeat_columns)
    words = tuple(f"{role}={name}" for role, name in columns.items())
    try:
        return replace(config, columns=words, sidecar=None, begin=None, end=None).open(path, joint)
    except LogError as error:
        raise LogError(f"{path.name} cannot be compared, leave it out or mend it: {error}") from error


def memory_of(limit: float) -> int:
    """Return a limit in bytes; raise `ConfigurationError` for one that nothing fits into, or that is no number."""
    if not 0.125 <= limit <= 1e6:
        raise ConfigurationError(f"memory limit {limit} GiB: expected at least 0.125")
    return round(limit * 2**30)


def _identify_walk(arguments: list[str]) -> int:
    """Identify the log of a walk; return the exit status."""
    options = read_options(WalkOptions, arguments, "stiction identify walk", WALK_DESCRIPTION, groups=WALK_GROUPS)
    from stiction.files.run_log import read_walk_log
    from stiction.files.walk import write_walk_fit
    from stiction.identification.proposal import write_proposal
    from stiction.identification.walking.foreign import foreign_walk
    from stiction.identification.walking.pipeline import identify_walk
    from stiction.identification.walking.walk import Walk
    from stiction.report.walking import write_walking_page
    from stiction.robots.catalog import find_robot

    _keep_inputs(options.log, options.out)
    # As above, before anything is read.
    check_settings(options.out, _verb(options), options, RESULTS, _inputs(options))
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
        found = identify_walk(walk)
        with results_folder(options.out, _verb(options), options, RESULTS, _inputs(options)):
            found.joints.write(options.out / "joints.json")
            write_proposal(options.out, found.joints)
            write_walk_fit(options.out / "fit.npz", found.fit)
            if options.page:
                write_walking_page(options.out, shlex.join(["stiction", "identify", WALK, *arguments]))
    _print_results(options, found.joints, show_walk)
    return _status(found.joints)


def _refuse_declared(options: WalkOptions) -> None:
    """Refuse what a log of our own form says itself."""
    names = [item.name for part in (ReadOptions, RobotLogSetup) for item in fields(part)] + list(DECLARED)
    for name in names:
        if getattr(options, name) not in (None, ()):
            raise ConfigurationError(
                f"{flag_of(name)} with {options.log.name}, a log of evaluate --log, which says that itself: "
                "leave it out"
            )


def _verb(options: IdentifyConfig | WalkOptions) -> str:
    """Return the words that the options are of."""
    return f"identify {WALK}" if isinstance(options, WalkOptions) else "identify"


def _inputs(options: IdentifyConfig | WalkOptions) -> Inputs:
    """Return what is read; a sidecar that is named stands in for that of a log, and not for those of repeats."""
    from stiction.files.inputs import with_sidecars

    logs = [options.log] if isinstance(options, WalkOptions) else [*options.log]
    repeats = () if isinstance(options, WalkOptions) else options.repeat
    return {
        "log": with_sidecars(logs) if options.sidecar is None else logs,
        "sidecar": options.sidecar,
        "repeat": with_sidecars(repeats),
        "held_out": []
        if isinstance(options, WalkOptions) or options.held_out is None
        else with_sidecars([options.held_out]),
        "robot": options.robot,
    }


def _keep_inputs(log: Path, out: Path) -> None:
    """Refuse a folder in which a result would overwrite the log, or be taken for its sidecar by the next run."""
    # Not `Path.resolve`, which raises where a link leads to itself.
    real = Path(os.path.realpath(log))
    inputs = (real, sidecar_of(real))
    for name in RESULTS:
        if (out / name).resolve() in inputs:
            raise ConfigurationError(
                f"--out {out} would put {name} where {log.name} has itself or its sidecar; choose another --out"
            )


def _print_results(
    options: WriteOptions, joints: JointsFile, show: Callable[[Console, JointsFile, Path], None]
) -> None:
    """Print what was found: as JSON, or as `show` does for a person, of a file in a folder."""
    if options.json:
        print(object_text(joints.to_dict()), end="")
        return
    terminal = Terminal()
    show(terminal if terminal.is_terminal else Terminal(width=PLAIN_WIDTH), joints, options.out)
    if options.page:
        Terminal(stderr=True).print(f"page: {options.out / 'report.html'}", highlight=False, soft_wrap=True)
