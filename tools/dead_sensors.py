"""Measures the rules on dead sensors, on virtual robots that walk: false alarms, and how soon faults are found.

    python tools/dead_sensors.py --walks 40 --out results/deploy/sensors     # false alarms: 40 walks of each policy
    python tools/dead_sensors.py --faults 4 --out results/deploy/sensors     # faults: 4 of each, of each policy
    python tools/dead_sensors.py --exchanges 2 --out results/deploy/sensors  # joints exchanged: 2 walks of each policy
    python tools/dead_sensors.py --out results/deploy/sensors                # what the tables come to

Each walk is a run under the supervisor on a clock of its own (`tests/helpers/lockstep.py`): as fast as the machine is,
with the same numbers on each. A walk's seed is that of its virtual robot, of commands, friction, wear and pushes too:
every 4 s another command, every 4 to 8 s a push of up to 0.7 m/s along each axis (0.3 of a biped), friction of 0 to
20 % of the torque limit (10 of a biped), in every second walk worn from half to twice within it. Joints of the first
two legs are exchanged in what a walk recorded, each pair once a second. A row a walk in walks.csv and faults.csv, and
a joint in exchanges.csv, with which a second call goes on; what they came to is in results/deploy/README.md. A rule on
tilt is right if the robot falls: here it ends a walk 3 s later, and largest_tilt [rad] is what the simulated robot
leaned by then, without its sensors.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests/helpers"))
from lockstep import Lockstep
from stiction.deploy.control import JointCommand
from stiction.deploy.plausibility import RULES, ReadingGuard
from stiction.deploy.runtime.config import SafetyCfg, SupervisorCfg
from stiction.deploy.runtime.safety import Safety, tilt
from stiction.deploy.runtime.supervisor import Stage
from stiction.deploy.transports.link import RobotState
from stiction.engines.catalog import make_engine
from stiction.files.bundle import Bundle, find_bundle, read_bundle
from stiction.files.contract import robot_of
from stiction.virtual.faults import exchanged
from stiction.virtual.robot import PERIOD, Wear
from stiction.virtual.serve import VirtualCfg
from stiction.virtual.trial import World

SHIPPED = "saturn_lite-flat-deception-0.2"
TRAINED = ("go1-deception-s10", "go2-deception-s10", "g1-none-s10")
"""Policies of the robots that come with the package: the hexapod's, which does too, and those of results/robots."""

FAULTS = ("frozen-angle", "frozen-angles", "dead-gyroscope", "swapped-joints", "offset-joint", "slow-clock")

SENSORS = ("velocity and angle", "frozen angle", "attitude and gyroscope", "torque and command")
"""Rules whose largest values stand beside each walk, as shares of their limits."""

NEVER = 10.0
"""Limit of a rule on tilt with which it ends no walk [rad]."""

LATER = 3.0
"""Time within which a robot that falls lies [s]."""

LYING = 1.4
"""Least tilt of a robot that lies [rad]."""

SECONDS = 30.0
"""Length of a walk [s]."""

WITHIN = 0.3
"""Time within which a fault is to be found [s]."""


class Values:
    """Largest values of the rules in one run, over their limits."""

    def __init__(self, loop: Lockstep) -> None:
        """Begin with a run."""
        self._loop, self.largest = loop, np.zeros(len(SENSORS))
        limits = (SafetyCfg().apart, RULES["frozen angle"].limit, RULES["attitude and gyroscope"].limit)
        self._limits = np.array([*limits, SafetyCfg().torque_error])

    def look(self) -> None:
        """Look at what the rules see now."""
        supervisor = self._loop.supervisor
        good, safety = supervisor._guard._before, supervisor._safety
        if good is None:
            return
        apart, still = np.abs(good.position - good.moved).max(), np.abs(good.unmoved).max()
        errors = safety.errors.mean()
        error = 0.0 if errors is None else np.abs(errors).max()
        values = np.array([apart, still, math.dist(good.up, good.turned), error])
        self.largest = np.maximum(self.largest, values / self._limits)


Record = list[tuple[RobotState, JointCommand]]
"""Each state of a walk, and the command that answered it."""


