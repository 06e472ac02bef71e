"""The criteria of the comparison: functions of what the policies reached in other engines and on the virtual robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from stiction.transfer.experiment.criteria import FOLLOWS, JITTER, STATIONARY
from stiction.transfer.experiment.judging import Finding, all_of, larger, larger_paired, over_levels, within
from stiction.transfer.experiment.table import Points
from stiction.transfer.replication.evidence import Evidence, Spot

Judge = Callable[[Evidence], Finding]
"""A criterion as a function of the rows."""

OTHERS = ("physx", "ode-webots", "ode")
"""Engines that are not the one of the training."""

ROBOT, NOMINAL, FRICTION, REST = "physx+all", "physx+nominal", "physx+friction", "physx+rest"
"""The virtual robot, and the cells by which causes are told apart."""

REAL = "real"
"""Law of its friction."""

PAPER = 0.442
"""The paper's number [N m], read as a coefficient."""

MOVES = 0.1
"""Speed at which a robot that is told to stand does not [m/s]."""

NOTICEABLE = 0.1
"""Loss of speed ratio that one notices."""

HALF, JUMPING, STABLE, CROSSED = 0.5, 0.05, 0.05, 0.8
"""Share of the command that counts as walking; of steps in the air as jumping; of falls as stable; of crossings."""


def elsewhere(e: Evidence, way: str, level: float = 0.0) -> list[Spot]:
    """Return the other engines in which a way was walked at a level of Coulomb friction."""
    return [Spot(engine, level) for engine in OTHERS if level in e.levels(way, engine)]


def on_robot(e: Evidence, way: str, judge: Callable[[Spot], Finding]) -> Finding:
    """Judge at every level of the virtual robot's friction."""
    levels = e.levels(way, ROBOT, REAL)
    if not levels:
        return Finding("not tested", f"{way} was not walked on the virtual robot")
    return over_levels([(level, judge(Spot(ROBOT, level, REAL))) for level in levels])


def everywhere(e: Evidence, way: str, judge: Callable[[Spot], Finding], level: float = 0.0) -> Finding:
    """Judge in every other engine; all of them must agree."""
    spots = elsewhere(e, way, level)
    if not spots:
        return Finding("not tested", f"{way} was not walked in another engine")
    found = [judge(spot) for spot in spots]
    return all_of(*(Finding(f.outcome, f"{s.engine}: {f.evidence}") for s, f in zip(spots, found, strict=True)))


def best_without_friction(e: Evidence) -> Finding:
    """Without friction in other engines nobody is nearer to the command than conventional training."""
    return all_of(*(worse_elsewhere(other, "none")(e) for other in ("deception", "actuator")))


def worse_elsewhere(way: str, than: str) -> Judge:
    """One way is farther from the command than another, in other engines without friction."""

    def judge(e: Evidence) -> Finding:
        def at(spot: Spot) -> Finding:
            return larger((way, e.error(way, [spot])), (than, e.error(than, [spot])))

        return everywhere(e, way, at)

    return judge


def fails_elsewhere(way: str) -> Judge:
    """A way comes to a stand in one direction in other engines without friction."""
    return lambda e: everywhere(e, way, lambda s: within(way, e.slower(way, s), -np.inf, STATIONARY))


def loses(way: str, level: float) -> Judge:
    """A way loses a noticeable part of its speed up to a level, in other engines, policy by policy."""

    def judge(e: Evidence) -> Finding:
        def at(spot: Spot) -> Finding:
            lost = _less(e.slower(way, replace(spot, level=0.0)), e.slower(way, spot))
            return within(f"{way}, speed ratio lost", lost, NOTICEABLE, np.inf)

        return everywhere(e, way, at, level)

    return judge


def jitters_elsewhere(e: Evidence) -> Finding:
    """The friction-aware policy's joints accelerate a multiple of the conventional one's."""

    def at(spot: Spot) -> Finding:
        return _jitter(e, "deception", "none", spot)

    return everywhere(e, "deception", at)


def jitters_on_the_robot(way: str, than: str) -> Judge:
    """The same on the virtual robot, of any two ways."""
    return lambda e: on_robot(e, way, lambda spot: _jitter(e, way, than, spot))


def _jitter(e: Evidence, way: str, than: str, spot: Spot) -> Finding:
    """Judge that the joints' accelerations of one way are above `JITTER` times those of another."""
    first, second = (e.worst(name, spot, "joint_jitter") for name in (way, than))
    allowed = {seed: JITTER * value for seed, value in second.items()}
    return larger((f"{way} [rad/s²]", first), (f"{JITTER:g} x {than}", allowed))


def jumps_elsewhere(e: Evidence) -> Finding:
    """The friction-aware policy flies."""

    def at(spot: Spot) -> Finding:
        return within("share of steps in the air", e.worst("deception", spot, "flight_share"), JUMPING, np.inf)

    return everywhere(e, "deception", at)


def climbs(way: str, engine: str, level: float) -> Judge:
    """A way crosses stairs of every height that was tried."""
    return lambda e: _crossings(e, way, engine, level, CROSSED, np.inf)


def climbs_not(way: str, engine: str, level: float) -> Judge:
    """A way crosses stairs of no height that was tried."""
    return lambda e: _crossings(e, way, engine, level, -np.inf, STATIONARY)


def _crossings(e: Evidence, way: str, engine: str, level: float, low: float, high: float) -> Finding:
    """Judge the share of crossings at each height."""
    law = REAL if engine == ROBOT and level > 0 else "coulomb"
    heights = sorted({terrain for w, at, *_, terrain, _ in e.cells if (w, at) == (way, engine) and terrain != "flat"})
    found = []
    for terrain in heights:
        points = e.points(way, Spot(engine, level, law), "vx=0.4", "crossed", terrain)
        found.append(within(f"{way} on {terrain}", points, low, high))
    return all_of(*found) if found else Finding("not tested", f"{way} was not walked over stairs in {engine}")


