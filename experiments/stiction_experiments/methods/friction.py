"""`--method compensation`, `finetune` and `iterative`: friction added to the command, or brought in later. No torch."""

from __future__ import annotations

from stiction.files.contract import Contract
from stiction.files.method import Method
from stiction.joints.compensation import BY_SPEED

USUAL = (0.8, 1.2)
"""Range that the paper's Table II gives every other joint parameter."""

BY_ERROR = "compensation-error"
"""Name in results of policies of `compensation` from before it went by the speed of the joints; none is trained now."""


def _called(contract: Contract) -> str:
    by_error = contract.compensation is not None and contract.compensation_speeds is None
    return BY_ERROR if by_error else COMPENSATION.name


COMPENSATION = Method(
    "compensation",
    "dry friction in the joints, drawn closely around its nominal value, part of which is added to the command, by the "
    "joint's speed",
    USUAL,
    compensation=BY_SPEED.label,
    called=_called,
    names={
        "compensation": f"{BY_SPEED.share:g} of the nominal friction added to the command, in training and after, by "
        "the measured speed, and by the error while stuck",
        BY_ERROR: "all of the nominal friction added to the command, in training and after, by the error",
    },
)
FINETUNE = Method(
    "finetune",
    "without dry friction at first, then all of it at once, drawn closely around its nominal value",
    USUAL,
    begin=0.5,
    names={"finetune": "trained without friction, then with all of it at once"},
)
ITERATIVE = Method(
    "iterative",
    "without dry friction at first, then more of it in equal steps, drawn closely around each",
    USUAL,
    begin=0.5,
    stages=4,
    names={"iterative": "trained without friction, then with more in steps"},
)
