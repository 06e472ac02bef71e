"""`stiction deploy BUNDLE --robot TRANSPORT`: run a policy on a robot, under a supervisor that alone can move it."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from stiction.core.effects import excludes, exclusion, needs
from stiction.core.errors import ConfigurationError, UnwrittenError
from stiction.core.files import write_text
from stiction.core.flags import ARGUMENT
from stiction.core.options import read_options
from stiction.core.records import part_of
from stiction.deploy.runtime.config import LimitsCfg, OperatorCfg, SafetyCfg
from stiction.deploy.transports.config import HeldCfg
from stiction.files.settings import check_file, results_folder

if TYPE_CHECKING:
    from stiction.deploy.runtime.config import RunCfg
    from stiction.deploy.transports.config import Address
    from stiction.deploy.transports.link import Link
    from stiction.files.bundle import Bundle
    from stiction.files.contract import Contract
    from stiction.virtual.faults import Faults

DESCRIPTION = """Run a policy bundle on a robot, or play a designed motion on it.

Passive, until robot and policy are there; up to the standing pose, from where the joints are, over --ramp seconds; then
the policy; then damping. A supervisor judges every reading and clips every target; a broken rule ends the run: damping
for a second at least and while the robot moves (at most 5 s), one line with the rule, the joint and the value, and exit
status 1. Space, q, Enter, Ctrl-C, Ctrl-Z, Ctrl-\\ and every signal that can be caught stop it too; after a signal N the
exit status is 128 + N. Nothing is sent without --armed.

One robot, one writer of its states: a second one on the network is refused, or stops the run. Programs beside the robot
that read the commands are named, and need consent: --readers, or a typed yes.

--robot virtual starts a virtual robot in a process of its own: friction, motors, delays, gears and sensors are those of
--robot-seed. Try there, with --fault, what your robot must never do. unitree-go:eth0 is a Go2 or B2 at that network
interface, unitree-hg:eth0 a G1 or H1-2, ros2:/dog any robot whose driver speaks ROS 2 there: read the page "Bringing
up your robot" of the documentation before.

Examples:
  stiction deploy saturn_lite-flat-deception-0.2 --robot virtual --armed --command vx=0.5 --duration 10
  stiction deploy BUNDLE --robot virtual --armed --fault tilt@3
  stiction deploy BUNDLE --robot virtual --stand --armed --excitation excite/trajectory.csv
  stiction deploy BUNDLE --robot unitree-go:eth0
  stiction identify stiction-deploy/log"""


GROUPS = {
    "usually needed": ("--robot", "--armed", "--command", "--duration", "--out", "--json"),
    "the virtual robot": ("--robot-seed", "--friction-level", "--engine", "--robot-cell", "--stand", "--fault"),
    "what else": ("--forward", "--excitation", "--key", "--expect-digest", "--realtime", "--domain", "--readers"),
}
"""The options that people use."""


VIRTUAL = needs("--robot virtual")
"""Requirement of options of the virtual robot."""

UNITREE = needs("--robot unitree-go:INTERFACE", lambda cfg: cfg.robot.startswith("unitree-"))
"""Requirement of options of a Unitree robot."""


HEARTBEAT = needs(
    "--operator.heartbeat",
    lambda cfg: cfg.operator.heartbeat is not None or any(text.partition("@")[0] == "heartbeat" for text in cfg.fault),
    ("heartbeat_timeout",),
)
"""Requirement of a second machine that sends heartbeats, or a fault that plays one."""


@dataclass(frozen=True)
class DeployCfg:
    """Options of the verb."""

    bundle: Annotated[Path, ARGUMENT]
    """Directory of the bundle, or the name of one that comes with the package."""
    robot: str = "virtual"
    """Address of the robot: virtual, unitree-go:INTERFACE, unitree-hg:INTERFACE, ros2:/NAMESPACE."""
    held: HeldCfg = field(default_factory=HeldCfg, metadata=UNITREE)
    """Gains of joints that the robot has and the policy does not move, of a Unitree robot."""
    domain: int = field(default=0, metadata=UNITREE)
    """DDS domain of a Unitree robot, 0 to 232; two robots on one network need two."""
    readers: int = field(
        default=1, metadata=needs("--robot unitree-go:INTERFACE or ros2:/NAMESPACE", lambda cfg: cfg.robot != "virtual")
    )
    """Number of programs that may read the commands, the robot's own included; further ones are refused, or stop it."""
    armed: bool = False
    """Send commands. Without it everything runs but nothing is sent: look at the report and the log first."""
    command: str = "stand"
    """Commanded velocity, vx forward, vy sideways [m/s], wz turn [rad/s]: vx=0.5, or vx=0.3,wz=0.2, or stand."""
    duration: float | None = None
    """Seconds of the run after standing up, at most, also of --excitation; without it until somebody stops it."""
    forward: Path | None = None
    """A joints.json of `stiction identify`: 75 % of its friction is fed forward by the measured speed while the policy
    runs. Too much of it makes joints hunt about their targets: try it with the robot hung up."""
    excitation: Path | None = field(
        default=None, metadata=excludes("--command", "--forward", "--operator.command-from", "--silence")
    )
    """Play this trajectory.csv of `stiction excite` in place of the policy, the robot on a stand."""
    out: Path = Path("stiction-deploy")
    """Folder of the run: log/, report.json."""
    report: Path | None = None
    """File for the report, JSON; by default report.json in --out."""
    keep_minutes: float = 120.0
    """Minutes of the log that are kept, the newest; 0: no log."""
    ramp: float = 2.0
    """Seconds from the measured pose to the standing pose, at least 2."""
    silence: float = 0.06
    """Seconds after the policy's last answer from which on it hangs."""
    stale: float = 0.03
    """Maximum age of a robot state [s]."""
    gap: float = 0.06
    """Longest time between two turns of the supervisor's own loop [s]."""
    limits: LimitsCfg = field(default_factory=LimitsCfg)
    """Command limits."""
    safety: SafetyCfg = field(default_factory=SafetyCfg)
    """Safety limits."""
    operator: OperatorCfg = field(default_factory=OperatorCfg, metadata=HEARTBEAT)
    """Remote stop and velocity inputs."""
    realtime: int | None = None
    """Real-time priority (SCHED_FIFO, 1 to 99) of supervisor and policy; what it does to an idle loop is printed."""
    key: Path | None = None
    """Public key of the maker, a PEM file: the bundle must have this key's signature. Needs the extra sign."""
    expect_digest: str | None = None
    """Digest that the bundle must have, as `stiction verify` prints it."""
    robot_seed: int = field(default=1000, metadata=VIRTUAL)
    """Seed of the virtual robot."""
    engine: str = field(default="mujoco", metadata=VIRTUAL)
    """Physics engine of the virtual robot."""
    friction_level: str = field(default="0.1", metadata=VIRTUAL)
    """Dry friction of the virtual robot's joints: a fraction of the torque limit, or bench, or bench+0.02."""
    robot_cell: str = field(default="all", metadata=VIRTUAL)
    """Imperfections of the virtual robot: all, nominal (none), or groups such as friction+delays."""
    stand: bool = field(default=False, metadata=VIRTUAL)
    """Bolt the virtual robot to a stand, its legs in the air."""
    fault: tuple[str, ...] = field(default=(), metadata=VIRTUAL)
    """Faults of the virtual robot's run, NAME@SECOND after the policy took over: tilt@3.
    `stiction list faults` names them."""
    overwrite: bool = False
    """Write over what a run of other settings left in --out, but for its log: that of a run is never written over; and
    over the file of --report."""
    json: bool = False
    """Print the report as JSON on standard output, and nothing else."""


