"""`stiction study peers`: identification beside other estimators, fitted to a part of a record, judged on the rest."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from stiction.core.cache import key_of
from stiction.core.decode import from_plain
from stiction.core.errors import ConfigurationError, check_once, unknown_name
from stiction.core.records import column, make_folder
from stiction_experiments import CODE
from stiction_experiments.lab.files import cached
from stiction_experiments.lab.study import ParallelOptions, Report, Study, Work

if TYPE_CHECKING:
    from stiction_experiments.peers.judge import Fitted
    from stiction_experiments.peers.records import Problem, Record
    from stiction_experiments.peers.walks import WalkRow

DESCRIPTION = """Fit estimators to the first part of measured records (STICTION_DATA) and of simulated ones, and
predict the rest in closed loop: identification, least squares on torque, output error with SciPy, MuJoCo's sysid, BAM,
the objective that the paper prints, and the true joint of a simulation. A toolbox that is not installed is left out."""

CHOSEN, COULOMB = "stiction", "stiction, Coulomb"
"""Names of identification, by the law that it chose and by viscous and Coulomb friction."""

OURS = (CHOSEN, COULOMB)

RECORDS = ("measured", "simulated")
"""Kinds of records."""

PEERS = ("regression", "scipy", "sysid", "bam", "paper")
"""Estimators of others."""

TRUTH = "the true joint"
"""Name of the simulated joint itself: no estimator predicts better but by chance."""


@dataclass(frozen=True, kw_only=True)
class PeersOptions(ParallelOptions):
    """Options of `stiction study peers`."""

    records: tuple[str, ...] = RECORDS
    """Records: measured, simulated."""
    seeds: tuple[int, ...] = (0,)
    """Seeds of the simulated records."""
    peers: tuple[str, ...] = PEERS
    """Estimators of others: least squares on torque, output error with SciPy, MuJoCo's sysid, BAM (with Coulomb's law,
    bam-m1, and with the law that it chooses), the paper's objective."""
    walks: tuple[Path, ...] = ()
    """Folders with state_history.csv and command_history.csv of a Go2 that walked, to be replayed."""
    out: Path = Path("stiction-peers")
    """Directory for peers.csv, means.csv, replays.csv, summary.json and report.html."""

    def __post_init__(self) -> None:
        """Reject the same work twice."""
        for name in ("records", "seeds", "peers"):
            check_once(f"--{name}", getattr(self, name))
        for name, known in (("records", RECORDS), ("peers", PEERS)):
            for word in getattr(self, name):
                if word not in known:
                    raise ConfigurationError(f"--{name}: {unknown_name(name[:-1], word, known)}")


@dataclass(frozen=True)
class PeerRow:
    """Held-out error of one estimator on one joint."""

    record: str = field(metadata=column("record"))
    joint: str = field(metadata=column("joint"))
    peer: str = field(metadata=column("estimator"))
    law: str = field(metadata=column("law"))
    """Friction law that was fitted."""
    error: float | None = field(metadata=column("error", "rad", ".3g"))
    """Error in closed loop on the rest, the smaller of the next two [rad, or m]; None without a prediction."""
    common: float | None = field(metadata=column("common simulation", "rad", ".3g"))
    """Error in the simulation that all share [rad, or m]; None where it does not have the law."""
    own: float | None = field(metadata=column("own simulator", "rad", ".3g"))
    """Error in the estimator's own simulator [rad, or m]; None without one."""
    cpu: float = field(metadata=column("CPU", "s", ".2g"))
    """Time of the processor for the fit [s]."""
    note: str = field(metadata=column("note"))


def fit_peers(name: str, problem: Problem, textbook: Fitted) -> dict[str, Fitted]:
    """Return the fits of one word of `PEERS`, by the names that they have in the table.

    textbook: the regression, where the others begin. Raises `StictionError` where a toolbox is not installed.
    """
    from stiction_experiments.peers import bam, mujoco_sysid, plain

    if name == "bam":
        return bam.fit_bam(problem, textbook)
    if name == "regression":
        return {name: textbook}
    fit = {"scipy": plain.fit_output_error, "sysid": mujoco_sysid.fit_sysid, "paper": plain.fit_paper}[name]
    return {name: fit(problem, textbook)}


