"""Options, inputs and printed results that `stiction identify` shares among joints, limbs and walks."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.table import Table
from rich.text import Text

from stiction.core.errors import ConfigurationError, FileError
from stiction.core.flags import SETTING, flag
from stiction.core.memory import DEFAULT_LIMIT
from stiction.files.joints import JointsFile
from stiction.files.log import Log, sidecar_of
from stiction.files.plain import object_text
from stiction.files.settings import SETTINGS
from stiction.report.glance import STYLES, print_glance
from stiction.report.terminal import Terminal

if TYPE_CHECKING:
    from stiction.files.inputs import Inputs

USUAL = ("--robot", "--kp", "--kd", "--torque-limit", "--torque-source", "--out", "--json")
ODD = ("--columns", "--names", "--torque-scale", "--position-scale", "--time-scale", "--rate", "--from", "--to")

RESULTS = ("joints.json", "fit.npz", "training.json", "report.html", SETTINGS)
"""Files written into --out."""


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """Options for reading a log of another form than our own."""

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
    """Start of the part of the log to use, from its first stamp [s]."""
    end: Annotated[float | None, flag("--to")] = None
    """End of the part of the log to use, from its first stamp [s]."""
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
    """Output folder, and limits of reading and fitting."""

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


def print_results(options: WriteOptions, joints: JointsFile, command: str) -> None:
    """Print what was found: as JSON, or for a person at a glance. command: as typed."""
    if options.json:
        print(object_text(joints.to_dict()), end="")
        return
    from stiction.report.identified import glance_of

    if (glance := glance_of(joints, options.out, command, options.page)) is None:
        raise FileError(f"{options.out}: got joints without an answer, expected one each; report this")
    tables = [_several(joints)] if len(joints.joints) > 1 else []
    print_glance(Terminal(), glance, *tables)


def _several(joints: JointsFile) -> Table:
    """Tabulate several joints, the worst first."""
    from stiction.report.gauge import ANSWERS
    from stiction.report.identified import MOST_ROWS, UNKNOWN, glance_rows
    from stiction.report.joints import unit

    units = dict.fromkeys(unit(record, "coulomb_friction") for record in joints.joints.values())
    over = all(record.coulomb_friction is None for record in joints.joints.values() if record.diagnostics)
    heading = f"friction{'/k' if over else ''} [{' or '.join(units)}]"
    table = Table("joint", heading, "of limit", "dead band", "matters", box=None, pad_edge=False)
    rows = glance_rows(joints)
    for *cells, answer in rows[:MOST_ROWS]:
        table.add_row(*cells, Text(answer, STYLES[ANSWERS.get(answer, "unknown" if answer == UNKNOWN else "bad")]))
    if len(rows) > MOST_ROWS:
        table.add_row(f"and {len(rows) - MOST_ROWS} more", *[""] * 4)
    return table
