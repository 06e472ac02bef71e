"""Supervisor: decides at every reading on the command to the robot. No process, no socket, no clock of its own.

    passive ──ready──▶ stand up ──ramp done──▶ run ──duration or motion over──▶ damping ──▶ done, or stopped
       │                  │                     │                                  ▲
       └──────────────────┴── a broken rule ────┴──────────────────────────────────┘

In every stage the reading is judged first. A stop is latched: only a new start by a person ends it. Damping is
sent again and again, since a frame can be lost: for the settling time, and while the robot moves, up to a limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from stiction.deploy.control import FREE, JointCommand, Limited, Limits
from stiction.deploy.plausibility import RULES as PLAUSIBLE
from stiction.deploy.plausibility import ClockRate, ReadingGuard, Violation, compare_drive
from stiction.deploy.runtime.config import SupervisorCfg
from stiction.deploy.runtime.motion import Motion
from stiction.deploy.runtime.safety import Safety
from stiction.deploy.runtime.settling import Settling
from stiction.deploy.transports.link import Peers, RobotState
from stiction.files.contract import Contract
from stiction.files.run_log import RUN_STAGE
from stiction.joints.compensation import FrictionController, Hunting

GAINS_AFTER = 0.5
"""Time after the first command with gains at which a robot that reports its gains reports ours [s]."""


class Stage(IntEnum):
    """Stage of the supervisor; the number stands in the log."""

    PASSIVE = 0
    STAND = 1
    RUN = RUN_STAGE
    DAMP = 3
    DONE = 4
    STOPPED = 5


@dataclass(frozen=True)
class Out:
    """Decision at one reading."""

    stage: Stage
    command: JointCommand | None
    """Command to the robot; None: nothing. Without `armed` it is shown and not sent."""
    requested: np.ndarray
    """Requested targets [rad], NaN without any, shape (J,)."""
    limited: Limited


@dataclass(frozen=True)
class Stop:
    """Reason why the robot was stopped."""

    violation: Violation
    detail: str
    """Detail for people; may be empty."""
    time: float
    """Time of the violation [s], on the clock of the supervisor's process."""
    last_state: float
    """Time of the last good state [s]; NaN: never."""

    def sentence(self) -> str:
        """Return the stop in one line."""
        if math.isnan(self.violation.limit):
            return self.violation.rule + (f": {self.detail}" if self.detail else "")
        return self.violation.sentence() + (f" ({self.detail})" if self.detail else "")

    def summary(self) -> dict[str, object]:
        """Return plain data for the report; numbers that are not finite become null."""
        data = {name: getattr(self.violation, name) for name in ("rule", "joint", "value", "limit", "unit")}
        data |= {"detail": self.detail, "time": self.time, "last_state": self.last_state}
        return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in data.items()}


def check_peers(peers: Peers, cfg: SupervisorCfg) -> tuple[Violation, str] | None:
    """Return the rule that programs at the other end of the link break, and their names; None: none is broken."""
    if (count := len(peers.robots)) > 1:
        return Violation("second robot", None, count, 1), "; ".join(peers.robots)
    if cfg.armed and (count := len(peers.writers)) > 0:
        return Violation("second writer", None, count, 0), "; ".join(peers.writers)
    if cfg.armed and (count := len(peers.readers)) > cfg.readers:
        return Violation("further reader", None, count, cfg.readers), "; ".join(peers.readers)
    return None


