"""Link to a Unitree robot by `rt/lowstate` and `rt/lowcmd`: `unitree-go` is Go2 and B2, `unitree-hg` is G1 and H1-2.

Our values, joint by joint, become the maker's by order, signs and zeros in the contract (`deploy.vendor`). Undriven
motors are off. Joints that the robot has and the policy does not move are held: from their measured angles
they go to their angles slowly, and they are damped when the others are.

    robot ──LowState──▶ checksum, mode ──▶ RobotState        JointCommand ──▶ LowCmd, checksum ──▶ robot
"""

from __future__ import annotations

import time

import numpy as np

from stiction.core.errors import ConfigurationError, RobotError
from stiction.deploy.control import JointCommand
from stiction.deploy.observation import Sensors
from stiction.deploy.transports.arrivals import Arrivals
from stiction.deploy.transports.config import HeldCfg
from stiction.deploy.transports.dds import DdsBus
from stiction.deploy.transports.link import Ages, Peers, RobotState, Spare
from stiction.deploy.vendor import VendorMap
from stiction.files.contract import Contract
from stiction.files.unitree import GO_COMMAND, GO_STATE, HG_COMMAND, HG_STATE

PERIOD = 0.002
"""Time between two states [s]."""

HEAD = (0xFE, 0xEF)
LOW_LEVEL = 0xFF
"""`level_flag` of go: the commands are of motors, not of a gait."""

MOTOR_ON = 1

PITCH_ROLL = 0
"""`mode_pr` of hg: ankles and waist in numbers of joints (pitch, roll), not of the motors behind them (A, B)."""

MOTORS_TIMED_OUT = 0x80

TICK = 1e-3
"""Unit of `tick`, the robot's monotonic count since it was switched on [s]; a simulator may leave it at 0."""

TICKS = 2**32
"""Number of ticks after which the count begins again."""

HELD_SPEED = 0.5
"""Speed at which joints that the policy does not move go to their held angles [rad/s]."""

HELD_STEP = 0.1
"""Longest time that one step of held joints makes up for [s]: after a pause they do not jump."""

FOREIGN = 0.0
"""Number of a command that is not ours; ours begin with 1."""


FAMILIES = {"unitree-go": (GO_STATE, GO_COMMAND), "unitree-hg": (HG_STATE, HG_COMMAND)}
"""Transport -> messages of its robots: states and commands."""


