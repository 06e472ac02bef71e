"""Questions that sentences are made of: tests of two trainings, and of one, by the values of their seeds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from statistics import fmean
from typing import Literal

from stiction.files.following import COMMAND_SET
from stiction.files.results import FOLLOWS
from stiction.files.velocity import STAND
from stiction_experiments.paper import rows as of
from stiction_experiments.paper.decide import Seeds, Test
from stiction_experiments.paper.plan import ROBOT_LEVELS, SEALED, VIRTUAL, own_robot
from stiction_experiments.paper.results import Results, Value

FOLLOWED, SHARES = FOLLOWS[0], ROBOT_LEVELS
ROBOTS, ENDS, LOADED = (tuple(f"{kind}-{n}" for n in VIRTUAL) for kind in ("robot", "ends", "loaded"))
FAST = tuple(label for label in COMMAND_SET if label not in ("vx=0.2", "vx=-0.2", STAND))
"""Commands of the worst reach, as of the onset: those fast enough that a ratio means something."""

FORWARD, BACKWARD = ("vx=0.2", "vx=0.5", "vx=0.8"), ("vx=-0.2", "vx=-0.5", "vx=-0.8")


def percent(friction: str) -> str:
    """Return a friction as people read it: `20 %`, `bench`, `bench and 0.02 of the load`."""
    if friction.startswith("bench"):
        return friction.replace("+", " and ") + " of the load" * ("+" in friction)
    return f"{100 * float(friction):g} %"


def at_each(frictions: Sequence[str], test: Callable[[str], Test]) -> list[Test]:
    """Return a test for each friction."""
    return [test(friction) for friction in frictions]


def two(label: str, values: Iterable[Seeds], kind: Literal["larger", "noticeable"] = "larger", about: str = "") -> Test:
    """Return the test that the first of two trainings' values are larger, or noticeably so."""
    first, second = values
    return Test(label, first, second, kind, about=about)


def compare(
    r: Results, value: Value, first: str, second: str, place: str | Sequence[str], friction: str, *commands: str
) -> Test:
    """Return the test that one training's value is larger than another's in one place."""
    values = (r.at(value, training, place, friction, *commands) for training in (first, second))
    return two(percent(friction), values, about=f"{first}, {second}")


def alone(
    r: Results, value: Value, training: str, place: str | Sequence[str], friction: str, bound: float,
    *commands: str, below: bool = False, label: str = "",
) -> Test:  # fmt: skip
    """Return the test that every seed of a training is above a bound, or below it."""
    values = r.at(value, training, place, friction, *commands)
    return Test(label or percent(friction), values, kind="below" if below else "above", bound=bound, about=training)


def on_robots(r: Results, value: Value, training: str, friction: str, own: bool, *commands: str) -> Seeds:
    """Return seed -> value on the robot whose walk that seed's net is of, or the mean over the others."""
    each = {number: r.at(value, training, f"robot-{number}", friction, *commands) for number in VIRTUAL}
    seeds = set.intersection(*(set(values) for values in each.values()))
    return {
        seed: fmean(values[seed] for number, values in each.items() if (own_robot(seed) == number) is own)
        for seed in sorted(seeds)
    }


STAIRS_FRICTION = ("bench", "0.2")
"""Friction of the robots that cross stairs."""

STANDS = 0.05
"""Planar speed under which a robot stands, whatever it is told [m/s]."""

WAYS = ("vx=0.5", "vx=-0.5")
"""Commands under which a robot is asked whether it stands."""


def stands(r: Results, *trainings: tuple[str, str, str]) -> list[Test]:
    """Return the tests that trainings stand still in a place, at a friction, when told 0.5 m/s either way.

    Of those with a like that never meets friction, that this one walks.
    """
    tests = []
    for name, place, friction in trainings:
        test = alone(r, of.planar_speed, name, place, friction, STANDS, *WAYS, below=True, label=name)
        if like := LIKE.get(name):
            test = replace(test, like=r.at(of.planar_speed, like, "mujoco", "0", *WAYS), about=f"{name}, {like}")
        tests.append(test)
    return tests


def overall(r: Results, training: str, friction: str) -> Seeds:
    """Return seed -> share followed, the mean over two engines and all robots."""
    own = "0.01" if friction == "bench" else friction
    each = [r.at(of.share_followed, training, place, own) for place in ("physx", "webots")]
    each += [r.at(of.share_followed, training, place, friction) for place in ROBOTS]
    return {seed: fmean(seeds[seed] for seeds in each) for seed in set.intersection(*map(set, each))}


def less(first: Seeds, second: Seeds) -> Seeds:
    """Return the differences of the seeds that both have."""
    return {seed: first[seed] - second[seed] for seed in first if seed in second}


OWN_FRICTION = (
    *(("direct", "mujoco", "0.2"), ("direct-1", "mujoco", "0.01"), ("direct-effort", "mujoco-effort", "0.442")),
    *(("direct-load-5", "mujoco-load", "0.05"), ("direct-load-44", "mujoco-load", "0.442")),
    *((f"direct-{name}", "mujoco", "0.2") for name in ("half", "weak", "sharp")),
)
"""Direct trainings, and the place and friction at which they are asked whether they stand."""

LIKE = {f"direct-{name}": f"none-{name}" for name in ("half", "weak", "sharp")}
"""Direct training -> the same without friction."""

JOINTS = (
    *(
        (f"kp × {kp}", name, "mujoco-fine", SEALED)
        for kp, name in (("0.5", "none-half"), ("1", "none"), ("2", "none-double"))
    ),
    *((f"{c} of the load", "none", "mujoco-load", c) for c in ("0.02", "0.1")),
)
"""Conditions under which friction as small as the paper's may be noticed: label, training, place, friction."""
