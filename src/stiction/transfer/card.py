"""The card of a bundle: what the policy is, for people, made from the contract alone."""

from __future__ import annotations

from stiction.formats.contract import METHODS, Contract
from stiction.formats.friction import LAWS, has_coefficient, level_text
from stiction.formats.known_friction import told_text

TEMPLATE = """\
# {robot}, {terrain}, {method}, {title}

A walking policy for the robot `{robot}` on {terrain} ground: the student of rapid motor adaptation, which sees joints,
attitude and its own last actions, and follows a commanded velocity.

| | |
|---|---|
| trained with | {meaning} |
| law of the dry friction | `{law}`: {law_meaning} |
| nominal dry friction | {nominal} |
| dry friction in training | {low:.3g} to {high:.3g}{unit} |
| joints | {joints} ({joint_count}) |
| control period | {period:g} s |
| identification used | {identification} |
{told}| joint torque in training | {torque} |
| seed | {seed} |
| code | {revision} |
| made by | `{command}` |

It was trained and evaluated in simulation. It has not run on a robot.

`stiction verify` checks the files and replays the recorded sensors of `golden.npz`. `SHA256SUMS` guards against
damage, it is not a signature: take bundles from where you trust.
"""


def write_card(contract: Contract) -> str:
    """Return the text of card.md."""
    low, high = contract.friction_range
    used, level = contract.joints_file, level_text(contract.friction_law, contract.friction_level)
    coefficient = has_coefficient(contract.friction_law)
    net = contract.actuator
    return TEMPLATE.format(
        robot=contract.robot,
        terrain=contract.terrain,
        method=contract.method,
        meaning=METHODS.get(contract.method, contract.method),
        title=level if contract.friction_law == "coulomb" else f"{contract.friction_law} {level}",
        law=contract.friction_law,
        law_meaning=LAWS[contract.friction_law],
        nominal=level if coefficient else f"{level} of each joint's torque limit",
        unit="" if coefficient else " of the torque limit",
        low=low,
        high=high,
        joints=", ".join(contract.joint_names),
        joint_count=contract.num_joints,
        period=contract.control_period,
        identification=f"{used['name']}, SHA-256 {used['sha256']}" if used else "none",
        told=_told(contract),
        torque=f"Actuator Net {net['name']}, SHA-256 {net['sha256']}"
        if net
        else "PD law with the gains of the contract",
        seed=contract.seed,
        revision=contract.revision,
        command=contract.command,
    )


def _told(contract: Contract) -> str:
    """Return the line on the friction that the policy is told; nothing for one that is told none."""
    told, file = contract.known_friction, contract.known_friction_file
    if told is None:
        return ""
    source = f"{file['name']}, SHA-256 {file['sha256']}" if file else "the nominal friction of training, of no robot"
    return f"| friction that it is told | {told_text(told)}, from {source} |\n"
