"""The criteria of the comparison: functions of what the policies reached in other engines and on the virtual robot.

A criterion under one condition is a function of the rows, a training method and the condition (`JudgeAt`); `elsewhere`,
`on_robot` and `under` say where it must hold.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from stiction.evaluation.grid import BATCH, REAL
from stiction.evaluation.samples import Condition, SeedValues
from stiction.files.results import DIRECTIONS, FOLLOWS
from stiction.files.velocity import STAND
from stiction_experiments.friction.claims import JITTER, MOVES, STATIONARY
from stiction_experiments.lab import claims
from stiction_experiments.lab.claims import (
    STABLE,
    Finding,
    all_of,
    any_of,
    differences,
    larger,
    larger_paired,
    over_levels,
    rate_within,
    within,
)
from stiction_experiments.lab.evidence import Evidence, Measurement
from stiction_experiments.replication.plan import (
    FRICTION_CELL,
    OTHER_ENGINES,
    PAPER_COEFFICIENT,
    REST_CELL,
    STAIRS_COMMAND,
    VIRTUAL_ROBOT,
)
from stiction_experiments.stairs.climb import ENOUGH

BENCHED = f"{REAL}-bench"
"""Law of what the paper's bench measured, as in results.csv."""

LOADED = "+load"
"""In the name of a law what stands before the coefficient of the load."""

Judge = Callable[[Evidence], Finding]
"""A criterion as a function of the rows."""

JudgeAt = Callable[[Evidence, str, Condition], Finding]
"""A criterion of a training method under one condition."""

HALF, JUMPING = 0.5, 0.05
"""Share of the command that counts as walking, and of walks that fall as failing; of steps in the air as jumping."""

NOTICEABLE = 0.1
"""Loss of speed ratio that one notices."""


def under(method: str, condition: Condition, judge: JudgeAt) -> Judge:
    """Judge a method under one condition."""
    return lambda e: judge(e, method, condition)


def elsewhere(method: str, judge: JudgeAt, level: float = 0.0) -> Judge:
    """Judge in every other engine in which a method was walked at a level of Coulomb friction; all must agree."""

    def judge_all(e: Evidence) -> Finding:
        engines = [engine for engine in OTHER_ENGINES if level in e.levels(method, engine)]
        if not engines:
            return Finding("not tested", f"{method} was not walked in another engine")
        return all_of(*(_located(engine, judge(e, method, Condition(engine, level))) for engine in engines))

    return judge_all


def _located(engine: str, finding: Finding) -> Finding:
    return Finding(finding.outcome, f"{engine}: {finding.evidence}")


def on_robot(method: str, judge: JudgeAt, engine: str = VIRTUAL_ROBOT) -> Judge:
    """Judge a sentence that names no level at every friction of virtual robots: where a method was not walked and
    others were, the evidence says so.

    Shares of the torque limit and the bench's value are one axis, and so is the load's coefficient for each of those
    that it was added to: which of 0.1 of the load and 10 % of the torque limit is more depends on the walk.
    """

    def judge_all(e: Evidence) -> Finding:
        if not e.frictions(method, engine):
            return Finding("not tested", f"{method} was not walked with friction in {engine}")
        axes: dict[tuple[str, float], list[tuple[float, Finding]]] = {}
        bench = ""
        conditions = {condition for other in e.methods() for condition in e.frictions(other, engine)}
        for condition in sorted(conditions, key=lambda one: (_load(one), one.level, one.law)):
            finding = judge(e, method, condition)
            if condition.law == BENCHED:
                bench = f"; at the bench's value, {condition.level:g}: {finding.outcome}, {finding.evidence}"
            load = _load(condition)
            base = (condition.law.partition(LOADED)[0], condition.level) if load else ("", 0.0)
            axes.setdefault(base, []).append((load or condition.level, finding))
        together = together_over_axes([_named(base, over_levels(findings)) for base, findings in axes.items()])
        return Finding(together.outcome, together.evidence + bench)

    return judge_all


def _load(condition: Condition) -> float:
    """Return the coefficient of the load, 0 without."""
    return float(condition.law.partition(LOADED)[2] or 0.0)


def _named(base: tuple[str, float], finding: Finding) -> Finding:
    """Return the finding of an axis; that of a load says so, and what it is added to."""
    law, level = base
    if not law:
        return finding
    of = "the bench's value" if law == BENCHED else f"{level:g}"
    return Finding(finding.outcome, f"load beside {of}: {finding.outcome}, {finding.evidence}")


def together_over_axes(findings: Sequence[Finding]) -> Finding:
    """Judge a sentence on several axes: as on all that were tested, or within limits where it has them on some.

    So it reproduces where it does on each, `only above x` where it does so on one and nothing else is said but that it
    holds throughout, or nowhere, on another; what contradicts is undecided.
    """
    evidence = "; ".join(finding.evidence for finding in findings)
    outcomes = {finding.outcome for finding in findings} - {"not tested"}
    if not outcomes:
        return Finding("not tested", evidence)
    limited = outcomes - {"reproduces", "does not"}
    decided = limited if limited and len(outcomes - limited) < 2 else outcomes
    return Finding(next(iter(decided)) if len(decided) == 1 else "undecided", evidence)


