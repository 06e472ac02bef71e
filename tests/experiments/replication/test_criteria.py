"""The criteria of the comparison, on rows made by hand: three seeds whose intervals decide, one that does not."""

from typing import Any

import numpy as np
import pytest

from stiction.evaluation.policies import BEHIND_GEAR
from stiction.evaluation.samples import Condition, Row
from stiction.files.results import DIRECTIONS
from stiction_experiments.lab.claims import Finding
from stiction_experiments.lab.evidence import Evidence
from stiction_experiments.replication import criteria
from stiction_experiments.replication.claims import CLAIMS, judge_all
from stiction_experiments.replication.criteria import elsewhere, on_robot, together_over_axes
from stiction_experiments.replication.plan import VIRTUAL_ROBOT

SEEDS = (0, 1, 2)
SPREAD = (-0.01, 0.0, 0.01)
"""Differences between seeds: the half-width of the 95 % interval is 4.303 · 0.01 / √3 = 0.025."""


def rows(
    method: str,
    condition: Condition,
    forward: float,
    backward: float | None = None,
    seeds: tuple[int, ...] = SEEDS,
    **columns: Any,
) -> list[Row]:
    """Return rows of a method at a condition: speed ratios about these means, other columns the same for every seed."""
    speeds = (("vx=0.5", forward), ("vx=-0.5", forward if backward is None else backward))
    same = {"terrain": "flat", "tracking_error": 0.1, "fall_rate": 0.0, "joint_jitter": 50.0, "flight_share": 0.0}
    same |= {"episodes": 40}
    return [
        same
        | {
            "method": method,
            "engine": condition.engine,
            "friction_law": condition.law,
            "friction_level": condition.level,
        }
        | {"seed": seed, "command": command, "speed_ratio": ratio + SPREAD[seed], "crossed": None}
        | columns
        for command, ratio in speeds
        for seed in seeds
    ]


def judged(judge: criteria.Judge, *parts: list[Row]) -> Finding:
    """Judge rows."""
    return judge(Evidence.of(row for part in parts for row in part))


PHYSX, ODE = Condition("physx", 0.0), Condition("ode-webots", 0.0)
JITTERS_ELSEWHERE = elsewhere("deception", criteria.jitters("none", *DIRECTIONS))
REAL = [Condition(VIRTUAL_ROBOT, level, "real") for level in (0.1, 0.2)]


def test_the_slower_direction_is_that_of_each_seed() -> None:
    """The mean of two directions would hide a robot that walks one method only."""
    evidence = Evidence.of(rows("none", PHYSX, 0.9, 0.5))
    assert list(evidence.slower("none", PHYSX).seeds.values()) == pytest.approx([0.49, 0.50, 0.51])
    assert list(evidence.faster("none", PHYSX).seeds.values()) == pytest.approx([0.89, 0.90, 0.91])
    assert evidence.error("none", PHYSX).seeds[1] == pytest.approx((0.1 + 0.5) / 2)


def test_all_other_engines_must_agree() -> None:
    """An Actuator Net that fails in one engine and walks in the other did not fail elsewhere."""
    fails = elsewhere("actuator", criteria.fails)
    assert judged(fails, rows("actuator", PHYSX, 0.0), rows("actuator", ODE, 0.05)).outcome == "reproduces"
    finding = judged(fails, rows("actuator", PHYSX, 0.0), rows("actuator", ODE, 0.9))
    assert finding.outcome == "does not"
    assert "ode-webots: actuator, slower direction 0.90" in finding.evidence


def test_who_is_best_without_friction() -> None:
    """None at 0.98 is nearer than deception at 1.3 and actuator at 0.5; deception at 0.99 would be nearer."""
    none, actuator = rows("none", PHYSX, 0.95), rows(BEHIND_GEAR, PHYSX, 0.5)
    (e1,) = (claim for claim in CLAIMS if claim.id == "E1")
    best = e1.judge
    assert judged(best, none, actuator, rows("deception", PHYSX, 1.3)).outcome == "reproduces"
    assert judged(best, none, actuator, rows("deception", PHYSX, 0.99)).outcome == "does not"


