"""The maker's protocol: our joints in the maker's order, with its signs and zeros, held joints included. NumPy."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from stiction.core.errors import RobotError
from stiction.core.files import publish
from stiction.formats.bundle import Bundle
from stiction.formats.contract import Contract


class VendorMap:
    """Turns joint angles of a policy into the maker's numbers, and back: maker's = sign · angle + offset."""

    def __init__(self, contract: Contract) -> None:
        """Read the protocol of the contract's robot.

        Raises `RobotError` where nobody said what it is.
        """
        robot = contract.anatomy
        if robot is None or robot.vendor is None:
            raise RobotError(
                f"the maker's order of the joints of {contract.robot!r} is not in the contract; say vendor in "
                "robot.yaml and train again"
            )
        self.order = robot.vendor.order
        """Names of all joints, as the maker numbers them."""
        self._sign, self._offset = np.array(robot.vendor.sign), np.array(robot.vendor.offset)
        own = {name: number for number, name in enumerate(contract.joint_names)}
        held = {joint.name: joint.position for joint in robot.held}
        self._number = np.array([own.get(name, -1) for name in self.order])
        self._held = np.array([held.get(name, 0.0) for name in self.order])

    def to_maker(self, angles: np.ndarray) -> np.ndarray:
        """Return the maker's angles [rad], (..., M), of ours, (..., J); held joints are at their angles."""
        known = np.concatenate((angles, np.zeros((*angles.shape[:-1], 1))), axis=-1)[..., self._number]
        return self._sign * np.where(self._number >= 0, known, self._held) + self._offset

    def from_maker(self, angles: np.ndarray) -> np.ndarray:
        """Return our angles [rad], (..., J), of the maker's, (..., M)."""
        own = self._sign * (angles - self._offset)
        places = [int(np.flatnonzero(self._number == joint)[0]) for joint in range(int(self._number.max()) + 1)]
        return own[..., places]


def write_maker_targets(bundle: Bundle, path: Path) -> None:
    """Write the targets of a bundle's recorded walk in the maker's order as CSV: `time` [s], and each joint [rad].

    Played with the robot in the air they show, joint by joint, whether each turns as it should. Raises `RobotError`
    where the maker's order is not known.
    """
    maker = VendorMap(bundle.contract)
    golden = bundle.golden
    walked = slice(None) if golden.walked is None else golden.walked
    rows = maker.to_maker(golden.target[walked])
    with publish(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["time", *maker.order])
        for time, row in zip(golden.time[walked], rows, strict=True):
            writer.writerow([f"{time:.4f}", *(f"{angle:.6f}" for angle in row)])
