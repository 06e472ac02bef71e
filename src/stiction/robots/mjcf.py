"""MuJoCo model of a `Robot`.

Every joint has a `position` actuator of the same name, in the order of `Robot.joint_names`; every foot has a touch
sensor (normal force, N). On request every joint also has a force and a torque sensor, after those of the feet. Dry
friction is the solver's `frictionloss`, stiff enough to hold, or a slider (see `robots.physics`).
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from stiction.robots.model import DELAY_SAMPLES, Body, Foot, Joint, Robot
from stiction.robots.physics import EXACT, LEAST_LS_ITERATIONS, SMALLEST_YIELD, PhysicsCfg, friction_row
from stiction.robots.shapes import Shape, Vector, bounds

STONES: tuple[Vector, Vector] = ((0.80, 0.81, 0.77), (0.72, 0.74, 0.70))
"""Alternating colors of the boxes of a course."""

PLAIN: Vector = (0.62, 0.66, 0.70)
"""Default color of a shape."""

SOLVERS = {"newton": mujoco.mjtSolver.mjSOL_NEWTON, "pgs": mujoco.mjtSolver.mjSOL_PGS}
"""MuJoCo's solvers by the names of `PhysicsCfg`."""

SHAPES = {
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "hull": mujoco.mjtGeom.mjGEOM_MESH,
}

GROUND, OBSTACLE = 1, 2
"""Collision bits: feet and trunk touch the plane, obstacles and each other, shanks obstacles alone, thighs nothing."""

CONTACT = {"ground": (GROUND, GROUND), "obstacles": (OBSTACLE, 0), "nothing": (0, 0)}
"""Bits of MuJoCo's `contype` and `conaffinity` by the contact of a shape."""


def build(
    robot: Robot,
    timestep: float = 0.005,
    obstacles: np.ndarray | None = None,
    joint_sensors: bool = False,
    physics: PhysicsCfg = EXACT,
) -> mujoco.MjSpec:
    """Return the robot on the ground as an `MjSpec`, its base free, in its standing pose (keyframe 0).

    `timestep`: physics step [s]; `obstacles`: half sizes of boxes [m], (boxes, 3), parked far below until they are
    placed; `joint_sensors`: measure the load of every joint, see `_add_joint_sensors`; `physics`: of dry friction.
    """
    spec = mujoco.MjSpec()
    spec.modelname = robot.name
    spec.compiler.degree = False
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    # MuJoCo would put a robot that blew up back into its first pose without a word.
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_AUTORESET
    spec.option.solver = SOLVERS[physics.solver_name]
    spec.option.iterations = physics.solver_iterations
    spec.option.ls_iterations = LEAST_LS_ITERATIONS
    _add_scene(spec)
    _add_obstacles(spec, np.zeros((0, 3)) if obstacles is None else obstacles)
    base = spec.worldbody.add_body(name="base", pos=[0, 0, robot.standing_height], **_mass(robot.base))
    base.add_freejoint(name="root")
    for shape in robot.base.shapes:
        name = "base" if shape is robot.base.shapes[0] else ""
        _add_shape(spec, base, shape, name)
    bodies = _add_links(spec, base, robot, physics)
    for foot in robot.feet:
        _add_foot(spec, bodies[foot.link], foot)
    if joint_sensors:
        _add_joint_sensors(spec, robot)
    _add_actuators(spec, robot)
    standing = robot.joint_values("default_position")
    slack = {"plastic": standing} if physics.plastic else {}
    spec.add_key(name="standing", qpos=[0, 0, robot.standing_height, 1, 0, 0, 0, *standing], ctrl=standing, **slack)
    return spec


def build_model(
    robot: Robot,
    timestep: float = 0.005,
    obstacles: np.ndarray | None = None,
    joint_sensors: bool = False,
    physics: PhysicsCfg = EXACT,
) -> mujoco.MjModel:
    """Return the compiled model of `build`."""
    return build(robot, timestep, obstacles, joint_sensors, physics).compile()


def standing_inertia(model: mujoco.MjModel) -> np.ndarray:
    """Return the inertia matrix of a model from `build`, in its standing pose, shape (nv, nv)."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    return inertia


def _mass(body: Body) -> dict[str, Any]:
    """Return mass, centre and inertia as fields of `MjsBody`; principal axes along the frame's stay unchanged."""
    fields: dict[str, Any] = {"mass": body.mass, "ipos": body.com, "explicitinertial": True}
    if any(body.inertia[3:]):
        return fields | {"fullinertia": body.inertia}
    return fields | {"inertia": body.inertia[:3]}


def _friction(joint: Joint, timestep: float, physics: PhysicsCfg) -> dict[str, Any]:
    """Return a joint's dry friction as fields of `MjsJoint`."""
    rows: dict[str, Any] = dict(
        zip(("solref_friction", "solimp_friction"), friction_row(timestep, physics.impedance), strict=True)
    )
    if not physics.plastic:
        return rows | {"frictionloss": joint.frictionloss}
    # The angle in the state `plastic` is the one at which the spring is slack: its reference is zero.
    return rows | {
        "stiffness": np.array([physics.stiffness, 0.0, 0.0]),
        "springref": 0.0,
        "springyield": max(joint.frictionloss / physics.stiffness, SMALLEST_YIELD),
    }