def test_jitter_is_a_multiple() -> None:
    """160 is above 1.5 times 100, 140 is not."""
    none = rows("none", PHYSX, 1.0, joint_jitter=100.0)
    for jitter, outcome in ((160.0, "reproduces"), (140.0, "does not")):
        deception = rows("deception", PHYSX, 1.0, joint_jitter=jitter)
        assert judged(JITTERS_ELSEWHERE, none, deception).outcome == outcome


def test_the_virtual_robot_is_judged_level_by_level() -> None:
    """A policy that walks at 10 % and stands at 20 % walks at some levels: the sentence says none."""
    walks = on_robot("none", criteria.walks("vx=-0.5"))
    low, high = REAL
    assert judged(walks, rows("none", low, 0.9), rows("none", high, 0.8)).outcome == "reproduces"
    assert judged(walks, rows("none", low, 0.9), rows("none", high, 0.1)).outcome == "only up to x"
    stationary = on_robot("none", criteria.stationary)
    assert judged(stationary, rows("none", low, 0.9), rows("none", high, 0.1)).outcome == "only above x"
    assert judged(walks).outcome == "not tested"


def test_one_seed_that_does_not_follow_refutes_that_a_way_follows() -> None:
    """The mean of three is within the band; one is over it, or falls, or is slow in one direction: that is named."""
    follows = criteria.follows_on_robot("none+forward")
    finding = judged(follows, *(rows("none+forward", condition, 1.0) for condition in REAL))
    assert finding.outcome == "reproduces" and "3 of 3 seeds follow" in finding.evidence
    fast = judged(follows, *(rows("none+forward", condition, 1.195) for condition in REAL))
    assert fast.outcome == "does not" and "2 of 3 seeds follow, 1 too fast" in fast.evidence
    slow = judged(follows, *(rows("none+forward", condition, 1.0, 0.801) for condition in REAL))
    assert slow.outcome == "does not" and "2 of 3 seeds follow, 1 too slow" in slow.evidence
    fell = judged(follows, *(rows("none+forward", condition, 1.0, fall_rate=0.1) for condition in REAL))
    assert fell.outcome == "does not" and "0 of 3 seeds follow, 3 fell" in fell.evidence
    assert (
        judged(follows, *(rows("none+forward", condition, 1.3, seeds=(1,)) for condition in REAL)).outcome
        == "not tested"
    )


def test_friction_is_the_cause_where_it_costs_more_than_the_rest() -> None:
    """From 1.0: friction leaves 0.5, all else 0.9."""
    nominal, rest = rows("none", Condition("physx+nominal", 0.0), 1.0), rows("none", Condition("physx+rest", 0.0), 0.9)
    friction = Condition("physx+friction", 0.2, "real")
    cause = criteria.friction_is_the_cause
    assert judged(cause, nominal, rest, rows("none", friction, 0.5)).outcome == "reproduces"
    assert judged(cause, nominal, rest, rows("none", friction, 0.98)).outcome == "does not"


def test_stairs_elsewhere_are_those_of_every_other_engine() -> None:
    """Nine of ten in PhysX and none in ODE is no navigation of stairs; an engine without walks is not judged."""

    def crossings(condition: Condition, share: float) -> list[Row]:
        return rows("deception", condition, 0.8, terrain="stairs=0.1", crossed=share, command="vx=0.4")

    climbs = criteria.climbs_elsewhere("deception")
    for ode, outcome in ((1.0, "reproduces"), (0.0, "does not")):
        assert judged(climbs, crossings(PHYSX, 1.0), crossings(ODE, ode)).outcome == outcome
    assert judged(climbs, crossings(PHYSX, 1.0)).outcome == "not tested"


def test_the_bench_is_not_felt_and_a_share_of_the_load_is() -> None:
    """Both halves of the explanation must hold."""
    bench = rows("none", Condition(VIRTUAL_ROBOT, 0.0107, "real-bench"), 1.0)
    loaded = Condition(VIRTUAL_ROBOT, 0.0107, "real-bench+load0.1")
    assert judged(criteria.load_above_bench, bench, rows("none", loaded, 0.3)).outcome == "reproduces"
    assert judged(criteria.load_above_bench, bench, rows("none", loaded, 1.0)).outcome == "does not"


