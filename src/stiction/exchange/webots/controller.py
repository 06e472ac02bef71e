"""Controller program of the robot in a Webots world, by a policy bundle. Not run in Webots.

`stiction export --to webots` copies this file, as it is, into the project, beside the bundle. It needs the base install
of stiction (NumPy and onnxruntime, neither torch nor a simulator) and is started from outside of Webots:

    $WEBOTS_HOME/webots-controller controllers/stiction_policy/stiction_policy.py --command vx=0.5

The policy acts once every control period, from the bundle alone. The joint controller runs here, at every physics
step: torque = kp (target - angle) - kd velocity, clipped to the motor's limit, by `setTorque`. Webots' own position
control is not used: under it the friction of the joints does nothing (cyberbotics/webots#2483).

What Webots measures (docs/reference of https://github.com/cyberbotics/webots):

* `InertialUnit.getQuaternion`: x y z w, of the device in the world (ENU); the policy takes w x y z. `Gyro.getValues`:
  in the device's frame [rad/s]. Both sit in the trunk's frame: x forward, y left, z up.
* `PositionSensor.getValue` [rad] counts from the standing pose. Velocities are its differences over one physics step,
  which is what ODE turned the joint by in that step: there is no sensor for them, and no noise in the angle.
* `GPS.getValues`: where the trunk is in the world [m]. Its first height is taken for that of standing. No ground of the
  project is lower than that under the start; over stairs a trunk may lie lower over its step than this tells.
* Values are there after the first step. Until a torque is set the motors hold the pose that the world gives them.
"""

from __future__ import annotations

import importlib
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import EngineError, PolicyError, StictionError
from stiction.core.options import read_options
from stiction.core.rotation import yaw
from stiction.deploy.check import check_bundle
from stiction.deploy.control import ControlLoop
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import Policy, load_policy
from stiction.evaluation.course import SETTLE
from stiction.files.bundle import Bundle
from stiction.files.contract import Contract
from stiction.files.velocity import Command, parse_command
from stiction.robots.model import leans_too_far, too_low
from stiction.task.terrain import TerrainCfg, hold_heading


class Odometer:
    """Velocity reached, over control periods: of the place in the heading's frame, and the yaw rate."""

    def __init__(self, period: float) -> None:
        """Start without a place; period: between two calls of `add` [s]."""
        self._period = period
        self._velocity: list[tuple[float, float, float]] = []
        self._last: np.ndarray | None = None

    def add(self, place: np.ndarray, sensors: Sensors) -> None:
        """Note the robot's place, (3,) [m]."""
        if self._last is not None:
            along, across = (place - self._last)[:2] / self._period
            facing = yaw(sensors.quaternion)
            cosine, sine = np.cos(facing), np.sin(facing)
            turn = float(sensors.angular_velocity[2])
            self._velocity.append((cosine * along + sine * across, cosine * across - sine * along, turn))
        self._last = place

    def speed(self, command: Command) -> float | None:
        """Return the mean speed along the command [m/s], or [rad/s]; None where none is commanded or measured."""
        first = round(SETTLE / self._period)
        if command.direction is None or len(self._velocity) <= first:
            return None
        return float((np.array(self._velocity[first:]) @ command.direction).mean())


IMU, GYRO, GPS, RECEIVER, SENSOR = "imu", "gyro", "gps", "plugin", "_sensor"
"""Names of the devices; a joint's sensor is called like the joint and `SENSOR`, its motor like the joint."""

PLUGIN, CHANNEL = "rotor_inertia", 1
"""Physics plugin, and the channel on which it reports in every step."""

PATIENCE = 10
"""Physics steps within which the plugin must report."""


@dataclass(frozen=True)
class ControllerCfg:
    """Command and length of the walk."""

    command: str = "vx=0.5"
    """Commanded velocity, vx forward, vy sideways [m/s], wz turn [rad/s]: vx=0.5 or vx=0.3,wz=0.2 or stand."""
    hold_heading: bool = False
    """Correct the heading back to that of the start, as a pilot would: for stairs."""
    seconds: float = 20.0
    """Length of the walk [s]; the first 2 s are not measured."""


