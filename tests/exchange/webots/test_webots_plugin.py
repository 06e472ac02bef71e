"""The physics plugin: its table, that it compiles, and, in ODE itself, that it is rotor inertia and nothing else."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bundles import make_contract
from stiction.engines.ode.library import candidates
from stiction.exchange.webots.export import plugin_files, write_table
from stiction.robots.catalog import find_robot

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")

ODE = """
#ifndef ODE_H
#define ODE_H
typedef double dReal;
typedef dReal dVector3[4];
typedef struct dxWorld *dWorldID;
typedef struct dxBody *dBodyID;
typedef struct dxJoint *dJointID;
typedef struct dxJointGroup *dJointGroupID;
typedef enum { dJointTypeHinge = 2 } dJointType;
enum { dAMotorUser = 0 };
enum { dParamVel = 2, dParamFMax = 5, dParamCFM = 8 };
dWorldID dBodyGetWorld(dBodyID);
int dBodyGetNumJoints(dBodyID);
dJointID dBodyGetJoint(dBodyID, int);
dJointType dJointGetType(dJointID);
dBodyID dJointGetBody(dJointID, int);
void dJointAttach(dJointID, dBodyID, dBodyID);
void dJointDestroy(dJointID);
void dJointGetHingeAxis(dJointID, dVector3);
dReal dJointGetHingeAngleRate(dJointID);
dJointID dJointCreateAMotor(dWorldID, dJointGroupID);
void dJointSetAMotorMode(dJointID, int);
void dJointSetAMotorNumAxes(dJointID, int);
void dJointSetAMotorAxis(dJointID, int, int, dReal, dReal, dReal);
void dJointSetAMotorParam(dJointID, int, dReal);
#endif
"""
"""Part of ODE 0.16's headers used by the plugin, in double precision; Webots has its own."""

WEBOTS = """
void webots_physics_init(void);
void webots_physics_step(void);
void webots_physics_cleanup(void);
dBodyID dWebotsGetBodyFromDEF(const char *);
void dWebotsSend(int channel, const void *buffer, int size);
void dWebotsConsolePrintf(const char *format, ...);
"""
"""Part of Webots' include/plugins/physics.h used by the plugin."""

HARNESS = """
#include <ode/ode.h>
#include <plugins/physics.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
static struct { const char *name; dBodyID body; } known[64];
static int bodies = 0;
char said[1000] = "";
int sent = 0, channel = 0;
void know(const char *name, dBodyID body) { known[bodies].name = name; known[bodies++].body = body; }
void forget(void) { bodies = 0; sent = 0; said[0] = 0; }
dBodyID dWebotsGetBodyFromDEF(const char *name) {
  int i;
  for (i = 0; i < bodies; ++i)
    if (strcmp(known[i].name, name) == 0) return known[i].body;
  return 0;
}
void dWebotsSend(int to, const void *buffer, int size) { ++sent; channel = to; (void)buffer; (void)size; }
void dWebotsConsolePrintf(const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(said + strlen(said), sizeof said - strlen(said), format, arguments);
  va_end(arguments);
}
"""
"""Substitute for Webots: bodies by their names, and the plugin's messages."""

needs_compiler = pytest.mark.skipif(
    COMPILER is None, reason="a C compiler (cc, gcc or clang) is needed to build the plugin"
)


def add_headers(folder: Path) -> Path:
    """Write the stand-ins beside the plugin's files; return the folder."""
    headers = {
        "include/ode/ode.h": ODE,
        "include/plugins/physics.h": f"#include <ode/ode.h>\n{WEBOTS}",
        "harness.c": HARNESS,
    }
    for name, text in headers.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


def compiled(folder: Path, *options: str) -> None:
    """Compile with all warnings as errors."""
    command = [str(COMPILER), "-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Iinclude", *options]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def load_plugin(folder: Path) -> ctypes.CDLL:
    """Compile the plugin in a folder with its headers and load it; ODE must have been loaded before."""
    compiled(folder, "-shared", "-fPIC", "-o", "plugin.so", "rotor_inertia.c", "harness.c")
    plugin = ctypes.CDLL(str(folder / "plugin.so"))
    plugin.know.argtypes = [ctypes.c_char_p, ctypes.c_void_p]
    return plugin


def said_by(plugin: ctypes.CDLL) -> str:
    """Return the lines printed by the plugin to Webots' console."""
    return (ctypes.c_char * 1000).in_dll(plugin, "said").value.decode()