def test_nothing_walked_is_nothing_judged() -> None:
    """Every sentence must say so, and none must break."""
    verdicts, read = judge_all(Evidence.of([]))
    assert [verdict.id for verdict in verdicts] == [claim.id for claim in CLAIMS]
    assert len({claim.id for claim in CLAIMS}) == len(CLAIMS)
    assert {verdict.outcome for verdict in verdicts} == {"not tested"}
    assert read == []


def test_a_share_ends_at_one_and_its_interval_does_not() -> None:
    """Crossings of 1, 0.95 and 1 have a t-interval up to 1.05: undecided, and so would no falls at all be."""
    climbs = criteria.under("deception", PHYSX, criteria.climbs)
    crossings = [
        row | {"crossed": share}
        for seed, share in enumerate((1.0, 0.95, 1.0))
        for row in rows("deception", PHYSX, 0.8, seeds=(seed,), terrain="stairs=0.1", command="vx=0.4")
    ]
    assert judged(climbs, crossings).outcome == "reproduces"
    falls = [
        row | {"fall_rate": share}
        for condition in REAL
        for seed, share in enumerate((0.9, 1.0, 0.95))
        for row in rows("none", condition, 0.5, seeds=(seed,))
    ]
    assert judged(on_robot("none", criteria.falls("vx=0.5")), falls).outcome == "reproduces"


def test_the_same_policies_are_compared_one_by_one() -> None:
    """Seeds differ by 0.2, levels by 0.1 in each of them: only in pairs is that more than chance."""
    apart = (0.0, 0.1, 0.2)

    def at(level: float, deviation: float) -> list[Row]:
        condition = Condition(VIRTUAL_ROBOT, level, "real")
        return [
            row | {"speed_ratio": 1.0 - deviation - apart[seed]}
            for seed in SEEDS
            for row in rows("none", condition, 0.0, seeds=(seed,))
        ]

    assert judged(criteria.lower_is_better, at(0.1, 0.2), at(0.2, 0.3)).outcome == "reproduces"


def test_who_falls_over_does_not_stand() -> None:
    """A robot that lies has no speed."""
    stands_badly = on_robot("iterative", criteria.stands_badly)
    still = [
        rows("iterative", condition, 1.0, command="stand", tracking_error=0.0, fall_rate=1.0) for condition in REAL
    ]
    assert judged(stands_badly, *still).outcome == "reproduces"
    still = [rows("iterative", condition, 1.0, command="stand", tracking_error=0.01) for condition in REAL]
    assert judged(stands_badly, *still).outcome == "does not"


def walked_by(method: str, condition: Condition, rate: float, episodes: int, robots: int = 0) -> list[Row]:
    """Return rows in which every seed has the same share of falls, in each direction."""
    robot_rates = {"robots": {str(1000 + robot): 1.0 for robot in range(robots)}} if robots else {}
    return rows(method, condition, 1.0, fall_rate=rate, episodes=episodes, **robot_rates)


def test_walks_of_one_virtual_robot_are_one_trial() -> None:
    """Three policies on four robots are 12 trials, however often each walks: up to 0.24 may fall; four robots."""
    parts = [walked_by("deception", condition, 0.0, 400, robots=4) for condition in REAL]
    rate = Evidence.of(row for part in parts for row in part).rate("deception", REAL[0], ("vx=0.5",), "fall_rate")
    assert (rate.trials, rate.successes, rate.robots) == (12, 0.0, 4)
    assert rate.interval == (pytest.approx(0.0, abs=1e-9), pytest.approx(0.2425, abs=1e-4))
    both = Evidence.of(parts[0]).rate("deception", REAL[0], ("vx=0.5", "vx=-0.5"), "fall_rate")
    assert both.trials == 12
    assert judged(criteria.follows_on_robot("deception"), *parts).outcome == "undecided"


def test_falls_alone_are_abnormal_and_a_failure() -> None:
    """An Actuator Net that runs as fast as it should, smoothly, and falls over has failed."""
    none = [rows("none", condition, 1.0) for condition in (PHYSX, ODE)]
    upright, falling = (
        [rows("actuator", condition, 1.0, fall_rate=rate) for condition in (PHYSX, ODE)] for rate in (0.0, 0.9)
    )
    for judge in (elsewhere("actuator", criteria.unsteady("none", *DIRECTIONS)), elsewhere("actuator", criteria.fails)):
        assert judged(judge, *none, *falling).outcome == "reproduces"
        assert judged(judge, *none, *upright).outcome == "does not"


