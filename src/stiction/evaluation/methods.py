"""The training method of a policy, by its contract: methods under the names in tables."""

from __future__ import annotations

from dataclasses import dataclass

from stiction.files.contract import Contract
from stiction.files.contract_rules import IMPORTED
from stiction.files.method import installed_methods, known_method
from stiction.joints.compensation import SHARES, By, Compensation

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
    IMPORTED: "trained elsewhere: what friction it met is not known",
}
"""Training method of the product -> what it is."""


def method_texts() -> dict[str, str]:
    """Return every training method -> what it is, those of installed distributions among them."""
    texts = dict(METHODS)
    for method in installed_methods():
        texts |= method.names or {method.name: method.description}
    return texts


def method_of(contract: Contract) -> str:
    """Return the training method of a policy, one of `method_texts`; of one that is not installed its name alone."""
    if contract.actuator is not None:
        return BEHIND_GEAR if contract.torque_source == "output_side" else "actuator"
    if contract.observes_friction:
        return KNOWN_FRICTION
    if contract.method == "deception" and contract.joints_file is not None:
        return "identified"
    if (method := known_method(contract.method)) is not None and method.called is not None:
        return method.called(contract)
    low, high = contract.friction_range
    return "point" if contract.method == "direct" and low == high else contract.method
