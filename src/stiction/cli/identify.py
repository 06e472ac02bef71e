"""`stiction identify`: find a joint's inertia and friction from a log, with intervals."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from stiction.formats.errors import StictionError
from stiction.formats.fit import write_fit
from stiction.formats.joints import PARAMETERS, JointRecord, JointsFile
from stiction.identify.setup import IdentifySetup

DESCRIPTION = """Find a joint's inertia, viscous and dry friction from a log with measured torque, say whether the
friction matters, and write joints.json, fit.npz and report.html.

The log is CSV or NPZ with columns time, position.<joint>, target.<joint>, torque.<joint>, or anything else (MATLAB 5
too) with a column mapping. Gains, torque limit and so on come from flags or from LOG.json beside the log."""


RESULTS = ("joints.json", "fit.npz", "report.html")
"""What is written into --out."""


@dataclass(frozen=True, kw_only=True)
class IdentifyConfig(IdentifySetup):
    """Options of the verb."""

    log: Annotated[Path, tyro.conf.Positional]
    """The log: .csv, .npz or .mat."""
    joint: str | None = None
    """Which joint of the log, and the name it gets; needed where there are several."""
    columns: tuple[str, ...] = ()
    """ROLE=NAME pairs for logs with other column names; roles: time, position, velocity, target, torque."""
    out: Path = Path("identified")
    """Folder for joints.json, fit.npz and report.html."""
    json: bool = False
    """Print the machine-readable summary, and nothing else, on standard output."""


def main(arguments: list[str]) -> int:
    """Run the verb; return the exit status."""
    config = tyro.cli(IdentifyConfig, args=arguments, prog="stiction identify", description=DESCRIPTION)
    from stiction.identify.pipeline import identify_joint
    from stiction.identify.logs import open_log, parse_columns

    _keep_inputs(config.log, config.out)
    console = Console(stderr=True)
    setup = IdentifySetup(**{item.name: getattr(config, item.name) for item in fields(IdentifySetup)})
    with console.status("reading, fitting, simulating"):
        log = open_log(config.log, parse_columns(config.columns), config.joint)
        result = identify_joint(log, config.joint, setup)
        joints = JointsFile({result.name: result.record})
        write_results(config.out, joints, {result.name: result.fit})
    if config.json:
        print(json.dumps(joints.to_dict(), indent=2, allow_nan=False, ensure_ascii=False))
    else:
        show(Console(), result.name, result.record)
        console.print(f"page: {config.out / 'report.html'}", highlight=False, soft_wrap=True)
    return 0


def _keep_inputs(log: Path, out: Path) -> None:
    """Refuse a folder in which a result would overwrite the log, or be taken for its sidecar by the next run."""
    inputs = (log.resolve(), log.resolve().with_suffix(".json"))
    for name in RESULTS:
        if (out / name).resolve() in inputs:
            raise StictionError(
                f"--out {out} would put {name} where {log.name} has itself or its sidecar; choose another --out"
            )


def write_results(folder: Path, joints: JointsFile, fits: dict) -> None:
    """Write `joints.json`, `fit.npz` and `report.html`; raise `StictionError` if the folder cannot be written."""
    from stiction.report.identification import write_identification_page

    try:
        folder.mkdir(parents=True, exist_ok=True)
        joints.write(folder / "joints.json")
        write_fit(folder / "fit.npz", fits)
        write_identification_page(folder)
    except OSError as error:
        raise StictionError(f"cannot write to {folder}: {error.strerror or error}; choose another --out") from error


def show(console: Console, name: str, record: JointRecord) -> None:
    """Print what both estimators found, the verdict and the warnings for a person."""
    from stiction.report.identification import unit

    other = record.diagnostics["output_error"] or {}
    table = Table("", "unit", "value", "95 % interval", "output error", title=name)
    for quantity in (*PARAMETERS, "friction_ratio", "dead_band"):
        estimate = getattr(record, quantity)
        if estimate is None:
            table.add_row(quantity, unit(record, quantity), "not known", "", "")
            continue
        second = f"{other[quantity]['value']:.5g}" if quantity in other else ""
        interval = "{:.5g} to {:.5g}".format(*estimate.interval95)
        table.add_row(quantity, unit(record, quantity), f"{estimate.value:.5g}", interval, second)
    console.print(table)
    console.print(record.diagnostics["verdict"]["text"], highlight=False)
    for text in record.warnings:
        console.print(f"warning: {text}", highlight=False, markup=False)