def walk(bundle: Bundle, seed: int, seconds: float, fault: str = "", record: Record | None = None) -> dict[str, object]:
    """Walk, until something is found; return a row.

    fault: begins once the robot walks, a second before the end; record: takes the walk.
    """
    spec, chance = robot_of(bundle.contract), np.random.default_rng(seed)
    biped = len(spec.foot_names) == 2
    level, speed, push = (0.1, 0.5, 0.3) if biped else (0.2, 0.8, 0.7)
    cfg = VirtualCfg(seed=seed, level=f"{level * (seed % 4) / 3:.3f}")
    command = np.array([0.5 * speed, 0.0, 0.0])
    safety = SafetyCfg() if fault else SafetyCfg(tilt=NEVER, predicted_tilt=NEVER)
    loop = Lockstep(bundle, SupervisorCfg(armed=True, safety=safety), cfg, command)
    if seed % 2 and not fault:
        wear = Wear(start=0.5, end=2.0, seconds=seconds)
        loop.robot._robot = World(partial(make_engine, cfg.engine)).robot(cfg.case, spec, chance, wear)
    loop.begin()
    values, begin, pushed, commanded = Values(loop), loop.now, loop.now + 4.0, loop.now + 4.0
    broken_at, end = begin + seconds - 1.0 if fault else np.inf, begin + seconds
    rules, fall, largest_tilt, ended = Safety(bundle.contract, SafetyCfg(), PERIOD), None, 0.0, None
    while loop.supervisor.stop_record is None and loop.now < end:
        if loop.now > commanded and not fault:
            command[:] = chance.uniform(-1, 1, 3) * (speed, 0.4 * speed, 0.6) * (chance.random() > 0.15)
            loop.supervisor.command_velocity(command, loop.now)
            commanded += 4.0
        if loop.now > pushed and not fault:
            loop.robot._robot._engine.push(push * chance.uniform(-1, 1, 2))
            pushed += chance.uniform(4, 8)
        if loop.now >= broken_at and fault:
            loop.break_(fault)
            broken_at, started = np.inf, loop.now
        loop.step()
        if fall is not None:
            base = loop.robot._robot.ground_truth().motion.base_quaternion
            largest_tilt = max(largest_tilt, tilt(base, np.zeros(3), 0.0)[0])
            continue
        values.look()
        if record is not None and loop.newest is not None and loop.supervisor._safety._command is not None:
            record.append((loop.newest, loop.supervisor._safety._command))
        if loop.newest is not None and not fault and (fall := rules.falling(loop.newest.sensors)) is not None:
            ended, end = loop.now, loop.now + LATER
    stop = loop.supervisor.stop_record
    loop.close()
    assert stop is not None or loop.supervisor.stage is Stage.RUN
    violation = fall or (None if stop is None else stop.violation)
    row: dict[str, object] = {
        **{"robot": bundle.contract.robot, "seed": seed, "seconds": round((ended or loop.now) - begin, 2)},
        **{"rule": "" if violation is None else violation.rule, "joint": (violation and violation.joint) or ""},
    }
    if fault:
        late = "" if stop is None else round(1e3 * (stop.time - started), 1) if broken_at == np.inf else "before"
        return {"fault": fault} | row | {"found_ms": late}
    shares = dict(zip(SENSORS, values.largest.round(3).tolist(), strict=True))
    return row | {"largest_tilt": "" if fall is None else round(largest_tilt, 3)} | shares


def is_found(bundle: Bundle, record: Record, joint: int, begin: int) -> bool:
    """Return whether two joints, exchanged from a state of a walk on, are found in time; `joint`: see `exchanged`."""
    steps, cfg = round(WITHIN / PERIOD), SafetyCfg()
    # It walks already: how it leans and faces at the begin is no start.
    off = dict.fromkeys(("leans at the start", "half turn at the start"), np.inf)
    guard = ReadingGuard(bundle.contract, {"velocity and angle": cfg.apart} | off)
    safety = Safety(bundle.contract, cfg, PERIOD)
    for number in range(begin - steps, begin + steps):
        state, command = record[number]
        state = exchanged(state, joint) if number >= begin else state
        if (guard.check(state.time, state.sensors, np.zeros(3), acting=True) or safety.check(state)) is not None:
            assert number >= begin
            return True
        safety.commanded(command)
    return False


