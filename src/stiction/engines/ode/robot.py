"""A robot in ODE: bodies, hinges, and a motor a joint that is its motor, its rotor and its friction.

ODE knows neither rotor inertia nor friction in joints. Both are rows of its constraint solver here, which finds a
torque λ in each, within bounds, so that J v + cfm λ = rhs at the end of the step. With q' the joint's speed then, v its
speed at the start and τ the motor's torque:

    rotor      λ = τ - I (q' - v) / dt - B q', so cfm = 1 / (I/dt + B), rhs = cfm (τ + I v / dt), no bound
    friction   q' = 0, |λ| at most the bound: whatever holds the joint, and no more

so rotor and viscous friction are implicit in time, and λ is all that the motor gives to the link. The rows are the two
axes of one angular motor. Friction could be the hinge's own motor, but that shares its row with the limits of the
angle: at a limit ODE makes it a push against the stop.
"""

from __future__ import annotations

import ctypes

import numpy as np

from stiction.core.rotation import about_vector, cross, matrix
from stiction.engines.engine import Body
from stiction.engines.ode import library as c
from stiction.robots.model import Body as RigidBody

STATE = 3 + 4 + 3 + 3
"""Length of a body's state."""

LINK_AXIS = 1
"""Number of the body that turns an axis of a motor: the first body of the joint, the link behind it."""


