"""Protocol of the maker: our joints in the maker's order, with its signs and zeros, held joints included. NumPy."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stiction.core.errors import RobotError
from stiction.files.bundle import Bundle
from stiction.files.contract import Contract
from stiction.files.tables import write_csv


class VendorMap:
    """Conversion of a policy's joint angles to the maker's numbers, and back: maker's = sign · angle + offset."""

    def __init__(self, contract: Contract) -> None:
        """Read the protocol of the contract's robot.

        Raises `RobotError` where it is not known.
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
        numbers = {name: number for number, name in enumerate(contract.joint_names)}
        at = {joint.name: joint.position for joint in robot.held}
        self._number = np.array([numbers.get(name, -1) for name in self.order])
        self.held = self._number < 0
        """Mask of the maker's joints that the policy does not move, bool, shape (M,)."""
        self._places = np.array([self.order.index(name) for name in contract.joint_names])
        self._at = np.array([at.get(name, 0.0) for name in self.order])

    def to_maker(self, angles: np.ndarray) -> np.ndarray:
        """Return the maker's angles [rad], (..., M), of ours, (..., J); held joints are at their angles."""
        return self._sign * np.where(self.held, self._at, self.theirs(angles)) + self._offset

    def from_maker(self, angles: np.ndarray) -> np.ndarray:
        """Return our angles [rad], (..., J), of the maker's, (..., M)."""
        return self.ours(self._sign * (angles - self._offset))

    def rates_to_maker(self, values: np.ndarray) -> np.ndarray:
        """Return the maker's velocities or torques, (..., M), of ours, (..., J): a zero elsewhere is not in them."""
        return self._sign * self.theirs(values)

    def rates_from_maker(self, values: np.ndarray) -> np.ndarray:
        """Return our velocities or torques, (..., J), of the maker's, (..., M)."""
        return self.ours(self._sign * values)

    def theirs(self, values: np.ndarray) -> np.ndarray:
        """Return values without direction, such as gains, in the maker's order, (..., M); zero for held joints."""
        # A held joint has the number -1, which is the zero at the end.
        return np.concatenate((values, np.zeros((*values.shape[:-1], 1))), axis=-1)[..., self._number]

    def ours(self, values: np.ndarray) -> np.ndarray:
        """Return values without direction, such as temperatures, in our order, (..., J)."""
        return values[..., self._places]


def write_maker_targets(bundle: Bundle, path: Path) -> None:
    """Write the targets of a bundle's recorded walk in the maker's order as CSV: `time` [s], and each joint [rad].

    Played with the robot in the air they show, joint by joint, if each turns as it should. Raises `RobotError`
    where the maker's order is not known.
    """
    maker = VendorMap(bundle.contract)
    golden = bundle.golden
    walked = slice(None) if golden.walked is None else golden.walked
    targets = maker.to_maker(golden.target[walked])
    write_csv(path, {"time": golden.time[walked], **dict(zip(maker.order, targets.T, strict=True))})