class Devices:
    """Motors and sensors of the robot in Webots, in the order of the contract."""

    def __init__(self, robot: Any, contract: Contract) -> None:
        """Find the devices and enable the sensors.

        robot: Webots' `Robot`. Raises `StictionError` where a device is missing, a motor has another limit, or the
        world has another physics step than the contract.
        """
        self.milliseconds = round(1000 * contract.physics_timestep)
        self._robot, self._timestep = robot, contract.physics_timestep
        if robot.getBasicTimeStep() != self.milliseconds:
            raise EngineError(
                f"the world's basicTimeStep is {robot.getBasicTimeStep():g} ms; this policy was trained with "
                f"{self.milliseconds} ms, and the physics plugin is built for it; set it back"
            )
        self.motors = [self._device(name) for name in contract.joint_names]
        for name, motor, limit in zip(contract.joint_names, self.motors, contract.torque_limit, strict=True):
            # To the last digit, since the PROTO has all of them.
            if motor.getMaxTorque() != limit:
                raise EngineError(
                    f"the motor {name} has a maxTorque of {motor.getMaxTorque():g} N m, the policy's robot {limit:g}; "
                    "set it back, or export the project again"
                )
        self._angles = [self._sensor(name + SENSOR) for name in contract.joint_names]
        self._imu, self._gyro, self._gps, self._receiver = map(self._sensor, (IMU, GYRO, GPS, RECEIVER))
        self._heard = False
        self._standing = contract.array("standing")
        self._last: np.ndarray | None = None

    def _device(self, name: str) -> Any:
        """Return a device by its name."""
        device = self._robot.getDevice(name)
        if device is None:
            raise EngineError(f"the robot in Webots has no device {name!r}; is it the one of this project?")
        return device

    def _sensor(self, name: str) -> Any:
        """Return a sensor by its name, enabled."""
        sensor = self._device(name)
        sensor.enable(self.milliseconds)
        return sensor

    def sense(self) -> Sensors:
        """Return the robot's present readings; to be called once after every physics step.

        The first call has no velocities of the joints yet: they are zero.
        """
        position = self._standing + [sensor.getValue() for sensor in self._angles]
        velocity = np.zeros(len(position)) if self._last is None else (position - self._last) / self._timestep
        self._last = position
        return Sensors(
            # Webots has w last.
            quaternion=np.roll(self._imu.getQuaternion(), 1),
            angular_velocity=np.array(self._gyro.getValues(), float),
            joint_position=position,
            joint_velocity=velocity,
        )

    def listen(self, steps: int) -> None:
        """Check that the physics plugin acts; raise `StictionError` where it was silent for `PATIENCE` steps.

        steps: physics steps so far, from 0 on in each call.
        """
        self._heard = self._heard or (steps <= PATIENCE and self._receiver.getQueueLength() > 0)
        if steps == PATIENCE:
            if not self._heard:
                raise EngineError(
                    f"the physics plugin {PLUGIN} says nothing, so the joints have no rotor inertia: build it (make in "
                    f"plugins/physics/{PLUGIN}), open the world again, and read what the console says of it"
                )
            # The queue is not read from here on, and would grow at every step.
            self._receiver.disable()

    def place(self) -> np.ndarray:
        """Return the trunk's place in the world [m], shape (3,)."""
        return np.array(self._gps.getValues(), float)

    def set_torque(self, torque: np.ndarray) -> None:
        """Set the motors' torques for the coming physics step [N m], shape (J,)."""
        for motor, value in zip(self.motors, torque.tolist(), strict=True):
            motor.setTorque(value)