class Supervisor:
    """One robot, one policy or motion, one run."""

    def __init__(
        self,
        contract: Contract,
        cfg: SupervisorCfg,
        period: float,
        now: float,
        source: Motion | None = None,
        forward: FrictionController | None = None,
    ) -> None:
        """Start passive.

        contract: limits of the joints; period: between two readings [s]; now: on the caller's clock [s]; source:
        motion in place of a policy; forward: feed-forward of friction while a policy runs.
        """
        self.contract, self.cfg, self.stage = contract, cfg, Stage.PASSIVE
        self.stop_record: Stop | None = None
        """Stop of the run, None without one."""
        self.velocity = np.zeros(3)
        """Commanded velocity for the policy: forward, sideways [m/s], turn [rad/s]."""
        self.policy_ready = source is not None
        """True if the policy has reported that it waits."""
        self.limited_counts = np.zeros((contract.num_joints, 4), dtype=np.int64)
        """Number of readings in which each joint's target was free, or limited by each rule, shape (J, 4)."""
        jump = max(PLAUSIBLE["time jump"].limit, cfg.stale)
        limits = {"frozen IMU": cfg.frozen, "time jump": jump, "velocity and angle": cfg.safety.apart}
        self._guard = ReadingGuard(contract, limits)
        # A longer allowed wait for states means a slow machine or robot.
        self._clock = ClockRate(max(PLAUSIBLE["clock rate"].limit, 2.0 * cfg.stale))
        self._safety = Safety(contract, cfg.safety, period)
        self._source = source
        standing, kp, kd = (contract.array(name) for name in ("standing", "kp", "kd"))
        lengths = (cfg.duration, None if source is None else source.seconds)
        self._length = min((length for length in lengths if length is not None), default=math.inf)
        self._standing: np.ndarray = standing if source is None else source.start
        self._kp, self._kd = (kp, kd) if source is None else (source.kp, source.kd)
        slew, margin = cfg.limits.resolved(contract)
        self._limits, self._forward = Limits(contract, slew, margin, self._kp, self._kd), forward
        self._hunting = Hunting(contract.num_joints, period)
        self.hunts = np.zeros(contract.num_joints, bool)
        """Joints that hunted while standing was commanded: from then on nothing is fed forward to them."""
        self._torque_limit = contract.array("torque_limit")
        self._damping, self._nothing = kd, np.full(contract.num_joints, math.nan)
        self._began, self._since, self._seen = now, now, math.nan
        self._from: np.ndarray | None = None
        self._answered, self._asked, self._commanded = now, now, now
        self._answer: tuple[np.ndarray, Limited] | None = None
        self._ours: tuple[float, float] = (math.nan, math.nan)
        self._sent = -math.inf
        self._remote, self._ran, self._position, self._period = False, 0.0, standing, period
        self._turned, self._framed = math.nan, now
        self._drives: list[bytes | None] = []
        self._settling = Settling(cfg, contract.num_joints, now)

    @property
    def ended(self) -> bool:
        """True if nothing more will be sent."""
        return self.stage in (Stage.DONE, Stage.STOPPED)

    def motion(self) -> dict[str, float] | None:
        """Return the length of the motion, and the part of it that was played [s]; None for a run of a policy."""
        if self._source is None:
            return None
        return {"seconds": self._source.seconds, "played": min(self._ran, self._length)}

    # Inputs.

    def command_velocity(self, velocity: np.ndarray, now: float, remote: bool = False) -> None:
        """Take a velocity command, judged with the next state; remote: True if its source can be lost."""
        self.velocity, self._commanded, self._remote = np.array(velocity, float), now, remote

    def sent(self, number: float, now: float) -> None:
        """Remember the number and the time of a sent command."""
        first = number if math.isnan(self._ours[0]) else self._ours[0]
        self._ours, self._sent = (first, number), now

    def policy_waits(self, now: float) -> None:
        """Note that the policy's process waits for a reading."""
        self.policy_ready, self._answered = True, now

    def policy_targets(
        self, target: np.ndarray, now: float, requested: np.ndarray | None = None, by: np.ndarray | None = None
    ) -> Out | None:
        """Take the targets of a control step [rad], shape (J,).

        requested: the policy's targets before the contract's limits [rad]; by: the limiting rules, see `LIMITED_BY`.
        """
        elapsed, self._answered = now - self._answered, now
        if not np.isfinite(target).all():
            joint = self.contract.joint_names[int(np.argmin(np.isfinite(target)))]
            return self.stop(Violation("target not finite", joint, math.nan, math.nan), now, f"target of {joint}")
        if self.stage is Stage.RUN and self._source is None:
            # As in training a target acts at once; so the slew is of one answer to the next, not of readings. Of a gap
            # two periods count at most, else the first target after it could jump.
            within = self._limits.step(np.array(target, float), min(elapsed, 2.0 * self.contract.control_period))
            if by is not None:
                within = Limited(within.target, np.where(within.by == FREE, by.astype(int), within.by))
            self._answer = np.array(target if requested is None else requested, float), within
        return None

    def stop(self, violation: Violation, now: float, detail: str = "") -> Out | None:
        """Stop for good; return the first damping frame, or None where the run was stopped, or had ended, before."""
        if self.ended or self.stop_record is not None:
            return None
        return self._stop(violation, now, detail)

    def _stop(self, violation: Violation, now: float, detail: str = "") -> Out:
        self.stop_record = Stop(violation, detail, now, self._seen)
        self.stage, self._since = Stage.DAMP, now
        return self._settle(now)

    # Time.

    def turn(self, now: float) -> Out | None:
        """Judge the time since the last turn of the caller's loop; to be called first in each turn."""
        gap, self._turned = now - self._turned, now
        if self.stage in (Stage.STAND, Stage.RUN) and gap > self.cfg.gap:
            return self.stop(Violation("supervisor halted", None, gap, self.cfg.gap, "s"), now)
        return None

    def meet(self, peers: Peers, now: float) -> Out | None:
        """Judge the programs at the other end of the link."""
        broken = check_peers(peers, self.cfg)
        return None if broken is None else self.stop(broken[0], now, broken[1])

    def delivered(self, bad: float, sent: float, now: float) -> Out | None:
        """Judge the delivery of the robot's states; the arguments are those of `Safety.losses`."""
        broken = self._safety.losses(bad, sent, now)
        return None if broken is None else self.stop(broken, now)

    def tick(self, now: float) -> Out | None:
        """Judge late messages, and repeat the damping frame; to be called every 2 ms or so."""
        if self.ended:
            return None
        return (None if self.stop_record is not None else self._late(now)) or self.repeat(now)

    def repeat(self, now: float) -> Out | None:
        """Return the next damping frame where one is due: without states to answer, too, since none may come."""
        if self.stage is Stage.DAMP and now - self._framed >= 0.9 * self._period:
            return self._settle(now)
        return None

    def _late(self, now: float) -> Out | None:
        # Until both have come, nothing can be stale or silent.
        if self.stage is Stage.PASSIVE and (math.isnan(self._seen) or not self.policy_ready):
            if now - self._began > self.cfg.ready_timeout:
                waited, unseen = now - self._began, math.isnan(self._seen)
                missing = "no valid state of the robot has come" if unseen else "the policy has not answered"
                return self.stop(Violation("not ready", None, waited, self.cfg.ready_timeout, "s"), now, missing)
            return None
        if now - self._seen > self.cfg.stale:
            return self.stop(Violation("stale state", None, now - self._seen, self.cfg.stale, "s"), now)
        if self._source is None and now - self._answered > self.cfg.silence:
            return self.stop(Violation("policy silent", None, now - self._answered, self.cfg.silence, "s"), now)
        if self._remote and self.stage is Stage.RUN:
            age = now - self._commanded
            if age > self.cfg.command_stop:
                return self.stop(Violation("command lost", None, age, self.cfg.command_stop, "s"), now)
            if age > self.cfg.command_timeout:
                self.velocity = np.zeros(3)
        return None

    def state(self, state: RobotState, now: float) -> Out:
        """Judge a state and return the decision."""
        if self.ended:
            return self._out(None)
        if self.stop_record is None:
            broken = self._judge(state, now)
            # By when it came: after a halt the queue is full of old states, and the newest may be lost.
            if broken is None and self.stage is not Stage.PASSIVE and state.age > self.cfg.stale:
                broken = Violation("stale state", None, state.age, self.cfg.stale, "s")
            if broken is not None:
                return self._stop(broken, now)
            self._seen, self._position = now - state.age, state.sensors.joint_position
        if self.stage is Stage.PASSIVE:
            return self._passive(now)
        if self.stage is Stage.STAND:
            return self._stand(state, now)
        if self.stage is Stage.RUN:
            return self._run(state, now)
        self._settling.look(state.sensors, now)
        return self._settle(now)

    def passed(self, state: RobotState, now: float) -> Out | None:
        """Judge a state that a newer one has overtaken; it decides nothing but a stop."""
        if self.ended or self.stop_record is not None:
            return None
        broken = self._judge(state, now)
        if broken is not None:
            return self.stop(broken, now)
        self._seen = now - state.age
        return None

    # The stages.

    def _passive(self, now: float) -> Out:
        """Damp until the policy is ready, then begin to stand up from where the robot is."""
        if not self.policy_ready:
            return self._out(self._damp())
        self.stage, self._since, self._from = Stage.STAND, now, np.array(self._position)
        self._limits.begin(self._from)
        self._asked = now
        # No time, so that only the range can move it away from the measured pose.
        first = self._limits.step(self._from, 0.0)
        broken = self._far("first target", first.target, self.cfg.first_target)
        if broken is not None:
            return self._stop(broken, now, "move it by hand to within its limits, then start again")
        return self._out(JointCommand.position(first.target, self._kp, self._kd), self._from, first)

    def _stand(self, state: RobotState, now: float) -> Out:
        assert self._from is not None
        elapsed = now - self._since
        # Half a cosine: it begins and ends at rest.
        share = 0.5 - 0.5 * math.cos(math.pi * min(elapsed / self.cfg.ramp, 1.0))
        requested = self._from + share * (self._standing - self._from)
        if elapsed < self.cfg.ramp + self.cfg.hold:
            return self._limit(requested, state, now)
        broken = self._far("did not stand up", self._standing, self.cfg.standing_error)
        # Unarmed, nothing was sent, and the robot lies where it lay: a dry run goes on.
        if self.cfg.armed and broken is not None:
            return self._stop(broken, now)
        self.stage, self._since = Stage.RUN, now
        # Nobody had to command a robot that was standing up: silence counts from here.
        self._answer, self._commanded = None, now
        self._safety.reset()
        return self._limit(requested, state, now)

    def _run(self, state: RobotState, now: float) -> Out:
        self._ran = elapsed = now - self._since
        if elapsed >= self._length:
            self.stage, self._since = Stage.DAMP, now
            return self._settle(now)
        if self._source is not None:
            out = self._limit(self._source.target(elapsed), state, now)
        elif self._answer is None:
            return self._limit(self._standing, state, now)
        else:
            out = self._within_torque(*self._answer, state)
        self.limited_counts[np.arange(len(out.limited.by)), out.limited.by] += 1
        return out

    def _settle(self, now: float) -> Out:
        """Return a damping frame, the last one where the robot has come to rest."""
        self._framed = now
        if self._settling.over(now - self._since, now, silent=math.isnan(self._seen)):
            self.stage = Stage.DONE if self.stop_record is None else Stage.STOPPED
        return self._out(self._damp())

    def _far(self, rule: str, pose: np.ndarray, limit: float) -> Violation | None:
        """Return a violation if a joint is further than a limit from a pose [rad], else None."""
        joint = int(np.argmax(far := np.abs(pose - self._position)))
        name = self.contract.joint_names[joint]
        return Violation(rule, name, float(far[joint]), limit, "rad") if far[joint] > limit else None

    # Outputs.

    def _limit(self, requested: np.ndarray, state: RobotState, now: float) -> Out:
        """Return the command for requested targets, within every limit."""
        limited = self._limits.step(requested, now - self._asked)
        self._asked = now
        return self._within_torque(requested, limited, state)

    def _within_torque(self, requested: np.ndarray, limited: Limited, state: RobotState) -> Out:
        """Return the command for targets that are within slew and range."""
        angle, speed = state.sensors.joint_position, state.sensors.joint_velocity
        limited = self._limits.apply_torque(limited, angle, speed)
        command = JointCommand.position(limited.target, self._kp, self._kd)
        if self._forward is not None and self.stage is Stage.RUN and self._source is None:
            if self.velocity.any():
                self._hunting.reset()
            else:
                self.hunts |= self._hunting.step(speed)
            pushed = command.against_friction(angle, speed, self._forward, self._torque_limit)
            command = replace(pushed, forward=np.where(self.hunts, 0.0, pushed.forward))
        return self._out(command, requested, limited)

    def _damp(self) -> JointCommand:
        """Return the damping frame: no stiffness, the controllers' own damping, where the joints are."""
        zero = np.zeros_like(self._damping)
        return JointCommand(np.nan_to_num(self._position), zero, self._damping, zero)

    def _out(
        self, command: JointCommand | None, requested: np.ndarray | None = None, limited: Limited | None = None
    ) -> Out:
        if self.cfg.armed and command is not None:
            self._safety.commanded(command)
        if limited is None:
            target = self._nothing if command is None else command.target
            limited = Limited(target, np.full(len(target), FREE))
        return Out(self.stage, command, self._nothing if requested is None else requested, limited)

    def _judge(self, state: RobotState, now: float) -> Violation | None:
        acting = self.stage is Stage.RUN
        broken = self._guard.check(state.time, state.sensors, self.velocity, acting=acting)
        broken = broken or self._safety.finite(state) or self._clock.check(state.time, now - state.age)
        if broken is not None:
            return broken
        # Before the first command of ours both ends are NaN, and any other one is another writer's.
        if self.cfg.armed and math.isfinite(state.command) and not self._ours[0] <= state.command <= self._ours[1]:
            return Violation("second writer", None, state.command, self._ours[1])
        # The gains that a robot reports may still be from before the first command that sets them, and wait in a queue.
        measured = now - state.age
        gains = self.cfg.armed and (acting or (self.stage is Stage.STAND and measured - self._since > GAINS_AFTER))
        kp, kd = (_reported(values) if gains and self._source is None else None for values in (state.kp, state.kd))
        drives = (kp, kd, _reported(state.torque_limit))
        # Gains and limits that are those of the last reading, to the last bit, were judged there.
        if (told := [None if values is None else values.tobytes() for values in drives]) != self._drives:
            if differences := compare_drive(self.contract, *drives):
                return differences[0]
            self._drives = told
        return self._safety.check(state, answers=measured > self._sent)


def _reported(values: np.ndarray) -> np.ndarray | None:
    return None if np.isnan(values).all() else values