def _add_links(spec: mujoco.MjSpec, base: mujoco.MjsBody, robot: Robot, physics: PhysicsCfg) -> list[mujoco.MjsBody]:
    """Add all links with their joints and shapes; return their bodies in the order of the joints."""
    bodies: list[mujoco.MjsBody] = []
    for link, joint in zip(robot.links, robot.joints, strict=True):
        below = bodies[link.parent] if link.parent >= 0 else base
        body = below.add_body(name=link.name, pos=link.origin, **_mass(link))
        body.add_joint(
            name=joint.name,
            axis=link.axis,
            range=[joint.lower, joint.upper],
            limited=mujoco.mjtLimited.mjLIMITED_TRUE,
            armature=joint.armature,
            damping=np.array([joint.damping, 0.0, 0.0]),
            **_friction(joint, spec.option.timestep, physics),
        )
        for shape in link.shapes:
            _add_shape(spec, body, shape)
        bodies.append(body)
    return bodies


def _add_shape(spec: mujoco.MjSpec, body: mujoco.MjsBody, shape: Shape, name: str = "", **fields: Any) -> None:
    """Add one shape to a body."""
    contype, conaffinity = CONTACT[shape.contact]
    if shape.kind == "hull":
        mesh = spec.add_mesh(name=f"{body.name}_hull{len(spec.meshes)}", uservert=np.ravel(shape.vertices))
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        fields["meshname"] = mesh.name
    body.add_geom(
        name=name,
        type=SHAPES[shape.kind],
        size=shape.size,
        pos=shape.position,
        quat=shape.quaternion,
        contype=contype,
        conaffinity=conaffinity,
        rgba=[*(shape.color or PLAIN), 1],
        **fields,
    )


def foot_geometries(robot: Robot) -> list[str]:
    """Return the names of the geometries of all feet; the first of each foot has the foot's name."""
    return [name for foot in robot.feet for name in foot.geometry_names]


def _add_foot(spec: mujoco.MjSpec, link: mujoco.MjsBody, foot: Foot) -> None:
    """Add the contact shapes of one foot, and its sensor."""
    for name, shape in zip(foot.geometry_names, foot.shapes, strict=True):
        # By priority a foot's friction holds, whatever the ground's is; without it MuJoCo takes the larger of the two.
        _add_shape(spec, link, shape, name, priority=1, friction=[1.0, 0.005, 0.0001])
    if foot.is_ball:
        link.add_site(name=foot.name, size=[1.2 * foot.radius, 0, 0], pos=foot.position, group=4)
    else:
        low, high = bounds(foot.shapes)
        link.add_site(
            name=foot.name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            # Larger than the sole: a touch sensor counts contacts inside its site, and those lie on the surface.
            size=0.6 * (high - low),
            pos=(low + high) / 2,
            group=4,
        )
    spec.add_sensor(
        name=f"{foot.name.removesuffix('_foot')}_touch",
        type=mujoco.mjtSensor.mjSENS_TOUCH,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=foot.name,
    )


def _add_joint_sensors(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Add sensors of force [N] and torque [N m] between each joint's two links, joint by joint, three axes each.

    The torque is about the centre of mass of the link behind the joint: there PhysX takes it for its joint friction
    (`stiction.sim.fleet`).
    """
    for name in robot.joint_names:
        link = spec.joint(name).parent
        link.add_site(name=f"{name}_load", pos=link.ipos, size=[0.01, 0, 0], group=4)
        for kind, quantity in (("force", mujoco.mjtSensor.mjSENS_FORCE), ("torque", mujoco.mjtSensor.mjSENS_TORQUE)):
            spec.add_sensor(
                name=f"{name}_{kind}", type=quantity, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=f"{name}_load"
            )


def _add_scene(spec: mujoco.MjSpec) -> None:
    """Add ground, light and the offscreen size."""
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 960, 720
    spec.add_texture(
        name="grid",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.93, 0.93, 0.91],
        rgb2=[0.84, 0.85, 0.84],
        width=256,
        height=256,
    )
    material = spec.add_material(name="grid", texrepeat=[2, 2], texuniform=True)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "grid"
    spec.worldbody.add_light(pos=[0, 0, 4], dir=[0.2, 0.2, -1], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.5], material="grid")


def _add_obstacles(spec: mujoco.MjSpec, half_sizes: np.ndarray) -> None:
    """Add boxes that each simulation places.

    MuJoCo sorts the boxes of a body into a tree when it compiles, which ignores later places: it is left out. A box
    that is not turned when it compiles counts as one that never is, so these are turned, about z.
    """
    for number, half in enumerate(half_sizes):
        spec.worldbody.add_geom(
            name=f"obstacle{number}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=half,
            pos=[0.0, 0.0, -10.0],
            quat=[0.8, 0.0, 0.0, 0.6],
            contype=OBSTACLE,
            conaffinity=GROUND | OBSTACLE,
            rgba=[*STONES[number % 2], 1],
        )
    if len(half_sizes):
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE


def _add_actuators(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Add one PD position actuator per joint, limited to the motor's torque."""
    rows = zip(
        robot.joint_names,
        robot.joint_values("kp"),
        robot.joint_values("kd"),
        robot.joint_values("torque_limit"),
        strict=True,
    )
    for name, kp, kd, limit in rows:
        spec.add_actuator(
            name=name,
            target=name,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            gaintype=mujoco.mjtGain.mjGAIN_FIXED,
            biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            gainprm=[kp, *[0.0] * 9],
            biasprm=[0.0, -kp, -kd, *[0.0] * 7],
            forcerange=[-limit, limit],
            forcelimited=mujoco.mjtLimited.mjLIMITED_TRUE,
            nsample=DELAY_SAMPLES,
        )