def _counted(judge: Judge, *methods: str) -> Judge:
    """Say in the evidence at which frictions virtual robots are left out: not all of the methods walked on them."""

    def judge_counted(e: Evidence) -> Finding:
        finding = judge(e)
        evidence = [finding.evidence]
        for c in e.frictions(methods[-1], VIRTUAL_ROBOT):
            counted, left_out = e.robots(c, *methods)
            if left_out:
                evidence.append(f"at {c.level:g} ({c.law}) robots counted: {len(counted)}, left out: {len(left_out)}")
        return Finding(finding.outcome, "; ".join(evidence))

    return judge_counted


def _falls(e: Evidence, method: str, c: Condition, commands: Sequence[str], low: float, high: float) -> list[Finding]:
    """Judge the share of walks that end in a fall, each command by itself."""
    rates = {vx: e.rate(method, c, (vx,), "fall_rate") for vx in commands}
    return [rate_within(f"{method}, falls at {vx}", rate, low, high) for vx, rate in rates.items()]


def farther_than(other: str) -> JudgeAt:
    """A method is farther from the command than another."""
    return lambda e, method, c: larger((method, e.error(method, c)), (other, e.error(other, c)))


def nearer_on_robot(method: str, than: str) -> Judge:
    """One method is nearer to the command than another on the virtual robots on which both walked."""

    def nearer(e: Evidence, method: str, c: Condition) -> Finding:
        shared = e.on_shared_robots(c, method, than)
        return larger((than, shared.error(than, c)), (method, shared.error(method, c)))

    return _counted(on_robot(method, nearer), method, than)


def follows_on_robot(method: str) -> Judge:
    """Every seed of a method follows on the virtual robots on which it walked, and nobody falls."""
    return _counted(on_robot(method, lambda e, method, c: claims.follows(e, method, c, method)), method)


def fails(e: Evidence, method: str, c: Condition) -> Finding:
    """A method comes to a stand in one direction, or half of its walks in one fall."""
    stands = within(f"{method}, slower direction", e.slower(method, c), -np.inf, STATIONARY)
    return any_of(stands, *_falls(e, method, c, DIRECTIONS, HALF, np.inf))


def unsteady(than: str, *commands: str) -> JudgeAt:
    """A method jitters beside another one, or falls too often to be stable, over the commands together."""

    def judge(e: Evidence, method: str, c: Condition) -> Finding:
        falling = rate_within(f"{method}, falls", e.rate(method, c, commands, "fall_rate"), STABLE, np.inf)
        return any_of(jitters(than, *commands)(e, method, c), falling)

    return judge


def jitters(than: str, *commands: str) -> JudgeAt:
    """The joints' accelerations of a method are above `JITTER` times those of another, while both walk.

    Joints of a robot that stands hardly accelerate, and of one that lies they are not measured: of each method only the
    seeds count that reach at least `HALF` of every command and fall in less than `HALF` of its walks. On virtual robots
    seeds alone decide: each may fall on other robots, and of a robot on which it fell there is no jitter to compare.
    """

    def judge(e: Evidence, method: str, c: Condition) -> Finding:
        (first, halted), (second, others) = (_jitter_of_walking(e, name, c, commands) for name in (method, than))
        allowed = Measurement({seed: JITTER * value for seed, value in second.items()})
        finding = larger((f"{method} [rad/s²]", Measurement(first)), (f"{JITTER:g} x {than}", allowed))
        reasons = [
            f"{name} stands or falls with seed {' '.join(map(str, seeds))}, which does not count"
            for name, seeds in ((method, halted), (than, others))
            if seeds
        ]
        return Finding(finding.outcome, "; ".join([finding.evidence, *reasons]))

    return judge


def _jitter_of_walking(e: Evidence, method: str, c: Condition, commands: Sequence[str]) -> tuple[SeedValues, list[int]]:
    """Return the largest joint acceleration over commands of the seeds that walk upright, and the seeds that do not."""
    jitter = e.worst(method, c, "joint_jitter", commands).seeds
    speed, falling = e.slower(method, c, commands).seeds, e.worst(method, c, "fall_rate", commands).seeds
    walking = {seed: value for seed, value in jitter.items() if speed.get(seed, 0.0) >= HALF > falling.get(seed, 1.0)}
    return walking, [seed for seed in jitter if seed not in walking]


def jumps(e: Evidence, method: str, c: Condition) -> Finding:
    """A method has no foot on the ground in too many steps."""
    return within("share of steps in the air", e.worst(method, c, "flight_share"), JUMPING, np.inf)


def climbs(e: Evidence, method: str, c: Condition) -> Finding:
    """A method crosses stairs of every height that was tried."""
    return _crossings(e, method, c, ENOUGH, np.inf)