class PolicyLoop:
    """Loop of the policy, once every control period, and of the joint controller, at every physics step."""

    def __init__(self, contract: Contract, policy: Policy) -> None:
        """Start with the policy due."""
        self.contract, self.policy = contract, policy
        self._loop, self._limit = ControlLoop(policy, contract), contract.array("torque_limit")
        self.target = contract.array("standing")
        """Joint targets, held over the control period [rad], shape (J,)."""
        self.steps = 0
        """Physics steps so far."""

    @property
    def due(self) -> bool:
        """True if the policy acts at the coming physics step."""
        return self.steps % self.contract.decimation == 0

    def torque(self, sensors: Sensors, command: np.ndarray) -> np.ndarray:
        """Return the torques of the coming physics step [N m], shape (J,).

        sensors: present readings; command: forward, sideways [m/s], turn [rad/s], shape (3,). Raises `PolicyError` for
        values that are not finite.
        """
        if self.due:
            self.target = self._loop.act(sensors, command).target
        self.steps += 1
        angle, speed = sensors.joint_position, sensors.joint_velocity
        asked = self._loop.command(angle, speed)
        wanted = asked.kp * (asked.target - angle) - asked.kd * speed + asked.forward
        if not np.isfinite(wanted).all():
            raise PolicyError("a joint's angle is not finite (NaN or infinite); did the simulation blow up?")
        return np.clip(wanted, -self._limit, self._limit)


def walk(robot: Any, bundle: Bundle, cfg: ControllerCfg) -> str:
    """Walk until time is up, the robot falls or Webots ends the program; return the result in one line.

    It has fallen where its trunk leans too far, or is too low over the ground at its start.

    Raises `StictionError` where world and bundle do not fit, the plugin is silent, or a sensor is not finite.
    """
    contract, command = bundle.contract, parse_command(cfg.command)
    devices, loop = Devices(robot, contract), PolicyLoop(contract, load_policy(contract, bundle.policy))
    odometer, end = Odometer(contract.control_period), "stopped by Webots"
    start: tuple[float, float] | None = None
    if robot.step(devices.milliseconds) != -1:
        devices.sense()  # Velocities are differences: they need a sample before the first.
    while robot.step(devices.milliseconds) != -1:
        devices.listen(loop.steps)
        sensors, place = devices.sense(), devices.place()
        if start is None:
            start = yaw(sensors.quaternion), place[2]
        first, stood = start
        if leans_too_far(sensors.quaternion) or too_low(place[2], stood):
            end = "fell"
            break
        if loop.due:
            odometer.add(place, sensors)
            if loop.steps * contract.physics_timestep >= cfg.seconds:
                end = "done"
                break
        velocity = np.array(command.velocity)
        if cfg.hold_heading:
            error = np.array(first - yaw(sensors.quaternion))
            velocity[2] += hold_heading(error, TerrainCfg.heading_gain)
        devices.set_torque(loop.torque(sensors, velocity))
    seconds, speed = loop.steps * contract.physics_timestep, odometer.speed(command)
    reached = "" if speed is None else f", {speed:.3f} along the command, {speed / command.speed:.2f} of it"
    return f"{command.label}: {end} after {seconds:.2f} s{reached}"


def webots_robot() -> Any:
    """Return Webots' `Robot`; raise `StictionError` where this file was not started by Webots or its launcher."""
    try:
        module = importlib.import_module("controller")
    except ModuleNotFoundError as error:
        raise EngineError(
            "Webots' Python module `controller` is not on the path; start this file with $WEBOTS_HOME/webots-controller"
        ) from error
    return module.Robot()


def main(arguments: list[str]) -> int:
    """Check the bundle next to this file, drive the robot, print the result; return the exit status."""
    try:
        cfg = read_options(ControllerCfg, arguments, Path(__file__).name, str(ControllerCfg.__doc__))
        bundle = check_bundle(Path(__file__).parent / "bundle").bundle
        print(walk(webots_robot(), bundle, cfg))
    except StictionError as error:
        print(f"{Path(__file__).name}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
