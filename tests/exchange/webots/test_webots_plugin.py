"""The physics plugin: its table, that it compiles, and, in ODE itself, that it is rotor inertia and nothing else."""

from __future__ import annotations

import ctypes
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from bundles import make_contract
from stiction.exchange.webots.export import plugin_files, write_table
from stiction.robots.catalog import find_robot
from webots_build import add_headers, compiled, load_plugin, needs_compiler, said_by, sent_by
from webots_ode import ode_or_skip

TABLE = """
#define TIMESTEP 0.002
#define CHANNEL 1
#define JOINTS 2
static const struct { const char *parent, *child; double inertia; } TABLE[JOINTS] = {
  {"ROBOT", "ROBOT.A_link", 0.0145}, {"ROBOT.A_link", "ROBOT.B_link", 0.03}};
"""
"""Two joints, one behind the other."""


def sources(folder: Path, table: str | None = None) -> Path:
    """Write the plugin's files for a robot, or for another table of joints, and what it takes to compile them."""
    files = plugin_files(find_robot("saturn_lite"), make_contract())
    for name, text in (files if table is None else files | {"joints.h": table}).items():
        (folder / name).write_text(text)
    return add_headers(folder)


@pytest.mark.parametrize("name", ["saturn_lite", "go2", "g1"])
def test_the_table_has_every_joint_with_the_inertia_of_the_contract(name: str) -> None:
    """If this failed, a joint would turn without its rotor, or with another's."""
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
    """If this failed, `make` in the exported project would fail, and Webots would run without rotor inertia."""
    compiled(sources(tmp_path), "-fsyntax-only", "rotor_inertia.c")


class Scene:
    """Three bodies in a row, floating, two hinges along z between them, in ODE, and the plugin on them."""

    INERTIA = (0.5, 0.0077, 0.004)
    """Of the bodies about z [kg m²]."""

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
    """If this failed, the plugin would add another inertia, to another joint, or brake."""
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
    """If this failed, the controller would walk a robot without rotor inertia, or refuse one that has it."""
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


@needs_compiler
def test_a_reset_leaves_one_rotor_a_joint(built: tuple[ctypes.CDLL, ctypes.CDLL]) -> None:
    """If this failed, every reset of the simulation would add the inertia once more."""
    scene = Scene(*built)
    for _ in range(3):
        scene.plugin.webots_physics_init()
        assert scene.joints() == 4  # two hinges, two motors
        scene.plugin.webots_physics_cleanup()  # as WbSimulationWorld::reset does before it calls init again
        assert scene.joints() == 2
