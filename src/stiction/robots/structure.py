"""Whether what a file describes is a robot that can be simulated: a tree of hinges, with numbers that are numbers.

What is not taken over from a file is said: springs, tendons, keyframes that turn the base, things beside the robot.
"""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from stiction.core.errors import RobotError
from stiction.robots.model import LARGEST

WIDTH = {mujoco.mjtJoint.mjJNT_FREE: 7, mujoco.mjtJoint.mjJNT_BALL: 4}
"""Numbers of a joint's position; hinges and slides have one."""


def check_structure(spec: mujoco.MjSpec, name: str) -> None:
    """Refuse what is more than a tree of rigid bodies with hinges, and joints that nobody can name.

    Raises `RobotError`, and MuJoCo's `ValueError` where two things have one name.
    """
    for equality in spec.equalities:
        raise RobotError(
            f"{name}: the equality constraint {equality.name or equality.name1!r} closes a loop or couples joints; "
            "only trees of free hinges are simulated: remove it, or replace the coupled joints by one"
        )
    for joint in spec.joints:
        if joint.type not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_FREE):
            kind = "slide" if joint.type == mujoco.mjtJoint.mjJNT_SLIDE else "ball"
            called = repr(joint.name) if joint.name else f"of the body {joint.parent.name!r}"
            raise RobotError(f"{name}: the joint {called} is a {kind} joint; only hinges are simulated")
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE and not joint.name:
            raise RobotError(
                f"{name}: a joint of the body {joint.parent.name!r} has no name, or another joint's; give every joint "
                "one in the file: what a policy moves is told by name"
            )
        if not np.isfinite([*joint.range, joint.armature]).all():
            raise RobotError(f"{name}: joint {joint.name!r} has a number that is none in range or armature")


def num_positions(spec: mujoco.MjSpec) -> int:
    """Return the number of generalised positions of a robot (MuJoCo's nq)."""
    return sum(WIDTH.get(joint.type, 1) for joint in spec.joints)


def check_keyframes(spec: mujoco.MjSpec, name: str) -> None:
    """Refuse a keyframe of another length: MuJoCo fills it up, and every joint stands at its neighbour's angle."""
    for key in spec.keys:
        if len(key.qpos) not in (0, num_positions(spec)):
            raise RobotError(
                f"{name}: the keyframe {key.name!r} has {len(key.qpos)} positions, the model {num_positions(spec)}; "
                "remove it, or correct its qpos"
            )


def check_numbers(model: mujoco.MjModel, name: str) -> None:
    """Refuse a model with a number that is none, or that overflows: it would be found as something else, or not at all.

    Raises `RobotError` naming the body, joint or actuator.
    """
    for kind, fields in (
        ("body", (model.body_pos, model.body_quat, model.body_ipos, model.body_mass, model.body_inertia)),
        ("jnt", (model.jnt_axis, model.jnt_pos, model.jnt_range)),
        ("geom", (model.geom_pos, model.geom_size)),
        ("key", (model.key_qpos,)),
    ):
        for values in fields:
            # In this form a NaN is found too.
            number = next((row for row, own in enumerate(values) if not (np.abs(own) < LARGEST).all()), None)
            if number is not None:
                word = {"jnt": "joint", "geom": "geometry", "key": "keyframe"}.get(kind, kind)
                called = getattr(model, {"jnt": "joint"}.get(kind, kind))(number).name
                found = ", ".join(f"{value:.4g}" for value in np.ravel(values[number])[:8])
                raise RobotError(
                    f"{name}: the {word} {called!r} has numbers that no robot has ({found}); correct them in the file"
                )


def not_taken(model: mujoco.MjModel, root: int) -> Iterator[str]:
    """Yield a sentence for everything that a file has and that is not simulated; `root`: number of the base's body."""
    springs = [model.joint(joint).name for joint in np.flatnonzero(np.any(_stiffness(model), axis=1))]
    if springs:
        yield f"the file has springs at {', '.join(springs)}; they are not simulated"
    if model.ntendon:
        names = ", ".join(model.tendon(tendon).name or str(tendon) for tendon in range(model.ntendon))
        yield f"the file has tendons ({names}); they are not simulated, and what they couple moves freely"
    floated = [model.body(body).name for body in np.flatnonzero(model.body_gravcomp)]
    if floated:
        yield f"the file takes the weight of {', '.join(floated)} away (gravcomp); here it has it"
    others = [body for body in range(1, model.nbody) if model.body_rootid[body] == body and body != root]
    loose = [model.body(body).name for body in others if model.body_dofnum[body]]
    if loose:
        yield f"beside the robot the file has {', '.join(map(repr, loose))}, which is left out"
    for number in range(model.nkey):
        address = int(model.jnt_qposadr[model.body_jntadr[root]])
        yield from _turned(
            model.key_qpos[number, address + 3 : address + 7], f"the keyframe {model.key(number).name!r}"
        )
    yield from _turned(model.body_quat[root], "the file")


def _stiffness(model: mujoco.MjModel) -> np.ndarray:
    """Return the stiffness of springs at each joint, a row each."""
    return model.jnt_stiffness.reshape(model.njnt, -1)


def _turned(quaternion: np.ndarray, what: str) -> Iterator[str]:
    """Yield a sentence where a base stands turned, by more than 5°."""
    # A quaternion and its negative are one rotation.
    angle = 2 * np.arccos(np.clip(abs(quaternion[0]) / max(float(np.linalg.norm(quaternion)), 1e-9), 0, 1))
    if angle > np.radians(5.0):
        yield (
            f"{what} has the base turned by {np.degrees(angle):.0f}°; here it stands along its own axes, x forward, y "
            "left, z up: where they are not, say base: NAME of a body rigid with it that has such axes"
        )