SEARCH_SECONDS = 1.0
"""Time in which other programs on the network are looked for before a person is asked [s]."""


def main(arguments: list[str]) -> int:
    """Run the verb; return the exit status."""
    cfg = read_options(DeployCfg, arguments, "stiction deploy", DESCRIPTION, groups=GROUPS)
    from stiction.deploy.check import check_bundle
    from stiction.deploy.transports.config import parse_address
    from stiction.files.bundle import find_bundle

    address = parse_address(cfg.robot)
    folder = find_bundle(cfg.bundle)
    if cfg.report is not None:
        check_file(cfg.report, cfg, "--report")  # before the robot moves
    report: dict[str, Any] = {}
    failures: list[str] = []
    try:
        # First: what is no bundle would else be called one of other settings than those in the folder.
        drive = _planned(cfg, address, check_bundle(folder, cfg.expect_digest, cfg.key).bundle, folder)
        written: tuple[str, ...] = () if cfg.report else ("report.json",)
        read = {"bundle": folder, "excitation": cfg.excitation, "forward": cfg.forward}
        with results_folder(cfg.out, "deploy", cfg, written, read):
            report = drive()
            write_text(cfg.report or cfg.out / "report.json", _text(report))
    except UnwrittenError as error:
        if not report:
            raise
        failures = [str(error)]  # The run was made: its end is reported all the same.
    if cfg.json:
        print(_text(report), end="")
    if report["log_end"] is not None:
        failures.insert(0, f"its log is not whole: {report['log_end']}")
    refused = (
        [] if report.get("complaint") is None else [f"{report['malformed']} states refused, {report['complaint']}"]
    )
    failed = bool(failures) or report["stop"] is not None
    if failed or refused:
        lines = [report["end"], *failures, *refused] if failed else refused
        print(f"stiction deploy: {'; '.join(lines)}", file=sys.stderr)
    if failed:
        return 128 + report["signal"] if report.get("signal") else 1
    if not cfg.json:
        _show(cfg, report)
    return 0


def _text(report: dict[str, Any]) -> str:
    """Return the report as it is written."""
    return json.dumps(report, indent=2, allow_nan=False) + "\n"


