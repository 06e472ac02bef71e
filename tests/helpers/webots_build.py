"""Compiles the exported physics plugin without Webots: stand-ins of the headers, and of what Webots gives a plugin."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import pytest

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
"""What the plugin uses of ODE 0.16's headers in double precision; Webots has its own."""

WEBOTS = """
void webots_physics_init(void);
void webots_physics_step(void);
void webots_physics_cleanup(void);
dBodyID dWebotsGetBodyFromDEF(const char *);
void dWebotsSend(int channel, const void *buffer, int size);
void dWebotsConsolePrintf(const char *format, ...);
"""
"""What it uses of Webots' include/plugins/physics.h."""

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
"""Stands in for Webots: bodies by their names, and what the plugin says."""

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
    """Return what the plugin has printed to Webots' console."""
    return (ctypes.c_char * 1000).in_dll(plugin, "said").value.decode()


def sent_by(plugin: ctypes.CDLL) -> tuple[int, int]:
    """Return how many messages it has sent, and the channel of the last."""
    return ctypes.c_int.in_dll(plugin, "sent").value, ctypes.c_int.in_dll(plugin, "channel").value
