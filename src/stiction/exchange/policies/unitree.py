"""deploy.yaml of unitree_rl_lab, read and written.

Angles, scales and offsets are in the policy's order of the joints; gains are in the maker's, `joint_ids_map` has the
maker's number of each of the policy's joints. A term is cut off before it is scaled (`scale_first` turns that round),
frames are stacked term by term (`use_gym_history`: whole frames), the oldest first; the history begins with the first
frame. The last action is the network's output as it is; `clip` of the action is one of angles.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from stiction.core.errors import ConfigurationError, FileError, RobotError, unknown_name
from stiction.exchange.policies.description import PolicySpec, TermSpec, unsupported_part
from stiction.exchange.policies.values import take
from stiction.files.contract import Contract
from stiction.files.observation import NO_CLIP, GaitClock, ObservationLayout, Term

TERMS = {
    "base_ang_vel": "angular_velocity",
    "projected_gravity": "projected_gravity",
    # The same from the keyboard: the name in deploy.yaml files that were made for a simulation.
    "keyboard_velocity_commands": "command",
    "velocity_commands": "command",
    "joint_pos_rel": "joint_position",
    "joint_vel_rel": "joint_velocity",
    "last_action": "last_action",
    "gait_phase": "phase",
}
"""Name in unitree_rl_lab -> ours."""

THEIR_NAMES = {ours: theirs for theirs, ours in TERMS.items()}

WIDE = 10.0
"""Angle that no joint of a legged robot reaches [rad]: clips from there on, as of unitree_rl_lab's Go2, cut nothing."""

SWITCHES = ("scale_first", "use_gym_history")
"""Entries among the observations that are not terms."""


def is_deploy(content: Mapping[str, Any]) -> bool:
    """Return True if a YAML file is a deploy.yaml."""
    return {"step_dt", "observations"} <= content.keys()


def read_deploy(content: Mapping[str, Any], where: str, maker: Sequence[str] | None) -> PolicySpec:
    """Return the description in a deploy.yaml.

    Args:
        content: of the file.
        where: the file, for messages.
        maker: joints in the maker's order; None: unknown.

    Raises `StictionError`, naming the entry.

    """
    entry = f"{where}: joint_ids_map"
    ids = [take.whole(item, entry) for item in take.sequence(content.get("joint_ids_map"), entry)]
    if maker is None:
        raise RobotError(
            f"{where} numbers the joints as their maker does, and the robot's file does not say that order; say "
            "vendor: {order: [...]} in robot.yaml"
        )
    if not ids or not all(0 <= number < len(maker) for number in ids) or len(set(ids)) != len(ids):
        raise FileError(f"{entry} is {ids}; expected different numbers from 0 to {len(maker) - 1}")
    gains = {name: take.numbers(content.get(name), f"{where}: {name}") for name in ("stiffness", "damping")}
    if any(len(values) <= max(ids) for values in gains.values()):
        raise FileError(f"{where}: stiffness and damping have {len(gains['stiffness'])} and {len(gains['damping'])} "
                        f"numbers; expected one for each of the maker's joints up to {max(ids)}")  # fmt: skip
    pose = take.numbers(content.get("default_joint_pos"), f"{where}: default_joint_pos", len(ids))
    terms, clock, history = _observations(take.mapping(content["observations"], f"{where}: observations"), where)
    return PolicySpec(
        joint_names=tuple(maker[number] for number in ids),
        control_period=take.number(content["step_dt"], f"{where}: step_dt"),
        kp=tuple(gains["stiffness"][number] for number in ids),
        kd=tuple(gains["damping"][number] for number in ids),
        default_position=pose,
        action_scale=_action_scale(take.mapping(content.get("actions"), f"{where}: actions"), pose, where),
        action_clip=math.inf,
        last_action="raw",
        observation=terms,
        clock=clock,
        **history,
    )


def _action_scale(content: Mapping[str, Any], pose: tuple[float, ...], where: str) -> tuple[float, ...]:
    """Return the scale of the action; reject other actions than angles of all joints about the pose."""
    if list(content) != ["JointPositionAction"]:
        raise ConfigurationError(f"{where}: the actions are {', '.join(content)}; expected JointPositionAction alone")
    action = take.mapping(content["JointPositionAction"], f"{where}: JointPositionAction")
    for bounds in take.sequence(action.get("clip") or [], f"{where}: clip"):
        low, high = take.numbers(bounds, f"{where}: clip", 2)
        if low > -WIDE or high < WIDE:
            raise ConfigurationError(
                f"{where}: JointPositionAction: got clip {low:g} to {high:g} rad, expected null or {WIDE:g} rad and "
                "more either way; a contract cuts no angles off"
            )
    if action.get("joint_ids") is not None:
        raise ConfigurationError(f"{where}: JointPositionAction has joint_ids, a part of the joints, which a contract "
                                 "does not hold")  # fmt: skip
    offset = take.numbers(action.get("offset"), f"{where}: offset", len(pose))
    if any(abs(shift - angle) > 1e-6 for shift, angle in zip(offset, pose, strict=True)):
        raise ConfigurationError(f"{where}: the action's offset is not default_joint_pos; a contract holds one pose")
    return take.numbers(action.get("scale"), f"{where}: scale", len(pose))


