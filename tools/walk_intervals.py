"""Do intervals of `identify walk` hold the truth in logs with others' columns? Simulated walks of known friction.

    python tools/walk_intervals.py results/identification/walks.csv --logs 24

Two robots (a Go2 in an open-loop trot, the hexapod under a trained policy, commands drawn), physics and motor
controllers at 1 kHz, targets at 50 Hz. Dry friction of each joint is drawn anew for each log, 1 to 8 % of its limit.
What a computer on board would log is taken of it (`tests/helpers/trots.py`), at several rates, with the IMU's place
declared and not, and contact from force, torque and height. One row per robot and condition. Walks are kept in
--walks. `identify walk` states viscous friction and rotor from 400 Hz on, dry friction from 200 Hz on; here all are,
so that the table shows why.
"""

from __future__ import annotations

import argparse
import csv
import sys
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tools/shipped_robots"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/helpers"))

import trots
from stiction.core.errors import StictionError
from stiction.files.joints import Estimate
from stiction.identification.setup import IdentifySetup
from stiction.identification.walking import foreign, pipeline, walk
from stiction.identification.walking.pipeline import identify_walk
from stiction.identification.walking.setup import RobotLogSetup, WalkSetup
from stiction.robots.model import Robot

FIRST_SEED = 1000
"""Seeds below were looked at while the method was made."""

SECONDS = 8.0
COMMANDS = ((0.5, 0.0, 0.0), (0.3, 0.2, 0.3), (-0.5, 0.0, 0.0), (0.0, 0.3, 0.0))
QUANTITIES = ("coulomb_friction", "viscous_friction", "rotor_inertia")
COLUMNS = (
    *("robot", "rate", "imu_position", "contact", "logs", "refused_logs", "joints", "own"),
    *(f"covered_{name}" for name in QUANTITIES),
    *("error_coulomb_friction", "halfwidth_coulomb_friction"),
)
"""`own`: share of joints whose own swings tell; the others take their kind's record. `covered_...`: share of joints
whose interval holds the truth, empty where it is not stated. `error_...`, `halfwidth_...`: median, over the truth."""


@dataclass(frozen=True)
class Condition:
    """Condition under which a log was made and read."""

    every: int
    placed: bool = True
    contact: str = "auto"
    any_rate: bool = False
    """True to admit rates that the code refuses, to see which intervals would result."""


CONDITIONS = (
    *(Condition(every) for every in (1, 2, 4, 5)),
    *(Condition(every, any_rate=True) for every in (8, 10, 20)),
    Condition(2, placed=False),
    Condition(2, contact="torque"),
    Condition(2, contact="height"),
)


def draw(spec: Robot, seed: int) -> np.ndarray:
    """Return the dry friction of each joint [N m], shape (J,)."""
    share = np.exp(np.random.default_rng([seed, 1]).uniform(np.log(0.01), np.log(0.08), spec.num_joints))
    return share * trots.limits(spec)


def walks(name: str, seeds: range, folder: Path) -> dict[int, trots.Walked]:
    """Return seed -> walk, simulated where it is not kept; robots that fell are left out."""
    folder.mkdir(parents=True, exist_ok=True)
    by_seed: dict[int, trots.Walked] = {}
    for seed in seeds:
        path = folder / f"{name}-{seed}.npz"
        if not path.exists():
            try:
                if name == "go2":
                    walked = [trots.trot(draw(trots.GO2, seed), SECONDS, seed)]
                else:
                    friction = draw(trots.HEXAPOD, seed)[None]
                    walked = trots.hexapods(friction, COMMANDS[seed % len(COMMANDS)], SECONDS, seed)
            except StictionError:
                walked = []
            np.savez_compressed(path, **(vars(walked[0]) if walked else {}))
        with np.load(path) as kept:
            if kept.files:
                by_seed[seed] = trots.Walked(**{item.name: kept[item.name] for item in fields(trots.Walked)})
    return by_seed


