"""The paper's sentences on training with friction, each with its criterion. All of it is judged in simulation.

`V` is the paper's section on joints and training with friction, `A` its abstract, `I` the introduction, `E` the
experiments, `C` the conclusion. Stairs, other engines, the Actuator Net and the robot are other experiments.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from stiction.formats.experiment import Verdict
from stiction.formats.following import BAND, LEAST
from stiction.transfer.experiment import criteria
from stiction.transfer.experiment.criteria import Evidence
from stiction.transfer.experiment.judging import Finding


@dataclass(frozen=True)
class Claim:
    """One sentence of the paper."""

    id: str
    """Section and number."""
    sentence: str
    """The sentence, shortened."""
    criterion: str
    """What must hold for it to reproduce."""
    judge: Callable[[Evidence], Finding]
    """The criterion as a function of the results."""


CLAIMS: tuple[Claim, ...] = (
    Claim(
        "V1",
        "the inclusion of f_j introduced nonlinearity, significantly increasing training difficulty",
        f"iterations until the teacher reaches {LEAST} both ways, under its own friction: direct takes more than none",
        criteria.harder,
    ),
    Claim(
        "V2",
        "directly incorporating the identified static friction ... caused the robot to remain stationary",
        "direct, level 0.2: under 20 % of the command in both directions",
        criteria.stationary(criteria.DIRECT),
    ),
    Claim(
        "V2, as load",
        "the same, the number read as a coefficient of the joint's load",
        "direct, law load: under 20 % of the command in both directions, at the coefficient it was trained with",
        criteria.stationary_under_load,
    ),
    Claim(
        "V3",
        "manually compensating for it in the RL-generated actions ... caused the robot to remain stationary",
        "compensation, level 0.2: under 20 % of the command in both directions",
        criteria.stationary("coulomb20-compensation"),
    ),
    Claim(
        "V4",
        "this is due to the chaotic nature of early RL actions, with static friction acting as a strong filter",
        "slower direction: direct whose first actions outdo the friction reaches more than direct whose do not, and so "
        "does as weak an exploration without friction",
        criteria.filtered,
    ),
    Claim(
        "V5",
        "fine-tuning a pre-trained model (trained without static friction) by introducing f_j also failed",
        f"finetune, level 0.2: too slow, under {LEAST} of the command in its slower direction",
        criteria.too_slow("coulomb20-finetune"),
    ),
    Claim(
        "V6",
        "likely because the model weights were already trapped in local optima or saddle points",
        "none: no run here can tell",
        criteria.nobody_looked,
    ),
    Claim(
        "V7",
        "models trained with [the iterative] method exhibited severe jitter during real-world deployment",
        f"iterative, level 0.2: joint accelerations above {criteria.JITTER:g} times those of deception",
        criteria.jitters,
    ),
    Claim(
        "V8",
        "even making stable standing difficult",
        "iterative, level 0.2: more than 0.1 m/s where standing is commanded",
        criteria.stands_badly,
    ),
    Claim(
        "V9",
        "we significantly expanded the randomization range of f_j. This approach successfully enabled ... deployment",
        f"deception follows at 0 and at 0.2: {BAND} both ways by every seed, and nobody falls; in simulation",
        criteria.deception_works,
    ),
    Claim(
        "V10",
        "increased randomization allows the robot to encounter scenarios with negligible static friction, reducing "
        "training difficulty",
        "same mean, no easy robots: the narrow range reaches less than deception in its slower direction at 0.2",
        criteria.easy_robots,
    ),
    Claim(
        "V11",
        "expanding the randomization range enhances the robot's robustness to mechanical wear",
        "mean |speed ratio - 1| over 0 to 0.3: deception is below direct and below none",
        criteria.bears_wear,
    ),
    Claim(
        "A1",
        "conventional domain randomization approaches resulted in significantly underperforming real-world models",
        f"none: too slow, under {LEAST} of the command in its slower direction, at each level of friction above 0; in "
        "simulation",
        criteria.underperforms,
    ),
    Claim(
        "A2",
        "recognizing the increased training difficulty ..., a simple and novel solution to reduce learning complexity",
        f"iterations until the teacher reaches {LEAST} both ways: deception takes fewer than direct",
        criteria.easier,
    ),
    Claim(
        "A3",
        "our method achieved superior adaptive capabilities and overall performance",
        "mean |speed ratio - 1| over 0 to 0.3: deception is below none; the Actuator Net is another experiment",
        criteria.superior,
    ),
    Claim(
        "I1",
        "only by incorporating static friction into the randomization could we achieve satisfactory performance",
        f"at 0.2, none is too slow, under {LEAST} in its slower direction, and deception follows: {BAND} both ways by "
        "every seed, and nobody falls",
        criteria.only_with_friction,
    ),
    Claim(
        "E1",
        "this approach significantly improved Sim2Real performance, albeit with a slight sacrifice in Sim2Sim "
        "performance",
        "the second half, in the engine of training: without friction, deception has a larger tracking error than none",
        criteria.sacrifice,
    ),
    Claim(
        "C1",
        "the introduction of static friction will cause the model to fail to train",
        f"direct, level 0.2: too slow, under {LEAST} of the command in its slower direction",
        criteria.too_slow(criteria.DIRECT),
    ),
)
"""In the order of the paper's section on training with friction, then the other sections."""


def judge_all(evidence: Evidence, claims: Iterable[Claim] = CLAIMS) -> list[Verdict]:
    """Return what became of every sentence."""
    return [
        Verdict(claim.id, claim.sentence, claim.criterion, finding.outcome, finding.evidence)
        for claim in claims
        for finding in [claim.judge(evidence)]
    ]
