"""Say what the recorded walks of policies ask of the runtime's limits, and of two rules of plausibility.

    python tools/walk_limits.py                 # the policies that come with the package
    python tools/walk_limits.py runs/policy     # any bundles

Readings are those of golden vectors, with noise as in training; where a recording says which of them were walked, those
alone. A line a policy: fastest target, largest tilt, fastest joint, largest root mean square over all joints in the
time of the rule `flailing`, and the largest values of the rules `attitude and gyroscope` and `velocity and angle`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from itertools import pairwise
from math import inf
from pathlib import Path

import numpy as np

from stiction.core.rotation import up_axis
from stiction.deploy.observation import Sensors
from stiction.deploy.plausibility import RULES, ReadingGuard
from stiction.deploy.runtime.config import SafetyCfg
from stiction.files.bundle import Bundle, read_bundle, shipped_bundles
from stiction.files.golden import Golden

UNBOUNDED = dict.fromkeys(RULES, inf)
"""Limits at which nothing is refused."""

UNITS = ("fastest target [rad/s]", "largest tilt [rad]", "fastest joint [rad/s]", "all joints, rms [rad/s]")
JUDGED = ("attitude and gyroscope", "velocity and angle")


def walks(golden: Golden) -> Iterator[slice]:
    """Yield the parts of a recording that were walked: from one reset to the next."""
    starts = [*np.flatnonzero(golden.reset).tolist(), len(golden)]
    for start, end in pairwise(starts):
        if golden.walked is None or golden.walked[start]:
            yield slice(start, end)


def rolling_rms(velocity: np.ndarray, steps: int) -> np.ndarray:
    """Return the root mean square over all joints and `steps` readings, of velocities (T, J), T >= steps."""
    sums = np.concatenate([[0.0], np.cumsum(np.square(velocity).mean(1))])
    return np.sqrt((sums[steps:] - sums[:-steps]) / steps)


def largest(bundle: Bundle, part: slice, rule: str) -> float:
    """Return the largest value that a rule of plausibility finds in a part of the recording."""
    golden, guard = bundle.golden, ReadingGuard(bundle.contract, UNBOUNDED | {rule: 0.0})
    peak = 0.0
    for at in range(part.start, part.stop):
        sensors = Sensors(
            golden.quaternion[at], golden.angular_velocity[at], golden.joint_position[at], golden.joint_velocity[at]
        )
        violation = guard.check(float(golden.time[at]), sensors, golden.command[at])
        peak = max(peak, violation.value if violation and violation.rule == rule else 0.0)
    return peak


def asked(bundle: Bundle) -> list[float]:
    """Return the numbers of a policy's line."""
    golden, period = bundle.golden, bundle.contract.control_period
    steps = max(1, round(SafetyCfg().flailing_seconds / period))
    rows = []
    for part in walks(golden):
        speed = golden.joint_velocity[part]
        tilt = np.arccos(np.clip(up_axis(*golden.quaternion[part].T)[2], -1.0, 1.0))
        slew = np.abs(np.diff(golden.target[part], axis=0)) / period
        motion = [slew.max(), tilt.max(), np.abs(speed).max(), rolling_rms(speed, steps).max()]
        rows.append([*motion, *(largest(bundle, part, rule) for rule in JUDGED)])
    return np.max(rows, axis=0).tolist()


def main() -> None:
    """Print a Markdown table of the bundles named, of the package's own without names."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("bundles", nargs="*", type=Path, help="directories of policy bundles")
    bundles = parser.parse_args().bundles or list(shipped_bundles().values())
    print("|".join(["", " policy ", *(f" {name} " for name in (*UNITS, *JUDGED)), ""]))
    print("|" + "---|" * (1 + len(UNITS) + len(JUDGED)))
    for path in bundles:
        numbers = asked(read_bundle(path))
        cells = [f"{value:.{digits}f}" for value, digits in zip(numbers, (1, 2, 1, 1, 3, 3), strict=True)]
        print(f"| `{path.name}` | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
