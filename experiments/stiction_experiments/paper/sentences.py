"""The sentences of the paper, each with its question, by the numbers of `results/paper/criteria.md`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import fmean
from typing import Literal

from stiction.files.following import COMMAND_SET
from stiction.files.results import FOLLOWS
from stiction.files.velocity import STAND
from stiction_experiments.paper import rows as of
from stiction_experiments.paper.configurations import votes
from stiction_experiments.paper.decide import Seeds, Test
from stiction_experiments.paper.estimator import MODELLED, PARAMETERS, SAMPLED
from stiction_experiments.paper.plan import LOADS, RANGE_ENDS, ROBOT_LEVELS, SEALED, UNSEALED, VIRTUAL, own_robot
from stiction_experiments.paper.results import HALF, Results, Value

Family = Literal["S", "R", "T", "J", "G", "N"]
"""Family of Holm's correction: Sim2Sim, robot, training, joints, gait, net."""

FOLLOWED, SHARES = FOLLOWS[0], ROBOT_LEVELS
ROBOTS, ENDS, UNDER_LOAD = (tuple(f"{kind}-{n}" for n in VIRTUAL) for kind in ("robot", "ends", "loaded"))
FAST = tuple(label for label in COMMAND_SET if label not in ("vx=0.2", "vx=-0.2", STAND))
"""Commands of the worst reach, as of the onset: those fast enough that a ratio means something."""

FORWARD, BACKWARD = ("vx=0.2", "vx=0.5", "vx=0.8"), ("vx=-0.2", "vx=-0.5", "vx=-0.8")


@dataclass(frozen=True)
class Sentence:
    """One sentence."""

    number: str
    text: str
    """As in the paper, shortened."""
    family: Family
    asked: str
    """Question that decides it."""
    tests: Callable[[Results], Sequence[Test]] | None = None
    """Its conditions; None: it was decided elsewhere, or cannot be."""
    fixed: str = "not testable"
    """Outcome of a sentence without tests."""
    why: str = ""
    """Reason of that."""


def percent(friction: str) -> str:
    """Return a friction as people read it: `20 %`, `bench`, `bench and 0.02 of the load`."""
    if friction.startswith("bench"):
        return friction.replace("+", " and ") + " of the load" * ("+" in friction)
    return f"{100 * float(friction):g} %"


def _each(frictions: Sequence[str], test: Callable[[str], Test]) -> list[Test]:
    return [test(friction) for friction in frictions]


def _two(
    label: str, values: Iterable[Seeds], kind: Literal["larger", "noticeable"] = "larger", about: str = ""
) -> Test:
    """Return the test that the first of two trainings' values are larger, or noticeably so."""
    first, second = values
    return Test(label, first, second, kind, about=about)


def _compare(
    r: Results, value: Value, first: str, second: str, place: str | Sequence[str], friction: str, *commands: str
) -> Test:
    """Return the test that one training's value is larger than another's in one place."""
    values = (r.at(value, training, place, friction, *commands) for training in (first, second))
    return _two(percent(friction), values, about=f"{first}, {second}")


def _alone(
    r: Results, value: Value, training: str, place: str | Sequence[str], friction: str, bound: float,
    *commands: str, below: bool = False, label: str = "",
) -> Test:  # fmt: skip
    """Return the test that every seed of a training is above a bound, or below it."""
    values = r.at(value, training, place, friction, *commands)
    return Test(label or percent(friction), values, kind="below" if below else "above", bound=bound, about=training)


def _on_robots(r: Results, value: Value, training: str, friction: str, own: bool, *commands: str) -> Seeds:
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


def _stands(r: Results, *trainings: tuple[str, str, str]) -> list[Test]:
    """Return the tests that trainings stand still in a place, at a friction, when told 0.5 m/s either way.

    Of those with a like that never meets friction, that this one walks.
    """
    tests = []
    for name, place, friction in trainings:
        test = _alone(r, of.planar_speed, name, place, friction, STANDS, *WAYS, below=True, label=name)
        if like := LIKE.get(name):
            test = replace(test, like=r.at(of.planar_speed, like, "mujoco", "0", *WAYS), about=f"{name}, {like}")
        tests.append(test)
    return tests


