"""What of ODE 0.16 is called: structures, numbers and prototypes, as its C headers have them in double precision.

Handles (worlds, bodies, joints, geometries) are addresses. A prototype that is wrong is not noticed by ctypes: it
passes garbage. So every function that is used is here, and no other is called.
"""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_char_p, c_double, c_int, c_uint, c_ulong, c_void_p

Handle = c_void_p
"""dWorldID, dBodyID, dJointID, dGeomID, dSpaceID, ...: a pointer that only ODE looks behind."""

Vector = c_double * 4
"""dVector3: three numbers and one of padding."""

LO_STOP, HI_STOP, VELOCITY, FORCE_MAX, CFM, STOP_ERP, STOP_CFM = 0, 1, 2, 5, 8, 9, 10
"""dParamLoStop, HiStop, Vel, FMax, CFM, StopERP, StopCFM. Up to 0.11 those after the third were two lower."""

SECOND_AXIS = 0x100
"""dParamGroup2: added to a number, it means the second axis of an angular motor."""

FIRST_DIRECTION, SOFT_ERP, SOFT_CFM, APPROX1 = 0x002, 0x008, 0x010, 0x7000
"""dContactFDir1, SoftERP, SoftCFM, Approx1: bits of `Surface.mode`."""

COLLISION_DATA = 0x1
"""dAllocateFlagCollisionData."""


class Mass(ctypes.Structure):
    """dMass: mass [kg], centre of mass, inertia about it, rows of a 3 x 4 matrix [kg m²]."""

    _fields_ = (("mass", c_double), ("centre", Vector), ("inertia", c_double * 12))


class Feedback(ctypes.Structure):
    """dJointFeedback: force [N] and torque about its centre of mass [N m] of a joint on its first and second body."""

    _fields_ = (("force1", Vector), ("torque1", Vector), ("force2", Vector), ("torque2", Vector))


class Surface(ctypes.Structure):
    """dSurfaceParameters: what a contact is made of; `mode` says which of the numbers count."""

    _fields_ = (
        ("mode", c_int),
        ("mu", c_double),
        ("mu2", c_double),
        ("rho", c_double),
        ("rho2", c_double),
        ("rho_n", c_double),
        ("bounce", c_double),
        ("bounce_velocity", c_double),
        ("soft_erp", c_double),
        ("soft_cfm", c_double),
        ("motion1", c_double),
        ("motion2", c_double),
        ("motion_n", c_double),
        ("slip1", c_double),
        ("slip2", c_double),
    )


class ContactPoint(ctypes.Structure):
    """dContactGeom: where two geometries meet; the normal points into the first, `depth` is positive inside [m]."""

    _fields_ = (
        ("position", Vector),
        ("normal", Vector),
        ("depth", c_double),
        ("geometry1", Handle),
        ("geometry2", Handle),
        ("side1", c_int),
        ("side2", c_int),
    )


class Contact(ctypes.Structure):
    """dContact: what a contact joint is made from."""

    _fields_ = (("surface", Surface), ("point", ContactPoint), ("first_direction", Vector))


MessageHandler = ctypes.CFUNCTYPE(None, c_int, c_char_p, c_void_p)
"""dMessageFunction: number, format, and a `va_list` of what goes into the format."""

NearCallback = ctypes.CFUNCTYPE(None, c_void_p, c_void_p, c_void_p)
"""dNearCallback: data, and two geometries whose boxes overlap."""

_WORLD = {
    "dWorldCreate": (Handle, ()),
    "dWorldDestroy": (None, (Handle,)),
    "dWorldSetGravity": (None, (Handle, c_double, c_double, c_double)),
    "dWorldSetERP": (None, (Handle, c_double)),
    "dWorldSetCFM": (None, (Handle, c_double)),
    "dWorldSetQuickStepNumIterations": (None, (Handle, c_int)),
    "dWorldStep": (c_int, (Handle, c_double)),
    "dWorldQuickStep": (c_int, (Handle, c_double)),
    "dRandSetSeed": (None, (c_ulong,)),
    "dRandGetSeed": (c_ulong, ()),
}

