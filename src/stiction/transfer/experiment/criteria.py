"""The criteria by which the paper's sentences are judged: functions of what the runs reached and how they learned.

The student is judged, on flat ground, in the engine of training.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stiction.formats.experiment import CurvePoint
from stiction.formats.results import DIRECTIONS, FOLLOWS
from stiction.transfer.experiment.judging import (
    Finding,
    all_follow,
    all_of,
    any_of,
    describe,
    larger,
    over_levels,
    within,
)
from stiction.transfer.experiment.learning import iterations_by_seed
from stiction.transfer.experiment.manifest import LEVEL, LOAD_COEFFICIENTS
from stiction.transfer.experiment.table import Points, Table

STATIONARY = 0.2
"""Below this share of the commanded speed a robot counts as stationary [-]."""

JITTER = 1.5
"""A policy jitters severely if its joint accelerations are this many times those of deception [-]."""

NONE, DIRECT, DECEPTION = "coulomb20-none", "coulomb20-direct", "coulomb20-deception"

BUDGET = 350
"""Iterations of the teacher with the preset `two-phase`."""


@dataclass(frozen=True)
class Evidence:
    """What is known of all runs."""

    table: Table
    """What the policies reached."""
    curves: Mapping[str, Sequence[CurvePoint]]
    """Run -> its learning curve."""

    def nominal(self, condition: str) -> list[tuple[str, Points]]:
        """Return forward and backward speed ratio of a condition at the nominal level, with labels."""
        name = condition.removeprefix("coulomb20-")
        labels = ((f"{name} forward", "vx=0.5"), (f"{name} backward", "vx=-0.5"))
        return [(label, self.table.points(condition, LEVEL, vx, "speed_ratio")) for label, vx in labels]

    def error(self, condition: str) -> tuple[str, Points]:
        """Return the mean of |speed ratio - 1| over the levels up to 0.3, with a label."""
        levels = [level for level in self.table.levels(condition) if level <= 0.3]
        return condition.removeprefix("coulomb20-"), self.table.speed_error(condition, levels)

    def falls(self, condition: str, level: float) -> Points:
        """Return the larger share of episodes with a fall, forward or backward, of every seed."""
        forward, backward = (self.table.points(condition, level, vx, "fall_rate") for vx in DIRECTIONS)
        return {seed: max(forward[seed], backward[seed]) for seed in forward if seed in backward}

    def iterations(self, condition: str) -> tuple[str, Points]:
        """Return the iterations until the teacher walks both ways, with a label that says how many seeds never do:
        they count as the whole budget, less than the truth.
        """
        found, name = iterations_by_seed(condition, self.curves, BUDGET), condition.removeprefix("coulomb20-")
        late = sum(value >= BUDGET for value in found.values())
        return f"{name} ({late} of {len(found)} seeds not before the end)" if late else name, found


def harder(e: Evidence) -> Finding:
    """Training with all the friction takes longer than without."""
    return larger(e.iterations(DIRECT), e.iterations(NONE))


def easier(e: Evidence) -> Finding:
    """Training with the wide range takes less long than directly."""
    return larger(e.iterations(DIRECT), e.iterations(DECEPTION))


def stationary(condition: str) -> Callable[[Evidence], Finding]:
    """The robot hardly moves in either direction at the friction that it was trained with."""

    def judge(e: Evidence) -> Finding:
        label = f"{condition.removeprefix('coulomb20-')}, faster direction"
        return within(label, e.table.faster(condition, LEVEL), -np.inf, STATIONARY)

    return judge


def stationary_under_load(e: Evidence) -> Finding:
    """The same with friction that grows with load, at each coefficient trained with."""
    found = []
    for c in LOAD_COEFFICIENTS:
        points = e.table.faster(f"load{round(1000 * c)}-direct", c)
        found.append((c, within("direct, faster direction", points, -np.inf, STATIONARY)))
    return over_levels(found)


def filtered(e: Evidence) -> Finding:
    """Exploration under the friction learns less than exploration that breaks away, and not for being weak: as weak an
    exploration learns more where there is no friction. One of the two weak ones of the manifest suffices.
    """
    strong = e.table.slower(f"{DIRECT}-strong", LEVEL)
    found = []
    for name in ("weak", "mid"):
        weak, control = e.table.slower(f"{DIRECT}-{name}", LEVEL), e.table.slower(f"{NONE}-{name}", 0.0)
        if weak or name == "weak":
            more = larger((f"{name} and no friction at all", control), (name, weak))
            found.append(all_of(larger(("strong, slower direction", strong), (name, weak)), more))
    judged = any_of(*found)
    return Finding(judged.outcome, f"{judged.evidence}; {describe('default', e.table.slower(DIRECT, LEVEL))}")


def too_slow(condition: str) -> Callable[[Evidence], Finding]:
    """The policy is too slow in its slower direction at the nominal friction, however fast it is elsewhere."""

    def judge(e: Evidence) -> Finding:
        label = f"{condition.removeprefix('coulomb20-')}, slower direction"
        return within(label, e.table.slower(condition, LEVEL), -np.inf, FOLLOWS[0])

    return judge


def jitters(e: Evidence) -> Finding:
    """The iterative policy's joint accelerations are a multiple of deception's."""
    iterative = e.table.points("coulomb20-iterative", LEVEL, "vx=0.5", "joint_jitter")
    deception = e.table.points(DECEPTION, LEVEL, "vx=0.5", "joint_jitter")
    allowed = {seed: JITTER * value for seed, value in deception.items()}
    return larger(("iterative [rad/s²]", iterative), (f"{JITTER} x deception", allowed))


def stands_badly(e: Evidence) -> Finding:
    """The iterative policy moves faster than 0.1 m/s where it is told to stand."""
    points = e.table.points("coulomb20-iterative", LEVEL, "stand", "tracking_error")
    return within("iterative, speed while standing [m/s]", points, 0.1, np.inf)


def follows_at(condition: str, level: float) -> Callable[[Evidence], Finding]:
    """Every seed follows the command at a level, in both directions, and nobody falls."""

    def judge(e: Evidence) -> Finding:
        name = condition.removeprefix("coulomb20-")
        slower, faster = (choose(condition, level) for choose in (e.table.slower, e.table.faster))
        mean = all_of(
            within(f"{name} at {level:g}, slower direction", slower, *FOLLOWS),
            within("faster direction", faster, *FOLLOWS),
        )
        return all_follow(mean, slower, faster, e.falls(condition, level))

    return judge


def deception_works(e: Evidence) -> Finding:
    """The policy trained with the wide range follows without friction and with all of it."""
    return all_of(follows_at(DECEPTION, 0.0)(e), follows_at(DECEPTION, LEVEL)(e))


def easy_robots(e: Evidence) -> Finding:
    """With the same mean and no easy robots, what the wide range reached is not reached."""
    narrow, wide = (e.table.slower(f"coulomb20-{name}", LEVEL) for name in ("narrow", "deception"))
    found = larger(("deception, slower direction", wide), ("narrow", narrow))
    others = ("mean-kept", "mixture", "deception-joint")
    beside = "; ".join(describe(name, e.table.slower(f"coulomb20-{name}", LEVEL)) for name in others)
    return Finding(found.outcome, f"{found.evidence}; {beside}")


def bears_wear(e: Evidence) -> Finding:
    """Over 0 to 0.3, the wide range is nearer to the command than the narrow one, and than none."""
    return all_of(*(larger(e.error(other), e.error(DECEPTION)) for other in (DIRECT, NONE)))


def superior(e: Evidence) -> Finding:
    """Over 0 to 0.3, the wide range is nearer to the command than conventional randomisation."""
    return larger(e.error(NONE), e.error(DECEPTION))


def underperforms(e: Evidence) -> Finding:
    """The conventional policy is too slow in its slower direction, at each level."""
    return over_levels(
        [
            (level, within("none, slower direction", e.table.slower(NONE, level), -np.inf, FOLLOWS[0]))
            for level in e.table.levels(NONE)
            if level <= 0.3
        ]
    )


def only_with_friction(e: Evidence) -> Finding:
    """At nominal friction the wide range follows, and conventional randomisation is too slow."""
    return all_of(too_slow(NONE)(e), follows_at(DECEPTION, LEVEL)(e))


def sacrifice(e: Evidence) -> Finding:
    """Without friction, the wide range tracks worse than conventional randomisation."""
    names = (("deception, error at 0 [m/s]", DECEPTION), ("none", NONE))
    first, second = ((label, _tracking(e.table, name, 0.0)) for label, name in names)
    return larger(first, second)


def _tracking(table: Table, condition: str, level: float) -> Points:
    """Return the tracking error of every seed, mean of forward and backward [m/s]."""
    columns = [table.points(condition, level, vx, "tracking_error") for vx in DIRECTIONS]
    return {seed: float(np.mean([c[seed] for c in columns])) for seed in columns[0] if seed in columns[1]}


def nobody_looked(e: Evidence) -> Finding:
    """No result here bears on it."""
    return Finding("not tested", "nothing here looks at the optimiser's path")
