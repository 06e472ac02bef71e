"""PhysX's friction coefficient against our law `load`: what was measured there, and, where sapien is installed, is.

The rig: a link of 1 kg and one of 2 kg, welded to it, on a revolute joint about x. Each link has 0.01 kg m² about every
axis. The joint slides under a force-limited velocity drive of 6 N m; its friction is what is missing of I q''.
Coefficient 0.05, gravity 10 m/s², 10 position iterations and no velocity iteration unless said otherwise, 2 ms.
The numbers were measured with sapien 3.0.3 (PhysX 5.3.1) on a CPU.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import pytest

from stiction.sim.fleet import load_size

COEFFICIENT, DRIVE, STEP = 0.05, 6.0, 0.002
ALONG, ACROSS = (-10.0, 0.0, 0.0), (0.0, 0.0, -10.0)


@dataclass(frozen=True)
class Case:
    """One set-up, and the friction measured in PhysX."""

    name: str
    friction: float
    """[N m]."""
    own: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Centre of mass of the first link, from the joint [m]."""
    second: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position of the second [m]."""
    gravity: tuple[float, float, float] = ALONG
    """[m/s²]."""
    velocity_iterations: int = 0
    """Velocity iterations of the solver."""

    @property
    def inertia(self) -> float:
        """About the joint [kg m²]."""
        return 0.02 + self.own[1] ** 2 + 2.0 * self.second[1] ** 2


CASES = [
    Case("30 N along the axis", 1.5),
    Case("30 N, one velocity iteration after ten of position", 1.65, velocity_iterations=1),
    Case("30 N across the axis", 1.5, gravity=ACROSS, second=(0.0, 0.0, 0.0)),
    Case("30 N and 8 N m about the first link's centre, no torque about the axis", 1.9, second=(0.0, 0.4, 0.0)),
    Case("8 N m by a force across the axis", 1.9, second=(0.4, 0.0, 0.0), gravity=ACROSS),
    Case("12 N m about the joint, none about the centre", 1.5, (0.4, 0.0, 0.0), (0.4, 0.0, 0.0), ACROSS),
    Case("4 N m about the joint, 16 about the centre", 2.3, (-0.4, 0.0, 0.0), (0.4, 0.0, 0.0), ACROSS),
]


def by_the_formula(case: Case) -> float:
    """Return c (|F| + |T|), T about the first link's centre of mass, times (P + V) / P."""
    weight = np.array(case.gravity)
    torque = np.cross(np.subtract(case.second, case.own), 2.0 * weight)
    load = load_size(np.array([[[3.0 * weight, torque]]]))
    return float(COEFFICIENT * load[0, 0] * (10 + case.velocity_iterations) / 10)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_the_formula_gives_what_physx_was_measured_to_do(case: Case) -> None:
    """Were T taken about the joint, or forces left out, `load` would be another law than the engine's."""
    assert by_the_formula(case) == pytest.approx(case.friction, abs=2e-3)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_our_sensors_read_the_same_load(case: Case) -> None:
    """The same rig in MuJoCo at rest: what the sensors read must be what PhysX multiplies."""
    spec = mujoco.MjSpec()
    spec.option.gravity = case.gravity
    inertia = {"inertia": [0.01] * 3, "explicitinertial": True}
    first = spec.worldbody.add_body(mass=1.0, ipos=case.own, **inertia)
    first.add_joint(axis=[1, 0, 0], frictionloss=1e3)
    first.add_body(pos=case.second, mass=2.0, ipos=[0.0, 0.0, 0.0], **inertia)
    first.add_site(name="load", pos=case.own)
    for quantity in (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE):
        spec.add_sensor(type=quantity, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="load")
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    load = COEFFICIENT * load_size(data.sensordata.reshape(1, 1, 2, 3))[0, 0]
    assert load * (10 + case.velocity_iterations) / 10 == pytest.approx(case.friction, abs=2e-3)


def scene_of(gravity: tuple[float, float, float]):
    """Return sapien and an empty scene without a renderer."""
    sapien = pytest.importorskip("sapien", reason="the package sapien, of the extra 'engines', is needed to ask PhysX")
    sapien.physx.set_scene_config(gravity=np.array(gravity, np.float32))
    physics = sapien.physx.PhysxCpuSystem()
    physics.timestep = STEP
    return sapien, sapien.Scene([physics])


def prepared(articulation, coefficient: float, iterations: tuple[int, int]):
    """Give the joint its friction, switch off everything else that brakes; return the joint."""
    (joint,) = articulation.get_active_joints()
    joint.set_drive_properties(0.0, 0.0)
    joint.set_friction(coefficient)
    articulation.set_solver_position_iterations(iterations[0])
    articulation.set_solver_velocity_iterations(iterations[1])
    for link in articulation.get_links():
        link.set_linear_damping(0.0)
        link.set_angular_damping(0.0)
    return joint


def acceleration(scene, articulation, push) -> float:
    """Return the mean acceleration over steps 5 to 10 under `push()` [rad/s²]."""
    speed = []
    for _ in range(10):
        push()
        scene.step()
        speed.append(float(articulation.qvel[0]))
    return (speed[9] - speed[4]) / (5 * STEP)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_physx_still_does_what_was_measured(case: Case) -> None:
    """Another version with another law would make our comparison history."""
    sapien, scene = scene_of(case.gravity)
    builder, pose = scene.create_articulation_builder(), sapien.Pose
    parent = None
    for mass, at, joint in ((5.0, (0, 0, 0), "fixed"), (1.0, case.own, "revolute_unwrapped"), (2.0, None, "fixed")):
        link = builder.create_link_builder(parent) if parent else builder.create_link_builder()
        link.set_mass_and_inertia(mass, pose(p=at or (0, 0, 0)), np.full(3, 0.01))
        limits = [[-1e5, 1e5]] if joint != "fixed" else []
        link.set_joint_properties(joint, limits, pose(p=(0, 0, 0) if at is not None else case.second), pose(), 0, 0)
        parent = link
    articulation = builder.build(fix_root_link=True)
    joint = prepared(articulation, COEFFICIENT, (10, case.velocity_iterations))
    joint.set_drive_properties(0.0, 1e6, force_limit=DRIVE, mode="force")
    joint.set_drive_velocity_target(1e3)
    friction = DRIVE - case.inertia * acceleration(scene, articulation, lambda: None)
    assert friction == pytest.approx(case.friction, abs=5e-3)
