"""The physics plugin that gives Webots' joints the inertia of their rotors: C source, and the table it is built with.

Webots has no rotor inertia. Lumped into the link it would be wrong: a rotor turns against its link, not with it. In
ODE, which Webots is built on, an angular motor for each joint holds it: a constraint on the joint's rate q' with

    target speed = q' before the step,    CFM = Δt / I,    as good as no bound on its torque

gives the torque -I (q'_after - q'_before) / Δt, which is -I q'': the rotor's, taken implicitly. A test compiles the
plugin and steps it in ODE 0.16, where the ODE library is at hand. **Not run in Webots.** Without rotor inertia a light
link is stiff against its gains at the physics step, and the joint controller may ring.

The plugin tells the controller in every step that it acts (a message on channel `CHANNEL`), and says nothing where a
joint of its table is missing: the controller then refuses to walk without rotor inertia.

Source: ODE's manual, "Stops and motor parameters" and "CFM"; docs/reference of https://github.com/cyberbotics/webots,
callback-functions.md and utility-functions.md.
"""

from __future__ import annotations

from importlib import resources

from stiction.formats.contract import Contract
from stiction.robots.links import links
from stiction.robots.spec import RobotSpec
from stiction.transfer.webots.controller import CHANNEL, PLUGIN
from stiction.transfer.webots.proto import proto_name
from stiction.transfer.webots.vrml import number
from stiction.transfer.webots.world import ROBOT

TABLE = "joints.h"
"""The generated file."""

FIXED = (f"{PLUGIN}.c", "Makefile")
"""Files that are the same for every robot; they lie beside this module."""


def write_table(spec: RobotSpec, contract: Contract) -> str:
    """Return the text of `joints.h`: Δt [s] and, for every joint, the links before and behind it and I [kg m²]."""
    inertia = dict(zip(spec.joint_names, contract.armature, strict=True))
    tree, rows = links(spec), []
    for link in tree:
        parent = ROBOT if link.parent < 0 else f"{ROBOT}.{tree[link.parent].name}"
        rows.append(f'  {{"{parent}", "{ROBOT}.{link.name}", {number(inertia[link.joint])}}},\n')
    return (
        f"/* {proto_name(spec.name)}: the joints and the inertia of their rotors, at the joint [kg m^2].\n"
        "   Written by `stiction export --to webots`. NOT RUN in Webots. */\n"
        f"#define TIMESTEP {number(contract.physics_timestep)} /* physics step of the world [s] */\n"
        f"#define CHANNEL {CHANNEL} /* of the robot's receiver */\n"
        f"#define JOINTS {len(rows)}\n"
        "static const struct {\n  const char *parent, *child;\n  double inertia;\n} TABLE[JOINTS] = {\n"
        f"{''.join(rows)}}};\n"
    )


def plugin_files(spec: RobotSpec, contract: Contract) -> dict[str, str]:
    """Return name -> text of the files of the plugin's folder."""
    beside = resources.files(__package__)
    return {name: beside.joinpath(name).read_text("utf-8") for name in FIXED} | {TABLE: write_table(spec, contract)}