def _observations(
    content: Mapping[str, Any], where: str
) -> tuple[tuple[TermSpec, ...], GaitClock | None, dict[str, Any]]:
    """Return the terms, the gait clock where one is observed, and the stacking of frames."""
    switches = {name: content.get(name, False) for name in SWITCHES}
    if not all(isinstance(value, bool) for value in switches.values()):
        raise FileError(
            f"{where}: observations: {', '.join(SWITCHES)} are {list(switches.values())}; expected true or false"
        )
    terms, clock = [], None
    for name, entry in content.items():
        if name in SWITCHES:
            continue
        place = f"{where}: observations: {name}"
        if name not in TERMS:
            raise ConfigurationError(f"{where}: {unknown_name('observation term', name, TERMS)}; or it is a group: "
                                     "one group of observations is read")  # fmt: skip
        fields = take.mapping(entry, place)
        parameters = take.mapping(fields.get("params") or {}, f"{place}: params")
        if name == "gait_phase":
            clock = GaitClock(take.number(parameters.get("period"), f"{place}: period"), (0.0,), first=1)
        elif set(parameters) - {"command_name"}:
            raise ConfigurationError(f"{place}: params {', '.join(parameters)}: a part of the joints is not read")
        terms.append(
            TermSpec(
                TERMS[name],
                scale=take.one_or_all(fields["scale"], f"{place}: scale") if fields.get("scale") is not None else 1.0,
                clip=take.bounds(fields.get("clip"), f"{place}: clip"),
                clip_first=not switches["scale_first"],
                history=take.whole(fields.get("history_length", 1), f"{place}: history_length"),
            )
        )
    frames = switches["use_gym_history"]
    history = {
        "history_length": (terms[0].history or 1) if frames and terms else 1,
        "history_layout": "frame_major" if frames else "term_major",
        "history_direction": "oldest_first",
        "history_fill": "first",
    }
    return tuple(terms), clock, history


def limitation(layout: ObservationLayout) -> str | None:
    """Return the part of a layout that a deploy.yaml cannot hold, or None."""
    for term in layout.terms:
        if (odd := unsupported_part(term, THEIR_NAMES)) is not None:
            return odd
        if isinstance(term.clip, tuple):
            return f"different clips within {term.name}"
    clock = layout.clock
    if clock is not None and (clock.offsets != (0.0,) or clock.standing is not None or clock.first != 1):
        return "a gait clock with several phases, or one that does not run from its first step on"
    return None if layout.depth == 1 or layout.direction == "oldest_first" else "the newest frame first"


RANGES = ("lin_vel_x", "lin_vel_y", "ang_vel_z")
"""Names of the ranges of the commands."""


def deploy_of(contract: Contract, commands: Sequence[float]) -> dict[str, Any]:
    """Return the content of the deploy.yaml of a policy whose layout it holds.

    commands: largest command forward, sideways [m/s], turn [rad/s], to which its runner keeps.

    Raises `RobotError` where the maker's order of the joints is not known, or turns or shifts angles.
    """
    robot, layout = contract.anatomy, contract.observation
    if robot is None or robot.vendor is None:
        raise RobotError(
            f"the maker's order of the joints of {contract.robot!r} is not in the contract, and a deploy.yaml numbers "
            "joints in it; say vendor in robot.yaml, and export the bundle again"
        )
    vendor = robot.vendor
    if set(vendor.sign) != {1.0} or any(vendor.offset):
        raise RobotError(f"the maker of {robot.name!r} turns or shifts angles of joints; a deploy.yaml cannot say that")
    held = {joint.name for joint in robot.held}
    if held:
        raise RobotError(
            f"{', '.join(sorted(held)[:6])} of {robot.name!r} are held while this policy walks; a deploy.yaml has "
            "gains and targets for the policy's joints alone, and would let them hang"
        )
    ids = [vendor.order.index(name) for name in contract.joint_names]
    numbers = [contract.joint_names.index(name) for name in vendor.order]
    # One for each joint, also where the contract has one for all.
    scale = (contract.array("standing") * 0 + contract.scale).tolist()
    # A clip after the scale is one before it, divided; where scales differ within a term it has to stay behind.
    clip_last = any((term.clips < NO_CLIP).any() and isinstance(term.scale, tuple) for term in layout.terms)
    observations: dict[str, Any] = {THEIR_NAMES[term.name]: _entry(term, layout, clip_last) for term in layout.terms}
    if clip_last:
        observations["scale_first"] = True
    if layout.depth > 1 and layout.layout == "frame_major":
        observations["use_gym_history"] = True
    ranges: dict[str, Any] = {name: [-float(most), float(most)] for name, most in zip(RANGES, commands, strict=True)}
    return {
        "joint_ids_map": ids,
        "step_dt": contract.control_period,
        "stiffness": [contract.kp[number] for number in numbers],
        "damping": [contract.kd[number] for number in numbers],
        "default_joint_pos": list(contract.standing),
        "commands": {"base_velocity": {"ranges": ranges | {"heading": None}}},
        "actions": {
            "JointPositionAction": {
                "clip": None,
                "joint_names": [".*"],
                "scale": scale,
                "offset": list(contract.standing),
                "joint_ids": None,
            }
        },
        "observations": observations,
    }


def _entry(term: Term, layout: ObservationLayout, clip_last: bool) -> dict[str, Any]:
    """Return one term as a deploy.yaml has it."""
    clip = None
    if term.clips[0] < NO_CLIP:
        bound = float(term.clips[0] if clip_last else term.clips[0] / term.scales[0])
        clip = [-bound, bound]
    parameters: dict[str, Any] = {"command_name": "base_velocity"} if term.name == "command" else {}
    if term.name == "phase" and layout.clock is not None:
        parameters = {"period": layout.clock.period}
    return {
        "params": parameters,
        "clip": clip,
        "scale": term.scales.tolist(),
        "history_length": layout.history_of(term),
    }