class OdeRobot:
    """Bodies and joints of one robot in a world."""

    def __init__(self, library: ctypes.CDLL, world: int, body: Body, timestep: float) -> None:
        """Build a robot that passed `check_body`, the base at the origin, every joint in mid-range."""
        spec = body.spec
        lower, upper = spec.joint_values("lower"), spec.joint_values("upper")
        self._inertia = np.asarray(body.armature, float) / timestep
        self._softness = 1.0 / (self._inertia + body.damping)
        self._library, self._links = library, spec.links
        self._middle, self._com = (lower + upper) / 2, body.base_com
        self.base = self._add_link(world, spec.base)
        if body.fixed:
            library.dBodySetKinematic(self.base)
        self.links = [self._add_link(world, link) for link in self._links]
        """Bodies behind the joints, in the order of `Robot.joint_names`."""
        self._feedback = np.zeros((len(self.links), 2, 4, 4))
        joints = self._add_joints(world, (upper - lower) / 2)
        self._hinges, self._motors = [hinge for hinge, _ in joints], [motor for _, motor in joints]
        self._bodies = (self.base, *self.links)
        state = zip((library.dBodyGetPosition, library.dBodyGetQuaternion), (3, 4), strict=True)
        speeds = zip((library.dBodyGetLinearVel, library.dBodyGetAngularVel), (3, 3), strict=True)
        parts = (*state, *speeds)
        # Views of ODE's own memory: they follow the bodies, and one call for each in every step is saved.
        self._state = [np.ctypeslib.as_array(get(body), (count,)) for body in self._bodies for get, count in parts]
        self.angle, self.speed = self._middle.copy(), np.zeros(len(self.links))
        """Present angles and speeds of the joints [rad, rad/s], shape (J,). ODE's angle is zero in the middle of the
        range: it ends at ±π."""

    def place(self, angle: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Place the robot at rest: joint angles [rad], (J,), position [m] and orientation of the base's frame."""
        turns, origins = self._frames(np.asarray(angle, float), np.asarray(position, float), matrix(quaternion))
        self._put(self.base, origins[-1] + turns[-1] @ self._com, turns[-1])
        for body, link, turn, origin in zip(self.links, self._links, turns, origins, strict=False):
            self._put(body, origin + turn @ link.com, turn)
        # In place: ODE has the address of this memory and writes to it.
        self._feedback[:] = 0.0
        self.read()

    def drive(self, torque: np.ndarray, friction: np.ndarray) -> None:
        """Set torques of the motors and bounds of friction [N m], both (J,), for the coming step."""
        wanted = self._softness * (torque + self._inertia * self.speed)
        set_parameter = self._library.dJointSetAMotorParam
        for motor, speed, bound in zip(self._motors, wanted.tolist(), friction.tolist(), strict=True):
            set_parameter(motor, c.VELOCITY, speed)
            set_parameter(motor, c.SECOND_AXIS + c.FORCE_MAX, bound)

    def read(self) -> None:
        """Read angles and speeds of the joints from ODE."""
        angle, speed = self._library.dJointGetHingeAngle, self._library.dJointGetHingeAngleRate
        self.angle = self._middle + [angle(hinge) for hinge in self._hinges]
        self.speed = np.array([speed(hinge) for hinge in self._hinges])

    def speeds(self) -> tuple[np.ndarray, ...]:
        """Return the speeds of the joints [rad/s], (J,), and the base's velocities [m/s, rad/s], shape (3,) each."""
        return self.speed, *self._state[2:4]

    def state(self) -> np.ndarray:
        """Return a copy of the bodies' state, shape (bodies, 13): position, quaternion, velocity, angular velocity."""
        return np.concatenate(self._state).reshape(-1, STATE)

    def restore(self, state: np.ndarray) -> None:
        """Restore the bodies' state, as from `state`."""
        library = self._library
        for body, row in zip(self._bodies, state, strict=True):
            library.dBodySetPosition(body, *row[:3])
            library.dBodySetQuaternion(body, (ctypes.c_double * 4)(*row[3:7]))
            library.dBodySetLinearVel(body, *row[7:10])
            library.dBodySetAngularVel(body, *row[10:])

    def push(self, velocity: np.ndarray) -> None:
        """Add a velocity, x and y in the world [m/s], shape (2,), to that of every body."""
        for body, row in zip(self._bodies, self.state(), strict=True):
            # All bodies alike: were the base pushed alone, the joints would be torn.
            self._library.dBodySetLinearVel(body, row[7] + velocity[0], row[8] + velocity[1], row[9])

    def base_motion(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return position [m] and quaternion of the base's frame, and its velocities in it [m/s], [rad/s]."""
        # ODE's state is that of the centre of mass.
        centre, quaternion, velocity, angular_velocity = self._state[:4]
        rotation = matrix(quaternion)
        rate = angular_velocity @ rotation
        return centre - rotation @ self._com, quaternion.copy(), velocity @ rotation - cross(rate, self._com), rate

    def transmitted(self) -> tuple[np.ndarray, np.ndarray]:
        """Return |F| [N] and |T| [N m] of the hinge's constraint and the motor on the link in the last step, (J,)."""
        loads = np.linalg.norm(self._feedback[:, :, :2, :3].sum(axis=1), axis=-1)
        return loads[:, 0], loads[:, 1]

    def _add_link(self, world: int, link: RigidBody) -> int:
        """Return a new body with the mass and the inertia of a link."""
        body = self._library.dBodyCreate(world)
        x, y, z, xy, xz, yz = link.inertia
        rows = (x, xy, xz, 0, xy, y, yz, 0, xz, yz, z, 0)
        self._library.dBodySetMass(body, c.Mass(link.mass, (0, 0, 0, 0), rows))
        return body

    def _add_joints(self, world: int, half: np.ndarray) -> list[tuple[int, int]]:
        """Return hinge and motor of every joint, made where `place` puts the middle of the ranges.

        half: half the range of each joint [rad], shape (J,).
        """
        library, joints = self._library, []
        turns, origins = self._frames(self._middle, np.zeros(3), np.eye(3))
        self._put(self.base, self._com, np.eye(3))
        for number, link in enumerate(self._links):
            body, axis = self.links[number], turns[number] @ link.axis
            self._put(body, origins[number] + turns[number] @ link.com, turns[number])
            parent = self.base if link.parent < 0 else self.links[link.parent]
            hinge = library.dJointCreateHinge(world, None)
            library.dJointAttach(hinge, body, parent)
            library.dJointSetHingeAnchor(hinge, *origins[number])
            library.dJointSetHingeAxis(hinge, *axis)
            library.dJointSetHingeParam(hinge, c.LO_STOP, -half[number])
            library.dJointSetHingeParam(hinge, c.HI_STOP, half[number])
            motor = library.dJointCreateAMotor(world, None)
            library.dJointAttach(motor, body, parent)
            library.dJointSetAMotorNumAxes(motor, 2)
            library.dJointSetAMotorAxis(motor, 0, LINK_AXIS, *axis)
            library.dJointSetAMotorAxis(motor, 1, LINK_AXIS, *axis)
            library.dJointSetAMotorParam(motor, c.CFM, self._softness[number])
            library.dJointSetAMotorParam(motor, c.FORCE_MAX, np.inf)
            for joint, feedback in zip((hinge, motor), self._feedback[number], strict=True):
                library.dJointSetFeedback(joint, feedback.ctypes.data_as(ctypes.POINTER(c.Feedback)))
            joints.append((hinge, motor))
        return joints

    def _frames(
        self, angle: np.ndarray, position: np.ndarray, turn: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Return rotation and origin of every link's frame in the world, and after them, so at -1, of the base."""
        turns: list[np.ndarray] = [turn] * (len(self._links) + 1)
        origins: list[np.ndarray] = [position] * (len(self._links) + 1)
        for number, (link, turned) in enumerate(zip(self._links, angle, strict=True)):
            origins[number] = origins[link.parent] + turns[link.parent] @ link.origin
            turns[number] = turns[link.parent] @ matrix(about_vector(np.array(link.axis), turned))
        return turns, origins

    def _put(self, body: int, centre: np.ndarray, turn: np.ndarray) -> None:
        """Place a body at rest: its centre of mass [m], its rotation matrix."""
        library = self._library
        library.dBodySetPosition(body, *centre)
        library.dBodySetRotation(body, (ctypes.c_double * 12)(*np.column_stack((turn, np.zeros(3))).ravel()))
        library.dBodySetLinearVel(body, 0.0, 0.0, 0.0)
        library.dBodySetAngularVel(body, 0.0, 0.0, 0.0)
