"""rl_sar's config.yaml and base.yaml of a policy, read and written.

Numbers are in the policy's order of the joints; joint i of the policy is `joint_names[joint_mapping[i]]`. Terms are
scaled, and then all are cut off at `clip_obs`. `observations_history` lists the frames, 0 is the newest; they are
stacked as whole frames (priority `time`) or term by term (`term`); what is before the first frame is zero. The last
action is the one after the clip. Whatever the frame of the robot's gyroscope, `ang_vel` reaches the network in that of
the base.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stiction.core.errors import ConfigurationError, FileError, unknown_name
from stiction.exchange.policies.description import UNBOUNDED, PolicySpec, TermSpec, unsupported_part
from stiction.exchange.policies.values import take
from stiction.files.contract import Contract
from stiction.files.observation import NO_CLIP, GaitClock, ObservationLayout

TERMS = {
    "lin_vel": "base_linear_velocity",
    "ang_vel": "angular_velocity",
    "ang_vel_body": "angular_velocity",
    "ang_vel_world": "angular_velocity",
    "gravity_vec": "projected_gravity",
    "commands": "command",
    "dof_pos": "joint_position",
    "dof_vel": "joint_velocity",
    "actions": "last_action",
    "g1_phase": "phase",
}
"""Name in rl_sar -> ours."""

THEIR_NAMES = {ours: theirs for theirs, ours in TERMS.items()} | {"angular_velocity": "ang_vel"}

SCALES = {
    "base_linear_velocity": "lin_vel_scale",
    "angular_velocity": "ang_vel_scale",
    "command": "commands_scale",
    "joint_position": "dof_pos_scale",
    "joint_velocity": "dof_vel_scale",
}
"""Term -> the entry with its scale; others are not scaled."""

G1_CLOCK = GaitClock(0.8, (0.0,))
"""The clock behind `g1_phase`, whose period is written into rl_sar."""


def is_rl_sar(content: Mapping[str, Any]) -> bool:
    """Return True if a YAML file is a config.yaml or base.yaml of rl_sar: one robot, or policy, with entries."""
    inner = list(content.values())
    known = {"rl_kp", "num_of_dofs", "observations_history", "joint_mapping"}
    return len(inner) == 1 and isinstance(inner[0], Mapping) and bool(known & inner[0].keys())


def entries_of(content: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return the entries of a config.yaml or base.yaml, without the name above them."""
    return dict(take.mapping(next(iter(content.values())), where))


def read_rl_sar(entries: Mapping[str, Any], where: str) -> PolicySpec:
    """Return the description in config.yaml and base.yaml together; where: the files. Raises `StictionError`."""

    def vector(name: str, count: int | None = None) -> tuple[float, ...] | None:
        return None if name not in entries else take.numbers(entries[name], f"{where}: {name}", count)

    if entries.get("wheel_indices"):
        raise ConfigurationError(f"{where}: wheel_indices: wheels, which are driven by velocity, are not read")
    fields: dict[str, Any] = {}
    pose = vector("default_dof_pos")
    if "joint_names" in entries and pose is not None:
        names = take.names(entries["joint_names"], f"{where}: joint_names")
        mapping = entries.get("joint_mapping", list(range(len(pose))))
        order = [
            take.whole(item, f"{where}: joint_mapping") for item in take.sequence(mapping, f"{where}: joint_mapping")
        ]
        if len(set(order)) != len(pose) or not all(0 <= number < len(names) for number in order):
            raise FileError(
                f"{where}: joint_mapping is {order}; expected {len(pose)} different numbers under {len(names)}"
            )
        fields["joint_names"] = tuple(names[number] for number in order)
    if "dt" in entries:
        step = take.number(entries["dt"], f"{where}: dt")
        fields["physics_timestep"] = step
        fields["control_period"] = step * take.whole(entries.get("decimation"), f"{where}: decimation")
    for field, name in (("kp", "rl_kp"), ("kd", "rl_kd"), ("torque_limit", "torque_limits")):
        fields[field] = vector(name)
    fields["default_position"] = pose
    if "action_scale" in entries:
        fields["action_scale"] = take.one_or_all(entries["action_scale"], f"{where}: action_scale")
    if "clip_actions_upper" in entries:
        fields |= {"action_clip": _action_clip(entries, where), "last_action": "clipped"}
    if "observations" in entries:
        fields |= _observations(entries, where)
    note = "rl_sar begins with a history of zeros; whether the training did is not in its files"
    return PolicySpec(**fields, notes=(note,) if fields.get("history_length", 1) > 1 else ())


def _action_clip(entries: Mapping[str, Any], where: str) -> float:
    """Return the bound of the action, the same for all joints and both ways."""
    upper, lower = (
        take.numbers(entries.get(f"clip_actions_{side}"), f"{where}: clip_actions_{side}")
        for side in ("upper", "lower")
    )
    bounds = {abs(value) for value in (*upper, *lower)}
    if not upper or not lower or len(bounds) != 1 or min(upper) <= 0 or max(lower) >= 0:
        raise ConfigurationError(
            f"{where}: clip_actions are {sorted(bounds)[:6]}; a contract holds one bound of all actions, both ways"
        )
    return bounds.pop()


