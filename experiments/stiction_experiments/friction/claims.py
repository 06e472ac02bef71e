"""The paper's sentences on training with friction, each with its criterion. All of it is judged in simulation.

`V` is the paper's section on joints and training with friction, `A` its abstract, `I` the introduction, `E` the
experiments, `C` the conclusion. Stairs, other engines, the Actuator Net and the robot are other experiments.

The student is judged, on flat ground, in the engine of training. A method is a training condition of the manifest.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stiction.evaluation.grid import BATCH
from stiction.files.results import DIRECTIONS, FOLLOWS
from stiction.files.velocity import STAND
from stiction_experiments.friction.evaluation import iterations_by_seed
from stiction_experiments.friction.evidence import TrainingEvidence, at
from stiction_experiments.friction.manifest import LEVEL, LOAD_COEFFICIENTS
from stiction_experiments.friction.records import HIGHEST, short_name
from stiction_experiments.lab.claims import (
    FOLLOWING,
    Claim,
    Finding,
    Labelled,
    all_of,
    any_of,
    describe,
    each,
    follows,
    larger,
    over_levels,
    within,
)
from stiction_experiments.lab.evidence import Measurement
from stiction_experiments.lab.straight import SLOW

STATIONARY = 0.2
"""Below this share of the commanded speed a robot counts as stationary [-]."""

HARDLY = f"under {100 * STATIONARY:g} %"
"""The same, for criteria."""

JITTER = 1.5
"""A policy jitters severely if its joint accelerations are this many times those of deception [-]."""

MOVES = 0.1
"""Speed from which on a robot that is commanded to stand does not [m/s]."""

NONE, DIRECT, DECEPTION = "coulomb20-none", "coulomb20-direct", "coulomb20-deception"

NOMINAL = at(LEVEL)
"""The friction that the paper trains with."""

Judge = Callable[[TrainingEvidence], Finding]
"""A criterion as a function of the results."""


def _iterations(e: TrainingEvidence, method: str) -> Labelled:
    """Return the iterations until the robot walks both ways in the first phase, with a label that says how many seeds
    never do: they count as the whole phase, less than the truth.
    """
    (iterations, late), name = iterations_by_seed(method, e.curves), short_name(method)
    return f"{name} ({late} of {len(iterations)} seeds not before the end)" if late else name, Measurement(iterations)


def takes_longer(method: str, than: str) -> Judge:
    """Training with one method takes more iterations than with another."""
    return lambda e: larger(_iterations(e, method), _iterations(e, than))


def stationary(method: str) -> Judge:
    """The robot hardly moves in either direction at the friction that it was trained with."""
    label = f"{short_name(method)}, faster direction"
    return lambda e: within(label, e.faster(method, NOMINAL), -np.inf, STATIONARY)


def stationary_under_load(e: TrainingEvidence) -> Finding:
    """The same with friction that grows with load, at each coefficient trained with."""
    findings = []
    for c in LOAD_COEFFICIENTS:
        measured = e.faster(f"load{round(1000 * c)}-direct", at(c, "load"))
        findings.append((c, within("direct, faster direction", measured, -np.inf, STATIONARY)))
    return over_levels(findings)


def filtered(e: TrainingEvidence) -> Finding:
    """Exploration under the friction learns less than exploration that breaks away, and not for being weak: as weak an
    exploration learns more where there is no friction. One of the two weak ones of the manifest suffices.
    """
    strong = e.slower(f"{DIRECT}-strong", NOMINAL)
    findings = []
    for name in ("weak", "mid"):
        weak, control = e.slower(f"{DIRECT}-{name}", NOMINAL), e.slower(f"{NONE}-{name}", at(0.0))
        if weak.seeds or name == "weak":
            more = larger((f"{name} and no friction at all", control), (name, weak))
            findings.append(all_of(larger(("strong, slower direction", strong), (name, weak)), more))
    judged = any_of(*findings)
    return Finding(judged.outcome, f"{judged.evidence}; {describe('default', e.slower(DIRECT, NOMINAL).seeds)}")


def too_slow(method: str) -> Judge:
    """The policy is too slow in its slower direction at the nominal friction, however fast it is elsewhere."""
    label = f"{short_name(method)}, slower direction"
    return lambda e: within(label, e.slower(method, NOMINAL), -np.inf, FOLLOWS[0])


def jitters(e: TrainingEvidence) -> Finding:
    """The iterative policy's joint accelerations are a multiple of deception's."""
    iterative, deception = (
        e.mean(method, NOMINAL, "joint_jitter", DIRECTIONS[0]) for method in ("coulomb20-iterative", DECEPTION)
    )
    allowed = Measurement({seed: JITTER * value for seed, value in deception.seeds.items()})
    return larger(("iterative [rad/s²]", iterative), (f"{JITTER} x deception", allowed))


def stands_badly(e: TrainingEvidence) -> Finding:
    """The iterative policy moves where it is commanded to stand."""
    speed = e.mean("coulomb20-iterative", NOMINAL, "tracking_error", STAND)
    return within("iterative, speed while standing [m/s]", speed, MOVES, np.inf)


def follows_at(method: str, level: float) -> Judge:
    """Every seed follows the command at a level, in both directions, and nobody falls."""
    return lambda e: follows(e, method, at(level), f"{short_name(method)} at {level:g}")


def easy_robots(e: TrainingEvidence) -> Finding:
    """With the same mean and no easy robots, what the wide range reached is not reached."""
    narrow, wide = (e.slower(f"coulomb20-{name}", NOMINAL) for name in ("narrow", "deception"))
    finding = larger(("deception, slower direction", wide), ("narrow", narrow))
    others = ("mean-kept", "mixture", "deception-joint")
    comparison = "; ".join(describe(name, e.slower(f"coulomb20-{name}", NOMINAL).seeds) for name in others)
    return Finding(finding.outcome, f"{finding.evidence}; {comparison}")


def nearer_than(other: str) -> Judge:
    """Over the levels, the wide range is nearer to the command than another method."""
    return lambda e: larger(*((short_name(method), e.mean_error(method)) for method in (other, DECEPTION)))


def underperforms(e: TrainingEvidence) -> Finding:
    """The conventional policy is too slow in its slower direction, at each level."""
    levels = (level for level in e.levels(NONE, BATCH) if level <= HIGHEST)
    slower = ((level, e.slower(NONE, at(level))) for level in levels)
    return over_levels([(level, within("none, slower direction", one, -np.inf, FOLLOWS[0])) for level, one in slower])


def sacrifice(e: TrainingEvidence) -> Finding:
    """Without friction, the wide range tracks worse than conventional randomisation."""
    deception, none = (e.mean(method, at(0.0), "tracking_error", *DIRECTIONS) for method in (DECEPTION, NONE))
    return larger(("deception, error at 0 [m/s]", deception), ("none", none))


CLAIMS: tuple[Claim[TrainingEvidence], ...] = (
    Claim(
        "V1",
        "the inclusion of f_j introduced nonlinearity, significantly increasing training difficulty",
        f"iterations until it reaches {SLOW} both ways in training, at its own friction: direct takes more than none",
        takes_longer(DIRECT, NONE),
    ),
    Claim(
        "V2",
        "directly incorporating the identified static friction ... caused the robot to remain stationary",
        f"direct, level {LEVEL:g}: {HARDLY} of the command in both directions",
        stationary(DIRECT),
    ),
    Claim(
        "V2, as load",
        "the same, the number read as a coefficient of the joint's load",
        f"direct, law load: {HARDLY} of the command in both directions, at the coefficient it was trained with",
        stationary_under_load,
    ),
    Claim(
        "V3",
        "manually compensating for it in the RL-generated actions ... caused the robot to remain stationary",
        f"compensation, level {LEVEL:g}: {HARDLY} of the command in both directions",
        stationary("coulomb20-compensation"),
    ),
    Claim(
        "V4",
        "this is due to the chaotic nature of early RL actions, with static friction acting as a strong filter",
        "slower direction: direct whose first actions outdo the friction reaches more than direct whose do not, and so "
        "does as weak an exploration without friction",
        filtered,
    ),
    Claim(
        "V5",
        "fine-tuning a pre-trained model (trained without static friction) by introducing f_j also failed",
        f"finetune, level {LEVEL:g}: too slow, under {SLOW} of the command in its slower direction",
        too_slow("coulomb20-finetune"),
    ),
    Claim(
        "V6",
        "likely because the model weights were already trapped in local optima or saddle points",
        "none: no run here can tell",
        lambda e: Finding("not tested", "nothing here looks at the optimiser's path"),
    ),
    Claim(
        "V7",
        "models trained with [the iterative] method exhibited severe jitter during real-world deployment",
        f"iterative, level {LEVEL:g}: joint accelerations above {JITTER:g} times those of deception",
        jitters,
    ),
    Claim(
        "V8",
        "even making stable standing difficult",
        f"iterative, level {LEVEL:g}: more than {MOVES:g} m/s where standing is commanded",
        stands_badly,
    ),
    Claim(
        "V9",
        "we significantly expanded the randomization range of f_j. This approach successfully enabled ... deployment",
        f"deception follows at 0 and at {LEVEL:g}: {FOLLOWING}; in simulation",
        each(follows_at(DECEPTION, 0.0), follows_at(DECEPTION, LEVEL)),
    ),
    Claim(
        "V10",
        "increased randomization allows the robot to encounter scenarios with negligible static friction, reducing "
        "training difficulty",
        f"same mean, no easy robots: the narrow range reaches less than deception in its slower direction at {LEVEL:g}",
        easy_robots,
    ),
    Claim(
        "V11",
        "expanding the randomization range enhances the robot's robustness to mechanical wear",
        f"mean |speed ratio - 1| over 0 to {HIGHEST:g}: deception is below direct and below none",
        each(nearer_than(DIRECT), nearer_than(NONE)),
    ),
    Claim(
        "A1",
        "conventional domain randomization approaches resulted in significantly underperforming real-world models",
        f"none: too slow, under {SLOW} of the command in its slower direction, at each level of friction above 0; in "
        "simulation",
        underperforms,
    ),
    Claim(
        "A2",
        "recognizing the increased training difficulty ..., a simple and novel solution to reduce learning complexity",
        f"iterations until it reaches {SLOW} both ways in training: deception takes fewer than direct",
        takes_longer(DIRECT, DECEPTION),
    ),
    Claim(
        "A3",
        "our method achieved superior adaptive capabilities and overall performance",
        f"mean |speed ratio - 1| over 0 to {HIGHEST:g}: deception is below none; the Actuator Net is another "
        "experiment",
        nearer_than(NONE),
    ),
    Claim(
        "I1",
        "only by incorporating static friction into the randomization could we achieve satisfactory performance",
        f"at {LEVEL:g}, none is too slow, under {SLOW} in its slower direction, and deception follows: {FOLLOWING}",
        each(too_slow(NONE), follows_at(DECEPTION, LEVEL)),
    ),
    Claim(
        "E1",
        "this approach significantly improved Sim2Real performance, albeit with a slight sacrifice in Sim2Sim "
        "performance",
        "the second half, in the engine of training: without friction, deception has a larger tracking error than none",
        sacrifice,
    ),
    Claim(
        "C1",
        "the introduction of static friction will cause the model to fail to train",
        f"direct, level {LEVEL:g}: too slow, under {SLOW} of the command in its slower direction",
        too_slow(DIRECT),
    ),
)
"""In the order of the paper's section on training with friction, then the other sections."""