def climbs_elsewhere(method: str) -> Judge:
    """A method crosses stairs of every height that was tried in each other engine, without friction."""
    return lambda e: all_of(*(_located(engine, climbs(e, method, Condition(engine, 0.0))) for engine in OTHER_ENGINES))


def climbs_not(e: Evidence, method: str, c: Condition) -> Finding:
    """A method crosses stairs of no height that was tried."""
    return _crossings(e, method, c, -np.inf, STATIONARY)


def _crossings(e: Evidence, method: str, c: Condition, low: float, high: float) -> Finding:
    walked = {terrain for name, engine, *_, terrain, _ in e.cells if (name, engine) == (method, c.engine)}
    rates = {terrain: e.rate(method, c, (STAIRS_COMMAND,), "crossed", terrain) for terrain in sorted(walked - {"flat"})}
    if not rates:
        return Finding("not tested", f"{method} was not walked over stairs in {c.engine}")
    return all_of(*(rate_within(f"{method} on {terrain}", rate, low, high) for terrain, rate in rates.items()))


def walks(command: str) -> JudgeAt:
    """A method reaches half of a command."""
    return lambda e, method, c: within(f"{method}, {command}", e.mean(method, c, "speed_ratio", command), HALF, np.inf)


def falls(command: str) -> JudgeAt:
    """Half of the walks end in a fall."""
    return lambda e, method, c: all_of(*_falls(e, method, c, (command,), HALF, np.inf))


def stationary(e: Evidence, method: str, c: Condition) -> Finding:
    """A method hardly moves in either direction, and stays upright in most walks: after a fall the speed is zero."""
    still = within(f"{method}, faster direction", e.faster(method, c), -np.inf, STATIONARY)
    return all_of(still, *_falls(e, method, c, DIRECTIONS, -np.inf, HALF))


def frozen_by(law: str) -> Judge:
    """The paper's number as a coefficient stops a policy that never met friction: it stands upright."""
    return under("none", Condition(BATCH, PAPER_COEFFICIENT, law), stationary)


def too_slow(e: Evidence, method: str, c: Condition) -> Finding:
    """A method is too slow in its slower direction."""
    return within(method, e.slower(method, c), -np.inf, FOLLOWS[0])


def stands_badly(e: Evidence, method: str, c: Condition) -> Finding:
    """A method moves where it is commanded to stand, or falls: then it has no speed."""
    speed = within(f"{method} at stand [m/s]", e.mean(method, c, "tracking_error", STAND), MOVES, np.inf)
    return any_of(speed, *_falls(e, method, c, (STAND,), STABLE, np.inf))


def loses(e: Evidence, method: str, c: Condition) -> Finding:
    """A method loses a noticeable part of its speed ratio between no friction and a condition, policy by policy."""
    lost = differences(e.slower(method, replace(c, level=0.0)).seeds, e.slower(method, c).seeds)
    return within(f"{method}, speed ratio lost", Measurement(lost), NOTICEABLE, np.inf)


def loses_at_each_level(method: str, engine: str) -> Judge:
    """The same in one engine, level by level."""

    def judge(e: Evidence) -> Finding:
        levels = [level for level in e.levels(method, engine) if level > 0]
        if not levels:
            return Finding("not tested", f"{method} was not walked with friction in {engine}")
        return over_levels([(level, loses(e, method, Condition(engine, level))) for level in levels])

    return judge


def slower_than_by_all_else(e: Evidence, method: str, c: Condition) -> Finding:
    """A friction leaves a method slower than all other differences of the virtual robot alone, policy by policy."""
    rest = e.slower(method, Condition(REST_CELL, 0.0))
    return larger_paired(("all but friction", rest), ("friction alone", e.slower(method, c)))


friction_is_the_cause = on_robot("none", slower_than_by_all_else, FRICTION_CELL)


def lower_is_better(e: Evidence) -> Finding:
    """Half of the friction leaves the conventional policy nearer to the command."""
    high, low = (e.error("none", Condition(VIRTUAL_ROBOT, level, REAL)) for level in (0.2, 0.1))
    return larger_paired(("none at 0.2", high), ("at 0.1", low))


def load_above_bench(e: Evidence) -> Finding:
    """The bench's friction does not trouble the conventional policy, a share of the load does."""
    frictions = {condition.law: condition for condition in e.frictions("none", VIRTUAL_ROBOT)}
    asked = {BENCHED: (FOLLOWS[0], np.inf), f"{BENCHED}{LOADED}0.1": (-np.inf, FOLLOWS[0])}
    if not asked.keys() <= frictions.keys():
        return Finding("not tested", "the virtual robot was not walked at the bench's friction with 0.1 of the load")
    at = {law: frictions[law] for law in asked}
    return all_of(*(within(f"none at {law} {c.level:g}", e.slower("none", c), *asked[law]) for law, c in at.items()))
