"""The comparison of a day on a robot: runs of `stiction deploy` beside identified friction and predicted walks.

A day is a folder of conditions of friction, each a folder of results, `DAY/CONDITION/RESULT`: a run (`report.json` and
`log`), an identification (`joints.json`) or an evaluation (`results.csv`). The condition's name is all that is said of
it. What no program measures stands in `DAY/sheet.csv`, written by hand: how far the robot went.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice, product
from pathlib import Path
from statistics import mean, stdev
from typing import Any

import numpy as np

from stiction.core.decode import is_number
from stiction.core.errors import FileError
from stiction.core.files import read_bounded, write_text
from stiction.core.records import column, read_rows, write_rows
from stiction.files.bam import load_joints
from stiction.files.plain import read_object
from stiction.files.results import ResultRow
from stiction.files.run_log import LOG, RUN_STAGE, RunLog, read_run_log
from stiction.files.settings import SETTINGS
from stiction.files.velocity import AXES, Command, parse_command
from stiction.report.page import Section, bullets, paragraph, render_page, row_table

SHEET, TABLE, PAGE = "sheet.csv", "bench.csv", "bench.html"
"""Files of a day: written by hand, and made of it."""

MOST_FOLDERS = 1000
"""Largest number of results of a day."""

MOST_BYTES = 2**22
"""Largest size of a table of the day [B]."""

FEWEST = 3
"""Smallest number of walks of a cell whose spread says something."""

FAR = 0.05
"""Largest difference between the robot's time of a run and this computer's, over the latter [-]. A virtual robot on a
busy machine is slower, while its policy is not."""


@dataclass(frozen=True)
class SheetRow:
    """One line of the sheet: what the operator saw of a run."""

    run: str
    """Folder of the run, `CONDITION/RUN`."""
    distance: float | None = None
    """Distance that the base went along the command [m], against it negative."""
    seconds: float | None = None
    """Time for that distance [s]; None: the whole walk, of which the log knows the time."""
    robot: str = ""
    """Serial number of the robot."""
    note: str = ""
    """Whatever else should be known."""


@dataclass(frozen=True)
class Walk:
    """One armed run of a policy."""

    run: str
    condition: str
    policy: str
    digest: str
    """Digest of the policy's bundle."""
    command: Command
    reached: float | None
    """Velocity along the command over the commanded one [-]; None if it was stopped, not measured or not `counted`."""
    stop: str
    """Rule that stopped it; empty: it ended as asked."""
    jitter: float | None
    """As `joint_jitter` of results.csv [rad/s²], the encoders' noise in it; None where the policy never had the robot.
    """
    tracking: float | None
    """Root mean square of target less angle over joints and readings [rad]."""
    late: bool
    """True if the machine was quick enough and the policy came late all the same."""
    forward: dict[str, Any] | None
    """Friction fed forward, as in report.json; None: none, or a report older than this field."""
    pace: float
    """Time of the robot over that of this computer, from the first reading to the last [-]."""

    @property
    def name(self) -> str:
        """Policy, with the way in which friction was fed forward, as in results.csv: `none+measured`."""
        return self.policy + (f"+{self.forward['way']}" if self.forward else "")

    @property
    def counted(self) -> bool:
        """True if the robot's time was this computer's."""
        return abs(self.pace - 1.0) <= FAR


@dataclass(frozen=True)
class JointFriction:
    """One identified joint in one condition."""

    condition: str = field(metadata=column("condition", form=str))
    joint: str = field(metadata=column("joint", form=str))
    friction: float = field(metadata=column("dry friction", "N m"))
    low: float = field(metadata=column("from", "N m"))
    """Lower end of the interval of 95 % [N m]."""
    high: float = field(metadata=column("to", "N m"))


@dataclass(frozen=True)
class BenchRow:
    """One policy under one condition of friction and one command: what was measured, and what was predicted."""

    policy: str = field(metadata=column("policy", form=str))
    condition: str = field(metadata=column("friction", form=str))
    command: str = field(metadata=column("command", form=str))
    runs: int = field(metadata=column("runs"))
    measured: int = field(metadata=column("measured"))
    """Runs whose velocity is known."""
    reached: float | None = field(metadata=column("reached/told", form=".2f"))
    """Mean over the measured runs [-]."""
    spread: float | None = field(metadata=column("spread", form=".2f"))
    """Standard deviation between runs [-]; None of fewer than two."""
    predicted: float | None = field(metadata=column("predicted", form=".2f"))
    """Speed ratio of `stiction evaluate` in this condition's folder [-]."""
    stops: str = field(metadata=column("stops", form=str))
    """Rules that stopped runs, and how often: `tilt 2, torque 1`."""
    jitter: float | None = field(metadata=column("jitter", "rad/s²", ".0f"))
    tracking: float | None = field(metadata=column("target - angle", "rad", ".3f"))
    friction: float | None = field(metadata=column("identified", "N m"))
    """Mean dry friction of the condition's identified joints [N m]."""
    friction_low: float | None = field(metadata=column("from", "N m"))
    """Mean of the lower ends: as if all joints erred together [N m]."""
    friction_high: float | None = field(metadata=column("to", "N m"))


