"""`stiction identify`: find the inertia and friction of a robot's joints from a log, with intervals."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
from stiction.core.effects import excludes, flag_of, needs
from stiction.core.errors import ConfigurationError, LogError, nearest
from stiction.core.flags import ARGUMENT, SETTING
from stiction.core.memory import limit_memory
from stiction.core.options import read_options, refuse
from stiction.core.records import part_of
from stiction.files.log import Log, LogSetup
from stiction.files.settings import check_settings, results_folder
from stiction.identification.setup import IdentifySetup, LimbSetup
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
Exit status 1 where nothing could be written, or a fit is not valid, which its results say; else 0.

Examples:
  stiction identify log.csv --kp 30 --kd 0.5 --torque-limit 12 --test-condition in_air
  stiction identify log.csv --columns time=t position=q_{joint} target=des_{joint} torque=tau_{joint}
  stiction identify log.csv --init
  stiction identify leg.csv --robot robot.urdf
  stiction identify walk walk.csv --robot robot.xml"""

GROUPS = {
    "usually needed": (*USUAL, "--test-condition", "--joint"),
    "odd logs": ("--init", *ODD, "--torque-column", "--join", "--repeat", "--held-out", "--axis"),
}
"""The options that people use."""

WALK = "walk"
"""The word before a log that is one of a walk, in whatever form."""


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


def main(arguments: list[str]) -> int:
    """Run the verb; return the exit status."""
    named = arguments[:1] == [WALK]
    if named or any(_is_walk(Path(text)) for text in arguments if not text.startswith("-")):
        from stiction.cli.identify_walk import identify_walk

        return identify_walk(arguments[named:])
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
    from stiction.files.inputs import with_sidecars
    from stiction.identification.logs import join_logs, refuse_absent
    from stiction.report.terminal import work_progress

    if not config.log:
        refuse("stiction identify", "no log given; expected one, or several runs of the same joints")
    if config.init:
        print(_start_sidecar(config))
        return 0
    held_out = [] if config.held_out is None else [config.held_out]
    for log in (*config.log, *config.repeat, *held_out):
        if not log.is_dir():  # the log of a run
            refuse_absent(log)
        keep_inputs(log, config.out)
    # Before anything is read: a folder of other results is refused at once, not after minutes of fitting.
    inputs: Inputs = {
        **log_inputs(config, config.log),
        "repeat": with_sidecars(config.repeat),
        "held_out": with_sidecars(held_out),
        "robot": config.robot,
    }
    check_settings(config.out, "identify", config, RESULTS, inputs)
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
            result = identify_joints(first, setup, config.joint, repeats, more, progress=progress, held_out=held)
    else:
        limb = part_of(LimbSetup, config)
        with Terminal(stderr=True).status("fitting all joints at once"):
            result = identify_limb(first, config.robot, setup, limb, config.joint, [*repeats, *unseen], more)
    with results_folder(config.out, "identify", config, RESULTS, inputs):
        result.write(config.out, command, config.page)
    print_results(config, result.file, command)
    return status_of(result.file)


def _is_walk(path: Path) -> bool:
    """Return whether a path is a walking log by its looks: an archive, or the folder of a run."""
    if path.suffix != ".npz" and not path.is_dir():
        return False
    from stiction.files.run_log import is_walk_log

    return is_walk_log(path)


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
