"""ODE as Webots sets it up, from a world that was read from its file: the nearest to running Webots that there is here.

Written after src/webots of https://github.com/cyberbotics/webots, in the places named below, against ODE 0.16 (Webots
has a fork of it). The physics plugin is the exported one, compiled. What is not here: everything that is not physics.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from ctypes import c_double, c_int, c_void_p
from importlib import metadata
from typing import Any

import numpy as np
import pytest

from webots_files import Read
from webots_kinematics import Placed, place, touched

LO_STOP, HI_STOP, VELOCITY, FORCE_MAX, STOP_ERP, STOP_CFM = 0, 1, 2, 5, 9, 10
"""dParamLoStop, ... of ODE 0.16."""

CONTACT_MODE = 0x004 | 0x008 | 0x010 | 0x7000
"""dContactBounce | SoftERP | SoftCFM | Approx1 (WbSimulationCluster.cpp, fillSurfaceParameters)."""

SOFT_CFM, SOFT_ERP, WORLD_CFM, WORLD_ERP = 1e-3, 0.2, 1e-5, 0.2
"""Defaults of ContactProperties and WorldInfo."""

CONTROL_P, MAX_VELOCITY = 10.0, 10.0
"""Defaults of RotationalMotor: they hold the joints until a torque is set."""

CONTACTS = 10
"""Most contacts of two shapes, the default of ContactProperties."""

Vector = c_double * 4


class Surface(ctypes.Structure):
    """dSurfaceParameters."""

    _fields_ = (("mode", c_int), *((name, c_double) for name in ("mu", "mu2", "rho", "rho2", "rho_n", "bounce")))
    _fields_ += tuple((name, c_double) for name in ("bounce_vel", "soft_erp", "soft_cfm", "motion1", "motion2"))
    _fields_ += tuple((name, c_double) for name in ("motion_n", "slip1", "slip2"))


class Geometry(ctypes.Structure):
    """dContactGeom."""

    _fields_ = (
        *(("position", Vector), ("normal", Vector), ("depth", c_double), ("first", c_void_p), ("second", c_void_p)),
        *(("side1", c_int), ("side2", c_int)),
    )


class Contact(ctypes.Structure):
    """dContact."""

    _fields_ = (("surface", Surface), ("geometry", Geometry), ("direction", Vector))


FUNCTIONS = {
    "p": "dWorldCreate dGeomGetBody:p dBodyCreate:p dJointCreateHinge:pp dJointCreateAMotor:pp "
    "dJointCreateContact:ppp dJointGroupCreate:i dCreateBox:pddd dCreateSphere:pd dCreateCapsule:pdd "
    "dBodyGetPosition:p dBodyGetQuaternion:p dBodyGetAngularVel:p",
    "d": "dJointGetHingeAngle:p dJointGetHingeAngleRate:p",
    "i": "dInitODE2:i dWorldStep:pd dCollide:ppipi dBodyGetNumJoints:p",
    "": "dWorldSetGravity:pddd dWorldSetCFM:pd dWorldSetERP:pd dMassSetParameters:pdddddddddd "
    "dBodySetMass:pp dBodySetPosition:pddd dBodySetRotation:pp dJointAttach:ppp dJointSetHingeAnchor:pddd "
    "dJointSetHingeAxis:pddd dJointSetHingeParam:pid dJointAddHingeTorque:pd dJointSetAMotorNumAxes:pi "
    "dJointSetAMotorMode:pi dJointSetAMotorAxis:piiddd dJointSetAMotorAngle:pid dJointSetAMotorParam:pid "
    "dGeomSetBody:pp dGeomSetOffsetPosition:pddd dGeomSetOffsetRotation:pp dGeomSetPosition:pddd "
    "dJointGroupEmpty:p",
}
"""Result -> functions and their arguments: p pointer, d double, i int."""

TYPES: dict[str, Any] = {"p": c_void_p, "d": c_double, "i": c_int, "": None}


def ode_or_skip() -> ctypes.CDLL:
    """Return ODE, from the system or from the wheel of dartpy, its functions open to the plugin; skip without it."""
    for name in _candidates():
        try:
            library = ctypes.CDLL(name, mode=ctypes.RTLD_GLOBAL)
        except OSError:
            continue
        library.dGetConfiguration.restype = ctypes.c_char_p
        if b"ODE_double_precision" in library.dGetConfiguration():
            for result, functions in FUNCTIONS.items():
                for function, _, arguments in (entry.partition(":") for entry in functions.split()):
                    getattr(library, function).restype = TYPES[result]
                    getattr(library, function).argtypes = [TYPES[argument] for argument in arguments]
            library.dInitODE2(0)
            library.dAllocateODEDataForThread(1)
            return library
    pytest.skip("ODE 0.16 in double precision is needed: apt install libode8, or pip install dartpy")


def _candidates() -> Iterator[str]:
    """Yield names and paths to try."""
    yield from ("libode.so.8", "libode.8.dylib")
    try:
        files = metadata.files("dartpy") or []
    except metadata.PackageNotFoundError:
        return
    yield from (str(file.locate()) for file in files if file.name.startswith("libode-"))


def _matrix(rotation: np.ndarray) -> Any:
    """Return a rotation as dMatrix3."""
    return (c_double * 12)(*np.hstack([rotation, np.zeros((3, 1))]).ravel())


class WebotsOde:
    """A world of Webots in ODE: a robot on boxes, its motors under torque control once a torque is set."""

    def __init__(self, nodes: list[Read], library: ctypes.CDLL, plugin: ctypes.CDLL) -> None:
        """`nodes`: of the world; `plugin`: the compiled physics plugin, see `webots_build`."""
        self.ode, self.plugin = library, plugin
        info, robot = (next(node for node in nodes if node.kind == kind) for kind in ("WorldInfo", "Robot"))
        self.timestep, self.contact = info["basicTimeStep"] / 1000, info["contactProperties"][0]
        self.world, self.group = library.dWorldCreate(), library.dJointGroupCreate(0)
        library.dWorldSetGravity(self.world, 0.0, 0.0, -9.81)
        library.dWorldSetCFM(self.world, WORLD_CFM)
        library.dWorldSetERP(self.world, WORLD_ERP)
        self.bodies: dict[str, int] = {}
        self.shapes: list[int] = []
        links = place(robot, {})
        for name, link in links.items():
            self._add_body(name, link)
        self.hinges: dict[str, tuple[int, Read, int]] = {}
        self.limits: dict[str, float] = {}
        self._add_hinges(robot, "base", links)
        self.ground = [self._box(node) for node in nodes if node.kind == "Solid"]
        self.contacts = (Contact * CONTACTS)()
        plugin.forget()
        self._names = [f"{robot.define}.{name}".removesuffix(".base").encode() for name in self.bodies]
        for name, body in zip(self._names, self.bodies.values(), strict=True):
            plugin.know(name, body)
        plugin.webots_physics_init()

    def _add_body(self, name: str, link: Placed) -> None:
        """Make a link: its body at the centre of mass, its shapes on it (WbSolid.cpp, WbSolidMerger.cpp)."""
        physics = link.solid["physics"]
        mass, body = (c_double * 20)(), self.ode.dBodyCreate(self.world)
        self.ode.dMassSetParameters(
            mass, physics["mass"], 0.0, 0.0, 0.0, *physics["inertiaMatrix"][0], *physics["inertiaMatrix"][1]
        )
        self.ode.dBodySetMass(body, mass)
        self.ode.dBodySetPosition(body, *link.centre.tolist())
        self.ode.dBodySetRotation(body, _matrix(link.rotation))
        self.bodies[name] = body
        for part in touched(link.solid):
            geom = self._shape(part.geometry)
            self.ode.dGeomSetBody(geom, body)
            self.ode.dGeomSetOffsetPosition(geom, *(part.origin - physics["centerOfMass"][0]).tolist())
            self.ode.dGeomSetOffsetRotation(geom, _matrix(part.rotation))
            self.shapes.append(geom)

    def _shape(self, geometry: Read) -> int:
        """Make a shape."""
        if geometry.kind == "Box":
            return self.ode.dCreateBox(None, *geometry["size"])
        if geometry.kind == "Sphere":
            return self.ode.dCreateSphere(None, geometry["radius"])
        assert geometry.kind == "Capsule"  # cylinders and meshes are not here
        return self.ode.dCreateCapsule(None, geometry["radius"], geometry["height"])

    def _box(self, solid: Read) -> int:
        """Make a box that nothing moves."""
        geom = self._shape(solid["boundingObject"])
        self.ode.dGeomSetPosition(geom, *solid["translation"])
        return geom

    def _add_hinges(self, solid: Read, name: str, links: dict[str, Placed]) -> None:
        """Make the joints of a solid and of those behind it (WbHingeJoint.cpp): the parent is the first body."""
        for hinge in [child for child in solid["children"] if child.kind == "HingeJoint"]:
            parameters, end = hinge["jointParameters"], hinge["endPoint"]
            motor = next(device for device in hinge["device"] if device.kind == "RotationalMotor")
            here, bodies = links[name], (self.bodies[name], self.bodies[end["name"]])
            axis = (here.rotation @ parameters["axis"]).tolist()
            joint = self.ode.dJointCreateHinge(self.world, None)
            self.ode.dJointAttach(joint, *bodies)
            self.ode.dJointSetHingeAxis(joint, *axis)
            self.ode.dJointSetHingeAnchor(joint, *(here.origin + here.rotation @ parameters["anchor"]).tolist())
            self.ode.dJointSetHingeParam(joint, LO_STOP, -parameters["maxStop"])
            self.ode.dJointSetHingeParam(joint, HI_STOP, -parameters["minStop"])
            damper = self.ode.dJointCreateAMotor(self.world, None)  # as applyToOdeSpringAndDampingConstants
            self.ode.dJointAttach(damper, *bodies)
            self.ode.dJointSetAMotorNumAxes(damper, 1)
            self.ode.dJointSetAMotorMode(damper, 0)
            self.ode.dJointSetAMotorAxis(damper, 0, 1, *axis)
            for parameter, value in (
                (LO_STOP, 0.0),
                (HI_STOP, 0.0),
                (STOP_ERP, 0.0),
                (STOP_CFM, 1 / max(parameters["dampingConstant"], 1e-12)),
            ):
                self.ode.dJointSetAMotorParam(damper, parameter, value)
            self.hinges[motor["name"]], self.limits[motor["name"]] = (joint, parameters, damper), motor["maxTorque"]
            self._add_hinges(end, end["name"], links)

    def step(self, torque: dict[str, float]) -> bool:
        """Take a physics step (WbHingeJoint::prePhysicsStep, WbSimulationWorld::step)."""
        for name, (joint, parameters, damper) in self.hinges.items():
            friction, angle = parameters["staticFriction"], -self.ode.dJointGetHingeAngle(joint)
            if name in torque:
                self.ode.dJointSetHingeParam(joint, VELOCITY, 0.0)
                self.ode.dJointSetHingeParam(joint, FORCE_MAX, friction)
                self.ode.dJointAddHingeTorque(joint, -torque[name])
            else:
                hold = np.clip(CONTROL_P * (0.0 - angle), -MAX_VELOCITY, MAX_VELOCITY)
                self.ode.dJointSetHingeParam(joint, VELOCITY, -float(hold))
                self.ode.dJointSetHingeParam(joint, FORCE_MAX, max(friction, self.limits[name]))
            self.ode.dJointSetAMotorAngle(damper, 0, -angle)
        self.plugin.webots_physics_step()
        self._collide()
        self.ode.dWorldStep(self.world, self.timestep)
        self.ode.dJointGroupEmpty(self.group)
        return True

    def _collide(self) -> None:
        """Make the contacts of the robot with the ground."""
        size = ctypes.sizeof(Contact)
        first = ctypes.addressof(self.contacts) + Contact.geometry.offset
        for shape in self.shapes:
            for ground in self.ground:
                for k in range(self.ode.dCollide(shape, ground, CONTACTS, first, size)):
                    surface = self.contacts[k].surface
                    surface.mode, surface.mu = CONTACT_MODE, self.contact["coulombFriction"][0]
                    surface.bounce, surface.bounce_vel = self.contact["bounce"], 0.01
                    surface.soft_cfm, surface.soft_erp = SOFT_CFM, SOFT_ERP
                    joint = self.ode.dJointCreateContact(self.world, self.group, ctypes.byref(self.contacts[k]))
                    self.ode.dJointAttach(joint, self.ode.dGeomGetBody(shape), None)

    def angles(self) -> dict[str, float]:
        """Return the angles of the joints, as Webots counts them [rad]."""
        return {name: -self.ode.dJointGetHingeAngle(joint) for name, (joint, *_) in self.hinges.items()}

    def trunk(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return place [m], orientation w x y z, and angular velocity in the trunk's frame [rad/s]."""
        body = self.bodies["base"]
        position, quaternion, velocity = (
            np.array((c_double * size).from_address(get(body)))
            for get, size in (
                (self.ode.dBodyGetPosition, 3),
                (self.ode.dBodyGetQuaternion, 4),
                (self.ode.dBodyGetAngularVel, 3),
            )
        )
        w, axis = quaternion[0], quaternion[1:]
        turned = velocity + 2.0 * np.cross(axis, np.cross(axis, velocity) - w * velocity)
        return position, quaternion, turned
