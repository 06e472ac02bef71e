"""The paper's sentences on its comparison, and the explanations that stand to be tested, each with its criterion.

`E`: the paper's section on Sim2Sim and Sim2Real. The virtual robot stands in for the real one, PhysX, ODE for Webots.
`V`: its section on training with friction, whose failures it saw on the robot. `T`: its table of motors, and what it
concludes from it. `X`: explanations for why the paper saw what it saw.

A policy walks while it reaches half of the command in the slower direction and falls in less than half of its walks.
Levels of the virtual robot are shares of the torque limit, the bench's value, and that with shares of the load.
"""

from __future__ import annotations

from collections.abc import Iterable

from stiction.evaluation.grid import REAL
from stiction.evaluation.policies import BEHIND_GEAR, FED, FED_BY_MEASURED
from stiction.evaluation.samples import Condition, each_seed
from stiction.files.results import DIRECTIONS
from stiction_experiments.friction.claims import HARDLY, JITTER, MOVES
from stiction_experiments.lab.claims import FOLLOWING, STABLE, Claim, Verdict, each, in_words
from stiction_experiments.lab.evidence import Evidence
from stiction_experiments.lab.straight import SLOW
from stiction_experiments.replication import criteria
from stiction_experiments.replication.criteria import HALF, JUMPING, NOTICEABLE, elsewhere, on_robot
from stiction_experiments.replication.plan import PAPER_COEFFICIENT, VIRTUAL_ROBOT
from stiction_experiments.replication.records import EvidenceRow
from stiction_experiments.stairs.climb import ENOUGH

FORWARD, BACKWARD = DIRECTIONS

STICKY = Condition(VIRTUAL_ROBOT, 0.2, REAL)
"""The virtual robot with the friction of the training, on which stairs are judged."""

ALL_CLIMBED = f"at least {100 * ENOUGH:g} % of crossings, at each height"

FROZEN = f"{HARDLY} of the command in the faster direction, upright in most walks in each"

TIMES = f"above {JITTER:g} times those of"

NOTICED = f"the slower direction loses at least {100 * NOTICEABLE:g} % of the command"

