"""Evidence behind a verdict: friction of public robots, friction at which policies fail, and the advised training.

Of public robots only entries of one condition can be compared with each other: a bare motor, a leg in the air and a
loaded joint differ by factors. `place` ranks a joint among those of its own condition. What somebody wrote into a
simulation model may never have been measured, and is not listed.

What policies did is read from `advice.json` beside this module, which the studies write from their rows; see
`stiction.files.advice`. A training covers a friction at which every seed of it, of three or more, follows every
command, and nothing else: neither what lies between two such levels, nor what is beyond the last that anybody walked
with, nor another robot, ground or law. Where policies begin to suffer is in `scale`, and ways without a training are
in `remedies`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

from stiction.core.statistics import permutation_p
from stiction.files.advice import SHARES, TRAINING, Source, TrainedWith, read_advice, robot_title
from stiction.files.following import DRIFT, FEWEST_SEEDS, CommandCount
from stiction.files.joints import Estimate, JointRecord

Quantity = Literal["friction_ratio", "dead_band"]

CONDITIONS = {"bare_motor": "on a bare motor", "in_air": "on a leg in the air", "loaded": "under load"}
"""Condition of an entry, and of a log -> its words."""

_DLS = "https://github.com/iit-DLSLab/sim2real-robot-identification"

SOURCES = {
    "paper": "Hu et al., Impact of Static Friction on Sim2Real in Robotic Reinforcement Learning, Tables I and III",
    "go2": f"{_DLS}/issues/8",
    "aliengo": f"{_DLS}, robot_model/aliengo/aliengo.xml at 68324ee",
    "a2": f"{_DLS}, robot_model/a2/isaaclab_identified_parameters.py at 9b07f12; "
    "limits of sysid_isaaclab/tasks/a2_pace_env_cfg.py at 68324ee",
    "bam": "https://github.com/Rhoban/bam, bam/params/<motor>/m1.json at ea21610; stall torque at 14.8 V from "
    "https://emanual.robotis.com/docs/en/dxl/mx/",
}
"""Short name -> source of the numbers."""


@dataclass(frozen=True)
class Entry:
    """Dry friction of one kind of joint."""

    robot: str
    """Robot, or servo."""
    joint: str
    """Joint, or joints that share the numbers."""
    condition: str
    """One of `CONDITIONS`."""
    friction: float
    """Coulomb friction [N m]."""
    torque_limit: float
    """Torque limit [N m]."""
    source: str
    """Key of `SOURCES`."""
    note: str
    """Method of the identification, or a remark."""
    kp: float | None = None
    """Proportional gain of the test [N m/rad]; None where unknown."""

    @property
    def friction_ratio(self) -> float:
        """Ratio f/τ_max [1]."""
        return self.friction / self.torque_limit

    @property
    def dead_band(self) -> float | None:
        """Dead band f/kp [rad], None without a gain."""
        return None if self.kp is None else self.friction / self.kp


_SINES = "sine excitation of the shank motor, no load; std {} N m"
_FITS = "repeated fits by simulation of one public record, 12 joints in the air; std {} N m"
_LEGS = "fit by simulation, mean of the four legs ({})"
_BENCH = "pendulum with weights, symmetric Coulomb and viscous law; its authors find that friction grows with load"

REFERENCE: tuple[Entry, ...] = (
    Entry("Unitree Go1", "shank", "bare_motor", 0.0481, 35.55, "paper", _SINES.format("0.00299")),
    Entry("Saturn Lite", "shank", "bare_motor", 0.442, 45.0, "paper", _SINES.format("0.0661") + "; sealed"),
    Entry("Unitree Go2", "hip", "in_air", 0.16, 23.7, "go2", _FITS.format("0.01"), 20.0),
    Entry("Unitree Go2", "thigh", "in_air", 0.195, 23.7, "go2", _FITS.format("0.015"), 20.0),
    Entry("Unitree Go2", "stiffer calf", "in_air", 0.74, 45.43, "go2", _FITS.format("0.03"), 20.0),
    Entry("Unitree Go2", "freer calf", "in_air", 0.50, 45.43, "go2", _FITS.format("0.02"), 20.0),
    Entry("Unitree AlienGo", "hip", "in_air", 0.480, 35.278, "aliengo", _LEGS.format("0.38 to 0.65 N m")),
    Entry("Unitree AlienGo", "thigh", "in_air", 0.297, 35.278, "aliengo", _LEGS.format("0.26 to 0.35 N m")),
    Entry("Unitree AlienGo", "calf", "in_air", 0.370, 44.4, "aliengo", _LEGS.format("0.20 to 0.49 N m")),
    Entry("Unitree A2", "hip", "in_air", 1.97, 120.0, "a2", _LEGS.format("1.71 to 2.27 N m"), 40.0),
    Entry("Unitree A2", "thigh", "in_air", 2.02, 120.0, "a2", _LEGS.format("1.85 to 2.30 N m"), 40.0),
    Entry("Dynamixel MX-106", "servo", "loaded", 0.1035, 10.0, "bam", _BENCH),
    Entry("Dynamixel MX-64", "servo", "loaded", 0.0904, 7.3, "bam", _BENCH),
)
"""Verified against their sources in November 2026. The A2's calves are left out: their fit ended at the bound of its
search (6 N m)."""


@dataclass(frozen=True)
class Placement:
    """Rank of a joint among public joints that were measured under the same condition."""

    quantity: Quantity
    """Compared quantity."""
    condition: str
    """Condition of the joint and of every entry that it is compared with."""
    below: int
    """Number of entries whose value is not larger."""
    count: int
    """Number of comparable entries."""
    text: str
    """Sentence on the rank, with the nearest entries, and how many lie within the joint's 95 % interval: the rank
    is not known better than that."""


def place(record: JointRecord, quantity: Quantity) -> Placement | None:
    """Rank a joint's ratio [1] or dead band [rad] among the entries of its condition; None where there are none.

    A linear axis has none. Entries are of Coulomb friction: where the joint's is that at rest, the sentence says so.
    """
    estimate: Estimate | None = getattr(record, quantity)
    symbol, scale, unit = ("f/τ_max", 100, "%") if quantity == "friction_ratio" else ("f/kp", 1, "rad")
    entries = sorted(
        (value, f"{entry.robot} {entry.joint} ({scale * value:.2g} {unit})")
        for entry in REFERENCE
        if entry.condition == record.test_condition and (value := getattr(entry, quantity)) is not None
    )
    if estimate is None or record.axis != "rotary" or record.test_condition is None or not entries:
        return None
    low, high = estimate.interval95
    below = sum(value <= estimate.value for value, _ in entries)
    if 0 < below < len(entries):
        where = f"between {entries[below - 1][1]} and {entries[below][1]}"
    else:
        where = f"above {entries[-1][1]}, the largest," if below else f"below {entries[0][1]}, the smallest,"
    within = sum(low <= value <= high for value, _ in entries)
    symbol += "" if record.holding_friction is None else " at rest, beside those of friction in motion,"
    text = f"Its {symbol} is {where} of {len(entries)} public joints measured {CONDITIONS[record.test_condition]}"
    text += f", {within} of them within its interval." if within else "."
    return Placement(quantity, record.test_condition, below, len(entries), text)


TRAINED_IN = "mujoco"
"""Engine of the training; all other engines are elsewhere."""

TRAINED_UNDER = "coulomb"
"""Friction law of the trainings that are compared."""

ALIKE = 0.05
"""Difference of shares that a handful of seeds does not resolve: a choice."""

TOLD_APART = 0.05
"""Largest p of an exact permutation test of their seeds at which two trainings are told apart."""

TOLD = "told"
"""Method that observes its joints' friction: shown and never chosen, for the robot would have to know it."""

