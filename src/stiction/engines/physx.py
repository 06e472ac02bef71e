"""Robot in PhysX 5.3, by the package sapien: an articulation in reduced coordinates, on the processor, float32.

Joint friction in PhysX 5.3 multiplies the joint's load without contacts (`stiction.sim.fleet`); it is set to zero. Dry
friction is a drive instead: its target is velocity zero and its torque limit the bound. Motor torque and viscous
friction are joint forces, computed from the state before the step. Armature is the engine's.

A reset builds the scene anew: PhysX keeps contacts and solver caches from step to step, and the same robot would not
repeat its motion.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from stiction.core.errors import EngineError
from stiction.core.rotation import UPRIGHT, about, cross_matrix, into_frame, matrix, product
from stiction.engines.engine import FASTEST, TOUCH, Body, Motion, check_speed
from stiction.engines.ground import Ground
from stiction.robots.model import GRAVITY
from stiction.robots.shapes import Contact, Shape

BRAKE = 1e5
"""Damping of the drive for dry friction [N m s/rad]: below its bound a joint creeps by the torque over this."""

ITERATIONS = (50, 1)
"""Position and velocity iterations of the solver, PGS: with fewer the locked joints of a standing robot creep faster,
as with equally many of TGS, sapien's default."""

CAP = 10 * FASTEST
"""Maximum velocity of a link [m/s, rad/s]; sapien's default would limit a free fall to 10 m/s."""

FEET_AND_TRUNK, OBSTACLE, SHANK = (1, 1), (2, 3), (2, 0)
BITS: dict[Contact, tuple[int, int]] = {"ground": FEET_AND_TRUNK, "obstacles": SHANK}
"""Collision bits of a shape: its categories, and those that it meets; two shapes touch if a bit of one's first is in
the other's second."""

ALONG_X = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])
"""Rotation of a capsule or cylinder: along x in PhysX, along z in a `Shape`."""