@dataclass(frozen=True)
class Day:
    """Content of a day's folder."""

    walks: tuple[Walk, ...]
    joints: tuple[JointFriction, ...]
    predicted: dict[tuple[str, str, str], float]
    """Condition, policy, command -> predicted speed ratio."""
    dry: tuple[str, ...]
    """Runs in which nothing was sent."""
    sheet: tuple[SheetRow, ...]


def read_day(folder: Path) -> Day:
    """Read a day's results.

    Raises `StictionError`: no run, too many results, a result that is damaged, or two policies of one name.
    """
    results = [*islice(folder.glob("*/*/"), MOST_FOLDERS + 1)]
    if len(results) > MOST_FOLDERS:
        raise FileError(f"{folder}: got more than {MOST_FOLDERS} results, expected those of one day; split it")
    lines = _table(folder / SHEET, SheetRow) if (folder / SHEET).exists() else []
    sheet = {row.run: row for row in lines}
    if len(sheet) < len(lines):
        raise FileError(f"{folder / SHEET}: got two lines of one run, expected one; remove the other")
    walks, joints, dry, evaluated = [], [], [], list[tuple[str, Path]]()
    for path in sorted(results):
        condition, run = path.parent.name, f"{path.parent.name}/{path.name}"
        if (path / "report.json").is_file():
            report = read_object(path / "report.json", "the report of stiction deploy")
            if report.get("armed") is False:
                dry.append(run)
            elif (walk := _walk(path, run, report, line := sheet.get(run, SheetRow(run)))) is not None:
                walks.append(walk)
                sheet[run] = line
        if (path / "joints.json").is_file():
            joints += _joints(condition, path / "joints.json")
        if (path / "results.csv").is_file():
            evaluated.append((condition, path))
    if not walks:
        raise FileError(f"{folder}: got no armed run of a policy, expected {folder}/CONDITION/RUN of stiction deploy")
    digests, names = {walk.policy: walk.digest for walk in walks}, {walk.name for walk in walks}
    fed: dict[tuple[str, str], Any] = {}
    for walk in walks:
        if walk.digest != digests[walk.policy]:
            raise FileError(f"{walk.run}: got another {walk.policy!r} than elsewhere, expected one; rename its bundle")
        if walk.forward != fed.setdefault((walk.condition, walk.name), walk.forward):
            raise FileError(f"{walk.run}: got other friction fed forward than before it, expected one in a condition")
    predicted = {}
    for condition, path in evaluated:
        for row in _predicted(path, digests, names):
            cell = condition, row.policy, row.command
            if cell in predicted:
                raise FileError(f"{path}: got a second prediction of {', '.join(cell)}, expected one friction level")
            if row.speed_ratio is not None:
                predicted[cell] = row.speed_ratio
    return Day(tuple(walks), tuple(joints), predicted, tuple(dry), tuple(sheet.values()))


def _table(path: Path, kind: type[Any]) -> list[Any]:
    """Return the rows of a bounded table."""
    read_bounded(path, f"a table of at most {MOST_BYTES} bytes", FileError, MOST_BYTES)
    return read_rows(path, kind)


