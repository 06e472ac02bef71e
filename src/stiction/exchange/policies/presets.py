"""Settings of five trainers' standard velocity tasks, for networks whose files lack them: data, a `Preset` each.

Read in public configurations: Isaac Lab 2.3 (`velocity_env_cfg`, A1, Go1, Go2), mjlab 1.6 (`velocity_env_cfg`, Go1),
legged_gym (`legged_robot_config`, A1) with Go2 of unitree_rl_gym, unitree_rl_lab (Go2, B2), and rl_sar's files of
robot_lab's policies (Go2, B2). No term is a quaternion: attitude is the direction of gravity in the base's frame, so
that Isaac Gym's x, y, z, w and the others' w, x, y, z do not matter. A preset only fills gaps; every field that it
fills is named to the user, with its value, and in the contract.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from stiction.core.errors import ConfigurationError
from stiction.exchange.policies.description import PolicySpec, TermSpec, layout_of, needed
from stiction.files.observation import HeightScan
from stiction.robots.model import Robot
from stiction.robots.record import Derived

BREADTH, DEPTH, FILE, MAKER = (
    "breadth first from the base, siblings by name",
    "leg by leg from the base, siblings by name",
    "as in the robot's file",
    "the maker's order",
)
"""Orders of joints."""

OF_ROBOT = ("kp", "kd", "default_position", "action_scale")
"""Fields that a robot's file may state, in place of a trainer's table."""


@dataclass(frozen=True)
class Preset:
    """Standard velocity task of one trainer."""

    tasks: str
    """Names of the tasks, for messages."""
    order: str
    """Order of the joints in action and observation."""
    settings: PolicySpec
    """Settings of all robots."""
    observations: Mapping[str, tuple[TermSpec, ...]]
    """Layouts of one frame, by the kind of task."""
    robots: Mapping[str, PolicySpec] = field(default_factory=dict)
    """Pose, gains and scale of the action of robots that come with the trainer."""
    rules: bool = False
    """True if gains and scale of the action follow from armature and torque limit by the rule of `robots.derive`."""


def _grid(forward_first: bool) -> tuple[tuple[float, float], ...]:
    """Return the 17 x 11 points of a height scan of 1.6 m x 1 m, from behind on the right [m]."""
    forward, left = ([round(0.1 * n, 1) for n in range(-most, most + 1)] for most in (8, 5))
    if forward_first:
        return tuple((x, y) for y in left for x in forward)
    return tuple((x, y) for x in forward for y in left)


POSE = {
    **{".*L_hip_joint": 0.1, ".*R_hip_joint": -0.1, "F._thigh_joint": 0.8, "R._thigh_joint": 1.0},
    ".*_calf_joint": -1.5,
}
"""Standing pose of Unitree's quadrupeds in Isaac Lab, legged_gym and unitree_rl_lab [rad]."""

RL_SAR_POSE = {".*_hip_joint": 0.0, ".*_thigh_joint": 0.8, ".*_calf_joint": -1.5}
RL_SAR_SCALE = {".*_hip_joint": 0.125, ".*": 0.25}
MJLAB_GO1 = PolicySpec(
    kp={".*_calf_joint": 35.764, ".*": 15.895},
    kd={".*_calf_joint": 2.2768, ".*": 1.0119},
    default_position={
        **{".*L_hip_joint": -0.1, ".*R_hip_joint": 0.1},
        **{".*_thigh_joint": 0.9, ".*_calf_joint": -1.8},
    },
    action_scale={".*_calf_joint": 0.2485, ".*": 0.3728},
)
"""Rotors of 0.000111842 kg m² behind gears of 6 and 9, by mjlab's rule."""

AT_50_HZ = PolicySpec(control_period=0.02, physics_timestep=0.005)
STACKED = replace(AT_50_HZ, history_layout="term_major", history_direction="oldest_first", history_fill="first")
UNCLIPPED = replace(STACKED, action_clip=math.inf, last_action="clipped")
"""Action that the wrapper of rsl_rl cuts off before the environment sees it, only if it is configured to."""


def _terms(*names: str, **scales: float | tuple[float, ...]) -> tuple[TermSpec, ...]:
    """Return terms without a clip."""
    return tuple(TermSpec(name, scale=scales.get(name, 1.0)) for name in names)


def _clipped(terms: tuple[TermSpec, ...], first: bool) -> tuple[TermSpec, ...]:
    """Return terms that are cut off at 100; first: before the scale."""
    return tuple(replace(term, clip=(-100.0, 100.0), clip_first=first) for term in terms)