PLACES = {TRAINED_IN: "in the simulator of the training", "physx": "in PhysX", "ode": "in ODE", "ode-webots": "in ODE"}
"""Engine -> its words; a plus in its name means a virtual robot."""

RATIOS = (1.0, 10.0)
"""Least and largest ratio of friction at rest to friction in motion that training takes."""

SLOWEST = 0.005
"""Least Stribeck velocity [rad/s]: below it the creep of a held joint in simulation would release it."""

AT_ONCE = (0.02, 0.1)
"""Stribeck velocities [rad/s] of a joint whose log shows a fall at once, the law `breakaway`: a choice. Simulated steps
of some ms let no joint move slower than that once it moves."""


@cache
def shipped() -> dict[str, Source]:
    """Return the advice that comes with the package."""
    return read_advice(Path(__file__).parent / "advice.json")


FAILS = "It does not cover"
"""Begin of the answer where what walked shows that a training does not cover a friction."""


@dataclass(frozen=True)
class Advice:
    """Advised training, and its evidence."""

    method: str
    """Advised training."""
    asked: float
    """Highest friction of the request [-]."""
    levels: tuple[float, ...]
    """Tested friction levels of the comparison, the nearest below and above the request included [-]."""
    cells: Mapping[str, tuple[CommandCount, ...]]
    """Training -> commands followed at these levels, in the simulator of the training."""
    elsewhere: tuple[CommandCount, ...]
    """Commands that the policies of each training follow in other engines and on virtual robots, the advised first, in
    each at the tested level nearest to the highest request; empty where nobody has walked there."""
    source: Source
    """Part of the study."""
    robot: str | None = None
    """Name of the robot with the joint; None where unknown."""

    @property
    def covered(self) -> bool:
        """True if every seed, of three or more, follows at the requested friction and at all levels compared."""
        return self.asked in self.levels and _all_covered(self.cells[self.method], self.levels)

    @property
    def as_good(self) -> dict[str, float]:
        """Trainings that are not told from the advised one -> p of the commands that each seed follows at the levels.

        `TOLD` is left out, and trainings whose seeds are not known one by one.
        """
        advised = _by_seed(self.cells[self.method])
        p_values = {
            name: permutation_p(advised, _by_seed(cells))
            for name, cells in self.cells.items()
            if name not in (self.method, TOLD)
        }
        return {name: p for name, p in p_values.items() if p is not None and p > TOLD_APART}

    @property
    def training(self) -> TrainedWith:
        """Training of the method's policies."""
        return self.source.methods[self.method]

    @property
    def settings(self) -> dict[str, Any]:
        """Fields of `FrictionCfg` for this training."""
        return {"method": self.training.method, "level": self.training.level, "law": TRAINED_UNDER, "per": "robot"}

    @property
    def range(self) -> list[float]:
        """Friction that this training draws, least and most, over the torque limit [-]."""
        return [self.training.low * self.training.level, self.training.high * self.training.level]

    @property
    def flags(self) -> str:
        """Method and level as words of `stiction train`."""
        level = f" --friction-level {self.training.level:g}" if self.training.level > 0 else ""
        return f"--method {self.training.method}{level}"

    @property
    def command(self) -> str:
        """Command for this training, with the preset of the advised policies."""
        preset = re.search(r" --preset[ =]\S+", self.source.command)
        return "stiction train --friction-from training.json" + (preset.group() if preset else "")

    @property
    def fails(self) -> bool:
        """True if what walked shows that it does not cover the request."""
        return self._answer.startswith(FAILS)

    @property
    def _answer(self) -> str:
        """Clause on whether the training covers the request."""
        cells, asked, beyond = self.cells[self.method], _percent(self.asked), self.asked > self.levels[-1]
        same = [cell for cell in cells if cell.friction_level == self.asked]
        if self.covered:
            answer = f"It covers {asked}"
        elif any(cell.covered for cell in same):
            answer = f"It covers {asked}, and not all below it"
        elif any(cell.every_seed for cell in same or cells[-1 if beyond else -2 :]):
            answer = f"Whether it covers {asked} is not known"
        elif not beyond and all(_nearly_covered(cell) for cell in cells):
            followed, total = (sum(getattr(cell, name) for cell in cells) for name in ("followed", "cells"))
            answer = f"It nearly covers {asked}, {followed} of {total} pairs of seed and command"
        else:
            answer = f"{FAILS} {asked}"
        return answer

    @property
    def coverage(self) -> str:
        """Sentences on the training's coverage of the request, its counts, and their robot."""
        cells, beyond = self.cells[self.method], self.asked > self.levels[-1]
        parts = [f"{self._answer}: {PLACES[TRAINED_IN]} every command is followed by {_counts(cells)}"]
        parts += [f"the worst at {_percent(cell.friction_level)} is {cell.worst}" for cell in cells if cell.worst][-1:]
        if any(cell.every_seed and not cell.covered for cell in cells):
            parts.append(f"fewer than {FEWEST_SEEDS} seeds do not tell")
        if beyond:
            parts.append(f"beyond {_percent(self.levels[-1])} nothing was walked")
        elif self.asked not in self.levels:
            parts.append("nothing was walked between")
        if self.as_good:
            apart = ", ".join(f"{name} (p = {p:.2g})" for name, p in self.as_good.items())
            parts.append(f"by its seeds it cannot be told from {apart}")
        limits = f"All of this is of {self.source.robot_text}, on flat ground, under Coulomb friction, in simulation"
        if self.robot != self.source.robot:
            other = "any other robot" if self.robot is None else robot_title(self.robot)
            limits += f"; of {other} nothing is known directly"
        return f"{'; '.join(parts)}. {limits}."

    @property
    def comparison(self) -> str:
        """Sentences on the other methods at the same levels, and on all methods elsewhere."""
        methods = [
            f"{name}{', which the robot has to tell its friction,' if name == TOLD else ''} {_counts(cells)}"
            for name, cells in self.cells.items()
            if name != self.method
        ]
        places: dict[str, dict[str, list[CommandCount]]] = {}
        for cell in self.elsewhere:
            place = "on virtual robots" if "+" in cell.engine else PLACES.get(cell.engine, f"in {cell.engine}")
            places.setdefault(place, {}).setdefault(cell.method, []).append(cell)
        texts = []
        for place, by_method in places.items():
            counts = [f"{name} {_counts(cells)}" for name, cells in by_method.items()]
            worst = [each.worst for each in by_method.get(self.method, ()) if each.worst][-1:]
            counts[0] += "".join(f" (worst {each})" for each in worst)
            absent = [name for name in self.cells if name not in by_method]
            counts += [f"not walked: {', '.join(absent)}"] * bool(absent)
            texts.append(f"{place} {', '.join(counts)}")
        text = f"Other methods: {'; '.join(methods)}. " if methods else ""
        return f"{text}Elsewhere: {'; '.join(texts) or 'nobody has walked there'}."

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for `training.json`: the counts, and the command and revision that they came from."""
        return {
            "levels": list(self.levels),
            "covered": self.covered,
            "cells": [asdict(cell) for cells in self.cells.values() for cell in cells],
            "elsewhere": [asdict(cell) for cell in self.elsewhere],
            "robot": self.source.robot,
            "command": self.source.command,
            "revision": self.source.revision,
            "policies": list(self.source.policies),
            "tables": list(self.source.tables),
        }


def advise(low: float, high: float, sources: Mapping[str, Source] | None = None, robot: str | None = None) -> Advice:
    """Return the training for friction from `low` to `high`, shares of the torque limit [-].

    The trainings are compared at the tested levels from the last that is not above `low` to the first that is not below
    `high`, or to the highest, in the simulator of the training: first by whether every seed, of three or more, follows
    every command at all of them, then by the share of pairs of seed and command that are followed, then by the least
    mean miss. Where none does the first, those within `ALIKE` of the best share are alike, and the share at these
    levels in other engines where all of them walked counts, then the widest range: what was not measured may have
    another friction. `TOLD` is compared and never chosen.

    sources: as of `read_advice`; by default what comes with the package; robot: name of the robot with the joint.
    """
    source = (shipped() if sources is None else sources)[TRAINING]
    low, high = round(low, 9), round(high, 9)
    walked = [cell for cell in source.cells if (cell.engine, cell.friction_law) == (TRAINED_IN, TRAINED_UNDER)]
    tested = sorted({cell.friction_level for cell in walked})
    first = max((level for level in tested if level <= low), default=tested[0])
    last = min((level for level in tested if level >= high), default=tested[-1])
    levels = tuple(level for level in tested if first <= level <= last)
    cells = {
        name: chosen
        for name in source.methods
        if (chosen := tuple(cell for cell in walked if cell.method == name and cell.friction_level in levels))
    }
    away = [cell for cell in source.cells if cell.engine != TRAINED_IN and cell.friction_law in SHARES]
    elsewhere = {name: _near_levels([cell for cell in away if cell.method == name], high) for name in source.methods}
    ranks = {name: _rank(cells[name], levels) for name in cells if name != TOLD}
    best = max(ranks, key=lambda name: ranks[name])
    if not ranks[best][0]:
        alike = [name for name, (_, share, _) in ranks.items() if share >= ranks[best][1] - ALIKE]
        common = set.intersection(*({cell.engine for cell in elsewhere[name]} for name in alike))
        range_away = [cell for cell in away if cell.engine in common and levels[0] <= cell.friction_level <= levels[-1]]
        shares = {name: _share([cell for cell in range_away if cell.method == name]) for name in alike}
        best = max(alike, key=lambda name: (shares[name], source.methods[name].width, ranks[name]))
    order = sorted(elsewhere, key=[best, *source.methods].index)
    return Advice(best, high, levels, cells, tuple(cell for name in order for cell in elsewhere[name]), source, robot)


def _near_levels(cells: Sequence[CommandCount], asked: float) -> list[CommandCount]:
    """Return the counts of each engine at the asked friction, or at the nearest levels below and above it."""
    chosen = []
    for engine in dict.fromkeys(cell.engine for cell in cells):
        own = sorted((cell for cell in cells if cell.engine == engine), key=lambda cell: cell.friction_level)
        below = [cell for cell in own if cell.friction_level <= asked][-1:]
        above = [cell for cell in own if cell.friction_level >= asked][:1]
        chosen += below + [cell for cell in above if cell not in below]
    return chosen


def _share(cells: Sequence[CommandCount]) -> float:
    """Return the share of pairs of seed and command that are followed; 0 where nothing walked."""
    return sum(cell.followed for cell in cells) / max(1, sum(cell.cells for cell in cells))


def _by_seed(cells: Sequence[CommandCount]) -> list[int]:
    """Return the commands that each seed follows over several levels; empty where that is not known of all of them."""
    each = [cell.by_seed for cell in cells]
    alike = bool(each) and len({len(counts) for counts in each}) == 1
    return [sum(counts) for counts in zip(*each, strict=True)] if alike else []


def _rank(cells: Sequence[CommandCount], levels: Sequence[float]) -> tuple[bool, float, float]:
    """Return the rank of a training: covered, share of followed cells, least miss; larger is better."""
    total = sum(cell.cells for cell in cells)
    return _all_covered(cells, levels), _share(cells), -sum(cell.miss * cell.cells for cell in cells) / total


def _all_covered(cells: Sequence[CommandCount], levels: Sequence[float]) -> bool:
    """Return True if a training follows with every seed, of three or more, at every one of the levels."""
    return len(cells) == len(levels) and all(cell.covered for cell in cells)


def _nearly_covered(cell: CommandCount) -> bool:
    """Return True if 95 % of the pairs of seed and command are followed, of three seeds or more, and no miss is large.

    A miss below a tenth of a m/s (rad/s) is not visible.
    """
    return cell.seeds >= FEWEST_SEEDS and cell.followed >= 0.95 * cell.cells and cell.largest_miss <= DRIFT


def _counts(cells: Sequence[CommandCount]) -> str:
    """Return the seeds that follow every command: `5 of 5 seeds at 10 %, 4 of 5 seeds at 20 %`."""
    return ", ".join(f"{cell.follow_all} of {cell.seeds} seeds at {_percent(cell.friction_level)}" for cell in cells)


def _percent(level: float) -> str:
    """Return a share of the torque limit in per cent, as text."""
    return f"{100 * level:.4g} %"


def draw_rise(record: JointRecord, coulomb: Mapping[str, Any]) -> tuple[dict[str, Any], str] | None:
    """Return settings that draw friction at rest and in motion, the law `stribeck`, and their words.

    The level of that law is friction in motion, and the advice is of friction at rest under Coulomb's law, where the
    two are one. So the level is divided by the ratio: at rest as much is drawn as in the training that is counted, in
    motion less. The ratio is drawn from least at rest over most in motion to most over least, by the 95 % intervals,
    within `RATIOS`, whether or not newton metres are known. None unless more friction holds the joint at rest.

    coulomb: fields of `FrictionCfg` of a training under Coulomb's law.
    """
    rest, moving, speed = record.holding_friction, record.moving_friction, record.stribeck_velocity
    if rest is None or moving is None or record.axis != "rotary":
        return None
    least, most = RATIOS
    value = rest.value / moving.value if moving.value > 0 else most
    ends = (rest.interval95[0] / max(moving.interval95[1], 1e-9), rest.interval95[1] / max(moving.interval95[0], 1e-9))
    ratio = [float(f"{min(max(end, least), most):.3g}") for end in ends]
    speeds = [*AT_ONCE] if speed is None else [float(f"{max(end, SLOWEST):.3g}") for end in speed.interval95]
    settings = {
        **coulomb,
        "law": "stribeck",
        "level": round(coulomb["level"] / min(value, most), 3),
        "static_ratio": ratio,
        "stribeck_velocity": speeds,
    }
    times, fall = (" to ".join(dict.fromkeys(f"{end:g}" for end in span)) for span in (ratio, speeds))
    text = f"{times} times as much friction at rest as in motion"
    text += f" (the most that training takes; this joint's is {value:.3g})" if value > most else ""
    text += f", gone over {fall} rad/s"
    text += ", speeds that are chosen, for the log shows a fall at once" if speed is None else ""
    return settings, text
