"""A run on a virtual robot in which time passes only with its physics: messages, supervisor and policy, no process."""

from __future__ import annotations

import socket
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stiction.deploy.control import ControlLoop
from stiction.deploy.policy import load_policy
from stiction.deploy.runtime.supervisor import Stage, Supervisor
from stiction.deploy.transports.udp import LOOPBACK, UdpLink
from stiction.files.contract import robot_of
from stiction.virtual.faults import ASK
from stiction.virtual.robot import PERIOD
from stiction.virtual.serve import RobotProcess, VirtualCfg

if TYPE_CHECKING:
    from stiction.deploy.runtime.config import SupervisorCfg
    from stiction.deploy.transports.link import RobotState
    from stiction.files.bundle import Bundle


class Lockstep:
    """Robot and supervisor at both ends of a port, and a policy that answers at once."""

    def __init__(self, bundle: Bundle, cfg: SupervisorCfg, virtual: VirtualCfg, command: np.ndarray) -> None:
        """Put them there; command: velocity forward, sideways [m/s], turn [rad/s], shape (3,), may be written over."""
        port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        port.bind((LOOPBACK, 0))
        port.setblocking(False)
        contract, spec = bundle.contract, robot_of(bundle.contract)
        self.port, self.robot, self.command = port, RobotProcess(spec, virtual, port), command
        self.link = UdpLink(port.getsockname(), spec.joint_names, spec.foot_names, PERIOD)
        take = self.link.arrivals.take
        # Time passes only with the physics here: messages arrive by that clock, too.
        self.link.arrivals.take = lambda stamp, _, number: take(stamp, self.now, number)  # type: ignore
        self.link.hello()
        self.now, self._control = 0.0, round(contract.control_period / PERIOD)
        self.supervisor = Supervisor(contract, cfg, PERIOD, 0.0)
        self.supervisor.command_velocity(command, 0.0)
        self.loop = ControlLoop(load_policy(contract, bundle.policy), contract)
        self.newest: RobotState | None = None
        self.frames: list[bool] = []
        """Stiffness of each sent command: True if it had gains."""

    def step(self) -> None:
        """Let 2 ms pass."""
        self.robot.period()
        self.now += PERIOD
        ticks = round(self.now / PERIOD)
        state, supervisor = next(iter(self.link.receive()[-1:]), None), self.supervisor
        self.newest = state or self.newest
        outs = [supervisor.turn(self.now), supervisor.meet(self.link.peers(), self.now)]
        outs.append(supervisor.delivered(*self.link.arrivals.counts.share, self.now))
        # How long a datagram waited says nothing.
        outs += [] if state is None else [supervisor.state(replace(state, age=0.0), self.now)]
        if ticks % self._control == 0:
            if supervisor.stage is not Stage.RUN:
                supervisor.policy_waits(self.now)
            elif self.newest is not None:
                target = self.loop.act(self.newest.sensors, self.command).target
                outs.append(supervisor.policy_targets(target, self.now))
        outs.append(supervisor.tick(self.now))
        for out in outs:
            if out is not None and out.command is not None:
                supervisor.sent(self.link.send(out.command), self.now)
                self.frames.append(bool(out.command.kp.any()))

    def run(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / PERIOD)):
            self.step()

    def begin(self) -> None:
        """Let the policy take over at once: the robot was put down standing."""
        self.run(0.04)
        self.supervisor.stage = Stage.RUN

    def break_(self, fault: str) -> None:
        """Let a fault of the robot, or of the way to it, begin."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.sendto(ASK + fault.encode(), self.port.getsockname())

    def close(self) -> None:
        """Close both ends."""
        self.link.close()
        for port in (self.port, self.robot._second):
            if port is not None:
                port.close()