def test_unsteady_is_jitter_or_falls() -> None:
    """Twice the accelerations of deception are unsteady, and so are falls; neither is not."""
    judge = on_robot("actuator", criteria.unsteady("deception", "vx=0.5"))
    calm = [rows("deception", condition, 1.0) for condition in REAL]
    for columns, outcome in (
        ({"joint_jitter": 100.0}, "reproduces"),
        ({"fall_rate": 0.45}, "reproduces"),
        ({}, "does not"),
    ):
        parts = [rows("actuator", condition, 0.8, **columns) for condition in REAL]
        assert judged(judge, *calm, *parts).outcome == outcome


def test_where_friction_would_have_shown_is_said_level_by_level() -> None:
    """1.0 without, 0.97 at 1 %, 0.5 at 20 %: it shows above 1 %, and in no other engine's rows."""
    webots = criteria.loses_at_each_level("none", "ode-webots")
    parts = [
        rows("none", Condition("ode-webots", level), ratio) for level, ratio in ((0.0, 1.0), (0.01, 0.97), (0.2, 0.5))
    ]
    finding = judged(webots, *parts)
    assert (finding.outcome, finding.evidence[:8]) == ("only above x", "x = 0.01")
    assert judged(webots, rows("none", PHYSX, 1.0)).outcome == "not tested"


def test_the_rows_behind_a_verdict_are_named() -> None:
    """A reader who takes them from the file must come to the same number."""
    evidence = Evidence.of(
        row for part in (rows("none", PHYSX, 1.0), rows(BEHIND_GEAR, PHYSX, 0.0, -0.1)) for row in part
    )
    _, read = judge_all(evidence)
    own = [row for row in read if row.claim == "E2b"]
    assert {(row.method, row.engine, row.command, row.column) for row in own} == {
        (BEHIND_GEAR, "physx", command, column)
        for command in ("vx=0.5", "vx=-0.5")
        for column in ("speed_ratio", "fall_rate")
    }
    backward = next(row for row in own if (row.command, row.column) == ("vx=-0.5", "speed_ratio"))
    assert (backward.seeds, backward.each) == ("0 1 2", "-0.11 -0.1 -0.09")
    assert not [row for row in read if row.claim == "X1"]


def test_who_falls_is_not_stationary() -> None:
    """After a fall the speed counts as zero: a policy that falls in every walk would remain stationary."""
    for rate, outcome in ((0.0, "reproduces"), (0.95, "does not"), (0.5, "undecided")):
        falling = [rows("direct", condition, 0.0, fall_rate=rate) for condition in REAL]
        assert judged(on_robot("direct", criteria.stationary), *falling).outcome == outcome
        frozen = rows("none", Condition("mujoco", 0.442, "load"), 0.0, fall_rate=rate)
        assert judged(criteria.frozen_by("load"), frozen).outcome == outcome


def test_jitter_is_compared_while_both_walk() -> None:
    """A robot that lies has no jitter and one that stands hardly any: any walk would be a multiple of it."""
    for lame in ({"fall_rate": 1.0, "joint_jitter": 0.0}, {"joint_jitter": 2.0}):
        none = rows("none", PHYSX, 0.05, **lame)
        finding = judged(JITTERS_ELSEWHERE, none, rows("deception", PHYSX, 1.0))
        assert (finding.outcome, "none stands or falls with seed 0 1 2" in finding.evidence) == ("not tested", True)
        finding = judged(JITTERS_ELSEWHERE, rows("none", PHYSX, 1.0), rows("deception", PHYSX, 0.05, **lame))
        assert finding.outcome == "not tested"


def on_robots(method: str, condition: Condition, *ratios: float, less: float = 0.0) -> list[Row]:
    """Return rows in which three seeds have the same speed ratios on robots; backward is slower by `less`."""
    cells = rows(method, condition, float(np.mean(ratios)), float(np.mean(ratios)) - less)
    for row in cells:
        own = less if row["command"] == "vx=-0.5" else 0.0
        row["robots"] = {str(1000 + number): ratio - own for number, ratio in enumerate(ratios)}
    return cells


