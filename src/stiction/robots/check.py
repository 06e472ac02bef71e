"""Checks of a robot before it is simulated or trained, with a remedy for each finding.

Most robots that fail here fail later too, and then look like a bad policy: a lost mass, a limit in degrees, an unknown
armature, a pose that it cannot hold.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from stiction.core.errors import StictionError
from stiction.core.rotation import uprightness
from stiction.robots.mirror import robot_mirror
from stiction.robots.mjcf import build_model
from stiction.robots.model import FALLEN_UP, WIDEST, Body, Robot, too_low
from stiction.robots.shapes import reach

State = Literal["good", "note", "bad"]
"""`note`: for information; `bad`: to be corrected before the robot is used."""

GRAVITY_SHARE = 0.6
"""Maximum share of a torque limit that holding the pose takes: the rest is for walking."""

STANDING_TIME = 3.0
"""Time that the robot must stand under its gains [s]."""

SUNK = 0.01
"""Depth below the ground at which a link other than a foot lies on it [m]: contacts yield less."""

NARROWEST = 0.1
"""Range below which, if most ranges are, the file was hardly meant in degrees [rad]."""

HIGHEST = 10.0
"""Maximum height of the base, and distance of two successive joints [m]."""

SHORTEST = 0.1
"""Minimum height of a base by which motors are judged [m]."""

STRONGEST = 10.0
"""Maximum torque limit, over the robot's weight times its standing height; known: 0.2 to 0.9 [1]."""

STIFFEST = 100.0
"""Maximum kp over the torque limit; known: 0.1 to 4 [1/rad]."""

UNITS = {"torque_limit": "N m", "armature": "kg m²", "kp": "N m/rad", "frictionloss": "N m"}
"""Field of a joint -> its unit."""

LIGHTEST, HEAVIEST = 0.5, 1000.0
"""Range of plausible masses of robots [kg]."""


@dataclass(frozen=True)
class Finding:
    """Result of one check."""

    check: str
    state: State
    text: str
    """Observation."""
    mend: str = ""
    """Remedy: the line to add, mostly to `robot.yaml`."""


def check_robot(robot: Robot) -> tuple[Finding, ...]:
    """Return the results of all checks, in their order; the robot can be used where none is `bad`.

    Impossible masses cannot be simulated, so the checks in which the robot stands are then skipped.
    """
    findings = [
        finding
        for check in (_mass, _size, _inertias, _limits, _motors, _feet, _mirror, _order)
        for finding in check(robot)
    ]
    if not any(finding.state == "bad" and finding.check in ("mass", "size", "inertia") for finding in findings):
        findings += [*_gravity(robot), *_stands(robot)]
    return tuple(findings)


def _mass(robot: Robot) -> Iterator[Finding]:
    """Check the whole robot's mass, and the base's share of it."""
    if not LIGHTEST <= robot.mass <= HEAVIEST:
        yield Finding("mass", "bad", f"the robot weighs {robot.mass:.4g} kg", "give the masses of the file in kg")
        return
    if robot.base.mass < 0.05 * robot.mass:
        yield Finding(
            "mass",
            "bad",
            f"the base weighs {robot.base.mass:.3g} kg of {robot.mass:.4g} kg; the trunk's mass is lost, or another "
            "body is the base",
            "base: NAME of the trunk's body",
        )
        return
    yield Finding("mass", "good", f"{robot.mass:.4g} kg, of which the base has {robot.base.mass:.4g} kg")


def _size(robot: Robot) -> Iterator[Finding]:
    """Check that lengths are metres, and that the base is above the feet."""
    far = max(robot.links, key=lambda link: float(np.linalg.norm(link.origin)))
    distance = float(np.linalg.norm(far.origin))
    if not 0 < robot.standing_height < HIGHEST or distance > HIGHEST:
        yield Finding(
            "size", "bad",
            f"the base stands {robot.standing_height:.4g} m above the ground, {far.name} is {distance:.4g} m from the "
            "link before it; are lengths in millimetres, or the feet wrong?",
            "feet: [...], base: NAME, or give the lengths of the file in metres",
        )  # fmt: skip