def exchanges(bundle: Bundle, seed: int) -> list[dict[str, object]]:
    """Walk and exchange each joint of the first leg with the second leg's; return a row a joint."""
    record = Record()
    row, second = walk(bundle, seed, SECONDS, record=record), round(1.0 / PERIOD)
    # A walk may end by a fall, which is found as such.
    begins = range(second, len(record) - (2 if row["rule"] else 1) * second, second)
    names = bundle.contract.joint_names[: len(record[0][0].joint_torque) // len(record[0][0].foot_contact)]
    counts = [sum(is_found(bundle, record, joint, begin) for begin in begins) for joint in range(len(names))]
    return [{"robot": bundle.contract.robot, "seed": seed, "joint": name, "trials": len(begins), "within_300_ms": count}
            for name, count in zip(names, counts, strict=True)]  # fmt: skip


def read_policies() -> list[Bundle]:
    """Return a policy of each robot."""
    trained = [Path(__file__).parents[1] / "results/robots/policies" / name for name in TRAINED]
    return [read_bundle(folder, allow_record=True) for folder in (find_bundle(Path(SHIPPED)), *trained)]


def kept(file: Path) -> list[dict[str, str]]:
    """Return the rows of a table, none where there is none yet."""
    return list(csv.DictReader(file.read_text(encoding="utf-8").splitlines())) if file.exists() else []


def add(file: Path, rows: list[dict[str, object]]) -> None:
    """Add rows to a table."""
    begun = file.exists()
    with file.open("a", newline="", encoding="utf-8") as out:
        writer = csv.DictWriter(out, list(rows[0]), lineterminator="\n")
        if not begun:
            writer.writeheader()
        writer.writerows(rows)


def main() -> None:
    """Make the walks that are missing, and print what they came to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--walks", type=int, default=0, help="walks of each policy without a fault, 30 s each")
    parser.add_argument("--faults", type=int, default=0, help="walks of each policy with each fault")
    parser.add_argument("--exchanges", type=int, default=0, help="walks of each policy in which joints are exchanged")
    parser.add_argument("--seed", type=int, default=0, help="of the first walk")
    parser.add_argument("--out", type=Path, default=Path("results/deploy/sensors"), help="folder of the tables")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    bundles = {bundle.contract.robot: bundle for bundle in read_policies()}
    counts = {"walks": args.walks, "faults": args.faults, "exchanges": args.exchanges}
    wanted = [
        (table, fault, seed, robot)
        for table, count in counts.items()
        for seed in range(args.seed, args.seed + count)
        for fault in (FAULTS if table == "faults" else ("",))
        for robot in bundles
    ]
    for table, fault, seed, robot in wanted:
        same = {"robot": robot, "seed": str(seed)} | ({"fault": fault} if fault else {})
        if any(same.items() <= row.items() for row in kept(args.out / f"{table}.csv")):
            continue
        if table == "exchanges":
            rows = exchanges(bundles[robot], seed)
        else:
            rows = [walk(bundles[robot], seed, 2.5 if fault else SECONDS, fault)]
        add(args.out / f"{table}.csv", rows)
    report(args.out)


def report(folder: Path) -> None:
    """Print what the tables of a folder come to."""
    walks = kept(folder / "walks.csv")
    hours = sum(float(row["seconds"]) for row in walks) / 3600
    falls = sum(float(row["largest_tilt"] or 0.0) >= LYING for row in walks)
    alarms = sum(bool(row["rule"]) for row in walks) - falls
    largest = {name: max(float(row[name]) for row in walks) for name in SENSORS} if walks else {}
    print(f"{len(walks)} walks, {hours:.2f} robot-hours, {falls} falls, {alarms} false alarms; largest: {largest}")
    for fault in FAULTS:
        own = [row for row in kept(folder / "faults.csv") if row["fault"] == fault and row["found_ms"] != "before"]
        times = [float(row["found_ms"] or "inf") for row in own]
        if times:
            within = sum(time <= 1e3 * WITHIN for time in times)
            print(f"{fault}: {within} of {len(times)} within {1e3 * WITHIN:g} ms, median {np.median(times):.0f} ms")


if __name__ == "__main__":
    main()