def test_ways_are_compared_on_the_robots_on_which_both_walked() -> None:
    """Friction is not fed forward on the two sticky robots: 0.9 against 0.95 on the other three, not 0.69 on five."""
    better, condition = criteria.nearer_on_robot("deception", "none+forward"), REAL[0]
    fed = on_robots("none+forward", condition, 0.9, 0.91, 0.89)
    for three, outcome in (((0.95, 0.96, 0.94), "reproduces"), ((0.85, 0.86, 0.84), "does not")):
        finding = judged(better, fed, on_robots("deception", condition, *three, 0.3, 0.3))
        assert finding.outcome == outcome
        assert "at 0.1 (real) robots counted: 3, left out: 2" in finding.evidence
    assert "none+forward 0.10 " in finding.evidence and "deception 0.15 " in finding.evidence
    _, read = judge_all(
        Evidence.of([*fed, *on_robots("deception", condition, 0.95, 0.96, 0.94, 0.3, 0.3)]),
        [claim for claim in CLAIMS if claim.id == "X9"],
    )
    each = {(row.method, row.command): row.each for row in read}
    assert each["deception", "vx=0.5"] == "0.05 0.05 0.05"


def test_robots_on_which_nothing_was_fed_forward_are_counted() -> None:
    """A policy that walks on eight robots of ten, the easy ones, would read as one that walks on all."""
    eight = 4 * (0.91, 0.89)
    fed, none = on_robots("none+forward", REAL[0], *eight), on_robots("none", REAL[0], *eight, 0.3, 0.3)
    finding = judged(criteria.follows_on_robot("none+forward"), fed, none)
    assert finding.outcome == "reproduces"
    assert finding.evidence.endswith("; at 0.1 (real) robots counted: 8, left out: 2")
    assert "left out" not in judged(criteria.follows_on_robot("none+forward"), fed).evidence


BENCH, LOADED = (Condition(VIRTUAL_ROBOT, 0.0107, f"real-bench{load}") for load in ("", "+load0.1"))


def test_the_bench_and_its_load_are_frictions_of_the_robot() -> None:
    """A policy that walks at 10 and 20 % and not with a share of the load does not walk at each level."""
    walks = on_robot("none", criteria.walks("vx=0.5"))
    real = [rows("none", condition, 0.9) for condition in REAL]
    finding = judged(walks, *real, rows("none", BENCH, 0.95), rows("none", LOADED, 0.9))
    assert finding.outcome == "reproduces"
    assert "at the bench's value, 0.0107: reproduces, none, vx=0.5 0.95" in finding.evidence
    assert "load beside the bench's value: reproduces, at 0.1" in finding.evidence
    assert judged(walks, *real, rows("none", LOADED, 0.1)).outcome == "undecided"
    assert judged(walks, *real, rows("none", BENCH, 0.1)).outcome == "only above x"
    assert judged(walks, rows("none", BENCH, 0.95)).outcome == "reproduces"


def test_levels_at_which_a_way_was_not_walked_are_named() -> None:
    """A sentence that holds at one level of three would read as one that holds at each."""
    others = [rows("direct", condition, 0.9) for condition in (*REAL, BENCH, LOADED)]
    finding = judged(on_robot("none", criteria.walks("vx=0.5")), rows("none", REAL[1], 0.9), *others)
    assert finding.outcome == "reproduces"
    assert "judged at 0.2 alone, not tested at 0.0107, 0.1" in finding.evidence
    assert "load beside the bench's value: not tested, at 0.1: none, vx=0.5 not evaluated" in finding.evidence


def test_a_limit_on_one_axis_is_one_of_the_sentence() -> None:
    """It holds above 10 % of the torque limit, and at each share of the load; two limits of two kinds contradict."""
    above, up_to, holds, fails = (
        Finding(outcome, "") for outcome in ("only above x", "only up to x", "reproduces", "does not")
    )
    for findings, outcome in (
        ((above, holds), "only above x"),
        ((above, above), "only above x"),
        ((fails, fails), "does not"),
        ((above, holds, fails), "undecided"),
        ((above, up_to), "undecided"),
        ((holds, Finding("undecided", "")), "undecided"),
        ((holds, Finding("not tested", "")), "reproduces"),
    ):
        assert together_over_axes(findings).outcome == outcome
