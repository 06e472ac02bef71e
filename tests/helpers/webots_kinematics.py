"""Where the links of a robot that was read from a PROTO are, as Webots places them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from webots_files import Read


@dataclass(frozen=True)
class Placed:
    """A solid in the world."""

    solid: Read
    origin: np.ndarray
    """Origin of its frame [m], shape (3,)."""
    rotation: np.ndarray
    """From its frame to the world, shape (3, 3)."""

    @property
    def centre(self) -> np.ndarray:
        """Return its centre of mass in the world [m], shape (3,)."""
        return self.origin + self.rotation @ self.solid["physics"]["centerOfMass"][0]

    @property
    def inertia(self) -> np.ndarray:
        """Return its inertia about that, along the world's axes [kg m²], shape (3, 3)."""
        (xx, yy, zz), (xy, xz, yz) = self.solid["physics"]["inertiaMatrix"]
        return self.rotation @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ self.rotation.T


def turn(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the matrix of a rotation about a unit axis (Rodrigues), shape (3, 3)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def place(robot: Read, angles: Mapping[str, float]) -> dict[str, Placed]:
    """Return name -> link of a robot whose joints are turned by `angles` [rad] from where the file has them.

    As WbHingeJoint::computeEndPointSolidPositionFromParameters: about the anchor, in the frame of the solid before.
    """
    placed: dict[str, Placed] = {}

    def add(solid: Read, origin: np.ndarray, rotation: np.ndarray, name: str) -> None:
        placed[name] = Placed(solid, origin, rotation)
        for hinge in [child for child in solid["children"] if child.kind == "HingeJoint"]:
            parameters, end = hinge["jointParameters"], hinge["endPoint"]
            motor = next(device["name"] for device in hinge["device"] if device.kind == "RotationalMotor")
            swing = turn(parameters["axis"], angles.get(motor, 0.0))
            anchor = np.array(parameters["anchor"])
            *axis, angle = end["rotation"]
            shift = anchor + swing @ (np.array(end["translation"]) - anchor)
            add(end, origin + rotation @ shift, rotation @ swing @ turn(np.array(axis), angle), end["name"])

    *axis, angle = robot["rotation"]
    add(robot, np.array(robot["translation"]), turn(np.array(axis), angle), "base")
    return placed