def sent_by(plugin: ctypes.CDLL) -> tuple[int, int]:
    """Return how many messages it has sent, and the channel of the last."""
    return ctypes.c_int.in_dll(plugin, "sent").value, ctypes.c_int.in_dll(plugin, "channel").value


FUNCTIONS = {
    "p": "dWorldCreate dBodyCreate:p dJointCreateHinge:pp",
    "d": "dJointGetHingeAngleRate:p",
    "i": "dInitODE2:i dWorldStep:pd dBodyGetNumJoints:p dAllocateODEDataForThread:i",
    "": "dWorldSetCFM:pd dMassSetParameters:pdddddddddd dBodySetMass:pp dJointAttach:ppp dJointSetHingeAxis:pddd "
    "dJointAddHingeTorque:pd",
}
"""Result -> functions of ODE and their arguments: p pointer, d double, i int."""

TYPES: dict[str, Any] = {"p": ctypes.c_void_p, "d": ctypes.c_double, "i": ctypes.c_int, "": None}


def ode_or_skip() -> ctypes.CDLL:
    """Return ODE, its functions open to the plugin; skip without it."""
    for name in candidates():
        try:
            library = ctypes.CDLL(name, mode=ctypes.RTLD_GLOBAL)
        except OSError:
            continue
        for result, functions in FUNCTIONS.items():
            for function, _, arguments in (entry.partition(":") for entry in functions.split()):
                getattr(library, function).restype = TYPES[result]
                getattr(library, function).argtypes = [TYPES[argument] for argument in arguments]
        library.dInitODE2(0)
        library.dAllocateODEDataForThread(1)
        return library
    pytest.skip("ODE 0.16 in double precision is needed: apt install libode8, or pip install dartpy")


TABLE = """
#define TIMESTEP 0.002
#define CHANNEL 1
#define JOINTS 2
static const struct { const char *parent, *child; double inertia; } TABLE[JOINTS] = {
  {"ROBOT", "ROBOT.A_link", 0.0145}, {"ROBOT.A_link", "ROBOT.B_link", 0.03}};
"""
"""Two joints, one behind the other."""


def sources(folder: Path, table: str | None = None) -> Path:
    """Write the plugin's files for a robot, or for another table of joints, and the files to compile them."""
    files = plugin_files(find_robot("saturn_lite"), make_contract())
    for name, text in (files if table is None else files | {"joints.h": table}).items():
        (folder / name).write_text(text)
    return add_headers(folder)


@pytest.mark.parametrize("name", ["saturn_lite", "go2", "g1"])
def test_the_table_has_every_joint_with_the_inertia_of_the_contract(name: str) -> None:
    """The table has every joint with the contract's inertia."""
    spec = find_robot(name)
    armature = tuple(0.001 * (k + 1) for k in range(spec.num_joints))
    text = write_table(spec, make_contract(name, armature=armature, physics_timestep=0.004, control_period=0.016))
    rows = re.findall(r'\{"([\w.]+)", "([\w.]+)", ([0-9.e-]+)\},', text)
    assert [child for _, child, _ in rows] == [f"ROBOT.{link.name}" for link in spec.links]
    assert tuple(float(inertia) for *_, inertia in rows) == armature
    leg = spec.num_joints // len(spec.feet)
    parents = ["ROBOT" if k % leg == 0 else rows[k - 1][1] for k in range(len(rows))]
    assert [parent for parent, *_ in rows] == parents
    assert "#define TIMESTEP 0.004 " in text
    assert f"#define JOINTS {spec.num_joints}\n" in text


@needs_compiler
def test_the_plugin_compiles_without_a_warning(tmp_path: Path) -> None:
    """The exported plugin compiles without a warning."""
    compiled(sources(tmp_path), "-fsyntax-only", "rotor_inertia.c")