def _inertias(robot: Robot) -> Iterator[Finding]:
    """Check that inertias are physical and fit the size of their links."""
    named: list[tuple[str, Body]] = [("base", robot.base), *((link.name, link) for link in robot.links)]
    wrong = []
    for name, body in named:
        moments = np.linalg.eigvalsh(body.inertia_matrix)
        if not body.is_physical:
            wrong.append(f"{name} ({', '.join(f'{moment:.3g}' for moment in moments)} kg m²)")
        elif np.sqrt(moments[2] / body.mass) > 2.0:
            wrong.append(f"{name} (radius of gyration {np.sqrt(moments[2] / body.mass):.3g} m)")
    if wrong:
        yield Finding(
            "inertia",
            "bad",
            f"no body has such moments: {'; '.join(wrong)}",
            "correct the inertia of these in the file",
        )
    else:
        yield Finding("inertia", "good", f"those of {len(named)} bodies are physical")


def _limits(robot: Robot) -> Iterator[Finding]:
    """Check that limits are angles in radians, with the pose well inside."""
    wide = [joint.name for joint in robot.joints if joint.upper - joint.lower > WIDEST]
    if wide:
        yield Finding(
            "limits", "bad", f"the range of {', '.join(wide)} is more than two turns; is it in degrees?",
            f"joints: {{{wide[0]}: {{lower: ..., upper: ...}}}} in radians",
        )  # fmt: skip
    narrow = [joint.name for joint in robot.joints if joint.upper - joint.lower < NARROWEST]
    if 2 * len(narrow) > robot.num_joints:
        yield Finding(
            "limits", "bad",
            f"the ranges of {len(narrow)} joints are below {NARROWEST:g} rad; does the file mean radians, and its "
            "compiler take degrees?",
            '<compiler angle="radian"/> in the file',
        )  # fmt: skip
    near = [
        joint.name
        for joint in robot.joints
        if min(joint.default_position - joint.lower, joint.upper - joint.default_position) < 0.02
    ]
    if near:
        yield Finding(
            "limits", "note", f"the pose is within 0.02 rad of a limit at {', '.join(near)}", "pose: further inside"
        )
    if not wide:
        yield Finding("limits", "good", "ranges are below two turns, and the pose is inside")


def _motors(robot: Robot) -> Iterator[Finding]:
    """Check that torque limits, armatures, gains and friction are plausible for motors."""
    armature, limit = robot.joint_values("armature"), robot.joint_values("torque_limit")
    kp, kd = robot.joint_values("kp"), robot.joint_values("kd")
    # Where the feet are none, `_size` says so, and no height may be divided by.
    friction, height = robot.joint_values("frictionloss"), max(robot.standing_height, SHORTEST)
    strength, turned = limit / (robot.weight * height), armature / (robot.mass * height**2)
    bad = [
        *_first_outlier(
            robot, "bad", strength > STRONGEST, "torque_limit",
            lambda n: f"has a torque limit of {limit[n]:.3g} N m, {strength[n]:.0f} times the robot's weight at its "
            "height; is it in N m?",
        ),
        *_first_outlier(
            robot, "bad", turned > 1, "armature",
            lambda n: f"has an armature of {armature[n]:.3g} kg m², {turned[n]:.3g} times the whole robot's inertia "
            "about its feet; is it in kg m²?",
        ),
        *_first_outlier(
            robot, "bad", kp > STIFFEST * limit, "kp",
            lambda n: f"asks for its {limit[n]:.3g} N m at an error of {limit[n] / kp[n]:.2g} rad, kp {kp[n]:.3g}; "
            "is it in N m/rad?",
        ),
        *_first_outlier(
            robot, "bad", friction >= limit, "frictionloss",
            lambda n: f"has a friction of {friction[n]:.3g} N m and a motor of {limit[n]:.3g} N m: it never moves",
        ),
    ]  # fmt: skip
    if bad:
        # What more is odd follows from them.
        yield from bad
        return
    frequency, ratio = np.sqrt(kp / armature) / (2 * np.pi), kd / (2 * np.sqrt(kp * armature))
    yield from _first_outlier(
        robot, "note", frequency > 100.0, "armature",
        lambda n: f"alone would swing at {frequency[n]:.3g} Hz under its kp; armature {armature[n]:.3g} kg m² is small "
        "for it",
    )  # fmt: skip
    yield from _first_outlier(
        robot, "note", kp * 1.0 < 0.1 * limit, "kp",
        lambda n: f"asks at an error of 1 rad for {kp[n]:.3g} of {limit[n]:.3g} N m; it is soft",
    )  # fmt: skip
    yield Finding(
        "motors", "good",
        f"torque limits {_span(limit)} N m, armature {_span(armature)} kg m², kp {_span(kp)} N m/rad, damping ratio of "
        f"the motors {_span(ratio)}",
    )  # fmt: skip


