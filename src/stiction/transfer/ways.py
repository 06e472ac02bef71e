"""How a policy was made, by its contract: the paper's methods under the names by which they are compared."""

from __future__ import annotations

from stiction.formats.contract import Contract
from stiction.formats.grid import FED

TOLD = "told"
"""Way of the policies that observe their joints' known friction, however it was drawn in training."""

WAYS = {
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
}
"""Way of training -> what it is."""


def way_of(contract: Contract) -> str:
    """Return the way in which a policy was trained, one of `WAYS`."""
    if contract.actuator is not None:
        return "actuator"
    if contract.knows_friction:
        return TOLD
    if contract.method == "deception" and contract.joints_file is not None:
        return "identified"
    low, high = contract.friction_range
    return "point" if contract.method == "direct" and low == high else contract.method
