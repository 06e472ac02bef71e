"""mjlab's metadata in an ONNX file, read and written: lists as text with commas, lists in lists with semicolons.

mjlab cuts a term off before it scales it, stacks term by term, the oldest frame first, and fills the history with the
first frame. Its own exporter rounds to three decimals. Period, clip of the action and the meaning of users' own terms
are not in the file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from stiction.core.errors import ConfigurationError, FileError, unknown_name
from stiction.exchange.policies.description import PolicySpec, TermSpec, unsupported_part
from stiction.exchange.policies.values import take
from stiction.files.contract import Contract
from stiction.files.observation import NO_CLIP, ObservationLayout, Term

TERMS = {
    "base_lin_vel": "base_linear_velocity",
    "base_ang_vel": "angular_velocity",
    "projected_gravity": "projected_gravity",
    "joint_pos": "joint_position",
    "joint_vel": "joint_velocity",
    "actions": "last_action",
    "command": "command",
    "height_scan": "height_scan",
}
"""Name in mjlab's velocity task -> ours."""

THEIR_NAMES = {ours: theirs for theirs, ours in TERMS.items()}


def is_mjlab(metadata: Mapping[str, str]) -> bool:
    """Return True if metadata of a network are mjlab's."""
    return {"joint_names", "joint_stiffness", "observation_names"} <= metadata.keys()


def read_mjlab(metadata: Mapping[str, str], where: str) -> PolicySpec:
    """Return the description in the metadata; where: the file, for messages. Raises `StictionError` with the entry."""

    def entries(name: str) -> list[str]:
        if name not in metadata:
            raise FileError(f"{where}: the metadata have no {name!r}; mjlab 1.6 writes it: export it again")
        return metadata[name].split(",") if metadata[name] else []

    def numbers(name: str) -> tuple[float, ...]:
        return tuple(take.infinite(text, f"{where}: {name}") for text in entries(name))

    observed = entries("observation_names")
    columns = {name: entries(f"observation_terms_{name}") for name in ("scale", "clip", "history_length")}
    for name, column in columns.items():
        if len(column) != len(observed):
            raise FileError(f"{where}: observation_terms_{name} has {len(column)} entries for {len(observed)} terms")
    if "command" in observed and (commands := entries("command_names")) != ["twist"]:
        raise ConfigurationError(
            f"{where}: the command is {', '.join(commands)}; expected twist alone: forward, sideways, turn"
        )
    action_scale = numbers("action_scale")
    return PolicySpec(
        joint_names=tuple(entries("joint_names")),
        kp=numbers("joint_stiffness"),
        kd=numbers("joint_damping"),
        default_position=numbers("default_joint_pos"),
        action_scale=action_scale if len(action_scale) > 1 else action_scale[0],
        observation=tuple(
            _term(name, scale, clip, history, where)
            for name, scale, clip, history in zip(observed, *columns.values(), strict=True)
        ),
        history_length=1,
        history_layout="term_major",
        history_direction="oldest_first",
        history_fill="first",
    )


def _term(name: str, scale: str, clip: str, history: str, where: str) -> TermSpec:
    """Return one term of the observation."""
    if name not in TERMS:
        raise ConfigurationError(
            f"{where}: {unknown_name('observation term', name, TERMS)}; where it is one of ours by another name, say "
            "the whole observation with --settings"
        )
    scales = tuple(take.infinite(text, f"{where}: scale of {name}") for text in scale.split(";"))
    ends = tuple(take.infinite(text, f"{where}: clip of {name}") for text in clip.split(";"))
    if len(ends) != 2:
        raise FileError(f"{where}: clip of {name} is {clip[:40]!r}; expected the lowest and the highest value")
    return TermSpec(
        TERMS[name],
        scale=scales[0] if len(set(scales)) == 1 else scales,
        clip=(ends[0], ends[1]),
        clip_first=True,
        # Zero is mjlab's word for no history.
        history=max(1, round(take.infinite(history, f"{where}: history_length of {name}"))),
    )


def limitation(layout: ObservationLayout) -> str | None:
    """Return the part of a layout that mjlab's metadata cannot hold, or None."""
    for term in layout.terms:
        if (odd := unsupported_part(term, THEIR_NAMES)) is not None:
            return odd
        if (term.clips < NO_CLIP).any() and (isinstance(term.scale, tuple) or isinstance(term.clip, tuple)):
            return f"a clip after different scales of {term.name}"
    if layout.heights is not None:
        return "the points of a height scan"
    if layout.depth > 1 and layout.layout != "term_major":
        return "whole frames one after the other"
    return None if layout.depth == 1 or layout.direction == "oldest_first" else "the newest frame first"


def metadata_of(contract: Contract) -> dict[str, str]:
    """Return mjlab's metadata of a policy whose layout they hold."""
    layout = contract.observation

    def joined(items: Sequence[float]) -> str:
        return ",".join(map(repr, map(float, items)))

    def each(parts: Sequence[Sequence[float]]) -> str:
        return ",".join(";".join(map(repr, map(float, part))) for part in parts)

    def clip(term: Term) -> tuple[float, float]:
        bound = float(term.clips[0] / term.scales[0]) if term.clips[0] < NO_CLIP else math.inf
        return -bound, bound

    return {
        "run_path": "stiction",
        "joint_names": ",".join(contract.joint_names),
        "joint_stiffness": joined(contract.kp),
        "joint_damping": joined(contract.kd),
        "default_joint_pos": joined(contract.standing),
        "command_names": "twist",
        "observation_names": ",".join(THEIR_NAMES[term.name] for term in layout.terms),
        "observation_terms_scale": each(
            [term.scales.tolist() if isinstance(term.scale, tuple) else [float(term.scale)] for term in layout.terms]
        ),
        "observation_terms_flatten_history_dim": ",".join("True" for _ in layout.terms),
        "observation_terms_history_length": ",".join(
            str(layout.history_of(term) if layout.history_of(term) > 1 else 0) for term in layout.terms
        ),
        "observation_terms_clip": each([clip(term) for term in layout.terms]),
        # One for each joint, also where the contract has one for all.
        "action_scale": joined((contract.array("standing") * 0 + contract.scale).tolist()),
    }
