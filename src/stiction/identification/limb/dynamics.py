"""Dynamics of a tree of links over a whole log, link by link, on a base that stands or moves. NumPy.

Newton and Euler's equations from the base outwards, then the wrench of each link on the axes of the joints that carry
it (Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 5). All vectors are along the base's axes, and what an
accelerometer on the base reads stands for its acceleration and gravity: no orientation is needed. Torques are linear in
a link's mass m, first moment m c and inertia about its origin, so an error of the model is a column of a regression
(`MODES`). MuJoCo has the sum (`mj_inverse`, with which the tests compare) and not the parts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stiction.core.rotation import crosses, matrices_about
from stiction.robots.mechanism import Mechanism
from stiction.robots.model import Body, Link, chain_to

MODES = ("mass", "inertia", "centre_x", "centre_y", "centre_z")
"""Errors of a link: mass by a share, its inertia following; inertia about its centre of mass by a share; centre of mass
along each axis of the link, by a share of its radius of gyration."""

Parameters = tuple[float, np.ndarray, np.ndarray]
"""Mass [kg], first moment [kg m], (3,), and inertia about the origin of the body's frame [kg m²], (3, 3)."""


def parameters(body: Body) -> Parameters:
    """Return the parameters of a body as the model has it."""
    centre = np.array(body.com)
    about_origin = body.inertia_matrix + body.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return body.mass, body.mass * centre, about_origin


def error_parameters(link: Link) -> tuple[Parameters, ...]:
    """Return the change of a link's parameters by a full share of each of `MODES`; the first is the link itself.

    A centre of mass that moves by d changes the inertia about the origin by m (2 c·d 1 − c dᵀ − d cᵀ), d² left out.
    """
    changes: list[Parameters] = [parameters(link), (0.0, np.zeros(3), link.inertia_matrix)]
    for direction in np.eye(3) * gyration(link):
        both = np.outer(link.com, direction)
        turned = link.mass * (2 * np.dot(link.com, direction) * np.eye(3) - both - both.T)
        changes.append((0.0, link.mass * direction, turned))
    return tuple(changes)


def gyration(link: Link) -> float:
    """Return the radius at which a link's mass lies about its centre [m], √(½ tr I / m); 0 without mass."""
    return float(np.sqrt(np.trace(link.inertia_matrix) / 2 / link.mass)) if link.mass > 0 else 0.0


@dataclass(frozen=True)
class Motion:
    """Motion of one body's frame, in the base's axes, T samples."""

    rotation: np.ndarray
    """Rotation to the base's axes, (T, 3, 3)."""
    axis: np.ndarray
    """Axis of its joint, (T, 3); zero for the base."""
    origin: np.ndarray
    """Position of the frame's origin [m], (T, 3)."""
    spin: np.ndarray
    """Angular velocity ω [rad/s], (T, 3)."""
    turning: np.ndarray
    """Angular acceleration ω' [rad/s²], (T, 3)."""
    pull: np.ndarray
    """Acceleration of the origin less gravity, as an accelerometer there reads [m/s²], (T, 3)."""


def base_motion(pull: np.ndarray, spin: np.ndarray | None = None, turning: np.ndarray | None = None) -> Motion:
    """Return the motion of a base, which by default does not turn; arguments: see `Motion`, shape (T, 3) each."""
    still = np.zeros_like(pull)
    level = np.broadcast_to(np.eye(3), (len(pull), 3, 3))
    return Motion(level, still, still, still if spin is None else spin, still if turning is None else turning, pull)


def link_motions(
    links: Sequence[Link], base: Motion, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
) -> list[Motion]:
    """Return the motion of every link.

    position, velocity, acceleration: of all joints [rad, rad/s, rad/s²], shape (T, J) each.
    """
    motions: list[Motion] = []
    for number, link in enumerate(links):
        below = motions[link.parent] if link.parent >= 0 else base
        arm, axis = below.rotation @ np.array(link.origin), below.rotation @ np.array(link.axis)
        relative = axis * velocity[:, number, None]
        motions.append(
            Motion(
                rotation=below.rotation @ matrices_about(np.array(link.axis), position[:, number]),
                axis=axis,
                origin=below.origin + arm,
                spin=below.spin + relative,
                turning=below.turning + axis * acceleration[:, number, None] + crosses(below.spin, relative),
                pull=below.pull + crosses(below.turning, arm) + crosses(below.spin, crosses(below.spin, arm)),
            )
        )
    return motions


