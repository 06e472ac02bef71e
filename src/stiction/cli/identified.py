"""What `stiction identify` has for joints, limbs and walks alike: options, inputs, and how results are printed."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.console import Console
from rich.table import Table

from stiction.core.errors import ConfigurationError
from stiction.core.flags import SETTING, flag
from stiction.core.memory import DEFAULT_LIMIT
from stiction.files.joints import PARAMETERS, JointRecord, JointsFile
from stiction.files.log import Log, sidecar_of
from stiction.files.plain import object_text
from stiction.files.settings import SETTINGS
from stiction.report.joints import (
    EXTRA,
    VALUE_CAPTION,
    VALUE_COLUMNS,
    contact_line,
    grouped_warnings,
    in_degrees,
    joint_columns,
    joint_row,
    lead_lines,
    number,
    own_warnings,
    remaining_warnings,
    unit,
    value_rows,
)
from stiction.report.terminal import Terminal

if TYPE_CHECKING:
    from stiction.files.inputs import Inputs

USUAL = ("--robot", "--kp", "--kd", "--torque-limit", "--torque-source", "--out", "--json")
ODD = ("--columns", "--names", "--torque-scale", "--position-scale", "--time-scale", "--rate", "--from", "--to")

PLAIN_WIDTH = 120
"""Width of a table, in columns, where the terminal's width is unknown."""

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


def log_inputs(options: ReadOptions, logs: Sequence[Path]) -> Inputs:
    """Return logs as inputs, with their sidecars, in whose place one that is named stands."""
    from stiction.files.inputs import with_sidecars

    return {"log": with_sidecars(logs) if options.sidecar is None else logs, "sidecar": options.sidecar}


def status_of(joints: JointsFile) -> int:
    """Return the exit status: 1 where the fit of a joint is not valid."""
    return int(any(record.objection_to("inertia") is not None for record in joints.joints.values()))


def memory_of(limit: float) -> int:
    """Return a limit in bytes; raise `ConfigurationError` for one that nothing fits into, or that is no number."""
    if not 0.125 <= limit <= 1e6:
        raise ConfigurationError(f"memory limit {limit} GiB: expected at least 0.125")
    return round(limit * 2**30)


def keep_inputs(log: Path, out: Path) -> None:
    """Refuse a folder in which a result would overwrite the log, or be taken for its sidecar by the next run."""
    # Not `Path.resolve`, which raises where a link leads to itself.
    real = Path(os.path.realpath(log))
    inputs = (real, sidecar_of(real))
    for name in RESULTS:
        if (out / name).resolve() in inputs:
            raise ConfigurationError(
                f"--out {out} would put {name} where {log.name} has itself or its sidecar; choose another --out"
            )


def print_results(options: WriteOptions, joints: JointsFile, show: Callable[[Console, JointsFile, Path], None]) -> None:
    """Print what was found: as JSON, or as `show` does for a person, of a file in a folder."""
    if options.json:
        print(object_text(joints.to_dict()), end="")
        return
    terminal = Terminal()
    show(terminal if terminal.is_terminal else Terminal(width=PLAIN_WIDTH), joints, options.out)
    if options.page:
        Terminal(stderr=True).print(f"page: {options.out / 'report.html'}", highlight=False, soft_wrap=True)