def row(name: str, spec: Robot, kept: dict[int, trots.Walked], condition: Condition) -> dict[str, str]:
    """Return the row of one condition."""
    truths = {"viscous_friction": trots.DAMPING, "rotor_inertia": trots.ARMATURE}
    gains = (trots.KP, trots.KD)
    if name != "go2":
        contract = trots.walking_bundle().contract
        truths = {"viscous_friction": contract.damping[0], "rotor_inertia": contract.armature[0]}
        gains = (contract.kp[0], contract.kd[0])
    declared = IdentifySetup(torque_source="motor_side", kp=gains[0], kd=gains[1])
    place = RobotLogSetup(imu_position=trots.IMU if condition.placed else None)
    slowest, pipeline.COARSE = walk.LONGEST_PERIOD, 1.0
    hits: dict[str, list[bool]] = {quantity: [] for quantity in QUANTITIES}
    errors, refused, own = [], 0, []
    for seed, truth in kept.items():
        raw = trots.sampled(spec, truth, condition.every, seed)
        foreign.LONGEST_PERIOD = walk.LONGEST_PERIOD = 1.0 if condition.any_rate else slowest
        try:
            setup = WalkSetup(contact=condition.contact)  # type: ignore[arg-type]
            opened = foreign.foreign_walk(trots.opened(spec, raw), spec, declared, place, setup)
            joints = identify_walk(opened).joints
        except StictionError as error:
            print(name, seed, error, file=sys.stderr)
            refused += 1
            continue
        finally:
            foreign.LONGEST_PERIOD = walk.LONGEST_PERIOD = slowest
        friction = draw(spec, seed)
        for number, joint in enumerate(spec.joint_names):
            if joint not in joints.joints:
                own.append(False)
                continue  # its kind's record takes joints for alike, which these are not
            record = joints.joints[joint]
            own.append(True)
            rotor = record.diagnostics.get("rotor_inertia")
            known = {
                "coulomb_friction": (record.coulomb_friction, friction[number]),
                "viscous_friction": (record.viscous_friction, truths["viscous_friction"]),
                "rotor_inertia": (Estimate.from_dict(rotor, joint) if rotor else None, truths["rotor_inertia"]),
            }
            for quantity, (estimate, value) in known.items():
                if estimate is not None:
                    hits[quantity].append(estimate.interval95[0] <= value <= estimate.interval95[1])
            level = record.coulomb_friction
            if level is not None:
                half = (level.interval95[1] - level.interval95[0]) / 2
                errors.append((abs(level.value / friction[number] - 1), half / friction[number]))
    middle = np.median(errors, axis=0) if errors else (np.nan, np.nan)
    return {
        "robot": name,
        "rate": f"{1000 / condition.every:g}",
        "imu_position": "declared" if condition.placed else "not",
        "contact": condition.contact,
        "logs": str(len(kept)),
        "refused_logs": str(refused),
        "joints": str(len(own)),
        "own": f"{np.mean(own):.3f}" if own else "",
        **{f"covered_{name}": f"{np.mean(values):.3f}" if values else "" for name, values in hits.items()},
        "error_coulomb_friction": f"{middle[0]:.4f}",
        "halfwidth_coulomb_friction": f"{middle[1]:.4f}",
    }


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--logs", type=int, default=24, help="of each robot")
    parser.add_argument("--first", type=int, default=FIRST_SEED, help="first seed")
    parser.add_argument("--walks", type=Path, default=Path("walks-kept"), help="folder of the simulated walks")
    options = parser.parse_args()
    with options.out.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        for name, spec in (("go2", trots.GO2), ("saturn_lite", trots.HEXAPOD)):
            kept = walks(name, range(options.first, options.first + options.logs), options.walks)
            for condition in CONDITIONS:
                writer.writerow(row(name, spec, kept, condition))
                file.flush()


if __name__ == "__main__":
    main()
