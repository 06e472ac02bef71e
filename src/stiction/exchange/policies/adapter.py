"""Adapter in a network for what a target's file cannot hold: scales, clips, order of terms, attitude.

The new network observes plain terms, as every target has them: unscaled, not cut off, term by term, the oldest frame
first. In front of the old one stand a product with a matrix that picks and scales, a sum and two bounds; roll and pitch
come from the direction of gravity, with the half-angle formulas

    roll = atan2(-g_y, -g_z) = 2 atan(-g_y / (√(g_y² + g_z²) - g_z))
    pitch = asin(g_x) = 2 atan(g_x / (1 + √(1 - g_x²)))

Behind it stands the clip of the action, so that the action before and after it are one. Everything is float32; the
actions agree to some 1e-6 of their size, see the tests.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from stiction.core.errors import PolicyError
from stiction.deploy.network_file import FLOAT, NetworkFile, Node, Port
from stiction.deploy.policy import INPUT, OUTPUT
from stiction.exchange.policies.description import UNBOUNDED
from stiction.exchange.policies.onnx_file import constant
from stiction.files.contract import Contract
from stiction.files.known_friction import TERM
from stiction.files.observation import FIRST_SIDE, FRAMES, NO_CLIP, PLACEHOLDERS, SLOW_TERMS, ObservationLayout, Term

PLAIN = {
    "angular_velocity": "angular_velocity",
    "roll_pitch": "projected_gravity",
    "projected_gravity": "projected_gravity",
    "base_linear_velocity": "base_linear_velocity",
    "command": "command",
    "command_linear": "command",
    "command_turn": "command",
    "joint_position": "joint_position",
    "joint_velocity": "joint_velocity",
    "last_action": "last_action",
    "phase": "phase",
    "phase_sin": "phase",
    "phase_cos": "phase",
}
"""Term -> plain term that it is made of."""


def plain_contract(contract: Contract) -> Contract:
    """Return the contract of the same policy behind the adapter.

    Raises `PolicyError`: it observes a quantity that no plain term has, or moves its targets by the friction of the
    joints.
    """
    layout = contract.observation
    if contract.compensation is not None:
        raise PolicyError("this policy's runtime adds friction to its targets (compensation); no other runtime does")
    for term in layout.terms:
        if term.name in SLOW_TERMS or term.name == "height_scan":
            raise PolicyError(f"this policy observes {term.name}, which the runtimes of others do not build")
        if term.name == TERM and contract.known_friction is None:
            raise PolicyError("this policy observes its joints' friction, which is not known: export it with --joints")
    joints, length = contract.num_joints, layout.depth
    sizes = dict.fromkeys(("joint_position", "joint_velocity", "last_action"), joints)
    sizes |= {"phase": 2 * len(layout.clock.offsets) if layout.clock else 0}
    names = dict.fromkeys(PLAIN[term.name] for term in layout.terms if term.name in PLAIN)
    terms = tuple(
        Term(name, sizes.get(name, 3), 1.0, NO_CLIP, FRAMES[name], "standing" if name == "joint_position" else "none")
        for name in names
    )
    plain = ObservationLayout(terms, length, layout="term_major", fill=layout.fill, clock=layout.clock)
    return replace(contract, observation=plain, action_clip=UNBOUNDED, known_friction=None, known_friction_file=None)


def adapted(contract: Contract, network: NetworkFile) -> NetworkFile:
    """Return a policy's network behind the adapter, for the observation of `plain_contract`."""
    old, new = contract.observation, plain_contract(contract).observation
    ends = np.cumsum([term.size * new.depth for term in new.terms]).tolist()
    starts = {term.name: end - term.size * new.depth for term, end in zip(new.terms, ends, strict=True)}
    depth, attitude = new.depth, old.has("roll_pitch")
    pick = np.zeros((new.size + (2 * depth if attitude else 0), old.size))
    shift, bound = np.zeros(old.size), np.zeros(old.size)
    places = {int(source): place for place, source in enumerate(old.order())}
    column = 0
    for term in old.terms:
        for entry in range(term.size):
            for frame in range(old.depth):
                place = places.get(frame * old.frame_size + column + entry)
                # The history of this term is shorter than the longest.
                if place is None:
                    continue
                bound[place] = term.clips[entry]
                row, offset = _source(term, entry, frame, contract, starts, new)
                shift[place] = offset * term.scales[entry]
                if row is not None:
                    pick[row, place] = term.scales[entry]
        column += term.size
    # Attitude first, then for every number of the old input: pick, scale, shift, and the two bounds.
    nodes, constants, seen = _attitude(starts["projected_gravity"], new) if attitude else ([], {}, INPUT)
    constants |= {"a_pick": pick, "a_shift": shift, "a_low": -bound, "a_high": bound}
    nodes += [
        Node("MatMul", (seen, "a_pick"), ("a_picked",), {}),
        Node("Add", ("a_picked", "a_shift"), ("a_shifted",), {}),
        Node("Max", ("a_shifted", "a_low"), ("a_bounded",), {}),
        Node("Min", ("a_bounded", "a_high"), ("a_observation",), {}),
    ]
    nodes += with_names(network.nodes, {INPUT: "a_observation"})
    added = {name: constant(name, np.asarray(values, dtype=np.float32)) for name, values in constants.items()}
    port = Port(INPUT, FLOAT, (None, new.size))
    return clipped(contract, NetworkFile(tuple(nodes), {**network.constants, **added}, port, network.output))


