"""One run on a robot: supervisor here, policy, logger and watchdog in processes of their own.

    robot ◀─commands── supervisor ──sensors──▶ policy
          ──states───▶            ◀──targets──
                          └──rows──▶ logger

The supervisor alone has the link to the robot, but for the watchdog, which sends damping once the supervisor no longer
goes on. It waits for no process: a message that does not come in time breaks a rule.
"""

from __future__ import annotations

import gc
import os
import select
import subprocess
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import ConfigurationError, PolicyError, RobotError
from stiction.core.lock import exclusive_lock
from stiction.core.provenance import limit_library_threads
from stiction.deploy.control import JointCommand
from stiction.deploy.fed_friction import FedFriction
from stiction.deploy.plausibility import Violation
from stiction.deploy.runtime.channel import IDLE, RUNNING, SENSORS, TIMES, Channel, sight_layout, targets_layout
from stiction.deploy.runtime.config import RunCfg
from stiction.deploy.runtime.motion import Motion
from stiction.deploy.runtime.operator import Operator
from stiction.deploy.runtime.processes import (
    Death,
    Logger,
    Watchdog,
    child_process,
    last_line,
    logging_process,
    watchdog_process,
)
from stiction.deploy.runtime.report import Timing, hunting_joints, summary
from stiction.deploy.runtime.supervisor import Out, Stage, Supervisor, check_peers
from stiction.deploy.runtime.ticker import Ticker
from stiction.deploy.transports.link import Link, RobotState
from stiction.files.bundle import Bundle

TICK = 0.002
"""Time between the supervisor's looks for late messages [s]."""

PROBE_SECONDS = 1.0
"""Length of the idle loop before a run, which measures this machine's timing [s]."""

DRAIN_SECONDS = 0.1
"""Longest time for dropping old states [s]."""


class Injected:
    """Faults that a test injects into a run: none here. See `virtual.faults`."""

    obeyed = False
    """True if the policy's process obeys faults."""

    def due(self, elapsed: float, policy: subprocess.Popen[bytes] | None) -> int:
        """Apply faults due at a time since the run began [s]; return the number of the policy's fault, 0 for none."""
        return 0


def run(
    bundle: Bundle,
    folder: Path,
    link: Link,
    cfg: RunCfg,
    velocity: np.ndarray,
    source: Motion | None = None,
    injected: Injected | None = None,
    say: Callable[[str], None] = lambda text: None,
    friction: FedFriction | None = None,
) -> dict[str, Any]:
    """Run a policy, or a motion, on a robot until it ends; return the report.

    bundle, folder: checked bundle and its folder, for a motion those of its robot; velocity: first command: forward,
    sideways [m/s], turn [rad/s], shape (3,); source: motion in place of the policy; injected: faults, for
    tests; say: takes a line for people; friction: fed forward while the policy runs.
    Raises `StictionError`: another process drives this robot, a second robot or reader is present, or the run cannot
    begin.
    """
    limit_library_threads()
    contract = bundle.contract
    if link.joint_names != contract.joint_names:
        raise PolicyError(f"the robot has the joints {link.joint_names}, the bundle {contract.joint_names}")
    with ExitStack() as stack:
        stack.enter_context(exclusive_lock(f"robot-{link.lock_name}", "the robot"))
        operator = Operator(cfg.operator, time.monotonic())
        stack.enter_context(operator.listening())
        timing, effect = Timing(), ""
        injected = injected or Injected()
        channel, policy = None, None
        if source is None:
            layouts = sight_layout(contract.num_joints), targets_layout(contract)
            words = [folder, bundle.digest, int(injected.obeyed)]
            end, policy = stack.enter_context(child_process("policy_process", words, 1))
            channel = Channel(end, *layouts)
        watchdog = stack.enter_context(watchdog_process(bundle, folder, link, cfg.supervisor))
        if watchdog is None and cfg.supervisor.armed:
            say("no watchdog over this transport: if this process is killed or halted, the robot must damp by itself")
        logger = stack.enter_context(logging_process(bundle, folder, link, cfg, source))
        _probe(timing)
        if cfg.realtime is not None:
            effect = _realtime(cfg.realtime, [p.pid for p in (policy, watchdog) if p is not None], timing)
            say(effect)
        forward = None if friction is None else friction.controller(link.period)
        supervisor = Supervisor(contract, cfg.supervisor, link.period, time.monotonic(), source, forward)
        if not cfg.supervisor.armed:
            say("a dry run: nothing is sent to the robot; --armed moves it")
        loop = _Loop(supervisor, link, channel, policy, logger, watchdog, operator, timing, injected, say)
        if loop.death is not None:
            stack.callback(loop.death.close)
        loop.run(velocity)
        if operator.complaint:
            say(f"ignored the last velocity command: {operator.complaint}")
    of_bundle = {"bundle": bundle.name, "digest": bundle.digest, "robot": contract.robot}
    log = {"log": None, "log_lost": 0, "log_end": None} if logger is None else logger.summary()
    of_run = {"armed": cfg.supervisor.armed, "stage": supervisor.stage.name.lower(), "sent": loop.sent_at}
    of_run |= {"signal": loop.signal, "damped_seconds": loop.damped_seconds}
    of_run |= {"forward": None if friction is None else friction.summary()}
    of_run |= {"watchdog": None if watchdog is None else {"acted": watchdog.acted}}
    counted = {name: None if np.isnan(n) else n for name, n in link.arrivals.counts.reported().items()}
    of_link = {"states": loop.states, "malformed": link.malformed, "complaint": link.complaint or None, **counted}
    of_link |= {"realtime": effect or None}
    return summary(supervisor, timing, of_run | of_link | log | of_bundle)


