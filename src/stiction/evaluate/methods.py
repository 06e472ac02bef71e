"""The training method of a policy, by its contract: the paper's methods under the names in tables."""

from __future__ import annotations

from dataclasses import dataclass

from stiction.formats.contract import Contract
from stiction.formats.contract_rules import IMPORTED

FORWARD = "+forward"
"""Behind the names of policy and method: with friction fed forward in the joint controllers."""

FED = f"none{FORWARD}"
"""The conventional policy with friction fed forward."""


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


TOLD = "told"
"""Method of policies that observe their joints' friction, however it was drawn in training."""

METHODS = {
    "none": "conventional randomisation, without friction",
    FED: "the same policy, the friction that was identified fed forward in the joint controllers at 500 Hz",
    "actuator": "Actuator Net: without friction, through a net of the torque that the motors of a robot of this kind "
    "logged while `none` walked backward",
    "deception": "friction-aware: friction from none to 1.2 of the nominal one",
    "identified": "friction-aware, around each joint's friction as identified on the bench of a robot of the same kind",
    TOLD: "friction-aware, and told the friction of each kind of joint, as a bench identifies it",
    "direct": "friction within 0.8 to 1.2 of the nominal one",
    "point": "one value of friction and no range: each joint's as identified on the bench of a robot of the same kind",
    "compensation": "nominal friction added to the command, in training and after",
    "finetune": "trained without friction, then with all of it at once",
    "iterative": "trained without friction, then with more in steps",
    IMPORTED: "trained elsewhere: what friction it met is not known",
}
"""Training method -> what it is."""


def method_of(contract: Contract) -> str:
    """Return the training method of a policy, one of `METHODS`."""
    if contract.actuator is not None:
        return "actuator"
    if contract.observes_friction:
        return TOLD
    if contract.method == "deception" and contract.joints_file is not None:
        return "identified"
    low, high = contract.friction_range
    return "point" if contract.method == "direct" and low == high else contract.method