def _planned(cfg: DeployCfg, address: Address, bundle: Bundle, folder: Path) -> Callable[[], dict[str, Any]]:
    """Return what runs on the robot and returns the report; folder: of the bundle.

    Raises `StictionError` for options that cannot be, before anything begins.
    """
    import numpy as np

    from stiction.deploy.fed_friction import read_fed_friction
    from stiction.deploy.runtime.config import RunCfg, SupervisorCfg
    from stiction.deploy.runtime.motion import Motion
    from stiction.deploy.runtime.runtime import run
    from stiction.evaluation.course import untrained
    from stiction.files.velocity import parse_command

    planned = part_of(RunCfg, cfg, supervisor=part_of(SupervisorCfg, cfg))
    command = parse_command(cfg.command)
    if message := untrained([command], bundle.contract):
        raise ConfigurationError(f"{message}; command less")
    motion = None if cfg.excitation is None else Motion(cfg.excitation, bundle.contract)
    friction = None
    if cfg.forward is not None:
        if bundle.contract.compensation is not None:
            raise ConfigurationError("--forward: this policy compensates friction in its targets already; leave it out")
        if bundle.contract.observes_friction:
            raise ConfigurationError("--forward: this policy is told its joints' friction and answers it; leave it out")
        friction = read_fed_friction(cfg.forward, bundle.contract)
    # Quiet with --json, where everything that is said is in the report.
    say = (lambda text: None) if cfg.json else lambda text: print(f"stiction deploy: {text}", file=sys.stderr)
    if friction is not None:
        say(friction.sentence(bundle.contract.kinds))
    if bundle.contract.observes_friction and bundle.contract.known_friction_file is None:
        say("it is told the friction of its training: stiction export RUN --joints joints.json tells it the bench's")
    velocity = np.array(command.velocity)

    def drive(link: Link, agreed: RunCfg, injected: Faults | None = None) -> dict[str, Any]:
        return run(bundle, folder, link, agreed, velocity, motion, injected, say, friction)

    if address.transport == "virtual":
        # Here alone is a simulator, and only for the robot that is one.
        from stiction.virtual.faults import WITH_POLICY, Faults, parse_fault, with_operators
        from stiction.virtual.serve import VirtualCfg, virtual_robot

        virtual = VirtualCfg(cfg.robot_seed, cfg.engine, cfg.friction_level, cfg.robot_cell, cfg.stand)
        faults = tuple(map(parse_fault, cfg.fault))
        if motion is not None and (idle := [fault.name for fault in faults if fault.name in WITH_POLICY]):
            raise ConfigurationError(exclusion("--excitation", f"--fault {idle[0]}"))
        watched = replace(planned, operator=with_operators(cfg.operator, faults, cfg.out / "stop"))

        def on_virtual_robot() -> dict[str, Any]:
            with virtual_robot(folder, virtual) as robot, ExitStack() as stack:
                injected = None
                if faults:
                    told = Faults(faults, robot.address, watched.operator, bundle.contract.num_joints, velocity)
                    injected = stack.enter_context(told)
                report = drive(robot.link, watched, injected)
                times = {} if injected is None else injected.times
                return report | {"faults": times, "virtual": robot.report() if cfg.armed else {}}

        return on_virtual_robot

    def on_robot() -> dict[str, Any]:
        with closing(_link(cfg, address, bundle.contract)) as link:
            readers = _consent(cfg, link)
            return drive(link, replace(planned, supervisor=replace(planned.supervisor, readers=readers)))

    return on_robot


def _consent(cfg: DeployCfg, link: Link) -> int:
    """Return the number of programs that may read the commands, after asking where there are more than --readers."""
    if not cfg.armed or cfg.json or sys.stdin is None or not sys.stdin.isatty():
        return cfg.readers
    until = time.monotonic() + SEARCH_SECONDS
    while len(readers := link.peers().readers) <= cfg.readers and time.monotonic() < until:
        link.receive()
        time.sleep(0.02)
    if len(readers) <= cfg.readers:
        return cfg.readers
    listed = "".join(f"\n  {name}" for name in readers)
    count = f"{len(readers)} programs read the commands, and each may move by them"
    print(f"stiction deploy: {count}:{listed}", file=sys.stderr)
    try:
        answer = input(f"Type yes where all but {cfg.readers} only listen: ")
    except EOFError:  # Ctrl-D.
        answer = ""
        print(file=sys.stderr)
    return len(readers) if answer.strip().lower() == "yes" else cfg.readers


def _link(cfg: DeployCfg, address: Address, contract: Contract) -> Link:
    """Return the link to a robot that is not virtual."""
    if address.transport == "ros2":
        from stiction.deploy.transports.ros2 import ros2_link

        return ros2_link(address.place, contract)
    from stiction.deploy.transports.unitree import unitree_link

    return unitree_link(address.transport, address.place, cfg.domain, contract, cfg.held)


def _show(cfg: DeployCfg, report: dict[str, Any]) -> None:
    """Print how the run went."""
    late = report["lateness_ms"]
    print(f"{report['end']}; lateness p50 {late['p50']:g} ms, p99 {late['p99']:g} ms, {report['lateness_judged']}")
    print(f"report: {cfg.report or cfg.out / 'report.json'}")
    if report["log"] is not None:
        lost = f" ({report['log_lost']} of its messages were lost: the disk is too slow)" if report["log_lost"] else ""
        print(f"log: {cfg.out / report['log']}{lost}")