def _first_outlier(
    robot: Robot, state: State, wrong: np.ndarray, field: str, text: Callable[[int], str]
) -> Iterator[Finding]:
    """Yield a finding of the first joint that is `wrong`, shape (num_joints,); text: message by its number."""
    for number in np.flatnonzero(wrong)[:1]:
        joint, more = robot.joint_names[number], int(wrong.sum()) - 1
        named = f"{joint} (and {more} more)" if more else joint
        mend = f"joints: {{{joint}: {{{field}: ...}}}} in {UNITS[field]}"
        yield Finding("motors", state, f"{named} {text(int(number))}", mend)


def _span(values: np.ndarray) -> str:
    """Return the range of values as text."""
    return f"{values.min():.3g} to {values.max():.3g}"


def standing_torques(robot: Robot) -> np.ndarray:
    """Return the torques that hold the pose on flat ground, each foot with its share [N m], shape (num_joints,).

    The feet push up with the least-squares forces that carry the weight and balance about the centre of mass.
    """
    model = build_model(robot)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    data.qvel[:], data.qacc[:] = 0.0, 0.0
    mujoco.mj_inverse(model, data)
    # At rest all of it is gravity's.
    bias = data.qfrc_bias.copy()
    columns = []
    for foot in robot.feet:
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jacSite(model, data, jacobian, None, model.site(foot.name).id)
        columns.append(jacobian[2])
    # The base has no motor: its six rows must be balanced by the feet alone.
    push = np.linalg.lstsq(np.array(columns).T[:6], bias[:6], rcond=None)[0]
    return bias[6:] - np.array(columns).T[6:] @ push


def _gravity(robot: Robot) -> Iterator[Finding]:
    """Check the torques that hold the pose."""
    share = np.abs(standing_torques(robot)) / robot.joint_values("torque_limit")
    worst = int(np.argmax(share))
    name = robot.joint_names[worst]
    text = f"holding the pose takes {share[worst]:.0%} of the torque limit at {name}"
    if share[worst] > GRAVITY_SHARE:
        yield Finding(
            "gravity",
            "bad",
            f"{text}; expected at most {GRAVITY_SHARE:.0%}",
            "pose: with straighter legs, or the true torque_limit",
        )
    else:
        yield Finding("gravity", "good", text)


def _feet(robot: Robot) -> Iterator[Finding]:
    """Check that the robot has feet to stand on, and their groups."""
    groups = robot.groups()
    words = (
        "no contact groups"
        if groups is None
        else "groups "
        + " | ".join(", ".join(foot.name for foot in robot.feet if foot.group == number) for number in (0, 1))
    )
    if len(robot.feet) < 2:
        yield Finding(
            "feet", "bad", f"one foot: {robot.feet[0].name}", "feet: [...], those that touch the ground in the pose"
        )
        return
    yield Finding("feet", "good", f"{len(robot.feet)}: {', '.join(robot.foot_names)}; {words}")


