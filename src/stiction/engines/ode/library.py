"""Bindings of ODE 0.16.

The library is a system package, or lies in the wheel of `dartpy`, which the extra `engines` installs on Linux for that
alone: neither DART nor any of its other libraries is loaded. ODE's licence is BSD or LGPL, by choice.

Handles (worlds, bodies, joints, geometries) are addresses. ctypes does not notice a wrong prototype and passes garbage,
so every function in use is declared here.
"""

from __future__ import annotations

import ctypes
import hashlib
import math
import os
import sys
from collections.abc import Callable, Iterator
from ctypes import POINTER, c_char_p, c_double, c_int, c_uint, c_ulong, c_void_p
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from stiction.core.errors import EngineError, StictionError
from stiction.core.extras import remedy

Handle = c_void_p
"""dWorldID, dBodyID, dJointID, dGeomID, dSpaceID, ...: an opaque pointer."""

Vector = c_double * 4
"""dVector3: three numbers and one of padding."""

LO_STOP, HI_STOP, VELOCITY, FORCE_MAX, CFM = 0, 1, 2, 5, 8
"""dParamLoStop, HiStop, Vel, FMax, CFM. Up to 0.11 those after the third were two lower."""

SECOND_AXIS = 0x100
"""dParamGroup2: added to a number, it selects the second axis of an angular motor."""

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
    """dSurfaceParameters: properties of a contact; `mode` selects the numbers in use."""

    _fields_ = (
        ("mode", c_int),
        *((name, c_double) for name in ("mu", "mu2", "rho", "rho2", "rho_n", "bounce", "bounce_velocity")),
        *((name, c_double) for name in ("soft_erp", "soft_cfm", "motion1", "motion2", "motion_n", "slip1", "slip2")),
    )


class ContactPoint(ctypes.Structure):
    """dContactGeom: contact point of two geometries; the normal points into the first, `depth` is positive inside
    [m].
    """

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
    """dContact: data of a contact joint."""

    _fields_ = (("surface", Surface), ("point", ContactPoint), ("first_direction", Vector))


MessageHandler = ctypes.CFUNCTYPE(None, c_int, c_char_p, c_void_p)
"""dMessageFunction: number, format, and a `va_list` of the format's arguments."""

NearCallback = ctypes.CFUNCTYPE(None, c_void_p, c_void_p, c_void_p)
"""dNearCallback: data, and two geometries whose boxes overlap."""

PROTOTYPES: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "dInitODE2": (c_int, (c_uint,)),
    "dAllocateODEDataForThread": (c_int, (c_uint,)),
    "dSetErrorHandler": (None, (MessageHandler,)),
    "dSetDebugHandler": (None, (MessageHandler,)),
    "dSetMessageHandler": (None, (MessageHandler,)),
    "dWorldCreate": (Handle, ()),
    "dWorldDestroy": (None, (Handle,)),
    "dWorldSetGravity": (None, (Handle, c_double, c_double, c_double)),
    "dWorldSetERP": (None, (Handle, c_double)),
    "dWorldSetCFM": (None, (Handle, c_double)),
    "dWorldSetQuickStepNumIterations": (None, (Handle, c_int)),
    "dWorldStep": (c_int, (Handle, c_double)),
    "dWorldQuickStep": (c_int, (Handle, c_double)),
    "dRandSetSeed": (None, (c_ulong,)),
    "dBodyCreate": (Handle, (Handle,)),
    "dBodySetMass": (None, (Handle, POINTER(Mass))),
    "dBodySetKinematic": (None, (Handle,)),
    "dBodySetPosition": (None, (Handle, c_double, c_double, c_double)),
    "dBodySetRotation": (None, (Handle, POINTER(c_double))),
    "dBodySetQuaternion": (None, (Handle, POINTER(c_double))),
    "dBodySetLinearVel": (None, (Handle, c_double, c_double, c_double)),
    "dBodySetAngularVel": (None, (Handle, c_double, c_double, c_double)),
    "dBodyGetPosition": (POINTER(c_double), (Handle,)),
    "dBodyGetQuaternion": (POINTER(c_double), (Handle,)),
    "dBodyGetLinearVel": (POINTER(c_double), (Handle,)),
    "dBodyGetAngularVel": (POINTER(c_double), (Handle,)),
    "dBodyGetPointVel": (None, (Handle, c_double, c_double, c_double, POINTER(c_double))),
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
    "dSimpleSpaceCreate": (Handle, (Handle,)),
    "dSpaceDestroy": (None, (Handle,)),
    "dSpaceCollide": (None, (Handle, c_void_p, NearCallback)),
    "dSpaceCollide2": (None, (Handle, Handle, c_void_p, NearCallback)),
    "dCollide": (c_int, (Handle, Handle, c_int, POINTER(ContactPoint), c_int)),
    "dCreateSphere": (Handle, (Handle, c_double)),
    "dCreateBox": (Handle, (Handle, c_double, c_double, c_double)),
    "dCreateCapsule": (Handle, (Handle, c_double, c_double)),
    "dCreateCylinder": (Handle, (Handle, c_double, c_double)),
    "dCreatePlane": (Handle, (Handle, c_double, c_double, c_double, c_double)),
    "dCreateTriMesh": (Handle, (Handle, Handle, c_void_p, c_void_p, c_void_p)),
    "dGeomTriMeshDataCreate": (Handle, ()),
    "dGeomTriMeshDataDestroy": (None, (Handle,)),
    "dGeomTriMeshDataBuildDouble": (None, (Handle, c_void_p, c_int, c_int, c_void_p, c_int, c_int)),
    "dGeomSetBody": (None, (Handle, Handle)),
    "dGeomSetOffsetPosition": (None, (Handle, c_double, c_double, c_double)),
    "dGeomSetOffsetQuaternion": (None, (Handle, POINTER(c_double))),
    "dGeomSetPosition": (None, (Handle, c_double, c_double, c_double)),
    "dGeomSetQuaternion": (None, (Handle, POINTER(c_double))),
    "dGeomSetCategoryBits": (None, (Handle, c_ulong)),
    "dGeomSetCollideBits": (None, (Handle, c_ulong)),
}
"""Name -> type of the result, types of the arguments. `dGetConfiguration` is called before these are declared."""