class Translation:
    """Translation of a contract's joints to the messages of one family, and back. Keeps no state."""

    def __init__(self, transport: str, contract: Contract, held: HeldCfg) -> None:
        """Drive the joints of a contract.

        Raises `RobotError`: the contract lacks the maker's order, or names more joints than the messages have;
        `ConfigurationError`: there are joints to be held, and no gains.
        """
        (self.state_structure, self.command_structure), self.joint_names = FAMILIES[transport], contract.joint_names
        self.foot_names = () if contract.anatomy is None else contract.anatomy.foot_names
        self._maker = VendorMap(contract)
        motors = self.command_structure.dtype["motor_cmd"].shape[0]
        if len(self._maker.order) > motors:
            raise RobotError(f"{len(self._maker.order)} joints in the contract; {transport} has {motors} motors")
        self._held = self._maker.held
        if self._held.any() and (held.kp is None or held.kd is None):
            names = [name for name, is_held in zip(self._maker.order, self._held, strict=True) if is_held]
            raise ConfigurationError(
                f"the policy does not move {', '.join(names)}: give the gains that hold them, --held.kp and --held.kd"
            )
        self._held_kp, self._held_kd = held.kp or 0.0, held.kd or 0.0
        self.held_goal = self._maker.to_maker(np.zeros(len(self.joint_names)))
        """Goal of held joints, in the maker's numbers [rad], shape (M,); other entries have no meaning."""

    def read(self, data: bytes) -> np.ndarray:
        """Return the message in bytes from the robot; raise `ValueError` where it is invalid."""
        structure = self.state_structure
        message = structure.from_wire(data)
        if (right := structure.checksum(message)) != (crc := int(message["crc"])):
            why = "" if crc else "; unitree_mujoco in Python sends none, see the page Bringing up your robot"
            raise ValueError(f"checksum: got {crc}, expected {right}{why}")
        if structure is HG_STATE and message["mode_pr"] != PITCH_ROLL:
            raise ValueError(
                f"mode_pr is {message['mode_pr']}: its angles are of the motors A and B, not of pitch and roll"
            )
        return message

    def measured(self, message: np.ndarray) -> np.ndarray:
        """Return the angles of all joints, in the maker's numbers [rad], shape (M,)."""
        return message["motor_state"]["q"][: len(self._maker.order)].astype(float)

    def state(self, message: np.ndarray, number: int, at: float, command: float, age: float) -> RobotState:
        """Return the state in a message; number, at: its time [s], command, age [s]: as of `RobotState`."""
        motors, imu = message["motor_state"][: len(self._maker.order)], message["imu_state"]
        unknown = np.full(len(self.joint_names), np.nan)
        sensors = Sensors(
            quaternion=imu["quaternion"].astype(float),
            angular_velocity=imu["gyroscope"].astype(float),
            joint_position=self._maker.from_maker(self.measured(message)),
            joint_velocity=self._maker.rates_from_maker(motors["dq"].astype(float)),
        )
        if self.state_structure is GO_STATE:
            temperature, lost = motors["temperature"], self._maker.ours(motors["lost"].astype(float))
            fault = motors["reserve"][:, 0] + 256.0 * (message["bit_flag"] & MOTORS_TIMED_OUT)
            battery = float(message["power_v"])
        else:
            temperature, lost = motors["temperature"].max(axis=1), unknown
            fault, battery = motors["motorstate"].astype(float), np.nan
        return RobotState(
            number=number,
            time=at,
            sensors=sensors,
            acceleration=imu["accelerometer"].astype(float),
            joint_torque=self._maker.rates_from_maker(motors["tau_est"].astype(float)),
            temperature=self._maker.ours(temperature.astype(float)),
            lost=lost,
            motor_fault=self._maker.ours(fault),
            foot_contact=np.full(len(self.foot_names), np.nan),
            battery=battery,
            # Neither family reports the gains or limits of its drives.
            kp=unknown,
            kd=unknown,
            torque_limit=unknown,
            command=command,
            age=age,
        )

    def message(self, command: JointCommand, held: np.ndarray, mode_machine: int) -> np.ndarray:
        """Return the message of a command.

        held: angles of held joints, in the maker's numbers [rad], shape (M,); mode_machine: type that hg reports, and
        expects in commands.
        """
        structure, maker = self.command_structure, self._maker
        message = structure.blank()
        if structure is GO_COMMAND:
            message["head"], message["level_flag"] = HEAD, LOW_LEVEL
        else:
            message["mode_pr"], message["mode_machine"] = PITCH_ROLL, mode_machine
        motors, stiff = message["motor_cmd"][: len(maker.order)], command.kp.any()
        motors["mode"] = MOTOR_ON
        motors["q"] = np.where(self._held, held, maker.to_maker(command.target))
        motors["tau"] = maker.rates_to_maker(command.forward)
        # While the others are damped, held joints have their damping alone too.
        motors["kp"] = np.where(self._held, self._held_kp if stiff else 0.0, maker.theirs(command.kp))
        motors["kd"] = np.where(self._held, self._held_kd, maker.theirs(command.kd))
        message["crc"] = structure.checksum(message)
        return message