def missing_toolboxes() -> dict[str, str]:
    """Return estimator -> sentence that says how to install its toolbox, for those that are not installed."""
    from importlib.util import find_spec

    from mujoco import sysid

    from stiction_experiments.peers import bam, mujoco_sysid

    missing = {}
    if not hasattr(sysid, "optimize"):
        missing["sysid"] = f"MuJoCo's sysid is not installed and left out; {mujoco_sysid.INSTALL}"
    if find_spec("bam") is None:
        missing["bam"] = f"BAM is not installed and left out; {bam.INSTALL}"
    return missing


def judged(record: Record, peers: Sequence[str]) -> list[PeerRow]:
    """Return the rows of one record. Raises `StictionError` where identification refuses it."""
    from stiction_experiments.peers.judge import in_common, in_own
    from stiction_experiments.peers.plain import fit_textbook
    from stiction_experiments.peers.records import Problem

    rows = _ours(record)
    first, rest = Problem.of(record.first, record.setup), Problem.of(record.rest, record.setup)
    begin = time.process_time()
    textbook = fit_textbook(first)
    regression = time.process_time() - begin
    for word in peers:
        begin = time.process_time()
        fits = fit_peers(word, first, textbook)
        seconds = regression if word == "regression" else time.process_time() - begin
        for name, fitted in fits.items():
            common, own = in_common(rest, fitted), in_own(rest, fitted)
            least = min((error for error in (common, own) if error is not None), default=None)
            rows.append(PeerRow(record.name, record.joint, name, fitted.law, least, common, own, seconds, fitted.note))
    if not record.measured:
        rows.append(_truth(record, rest))
    return rows


def kept(record: Record, peers: Sequence[str], folder: Path, key: str) -> list[PeerRow]:
    """Return the rows of one record, as the same command made them before where it did; folder: of parts."""
    name = f"{record.name}-{record.joint}".replace(" ", "-").lower()
    made = cached(folder, name, key, lambda: {"rows": [asdict(row) for row in judged(record, peers)]})
    return [from_plain(PeerRow, row, name) for row in made["rows"]]


def _ours(record: Record) -> list[PeerRow]:
    """Return the rows of identification, which predicts the rest as its own held-out record."""
    from stiction.identification.pipeline import identify_joint

    begin = time.process_time()
    result = identify_joint(record.first, setup=record.setup, held_out=record.rest).record
    seconds = time.process_time() - begin
    errors = {one["model"]: one["closed_loop"] for one in result.diagnostics["held_out"]["predictions"]}
    law = (result.friction_law or {}).get("law") or "coulomb"
    objections = "; ".join(one.seen for one in result.objections)
    rows = []
    for name, model, label in (
        (CHOSEN, "chosen", law),
        (COULOMB, "coulomb", "coulomb"),
        ("no friction", "no friction", "none"),
    ):
        error = errors[model]
        rows.append(PeerRow(record.name, record.joint, name, label, error, error, None, seconds, objections))
    return rows


def _truth(record: Record, rest: Problem) -> PeerRow:
    """Return how well the true joint predicts a simulated record: what is left is noise."""
    from stiction.joints.simulate import simulate
    from stiction_experiments.peers.judge import rms
    from stiction_experiments.peers.records import simulated_motors

    motor = simulated_motors()[record.name]
    motion = simulate(motor.joint, motor.gains, rest.step, rest.target, float(rest.position[0]), rest.speed)
    error = rms(rest, motion.position)
    return PeerRow(record.name, record.joint, TRUTH, record.name, error, error, None, 0.0, "")


def lead(rows: Sequence[PeerRow]) -> str:
    """Return on how many joints identification is ahead of the best of the others, and where it is not."""
    lines = []
    for record in dict.fromkeys(row.record for row in rows):
        behind = []
        joints = list(dict.fromkeys(row.joint for row in rows if row.record == record))
        for joint in joints:
            errors = {r.peer: r.error for r in rows if (r.record, r.joint) == (record, joint) and r.error is not None}
            rivals = {peer: error for peer, error in errors.items() if peer not in (*OURS, TRUTH)}
            best = min(rivals, key=lambda peer: rivals[peer])
            if errors.get(CHOSEN, float("inf")) > rivals[best]:
                behind.append(f"{joint} ({best}: {rivals[best]:.3g} against {errors.get(CHOSEN, float('nan')):.3g})")
        count = f"ahead of all others on {len(joints) - len(behind)} of {len(joints)}"
        lines.append(f"{record}: {count}" + (f"; behind on {', '.join(behind)}" if behind else ""))
    return "\n".join(lines)