ON_MACOS = ("libode.8.dylib", "/opt/homebrew/lib/libode.8.dylib")

SYSTEM_NAMES = ON_MACOS if sys.platform == "darwin" else ("libode.so.8",)
"""Names of ODE 0.16 for the system's loader; the 8 is the number of its binary interface."""

_messages: list[str] = []
"""Messages of ODE since `take_messages` was last called."""

_handlers: list[Callable[..., None]] = []
"""References to the functions that ODE calls, against garbage collection."""


@cache
def ode_library() -> ctypes.CDLL:
    """Return ODE, initialised and with its prototypes declared; always the same object, never closed.

    Raises `StictionError` without an ODE of this version and precision.
    """
    failures = []
    for name in candidates():
        try:
            return opened(name)
        except (OSError, StictionError) as error:
            failures.append(str(error))
    raise EngineError(
        f"the engine 'ode' needs ODE 0.16 in double precision; {remedy('engines')} (Linux), apt install libode8, or "
        f"brew install ode; tried: {'; '.join(failures)}"
    )


@cache
def library_digest() -> str | None:
    """Return the SHA-256 of ODE's file, since two builds of one version may round differently; None without ODE."""
    try:
        function = ode_library().dInitODE2
    except StictionError:
        return None
    return hashlib.sha256(file_of(function).read_bytes()).hexdigest()


class _AddressInfo(ctypes.Structure):
    """`Dl_info` of the C library: the origin of an address."""

    _fields_ = (("file", c_char_p), ("base", c_void_p), ("symbol", c_char_p), ("address", c_void_p))


def file_of(function: Any) -> Path:
    """Return the file of a function of a loaded library; raise `StictionError` for one unknown to the loader."""
    dladdr, info = ctypes.CDLL(None).dladdr, _AddressInfo()
    dladdr.argtypes = [c_void_p, POINTER(_AddressInfo)]
    if not dladdr(ctypes.cast(function, c_void_p), ctypes.byref(info)) or not info.file:
        raise EngineError(f"the file of {function} is not known to the system's loader; is the library still there?")
    return Path(os.fsdecode(info.file))


def candidates() -> Iterator[str]:
    """Yield names and paths of libraries to try, the system's before the wheel's."""
    yield from SYSTEM_NAMES
    try:
        files = metadata.files("dartpy") or []
    except metadata.PackageNotFoundError:
        return
    for file in files:
        # A wheel carries foreign libraries under names with a hash, as in libode-1a2b3c4d.so.8.
        if file.name.startswith("libode-"):
            yield str(file.locate())


