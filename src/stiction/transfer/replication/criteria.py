"""The criteria of the comparison: functions of what the policies reached in other engines and on the virtual robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from stiction.formats.climb import ENOUGH
from stiction.formats.results import DIRECTIONS, FOLLOWS
from stiction.transfer.command import STAND
from stiction.transfer.experiment.criteria import JITTER, STATIONARY
from stiction.transfer.experiment.judging import Finding, all_follow, all_of, any_of, rate_within
from stiction.transfer.experiment.judging import larger as larger_over_seeds
from stiction.transfer.experiment.table import Points
from stiction.transfer.grid.plan import REAL
from stiction.transfer.replication.agreement import larger, within
from stiction.transfer.replication.evidence import Evidence, Spot
from stiction.transfer.replication.frictions import over_frictions
from stiction.transfer.replication.plan import OTHERS, OVER, ROBOT

Judge = Callable[[Evidence], Finding]
"""A criterion as a function of the rows."""

MOVES = 0.1
"""Speed at which a robot that is told to stand does not [m/s]."""

HALF, JUMPING = 0.5, 0.05
"""Share of the command that counts as walking, and of walks that fall as failing; of steps in the air as jumping."""

STABLE = 1 / 3
"""Share of walks that may fall of a robot that is stable. No fall on eight robots shows that the rate over robots is
under it (Wilson: 0.324), however many policies walked on them; to show a rate under 10 % takes 35 robots. No fall in
twelve walks shows it on the robot of the data sheet (0.242), and none in six does not (0.390)."""


def elsewhere(e: Evidence, way: str, level: float = 0.0) -> list[Spot]:
    """Return the other engines in which a way was walked at a level of Coulomb friction."""
    return [Spot(engine, level) for engine in OTHERS if level in e.levels(way, engine)]


def on_robot(e: Evidence, way: str, judge: Callable[[Spot], Finding]) -> Finding:
    """Judge at every friction of the virtual robot."""
    return over_frictions(e, way, ROBOT, judge)


def everywhere(e: Evidence, way: str, judge: Callable[[Spot], Finding], level: float = 0.0) -> Finding:
    """Judge in every other engine; all of them must agree."""
    spots = elsewhere(e, way, level)
    if not spots:
        return Finding("not tested", f"{way} was not walked in another engine")
    return all_of(*(_located(spot.engine, judge(spot)) for spot in spots))


def _located(engine: str, found: Finding) -> Finding:
    """Return a finding that says in which engine it was made."""
    return Finding(found.outcome, f"{engine}: {found.evidence}")


def best_without_friction(e: Evidence) -> Finding:
    """Without friction in other engines nobody is nearer to the command than conventional training."""
    return all_of(*(worse_elsewhere(other, "none")(e) for other in ("deception", "actuator")))


def worse_elsewhere(way: str, than: str) -> Judge:
    """One way is farther from the command than another, in other engines without friction."""

    def judge(e: Evidence) -> Finding:
        def at(spot: Spot) -> Finding:
            return larger((way, e.error(way, spot)), (than, e.error(than, spot)))

        return everywhere(e, way, at)

    return judge


def abnormal_elsewhere(way: str, than: str) -> Judge:
    """A way jitters, beside another one, or falls, in other engines without friction."""
    return lambda e: everywhere(e, way, lambda spot: _unsteady(e, way, than, spot, DIRECTIONS))


def fails_elsewhere(way: str) -> Judge:
    """A way comes to a stand in one direction, or half of its walks fall, in other engines without friction."""

    def judge(e: Evidence) -> Finding:
        def at(spot: Spot) -> Finding:
            stands = within(f"{way}, slower direction", e.slower(way, spot), -np.inf, STATIONARY)
            return any_of(stands, *_falls(e, way, spot, DIRECTIONS, HALF, np.inf))

        return everywhere(e, way, at)

    return judge


def _falls(e: Evidence, way: str, spot: Spot, commands: Sequence[str], low: float, high: float) -> list[Finding]:
    """Judge the share of walks that end in a fall, each command by itself."""
    label = f"{way}, falls at {{}}"
    return [rate_within(label.format(vx), e.rate(way, spot, (vx,), "fall_rate"), low, high) for vx in commands]


def upright(e: Evidence, way: str, spot: Spot) -> list[Finding]:
    """Judge that a way does not fall in most of its walks, in each direction: who lies does not stand still."""
    return _falls(e, way, spot, DIRECTIONS, -np.inf, HALF)


def _unsteady(e: Evidence, way: str, than: str, spot: Spot, commands: Sequence[str]) -> Finding:
    """Judge that a way jitters beside another one, or is no stable one by its falls, over the commands together."""
    falling = rate_within(f"{way}, falls", e.rate(way, spot, commands, "fall_rate"), STABLE, np.inf)
    return any_of(_jitter(e, way, than, spot, commands), falling)


def jitters_elsewhere(e: Evidence) -> Finding:
    """The friction-aware policy's joints accelerate a multiple of the conventional one's."""

    def at(spot: Spot) -> Finding:
        return _jitter(e, "deception", "none", spot)

    return everywhere(e, "deception", at)


def jitters_on_the_robot(way: str, than: str) -> Judge:
    """The same on the virtual robot, of any two ways."""
    return lambda e: on_robot(e, way, lambda spot: _jitter(e, way, than, spot))


def _jitter(e: Evidence, way: str, than: str, spot: Spot, commands: Sequence[str] = DIRECTIONS) -> Finding:
    """Judge that the joints' accelerations of one way are above `JITTER` times those of another, while both walk.

    Joints of a robot that stands hardly accelerate, and of one that lies they are not measured: of each way only the
    seeds count that reach at least `HALF` of every command and fall in less than `HALF` of its walks. On virtual robots
    seeds alone decide: each may fall on other robots, and of a robot on which it fell there is no jitter to compare.
    """
    (first, halted), (second, others) = (_jitter_of_walking(e, name, spot, commands) for name in (way, than))
    allowed = {seed: JITTER * value for seed, value in second.items()}
    found = larger_over_seeds((f"{way} [rad/s²]", first), (f"{JITTER:g} x {than}", allowed))
    reasons = [
        f"{name} stands or falls with seed {' '.join(map(str, seeds))}, which does not count"
        for name, seeds in ((way, halted), (than, others))
        if seeds
    ]
    return Finding(found.outcome, "; ".join([found.evidence, *reasons]))


def _jitter_of_walking(e: Evidence, way: str, spot: Spot, commands: Sequence[str]) -> tuple[Points, list[int]]:
    """Return the largest joint acceleration over commands of the seeds that walk upright, and the seeds that do not."""
    jitter = e.worst(way, spot, "joint_jitter", commands).seeds
    speed, falls = e.slower(way, spot, commands).seeds, e.worst(way, spot, "fall_rate", commands).seeds
    walking = {seed: value for seed, value in jitter.items() if speed.get(seed, 0.0) >= HALF > falls.get(seed, 1.0)}
    return walking, [seed for seed in jitter if seed not in walking]


def jumps_elsewhere(e: Evidence) -> Finding:
    """The friction-aware policy flies."""

    def at(spot: Spot) -> Finding:
        return within("share of steps in the air", e.worst("deception", spot, "flight_share"), JUMPING, np.inf)

    return everywhere(e, "deception", at)


def climbs(way: str, engine: str, level: float) -> Judge:
    """A way crosses stairs of every height that was tried."""
    return lambda e: _crossings(e, way, engine, level, ENOUGH, np.inf)


def climbs_elsewhere(way: str) -> Judge:
    """A way crosses stairs of every height that was tried in each other engine, without friction."""
    return lambda e: all_of(*(_located(engine, climbs(way, engine, 0.0)(e)) for engine in OTHERS))


def climbs_not(way: str, engine: str, level: float) -> Judge:
    """A way crosses stairs of no height that was tried."""
    return lambda e: _crossings(e, way, engine, level, -np.inf, STATIONARY)


def _crossings(e: Evidence, way: str, engine: str, level: float, low: float, high: float) -> Finding:
    """Judge the share of crossings at each height."""
    law = REAL if engine == ROBOT and level > 0 else "coulomb"
    heights = sorted({terrain for w, at, *_, terrain, _ in e.cells if (w, at) == (way, engine) and terrain != "flat"})
    found = []
    for terrain in heights:
        rate = e.rate(way, Spot(engine, level, law), (OVER,), "crossed", terrain)
        found.append(rate_within(f"{way} on {terrain}", rate, low, high))
    return all_of(*found) if found else Finding("not tested", f"{way} was not walked over stairs in {engine}")


def walks(way: str, command: str) -> Judge:
    """A way reaches half of a command on the virtual robot."""

    def judge(e: Evidence) -> Finding:
        return on_robot(
            e, way, lambda s: within(f"{way}, {command}", e.points(way, s, command, "speed_ratio"), HALF, np.inf)
        )

    return judge


def follows(way: str) -> Judge:
    """Every seed of a way follows on the virtual robots on which it walked."""
    return lambda e: _counted(e, on_robot(e, way, lambda spot: _follows(e, way, spot)), way)


def _follows(e: Evidence, way: str, spot: Spot) -> Finding:
    """Judge that every seed of a way follows in both directions at a spot, and never falls."""
    slower, faster = e.slower(way, spot), e.faster(way, spot)
    mean = all_of(
        within(f"{way}, slower direction", slower, *FOLLOWS),
        within("faster direction", faster, *FOLLOWS),
    )
    return all_follow(mean, slower.seeds, faster.seeds, e.worst(way, spot, "fall_rate").seeds)


def falls(way: str, command: str) -> Judge:
    """Half of the walks on the virtual robot end in a fall."""
    return lambda e: on_robot(e, way, lambda spot: all_of(*_falls(e, way, spot, (command,), HALF, np.inf)))


def unsteady(way: str, than: str, command: str) -> Judge:
    """A way jitters on the virtual robot, beside another one, or falls more often than a stable one."""
    return lambda e: on_robot(e, way, lambda spot: _unsteady(e, way, than, spot, (command,)))


def walks_stably(way: str) -> Judge:
    """Every seed of a way follows on the virtual robot, on robots enough to show that it is stable."""

    def judge(e: Evidence) -> Finding:
        def at(spot: Spot) -> Finding:
            return all_of(_follows(e, way, spot), *_falls(e, way, spot, DIRECTIONS, -np.inf, STABLE))

        return on_robot(e, way, at)

    return judge


def better_on_the_robot(way: str, than: str) -> Judge:
    """One way is nearer to the command than another on the virtual robots on which both walked."""

    def judge(e: Evidence) -> Finding:
        def at(spot: Spot) -> Finding:
            shared = e.on_shared_robots(spot, way, than)
            return larger((than, shared.error(than, spot)), (way, shared.error(way, spot)))

        return _counted(e, on_robot(e, way, at), way, than)

    return judge


def _counted(e: Evidence, found: Finding, *ways: str) -> Finding:
    """Return a finding that says at which frictions virtual robots are left out: not all of the ways walked on them."""
    said = []
    for spot in e.frictions(ways[-1], ROBOT):
        counted, left_out = e.robots(spot, *ways)
        if left_out:
            said.append(f"at {spot.level:g} ({spot.law}) robots counted: {len(counted)}, left out: {len(left_out)}")
    return Finding(found.outcome, "; ".join([found.evidence, *said]))


def stationary(way: str) -> Judge:
    """A way hardly moves in either direction on the virtual robot, and stays upright."""
    return lambda e: on_robot(e, way, lambda spot: stands(e, way, spot))


def stands(e: Evidence, way: str, spot: Spot) -> Finding:
    """Judge that a way hardly moves in either direction, and is not one that falls: after a fall its speed is zero."""
    still = within(f"{way}, faster direction", e.faster(way, spot), -np.inf, STATIONARY)
    return all_of(still, *upright(e, way, spot))


def too_slow(way: str) -> Judge:
    """A way is too slow in its slower direction on the virtual robot."""
    return lambda e: on_robot(e, way, lambda s: within(way, e.slower(way, s), -np.inf, FOLLOWS[0]))


def stands_badly(way: str) -> Judge:
    """A way moves, or falls, where it is told to stand on the virtual robot: who lies has no speed."""

    def judge(e: Evidence) -> Finding:
        def at(spot: Spot) -> Finding:
            speed = within(f"{way} at stand [m/s]", e.points(way, spot, STAND, "tracking_error"), MOVES, np.inf)
            return any_of(speed, *_falls(e, way, spot, (STAND,), STABLE, np.inf))

        return on_robot(e, way, at)

    return judge
