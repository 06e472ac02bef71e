"""Designed motion as the source of targets: a trajectory of `excite`, played on the robot under the same supervisor."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stiction.core.errors import LogError, unknown_name
from stiction.core.files import near_file
from stiction.files.contract import Contract
from stiction.files.log import by_joint, read_setup, read_table

LONGEST = 1800.0
"""Longest motion [s]."""


class Motion:
    """Targets over time of some joints; the others stay in the standing pose."""

    def __init__(self, path: Path, contract: Contract) -> None:
        """Read a trajectory, `time` and `target.<joint>`, a joint's name or its kind, and its sidecar's gains.

        Raises `LogError`: no such table, time that does not increase, unknown joints, targets that are not finite or
        outside of the joint's limits.
        """
        if not path.exists():
            raise LogError(
                f"no motion at {path}{near_file(path) or ';'} expected a trajectory.csv; `stiction excite` designs one"
            )
        table = read_table(path).columns
        if "time" not in table:
            raise LogError(f"{path.name}: no column 'time'; expected a trajectory.csv as `stiction excite` writes it")
        self._time = table["time"] - table["time"][0]
        if not (np.isfinite(self._time).all() and (np.diff(self._time) > 0).all() and self._time[-1] <= LONGEST):
            raise LogError(f"{path.name}: time must increase and end before {LONGEST:g} s")
        targets = {name: s.target for name, s in by_joint(table, None).items() if s.target is not None}
        if not targets:
            raise LogError(f"{path.name}: no target.JOINT; expected a trajectory.csv as `stiction excite` writes it")
        setup, standing = read_setup(path), contract.array("standing")
        self.kp, self.kd = contract.array("kp"), contract.array("kd")
        self.seconds = float(self._time[-1])
        self._targets = np.tile(standing, (len(self._time), 1))
        known = {*contract.joint_names, *contract.kinds}
        for name, target in targets.items():
            if name not in known:
                raise LogError(f"{path.name}: {unknown_name('joint', name, sorted(known))}")
            for joint, (joint_name, kind) in enumerate(zip(contract.joint_names, contract.kinds, strict=True)):
                if name not in (joint_name, kind):
                    continue
                low, high = contract.lower[joint], contract.upper[joint]
                if not (np.isfinite(target).all() and low <= target.min() and target.max() <= high):
                    raise LogError(
                        f"{path.name}: targets of {name} from {np.min(target):.3g} to {np.max(target):.3g} rad; "
                        f"expected numbers within its limits, {low:g} to {high:g} rad: design it for this joint"
                    )
                gains = setup.of_joint(name)
                self._targets[:, joint] = target
                self.kp[joint] = self.kp[joint] if gains.kp is None else gains.kp
                self.kd[joint] = self.kd[joint] if gains.kd is None else gains.kd
        self.start = self._targets[0]

    def target(self, elapsed: float) -> np.ndarray:
        """Return the targets at a time [rad], shape (J,), linear between samples."""
        place = int(np.clip(np.searchsorted(self._time, elapsed, side="right") - 1, 0, len(self._time) - 2))
        share = np.clip((elapsed - self._time[place]) / (self._time[place + 1] - self._time[place]), 0.0, 1.0)
        return self._targets[place] + share * (self._targets[place + 1] - self._targets[place])