def _mirror(robot: Robot) -> Iterator[Finding]:
    """Check whether left mirrors right."""
    if robot.mirror_names == ():
        yield Finding("mirror", "good", "none, as its description says")
        return
    try:
        mirror = robot_mirror(robot)
    except StictionError as error:
        # What somebody says of the mirror and is not so is a mistake; a robot that has none is no mistake.
        state: State = "bad" if robot.mirror_names else "note"
        yield Finding("mirror", state, str(error), "mirror: none, or correct what differs")
        return
    flipped = int((mirror.sign < 0).sum())
    yield Finding("mirror", "good", f"left mirrors right; {flipped} of {robot.num_joints} angles change their sign")


def _order(robot: Robot) -> Iterator[Finding]:
    """Report the order of the joints, and of the maker's."""
    yield Finding("order", "good", f"joints: {', '.join(robot.joint_names)}")
    if robot.held:
        yield Finding(
            "order", "note", "held rigid: " + ", ".join(f"{joint.name} {joint.position:.3g}" for joint in robot.held)
        )
    if robot.vendor is None:
        yield Finding(
            "order",
            "note",
            "the maker's order, signs and offsets are unknown",
            "vendor: {order: [...], sign: {...}, offset: {...}}",
        )


def _stands(robot: Robot) -> Iterator[Finding]:
    """Check that the robot stands on its feet under its gains in simulation, and on nothing else."""
    model = build_model(robot, timestep=0.002)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    if sunk := _below_ground(robot, model, data):
        depth, names = max(sunk.values()), ", ".join(list(sunk)[:4])
        yield Finding(
            "stands", "bad",
            f"in the pose {names} {'reach' if len(sunk) > 1 else 'reaches'} up to {depth:.2g} m below the feet",
            "pose: with the feet lowest; or name the feet (feet: [...])",
        )  # fmt: skip
        return
    for _ in range(round(STANDING_TIME / model.opt.timestep)):
        mujoco.mj_step(model, data)
        if not np.isfinite(data.qpos).all():
            yield Finding(
                "stands", "bad", f"the simulation fails after {data.time:.2f} s", "check masses, inertias and armature"
            )
            return
    up, height = float(uprightness(data.qpos[3:7])), float(data.qpos[2])
    text = (
        f"after {STANDING_TIME:g} s under its gains the base is at {height:.3g} m of {robot.standing_height:.3g} m, "
        f"leaning {np.degrees(np.arccos(np.clip(up, -1, 1))):.2g}°"
    )
    pairs = [{int(model.geom_bodyid[geom]) for geom in contact.geom} for contact in data.contact]
    lying = ["base"] if {0, model.body("base").id} in pairs else []
    lying += [name for name in _below_ground(robot, model, data) if name]
    fallen = up < FALLEN_UP or too_low(np.array(height), robot.standing_height)
    if (fallen or lying) and len(robot.feet) <= 2:
        # As an inverted pendulum it needs more than m g h from its ankles, which no walking robot's gains have.
        yield Finding("stands", "note", f"it balances only under a policy: {text}")
    elif fallen or lying:
        on = f", on {', '.join(lying[:4])}" if lying else ""
        yield Finding(
            "stands", "bad", f"it falls: {text}{on}", "pose: with the feet under the centre of mass, or a larger kp"
        )
    else:
        yield Finding("stands", "good", text)


def _below_ground(robot: Robot, model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, float]:
    """Return link -> depth below the ground [m], of links that would lie on it: by their joint, or a shape.

    Only feet and trunk touch the ground in simulation; a link that carries a foot may end next to it.
    """
    sunk = {}
    carriers = {foot.link for foot in robot.feet}
    for number, link in enumerate(robot.links):
        body = data.body(link.name)
        down = body.xmat.reshape(3, 3).T @ np.array([0.0, 0.0, -1.0])
        shapes = () if number in carriers else link.shapes
        lowest = body.xpos[2] - max((reach(shape, down) for shape in shapes), default=0.0)
        if min(lowest, body.xpos[2]) < -SUNK:
            sunk[link.name] = -float(min(lowest, body.xpos[2]))
    return sunk
