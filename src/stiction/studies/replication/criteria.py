"""The criteria of the comparison: functions of what the policies reached in other engines and on the virtual robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from stiction.evaluate.command import STAND
from stiction.evaluate.grid import BATCH, REAL
from stiction.evaluate.samples import Condition, Evidence, Measurement, SeedValues
from stiction.formats.results import DIRECTIONS, FOLLOWS
from stiction.studies import claims
from stiction.studies.claims import (
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
from stiction.studies.friction.claims import JITTER, STATIONARY
from stiction.studies.replication.plan import FRICTION, OTHERS, OVER, PAPER, REST, ROBOT
from stiction.studies.stairs.climb import ENOUGH

BENCHED = f"{REAL}-bench"
"""Law of what the paper's bench measured, as in results.csv."""

LOADED = "+load"
"""In the name of a law what stands before the coefficient of the load."""

Judge = Callable[[Evidence], Finding]
"""A criterion as a function of the rows."""

JudgeAt = Callable[[Evidence, Condition], Finding]
"""A criterion under one condition."""

MOVES = 0.1
"""Speed at which a robot that is told to stand does not [m/s]."""

HALF, JUMPING = 0.5, 0.05
"""Share of the command that counts as walking, and of walks that fall as failing; of steps in the air as jumping."""

NOTICEABLE = 0.1
"""Loss of speed ratio that one notices."""


def over_frictions(method: str, engine: str, judge: JudgeAt) -> Judge:
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
            found = judge(e, condition)
            if condition.law == BENCHED:
                bench = f"; at the bench's value, {condition.level:g}: {found.outcome}, {found.evidence}"
            load = _load(condition)
            base = (condition.law.partition(LOADED)[0], condition.level) if load else ("", 0.0)
            axes.setdefault(base, []).append((load or condition.level, found))
        judged = [_named(base, over_levels(findings)) for base, findings in axes.items()]
        together = together_over_axes(judged)
        return Finding(together.outcome, together.evidence + bench)

    return judge_all


def _load(condition: Condition) -> float:
    """Return the coefficient of the load, 0 without."""
    return float(condition.law.partition(LOADED)[2] or 0.0)


def _named(base: tuple[str, float], found: Finding) -> Finding:
    """Return the finding of an axis; that of a load says so, and what it is added to."""
    law, level = base
    if not law:
        return found
    of = "the bench's value" if law == BENCHED else f"{level:g}"
    return Finding(found.outcome, f"load beside {of}: {found.outcome}, {found.evidence}")


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


def on_robot(method: str, judge: JudgeAt) -> Judge:
    """Judge at every friction of the virtual robot."""
    return over_frictions(method, ROBOT, judge)


def everywhere(method: str, judge: JudgeAt, level: float = 0.0) -> Judge:
    """Judge in every other engine in which a method was walked at a level of Coulomb friction; all must agree."""

    def judge_all(e: Evidence) -> Finding:
        engines = [engine for engine in OTHERS if level in e.levels(method, engine)]
        if not engines:
            return Finding("not tested", f"{method} was not walked in another engine")
        return all_of(*(_located(engine, judge(e, Condition(engine, level))) for engine in engines))

    return judge_all


def _located(engine: str, found: Finding) -> Finding:
    """Return a finding that says in which engine it was made."""
    return Finding(found.outcome, f"{engine}: {found.evidence}")


def best_without_friction(e: Evidence) -> Finding:
    """Without friction in other engines nobody is nearer to the command than conventional training."""
    return all_of(*(worse_elsewhere(other, "none")(e) for other in ("deception", "actuator")))


def worse_elsewhere(method: str, than: str) -> Judge:
    """One method is farther from the command than another, in other engines without friction."""
    return everywhere(method, lambda e, c: larger((method, e.error(method, c)), (than, e.error(than, c))))


def abnormal_elsewhere(method: str, than: str) -> Judge:
    """A method jitters, beside another one, or falls, in other engines without friction."""
    return everywhere(method, unsteady_at(method, than, DIRECTIONS))


def fails_elsewhere(method: str) -> Judge:
    """A method comes to a stand in one direction, or half of its walks fall, in other engines without friction."""

    def at(e: Evidence, c: Condition) -> Finding:
        stands = within(f"{method}, slower direction", e.slower(method, c), -np.inf, STATIONARY)
        return any_of(stands, *_falls(e, method, c, DIRECTIONS, HALF, np.inf))

    return everywhere(method, at)


def _falls(e: Evidence, method: str, c: Condition, commands: Sequence[str], low: float, high: float) -> list[Finding]:
    """Judge the share of walks that end in a fall, each command by itself."""
    rates = {vx: e.rate(method, c, (vx,), "fall_rate") for vx in commands}
    return [rate_within(f"{method}, falls at {vx}", rate, low, high) for vx, rate in rates.items()]


