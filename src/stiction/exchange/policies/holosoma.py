"""Metadata of holosoma in an ONNX file: names of the joints, gains, and the range of commands; each as JSON.

Scales, pose, gait clock and the order of the terms are in the configuration of its runner, `holosoma-inference`, and
have to be stated; the runner sorts the terms by their names: actions, base_ang_vel, command_ang_vel, command_lin_vel,
cos_phase, dof_pos, dof_vel, projected_gravity, sin_phase.
"""

from __future__ import annotations

from collections.abc import Mapping

from stiction.exchange.policies.description import PolicySpec
from stiction.exchange.policies.values import take
from stiction.files.plain import parse_object


def is_holosoma(metadata: Mapping[str, str]) -> bool:
    """Return True if metadata of a network are holosoma's."""
    return {"dof_names", "kp", "kd"} <= metadata.keys()


def read_holosoma(metadata: Mapping[str, str], where: str) -> PolicySpec:
    """Return the description in the metadata; where: the file, for messages. Raises `FileError`, naming the entry."""

    def entry(name: str) -> object:
        return parse_object(f'{{"value": {metadata[name]}}}', f"{where}: {name}", "a list in JSON")["value"]

    notes = []
    if metadata.get("command_ranges", "null") != "null":
        ranges = take.mapping(entry("command_ranges"), f"{where}: command_ranges")
        commands = ", ".join(f"{name} {str(value)[:40]}" for name, value in list(ranges.items())[:8])
        notes.append(f"it was trained under commands of {commands}")
    return PolicySpec(
        joint_names=take.names(entry("dof_names"), f"{where}: dof_names"),
        kp=take.numbers(entry("kp"), f"{where}: kp"),
        kd=take.numbers(entry("kd"), f"{where}: kd"),
        notes=tuple(notes),
    )
