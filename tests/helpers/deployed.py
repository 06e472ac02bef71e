"""A robot and a clock that exist only in numbers: the supervisor's runs in tests, without a process or a wait."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from bundles import make_contract
from stiction.deploy.observation import Sensors
from stiction.deploy.runtime.config import SupervisorCfg
from stiction.deploy.runtime.motion import Motion
from stiction.deploy.runtime.supervisor import Out, Stage, Stop, Supervisor
from stiction.deploy.transports.link import RobotState

CONTRACT = make_contract()
JOINTS = CONTRACT.num_joints
STANDING = CONTRACT.array("standing")
PERIOD = 0.002

FASTEST = 3.0
"""Speed at which joints follow [rad/s]."""

SHORT = SupervisorCfg(armed=True, duration=1.0, hold=0.1, settle=0.1)


def state(number: int, time: float, **changed: Any) -> RobotState:
    """Return what a robot says that stands in its pose, its IMU as restless as all IMUs; `changed`: other vectors."""
    trembling = 1e-3 * np.sin(np.arange(3) + 40.0 * time)
    sensors = {
        "quaternion": np.array([1.0, 0.0, 0.0, 0.0]),
        "angular_velocity": trembling,
        "joint_position": STANDING.copy(),
        "joint_velocity": np.zeros(JOINTS),
    }
    sensors |= {name: changed.pop(name) for name in list(changed) if name in sensors}
    robot_state = RobotState(
        number=number,
        time=time,
        sensors=Sensors(**sensors),
        acceleration=np.array([0.0, 0.0, 9.81]),
        joint_torque=np.zeros(JOINTS),
        temperature=np.full(JOINTS, 30.0),
        lost=np.zeros(JOINTS),
        motor_fault=np.zeros(JOINTS),
        foot_contact=np.ones(6),
        battery=48.0,
        kp=np.full(JOINTS, np.nan),
        kd=np.full(JOINTS, np.nan),
        torque_limit=CONTRACT.array("torque_limit"),
        command=np.nan,
    )
    return replace(robot_state, **changed)


@dataclass
class Run:
    """One run in numbers: time passes by readings of 2 ms, and the policy answers at every tenth."""

    cfg: SupervisorCfg = SHORT
    source: Motion | None = None
    target: np.ndarray = field(default_factory=lambda: STANDING + 0.05)
    """Joint targets of the policy [rad]."""
    perfect: bool = True
    """True if joints follow their targets exactly."""

    def __post_init__(self) -> None:
        """Begin at time 0."""
        self.now, self.number = 0.0, 0
        self.supervisor = Supervisor(CONTRACT, self.cfg, PERIOD, 0.0, self.source)
        self.place(STANDING)
        self.outs: list[Out] = []
        self.answers = True

    def place(self, position: np.ndarray) -> None:
        """Put the joints somewhere, at rest [rad], shape (J,)."""
        self.position, self.goal = np.array(position), np.array(position)

    def step(self, robot_state: RobotState | None = None, silent: bool = False) -> list[Out]:
        """Let 2 ms pass, in which the robot says something, by default that it stands; return what was decided."""
        self.now, self.number = self.now + PERIOD, self.number + 1
        results: list[Out | None] = []
        if not silent:
            moved = np.clip(self.goal - self.position, -FASTEST * PERIOD, FASTEST * PERIOD)
            self.position = self.position + moved
            now = {"joint_position": self.position.copy(), "joint_velocity": moved / PERIOD}
            robot_state = robot_state or state(self.number, self.now, **now)
            results.append(self.supervisor.state(robot_state, self.now))
        if self.answers and self.number % 10 == 0:
            if self.supervisor.stage is Stage.RUN:
                results.append(self.supervisor.policy_targets(self.target, self.now))
            else:
                self.supervisor.policy_waits(self.now)
        results.append(self.supervisor.tick(self.now))
        outs = [out for out in results if out is not None]
        self.outs += outs
        for out in outs:
            if self.perfect and out.command is not None and out.command.kp.any():
                self.goal = out.command.target.copy()
        return outs

    def until(self, stage: Stage, most: float = 60.0) -> Run:
        """Let time pass until a stage, at most so long [s]; a stop is an error, but where STOPPED is waited for."""
        end = self.now + most
        while self.supervisor.stage is not stage and self.now < end:
            self.step()
        assert self.supervisor.stage is stage, self.supervisor.stop_record
        assert stage is Stage.STOPPED or self.supervisor.stop_record is None, self.supervisor.stop_record
        return self

    def ended(self, most: float = 60.0, silent: bool = False) -> Stop:
        """Let time pass, at most so long [s], until the supervisor ends; return why. The robot may be silent."""
        end = self.now + most
        while not self.supervisor.ended and self.now < end:
            self.step(silent=silent)
        assert self.supervisor.stop_record is not None
        return self.supervisor.stop_record

    def frames(self) -> list[Out]:
        """Return what went to the robot."""
        return [out for out in self.outs if out.command is not None]