JOINTS = ("joint_position", "joint_velocity", "last_action")
BLIND = ("angular_velocity", "projected_gravity", "command", *JOINTS)
ISAACLAB = _terms("base_linear_velocity", *BLIND)
MJLAB = _terms("base_linear_velocity", "angular_velocity", "projected_gravity", *JOINTS, "command")
LEGGED_GYM = _clipped(
    _terms(
        *("base_linear_velocity", *BLIND),
        base_linear_velocity=2.0,
        angular_velocity=0.25,
        command=(2.0, 2.0, 0.25),
        joint_velocity=0.05,
    ),
    first=False,
)
ROUGH, FLAT = "rough, with a height scan of 17 x 11", "flat"

PRESETS: Mapping[str, Preset] = {
    "isaaclab": Preset(
        "Isaac-Velocity-Flat and -Rough of Isaac Lab",
        BREADTH,
        replace(UNCLIPPED, action_scale=0.5, heights=HeightScan(_grid(forward_first=True), 0.5)),
        {FLAT: ISAACLAB, ROUGH: (*ISAACLAB, TermSpec("height_scan", clip=(-1.0, 1.0)))},
        {
            **dict.fromkeys(("a1", "go2"), PolicySpec(kp=25.0, kd=0.5, default_position=POSE, action_scale=0.25)),
            # Its motors are an Actuator Net there, which has no gains.
            "go1": PolicySpec(default_position=POSE, action_scale=0.25),
        },
    ),
    "legged_gym": Preset(
        "legged_gym's velocity task, flat or rough",
        DEPTH,
        replace(
            AT_50_HZ,
            action_scale=0.5,
            action_clip=100.0,
            last_action="clipped",
            history_length=1,
            heights=HeightScan(_grid(forward_first=False), 0.5),
        ),
        {
            FLAT: LEGGED_GYM,
            ROUGH: (*LEGGED_GYM, TermSpec("height_scan", scale=5.0, clip=(-1.0, 1.0), clip_first=True)),
        },
        dict.fromkeys(("a1", "go2"), PolicySpec(kp=20.0, kd=0.5, default_position=POSE, action_scale=0.25)),
    ),
    "mjlab": Preset(
        "Mjlab-Velocity-Flat and -Rough",
        FILE,
        replace(UNCLIPPED, heights=HeightScan(_grid(forward_first=True))),
        {FLAT: MJLAB, ROUGH: (*MJLAB, TermSpec("height_scan", scale=0.2))},
        {"go1": MJLAB_GO1},
        rules=True,
    ),
    "rl_sar": Preset(
        "rl_sar with a policy of robot_lab",
        MAKER,
        replace(AT_50_HZ, action_clip=100.0, last_action="clipped", history_fill="zero"),
        {FLAT: _clipped(_terms(*BLIND, angular_velocity=0.25, joint_velocity=0.05), first=False)},
        {
            "go2": PolicySpec(
                kp=20.0, kd=0.5, default_position=RL_SAR_POSE, action_scale=RL_SAR_SCALE, torque_limit=23.5
            ),
            "b2": PolicySpec(
                kp=160.0,
                kd=5.0,
                default_position=RL_SAR_POSE,
                action_scale=RL_SAR_SCALE,
                torque_limit={".*_calf_joint": 320.0, ".*": 200.0},
            ),
        },
    ),
    "unitree": Preset(
        "Unitree-Velocity of unitree_rl_lab",
        BREADTH,
        replace(STACKED, action_scale=0.25, action_clip=math.inf, last_action="raw"),
        {FLAT: _clipped(_terms(*BLIND, angular_velocity=0.2, joint_velocity=0.05), first=True)},
        {
            "go2": PolicySpec(kp=25.0, kd=0.5, default_position=POSE),
            "b2": PolicySpec(kp=160.0, kd=5.0, default_position=POSE),
        },
    ),
}
"""Name for `--preset` -> the task."""


def by_breadth(robot: Robot) -> tuple[str, ...]:
    """Return the driven joints level by level from the base, those of one parent by their names."""
    order, level = [], _children(robot, (-1,))
    while level:
        order += level
        level = _children(robot, level)
    return tuple(robot.joint_names[number] for number in order)


def by_depth(robot: Robot) -> tuple[str, ...]:
    """Return the driven joints limb by limb from the base, those of one parent by their names."""
    order: list[int] = []
    waiting = _children(robot, (-1,))
    while waiting:
        order.append(waiting.pop(0))
        waiting = _children(robot, order[-1:]) + waiting
    return tuple(robot.joint_names[number] for number in order)


def _children(robot: Robot, parents: tuple[int, ...] | list[int]) -> list[int]:
    """Return the joints that hang on others, in the others' order; -1: the base."""
    names = robot.joint_names
    return [
        number
        for parent in parents
        for number in sorted(range(robot.num_joints), key=names.__getitem__)
        if robot.links[number].parent == parent
    ]


def _by_maker(robot: Robot) -> tuple[str, ...] | None:
    """Return the driven joints in the maker's order; None where that is unknown."""
    if robot.vendor is None:
        return None
    return tuple(name for name in robot.vendor.order if name in robot.joint_names)


