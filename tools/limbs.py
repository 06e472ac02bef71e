"""Do 95 % intervals of `identify --robot` hold the truth? Simulated logs of whole legs and arms, by MuJoCo.

    python tools/limbs.py results/identification/limbs.csv --logs 70

Three robots (the Go2's four legs hanging, an arm of six and one of seven joints, both of `tests/identification/limb/`),
each with dry friction, viscous friction, rotors and offsets drawn anew for each log, and links that weigh what the
model says (`right`), 10 % more or less, each by itself (`scattered`), or all of them 10 % more (`heavy`). One row per
robot, condition and joint is written as soon as the robot is done; a robot and condition that the table has is not made
again.
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "identification" / "limb"))

from limb_logs import LIMBS, Limb, Truth, limb_logs

from stiction.files.joints import ARMATURE, Estimate, JointRecord
from stiction.identification.limb.pipeline import identify_limb
from stiction.robots.catalog import find_mechanism

FIRST_SEED = 1000
"""Seeds below were looked at while the method was made."""

QUANTITIES = ("coulomb_friction", "viscous_friction", "armature", "offset")

COLUMNS = (
    *("robot", "masses", "joint", "logs", "identified"),
    *(f"covered_{name}" for name in QUANTITIES),
    *("error_coulomb_friction", "halfwidth_coulomb_friction", "bias_coulomb_friction"),
)
"""`identified`: logs in which friction was not refused; `covered_...`: share of them whose interval holds the truth;
`error_...`: median |estimate / truth - 1|; `halfwidth_...`: median half-width over the truth; `bias_...`: mean error in
standard deviations."""

BATCH = 10
"""Logs simulated at once."""


def estimate_of(record: JointRecord, name: str) -> Estimate | None:
    """Return one quantity of a record."""
    return record.combinations.get(ARMATURE) if name == "armature" else getattr(record, name)


def rows_of(limb: Limb, masses: str, logs: int) -> list[dict[str, str]]:
    """Return the rows of one robot under one condition."""
    mechanism = find_mechanism(limb.robot)
    hits: dict[tuple[str, str], list[bool]] = {}
    errors: dict[str, list[tuple[float, float, float]]] = {name: [] for name in mechanism.joint_names}
    for first in range(FIRST_SEED, FIRST_SEED + logs, BATCH):
        seeds = range(first, min(first + BATCH, FIRST_SEED + logs))
        for log, truth in limb_logs(limb, seeds, masses=masses):
            for joint, record in identify_limb(log, mechanism).joints.joints.items():
                _judge(joint, record, truth, mechanism.joint_names.index(joint), hits, errors)
    rows = []
    for joint in mechanism.joint_names:
        error, width, bias = np.array(errors[joint]).T
        covered = {f"covered_{name}": f"{np.mean(hits[joint, name]):.3f}" for name in QUANTITIES}
        rows.append(
            {"robot": limb.name, "masses": masses, "joint": joint, "logs": str(logs), "identified": str(len(error))}
            | covered
            | {
                "error_coulomb_friction": f"{np.median(error):.4f}",
                "halfwidth_coulomb_friction": f"{np.median(width):.4f}",
                "bias_coulomb_friction": f"{np.mean(bias):.2f}",
            }
        )
    return rows


def _judge(
    joint: str,
    record: JointRecord,
    truth: Truth,
    number: int,
    hits: dict[tuple[str, str], list[bool]],
    errors: dict[str, list[tuple[float, float, float]]],
) -> None:
    """Note whether one joint's intervals hold the truth, and how far off its friction is."""
    for name in QUANTITIES:
        estimate, true = estimate_of(record, name), float(getattr(truth, name)[number])
        if estimate is None:
            continue
        low, high = estimate.interval95
        hits.setdefault((joint, name), []).append(low <= true <= high)
        if name == "coulomb_friction":
            off = estimate.value - true
            errors[joint].append((abs(off) / true, (high - low) / 2 / true, off / estimate.std))


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--logs", type=int, default=70)
    parser.add_argument("--masses", nargs="+", default=["right", "scattered", "heavy"])
    options = parser.parse_args()
    done = set()
    if options.out.is_file():
        with options.out.open(encoding="utf-8") as file:
            done = {(row["robot"], row["masses"]) for row in csv.DictReader(file)}
    else:
        options.out.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")
    for masses in options.masses:
        for limb in LIMBS:
            if (limb.name, masses) in done:
                continue
            rows = rows_of(limb, masses, options.logs)
            with options.out.open("a", encoding="utf-8", newline="") as file:
                csv.DictWriter(file, COLUMNS, lineterminator="\n").writerows(rows)
            shares = [float(row["covered_coulomb_friction"]) for row in rows]
            print(limb.name, masses, f"dry friction covered in {min(shares):.3f} to {max(shares):.3f} by joint")


if __name__ == "__main__":
    main()