_BODY = {
    "dBodyCreate": (Handle, (Handle,)),
    "dBodySetMass": (None, (Handle, POINTER(Mass))),
    "dBodySetKinematic": (None, (Handle,)),
    "dBodySetPosition": (None, (Handle, c_double, c_double, c_double)),
    "dBodySetRotation": (None, (Handle, POINTER(c_double))),
    "dBodySetLinearVel": (None, (Handle, c_double, c_double, c_double)),
    "dBodySetAngularVel": (None, (Handle, c_double, c_double, c_double)),
    "dBodyGetPosition": (POINTER(c_double), (Handle,)),
    "dBodyGetQuaternion": (POINTER(c_double), (Handle,)),
    "dBodyGetLinearVel": (POINTER(c_double), (Handle,)),
    "dBodyGetAngularVel": (POINTER(c_double), (Handle,)),
    "dBodyGetPointVel": (None, (Handle, c_double, c_double, c_double, POINTER(c_double))),
}

_JOINT = {
    "dJointCreateHinge": (Handle, (Handle, Handle)),
    "dJointCreateAMotor": (Handle, (Handle, Handle)),
    "dJointCreateContact": (Handle, (Handle, Handle, POINTER(Contact))),
    "dJointGroupCreate": (Handle, (c_int,)),
    "dJointGroupEmpty": (None, (Handle,)),
    "dJointGroupDestroy": (None, (Handle,)),
    "dJointAttach": (None, (Handle, Handle, Handle)),
    "dJointSetFeedback": (None, (Handle, POINTER(Feedback))),
    "dJointSetHingeAnchor": (None, (Handle, c_double, c_double, c_double)),
    "dJointSetHingeAxis": (None, (Handle, c_double, c_double, c_double)),
    "dJointSetHingeParam": (None, (Handle, c_int, c_double)),
    "dJointGetHingeAngle": (c_double, (Handle,)),
    "dJointGetHingeAngleRate": (c_double, (Handle,)),
    "dJointSetAMotorNumAxes": (None, (Handle, c_int)),
    "dJointSetAMotorAxis": (None, (Handle, c_int, c_int, c_double, c_double, c_double)),
    "dJointSetAMotorParam": (None, (Handle, c_int, c_double)),
}

_COLLISION = {
    "dSimpleSpaceCreate": (Handle, (Handle,)),
    "dSpaceDestroy": (None, (Handle,)),
    "dSpaceCollide": (None, (Handle, c_void_p, NearCallback)),
    "dSpaceCollide2": (None, (Handle, Handle, c_void_p, NearCallback)),
    "dCollide": (c_int, (Handle, Handle, c_int, POINTER(ContactPoint), c_int)),
    "dCreateSphere": (Handle, (Handle, c_double)),
    "dCreateBox": (Handle, (Handle, c_double, c_double, c_double)),
    "dCreateCapsule": (Handle, (Handle, c_double, c_double)),
    "dCreatePlane": (Handle, (Handle, c_double, c_double, c_double, c_double)),
    "dCreateTriMesh": (Handle, (Handle, Handle, c_void_p, c_void_p, c_void_p)),
    "dGeomTriMeshDataCreate": (Handle, ()),
    "dGeomTriMeshDataDestroy": (None, (Handle,)),
    "dGeomTriMeshDataBuildDouble": (None, (Handle, c_void_p, c_int, c_int, c_void_p, c_int, c_int)),
    "dGeomSetBody": (None, (Handle, Handle)),
    "dGeomSetOffsetPosition": (None, (Handle, c_double, c_double, c_double)),
    "dGeomSetPosition": (None, (Handle, c_double, c_double, c_double)),
    "dGeomSetQuaternion": (None, (Handle, POINTER(c_double))),
    "dGeomSetCategoryBits": (None, (Handle, c_ulong)),
    "dGeomSetCollideBits": (None, (Handle, c_ulong)),
}

_LIBRARY = {
    "dInitODE2": (c_int, (c_uint,)),
    "dAllocateODEDataForThread": (c_int, (c_uint,)),
    "dSetErrorHandler": (None, (MessageHandler,)),
    "dSetDebugHandler": (None, (MessageHandler,)),
    "dSetMessageHandler": (None, (MessageHandler,)),
}

PROTOTYPES = _LIBRARY | _WORLD | _BODY | _JOINT | _COLLISION
"""Name -> type of the result, types of the arguments. `dGetConfiguration` is asked before these are declared."""
