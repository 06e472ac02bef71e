"""The training method of a policy, by its contract: the paper's methods under the names in tables."""

from __future__ import annotations

from dataclasses import dataclass

from stiction.files.contract import Contract
from stiction.files.contract_rules import IMPORTED, JOINT_DISTURBERS
from stiction.joints.compensation import BY_SPEED, SHARES, By, Compensation

FORWARD = "+forward"
"""Behind the names of policy and method: with friction fed forward by the position error."""

FED = f"none{FORWARD}"
"""The conventional policy with friction fed forward by the position error, all of it."""

FED_BY_REFERENCE, FED_BY_MEASURED = "none+reference", "none+measured"
"""The same as users of motors do it: by the speed of the target or of the joint, by the error while it is stuck."""

FED_BY: dict[By, str] = {"error": FED, "reference": FED_BY_REFERENCE, "measured": FED_BY_MEASURED}
"""How friction is fed forward in the comparison -> method."""


def fed_suffix(compensation: Compensation) -> str:
    """Return the suffix of policy and method where friction is fed forward: `+reference=0.8`."""
    return f"+{compensation.label.replace('error', FORWARD[1:])}"


@dataclass(frozen=True)
class MethodCell:
    """Which training method, in which cell of a grid."""

    method: str
    """Training method with friction; in brackets what else tells one training from another."""
    engine: str
    """Engine, and what of a virtual robot is real in it."""
    friction_law: str
    """Law of the friction."""
    friction_level: float
    """Friction over the torque limit, or a coefficient [-]."""
    terrain: str
    """Ground."""
    command: str
    """Commanded velocity."""


KNOWN_FRICTION = "told"
"""Method of policies that observe their joints' friction, however it was drawn in training."""

DREAMWAQ, DREAMWAQ_FRICTION = "dreamwaq", "dreamwaq-friction"
"""DreamWaQ as in its paper, and with dry friction in training, which its paper has not."""

HINF = {
    "force": ("hinf", "H∞: beside a disturber that learns to push the base"),
    "friction": ("hinf-joints", "H∞: beside a disturber that learns torques within each joint's friction"),
    "random": ("hinf-random", "PPO under random pushes of the base, to compare H∞ with"),
    "random-friction": ("hinf-random-joints", "PPO under random torques within each joint's friction, to compare"),
    None: ("hinf-nobody", "PPO as H∞ has it, and nobody disturbs"),
}
"""Who disturbed the training of the method `hinf` -> its name here, and what it is."""

WITH_FRICTION = "-friction"
"""Behind the names of those of `HINF` that need no friction in training and had some."""

_PUSHED = [names for kind, names in HINF.items() if kind not in JOINT_DISTURBERS]

COMPENSATION_BY_ERROR = "compensation-error"
"""Method of policies of `compensation` from before it went by the speed of the joints; none is trained any more."""

BEHIND_GEAR = "actuator-output"
"""Method of policies trained through an Actuator Net of torque behind the gear, as in the paper."""

METHODS = {
    "none": "conventional randomisation, without friction",
    FED: "the same policy, the friction that was identified fed forward in the joint controllers at 500 Hz",
    FED_BY_REFERENCE: f"the same, {SHARES['reference']:g} of it, by the target's speed, and by the error while stuck",
    FED_BY_MEASURED: f"the same, {SHARES['measured']:g} of it, by the measured speed, and by the error while stuck",
    BEHIND_GEAR: "Actuator Net: without friction of its own, through a net of the torque behind the gears, friction in "
    "it, that a robot of this kind logged while `none` walked backward",
    "actuator": "its control: the same with the torque that the motors logged, which no friction is in",
    "deception": "friction-aware: friction from none to 1.2 of the nominal one",
    "identified": "friction-aware, around each joint's friction as identified on the bench of a robot of the same kind",
    KNOWN_FRICTION: "friction-aware, and told the friction of each kind of joint, as a bench identifies it",
    "direct": "friction within 0.8 to 1.2 of the nominal one",
    "point": "one value of friction and no range: each joint's as identified on the bench of a robot of the same kind",
    "compensation": f"{BY_SPEED.share:g} of the nominal friction added to the command, in training and after, by the "
    "measured speed, and by the error while stuck",
    COMPENSATION_BY_ERROR: "all of the nominal friction added to the command, in training and after, by the error",
    "finetune": "trained without friction, then with all of it at once",
    "iterative": "trained without friction, then with more in steps",
    DREAMWAQ: "DreamWaQ: a code of the history in place of teacher and student; conventional randomisation, without "
    "friction",
    DREAMWAQ_FRICTION: "DreamWaQ, with friction in training, drawn from the range that was named",
    **{name: f"{text}; without friction" for name, text in _PUSHED},
    **{f"{name}{WITH_FRICTION}": f"{text}; with friction" for name, text in _PUSHED},
    **{HINF[kind][0]: f"{HINF[kind][1]}, with friction" for kind in JOINT_DISTURBERS},
    IMPORTED: "trained elsewhere: what friction it met is not known",
}
"""Training method -> what it is."""


def method_of(contract: Contract) -> str:
    """Return the training method of a policy, one of `METHODS`."""
    if contract.actuator is not None:
        return BEHIND_GEAR if contract.torque_source == "output_side" else "actuator"
    if contract.observes_friction:
        return KNOWN_FRICTION
    if contract.method == "deception" and contract.joints_file is not None:
        return "identified"
    low, high = contract.friction_range
    met_friction = max(high, contract.largest_load) > 0.0
    if contract.method == "hinf":
        name = HINF[contract.disturber][0]
        return f"{name}{WITH_FRICTION}" if met_friction and contract.disturber not in JOINT_DISTURBERS else name
    if contract.method == DREAMWAQ and met_friction:
        return DREAMWAQ_FRICTION
    if contract.compensation is not None and contract.compensation_speeds is None:
        return COMPENSATION_BY_ERROR
    return "point" if contract.method == "direct" and low == high else contract.method