@dataclass(frozen=True)
class Mean:
    """Geometric mean of one estimator's errors over the joints of one record."""

    record: str = field(metadata=column("record"))
    peer: str = field(metadata=column("estimator"))
    joints: int = field(metadata=column("joints"))
    error: float | None = field(metadata=column("geometric mean", "rad", ".3g"))
    least: float | None = field(metadata=column("least", "rad", ".3g"))
    most: float | None = field(metadata=column("most", "rad", ".3g"))
    ahead: int = field(metadata=column("stiction is ahead on"))
    """Joints on which identification predicts better."""
    cpu: float = field(metadata=column("CPU", "s", ".2g"))
    """Time of the processor for all fits [s]."""


def means(rows: Sequence[PeerRow]) -> list[Mean]:
    """Return the means of each record and estimator."""
    from stiction_experiments.peers.judge import geometric_mean

    ours = {(row.record, row.joint): row.error for row in rows if row.peer == CHOSEN}
    table = []
    for record, peer in dict.fromkeys((row.record, row.peer) for row in rows):
        some = [row for row in rows if (row.record, row.peer) == (record, peer)]
        errors = [row.error for row in some if row.error is not None]
        ahead = sum(
            row.error is None or (ours[record, row.joint] or float("inf")) < row.error for row in some if peer != CHOSEN
        )
        middle = geometric_mean(errors) if errors else None
        seconds = sum(row.cpu for row in some)
        table.append(
            Mean(
                record, peer, len(errors), middle, min(errors, default=None), max(errors, default=None), ahead, seconds
            )
        )
    return table


def chosen_records(options: PeersOptions) -> list[Record]:
    """Return the records of the options. Raises `StictionError` where a measured one is missing."""
    from stiction_experiments.flags.cases import data_folder
    from stiction_experiments.peers.records import measured_records, simulated_records

    todo: list[Record] = []
    if "measured" in options.records:
        todo += measured_records(data_folder())
    if "simulated" in options.records:
        todo += simulated_records(options.seeds)
    return todo


def walk_rows(folders: Sequence[Path]) -> list[WalkRow]:
    """Return the errors of replayed walks of a Go2; its friction is identified from the measured record in the air.

    Raises `StictionError` where a folder holds no walk, or the measured record is missing.
    """
    if not folders:
        return []
    from stiction.identification.pipeline import identify_log
    from stiction.robots.catalog import find_robot
    from stiction_experiments.flags.cases import data_folder, go2_in_air
    from stiction_experiments.peers.walks import identified_friction, replayed

    robot = find_robot("go2")
    legs = go2_in_air(data_folder())
    results, _ = identify_log(legs.log, legs.setup, workers=1)
    friction = identified_friction({name: result.record for name, result in results.items()}, robot)
    return [row for folder in folders for row in replayed(folder, robot, friction)]


def walk_lead(rows: Sequence[WalkRow]) -> list[str]:
    """Return what friction does to a replayed walk, a sentence a log."""
    sentences = []
    for log in dict.fromkeys(row.log for row in rows):
        errors = {row.friction: row.error for row in rows if row.log == log}
        texts = ", ".join(f"{name} {1e3 * error:.0f}" for name, error in errors.items())
        sentences.append(f"walk {log}, error of the angles by friction [mrad]: {texts}")
    return sentences


def run(options: PeersOptions, work: Work) -> Report:
    """Fit every estimator to every record."""
    from stiction.core.parallel import spread

    missing = missing_toolboxes()
    names = [name for name in options.peers if name not in missing]
    records = chosen_records(options)
    parts = work.begin() / "parts"
    make_folder(parts)
    keys = [key_of({"peers": names, "record": record.digest, "setup": record.setup}, *CODE) for record in records]
    tasks = [(record, names, parts, key) for record, key in zip(records, keys, strict=True)]
    rows: dict[int, list[PeerRow]] = {}
    for number, result in spread(kept, tasks, work.jobs):
        rows[number] = result
        work.progress("records", len(rows) / len(records))
    table = [row for number in sorted(rows) for row in rows[number]]
    walks = walk_rows(options.walks)
    answer = "\n".join((lead(table), *walk_lead(walks)))
    return Report(
        title="Identification beside other estimators",
        lead=answer,
        tables={"peers": table, "means": means(table), "replays": walks},
        summary={"lead": answer, "seconds": work.seconds, "left_out": missing},
        warnings=tuple(dict.fromkeys(missing.values())),
    )


STUDY = Study(
    "how well does identification predict a record that it has not seen, beside other estimators",
    DESCRIPTION,
    PeersOptions,
    run,
    results=("peers.csv", "means.csv", "replays.csv"),
)