def _overall(r: Results, training: str, friction: str) -> Seeds:
    """Return seed -> share followed, the mean over two engines and all robots."""
    own = "0.01" if friction == "bench" else friction
    each = [r.at(of.share_followed, training, place, own) for place in ("physx", "webots")]
    each += [r.at(of.share_followed, training, place, friction) for place in ROBOTS]
    return {seed: fmean(seeds[seed] for seeds in each) for seed in set.intersection(*map(set, each))}


def _less(first: Seeds, second: Seeds) -> Seeds:
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

SENTENCES: tuple[Sentence, ...] = (
    Sentence(
        *("1", "conventional randomisation underperforms on the robot", "R"),
        "`none` follows more commands in MuJoCo than on robots",
        lambda r: [
            Test(
                percent(friction),
                r.at(of.share_followed, "none", *there),
                r.at(of.share_followed, "none", places, friction),
                about="none in MuJoCo, on robots",
            )
            for friction, there, places in (
                *((share, ("mujoco", "0.01" if share == "bench" else share), ROBOTS) for share in SHARES),
                *((load, ("mujoco-load", load.removeprefix("bench+")), UNDER_LOAD) for load in LOADS),
            )
        ],
    ),
    Sentence(
        *("2", "it walks backward on the robot", "R"),
        "`none`: worst reach backward 0.8 or more, every seed",
        lambda r: _each(SHARES, lambda f: _alone(r, of.worst_reach, "none", ROBOTS, f, FOLLOWED, *BACKWARD)),
    ),
    Sentence(
        *("3", "walking forward it falls", "R"),
        "`none` falls in a walk forward, every seed",
        lambda r: _each(SHARES, lambda f: _alone(r, of.fall_rate, "none", ROBOTS, f, 1e-9, *FORWARD)),
    ),
    Sentence(
        *("4", "with an Actuator Net it walks forward", "R"),
        "`net`: worst reach forward 0.8 or more at 20 %, every seed",
        lambda r: [
            Test(label, values, kind="above", bound=FOLLOWED, about="net")
            for label, values in (
                ("the robot of its log", _on_robots(r, of.worst_reach, "net", "0.2", True, *FORWARD)),
                ("others", _on_robots(r, of.worst_reach, "net", "0.2", False, *FORWARD)),
            )
        ],
    ),
    Sentence(
        *("5", "unsteadily", "R"),
        "jitter of `net` over that of `deception`, at 20 %",
        lambda r: [_compare(r, of.chatter, "net", "deception", ROBOTS, "0.2", "vx=0.5")],
    ),
    Sentence(
        *("6", "and fails on stairs", "R"),
        "`stairs-deception` crosses more often than `stairs-net`",
        lambda r: [
            _two(
                f"{100 * height:g} cm ({percent(f)})",
                (r.crossed(f"stairs-{name}", "robots", f, height) for name in ("deception", "net")),
            )
            for height in (0.08, 0.12)
            for f in STAIRS_FRICTION
        ],
    ),
    Sentence(
        *("7", "because its data are of backward walking", "N"),
        "`net-all` reaches more forward than `net`, on the own robot",
        lambda r: [
            _two("20 %", (_on_robots(r, of.worst_reach, name, "0.2", True, *FORWARD) for name in ("net-all", "net")))
        ],
    ),
    Sentence(
        *("8", "because its data are of one robot", "N"),
        "`net-three` follows more than `net` on a robot of neither log",
        lambda r: [_compare(r, of.share_followed, "net-three", "net", "robot-3003", "0.2")],
    ),
    Sentence(
        *("9", "the loop lengthens training", "N"),
        "processor time of log, net and training, `net` over `deception-1`",
        lambda r: [_two("time", (r.of_curve(name, "seconds") for name in ("net", "deception-1")))],
    ),
    Sentence("10", "k_d and B act as one", "J", "", fixed="holds", why="decided on its own page, results/damping"),
    Sentence(
        *("11", "static friction is usually not randomised", "J"),
        "share of public configurations of legged locomotion that randomise joint friction, under one half",
        lambda r: [
            Test(label, votes(r.configurations, then), kind="share", bound=0.5)
            for label, then in (("all", False), ("in 2024", True))
        ],
    ),
    Sentence(
        *("12", "min MSE(reference − measured) identifies I, B, b", "J"),
        "relative error at most 0.2, every draw of a motor",
        lambda r: [
            Test(f"{name} ({reading})", r.errors(reading, name), kind="below", bound=0.2)
            for reading in (SAMPLED, MODELLED)
            for name in PARAMETERS
        ],
    ),
    Sentence(
        *("13", "0.98 % of the torque limit against 0.13 %", "J", ""),
        why="a measurement of two machines; what a bench says of simulated joints is in results/identification",
    ),
    Sentence(
        *("14", "0.98 % has a noticeable impact", "J"),
        "`none` without friction over itself with 0.98 %, or with some of the load: worst reach, share followed",
        lambda r: [
            _two(
                f"{label} ({text})",
                (r.at(value, name, *there, *commands) for there in (("mujoco", "0"), (place, f))),
                "noticeable",
            )
            for label, name, place, f in JOINTS
            for text, value, commands in (("reach", of.worst_reach, FAST), ("share", of.share_followed, ()))
        ],
    ),
    Sentence(
        *("15", "trained directly with friction it stays stationary", "T"),
        "under 0.05 m/s at its own friction when told 0.5 m/s, every seed; its like without friction is not",
        lambda r: _stands(r, *OWN_FRICTION),
    ),
    Sentence(
        *("16", "and fails to train", "T"),
        "worst reach at its own friction under 0.5, every seed",
        lambda r: [_alone(r, of.worst_reach, *at, 0.5, *FAST, below=True, label=at[0]) for at in OWN_FRICTION],
    ),
    Sentence(
        *("17", "compensated in the action it stays stationary", "T"),
        "as 15",
        lambda r: _stands(r, ("compensated", "mujoco", "0.2")),
    ),
    Sentence(
        *("18", "friction filters early actions", "T"),
        "weak exploration delays half of the speed forward by more iterations with friction than without",
        lambda r: [
            _two(
                "iterations",
                (_less(r.of_curve(f"{n}-weak", "reached"), r.of_curve(n, "reached")) for n in ("direct", "none")),
            )
        ],
    ),
    Sentence(
        *("19", "fine-tuning fails", "T"),
        "`fine-tuned`: worst reach at 20 % under 0.5, every seed",
        lambda r: [_alone(r, of.worst_reach, "fine-tuned", "mujoco", "0.2", 0.5, *FAST, below=True)],
    ),
    Sentence(
        *("20", "because of local optima", "T"),
        "at half the gain, best reach at 20 % where that friction begins at 40 % of the training, over from the start",
        lambda r: [_compare(r, of.best_reach, "direct-half-later", "direct-half", "mujoco", "0.2", *WAYS)],
    ),
    Sentence(
        *("21", "the iterative way jitters on the robot", "R"),
        "jitter, `iterative` over `deception`, at 20 %",
        lambda r: [_compare(r, of.chatter, "iterative", "deception", ROBOTS[:2], "0.2", "vx=0.5")],
    ),
    Sentence(
        *("22", "and hardly stands", "R"),
        "over 0.05 m/s, or a fall, while told to stand at 20 %, every seed",
        lambda r: [_alone(r, of.planar_speed, "iterative", ROBOTS[:2], "0.2", STANDS, "stand")],
    ),
    Sentence(
        *("23", "the wide range works", "R"),
        "`deception` follows every command, every seed",
        lambda r: [
            _alone(r, of.share_followed, "deception", places, f, 1.0)
            for f, places in (*((share, ROBOTS) for share in SHARES), *((end, ENDS) for end in RANGE_ENDS))
        ],
    ),
    Sentence(
        *("24", "because easy robots occur", "T"),
        "worst reach at 20 % over that of `direct`",
        lambda r: [
            _two(name, (r.at(of.worst_reach, n, "mujoco", "0.2", *FAST) for n in (name, "direct")))
            for name in ("deception", "mean-kept")
        ],
    ),
    Sentence(
        *("25", "the wide range makes learning easier", "T"),
        "area of the learning curve, `direct` over `deception`",
        lambda r: [_two("area", (r.of_curve(name, "area") for name in ("direct", "deception")))],
    ),
    Sentence(
        *("26", "friction makes training harder", "T"),
        "area of the learning curve, `direct` over `none`",
        lambda r: [_two("area", (r.of_curve(name, "area") for name in ("direct", "none")))],
    ),
    Sentence(
        *("27", "the wide range is robust to wear", "R"),
        "share of a life followed, friction growing, `deception` over `none`",
        lambda r: [
            _two(label, (r.life(training, name) for training in ("deception", "none")))
            for label, name in (("5 to 30 %", "followed"), ("24 to 30 %", "beyond"))
        ],
    ),
    Sentence(
        *("28", "Sim2Sim is best without friction", "S"),
        "deviation in Webots' ODE of each other training over that of `none`",
        lambda r: [
            _two(f"{name}, {percent(f)}", (r.at(of.deviation, n, "webots", f) for n in (name, "none")))
            for name in ("direct", "deception", "net")
            for f in ("0", "0.01")
        ],
    ),
    Sentence(
        *("29a", "the Actuator Net is abnormal in Sim2Sim", "S"),
        "`none` follows more than `net`",
        lambda r: _each(("0", "0.01"), lambda f: _compare(r, of.share_followed, "none", "net", "webots", f)),
    ),
    Sentence(
        *("29b", "and ends in system failure", "S"),
        "worst reach of `net` under 0.2, or it falls, every seed",
        lambda r: _each(("0", "0.01"), lambda f: _alone(r, of.worst_reach, "net", "webots", f, 0.2, *FAST, below=True)),
    ),
    Sentence(
        *("30a", "trained with friction it jitters in Sim2Sim", "S"),
        "jitter, `deception` over `none`",
        lambda r: _each(("0", "0.01"), lambda f: _compare(r, of.chatter, "deception", "none", "webots", f, "vx=0.5")),
    ),
    Sentence(
        *("30b", "and jumps", "S"),
        "share of moving control steps in the air, `deception` over `none`",
        lambda r: [
            replace(_compare(r, of.flight, "deception", "none", "webots", f, "vx=0.5"), kind="noticeable")
            for f in ("0", "0.01")
        ],
    ),
    Sentence(
        *("31", "but climbs stairs in Sim2Sim", "S"),
        "`stairs-deception` crosses 8 cm in 8 of 10 walks, every seed",
        lambda r: [Test("8 cm", r.crossed("stairs-deception", "webots", "0", 0.08), kind="above", bound=0.8)],
    ),
    Sentence(
        "32",
        "RMA adapts to the friction level",
        "T",
        "",
        fixed="holds: in two phases",
        why="on its own page, results/adaptation",
    ),
    Sentence(
        *("33", "with friction it is stable on flat ground", "R"),
        "`deception` follows every command and never falls, every seed",
        lambda r: _each(("bench", "0.1"), lambda f: _alone(r, of.share_followed, "deception", ROBOTS, f, 1.0)),
    ),
    Sentence(
        *("34", "and on stairs", "R"),
        "`stairs-deception` crosses 8 cm in 8 of 10 walks, every seed",
        lambda r: _each(
            STAIRS_FRICTION,
            lambda f: Test(percent(f), r.crossed("stairs-deception", "robots", f, 0.08), kind="above", bound=0.8),
        ),
    ),
    Sentence(
        *("35", "training with friction improves Sim2Real", "R"),
        "on robots `deception` follows more than `none`, and `none` deviates more than `deception`",
        lambda r: [
            *_each(SHARES, lambda f: _compare(r, of.share_followed, "deception", "none", ROBOTS, f)),
            *(
                replace(test, label=f"{test.label} (deviation)")
                for test in _each(SHARES, lambda f: _compare(r, of.deviation, "none", "deception", ROBOTS, f))
            ),
        ],
    ),
    Sentence(
        *("36", "with a slight sacrifice in Sim2Sim", "S"),
        "deviation of `deception` over that of `none`, and by less than 0.2, every seed",
        lambda r: [
            replace(_compare(r, of.deviation, "deception", "none", "webots", "0"), label="a sacrifice"),
            Test(
                "slight",
                _less(*(r.at(of.deviation, name, "webots", "0") for name in ("deception", "none"))),
                kind="below",
                bound=0.2,
            ),
        ],
    ),
    Sentence(
        *("37", "friction is the primary cause", "R"),
        "`none` follows less with the robot's friction alone than with all else alone",
        lambda r: _each(
            ("bench", "0.1", "0.2"),
            lambda f: Test(
                percent(f),
                r.at(of.share_followed, "none", [f"but-friction-{n}" for n in VIRTUAL], "0"),
                r.at(of.share_followed, "none", [f"friction-{n}" for n in VIRTUAL], f),
            ),
        ),
    ),
    Sentence(
        *("38", "only with friction in training it is satisfactory", "R"),
        "`deception` follows noticeably more than `none` fed forward",
        lambda r: [
            replace(_compare(r, of.share_followed, "deception", "none+measured", ROBOTS, f), kind="noticeable")
            for f in SHARES
        ],
    ),
    Sentence(
        *("39", "better overall", "R"),
        "share followed, mean over two engines and four robots, `deception` over each other",
        lambda r: [
            _two(f"{percent(f)} ({name})", (_overall(r, training, f) for training in ("deception", name)))
            for name in ("none", "net")
            for f in SHARES
        ],
    ),
    Sentence(
        *("40", "quadrupeds trot by themselves", "G"),
        "each diagonal is in phase in 80 % of steps, and under half of touch-downs are of all feet, every seed",
        lambda r: [Test(name, r.trot(name), kind="above", bound=0.8) for name in ("go1-plain", "go2-plain")],
    ),
    Sentence(
        *("41", "the hexapod pronks with the same reward", "G"),
        "all legs touch down within a tenth of a period in half of the touch-downs, every seed",
        lambda r: [Test("plain", r.pronk("plain"), kind="above", bound=HALF)],
    ),
    Sentence(
        *("42", "r_trot prevents it", "G"),
        "share of tripod steps, `plain` with r_trot over `plain`",
        lambda r: [_two("steps", (r.gait(name, "diagonal") for name in ("plain-trot", "plain")))],
    ),
    Sentence(
        *("43", "r_unsync prevents hopping on three legs", "G"),
        "unequal use of both groups, `no-unsync` over `none`",
        lambda r: [_two("use", (r.gait(name, "imbalance") for name in ("no-unsync", "none")))],
    ),
    Sentence(
        *("44", "less friction in the joints helps", "J"),
        "worst reach of `none` with less friction over that with more",
        lambda r: [
            _two(
                f"{percent(less)}, {percent(more)}",
                (r.at(of.worst_reach, "none", *at, *FAST) for at in pair),
                "noticeable",
            )
            for less, more, pair in (
                (UNSEALED, SEALED, (("mujoco-fine", UNSEALED), ("mujoco-fine", SEALED))),
                ("0.03", "0.1", (("mujoco-fine", "0.03"), ("mujoco", "0.1"))),
            )
        ],
    ),
    Sentence(
        *("45", "a hexapod's tripod is steadier than a quadruped", "G"),
        "roll and pitch of Go1 and Go2 over those of Saturn Lite, with its rewards and with theirs",
        lambda r: [
            _two(f"{name}, {own}", (r.gait(n, "sway") for n in (name, own)))
            for name in ("go1-plain", "go2-plain")
            for own in ("none", "plain")
        ],
    ),
)
"""Sentences decided by walks, curves, stairs, gaits, lives, estimators and public configurations."""


def by_family(results: Results) -> Mapping[Family, list[tuple[Sentence, list[Test]]]]:
    """Return the sentences with their tests, by family."""
    families: dict[Family, list[tuple[Sentence, list[Test]]]] = {}
    for sentence in SENTENCES:
        tests = [] if sentence.tests is None else list(sentence.tests(results))
        families.setdefault(sentence.family, []).append((sentence, tests))
    return families