def sapien() -> Any:
    """Return the package sapien, without its warning about missing renderers."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import sapien
    return sapien


class PhysxEngine:
    """`Engine` on PhysX."""

    name = "physx"

    def __init__(self, body: Body, ground: Ground, timestep: float) -> None:
        """Build the robot on its ground, the base at the origin; `timestep` of the physics [s].

        Raises `StictionError` for an unsupported ground friction.
        """
        self._sapien = sapien()
        if not 0 <= body.ground_friction <= 2:
            raise EngineError(f"ground friction {body.ground_friction}; the engine 'physx' takes 0 to 2")
        self.body, self.ground, self.timestep = body, ground, timestep
        self._lever = cross_matrix(np.array(body.base_com))
        self.reset(body.spec.joint_values("default_position"), np.zeros(3), UPRIGHT)

    def reset(self, joint_position: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Place the robot at rest; see `Engine.reset`."""
        physx = self._sapien.physx
        physx.set_scene_config(gravity=np.array([0.0, 0.0, -GRAVITY], np.float32), enable_tgs=False)
        self._system = physx.PhysxCpuSystem()
        self._system.timestep = self.timestep
        self._scene = self._sapien.Scene([self._system])
        # PhysX averages the coefficients of what touches: on this ground feet get theirs, and all else gets 1.
        mu = self.body.ground_friction
        self._rubber = physx.PhysxMaterial(mu, mu, 0.0)
        self._hull = physx.PhysxMaterial(2.0 - mu, 2.0 - mu, 0.0)
        self._add_ground()
        self._add_robot(position, quaternion)
        angles = np.empty(len(self._order), np.float32)
        angles[self._order] = joint_position
        self._robot.set_qpos(angles)
        self._friction = np.zeros(len(self._order))
        self._stepped = False

    def _add_ground(self) -> None:
        """Add plane and boxes."""
        physx, pose = self._sapien.physx, self._sapien.Pose
        ground = physx.PhysxRigidStaticComponent()
        plane = physx.PhysxCollisionShapePlane(self._rubber)
        # A plane of PhysX looks along its x axis.
        plane.set_local_pose(pose(q=[np.sqrt(0.5), 0.0, -np.sqrt(0.5), 0.0]))
        _attach(ground, plane, FEET_AND_TRUNK)
        boxes = self.ground.half_sizes, self.ground.positions, self.ground.quaternions
        for half, place, turn in zip(*boxes, strict=True):
            box = physx.PhysxCollisionShapeBox(half, self._rubber)
            box.set_local_pose(pose(p=place, q=turn))
            _attach(ground, box, OBSTACLE)
        self._ground_shapes = set(ground.get_collision_shapes())
        entity = self._sapien.Entity()
        entity.add_component(ground)
        self._scene.add_entity(entity)

    def _add_robot(self, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Add the robot in its zero position; record the order of its joints and feet in PhysX."""
        body, spec, pose = self.body, self.body.spec, self._sapien.Pose
        builder = self._scene.create_articulation_builder()
        base = builder.create_link_builder()
        moments, axes = spec.base.principal
        base.set_mass_and_inertia(spec.base.mass, pose(p=body.base_com, q=axes), moments)
        built: list[Any] = []
        for joint, link in zip(spec.joints, spec.links, strict=True):
            part = builder.create_link_builder(built[link.parent] if link.parent >= 0 else base)
            part.set_joint_name(joint.name)
            moments, axes = link.principal
            part.set_mass_and_inertia(link.mass, pose(p=link.com, q=axes), moments)
            # A hinge of PhysX turns about the x axis of its frame.
            turn = _turn_to(link.axis)
            frames = pose(p=link.origin, q=turn), pose(q=turn)
            part.set_joint_properties("revolute_unwrapped", [[-1.0, 1.0]], *frames)
            built.append(part)
        builder.set_initial_pose(pose(p=position, q=quaternion))
        self._robot = robot = builder.build(fix_root_link=body.fixed)
        robot.set_solver_position_iterations(ITERATIONS[0])
        robot.set_solver_velocity_iterations(ITERATIONS[1])
        # PhysX puts to sleep what stands still, and then does not simulate it.
        robot.set_sleep_threshold(0.0)
        for part in robot.get_links():
            part.set_linear_damping(0.0)
            part.set_angular_damping(0.0)
            part.set_max_linear_velocity(CAP)
            part.set_max_angular_velocity(CAP)
        joints = {joint.name: (number, joint) for number, joint in enumerate(robot.get_active_joints())}
        # PhysX numbers the joints breadth first.
        self._order = np.array([joints[name][0] for name in spec.joint_names])
        self._joints = [joints[name][1] for name in spec.joint_names]
        self._links = [joint.child_link for joint in self._joints]
        self._rows = np.array([link.index for link in self._links])
        centres = [into_frame(_turn_to(link.axis), np.array(link.com)) for link in spec.links]
        self._centres = np.array([cross_matrix(centre) for centre in centres])
        lower, upper = spec.joint_values("lower"), spec.joint_values("upper")
        for number, joint in enumerate(self._joints):
            joint.set_limits(np.array([[lower[number], upper[number]]], np.float32))
            joint.set_armature(np.array([body.armature[number]], np.float32))
            # Its own, which multiplies the load, is 0.05 by default.
            joint.set_friction(0.0)
            joint.set_max_velocity(CAP)
            joint.set_drive_properties(0.0, BRAKE, 0.0, "force")
        self._add_shapes()

    def _add_shapes(self) -> None:
        """Add the contact shapes of the robot, and record its feet."""
        spec = self.body.spec
        for shape in spec.base.shapes:
            self._add_shape(self._robot.get_root(), shape, self._hull)
        self._feet: dict[Any, int] = {}
        for number, (link, component) in enumerate(zip(spec.links, self._links, strict=True)):
            for shape in link.shapes:
                self._add_shape(component, shape, self._hull)
            for foot, foot_spec in enumerate(spec.feet):
                if foot_spec.link == number:
                    self._feet |= {self._add_shape(component, shape, self._rubber): foot for shape in foot_spec.shapes}

    def _add_shape(self, component: Any, shape: Shape, material: Any) -> Any:
        """Attach one shape if it has contacts, and return it."""
        if shape.contact == "nothing":
            return None
        physx, (a, b, c) = self._sapien.physx, shape.size
        quaternion = np.array(shape.quaternion)
        if shape.kind == "sphere":
            built = physx.PhysxCollisionShapeSphere(a, material)
        elif shape.kind == "box":
            built = physx.PhysxCollisionShapeBox([a, b, c], material)
        elif shape.kind == "hull":
            corners = np.array(shape.vertices, np.float32)
            built = physx.PhysxCollisionShapeConvexMesh(corners, np.ones(3, np.float32), material)
        else:
            make = physx.PhysxCollisionShapeCapsule if shape.kind == "capsule" else physx.PhysxCollisionShapeCylinder
            built, quaternion = make(a, b, material), product(quaternion, ALONG_X)
        built.set_local_pose(self._sapien.Pose(p=shape.position, q=quaternion))
        _attach(component, built, BITS[shape.contact])
        return built

    def step(self, torque: np.ndarray, friction: np.ndarray) -> None:
        """Advance by one timestep; see `Engine.step`."""
        forces = np.empty(len(self._order), np.float32)
        forces[self._order] = torque - self.body.damping * self._robot.get_qvel()[self._order]
        self._robot.set_qf(forces)
        for number in np.flatnonzero(friction != self._friction):
            self._joints[number].set_drive_properties(0.0, BRAKE, float(friction[number]), "force")
        self._friction = np.array(friction, float)
        self._system.step()
        self._stepped = True
        robot = self._robot
        check_speed(self.name, robot.get_qvel(), robot.get_root_linear_velocity(), robot.get_root_angular_velocity())

    def push(self, velocity: np.ndarray) -> None:
        """Push the robot; see `Pushable.push`."""
        if not self.body.fixed:
            speed = self._robot.get_root_linear_velocity() + np.array([*velocity, 0.0])
            self._robot.set_root_linear_velocity(speed.astype(np.float32))

    def friction_torque(self) -> np.ndarray:
        """Return the torque of the drive for dry friction; see `FrictionSensing`.

        PhysX takes it from the velocity at the end of the step, as is done here.
        """
        velocity = self._robot.get_qvel()[self._order].astype(float)
        return -np.clip(BRAKE * velocity, -self._friction, self._friction)

    def motion(self, loads: bool = True) -> Motion:
        """Return the present motion; see `Motion`."""
        robot = self._robot
        pose = robot.get_root_pose()
        quaternion = np.array(pose.q, float)
        turn = matrix(quaternion)
        rate = robot.get_root_angular_velocity().astype(float) @ turn
        # What PhysX calls the velocity of a link is that of its centre of mass: v = v_com + r_com × ω.
        velocity = robot.get_root_linear_velocity().astype(float) @ turn + self._lever @ rate
        force, torque = self._transmitted() if loads else np.zeros((2, len(self._order)))
        return Motion(
            base_position=np.array(pose.p, float),
            base_quaternion=quaternion,
            base_linear_velocity=velocity,
            base_angular_velocity=rate,
            joint_position=robot.get_qpos()[self._order].astype(float),
            joint_velocity=robot.get_qvel()[self._order].astype(float),
            foot_contact=self._pushes() >= TOUCH,
            joint_force=force,
            joint_torque=torque,
        )

    def _pushes(self) -> np.ndarray:
        """Return the normal force on each foot in the last step [N], shape (legs,)."""
        push = np.zeros(len(self.body.spec.feet))
        if not self._stepped:
            return push
        for contact in self._system.get_contacts():
            first, second = contact.shapes
            foot = first if second in self._ground_shapes else second
            if foot in self._feet and not self._ground_shapes.isdisjoint((first, second)):
                push[self._feet[foot]] += sum(abs(float(point.impulse @ point.normal)) for point in contact.points)
        return push / self.timestep

    def contact_forces(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the forces of the contacts with the ground; see `ContactSensing`."""
        forces = []
        for contact in self._system.get_contacts() if self._stepped else ():
            ground = [shape in self._ground_shapes for shape in contact.shapes]
            if any(ground):
                # PhysX gives the impulse on the first shape.
                sign = -1.0 if ground[0] else 1.0
                forces += [(point.position, sign * point.impulse / self.timestep) for point in contact.points]
        return forces

    def _transmitted(self) -> tuple[np.ndarray, np.ndarray]:
        """Return |F| and |T| of every joint in the last step [N, N m], shape (J,) each.

        PhysX gives both in the frame of the joint, the torque about the joint. About the centre of mass of the link,
        which is at r in that frame, it is T - r x F.
        """
        wrench = self._robot.get_link_incoming_joint_forces()[self._rows].astype(float)
        force, torque = wrench[:, :3], wrench[:, 3:]
        torque = torque - np.matmul(self._centres, force[:, :, None])[..., 0]
        return np.sqrt(np.square(force).sum(-1)), np.sqrt(np.square(torque).sum(-1))


def _attach(component: Any, shape: Any, bits: tuple[int, int]) -> None:
    """Add a shape with collision bits to a body."""
    shape.set_collision_groups([*bits, 0, 0])
    component.attach(shape)


def _turn_to(axis: Sequence[float]) -> np.ndarray:
    """Return a quaternion that turns the x axis to a unit vector, shape (4,)."""
    x, y, z = axis
    if z == 0.0:
        return about(2, np.arctan2(y, x))
    return product(about(2, np.arctan2(y, x)), about(1, -np.arcsin(np.clip(z, -1.0, 1.0))))