ORDERS: Mapping[str, Callable[[Robot], tuple[str, ...] | None]] = {
    BREADTH: by_breadth,
    DEPTH: by_depth,
    FILE: lambda robot: robot.joint_names,
    MAKER: _by_maker,
}
"""Order -> names of a robot's driven joints."""


def with_preset(spec: PolicySpec, name: str, derived: Derived, size: int, num_actions: int) -> PolicySpec:
    """Return the description of a policy with its gaps filled by a preset, and a note on each with its source.

    Args:
        spec: description of the policy, by its metadata and settings.
        name: of the preset.
        derived: the robot, with the origins of its values.
        size: numbers that the network takes.
        num_actions: actions that it gives.

    Raises `ConfigurationError` where no layout of the preset has the network's size.

    """
    preset, robot = PRESETS[name], derived.robot
    layers = (
        (preset.order, PolicySpec(joint_names=ORDERS[preset.order](robot))),
        (f"its {robot.name}", preset.robots.get(robot.name, PolicySpec())),
        (f"the robot's file{', or by rule from armature and torque limit' * preset.rules}", _of_file(derived, preset)),
        (preset.tasks, preset.settings),
    )
    filled = spec
    why: dict[str, str] = {}
    for source, layer in layers:
        values = {part.name: getattr(layer, part.name) for part in fields(PolicySpec) if part.name != "notes"}
        gaps = {key: value for key, value in values.items() if value is not None and getattr(filled, key) is None}
        filled, why = replace(filled, **gaps), why | dict.fromkeys(gaps, source)
    if filled.observation is None:
        kind, terms = _layout(filled, name, size, num_actions)
        filled, why = replace(filled, observation=terms), why | {"observation": kind}
    used = (*needed(filled), "physics_timestep", "torque_limit")
    told = {key: source for key, source in why.items() if key in used}
    notes = [
        f"--preset {name} assumes {key} {_text(getattr(filled, key))} ({source})" for key, source in told.items()
    ] or [f"--preset {name} assumes nothing: the files say all"]
    assumed = {"preset": name, "assumed": ", ".join(told)} if told else None
    return replace(filled, assumed=assumed, notes=(*spec.notes, *notes))


def _of_file(derived: Derived, preset: Preset) -> PolicySpec:
    """Return gains, pose and scale of the action that a robot's file states for all joints, and those by rule."""
    values: dict[str, Any] = {}
    for name in OF_ROBOT:
        origins = [origin for origin in derived.origins if origin.field == name]
        stated = {origin.subject for origin in origins if preset.rules or not origin.source.startswith("rule")}
        if stated >= set(derived.robot.joint_names):
            each = {re.escape(joint.name): float(getattr(joint, name)) for joint in derived.robot.joints}
            values[name] = each if len(set(each.values())) > 1 else next(iter(each.values()))
    return PolicySpec(**values)


def _layout(spec: PolicySpec, name: str, size: int, num_actions: int) -> tuple[str, tuple[TermSpec, ...]]:
    """Return the layout of a preset that has a network's size, and its kind; an unstated history is free."""
    frames = {
        kind: layout_of(replace(spec, observation=terms, history_length=1), num_actions).size
        for kind, terms in PRESETS[name].observations.items()
    }
    length = spec.history_length
    fits = [kind for kind, frame in frames.items() if size == frame * (length or 1)]
    if not fits and length is None:
        fits = [kind for kind, frame in frames.items() if size % frame == 0]
    if len(fits) == 1:
        return fits[0], PRESETS[name].observations[fits[0]]
    known = " or ".join(f"{frame * (length or 1)} ({kind})" for kind, frame in frames.items())
    more = "" if length is not None else ", or whole multiples: a history"
    raise ConfigurationError(
        f"--preset {name}: got a network of {size} inputs and {num_actions} actions, expected {known}{more}; say the "
        "observation with --settings"
    )


def _text(value: object) -> str:
    """Return a value for a note."""
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {number:.4g}" for key, number in value.items())
    if isinstance(value, HeightScan):
        return f"{len(value.points)} points, offset {value.offset:g} m"
    if isinstance(value, float):
        return "none" if math.isinf(value) else f"{value:g}"
    if isinstance(value, tuple):
        return ", ".join(_term(part) if isinstance(part, TermSpec) else str(part) for part in value)
    return str(value)


def _term(term: TermSpec) -> str:
    """Return a term with its scale and clip, for a note."""
    scale = "" if term.scale == 1.0 else f" x {term.scale}"
    if term.clip is None:
        return f"{term.name}{scale}"
    return f"{term.name}{scale} (clip {term.clip[1]:g} {'before' if term.clip_first else 'after'} the scale)"