@dataclass
class _Loop:
    """Loop of the supervisor's process: reads the robot, asks the policy, sends commands, logs."""

    supervisor: Supervisor
    link: Link
    channel: Channel | None
    policy: subprocess.Popen[bytes] | None
    logger: Logger | None
    watchdog: Watchdog | None
    operator: Operator
    timing: Timing
    injected: Injected
    say: Callable[[str], None]
    states: int = 0
    sent_at: float | None = None
    """Time at which the first damping frame of a stop was sent [s]."""
    damped_seconds: float = 0.0
    """Time from the first damping frame of the end to the last [s]."""
    signal: int | None = None
    """Number of the signal that stopped the run; None: another reason, or none."""

    def __post_init__(self) -> None:
        self._rows = None if self.logger is None else self.logger.rows
        self._answers = targets_layout(self.supervisor.contract)
        self.death = None if self.policy is None else Death(self.policy)
        self._files = [self.link.fileno(), *self.operator.files()]
        self._files += [] if self.channel is None else [self.channel.end.fileno()]
        self._stage, self._ran_since, self._damped_at = Stage.PASSIVE, 0.0, 0.0
        self._hunted = 0
        self._last: tuple[float, RobotState, Out] | None = None

    def run(self, velocity: np.ndarray) -> None:
        """Run until the run has ended, however it does; velocity: first command."""
        self._begin(velocity)
        # What is loaded by now lives to the end: frozen, no later collection walks over it and makes a reading late.
        gc.collect()
        gc.freeze()
        try:
            while not self.supervisor.ended:
                self._run_once()
        except BaseException as error:
            self._fail(error)
            # An error has become the reason of the stop, for log and report; an interruption is raised again.
            if not isinstance(error, Exception):
                raise
        finally:
            gc.unfreeze()
            # A robot that was damped needs no watchdog while the log is written; one that was not is left to it.
            if self.damped_seconds > 0.0:
                self._beat(time.monotonic())
        self._end()

    def _begin(self, velocity: np.ndarray) -> None:
        """Take the first velocity command, and drop old states from the start of the processes.

        Raises `RobotError` where more than one robot, or an unexpected reader, is present: nothing was sent.
        """
        until = time.monotonic() + DRAIN_SECONDS
        while self.link.receive() and time.monotonic() < until:
            pass
        if (broken := check_peers(self.link.peers(), self.supervisor.cfg)) is not None:
            rule, names = broken
            raise RobotError(
                f"{rule.rule}: got {rule.value:g} ({names}), expected at most {rule.limit:g}; switch others off, "
                "choose the robot's own --domain, or raise --readers for programs that only listen"
            )
        remote = self.operator.remote
        self.supervisor.command_velocity(velocity, time.monotonic(), remote)

    def _run_once(self) -> None:
        """Wait for a message, at most one tick, and process it."""
        select.select(self._files, [], [], TICK)
        now = time.monotonic()
        self._beat(now)
        # First: after a halt the robot still obeys the last command, and all messages that wait here are old.
        self._emit(self.supervisor.turn(now), None)
        self._obey(now)
        self._answered()  # Before anything is sent: Linux drops the last message of a process that is gone.
        read = time.monotonic()
        states = self.link.receive()
        if not self.states:
            self.link.arrivals.begin()
        self._emit(self.supervisor.meet(self.link.peers(), now), None)
        self._emit(self.supervisor.delivered(*self.link.arrivals.counts.share, read), None)
        if not self.supervisor.ended and states:
            self.states += len(states)
            *older, state = states
            for passed in older:
                self._passed(passed, read)
            now = time.monotonic()
            # It has waited for those before it, too.
            state = replace(state, age=state.age + now - read)
            self._emit(self.supervisor.state(state, now), state)
            self.timing.reading.add(time.monotonic() - now)
            self._show(state, now)
        self._answered()
        self._emit(self.supervisor.tick(time.monotonic()), None)
        if self.logger is not None and self.logger.ended_now():
            self.say(f"no log from now on, the run goes on: {self.logger.end}")
        self._announce()

    def _beat(self, now: float) -> None:
        """Send a beat to the watchdog; stop the run where it has acted, or is gone."""
        if self.watchdog is None:
            return
        if self.supervisor.stage < Stage.DAMP and (broken := self.watchdog.broken(now)) is not None:
            self._stop(*broken)
        self.watchdog.beat(now, Stage.STAND <= self.supervisor.stage <= Stage.DAMP)

    def _fail(self, error: BaseException) -> None:
        """Damp the robot after an error in this program, as long as after any stop; record the error as the reason."""
        reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
        self._stop(Violation("policy failed", None, np.nan, np.nan), f"the supervisor itself: {reason}")
        until = time.monotonic() + self.supervisor.cfg.settle_limit
        while not self.supervisor.ended and time.monotonic() < until:
            time.sleep(TICK)
            # Where nothing goes out, the watchdog's way to the robot may still be open.
            if self.damped_seconds > 0.0:
                self._beat(time.monotonic())
            # Each by itself: if the error comes again in one, the other is done all the same.
            with suppress(Exception):
                for state in self.link.receive():
                    self.supervisor.state(state, time.monotonic())
            with suppress(Exception):
                self._emit(self.supervisor.repeat(time.monotonic()), None)

    def _obey(self, now: float) -> None:
        who = self.operator.stop(now)
        if who:
            first = self._stop(Violation("operator", None, np.nan, np.nan), who)
            self.signal = self.operator.signal if first else self.signal
        velocity = self.operator.velocity()
        if velocity is not None:
            self.supervisor.command_velocity(velocity, now, remote=True)

    def _show(self, state: RobotState, now: float) -> None:
        """Apply a due fault, and send the policy's process the newest reading."""
        if self.supervisor.ended:
            return
        running = self.supervisor.stage is Stage.RUN
        if running and not self._ran_since:
            self._ran_since = now
        fault = self.injected.due(now - self._ran_since, self.policy) if running else 0
        if self.channel is None:
            return
        sensors = {name: getattr(state.sensors, name) for name in SENSORS}
        inputs = {"velocity": self.supervisor.velocity, "robot_time": state.time, "fault": float(fault)}
        mode = RUNNING if running else IDLE
        if not self.channel.send(now, sensors | inputs | {"mode": mode}):
            self._policy_fails("policy gone")

    def _answered(self) -> None:
        if self.channel is None:
            return
        for message in self.channel.receive():
            now = time.monotonic()
            answer = self._answers.vectors(message)
            if answer["failed"][0]:
                self._policy_fails("policy failed")
            elif answer["mode"][0] == RUNNING:
                target, asked, by = (answer[name] for name in ("target", "requested", "limited_by"))
                self._emit(self.supervisor.policy_targets(target, now, asked, by), None)
                times = {name: float(answer[name][0]) for name in TIMES}
                if self.supervisor.stage is Stage.RUN:
                    self.timing.answer(now, times, int(answer["skipped"][0]))
                if self._rows is not None:
                    self._rows.send(message.data)
            else:
                self.supervisor.policy_waits(now)
        if self.death is not None and self.death.seen():
            self._policy_fails("policy gone")

    def _policy_fails(self, rule: str) -> None:
        """Stop, because the policy's process failed or is gone, with its last line."""
        assert self.policy is not None
        line, status = last_line(self.policy), self.policy.poll()
        ended = "its process is gone" if status is None else f"its process ended with status {status}"
        self._stop(Violation(rule, None, np.nan, np.nan), "; ".join(text for text in (line, ended) if text))

    def _stop(self, violation: Violation, detail: str) -> bool:
        """Stop the run; return False where it was stopped, or had ended, before."""
        out = self.supervisor.stop(violation, time.monotonic(), detail)
        self._emit(out, None)
        return out is not None

    def _emit(self, out: Out | None, state: RobotState | None) -> None:
        """Send a decision, and log it with the reading that it answers."""
        if out is None:
            return
        if out.command is not None and self.supervisor.cfg.armed:
            self._send(out.command)
        if out.stage >= Stage.DAMP and out.command is not None:
            now = time.monotonic()
            self._damped_at = self._damped_at or now
            self.damped_seconds = now - self._damped_at
            if self.supervisor.stop_record is not None:
                self.sent_at = self.sent_at or now
        if state is not None and self._rows is not None:
            self._log(state, out)

    def _send(self, command: JointCommand) -> None:
        """Send a command, but none with gains once the watchdog damps: it was decided before a halt."""
        if self.watchdog is not None and command.kp.any():
            if self.watchdog.acted:
                return
            self.watchdog.guard()
        number = self.link.send(command)
        self.supervisor.sent(number, time.monotonic())
        if self.watchdog is not None:
            self.watchdog.sent(number)

    def _passed(self, state: RobotState, read: float) -> None:
        """Judge and log a state that was no longer the newest when it was read [s], under the last decision."""
        self.link.arrivals.counts.late += state.age > self.supervisor.cfg.stale
        self._emit(self.supervisor.passed(state, read), None)
        if self._rows is not None and self._last is not None:
            self._log(state, self._last[2])

    def _log(self, state: RobotState, out: Out) -> None:
        """Log the reading before this one, with its period's torque, which came with this one, see `files.walk`."""
        before, self._last = self._last, (time.monotonic(), state, out)
        if before is None or self._rows is None:
            return
        at, old, decided = before
        self._rows.reading(at, self._row(old, state.joint_torque, decided))

    def _row(self, state: RobotState, torque: np.ndarray, out: Out) -> dict[str, object]:
        """Return the log's row of a reading, with the link's counts until now; see `row`."""
        return row(state, torque, out, self.supervisor.velocity) | self.link.arrivals.counts.reported()

    def _end(self) -> None:
        """Log the last reading, without the torque of the period after it, and the end of the run."""
        if self._rows is not None:
            if self._last is not None:
                at, state, out = self._last
                unknown = np.full_like(state.joint_torque, np.nan)
                self._rows.reading(at, self._row(state, unknown, out))
            self._rows.end()

    def _announce(self) -> None:
        if self.supervisor.stage is not self._stage:
            self._stage = self.supervisor.stage
            if self._stage in STAGES:
                self.say(STAGES[self._stage])
        if (count := int(self.supervisor.hunts.sum())) > self._hunted:
            self._hunted = count
            names = ", ".join(hunting_joints(self.supervisor))
            self.say(f"hunting: {names}; no friction is fed forward to them from now on, less of it was meant")