def unsteady_at(method: str, than: str, commands: Sequence[str]) -> JudgeAt:
    """A method jitters beside another one, or falls too often to be stable, over the commands together."""

    def at(e: Evidence, c: Condition) -> Finding:
        falling = rate_within(f"{method}, falls", e.rate(method, c, commands, "fall_rate"), STABLE, np.inf)
        return any_of(jitters_at(method, than, commands)(e, c), falling)

    return at


def jitters_elsewhere(e: Evidence) -> Finding:
    """The friction-aware policy's joints accelerate a multiple of the conventional one's."""
    return everywhere("deception", jitters_at("deception", "none"))(e)


def jitters_on_the_robot(method: str, than: str) -> Judge:
    """The same on the virtual robot, of any two methods."""
    return on_robot(method, jitters_at(method, than))


def jitters_at(method: str, than: str, commands: Sequence[str] = DIRECTIONS) -> JudgeAt:
    """The joints' accelerations of one method are above `JITTER` times those of another, while both walk.

    Joints of a robot that stands hardly accelerate, and of one that lies they are not measured: of each method only the
    seeds count that reach at least `HALF` of every command and fall in less than `HALF` of its walks. On virtual robots
    seeds alone decide: each may fall on other robots, and of a robot on which it fell there is no jitter to compare.
    """

    def at(e: Evidence, c: Condition) -> Finding:
        (first, halted), (second, others) = (_jitter_of_walking(e, name, c, commands) for name in (method, than))
        allowed = Measurement({seed: JITTER * value for seed, value in second.items()})
        found = larger((f"{method} [rad/s²]", Measurement(first)), (f"{JITTER:g} x {than}", allowed))
        reasons = [
            f"{name} stands or falls with seed {' '.join(map(str, seeds))}, which does not count"
            for name, seeds in ((method, halted), (than, others))
            if seeds
        ]
        return Finding(found.outcome, "; ".join([found.evidence, *reasons]))

    return at


def _jitter_of_walking(e: Evidence, method: str, c: Condition, commands: Sequence[str]) -> tuple[SeedValues, list[int]]:
    """Return the largest joint acceleration over commands of the seeds that walk upright, and the seeds that do not."""
    jitter = e.worst(method, c, "joint_jitter", commands).seeds
    speed, falls = e.slower(method, c, commands).seeds, e.worst(method, c, "fall_rate", commands).seeds
    walking = {seed: value for seed, value in jitter.items() if speed.get(seed, 0.0) >= HALF > falls.get(seed, 1.0)}
    return walking, [seed for seed in jitter if seed not in walking]


def jumps_elsewhere(e: Evidence) -> Finding:
    """The friction-aware policy flies."""

    def at(e: Evidence, c: Condition) -> Finding:
        return within("share of steps in the air", e.worst("deception", c, "flight_share"), JUMPING, np.inf)

    return everywhere("deception", at)(e)


def climbs(method: str, engine: str, level: float) -> Judge:
    """A method crosses stairs of every height that was tried."""
    return lambda e: _crossings(e, method, engine, level, ENOUGH, np.inf)


def climbs_elsewhere(method: str) -> Judge:
    """A method crosses stairs of every height that was tried in each other engine, without friction."""
    return lambda e: all_of(*(_located(engine, climbs(method, engine, 0.0)(e)) for engine in OTHERS))


def climbs_not(method: str, engine: str, level: float) -> Judge:
    """A method crosses stairs of no height that was tried."""
    return lambda e: _crossings(e, method, engine, level, -np.inf, STATIONARY)


def _crossings(e: Evidence, method: str, engine: str, level: float, low: float, high: float) -> Finding:
    """Judge the share of crossings at each height."""
    law = REAL if engine == ROBOT and level > 0 else "coulomb"
    walked = {terrain for name, at, *_, terrain, _ in e.cells if (name, at) == (method, engine)}
    found = []
    for terrain in sorted(walked - {"flat"}):
        rate = e.rate(method, Condition(engine, level, law), (OVER,), "crossed", terrain)
        found.append(rate_within(f"{method} on {terrain}", rate, low, high))
    return all_of(*found) if found else Finding("not tested", f"{method} was not walked over stairs in {engine}")


def walks(method: str, command: str) -> Judge:
    """A method reaches half of a command on the virtual robot."""

    def at(e: Evidence, c: Condition) -> Finding:
        return within(f"{method}, {command}", e.mean(method, c, "speed_ratio", command), HALF, np.inf)

    return on_robot(method, at)


def follows(method: str) -> Judge:
    """Every seed of a method follows on the virtual robots on which it walked, and nobody falls."""
    return _counted(on_robot(method, lambda e, c: claims.follows(e, method, c, method)), method)


def falls(method: str, command: str) -> Judge:
    """Half of the walks on the virtual robot end in a fall."""
    return on_robot(method, lambda e, c: all_of(*_falls(e, method, c, (command,), HALF, np.inf)))


def unsteady(method: str, than: str, command: str) -> Judge:
    """A method jitters on the virtual robot, beside another one, or falls more often than a stable one."""
    return on_robot(method, unsteady_at(method, than, (command,)))