CLAIMS: tuple[Claim[Evidence], ...] = (
    Claim(
        "E1",
        "in Sim2Sim the robot achieved the best performance using domain randomization without static friction",
        f"other engines, no friction: mean |speed ratio - 1| of none is below that of deception, and of {BEHIND_GEAR}",
        each(*(elsewhere(other, criteria.farther_than("none")) for other in ("deception", BEHIND_GEAR))),
    ),
    Claim(
        "E2a",
        "using Actuator Net, the robot exhibited significant abnormal behavior [in Sim2Sim]",
        f"{BEHIND_GEAR}, other engines, no friction: joint accelerations {TIMES} none while both walk, or "
        f"falls in more than {in_words(STABLE)} of walks, both directions together",
        elsewhere(BEHIND_GEAR, criteria.unsteady("none", *DIRECTIONS)),
    ),
    Claim(
        "E2b",
        "eventually leading to system failure",
        f"{BEHIND_GEAR}, other engines, no friction: {HARDLY} of the command in the slower direction, or at least "
        f"{in_words(HALF)} of the walks in a direction end in a fall",
        elsewhere(BEHIND_GEAR, criteria.fails),
    ),
    Claim(
        "E3",
        "with static friction, the robot displayed irregular jittering [in Sim2Sim]",
        f"other engines, no friction: joint accelerations of deception {TIMES} none while both walk",
        elsewhere("deception", criteria.jitters("none", *DIRECTIONS)),
    ),
    Claim(
        "E4",
        "and jumping",
        "other engines, no friction: deception has no foot on the ground in more than "
        f"{100 * JUMPING:g} % of its moving steps",
        elsewhere("deception", criteria.jumps),
    ),
    Claim(
        "E5",
        "but was still capable of ascending and descending stairs",
        f"deception trained on stairs, other engines, no friction: {ALL_CLIMBED}",
        criteria.climbs_elsewhere("deception"),
    ),
    Claim(
        "E6",
        "domain randomization without static friction enabled the robot to walk backward on flat ground",
        f"none, virtual robot: at least {100 * HALF:g} % of the command backward, at each level",
        on_robot("none", criteria.walks(BACKWARD)),
    ),
    Claim(
        "E7",
        "but forward walking caused it to fall",
        f"none, virtual robot: at least {in_words(HALF)} of the walks forward end in a fall, at each level",
        on_robot("none", criteria.falls(FORWARD)),
    ),
    Claim(
        "E8a",
        "using Actuator Net allowed the robot to walk forward",
        f"{BEHIND_GEAR}, virtual robot: at least {100 * HALF:g} % of the command forward, at each level",
        on_robot(BEHIND_GEAR, criteria.walks(FORWARD)),
    ),
    Claim(
        "E8b",
        "albeit unsteadily",
        f"{BEHIND_GEAR}, virtual robot, forward: joint accelerations {TIMES} deception while both walk, or "
        f"falls in more than {in_words(STABLE)} of walks, at each level",
        on_robot(BEHIND_GEAR, criteria.unsteady("deception", FORWARD)),
    ),
    Claim(
        "E9",
        "and it was unable to climb stairs",
        f"{BEHIND_GEAR} trained on stairs, virtual robot, level {STICKY.level:g}: {HARDLY} of crossings, at each "
        "height; no preset trains such a policy: judged only where some are given",
        criteria.under(BEHIND_GEAR, STICKY, criteria.climbs_not),
    ),
    Claim(
        "E10",
        "domain randomization with static friction achieved stable walking on flat ground",
        f"deception follows on the virtual robot: {FOLLOWING}, at each level",
        criteria.follows_on_robot("deception"),
    ),
    Claim(
        "E11",
        "and successful stair navigation",
        f"deception trained on stairs, virtual robot, level {STICKY.level:g}: {ALL_CLIMBED}",
        criteria.under("deception", STICKY, criteria.climbs),
    ),
    Claim(
        "E12",
        "this approach significantly improved Sim2Real performance",
        "virtual robot: mean |speed ratio - 1| of deception is below that of none, at each level",
        criteria.nearer_on_robot("deception", "none"),
    ),
    Claim(
        "E13",
        "albeit with a slight sacrifice in Sim2Sim performance",
        "other engines, no friction: mean |speed ratio - 1| of deception is above that of none",
        elsewhere("deception", criteria.farther_than("none")),
    ),
    Claim(
        "E14",
        "static friction is the primary cause of this discrepancy",
        "none: slower with the virtual robot's friction alone than with everything else alone, at each level",
        criteria.friction_is_the_cause,
    ),
    Claim(
        "V2",
        "directly incorporating static friction caused the robot to remain stationary [during training]",
        f"direct, moved to the virtual robot: {HARDLY} of the command in the faster direction, and upright in most "
        "walks in each, at each level; training itself is judged by `stiction study friction`",
        on_robot("direct", criteria.stationary),
    ),
    Claim(
        "V3",
        "manually compensating for it in the actions caused the robot to remain stationary [during training]",
        f"compensation, moved to the virtual robot: {HARDLY} of the command in the faster direction, and upright in "
        "most walks in each, at each level; training itself is judged by `stiction study friction`",
        on_robot("compensation", criteria.stationary),
    ),
    Claim(
        "V5",
        "fine-tuning a model that was trained without static friction also failed",
        f"finetune, virtual robot: too slow, under {SLOW} of the command in the slower direction, at each level",
        on_robot("finetune", criteria.too_slow),
    ),
    Claim(
        "V7",
        "models trained with the iterative method exhibited severe jitter during real-world deployment",
        f"virtual robot: joint accelerations of iterative {TIMES} deception while both walk, at each level",
        on_robot("iterative", criteria.jitters("deception", *DIRECTIONS)),
    ),
    Claim(
        "V8",
        "even making stable standing difficult",
        f"iterative, virtual robot, told to stand: faster than {MOVES:g} m/s, or more than {in_words(STABLE)} of walks "
        "fall, at each level",
        on_robot("iterative", criteria.stands_badly),
    ),
    Claim(
        "T1",
        "static friction [0.98 % of the torque limit] leads to a noticeable impact",
        f"none, other engines: {NOTICED} between no friction and 1 %",
        elsewhere("none", criteria.loses, 0.01),
    ),
    Claim(
        "T2",
        "joints with lower friction-to-torque ratios could further alleviate this issue",
        "none, virtual robot: mean |speed ratio - 1| at 0.1 is below that at 0.2",
        criteria.lower_is_better,
    ),
    Claim(
        "X1",
        f"the unit: {PAPER_COEFFICIENT:g} read as a coefficient of the joint's load freezes conventional policies",
        f"none, law load, c = {PAPER_COEFFICIENT:g}: {FROZEN}",
        criteria.frozen_by("load"),
    ),
    Claim(
        "X2",
        f"the unit: {PAPER_COEFFICIENT:g} read as a coefficient of the motor's torque does",
        f"none, law effort, c = {PAPER_COEFFICIENT:g}: {FROZEN}",
        criteria.frozen_by("effort"),
    ),
    Claim(
        "X3",
        "had the paper's Sim2Sim had joint friction, it would have shown [Webots ignores it under position control]",
        f"none, ODE as Webots sets it up: {NOTICED}, at each level above "
        "0; that Webots ignores it was read in its source and not tried",
        criteria.loses_at_each_level("none", "ode-webots"),
    ),
    Claim(
        "X4",
        "on the real robot friction under load was far above the bench's value",
        f"none, virtual robot: in the slower direction not under {SLOW} at the bench's value, and under it with 0.1 "
        "of the load",
        criteria.load_above_bench,
    ),
    Claim(
        "X5",
        "what a user would try: friction fed forward in the joint controllers makes a conventional policy walk",
        f"{FED_BY_MEASURED} follows on the virtual robot, friction as identified on its bench: {FOLLOWING}, at each "
        "level; robots whose bench does not tell the friction are left out, and counted",
        criteria.follows_on_robot(FED_BY_MEASURED),
    ),
    Claim(
        "X6",
        "and training with friction is better than that",
        f"virtual robot: mean |speed ratio - 1| of deception is below that of {FED_BY_MEASURED}, at each level, over "
        "the robots on which friction was fed forward",
        criteria.nearer_on_robot("deception", FED_BY_MEASURED),
    ),
    Claim(
        "X8",
        "fed forward by the position error alone, a conventional policy walks [the control: not as users do it]",
        f"{FED} follows on the virtual robot, friction as identified on its bench: {FOLLOWING}, at each level",
        criteria.follows_on_robot(FED),
    ),
    Claim(
        "X9",
        "and training with friction is better than that",
        f"virtual robot: mean |speed ratio - 1| of deception is below that of {FED}, at each level",
        criteria.nearer_on_robot("deception", FED),
    ),
    Claim(
        "X7",
        "and a range, around and below the friction that one knows, is better than training at that friction alone",
        "virtual robot: mean |speed ratio - 1| of deception is below that of point, at each level",
        criteria.nearer_on_robot("deception", "point"),
    ),
)
"""In the order of the paper, then the criteria."""


def judge_all(
    evidence: Evidence, claims: Iterable[Claim[Evidence]] = CLAIMS
) -> tuple[list[Verdict], list[EvidenceRow]]:
    """Return what became of every sentence, and the numbers that each criterion read."""
    verdicts, read = [], []
    for claim in claims:
        own = evidence.afresh()
        verdicts.append(claim.verdict(own))
        read += [EvidenceRow(*cell, claim.id, column, *each_seed(seeds)) for (cell, column), seeds in own.reads.items()]
    return verdicts, read