class UnitreeLink:
    """`Link` to one robot; sends nothing before a whole state has come."""

    def __init__(
        self, translation: Translation, bus: DdsBus, lock_name: str = "unitree", spare: Spare | None = None
    ) -> None:
        self.spare, self.writer = spare, bus.writer
        self._translation, self._bus = translation, bus
        self.joint_names, self.foot_names = translation.joint_names, translation.foot_names
        self.period, self.lock_name = PERIOD, lock_name
        self._newest: np.ndarray | None = None
        self._held: np.ndarray | None = None
        self._first: int | None = None
        self._time = self._held_at = 0.0
        self._states = self.number = self._ticks = 0
        self._commanded, self._ages, self.arrivals = False, Ages(), Arrivals()
        self.malformed, self.complaint = 0, ""

    def fileno(self) -> int:
        """Return the bus's file."""
        return self._bus.fileno()

    def receive(self) -> list[RobotState]:
        """Return the new and valid states, oldest first."""
        came, states = self._bus.receive(), []
        self.arrivals.counts.dropped += self._bus.lost()
        # Stored until a state carries it: the bus reports it once, and this call may bring no valid state.
        self._commanded = self._bus.foreign() or self._commanded
        command = FOREIGN if self._commanded else np.nan
        now = time.monotonic()
        for stamp, data in came:
            try:
                message = self._translation.read(data)
            except ValueError as error:
                self.malformed, self.complaint = self.malformed + 1, str(error)
                continue
            self._first = stamp if self._first is None else self._first
            # Back by up to half of all ticks is back; further is beyond the last one, where they begin again.
            ticks = self._ticks + (int(message["tick"]) - self._ticks + TICKS // 2) % TICKS - TICKS // 2
            # Subtracted as integers: nanoseconds since 1970 have more digits than a double.
            stamped = (stamp - self._first) * 1e-9
            at = self.arrivals.take(stamped, now, monotonic=TICK * ticks, content=data)
            if at is None:
                continue
            self._newest, self._time, self._ticks = message, at, ticks
            self._states += 1
            age = self._ages.age(self._time, now)
            states.append(self._translation.state(message, self._states, self._time, command, age))
        self._commanded = self._commanded and not states
        return states

    def peers(self) -> Peers:
        """Return the writers of the robot's states and the readers of its commands."""
        return self._bus.peers()

    def know(self, writer: str) -> None:
        """Count a participant as ours, see `Link.know`."""
        self._bus.know(writer)

    def send(self, command: JointCommand) -> int:
        """Send a command; return its number."""
        self.number += 1
        if self._newest is not None:
            held = self._hold(self._newest, bool(command.kp.any()))
            mode = 0 if self._translation.state_structure is GO_STATE else int(self._newest["mode_machine"])
            message = self._translation.message(command, held, mode)
            self._bus.send(self._translation.command_structure.to_wire(message))
        return self.number

    def _hold(self, newest: np.ndarray, stiff: bool) -> np.ndarray:
        """Return the commanded angles of held joints, in the maker's numbers [rad], shape (M,).

        They are on the way to their angles while the others are stiff, and where they are while these are damped.
        """
        elapsed, self._held_at = self._time - self._held_at, self._time
        if not stiff or self._held is None:
            self._held = self._translation.measured(newest)
        else:
            most = HELD_SPEED * min(max(elapsed, 0.0), HELD_STEP)
            self._held = self._held + np.clip(self._translation.held_goal - self._held, -most, most)
        return self._held

    def close(self) -> None:
        """Leave the bus."""
        self._bus.close()


def unitree_link(transport: str, interface: str, domain: int, contract: Contract, held: HeldCfg) -> UnitreeLink:
    """Return the link to the robot at a network interface, on a DDS domain; errors as of `Translation` and `DdsBus`."""
    translation = Translation(transport, contract, held)
    bus = DdsBus(interface, translation.state_structure, translation.command_structure, domain)
    spare = Spare(transport, {"interface": interface, "domain": domain, "held": vars(held)})
    return UnitreeLink(translation, bus, f"unitree-{interface}-{domain}", spare)