def opened(name: str) -> ctypes.CDLL:
    """Return the library of that name or path, ready for use.

    Raises `OSError` for a missing one, `StictionError` for another library than ODE 0.16 in double precision.
    """
    library = ctypes.CDLL(name)
    # Before any other call: in single precision the structures declared here are of another size.
    check_precision(library, name)
    declare(library, name)
    set_handlers(library)
    if not library.dInitODE2(0):
        raise EngineError(f"{name} cannot be initialised")
    prepare_thread(library)
    check_numbers(library, name)
    return library


def declare(library: ctypes.CDLL, name: str) -> None:
    """Declare the prototype of every function in use; raise `StictionError` for a missing one."""
    for function, (result, arguments) in PROTOTYPES.items():
        try:
            entry = getattr(library, function)
        except AttributeError as error:
            raise EngineError(f"{name} has no {function}") from error
        entry.restype, entry.argtypes = result, list(arguments)


def check_precision(library: ctypes.CDLL, name: str) -> None:
    """Raise `StictionError` for another library, and for an ODE in single precision: its numbers have another size."""
    try:
        configuration = library.dGetConfiguration
    except AttributeError as error:
        raise EngineError(f"{name} is not ODE") from error
    configuration.restype, configuration.argtypes = c_char_p, []
    if b"ODE_double_precision" not in configuration().split():
        raise EngineError(f"{name} was built in single precision")


def check_numbers(library: ctypes.CDLL, name: str) -> None:
    """Raise `StictionError` unless the numbers of joint parameters are those of 0.16.

    They moved by two after 0.11, and an older library would silently ignore friction. So a motor of 3 N m turns a body
    of 2 kg m² towards 1 rad/s: it must reach 0.15 rad/s after 0.1 s.
    """
    world = library.dWorldCreate()
    try:
        library.dWorldSetCFM(world, 0.0)
        body = library.dBodyCreate(world)
        mass = Mass(1.0, (0, 0, 0, 0), (2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0))
        library.dBodySetMass(body, mass)
        hinge = library.dJointCreateHinge(world, None)
        library.dJointAttach(hinge, body, None)
        library.dJointSetHingeAxis(hinge, 0.0, 0.0, 1.0)
        library.dJointSetHingeParam(hinge, VELOCITY, 1.0)
        library.dJointSetHingeParam(hinge, FORCE_MAX, 3.0)
        library.dWorldStep(world, 0.1)
        rate = library.dJointGetHingeAngleRate(hinge)
    finally:
        library.dWorldDestroy(world)
    if not math.isclose(rate, 0.15, rel_tol=1e-9):
        raise EngineError(f"{name} is of another version: a motor that should turn at 0.15 rad/s does at {rate:g}")


def prepare_thread(library: ctypes.CDLL) -> None:
    """Allocate the collision detection's memory of the calling thread, if it has none."""
    if not library.dAllocateODEDataForThread(COLLISION_DATA):
        raise EngineError("ODE found no memory for this thread's collision detection; free some")


def set_handlers(library: ctypes.CDLL) -> None:
    """Record ODE's messages, which would go to standard error, and print its errors before it ends the process.

    ODE calls exit() after an error and abort() after a failed assertion, whatever its handlers do: callers must avoid
    both.
    """
    text = _formatter()

    def record(number: int, form: bytes, arguments: int) -> None:
        _messages.append(text(form, arguments))

    def report(number: int, form: bytes, arguments: int) -> None:
        print(f"stiction: ODE failed and ends this process: {text(form, arguments)}", file=sys.stderr, flush=True)

    error, message = MessageHandler(report), MessageHandler(record)
    _handlers.extend((error, message))
    library.dSetErrorHandler(error)
    library.dSetDebugHandler(error)
    library.dSetMessageHandler(message)


def take_messages() -> list[str]:
    """Return ODE's messages since the last call, and clear them."""
    taken, _messages[:] = _messages[:], []
    return taken


def _formatter() -> Callable[[bytes, int], str]:
    """Return C's vsnprintf as a function of a format and the address of its arguments."""
    vsnprintf = ctypes.CDLL(None).vsnprintf
    vsnprintf.restype, vsnprintf.argtypes = c_int, [c_char_p, ctypes.c_size_t, c_char_p, c_void_p]

    def text(form: bytes, arguments: int) -> str:
        buffer = ctypes.create_string_buffer(400)
        vsnprintf(buffer, len(buffer), form, arguments)
        return buffer.value.decode(errors="replace").strip()

    return text
