"""From a log to inertia and friction: `stiction identify` in Python."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from markupsafe import Markup

from stiction.api.logs import Log, as_log
from stiction.api.options import options_of, public, several
from stiction.api.result import Progress, Result, html_table, silent
from stiction.core.errors import ConfigurationError, FileError, LogError
from stiction.files import bam
from stiction.files.joints import FitSignals, JointRecord, JointsFile, read_fit, write_fit
from stiction.identification.pipeline import identify_log
from stiction.identification.setup import IdentifySetup, LimbSetup
from stiction.identification.verdict import propose, write_proposal


@dataclass(frozen=True, repr=False)
class Identified(Result):
    """Result of an identification. `result["hip"]` is the `JointRecord` of one joint."""

    file: JointsFile
    """Content of `joints.json`."""
    signals: dict[str, FitSignals]
    """Joint name -> signals, fit and residuals, arrays of shape (T,): time [s], position [rad], torque [N m], ...;
    empty where it was read from a file."""

    @property
    def joints(self) -> dict[str, JointRecord]:
        """Joint name -> record: inertia [kg m²], viscous_friction [N m s/rad], coulomb_friction [N m], ... with std
        and interval95; None where it cannot be known.
        """
        return self.file.joints

    @property
    def verdict(self) -> tuple[str, ...]:
        """Amount of friction, its importance, next step: one line each; of several joints, of the worst."""
        from stiction.report.joints import lead_lines

        return lead_lines(self.file)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings to read before a number is used, one sentence each."""
        return self.file.warnings

    @property
    def valid(self) -> bool:
        """True if every joint was identified and no error makes a fit invalid."""
        return all(record.diagnostics and not record.objections for record in self.joints.values())

    @property
    def training(self) -> dict[str, Any]:
        """Content of `training.json`: method, level and range of friction to train with, and why."""
        return propose(self.file)

    def __getitem__(self, joint: str) -> JointRecord:
        """Return the record of a joint, or of its kind; raise `StictionError` where there is none.

        Quantities of a fit that is not valid are None; `joints` has them, to show what is wrong.
        """
        return self.file.record(joint).usable()

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the joints."""
        return iter(self.joints)

    def __len__(self) -> int:
        """Return how many joints there are."""
        return len(self.joints)

    def lines(self) -> Sequence[str]:
        """Return the verdict at a glance, as the verb prints it; of several joints a line each, the worst first."""
        from stiction.report.identified import glance_of, glance_rows

        if (glance := glance_of(self.file, Path())) is None:
            return tuple(self.warnings[:3])
        rows = [", ".join(row) for row in glance_rows(self.file)] if len(self) > 1 else []
        return (*glance.lines, *rows, "why, and what is not known: result.verdict")

    def to_dict(self) -> dict[str, Any]:
        """Return what `stiction identify --json` prints, and `joints.json` holds."""
        return self.file.to_dict()

    def table(self) -> Markup:
        """Return a row a joint."""
        from stiction.report.joints import number, unit

        def cell(record: JointRecord, name: str) -> str:
            quantity = getattr(record, name)
            if quantity is None:
                return "not known"
            low, high = quantity.interval95
            return f"{number(quantity.value)} ({number(low)} to {number(high)}) {unit(record, name)}"

        shown = ["inertia", "viscous_friction", "coulomb_friction", "friction_ratio"]
        if any(record.static_friction is not None for record in self.joints.values()):
            shown.insert(3, "static_friction")
        rows = [[name, *(cell(self[name], part) for part in shown)] for name in self.joints]
        return html_table(["joint", *(name.replace("_", " ") for name in shown)], rows)

    def write(self, folder: Path, command: str = "", page: bool = True) -> None:
        """Write joints.json, fit.npz, training.json and, unless it is not wanted, report.html.

        command: the one that the page names, if there was one.
        """
        if not self.signals:
            raise FileError("this was read from a joints.json, whose signals lie beside it: copy that folder")
        self.file.write(folder / "joints.json")
        write_proposal(folder, self.file)
        write_fit(folder / "fit.npz", self.signals)
        if page:
            from stiction.report.identification import write_identification_page

            write_identification_page(folder, command)


@public
def identify(
    log: Log | str | Path | Any,
    *more_logs: Log | str | Path | Any,
    joint: str | Sequence[str] = (),
    repeat: Log | str | Path | Sequence[Any] = (),
    held_out: Log | str | Path | Any | None = None,
    robot: str | Path | None = None,
    kp: float | None = None,
    kd: float | None = None,
    torque_limit: float | None = None,
    torque_source: Literal["motor_side", "output_side"] | None = None,
    test_condition: Literal["bare_motor", "in_air", "loaded"] | None = None,
    jobs: int | None = None,
    progress: Progress = silent,
    out: str | Path | None = None,
    **options: Any,
) -> Identified:
    """Find inertia, viscous and dry friction of the joints in a log, with intervals, and say whether it matters.

    Args:
        log: from `load_log` or `from_arrays`; or the path of one, or a data frame.
        more_logs: further runs of the same joints, fitted together with it.
        joint: names of the joints to identify; all of them by default.
        repeat: further logs of the same joints, compared with it: hot and cold, with and without a payload.
        held_out: a log that is predicted and not fitted; by default the last part of the log is.
        robot: for the log of a whole leg or arm that moves with its base held: a MuJoCo or URDF file, a `robot.yaml`, a
            shipped robot, or `module:NAME`, which runs that module. All joints are then found together, also where
            one alone moves; `joint` names those to report.
        kp: proportional gain of the controller during the log [N m/rad]; like all that follows, by default the log's.
        kd: derivative gain [N m s/rad].
        torque_limit: largest torque of the motor, at the joint [N m].
        torque_source: `motor_side`, current or command, or `output_side`.
        test_condition: what hung on the motor.
        jobs: processes at once, where there are several joints; by default one a core.
        progress: called with what is done, and the share of it.
        out: folder for joints.json, fit.npz, training.json and report.html; by default nothing is written.
        options: every other field of `IdentifySetup`, and with `robot` of `LimbSetup`; the flags of the verb.

    Raises `StictionError` with one line that says what the log lacks.

    >>> from stiction.identification.example import Excitation, example_log
    >>> import stiction
    >>> result = stiction.identify(example_log(excitation=Excitation(duration=10.0)), torque_limit=45.0)
    >>> friction = result["shank"].coulomb_friction  # the truth is 0.442 N m
    >>> friction.interval95[0] < 0.442 < friction.interval95[1]
    True
    >>> len(result.verdict)
    3

    """
    from stiction.report.terminal import jobs_of

    named: dict[str, Any] = {"kp": kp, "kd": kd, "torque_limit": torque_limit}
    named |= {"torque_source": torque_source, "test_condition": test_condition}
    limb = {name: options.pop(name) for name in list(options) if name in LimbSetup.__dataclass_fields__}
    setup = options_of(IdentifySetup, named | options, identify)
    first, *others = [as_log(one) for one in (log, *more_logs)]
    wanted, jobs = several(joint), None if jobs is None else jobs_of(jobs)
    repeats = [as_log(one) for one in (repeat if isinstance(repeat, list | tuple) else (repeat,))]
    if robot is not None:
        of_limb = options_of(LimbSetup, limb, identify)
        result = identify_limb(first, str(robot), setup, of_limb, wanted, repeats, others)
    elif limb:
        raise ConfigurationError(f"{next(iter(limb))} is for the log of a whole limb; name its robot too")
    else:
        unseen = None if held_out is None else as_log(held_out)
        result = identify_joints(first, setup, wanted, repeats, others, jobs, progress, unseen)
    if out is not None:
        result.save(out)
    return result


def identify_joints(
    log: Log,
    setup: IdentifySetup,
    joints: Sequence[str] = (),
    repeats: Sequence[Log] = (),
    more: Sequence[Log] = (),
    jobs: int | None = None,
    progress: Progress = silent,
    held_out: Log | None = None,
) -> Identified:
    """Identify the joints of one log, or of several runs; see `identify`."""
    several = len(joints or log.joints) > 1
    fits, refused = identify_log(
        log,
        setup,
        joints,
        repeats,
        lambda joint: progress(f"identifying {joint}", 1.0) if several else None,
        jobs,
        more,
        held_out,
    )
    records = {name: result.record for name, result in fits.items()} | refused
    return Identified(JointsFile(records), {name: result.fit for name, result in fits.items()})


def identify_limb(
    log: Log,
    robot: str,
    declared: IdentifySetup,
    setup: LimbSetup,
    joints: Sequence[str] = (),
    repeats: Sequence[Log] = (),
    more: Sequence[Log] = (),
) -> Identified:
    """Identify all joints of a leg or an arm at once; see `identify`. Refuses what is for single joints.

    joints: those to report, by their names in the log; how the others moved, or were held, counts all the same.
    """
    from stiction.identification.limb import pipeline
    from stiction.identification.limb.signals import match_joints
    from stiction.robots.catalog import find_mechanism

    for inputs, what in ((repeats, "--repeat or --held-out"), (more, "several runs")):
        if inputs:
            raise ConfigurationError(
                f"{what} with --robot: expected one log, for all its joints at once; leave that out"
            )
    mechanism = find_mechanism(robot)
    numbers = match_joints(log, mechanism.name, mechanism.joint_names, setup.joint_map, mechanism.rigid)
    wanted = [mechanism.joint_names[numbers[log.joint(name)[0]]] for name in joints]
    result = pipeline.identify_limb(log, mechanism, declared, setup)
    if not wanted:
        return Identified(result.joints, result.signals)
    records = {name: record for name, record in result.joints.joints.items() if name in wanted}
    signals = {name: one for name, one in result.signals.items() if name in wanted}
    if not signals:
        raise LogError(next(iter(records.values())).warnings[0])
    return Identified(replace(result.joints, joints=records), signals)


@public
def load_joints(path: str | Path) -> Identified:
    """Return an earlier identification: its `joints.json`, or the folder with it; signals too, where they lie there.

    Raises `FileError` that names the field that is wrong.

    >>> import stiction
    >>> stiction.load_joints("missing")
    Traceback (most recent call last):
    stiction.core.errors.FileError: cannot read missing: No such file or directory; expected the joints.json of identify

    """
    file = Path(path) / "joints.json" if Path(path).is_dir() else Path(path)
    joints, fit = bam.load_joints(file), file.with_name("fit.npz")
    measured = [name for name, record in joints.joints.items() if record.diagnostics]
    signals = {name: read_fit(fit, name) for name in measured} if fit.is_file() else {}
    return Identified(joints, signals)


__all__ = ["Identified", "identify", "identify_joints", "identify_limb", "load_joints"]
