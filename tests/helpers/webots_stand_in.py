"""A stand-in of Webots' Python module `controller`: the devices of an exported robot, moved by whatever a test wants.

It behaves as the documents say (docs/reference of https://github.com/cyberbotics/webots): a sensor has no value before
it is enabled and a step has passed; a torque beyond `maxTorque` is refused here, where Webots warns and clips it; the
step is the world's; a device that does not exist is None.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np

from webots_files import Read


class Physics(Protocol):
    """Physics of the robot."""

    def step(self, torque: dict[str, float]) -> bool:
        """Take a physics step under the torques set so far [N m]; False where Webots ends."""

    def angles(self) -> dict[str, float]:
        """Return name of the joint -> angle from the standing pose [rad]."""

    def trunk(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return place [m], orientation w x y z, and angular velocity in the trunk's frame [rad/s]."""


class Device:
    """A device; a sensor's period is None until it is enabled."""

    def __init__(self, robot: Robot, name: str) -> None:
        self.robot, self.name, self.period = robot, name, None

    def enable(self, milliseconds: int) -> None:
        """Measure from the next step on, every so often."""
        assert isinstance(milliseconds, int)
        self.period = milliseconds

    def _read(self, values: Any) -> Any:
        """Return values, all NaN before the sensor can have any."""
        seen = self.period is not None and self.robot.steps > 0
        return values if seen else [math.nan] * len(values)


class Motor(Device):
    """A motor under torque control."""

    def __init__(self, robot: Robot, name: str, limit: float) -> None:
        super().__init__(robot, name)
        self._limit = limit

    def getMaxTorque(self) -> float:
        """Return `maxTorque` [N m]."""
        return self._limit

    def setTorque(self, torque: float) -> None:
        """Set the torque from the next step on [N m]."""
        assert isinstance(torque, float) and abs(torque) <= self._limit
        self.robot.torque[self.name] = torque


class PositionSensor(Device):
    """The sensor of a joint's angle, from the standing pose."""

    def getValue(self) -> float:
        """Return the angle [rad]."""
        return self._read([self.robot.angles.get(self.name.removesuffix("_sensor"), math.nan)])[0]


class InertialUnit(Device):
    """The sensor of the trunk's orientation in the world."""

    def getQuaternion(self) -> list[float]:
        """Return x y z w."""
        w, x, y, z = self.robot.trunk[1]
        return self._read([x, y, z, w])


class Gyro(Device):
    """The sensor of the trunk's angular velocity, in its frame."""

    def getValues(self) -> list[float]:
        """Return x y z [rad/s]."""
        return self._read(list(self.robot.trunk[2]))


class GPS(Device):
    """The sensor of the trunk's place in the world."""

    def getValues(self) -> list[float]:
        """Return x y z [m]."""
        return self._read(list(self.robot.trunk[0]))


class Receiver(Device):
    """Receiver of the physics plugin's messages, one per step."""

    def getQueueLength(self) -> int:
        """Return how many messages wait."""
        return self.robot.steps if self.robot.plugin and self.period else 0

    def disable(self) -> None:
        """Take no more messages."""
        self.period = None


SENSORS = {made.__name__: made for made in (PositionSensor, InertialUnit, Gyro, GPS, Receiver)}


class Robot:
    """Webots' `Robot`, with the devices of a robot that was read from a world."""

    def __init__(self, robot: Read, timestep: float, physics: Physics, plugin: bool = True) -> None:
        """timestep: the world's `basicTimeStep` [ms]; plugin: whether the physics plugin acts."""
        self.timestep, self.physics, self.plugin = timestep, physics, plugin
        self.steps, self.torque = 0, {}
        self.angles: dict[str, float] = {}
        self.trunk = np.full(3, math.nan), np.full(4, math.nan), np.full(3, math.nan)
        motors = [Motor(self, node["name"], node["maxTorque"]) for node in robot.every("RotationalMotor")]
        sensors = [made(self, node["name"]) for kind, made in SENSORS.items() for node in robot.every(kind)]
        self.devices = {device.name: device for device in (*motors, *sensors)}

    def getBasicTimeStep(self) -> float:
        """Return the world's step [ms]."""
        return self.timestep

    def getDevice(self, name: str) -> Device | None:
        """Return a device by its name, None where there is none."""
        return self.devices.get(name)

    def step(self, milliseconds: int) -> int:
        """Let time pass; return -1 where Webots ends the program."""
        assert isinstance(milliseconds, int) and milliseconds == self.timestep
        self.steps += 1
        goes_on = self.physics.step(self.torque)
        self.angles, self.trunk = self.physics.angles(), self.physics.trunk()
        return 0 if goes_on else -1


class Playback:
    """Physics that repeats recorded sensors: the joints arrive at each control step at the recorded angle and rate."""

    def __init__(
        self, joint_names: tuple[str, ...], standing: np.ndarray, timestep: float, decimation: int, record
    ) -> None:
        """`timestep`: of the physics [s]; `record`: golden vectors of one walk, at least one step."""
        self.names, self.standing, self.timestep, self.decimation = joint_names, standing, timestep, decimation
        self.record, self.taken = record, 0

    @property
    def now(self) -> int:
        """Number of the recorded step that is on, or comes next; the first physics step is before the first."""
        return min(max(-(-(self.taken - 2) // self.decimation), 0), len(self.record.time) - 1)

    def step(self, torque: dict[str, float]) -> bool:
        """Go on by a physics step; end with the last recorded one."""
        self.taken += 1
        return self.taken - 2 <= (len(self.record.time) - 1) * self.decimation

    def angles(self) -> dict[str, float]:
        """Return the recorded angles at control steps, and before them where the recorded rate came from."""
        late = self.now * self.decimation - (self.taken - 2)
        position = self.record.joint_position[self.now] - late * self.timestep * self.record.joint_velocity[self.now]
        return dict(zip(self.names, (position - self.standing).tolist(), strict=True))

    def trunk(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return a fixed place, and the recorded orientation and angular velocity."""
        return np.zeros(3), self.record.quaternion[self.now], self.record.angular_velocity[self.now]
