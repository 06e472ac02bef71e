"""The Actuator Net: fitted to what the motors of one virtual robot report while it walks.

As in the paper the conventional policy f0 walks on the robot, backward only, and its log trains f_motor; f1 is then
trained with that net in place of the PD law. The torque is that of a sensor behind the gear, which has the joints'
friction in it. The control has a motor current times a constant, which is what most robots log and which cannot know
the friction.

The folder has the logs and the net; it is an entry of `core.cache`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from stiction.core.cache import has_entry, key_of, publish_entry
from stiction.core.errors import FileError, PolicyError
from stiction.core.lock import replaced_folder
from stiction.engines.catalog import make_engine
from stiction.evaluation.course import FLAT
from stiction.evaluation.evaluate import WALK_CODE
from stiction.evaluation.grid import command_source
from stiction.evaluation.walk_logs import SHORTEST
from stiction.files.bundle import Bundle
from stiction.files.velocity import parse_command
from stiction.files.walk import write_walk
from stiction.joints.net import ActuatorCfg, TorqueSource
from stiction.robots.model import Robot
from stiction.virtual.bench import Bench, walk_log
from stiction.virtual.cases import Case
from stiction.virtual.trial import World, walk
from stiction_experiments.paper.plan import BACKWARD, RUNS

MAKING = (*WALK_CODE, "joints/*.py", "learning/actuator*.py", "stiction_experiments:paper/net.py")
"""Code that decides what the net is."""


@dataclass(frozen=True)
class WalkedNet:
    """A net of the walks of one robot, or of several."""

    engine: str
    """Name in the catalogue of engines."""
    case: Case
    spec: Robot
    policy: Bundle
    """f0, which walks."""
    torque_source: TorqueSource = "output_side"
    """Where the torque is measured that it learns."""
    seconds: float = 10.0
    """Length of each of its `RUNS` walks [s]."""
    cfg: ActuatorCfg = field(default_factory=ActuatorCfg)
    commands: tuple[str, ...] = BACKWARD
    """Commands of the walks."""
    others: tuple[Case, ...] = ()
    """Further robots that walk; all together make `RUNS` walks."""

    @property
    def label(self) -> str:
        """Name for people, of robot, policy and torque."""
        bench = Bench(self.engine, self.case, self.spec)
        return f"{bench.label}--{self.policy.name}--{self.torque_source.replace('_', '-')}"

    @property
    def key(self) -> str:
        """Digest of robot, engine, torque, policy, settings and code."""
        robot = (self.engine, self.case, self.spec, self.torque_source)
        walks = (self.seconds, self.commands, self.others)
        return key_of([*robot, self.policy.digest, *walks, self.cfg], *MAKING)


def make_net(walked: WalkedNet, folder: Path, command: str) -> None:
    """Let the policy walk and fit the net to its logs, unless the folder has it.

    Args:
        walked: robot, policy and settings.
        folder: for `logs` and the net's files.
        command: the command line, for the record.

    Raises:
        StictionError: the policy fell at once in nearly every run, or the folder cannot be written.

    """
    from stiction.learning.actuator import train_actuator, write_trained
    from stiction.learning.actuator_data import read_run
    from stiction.learning.phase import one_torch_thread

    if has_entry(folder, walked.key):
        return
    try:
        with replaced_folder(folder, "--out"), publish_entry(folder, walked.key, walked.label) as net:
            logs = net / "logs"
            logs.mkdir()
            each = RUNS // (len(walked.commands) * (1 + len(walked.others)))
            for number, case in enumerate((walked.case, *walked.others)):
                for name in walked.commands:
                    for episode in range(each):
                        log_walk(replace(walked, case=case), name, number * each + episode, logs)
            runs = [read_run(file) for file in sorted(logs.glob("*.npz"))]
            if len(runs) < 2:
                raise PolicyError(
                    f"{walked.policy.name} fell at once on {walked.case.label}: {len(runs)} of {RUNS} logs, too "
                    "few for a net; give a policy that walks"
                )
            with one_torch_thread():
                write_trained(net, train_actuator(runs, walked.cfg, command))
    except OSError as error:
        raise FileError(f"{folder} cannot be written: {error}; choose another --out") from error


def log_walk(walked: WalkedNet, command: str, episode: int, logs: Path) -> None:
    """Walk once and write the log `<command>--<episode>.npz`, if the robot stays up for `SHORTEST`.

    It is logged at the training's physics rate, at which the net will run.
    """
    contract = walked.policy.contract
    world = World(
        partial(make_engine, walked.engine), period=contract.physics_timestep, torque_source=walked.torque_source
    )
    order = command_source(parse_command(command), FLAT)
    steps = round(walked.seconds / contract.control_period)
    trial = walk(walked.policy, walked.case, world, order, steps, episode, spec=walked.spec)
    if len(trial.steps) * contract.control_period >= SHORTEST:
        log = walk_log(trial.steps, walked.policy, walked.spec, walked.engine, command, walked.torque_source)
        write_walk(logs / f"{command}--{episode}.npz", log)