def _walk(path: Path, run: str, report: dict[str, Any], sheet: SheetRow) -> Walk | None:
    """Return the walk of a run, None of a motion; raise `StictionError` where report and log do not fit."""
    log = read_run_log(path / LOG)
    if not log.header.policy:
        return None
    stop, fed = report.get("stop", ""), report.get("forward")
    named = isinstance(stop, dict) and isinstance(stop.get("rule"), str)
    known = (named or stop is None) and (fed is None or (isinstance(fed, dict) and isinstance(fed.get("way"), str)))
    if not known or (report.get("bundle"), report.get("digest")) != (log.header.policy, log.header.digest):
        raise FileError(f"{run}: got a report.json of another run than its log's, expected those of one run")
    ran = log.readings["stage"] == RUN_STAGE
    told = np.unique(np.round(log.readings["velocity_command"][ran if ran.any() else slice(None)], 4), axis=0)
    if len(told) != 1:
        raise FileError(f"{run}: got {len(told)} commands in one run, expected one; make a run for each")
    command = parse_command(",".join(f"{axis}={value:g}" for axis, value in zip(AXES, told[0], strict=True)))
    rule = stop["rule"] if isinstance(stop, dict) else ""
    late = report.get("lateness_judged") == "late"
    jitter, tracking = (None, None) if ran.sum() < 2 else _steadiness(log, ran)
    robot, here = (np.ptp(log.readings[clock]) for clock in ("robot_time", "time"))
    told_to = run, run.split("/")[0], log.header.policy, log.header.digest, command
    walk = Walk(*told_to, None, rule, jitter, tracking, late, fed, float(robot / here) if here > 0 else 1.0)
    if rule or ran.sum() < 2 or not walk.counted:
        return walk
    return replace(walk, reached=_reached(command, log, ran, report, sheet))


def _reached(command: Command, log: RunLog, ran: np.ndarray, report: dict[str, Any], sheet: SheetRow) -> float | None:
    """Return the velocity along the command over the commanded one [-]; None where nobody measured it.

    A turn is the gyroscope's. A distance is the sheet's, else what a virtual robot says of itself.
    """
    readings, direction = log.readings, command.direction
    if direction is None:
        return None
    if command.is_turn:
        return float(readings["angular_velocity"][ran, 2].mean() / command.velocity[2])
    distance, seconds = sheet.distance, sheet.seconds
    virtual = report.get("virtual")
    moved = virtual.get("moved") if isinstance(virtual, dict) else None
    if distance is None and isinstance(moved, list) and len(moved) == 2 and all(map(is_number, moved)):
        distance = float(np.dot(moved, direction[:2]))
    if distance is None:
        return None
    time = readings["robot_time"][ran]
    seconds = float(time[-1] - time[0]) if seconds is None else seconds
    if not seconds > 0:
        raise FileError(f"{sheet.run}: got a walk of {seconds:g} s, expected more than 0; mend {SHEET}")
    return distance / seconds / command.speed


def _steadiness(log: RunLog, ran: np.ndarray) -> tuple[float, float]:
    """Return jitter [rad/s²] and tracking [rad] of the readings in which the policy had the robot."""
    header, readings = log.header, log.readings
    every = max(1, round(header.control_period / header.period))
    change = np.diff(readings["velocity"][ran][::every], axis=0) / header.control_period
    error = (readings["target"] - readings["position"])[ran]
    return (float(np.sqrt(np.square(part).mean())) if part.size else 0.0 for part in (change, error))  # type: ignore[return-value]


def _joints(condition: str, path: Path) -> list[JointFriction]:
    """Return the joints that a joints.json gives dry friction [N m], without those that it objects to."""
    return [
        JointFriction(condition, name, estimate.value, *estimate.interval95)
        for name, record in load_joints(path).joints.items()
        if (estimate := record.coulomb_friction) is not None and not record.objections
    ]


def _predicted(path: Path, digests: dict[str, str], names: Collection[str]) -> list[ResultRow]:
    """Return the rows of an evaluation that are of the policies `names`; raise `FileError` where one is another."""
    if (path / SETTINGS).is_file():
        inputs = read_object(path / SETTINGS, "what `stiction evaluate` writes").get("inputs")
        known = [each for option in (inputs or {}).values() if isinstance(option, dict) for each in option.values()]
        for digest, _, policy in (str(each).partition("  ") for each in known):
            if digests.get(policy, digest) != digest:
                raise FileError(f"{path}: got another {policy!r} than the one that walked, expected one; evaluate that")
    return [row for row in _table(path / "results.csv", ResultRow) if row.policy in names]


def bench_rows(day: Day) -> list[BenchRow]:
    """Return a row for each policy, condition and command that was walked, in the order of their names."""
    cells: dict[tuple[str, str, str], list[Walk]] = {}
    for walk in sorted(day.walks, key=lambda walk: (walk.name, walk.command.label, walk.condition)):
        cells.setdefault((walk.name, walk.condition, walk.command.label), []).append(walk)
    rows = []
    for (policy, condition, command), walks in cells.items():
        known = [walk.reached for walk in walks if walk.reached is not None]
        rules = [walk.stop for walk in walks if walk.stop]
        joints = [joint for joint in day.joints if joint.condition == condition]
        rows.append(
            BenchRow(
                policy,
                condition,
                command,
                runs=len(walks),
                measured=len(known),
                reached=_mean(known),
                spread=stdev(known) if len(known) > 1 else None,
                predicted=day.predicted.get((condition, policy, command)),
                stops=", ".join(f"{rule} {rules.count(rule)}" for rule in dict.fromkeys(rules)),
                jitter=_mean([walk.jitter for walk in walks]),
                tracking=_mean([walk.tracking for walk in walks]),
                friction=_mean([joint.friction for joint in joints]),
                friction_low=_mean([joint.low for joint in joints]),
                friction_high=_mean([joint.high for joint in joints]),
            )
        )
    return rows