def better_on_the_robot(method: str, than: str) -> Judge:
    """One method is nearer to the command than another on the virtual robots on which both walked."""

    def at(e: Evidence, c: Condition) -> Finding:
        shared = e.on_shared_robots(c, method, than)
        return larger((than, shared.error(than, c)), (method, shared.error(method, c)))

    return _counted(on_robot(method, at), method, than)


def _counted(judge: Judge, *methods: str) -> Judge:
    """Say in the evidence at which frictions virtual robots are left out: not all of the methods walked on them."""

    def judge_counted(e: Evidence) -> Finding:
        found, said = judge(e), []
        for c in e.frictions(methods[-1], ROBOT):
            counted, left_out = e.robots(c, *methods)
            if left_out:
                said.append(f"at {c.level:g} ({c.law}) robots counted: {len(counted)}, left out: {len(left_out)}")
        return Finding(found.outcome, "; ".join([found.evidence, *said]))

    return judge_counted


def stationary(method: str) -> Judge:
    """A method hardly moves in either direction on the virtual robot, and stays upright."""
    return on_robot(method, stands_at(method))


def stands_at(method: str) -> JudgeAt:
    """A method hardly moves in either direction, and stays upright in most walks: after a fall the speed is zero."""

    def at(e: Evidence, c: Condition) -> Finding:
        still = within(f"{method}, faster direction", e.faster(method, c), -np.inf, STATIONARY)
        return all_of(still, *_falls(e, method, c, DIRECTIONS, -np.inf, HALF))

    return at


def too_slow(method: str) -> Judge:
    """A method is too slow in its slower direction on the virtual robot."""
    return on_robot(method, lambda e, c: within(method, e.slower(method, c), -np.inf, FOLLOWS[0]))


def stands_badly(method: str) -> Judge:
    """A method moves where it is told to stand on the virtual robot, or falls: then it has no speed."""

    def at(e: Evidence, c: Condition) -> Finding:
        speed = within(f"{method} at stand [m/s]", e.mean(method, c, "tracking_error", STAND), MOVES, np.inf)
        return any_of(speed, *_falls(e, method, c, (STAND,), STABLE, np.inf))

    return on_robot(method, at)


def loses(method: str, level: float) -> Judge:
    """A method loses a noticeable part of its speed up to a level, in other engines, policy by policy."""
    return everywhere(method, loses_at(method), level)


def loses_at_each_level(method: str, engine: str) -> Judge:
    """The same in one engine, level by level."""

    def judge(e: Evidence) -> Finding:
        levels = [level for level in e.levels(method, engine) if level > 0]
        if not levels:
            return Finding("not tested", f"{method} was not walked with friction in {engine}")
        return over_levels([(level, loses_at(method)(e, Condition(engine, level))) for level in levels])

    return judge


def loses_at(method: str) -> JudgeAt:
    """A method loses a noticeable part of its speed ratio between no friction and a condition."""

    def at(e: Evidence, c: Condition) -> Finding:
        lost = differences(e.slower(method, replace(c, level=0.0)).seeds, e.slower(method, c).seeds)
        return within(f"{method}, speed ratio lost", Measurement(lost), NOTICEABLE, np.inf)

    return at


def friction_is_the_cause(e: Evidence) -> Finding:
    """Friction alone leaves the conventional policy slower than all other differences alone, policy by policy."""

    def at(e: Evidence, c: Condition) -> Finding:
        rest = e.slower("none", Condition(REST, 0.0))
        return larger_paired(("all but friction", rest), ("friction alone", e.slower("none", c)))

    return over_frictions("none", FRICTION, at)(e)


def lower_is_better(e: Evidence) -> Finding:
    """Half of the friction leaves the conventional policy nearer to the command."""
    high, low = (e.error("none", Condition(ROBOT, level, REAL)) for level in (0.2, 0.1))
    return larger_paired(("none at 0.2", high), ("at 0.1", low))


def frozen_by(law: str) -> Judge:
    """The paper's number as a coefficient stops a policy that never met friction: it stands upright."""
    return lambda e: stands_at("none")(e, Condition(BATCH, PAPER, law))


def load_above_bench(e: Evidence) -> Finding:
    """The bench's friction does not trouble the conventional policy, a share of the load does."""
    frictions = {condition.law: condition for condition in e.frictions("none", ROBOT)}
    not_slow, slow = (FOLLOWS[0], np.inf), (-np.inf, FOLLOWS[0])
    asked = ((BENCHED, not_slow), (f"{BENCHED}{LOADED}0.1", slow))
    if any(law not in frictions for law, _ in asked):
        return Finding("not tested", "the virtual robot was not walked at the bench's friction with 0.1 of the load")
    found = []
    for law, ends in asked:
        c = frictions[law]
        found.append(within(f"none at {law} {c.level:g}", e.slower("none", c), *ends))
    return all_of(*found)
