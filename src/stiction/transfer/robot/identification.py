"""What can be known of a virtual robot: its bench log, identified as that of any robot, in a folder of its own.

The folder has `joints.json` and `training.json` as `stiction identify` writes them, with nothing of the truth in them.
`made.json` comes last and says what they were made from and by which code: what has changed since is made again.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from stiction.formats import made
from stiction.formats.errors import StictionError
from stiction.formats.joints import JointRecord, JointsError, JointsFile, load_joints
from stiction.formats.log import Log
from stiction.formats.reproducibility import made_by, seed_streams
from stiction.formats.training import write_training
from stiction.identify.many import REFUSED, identify_log
from stiction.identify.proposal import propose
from stiction.robots.spec import RobotSpec
from stiction.transfer.engines.catalog import binaries, make_engine
from stiction.transfer.robot.bench import BenchCfg, bench_log
from stiction.transfer.robot.factorial import Case
from stiction.transfer.robot.trial import World
from stiction.transfer.robot.virtual import VirtualRobot

JOINTS, TRAINING = "joints.json", "training.json"
"""Files of the folder."""

MAKING = (
    *("identify/*.py", "identify/excite/motion.py", "joints/*.py", "robots/*.py", "sim/fall.py", "sim/friction.py"),
    *("formats/advice.py", "formats/following.py", "transfer/engines/*.py", "transfer/robot/*.py"),
    *(
        f"formats/{name}.py"
        for name in ("fit", "friction", "joints", "log", "made", "reproducibility", "sidecar", "training")
    ),
)
"""Code that decides what a bench finds."""


@dataclass(frozen=True)
class Bench:
    """One robot on its bench."""

    engine: str
    """Name in the catalogue of engines."""
    case: Case
    """The robot."""
    spec: RobotSpec
    """Its data sheet."""
    cfg: BenchCfg = field(default_factory=BenchCfg)
    """How its log is made."""

    @property
    def label(self) -> str:
        """Name of its folder: `saturn_lite--physx--all--0.1--1000`."""
        return f"{self.spec.name}--{self.engine}--{self.case.label}"

    @property
    def key(self) -> str:
        """What it was made from, as one number: robot, engine, log, code."""
        text = repr((self.engine, self.case, self.spec, self.cfg, made_by(*MAKING), binaries(self.engine)))
        return hashlib.sha256(text.encode()).hexdigest()

    def robot(self) -> VirtualRobot:
        """Return the robot, bolted to its stand."""
        noise = seed_streams(self.case.seed, ["bench, noise"])["bench, noise"]
        return World(partial(make_engine, self.engine)).on_bench(self.case, self.spec, noise)


def is_made(bench: Bench, folder: Path) -> bool:
    """Say whether a folder has all that `make_bench` would make there."""
    return made.is_made(folder, bench.key) and all((folder / name).is_file() for name in (JOINTS, TRAINING))


def make_bench(bench: Bench, folder: Path, workers: int = 1) -> None:
    """Put a robot on its bench and identify it; arguments as of `write_identified`.

    Where no joint can be identified, that is what is found: every record is empty and its warning says why.

    Raises:
        StictionError: the folder cannot be written.

    """
    log = bench_log(bench.robot().plug, bench.spec, bench.cfg)
    try:
        joints = identified(log, workers)
    except StictionError as error:
        joints = JointsFile({name: JointRecord(warnings=(f"{REFUSED}no joint was; {error}",)) for name in log.joints})
    _write(bench, joints, folder)


def write_identified(bench: Bench, log: Log, folder: Path, workers: int = 1) -> JointsFile:
    """Identify the robot of a bench log and write what was found; return it.

    Args:
        bench: of the log.
        log: as from `bench_log`.
        folder: for the files.
        workers: processes; they do not change the result.

    Raises:
        StictionError: no joint can be identified, or the folder cannot be written.

    """
    joints = identified(log, workers)
    _write(bench, joints, folder)
    return joints


def identified(log: Log, workers: int = 1) -> JointsFile:
    """Return what is found in a bench log; raise `StictionError` where no joint can be identified."""
    found, refused = identify_log(log, workers=workers)
    records = {name: result.record for name, result in found.items()} | refused
    return JointsFile({name: records[name] for name in log.joints})


def _write(bench: Bench, joints: JointsFile, folder: Path) -> None:
    """Write what was found on a bench, what it was made from last; raise `StictionError` where that cannot be done."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        joints.write(folder / JOINTS)
        write_training(folder / TRAINING, propose(joints))
        made.mark_made(folder, bench.label, bench.key)
    except OSError as error:
        raise StictionError(f"{folder} cannot be written: {error}; choose another --out") from error


def identified_friction(joints: JointsFile | Path, joint_names: tuple[str, ...]) -> np.ndarray:
    """Return the Coulomb friction of every joint as it was identified [N m], shape (J,); below zero it is zero.

    joints: a `joints.json`, read or not yet; joint_names: the robot's, in its order.

    Raises:
        JointsError: the file cannot be read, or a joint is not in it or its friction is not known.

    """
    if not isinstance(joints, Path):
        return np.array(joints.nominal(joint_names, "coulomb_friction"))
    try:
        return identified_friction(load_joints(joints), joint_names)
    except JointsError as error:
        raise JointsError(f"{joints}: {error}") from error
