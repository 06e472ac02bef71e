"""The sentences of the paper, each with its question, by the numbers of `results/paper/criteria.md`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from stiction_experiments.paper import rows as of
from stiction_experiments.paper.configurations import votes
from stiction_experiments.paper.decide import Test
from stiction_experiments.paper.estimator import MODELLED, PARAMETERS, SAMPLED
from stiction_experiments.paper.plan import LOADS, RANGE_ENDS, SEALED, UNSEALED, VIRTUAL
from stiction_experiments.paper.questions import (
    BACKWARD,
    ENDS,
    FAST,
    FOLLOWED,
    FORWARD,
    JOINTS,
    LOADED,
    OWN_FRICTION,
    ROBOTS,
    SHARES,
    STAIRS_FRICTION,
    STANDS,
    WAYS,
    alone,
    at_each,
    compare,
    less,
    on_robots,
    overall,
    percent,
    stands,
    two,
)
from stiction_experiments.paper.results import HALF, Results

Family = Literal["S", "R", "T", "J", "G", "N"]
"""Family of Holm's correction: Sim2Sim, robot, training, joints, gait, net."""


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
                *((load, ("mujoco-load", load.removeprefix("bench+")), LOADED) for load in LOADS),
            )
        ],
    ),
    Sentence(
        *("2", "it walks backward on the robot", "R"),
        "`none`: worst reach backward 0.8 or more, every seed",
        lambda r: at_each(SHARES, lambda f: alone(r, of.worst_reach, "none", ROBOTS, f, FOLLOWED, *BACKWARD)),
    ),
    Sentence(
        *("3", "walking forward it falls", "R"),
        "`none` falls in a walk forward, every seed",
        lambda r: at_each(SHARES, lambda f: alone(r, of.fall_rate, "none", ROBOTS, f, 1e-9, *FORWARD)),
    ),
    Sentence(
        *("4", "with an Actuator Net it walks forward", "R"),
        "`net`: worst reach forward 0.8 or more at 20 %, every seed",
        lambda r: [
            Test(label, values, kind="above", bound=FOLLOWED, about="net")
            for label, values in (
                ("the robot of its log", on_robots(r, of.worst_reach, "net", "0.2", True, *FORWARD)),
                ("others", on_robots(r, of.worst_reach, "net", "0.2", False, *FORWARD)),
            )
        ],
    ),
    Sentence(
        *("5", "unsteadily", "R"),
        "jitter of `net` over that of `deception`, at 20 %",
        lambda r: [compare(r, of.chatter, "net", "deception", ROBOTS, "0.2", "vx=0.5")],
    ),
    Sentence(
        *("6", "and fails on stairs", "R"),
        "`stairs-deception` crosses more often than `stairs-net`",
        lambda r: [
            two(
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
            two("20 %", (on_robots(r, of.worst_reach, name, "0.2", True, *FORWARD) for name in ("net-all", "net")))
        ],
    ),
    Sentence(
        *("8", "because its data are of one robot", "N"),
        "`net-three` follows more than `net` on a robot of neither log",
        lambda r: [compare(r, of.share_followed, "net-three", "net", "robot-3003", "0.2")],
    ),
    Sentence(
        *("9", "the loop lengthens training", "N"),
        "processor time of log, net and training, `net` over `deception-1`",
        lambda r: [two("time", (r.of_curve(name, "seconds") for name in ("net", "deception-1")))],
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
            two(
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
        lambda r: stands(r, *OWN_FRICTION),
    ),
    Sentence(
        *("16", "and fails to train", "T"),
        "worst reach at its own friction under 0.5, every seed",
        lambda r: [alone(r, of.worst_reach, *at, 0.5, *FAST, below=True, label=at[0]) for at in OWN_FRICTION],
    ),
    Sentence(
        *("17", "compensated in the action it stays stationary", "T"),
        "as 15",
        lambda r: stands(r, ("compensated", "mujoco", "0.2")),
    ),
    Sentence(
        *("18", "friction filters early actions", "T"),
        "weak exploration delays half of the speed forward by more iterations with friction than without",
        lambda r: [
            two(
                "iterations",
                (less(r.of_curve(f"{n}-weak", "reached"), r.of_curve(n, "reached")) for n in ("direct", "none")),
            )
        ],
    ),
    Sentence(
        *("19", "fine-tuning fails", "T"),
        "`fine-tuned`: worst reach at 20 % under 0.5, every seed",
        lambda r: [alone(r, of.worst_reach, "fine-tuned", "mujoco", "0.2", 0.5, *FAST, below=True)],
    ),
    Sentence(
        *("20", "because of local optima", "T"),
        "at half the gain, best reach at 20 % where that friction begins at 40 % of the training, over from the start",
        lambda r: [compare(r, of.best_reach, "direct-half-later", "direct-half", "mujoco", "0.2", *WAYS)],
    ),
    Sentence(
        *("21", "the iterative way jitters on the robot", "R"),
        "jitter, `iterative` over `deception`, at 20 %",
        lambda r: [compare(r, of.chatter, "iterative", "deception", ROBOTS[:2], "0.2", "vx=0.5")],
    ),
    Sentence(
        *("22", "and hardly stands", "R"),
        "over 0.05 m/s, or a fall, while told to stand at 20 %, every seed",
        lambda r: [alone(r, of.planar_speed, "iterative", ROBOTS[:2], "0.2", STANDS, "stand")],
    ),
    Sentence(
        *("23", "the wide range works", "R"),
        "`deception` follows every command, every seed",
        lambda r: [
            alone(r, of.share_followed, "deception", places, f, 1.0)
            for f, places in (*((share, ROBOTS) for share in SHARES), *((end, ENDS) for end in RANGE_ENDS))
        ],
    ),
    Sentence(
        *("24", "because easy robots occur", "T"),
        "worst reach at 20 % over that of `direct`",
        lambda r: [
            two(name, (r.at(of.worst_reach, n, "mujoco", "0.2", *FAST) for n in (name, "direct")))
            for name in ("deception", "mean-kept")
        ],
    ),
    Sentence(
        *("25", "the wide range makes learning easier", "T"),
        "area of the learning curve, `direct` over `deception`",
        lambda r: [two("area", (r.of_curve(name, "area") for name in ("direct", "deception")))],
    ),
    Sentence(
        *("26", "friction makes training harder", "T"),
        "area of the learning curve, `direct` over `none`",
        lambda r: [two("area", (r.of_curve(name, "area") for name in ("direct", "none")))],
    ),
    Sentence(
        *("27", "the wide range is robust to wear", "R"),
        "share of a life followed, friction growing, `deception` over `none`",
        lambda r: [
            two(label, (r.life(training, name) for training in ("deception", "none")))
            for label, name in (("5 to 30 %", "followed"), ("24 to 30 %", "beyond"))
        ],
    ),
    Sentence(
        *("28", "Sim2Sim is best without friction", "S"),
        "deviation in Webots' ODE of each other training over that of `none`",
        lambda r: [
            two(f"{name}, {percent(f)}", (r.at(of.deviation, n, "webots", f) for n in (name, "none")))
            for name in ("direct", "deception", "net")
            for f in ("0", "0.01")
        ],
    ),
    Sentence(
        *("29a", "the Actuator Net is abnormal in Sim2Sim", "S"),
        "`none` follows more than `net`",
        lambda r: at_each(("0", "0.01"), lambda f: compare(r, of.share_followed, "none", "net", "webots", f)),
    ),
    Sentence(
        *("29b", "and ends in system failure", "S"),
        "worst reach of `net` under 0.2, or it falls, every seed",
        lambda r: at_each(
            ("0", "0.01"), lambda f: alone(r, of.worst_reach, "net", "webots", f, 0.2, *FAST, below=True)
        ),
    ),
    Sentence(
        *("30a", "trained with friction it jitters in Sim2Sim", "S"),
        "jitter, `deception` over `none`",
        lambda r: at_each(("0", "0.01"), lambda f: compare(r, of.chatter, "deception", "none", "webots", f, "vx=0.5")),
    ),
    Sentence(
        *("30b", "and jumps", "S"),
        "share of moving control steps in the air, `deception` over `none`",
        lambda r: [
            replace(compare(r, of.flight, "deception", "none", "webots", f, "vx=0.5"), kind="noticeable")
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
        lambda r: at_each(("bench", "0.1"), lambda f: alone(r, of.share_followed, "deception", ROBOTS, f, 1.0)),
    ),
    Sentence(
        *("34", "and on stairs", "R"),
        "`stairs-deception` crosses 8 cm in 8 of 10 walks, every seed",
        lambda r: at_each(
            STAIRS_FRICTION,
            lambda f: Test(percent(f), r.crossed("stairs-deception", "robots", f, 0.08), kind="above", bound=0.8),
        ),
    ),
    Sentence(
        *("35", "training with friction improves Sim2Real", "R"),
        "on robots `deception` follows more than `none`, and `none` deviates more than `deception`",
        lambda r: [
            *at_each(SHARES, lambda f: compare(r, of.share_followed, "deception", "none", ROBOTS, f)),
            *(
                replace(test, label=f"{test.label} (deviation)")
                for test in at_each(SHARES, lambda f: compare(r, of.deviation, "none", "deception", ROBOTS, f))
            ),
        ],
    ),
    Sentence(
        *("36", "with a slight sacrifice in Sim2Sim", "S"),
        "deviation of `deception` over that of `none`, and by less than 0.2, every seed",
        lambda r: [
            replace(compare(r, of.deviation, "deception", "none", "webots", "0"), label="a sacrifice"),
            Test(
                "slight",
                less(*(r.at(of.deviation, name, "webots", "0") for name in ("deception", "none"))),
                kind="below",
                bound=0.2,
            ),
        ],
    ),
    Sentence(
        *("37", "friction is the primary cause", "R"),
        "`none` follows less with the robot's friction alone than with all else alone",
        lambda r: at_each(
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
            replace(compare(r, of.share_followed, "deception", "none+measured", ROBOTS, f), kind="noticeable")
            for f in SHARES
        ],
    ),
    Sentence(
        *("39", "better overall", "R"),
        "share followed, mean over two engines and four robots, `deception` over each other",
        lambda r: [
            two(f"{percent(f)} ({name})", (overall(r, training, f) for training in ("deception", name)))
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
        lambda r: [two("steps", (r.gait(name, "diagonal") for name in ("plain-trot", "plain")))],
    ),
    Sentence(
        *("43", "r_unsync prevents hopping on three legs", "G"),
        "unequal use of both groups, `no-unsync` over `none`",
        lambda r: [two("use", (r.gait(name, "imbalance") for name in ("no-unsync", "none")))],
    ),
    Sentence(
        *("44", "less friction in the joints helps", "J"),
        "worst reach of `none` with less friction over that with more",
        lambda r: [
            two(
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
            two(f"{name}, {own}", (r.gait(n, "sway") for n in (name, own)))
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