def _observations(entries: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return the terms, and the stacking of frames."""
    clip = take.number(entries.get("clip_obs", NO_CLIP), f"{where}: clip_obs")
    terms: list[TermSpec] = []
    for name in take.names(entries["observations"], f"{where}: observations"):
        if name not in TERMS:
            raise ConfigurationError(f"{where}: {unknown_name('observation term', name, TERMS)}")
        scale: float | tuple[float, ...] = 1.0
        if (entry := SCALES.get(TERMS[name])) is not None:
            if entry not in entries:
                raise FileError(f"{where}: {entry!r} is missing, the scale of {name}")
            scale = take.one_or_all(entries[entry], f"{where}: {entry}")
        terms.append(TermSpec(TERMS[name], scale=scale, clip=(-clip, clip)))
    stacking: dict[str, Any] = {"observation": tuple(terms), "history_fill": "zero"}
    if any(term.name == "phase" for term in terms):
        stacking["clock"] = G1_CLOCK
    listed = entries.get("observations_history") or [0]
    frames = [take.whole(item, f"{where}: observations_history") for item in take.sequence(listed, where)]
    # A single frame is both; it is called the newest first.
    newest_first = frames == list(range(len(frames)))
    if not newest_first and frames != list(range(len(frames)))[::-1]:
        raise ConfigurationError(
            f"{where}: observations_history is {frames}; expected every frame from 0 on, up or down"
        )
    priority = take.choice(entries.get("observations_history_priority", "time"), f"{where}: priority", "time", "term")
    return stacking | {
        "history_length": len(frames),
        "history_layout": "frame_major" if priority == "time" else "term_major",
        "history_direction": "newest_first" if newest_first else "oldest_first",
    }


def limitation(layout: ObservationLayout) -> str | None:
    """Return the part of a layout that rl_sar cannot hold, or None."""
    for term in layout.terms:
        if (odd := unsupported_part(term, THEIR_NAMES)) is not None:
            return odd
        if layout.history_of(term) != layout.history_length:
            return "histories of different lengths"
        if term.name not in SCALES and not np.array_equal(term.scales, np.ones(term.size)):
            return f"a scale of {term.name}"
        if isinstance(term.scale, tuple) and term.name != "command":
            return f"different scales within {term.name}"
    if layout.clock not in (None, G1_CLOCK):
        return "another gait clock than that of 0.8 s"
    clips = {float(clip) for term in layout.terms for clip in term.clips}
    return None if len(clips) == 1 else "different clips of terms"


def config_of(contract: Contract, model: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the entries of base.yaml and config.yaml of a policy whose layout rl_sar holds; model: its file's name."""
    layout, joints = contract.observation, contract.num_joints
    bound = min(contract.action_clip, UNBOUNDED)
    vendor = None if contract.anatomy is None else contract.anatomy.vendor
    names = contract.joint_names if vendor is None else vendor.order
    scales = {name: [1.0] * 3 if name == "commands_scale" else 1.0 for name in SCALES.values()}
    for term in layout.terms:
        if (entry := SCALES.get(term.name)) is not None:
            scales[entry] = term.scales.tolist() if entry == "commands_scale" else float(term.scales[0])
    frames = list(range(layout.history_length))
    length = layout.history_length
    base = {
        "dt": contract.physics_timestep,
        "decimation": contract.decimation,
        "num_of_dofs": joints,
        "wheel_indices": [],
        "torque_limits": list(contract.torque_limit),
        "fixed_kp": list(contract.kp),
        "fixed_kd": list(contract.kd),
        "default_dof_pos": list(contract.standing),
        "joint_names": list(names),
        "joint_mapping": [list(names).index(name) for name in contract.joint_names],
    }
    config = {
        "model_name": model,
        "num_observations": layout.frame_size,
        "observations": [THEIR_NAMES[term.name] for term in layout.terms],
        "observations_history": [] if length == 1 else frames if layout.direction == "newest_first" else frames[::-1],
        "observations_history_priority": "time" if layout.layout == "frame_major" else "term",
        "clip_obs": float(layout.terms[0].clips[0]),
        "clip_actions_lower": [-bound] * joints,
        "clip_actions_upper": [bound] * joints,
        "rl_kp": list(contract.kp),
        "rl_kd": list(contract.kd),
        # One for each joint, also where the contract has one for all.
        "action_scale": (contract.array("standing") * 0 + contract.scale).tolist(),
        **scales,
        **{name: base[name] for name in ("num_of_dofs", "wheel_indices", "torque_limits", "fixed_kp", "fixed_kd")},
        **{name: base[name] for name in ("default_dof_pos", "joint_mapping")},
    }
    return base, config
