"""Inverse dynamics of a mechanism over a whole log, link by link: what each link's errors would do to every torque.

Newton and Euler's equations from the base outwards, then the wrench of each link on the axes of the joints that carry
it (Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 5). Torques are linear in a link's mass m, first moment
m c and inertia about its origin, so an error of the model is a column of a regression (`MODES`). MuJoCo has the sum
(`mj_inverse`, with which the tests compare) and not the parts; NumPy does a whole log at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.core.rotation import crosses, matrices_about
from stiction.robots.mechanism import Mechanism
from stiction.robots.model import Link

MODES = ("mass", "inertia", "centre_x", "centre_y", "centre_z")
"""Errors of a link: mass by a share, its inertia following; inertia about its centre of mass by a share; centre of mass
along each axis of the link, by a share of its radius of gyration."""


@dataclass(frozen=True)
class LinkTorques:
    """Torques of the links of a mechanism, J joints and links, T samples."""

    nominal: np.ndarray
    """By the model as it is, rotors apart [N m], shape (T, J)."""
    modes: np.ndarray
    """Change by a full share (an error of 1) of each error of each link [N m], shape (J links, MODES, T, J joints)."""


def link_torques(
    mechanism: Mechanism, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
) -> LinkTorques:
    """Return the torques that the links' motion needs at the joints, and their sensitivity to each link parameter.

    position, velocity, acceleration: of all joints [rad, rad/s, rad/s²], shape (T, J) each.
    """
    motions = _motions(mechanism, position, velocity, acceleration)
    modes = np.stack(
        [
            np.stack([_torques(mechanism, motions, number, one) for one in error_parameters(link)])
            for number, link in enumerate(mechanism.links)
        ]
    )
    # The first mode scales all of a link, so at a share of one it is the link itself.
    return LinkTorques(modes[:, 0].sum(axis=0), modes)


def corrected_torques(
    mechanism: Mechanism,
    errors: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
) -> np.ndarray:
    """Return what the links ask of the joints if they err by `errors`, (J, MODES); the rest: `link_torques`."""
    motions = _motions(mechanism, position, velocity, acceleration)
    total = np.zeros_like(position)
    for number, link in enumerate(mechanism.links):
        modes = error_parameters(link)
        shares = (1.0 + errors[number, 0], *errors[number, 1:])
        parts = zip(*modes)
        mass, first, inertia = (sum(share * part for share, part in zip(shares, kind)) for kind in parts)
        total += _torques(mechanism, motions, number, (float(mass), np.asarray(first), np.asarray(inertia)))
    return total


Parameters = tuple[float, np.ndarray, np.ndarray]
"""Mass [kg], first moment [kg m], (3,), and inertia about the link's origin [kg m²], (3, 3)."""


def error_parameters(link: Link) -> tuple[Parameters, ...]:
    """Return the change of a link's parameters by a full share of each of `MODES`; the first is the link itself.

    A centre of mass that moves by d changes the inertia about the origin by m (2 c·d 1 − c dᵀ − d cᵀ), d² left out.
    """
    centre, about_centre = np.array(link.com), link.inertia_matrix
    whole = about_centre + link.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    found: list[Parameters] = [(link.mass, link.mass * centre, whole), (0.0, np.zeros(3), about_centre)]
    for direction in np.eye(3) * gyration(link):
        both = np.outer(centre, direction)
        turned = link.mass * (2 * centre @ direction * np.eye(3) - both - both.T)
        found.append((0.0, link.mass * direction, turned))
    return tuple(found)


def gyration(link: Link) -> float:
    """Return the radius at which a link's mass lies about its centre [m], √(½ tr I / m); 0 without mass."""
    return float(np.sqrt(np.trace(link.inertia_matrix) / 2 / link.mass)) if link.mass > 0 else 0.0


@dataclass(frozen=True)
class _Motion:
    """How one link's frame moves, in the base's axes, T samples."""

    rotation: np.ndarray
    """(T, 3, 3)."""
    axis: np.ndarray
    """Of its joint, (T, 3)."""
    origin: np.ndarray
    """[m], (T, 3)."""
    spin: np.ndarray
    """ω [rad/s], (T, 3)."""
    turning: np.ndarray
    """ω' [rad/s²], (T, 3)."""
    pull: np.ndarray
    """Acceleration of the origin less gravity [m/s²], (T, 3)."""


def _motions(
    mechanism: Mechanism, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
) -> list[_Motion]:
    """Return the motion of every link."""
    count = len(position)
    still = np.zeros((count, 3))
    # A base that accelerates against gravity gives every link its weight, and no equation needs a term for it.
    pull = np.broadcast_to(-np.array(mechanism.gravity), (count, 3))
    base = _Motion(np.broadcast_to(np.eye(3), (count, 3, 3)), still, still, still, still, pull)
    found: list[_Motion] = []
    for number, link in enumerate(mechanism.links):
        below = found[link.parent] if link.parent >= 0 else base
        arm = below.rotation @ np.array(link.origin)
        axis = below.rotation @ np.array(link.axis)
        own = axis * velocity[:, number, None]
        found.append(
            _Motion(
                rotation=below.rotation @ matrices_about(np.array(link.axis), position[:, number]),
                axis=axis,
                origin=below.origin + arm,
                spin=below.spin + own,
                turning=below.turning + axis * acceleration[:, number, None] + crosses(below.spin, own),
                pull=below.pull + crosses(below.turning, arm) + crosses(below.spin, crosses(below.spin, arm)),
            )
        )
    return found


def _torques(mechanism: Mechanism, motions: list[_Motion], number: int, parameters: Parameters) -> np.ndarray:
    """Return the joint torques that move link `number` with these parameters [N m], shape (T, J)."""
    found = np.zeros((len(motions[0].origin), mechanism.num_joints))
    if any(np.any(part) for part in parameters):
        force, moment = _wrench(motions[number], *parameters)
        for joint in mechanism.chain(number):
            arm = motions[number].origin - motions[joint].origin
            found[:, joint] = np.sum(motions[joint].axis * (moment + crosses(arm, force)), axis=1)
    return found


def _wrench(motion: _Motion, mass: float, first: np.ndarray, inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the force [N] and the moment about the link's origin [N m] that move a link as it moves, (T, 3) each."""
    moment_arm = motion.rotation @ first
    turned = motion.rotation @ inertia @ motion.rotation.transpose(0, 2, 1)
    momentum = np.einsum("tij,tj->ti", turned, motion.spin)
    force = mass * motion.pull + crosses(motion.turning, moment_arm)
    force += crosses(motion.spin, crosses(motion.spin, moment_arm))
    moment = crosses(moment_arm, motion.pull) + np.einsum("tij,tj->ti", turned, motion.turning)
    return force, moment + crosses(motion.spin, momentum)