def show(console: Console, joints: JointsFile, folder: Path) -> None:
    """Print for a person what was found, and lies in a folder: the verdict in three lines, numbers, and warnings."""
    from stiction.identification.findings import repeat_lines
    from stiction.identification.held_out import prediction_text, predictions_text

    found = {name: record for name, record in joints.joints.items() if record.diagnostics}
    for line in lead_lines(joints, folder):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    if len(found) == 1:
        for name, record in found.items():
            console.print(_one(name, record))
            if record.friction_law and record.friction_law["law"] not in (None, "coulomb"):
                console.print(_law(record))
            console.print(record.friction_law["text"] if record.friction_law else "", highlight=False, soft_wrap=True)
    elif found:
        console.print(_several(found))
    for name, record in found.items():
        for line in repeat_lines(record):
            console.print(f"{name}: {line}", highlight=False, markup=False, soft_wrap=True)
        if len(found) == 1 and (held := record.diagnostics.get("held_out")) is not None:
            line = f"{name}: {held['source']}, held out: {prediction_text(held, record.axis)}"
            console.print(line, highlight=False, markup=False, soft_wrap=True)
    if len(found) > 1 and (line := predictions_text(found)):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    for text in remaining_warnings(joints):
        console.print(f"warning: {text}", highlight=False, markup=False, soft_wrap=True)
    own = own_warnings(joints)
    if len(found) == 1:
        for name, text in own:
            console.print(f"warning: {name}: {text}", highlight=False, markup=False, soft_wrap=True)
    elif own:
        console.print(f"warning: {len(own)} more about single joints: see the page, joint by joint", soft_wrap=True)


def _one(name: str, record: JointRecord) -> Table:
    """Tabulate one joint: values, combinations where parameters are not known, the symmetric fit beside a law."""
    symmetric = (record.friction_law or {}).get("symmetric") or {}
    title = f"{name}: NOT VALID, see above" if record.objections else name
    table = Table("", "unit", "value", "95 % interval", *(["symmetric"] if symmetric else []), title=title)
    for quantity in (*PARAMETERS, *EXTRA, "friction_ratio", "dynamic_ratio", "dead_band"):
        estimate = getattr(record, quantity)
        if estimate is None:
            if quantity in (*PARAMETERS, "friction_ratio", "dead_band"):
                table.add_row(quantity, unit(record, quantity), "not known")
            continue
        second = [number(symmetric[quantity]["value"])] if quantity in symmetric else []
        table.add_row(quantity, unit(record, quantity), number(estimate.value), _interval(estimate.interval95), *second)
        if (degrees := in_degrees(record, quantity)) is not None:
            table.add_row("", "°", number(degrees.value), _interval(degrees.interval95))
    for label, estimate in record.combinations.items():
        table.add_row(label, "", number(estimate.value), _interval(estimate.interval95))
    return table


def _interval(ends: Sequence[float]) -> str:
    """Return both ends of an interval."""
    return " to ".join(map(number, ends))


def _law(record: JointRecord) -> Table:
    """Tabulate the law that was chosen."""
    law = record.friction_law or {}
    table = Table("", "unit", "value", "95 % interval", title=f"{law['law']} law")
    over = "/k" if law["over_strength"] else ""
    for name, data in law["parameters"].items():
        table.add_row(name, unit(record, name) + over, number(data["value"]), _interval(data["interval95"]))
    return table


def _several(found: dict[str, JointRecord]) -> Table:
    """Tabulate several joints, a row each; what is known over k only carries it in its heading."""
    table = Table("joint", *joint_columns(found))
    for name, record in found.items():
        table.add_row(name, *joint_row(record))
        if record.coulomb_friction is None:
            damped = "; viscous includes the controller's kd: (B + k·kd)/k" if record.torque_source is None else ""
            table.caption = f"in units of the motor strength k{damped}"
    return table


def show_limb(console: Console, joints: JointsFile, folder: Path, model_error: float) -> None:
    """Print what was found in the log of a limb, and what was taken to be known of its links, for a person."""
    show(console, joints, folder)
    console.print(
        f"inertia is the rotor's (armature), behind the links of the model; each link's mass, inertia and centre were "
        f"admitted to be off by {model_error:.0%}, one standard deviation (--model-error)",
        highlight=False,
        soft_wrap=True,
    )


def show_walk(console: Console, joints: JointsFile, folder: Path) -> None:
    """Print what was found in a walk, and the warnings, for a person."""
    table = Table("", *VALUE_COLUMNS, caption=VALUE_CAPTION)
    for line in lead_lines(joints, folder):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    for row in value_rows(joints):
        table.add_row(*row)
    console.print(table)
    console.print(contact_line(joints), highlight=False, soft_wrap=True)
    for text in grouped_warnings(joints):
        console.print(f"warning: {text}", highlight=False, soft_wrap=True)