def clipped(contract: Contract, network: NetworkFile) -> NetworkFile:
    """Return a policy's network with the clip of its action behind it, where it has one."""
    if contract.action_clip >= UNBOUNDED:
        return network
    bound = np.full(contract.num_joints, contract.action_clip, dtype=np.float32)
    nodes = (
        *with_names(network.nodes, {OUTPUT: "a_action"}),
        Node("Max", ("a_action", "a_least"), ("a_raised",), {}),
        Node("Min", ("a_raised", "a_most"), (OUTPUT,), {}),
    )
    bounds = {"a_least": constant("a_least", -bound), "a_most": constant("a_most", bound)}
    return replace(network, nodes=nodes, constants={**network.constants, **bounds})


def with_names(nodes: Sequence[Node], names: Mapping[str, str]) -> list[Node]:
    """Return nodes in which some values are renamed."""
    return [
        replace(
            node,
            inputs=tuple(names.get(name, name) for name in node.inputs),
            outputs=tuple(names.get(name, name) for name in node.outputs),
        )
        for node in nodes
    ]


def _source(
    term: Term, entry: int, frame: int, contract: Contract, starts: dict[str, int], new: ObservationLayout
) -> tuple[int | None, float]:
    """Return the index in the plain observation of an entry of a frame, None for none, and the number added to it.

    entry, frame: within the term, and from the oldest on.
    """
    if term.name in PLACEHOLDERS:
        return None, 0.0
    if term.name == FIRST_SIDE:
        return None, 1.0
    if term.name == TERM:
        known = contract.known_friction_array
        return None, 0.0 if known is None else float(known[entry])
    if term.name == "roll_pitch":
        return new.size + entry * new.depth + frame, 0.0
    clock = contract.observation.clock
    first = {"command_turn": 2, "phase_cos": len(clock.offsets) if clock else 0}
    name = PLAIN[term.name]
    size = next(other.size for other in new.terms if other.name == name)
    # The plain angles are about the standing pose; where the policy's are not, it is added again.
    shift = contract.standing[entry] if term.name == "joint_position" and term.offset == "none" else 0.0
    return starts[name] + frame * size + first.get(term.name, 0) + entry, shift


def _attitude(start: int, new: ObservationLayout) -> tuple[list[Node], dict[str, np.ndarray], str]:
    """Return nodes that append roll and pitch of every frame to the plain observation, their constants, and its name.

    start: where the direction of gravity begins in it.
    """
    depth = new.depth
    constants: dict[str, np.ndarray] = {
        "a_one": np.ones(1),
        "a_two": np.full(1, 2.0),
        "a_zero": np.zeros(1),
        "a_tiny": np.full(1, 1e-12),
    }
    for axis, name in enumerate("xyz"):
        chosen = np.zeros((new.size, depth))
        chosen[start + 3 * np.arange(depth) + axis, np.arange(depth)] = 1.0
        constants[f"a_axis_{name}"] = chosen
    steps = [
        *(("MatMul", INPUT, f"a_axis_{name}", f"a_{name}") for name in "xyz"),
        *(("Mul", f"a_{name}", f"a_{name}", f"a_{name}{name}") for name in "xyz"),
        ("Add", "a_yy", "a_zz", "a_across2"),
        ("Sqrt", "a_across2", "", "a_across"),
        ("Sub", "a_across", "a_z", "a_beside"),
        # A history of zeros has no direction of gravity: zero over zero is not finite.
        ("Add", "a_beside", "a_tiny", "a_half"),
        ("Neg", "a_y", "", "a_left"),
        ("Div", "a_left", "a_half", "a_roll_tangent"),
        ("Sub", "a_one", "a_xx", "a_rest2"),
        # Rounding may make g_x² larger than 1, and the root of what is left NaN.
        ("Max", "a_rest2", "a_zero", "a_rest1"),
        ("Sqrt", "a_rest1", "", "a_rest"),
        ("Add", "a_one", "a_rest", "a_below"),
        ("Div", "a_x", "a_below", "a_pitch_tangent"),
        *(("Atan", f"a_{name}_tangent", "", f"a_{name}_half") for name in ("roll", "pitch")),
        *(("Mul", f"a_{name}_half", "a_two", f"a_{name}") for name in ("roll", "pitch")),
    ]
    nodes = [
        Node(operator, (first, second) if second else (first,), (out,), {}) for operator, first, second, out in steps
    ]
    nodes.append(Node("Concat", (INPUT, "a_roll", "a_pitch"), ("a_seen",), {"axis": 1}))
    return nodes, constants, "a_seen"