def _mean(values: Sequence[float | None]) -> float | None:
    """Return the mean of what is known, None where nothing is."""
    known = [value for value in values if value is not None]
    return mean(known) if known else None


def missing(day: Day, rows: Sequence[BenchRow]) -> list[str]:
    """Return what the comparison still lacks, a sentence each."""
    policies, conditions, commands = (
        sorted({getattr(row, name) for row in rows}) for name in ("policy", "condition", "command")
    )
    lines = [
        f"no second {name}: nothing to compare"
        for name, values in (("policy", policies), ("friction", conditions))
        if len(values) < 2
    ]
    by_cell = {(row.policy, row.condition, row.command): row for row in rows}
    for cell in product(policies, conditions, commands):
        where, row = f"{cell[0]}, {cell[1]}, {cell[2]}", by_cell.get(cell)
        if row is None:
            lines.append(f"{where}: not walked")
            continue
        if row.runs < FEWEST:
            lines.append(f"{where}: {row.runs} of {FEWEST} runs")
        if row.predicted is None and row.command != "stand":
            lines.append(f"{where}: no prediction; `stiction evaluate --out DAY/{cell[1]}/predicted`")
    identified = {joint.condition for joint in day.joints}
    lines += [f"{condition}: no friction identified" for condition in conditions if condition not in identified]
    walked = [w for w in day.walks if w.counted and not w.stop and w.command.direction is not None]
    unknown = [walk.run for walk in walked if walk.reached is None]
    lines += [f"{run}: no distance in {SHEET}" for run in unknown]
    lines += [
        f"{walk.run}: the robot's time ran at {walk.pace:.2f} of this computer's; not counted, walk it again, a "
        "virtual robot on an idle computer"
        for walk in day.walks
        if not walk.counted
    ]
    lines += [f"{walk.run}: the policy came late; walk it again" for walk in day.walks if walk.late]
    return lines + [f"{run}: a dry run, left out" for run in day.dry]


def write_bench(folder: Path, command: str = "") -> tuple[list[BenchRow], list[str]]:
    """Read a day, write its sheet, table and page into its folder; return the rows, and what is missing.

    Lines of the sheet are kept; runs that it lacks are added, to be filled in. Errors: `read_day`, `publish`.
    """
    day = read_day(folder)
    rows = bench_rows(day)
    lacking = missing(day, rows)
    write_rows(folder / SHEET, sorted(day.sheet, key=lambda row: row.run), form="")
    write_rows(folder / TABLE, rows)
    sections = [Section("Measured beside predicted", (row_table(rows, MEANING),))]
    if day.joints:
        sections.append(Section("Identified friction", (row_table(day.joints),)))
    blocks = (bullets(lacking),) if lacking else (paragraph("Nothing."),)
    sections.append(Section("Missing for the comparison", blocks))
    write_text(folder / PAGE, render_page("A day on the bench", sections, lead(rows, lacking), command=command))
    return rows, lacking


MEANING = (
    "`reached/told`: velocity along the command over the commanded one, mean and standard deviation over the measured "
    "runs. `predicted`: the same of `stiction evaluate`. `POLICY+measured`: with friction fed forward. `identified`: "
    "mean dry friction of the identified joints, with the means of the ends of their intervals of 95 %."
)


def lead(rows: Sequence[BenchRow], lacking: Sequence[str]) -> str:
    """Return the answer in a sentence: how far prediction and measurement are apart."""
    pairs = [abs(row.reached - row.predicted) for row in rows if row.reached is not None and row.predicted is not None]
    runs = f"{sum(row.runs for row in rows)} runs in {len(rows)} cells"
    apart = f"prediction and robot differ by {mean(pairs):.2f} on average, {max(pairs):.2f} at most" if pairs else (
        "no cell has both a measurement and a prediction")  # fmt: skip
    return f"{runs}; {apart}; {len(lacking)} things are missing."