class Scene:
    """Three bodies in a row, floating, two hinges along z between them, in ODE, and the plugin on them."""

    INERTIA = (0.5, 0.0077, 0.004)
    """Inertia of the bodies about z [kg m²]."""

    def __init__(self, library: ctypes.CDLL, plugin: ctypes.CDLL, known: int = 3) -> None:
        """`known`: how many of the bodies the stand-in of Webots finds by their names."""
        self.ode, self.plugin = library, plugin
        self.world = library.dWorldCreate()
        library.dWorldSetCFM(self.world, 0.0)
        self.bodies = [self._body(inertia) for inertia in self.INERTIA]
        self.hinges = []
        for parent, child in pairwise(self.bodies):
            hinge = library.dJointCreateHinge(self.world, None)
            library.dJointAttach(hinge, parent, child)  # as WbBasicJoint::setOdeJoint: the parent first
            library.dJointSetHingeAxis(hinge, 0.0, 0.0, 1.0)
            self.hinges.append(hinge)
        plugin.forget()
        for name, body in zip((b"ROBOT", b"ROBOT.A_link", b"ROBOT.B_link")[:known], self.bodies, strict=False):
            plugin.know(name, body)

    def _body(self, inertia: float) -> int:
        """Make a body whose centre of mass is on every axis."""
        mass, body = (ctypes.c_double * 20)(), self.ode.dBodyCreate(self.world)
        self.ode.dMassSetParameters(mass, 1.0, 0.0, 0.0, 0.0, inertia, inertia, inertia, 0.0, 0.0, 0.0)
        self.ode.dBodySetMass(body, mass)
        return body

    def turn(self, torques: tuple[float, float], steps: int) -> list[float]:
        """Return the rates of the joints [rad/s] after constant torques, as Webots applies them [N m]."""
        for _ in range(steps):
            for hinge, torque in zip(self.hinges, torques, strict=True):
                self.ode.dJointAddHingeTorque(hinge, -torque)  # as WbHingeJoint::prePhysicsStep
            self.plugin.webots_physics_step()
            self.ode.dWorldStep(self.world, 0.002)
        return [-self.ode.dJointGetHingeAngleRate(hinge) for hinge in self.hinges]

    def joints(self) -> int:
        """Return how many joints the middle body has."""
        return self.ode.dBodyGetNumJoints(self.bodies[1])


@pytest.fixture
def built(tmp_path: Path) -> tuple[ctypes.CDLL, ctypes.CDLL]:
    """ODE, and the plugin as a library."""
    library = ode_or_skip()
    return library, load_plugin(sources(tmp_path, TABLE))


def expected(torques: tuple[float, float], rotors: tuple[float, float], time: float) -> list[float]:
    """Return the joints' rates of three bodies in a row about one axis, from rest: rotors turn against their links.

    Rates of the bodies w, joints q'_k = w_(k+1) - w_k, I w' = what the joints give, each t_k - A_k q''_k to the body
    behind and its opposite to the body before.
    """
    difference = np.array([[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
    bodies = np.diag(Scene.INERTIA) + difference.T @ np.diag(rotors) @ difference
    return (difference @ np.linalg.solve(bodies, difference.T @ np.array(torques)) * time).tolist()


@needs_compiler
def test_joints_accelerate_as_with_rotors(built: tuple[ctypes.CDLL, ctypes.CDLL]) -> None:
    """Joints accelerate with the inertia of their own rotor."""
    scene, torques = Scene(*built), (0.4, -0.15)
    free = scene.turn(torques, 1)
    assert free == pytest.approx(expected(torques, (0.0, 0.0), 0.002), rel=1e-9)
    scene = Scene(*built)
    scene.plugin.webots_physics_init()
    assert scene.turn(torques, 50) == pytest.approx(expected(torques, (0.0145, 0.03), 0.1), rel=1e-6)
    before = scene.turn((0.0, 0.0), 0)
    assert scene.turn((0.0, 0.0), 50) == pytest.approx(before, rel=1e-6)  # a rotor coasts
    scene.plugin.webots_physics_cleanup()


@needs_compiler
def test_the_plugin_says_that_it_acts_or_what_is_missing(built: tuple[ctypes.CDLL, ctypes.CDLL]) -> None:
    """The plugin reports that it acts, or the missing part."""
    scene = Scene(*built)
    scene.plugin.webots_physics_init()
    scene.turn((0.0, 0.0), 3)
    assert sent_by(scene.plugin) == (3, 1)
    assert said_by(scene.plugin) == "rotor_inertia: 2 joints have rotor inertia\n"
    scene.plugin.webots_physics_cleanup()
    incomplete = Scene(*built, known=2)
    incomplete.plugin.webots_physics_init()
    incomplete.turn((0.0, 0.0), 3)
    assert sent_by(incomplete.plugin)[0] == 0
    assert "no joint between ROBOT.A_link and ROBOT.B_link; NO joint has rotor inertia" in said_by(incomplete.plugin)
    assert incomplete.joints() == 2  # the two hinges alone: the joint that was found got nothing either
    incomplete.plugin.webots_physics_cleanup()