STAGES = {
    Stage.STAND: "standing up; space, q, Enter, Ctrl-C or Ctrl-Z stops",
    Stage.RUN: "running; space, q, Enter, Ctrl-C or Ctrl-Z stops",
    Stage.DAMP: "damping",
}


def row(state: RobotState, torque: np.ndarray, out: Out, velocity: np.ndarray) -> dict[str, object]:
    """Return the log's row of a reading. torque: mean over the period that follows [N m], shape (J,)."""
    sensors = state.sensors
    return {
        "stage": float(out.stage),
        "robot_time": state.time,
        "position": sensors.joint_position,
        "velocity": sensors.joint_velocity,
        "torque": torque,
        "target": out.limited.target,
        "requested": out.requested,
        "limited_by": out.limited.by,
        "forward": 0.0 if out.command is None else out.command.forward,
        "temperature": state.temperature,
        "quaternion": sensors.quaternion,
        "angular_velocity": sensors.angular_velocity,
        "acceleration": state.acceleration,
        "foot_contact": state.foot_contact,
        "battery": state.battery,
        "velocity_command": velocity,
    }


def _probe(timing: Timing) -> None:
    """Measure how late an idle loop is on this machine now."""
    ticker = Ticker(TICK)
    for _ in range(round(PROBE_SECONDS / TICK)):
        timing.probe.add(ticker.wait()[0])


def _realtime(priority: int, ids: Sequence[int], timing: Timing) -> str:
    """Set a real-time priority for this process, and others by id; return its effect on an idle loop, in words.

    Raises `ConfigurationError` where the system does not allow it.
    """
    if not hasattr(os, "sched_setscheduler"):
        raise ConfigurationError("this system has no SCHED_FIFO; leave --realtime away")
    try:
        for process in (0, *ids):
            os.sched_setscheduler(process, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        raise ConfigurationError(
            f"a real-time priority of {priority} was not given: {error.strerror}; raise the limit rtprio of this user, "
            "or leave --realtime away"
        ) from error
    before = timing.probe
    timing.probe = type(before)()
    _probe(timing)
    words = " to ".join(f"{1e3 * histogram.quantile(0.99):.2f} ms" for histogram in (before, timing.probe))
    return f"real-time priority {priority}: p99 of an idle loop's lateness from {words}"