def motions_at_rest(links: Sequence[Link], position: np.ndarray, pull: np.ndarray | None = None) -> list[Motion]:
    """Return the motions of links at joint angles [rad], (T, J), at rest on a base that feels `pull` [m/s²], (3,)."""
    still = np.zeros_like(position)
    return link_motions(
        links, base_motion(np.tile(np.zeros(3) if pull is None else pull, (len(position), 1))), position, still, still
    )


def wrench(motion: Motion, body: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Return the force [N] and the moment about its origin [N m] that move a body as it moves, (T, 3) each."""
    mass, first, inertia = body
    moment_arm = motion.rotation @ first
    turned = motion.rotation @ inertia @ motion.rotation.transpose(0, 2, 1)
    momentum = np.einsum("tij,tj->ti", turned, motion.spin)
    force = mass * motion.pull + crosses(motion.turning, moment_arm)
    force += crosses(motion.spin, crosses(motion.spin, moment_arm))
    moment = crosses(moment_arm, motion.pull) + np.einsum("tij,tj->ti", turned, motion.turning)
    return force, moment + crosses(motion.spin, momentum)


def effort(
    links: Sequence[Link], motions: Sequence[Motion], number: int, body: Parameters
) -> tuple[np.ndarray, np.ndarray]:
    """Return the effort to move link `number` with these parameters: joint torques, and wrench about the base's origin.

    Torques [N m], (T, J), rotors and friction left out; force [N] and moment [N m], (T, 6).
    """
    torque, motion = np.zeros((len(motions[0].origin), len(links))), motions[number]
    force, moment = wrench(motion, body)
    if any(np.any(part) for part in body):
        for joint in chain_to(links, number):
            arm = motion.origin - motions[joint].origin
            torque[:, joint] = np.sum(motions[joint].axis * (moment + crosses(arm, force)), axis=1)
    return torque, np.concatenate([force, moment + crosses(motion.origin, force)], axis=1)


def whole_effort(links: Sequence[Link], motions: Sequence[Motion]) -> tuple[np.ndarray, np.ndarray]:
    """Return the effort to move all links as the model has them; see `effort`."""
    parts = [effort(links, motions, number, parameters(link)) for number, link in enumerate(links)]
    torques, wrenches = (np.sum(each, axis=0) for each in zip(*parts, strict=True))
    return torques, wrenches


def joint_inertia(links: Sequence[Link], position: np.ndarray) -> np.ndarray:
    """Return the inertia of the links about each joint, all others held at angles [rad], (J,), in kg m², (J,)."""
    each = np.eye(len(links))
    # In one sample for each joint that one alone speeds up, by 1 rad/s²; without weight nothing else asks for torque.
    base, still = base_motion(np.zeros((len(links), 3))), np.tile(position, (len(links), 1))
    return whole_effort(links, link_motions(links, base, still, 0 * each, each))[0].diagonal()


def link_torques(
    mechanism: Mechanism, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
) -> Iterator[np.ndarray]:
    """Yield, link by link, the joint torques of a full share of each of `MODES` on a held base [N m], (MODES, T, J).

    The first mode scales all of a link: at a full share it is the torque of the link itself. position, velocity,
    acceleration: see `link_motions`.
    """
    base = base_motion(np.broadcast_to(-np.array(mechanism.gravity), (len(position), 3)))
    motions = link_motions(mechanism.links, base, position, velocity, acceleration)
    for number, link in enumerate(mechanism.links):
        yield np.stack([effort(mechanism.links, motions, number, change)[0] for change in error_parameters(link)])


def model_torques(mechanism: Mechanism, *motion: np.ndarray, errors: np.ndarray | None = None) -> np.ndarray:
    """Return the torques that the links' motion needs at the joints of a held base, rotors apart [N m], (T, J).

    motion: see `link_torques`; errors: shares of `MODES` by which each link errs, shape (J, MODES), none by default.
    """
    shares = np.zeros((mechanism.num_joints, len(MODES))) if errors is None else errors.copy()
    # The first mode is the link itself, which is there without any error.
    shares[:, 0] += 1.0
    torques = (np.tensordot(share, modes, 1) for share, modes in zip(shares, link_torques(mechanism, *motion)))
    return sum(torques, np.zeros_like(motion[0]))