def walks(way: str, command: str) -> Judge:
    """A way reaches half of a command on the virtual robot."""

    def judge(e: Evidence) -> Finding:
        return on_robot(
            e, way, lambda s: within(f"{way}, {command}", e.points(way, s, command, "speed_ratio"), HALF, np.inf)
        )

    return judge


def walks_both_ways(way: str) -> Judge:
    """A way reaches 80 % of the command in both directions on the virtual robot, however fast it is."""
    return lambda e: on_robot(e, way, lambda s: within(f"{way}, slower", e.slower(way, s), FOLLOWS[0], np.inf))


def falls(way: str, command: str) -> Judge:
    """Half of the walks on the virtual robot end in a fall."""

    def judge(e: Evidence) -> Finding:
        return on_robot(
            e, way, lambda s: within(f"{way}, falls at {command}", e.points(way, s, command, "fall_rate"), HALF, np.inf)
        )

    return judge


def walks_stably(way: str) -> Judge:
    """A way follows in both directions on the virtual robot, and stays upright."""

    def judge(e: Evidence) -> Finding:
        def at(spot: Spot) -> Finding:
            return all_of(
                within(f"{way}, slower direction", e.slower(way, spot), *FOLLOWS),
                within("faster direction", e.faster(way, spot), *FOLLOWS),
                within("falls", e.worst(way, spot, "fall_rate"), -np.inf, STABLE),
            )

        return on_robot(e, way, at)

    return judge


def better_on_the_robot(way: str, than: str) -> Judge:
    """One way is nearer to the command than another on the virtual robot."""

    def judge(e: Evidence) -> Finding:
        return on_robot(e, way, lambda s: larger((than, e.error(than, [s])), (way, e.error(way, [s]))))

    return judge


def stationary(way: str) -> Judge:
    """A way hardly moves in either direction on the virtual robot."""
    return lambda e: on_robot(e, way, lambda s: within(way, e.faster(way, s), -np.inf, STATIONARY))


def fails(way: str) -> Judge:
    """A way does not follow in both directions on the virtual robot."""
    return lambda e: on_robot(e, way, lambda s: within(way, e.slower(way, s), -np.inf, FOLLOWS[0]))


def stands_badly(way: str) -> Judge:
    """A way moves, or falls, where it is told to stand: speed over `MOVES` or falls over `STABLE`, the larger."""

    def judge(e: Evidence) -> Finding:
        def at(spot: Spot) -> Finding:
            speed, falls = (e.points(way, spot, "stand", column) for column in ("tracking_error", "fall_rate"))
            points = {seed: max(speed[seed] / MOVES, falls[seed] / STABLE) for seed in speed}
            return within(f"{way} at stand, speed over {MOVES:g} m/s or falls over {STABLE:.0%}", points, 1.0, np.inf)

        return on_robot(e, way, at)

    return judge


def friction_is_the_cause(e: Evidence) -> Finding:
    """Friction alone leaves the conventional policy slower than all other differences alone, policy by policy."""
    rest = e.slower("none", Spot(REST, 0.0))
    found = []
    for level in e.levels("none", FRICTION, REAL):
        friction = e.slower("none", Spot(FRICTION, level, REAL))
        found.append((level, larger_paired(("all but friction", rest), ("friction alone", friction))))
    return over_levels(found) if found else Finding("not tested", "none was not walked with friction alone")


def _less(first: Points, second: Points) -> Points:
    """Return the differences of seeds that both have."""
    return {seed: first[seed] - second[seed] for seed in sorted(first.keys() & second.keys())}


def lower_is_better(e: Evidence) -> Finding:
    """Half of the friction leaves the conventional policy nearer to the command."""
    high, low = (e.error("none", [Spot(ROBOT, level, REAL)]) for level in (0.2, 0.1))
    return larger_paired(("none at 0.2", high), ("at 0.1", low))


def frozen_by(law: str) -> Judge:
    """The paper's number as a coefficient stops a policy that never met friction."""
    return lambda e: within("none, faster direction", e.faster("none", Spot("mujoco", PAPER, law)), -np.inf, STATIONARY)


def webots_without_friction(e: Evidence) -> Finding:
    """In Webots' engine the conventional policy follows without friction and does not with it."""
    return all_of(
        *(_follows_or_not(e, Spot("ode-webots", level), follows) for level, follows in ((0.0, True), (0.2, False)))
    )


def load_above_bench(e: Evidence) -> Finding:
    """The bench's friction does not trouble the conventional policy, a share of the load does."""
    levels = {law: level for w, at, law, level, *_ in e.cells if (w, at) == ("none", ROBOT) and law.startswith(REAL)}
    asked: Sequence[tuple[str, bool]] = ((f"{REAL}-bench", True), (f"{REAL}-bench+load0.1", False))
    if any(law not in levels for law, _ in asked):
        return Finding("not tested", "the virtual robot was not walked at the bench's friction with 0.1 of the load")
    return all_of(*(_follows_or_not(e, Spot(ROBOT, levels[law], law), follows) for law, follows in asked))


def _follows_or_not(e: Evidence, spot: Spot, follows: bool) -> Finding:
    """Judge that the conventional policy follows in its slower direction, or that it does not."""
    ends = (FOLLOWS[0], np.inf) if follows else (-np.inf, FOLLOWS[0])
    return within(f"none at {spot.law} {spot.level:g}", e.slower("none", spot), *ends)
