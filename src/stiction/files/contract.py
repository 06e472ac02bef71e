"""Contract of a policy: everything that a runtime needs to run it, as one validated record.

A runtime computes `target = standing + action_scale * clip(network(observation), ±action_clip)` once per control period
and holds it; the joint controller applies `kp (target - position) - kd velocity`, limited to the torque limit.

A frame is the concatenation of terms, o_prio of the paper; the policy's input is the last `history_length` frames, o_H,
flattened, oldest frame first. Right after a reset every frame of the history is the first one. Imported policies may
stack differently, term by term or newest first: see `observation`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from itertools import chain
from typing import Any

import numpy as np

from stiction.core.decode import from_plain, is_integer
from stiction.core.errors import BundleError, RobotError
from stiction.core.names import kinds_of
from stiction.files.contract_rules import (
    IMPORTED,
    PER_JOINT,
    RULES,
    SCHEMA_VERSION,
    SHARE,
    SPEED_RATIO,
    TARGET_LIMITS,
    UNKNOWN,
    expect,
    is_name,
)
from stiction.files.contract_training import ERAS, RISE, check_age, check_training, ends_of, span_text
from stiction.files.known_friction import TERM
from stiction.files.observation import ObservationLayout
from stiction.files.plain import parse_object
from stiction.joints.compensation import PushCfg
from stiction.joints.friction import LAWS, Law, has_coefficient, simulated_laws
from stiction.robots.catalog import find_robot
from stiction.robots.model import Robot

PHASES = {1: "one phase", 2: "two phases"}

MOST_JOINTS = 256

LATER = {"compensation": 1, "compensation_width": 1} | dict.fromkeys(chain(*ERAS), 2)
"""Field added later -> the last version in which it may be missing; it then has its default."""


@dataclass(frozen=True)
class Contract:
    """Requirements of a policy on robot and runtime. Sequences over joints have the order of `joint_names`."""

    robot: str
    terrain: str
    """Terrain trained on: `flat`."""
    method: str
    """Training method with friction: `none`, `direct`, `deception`, or the name of one of another distribution."""
    seed: int
    friction_law: str
    """Law of the joint friction in training: `coulomb`, see `stiction.joints.friction`."""
    friction_level: float
    """Nominal dry friction as a fraction of each joint's torque limit [-], a mean over joints where it was measured;
    for the laws `load` and `effort`, their coefficient [-]."""
    friction_range: tuple[float, float]
    """Range of the dry friction in training, in the unit of `friction_level`."""
    joint_names: tuple[str, ...]
    """Names of the joints, in the order of every vector over joints."""
    control_period: float
    """Time between two actions [s]."""
    decimation: int
    physics_timestep: float
    """Physics step of training [s]; control_period = decimation * physics_timestep."""
    kp: tuple[float, ...]
    """Proportional gains of the joint controller [N m/rad]."""
    kd: tuple[float, ...]
    """Derivative gains of the joint controller [N m s/rad]."""
    standing: tuple[float, ...]
    """Standing pose, the offset of the action [rad]."""
    lower: tuple[float, ...]
    """Lower joint limits [rad]."""
    upper: tuple[float, ...]
    """Upper joint limits [rad]."""
    torque_limit: tuple[float, ...]
    """Torque limits of the motors [N m]."""
    armature: tuple[float, ...]
    """Nominal rotor inertias at the joint, which training varied [kg m²]."""
    damping: tuple[float, ...]
    """Nominal viscous friction, which training varied [N m s/rad]."""
    friction: tuple[float, ...]
    """Nominal dry friction, which training varied [N m]; `friction_level` is its mean share of `torque_limit`. For the
    laws `load` and `effort` the coefficient of each joint [-]; `friction_level` is their mean."""
    observation: ObservationLayout
    action_scale: float | tuple[float, ...]
    """Joint angle per unit of action [rad]: one number, or one of each joint."""
    action_clip: float
    """Symmetric bound of the network's output [-]."""
    revision: str
    command: str
    joints_file: Mapping[str, str] | None = None
    """`name` and `sha256` of the joints.json that set the nominal joints, or None."""
    actuator: Mapping[str, str] | None = None
    """`name` and `sha256` of the Actuator Net that replaced kp and kd in training, or None."""
    torque_source: str | None = None
    """Place of the torque measurement of this net: `motor_side`, or `output_side`, behind the gear; None without a net,
    and in older contracts."""
    action_offset: str = "standing"
    """Offset of the scaled action; only `standing` is supported."""
    quaternion_order: str = "wxyz"
    """Order of the entries of the orientation; only `wxyz` is supported."""
    compensation: tuple[float, ...] | None = None
    """Maximum shift of each target by the runtime, the compensated share of f over kp [rad], or None; see
    `joints.compensation.compensated`, with v_s and v_f of `compensation_speeds` and the width `compensation_width`."""
    stribeck: tuple[float, float] | None = None
    """Numbers of the law `stribeck`: friction at rest over friction in motion [1], and the speed v_s [rad/s], the
    middle where robots differed and `settings` has the ends; None for other laws."""
    known_friction: Mapping[str, float] | None = None
    """Default of the term `known_friction`: kind of joint -> dry friction as a fraction of the torque limit [-]. None
    without that term, and where it must be set before the first step."""
    known_friction_file: Mapping[str, str] | None = None
    """`name` and `sha256` of the joints.json with `known_friction`; None: the nominal friction of training."""
    imported: Mapping[str, str] | None = None
    """`name` and `sha256` of the network of an imported policy, whose training is unknown; `preset` and `assumed` where
    a trainer's standard task filled fields that no file has: its name, theirs."""
    friction_load: tuple[float, float] | None = None
    """Range in training of the coefficient of friction that grows with load (the law `load`), in addition to
    `friction_range` [1], or None."""
    friction_spread: tuple[float, float] | None = None
    """Range of each joint's factor on its robot's friction in training [1], or None: all joints had one factor, or
    independent ones."""
    disturber: str | None = None
    """Disturbance of the robots during training, in the words of its method; None: no disturbance."""
    phases: int | None = None
    """Phases of the training: 1, its policy is deployed; 2, a teacher and its student. None: an older bundle."""
    anatomy: Robot | None = None
    """Complete robot, with held joints and the maker's order; places and axes of joints are in the base's frame (x
    forward, y left, z up) where all angles are zero. None: an older bundle, of the shipped robot of its name."""
    command_range: Mapping[str, tuple[float, float]] | None = None
    """Velocity commands in training: ends of `forward`, `sideways` [m/s], `turn` [rad/s]; None: older."""
    settings: Mapping[str, Any] | None = None
    """Settings of the training that differ from the defaults of the code, by their dotted names on the command line:
    `teacher.quiet`: 30; numbers, texts, or lists of them. None: an older bundle, or an imported one."""
    compensation_width: float = 0.05
    """Distance to the target at which all of it is added [rad]; with speeds, to a joint at rest."""
    compensation_speeds: tuple[float, float] | None = None
    """v_s and v_f [rad/s]; None: the speed is ignored, as in older bundles."""
    target_limits: Mapping[str, float] | None = None
    """Limits of joint targets that every control step applies: `slew`, maximum speed of a target [rad/s], and `margin`,
    minimum distance to the joint's limits [rad]; see `deploy.control`. None: an older bundle has none."""
    command_correction: Mapping[str, float] | None = None
    """Integral action on the velocity command in every control step: `time` [s], `share` of the command and `least`
    [m/s, rad/s]; see `deploy.control`. The network then has a second output, the velocity of the base. None: the policy
    gets the command unchanged."""
    schema_version: int = SCHEMA_VERSION

    def __post_init__(self) -> None:
        for name, rule in RULES.items():
            expect(rule.allowed(getattr(self, name)), name, getattr(self, name), rule.expected)
        period = self.decimation * self.physics_timestep
        right = math.isclose(period, self.control_period, rel_tol=1e-9)
        expect(right, "control_period", self.control_period, f"{period}, 'decimation' times 'physics_timestep'")
        _check_joints(self)
        _check_friction(self)
        _check_anatomy(self)
        self.observation.check(self.num_joints, len(set(self.kinds)))
        _check_known_friction(self)

    @property
    def largest_load(self) -> float:
        """Maximum friction in training per torque that a joint transmits [1]; 0 where none grew with the load."""
        return 0.0 if self.friction_load is None else self.friction_load[1]

    @property
    def met_friction(self) -> bool:
        """True if its joints had dry friction during training, as far as known."""
        return max(self.friction_range[1], self.largest_load) > 0.0

    @property
    def estimates_velocity(self) -> bool:
        """True if the network has a second output, the velocity of the base."""
        return self.command_correction is not None

    @property
    def trained(self) -> str:
        """Dry friction of its joints during training, in words: the name of a way to train on every page."""
        (low, high), load = self.friction_range, self.largest_load
        if self.imported is not None:
            return "elsewhere"
        if self.method == "none" or not self.met_friction:
            return "without friction"
        if high == 0.0:
            return f"with friction of up to {load:g} of the load"
        scale = (1.0, "") if has_coefficient(self.friction_law) else (100.0, " %")
        number = [f"{scale[0] * value:.3g}" for value in (low, self.friction_level, high)]
        text = f"at 0 to {number[2]}{scale[1]} friction" if low == 0.0 else f"at {number[1]}{scale[1]} friction"
        if (rise := span_text(self.rise)) != "1":
            text += f", {rise} times that at rest"
        if self.friction_spread is not None:
            text += ", different in each joint"
        return text if load == 0.0 else f"{text} and up to {load:g} of the load"

    @property
    def rise(self) -> tuple[float, float]:
        """Static over dynamic friction in training, lowest and highest [1]."""
        return (1.0, 1.0) if self.stribeck is None else ends_of((self.settings or {}).get(RISE[0], self.stribeck[0]))

    @property
    def law(self) -> Law:
        """Law of the joint friction in training; the middle of numbers that robots differed in."""
        return Law(self.friction_law) if self.stribeck is None else Law(self.friction_law, *self.stribeck)

    @property
    def push(self) -> PushCfg:
        """Direction of the push of `compensation`."""
        slow, fade = self.compensation_speeds or (math.inf, math.inf)
        return PushCfg(slow=slow, width=self.compensation_width, fade=fade)

    @property
    def observes_friction(self) -> bool:
        """True if the policy observes the friction of its joints."""
        return self.observation.has(TERM)

    @property
    def known_friction_array(self) -> np.ndarray | None:
        """`known_friction` as an array [-], shape (kinds,), in the order of the joints; None where that is None."""
        shares = self.known_friction
        return None if shares is None else np.array([shares[kind] for kind in dict.fromkeys(self.kinds)])

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kind of each joint; in an older bundle, by its name."""
        if self.anatomy is None:
            return kinds_of(self.joint_names)
        return tuple(joint.kind for joint in self.anatomy.joints)

    @property
    def scale(self) -> float | np.ndarray:
        """Joint angle per unit of action [rad]: one number, or one of each joint, shape (num_joints,)."""
        return np.array(self.action_scale) if isinstance(self.action_scale, tuple) else self.action_scale

    @property
    def num_joints(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    def array(self, field: str) -> np.ndarray:
        """Return a field with one number per joint as an array, shape (num_joints,)."""
        return np.array(getattr(self, field), dtype=np.float64)

    def to_json(self) -> str:
        """Return the text of contract.json, keys in the order of the fields."""
        return json.dumps(asdict(self), indent=2) + "\n"


def read_contract(text: bytes) -> Contract:
    """Parse the bytes of a contract.json.

    Raises `BundleError`: not JSON, another version, a field missing, unknown, of the wrong type or size, or not finite.
    """
    data = parse_object(text, "contract.json", "the contract of a policy; export the bundle again", BundleError)
    version = data.get("schema_version", SCHEMA_VERSION)
    # Before any field: another version has fields of its own.
    if not is_integer(version) or not 1 <= version <= SCHEMA_VERSION:
        newer = "; update stiction" if is_integer(version) and version > SCHEMA_VERSION else ""
        raise BundleError(
            f"contract.json: schema version {repr(version)[:60]}; this program reads 1 to "
            f"{SCHEMA_VERSION}{newer or '; export the bundle again'}"
        )
    check_age(data, version)
    later = {name for name, last in LATER.items() if version <= last}
    # Version 1 differs in fields that it lacks, and in nothing that it has.
    if version == 1:
        data["schema_version"] = SCHEMA_VERSION
    if data.get("anatomy") is not None:
        data["anatomy"] = from_plain(Robot, data["anatomy"], "contract.json: anatomy", RobotError)
    known = {field.name for field in fields(Contract)}
    contract = from_plain(Contract, data, "contract.json", BundleError, known - later)
    check_training(contract)
    if (limits := contract.target_limits) is not None:
        # A bundle may keep its targets closer than new bundles do; only who runs it may let them go further.
        narrowest = float((contract.array("upper") - contract.array("lower")).min())
        margin = min(TARGET_LIMITS["margin"], 0.1 * narrowest)
        within = limits["slew"] <= TARGET_LIMITS["slew"] and limits["margin"] >= margin * (1 - 1e-6)
        usual = f"slew of at most {TARGET_LIMITS['slew']:g} rad/s, margin of at least {margin:g} rad"
        expect(within, "target_limits", dict(limits), usual)
    return contract


def _check_joints(contract: Contract) -> None:
    """Check names, sizes and ranges of the fields with one entry per joint."""
    names = contract.joint_names
    valid = isinstance(names, tuple) and 0 < len(names) <= MOST_JOINTS and all(map(is_name, names))
    expect(valid and len(set(names)) == len(names), "joint_names", names, f"1 to {MOST_JOINTS} different names")
    single = () if isinstance(contract.action_scale, tuple) else ("action_scale",)
    absent = () if contract.compensation is not None else ("compensation",)
    for field, (allowed, expected) in PER_JOINT.items():
        values = getattr(contract, field)
        if field in single:
            expect(allowed(values), field, values, f"{expected}, or one for each of the {len(names)} joints")
        elif field not in absent:
            right = isinstance(values, tuple) and len(values) == len(names) and all(map(allowed, values))
            expect(right, field, values, f"{expected} for each of the {len(names)} joints")
    for name, lower, standing, upper in zip(names, contract.lower, contract.standing, contract.upper, strict=True):
        expect(lower < standing < upper, "standing", f"{standing} at {name}", f"an angle within ({lower}, {upper})")
        if (limits := contract.target_limits) is not None:
            room = f"a margin that leaves {name} room between {lower} and {upper}"
            expect(lower + limits["margin"] < upper - limits["margin"], "target_limits", limits, room)


OF_ROBOT = ("torque_limit", "lower", "upper", "kp", "kd", "action_scale")
"""Fields with one name in contract and robot, which must be equal."""


def _check_anatomy(contract: Contract) -> None:
    """Check that name, joints, limits, gains, pose and motors of the robot are the contract's.

    Motors from a joints.json, in `joints_file`, may differ.
    """
    robot = contract.anatomy
    if robot is None:
        return
    names = robot.joint_names
    expect(robot.name == contract.robot, "anatomy.name", robot.name, f"{contract.robot!r}, as 'robot'")
    expect(names == contract.joint_names, "anatomy", names, f"the joints {contract.joint_names}")
    same = {name: name for name in (*OF_ROBOT, *(() if contract.joints_file else ("armature", "damping")))}
    for field, name in {**same, "default_position": "standing"}.items():
        value = np.broadcast_to(getattr(contract, name), (len(names),))
        right = np.allclose(robot.joint_values(field), value, rtol=1e-6, atol=1e-9)
        expect(right, f"anatomy.{field}", robot.joint_values(field).tolist(), f"{getattr(contract, name)}, as {name!r}")
    if contract.joints_file is None:
        unit = 1.0 if has_coefficient(contract.friction_law) else contract.array("torque_limit")
        friction, level = contract.array("friction"), contract.friction_level * unit
        right = any(np.allclose(friction, each, rtol=1e-6) for each in (level, robot.joint_values("frictionloss")))
        expect(right, "friction", contract.friction, "the same share in each joint, or the robot's own friction")


def _check_friction(contract: Contract) -> None:
    """Check that the law has its numbers, and that the level is the mean over the joints.

    For torques it is the mean share of the limit, for coefficients their mean.
    """
    law, shape = contract.friction_law, contract.stribeck
    # Laws can be registered later than this module is imported.
    expect(law in simulated_laws(), "friction_law", law, " or ".join(map(repr, simulated_laws())))
    shaped = bool(LAWS[law].numbers)
    pair = isinstance(shape, tuple) and len(shape) == 2 and all(r.allowed(v) for r, v in zip(SPEED_RATIO, shape))
    expected = "a ratio in [1, 10] and a positive speed" if shaped else "null"
    expect(pair if shaped else shape is None, "stribeck", shape, expected)
    coefficients = has_coefficient(law)
    units = [1.0] * contract.num_joints if coefficients else contract.torque_limit
    mean = sum(value / unit for value, unit in zip(contract.friction, units, strict=True)) / len(units)
    agrees = math.isclose(mean, contract.friction_level, rel_tol=1e-6, abs_tol=1e-9)
    what = "the mean of 'friction'" if coefficients else "the mean of 'friction' over 'torque_limit'"
    expect(agrees, "friction_level", contract.friction_level, f"{mean:g}, {what}")


def _check_known_friction(contract: Contract) -> None:
    """Check that known friction covers the kinds of joints, and exists only where the policy observes it."""
    known, kinds = contract.known_friction, tuple(dict.fromkeys(contract.kinds))
    if not contract.observes_friction or known is None:
        expect(known is None, "known_friction", known, f"null: the observation has no term {TERM!r}")
        file = contract.known_friction_file
        expect(file is None, "known_friction_file", file, "null, as 'known_friction' is")
        return
    allowed, expected = SHARE
    right = isinstance(known, Mapping) and set(known) == set(kinds) and all(map(allowed, known.values()))
    expect(right, "known_friction", known, f"an object with {expected} for each of {', '.join(kinds)}, or null")


ALIKE = {"torque_limit": "torque limits", "kp": "gains kp", "kd": "gains kd"}
"""Field in which a robot must equal the contract -> its name in messages: the policy learned to walk with these."""


def limits_text(contract: Contract, robot: Robot) -> str | None:
    """Return the torque limits in which a contract differs from a robot of the same joints, in words; None: all
    equal.
    """
    limits = dict(zip(contract.joint_names, contract.torque_limit, strict=True))
    other = dict(zip(robot.joint_names, robot.joint_values("torque_limit").tolist(), strict=True))
    changed: dict[tuple[float, float], list[str]] = {}
    for name, limit in limits.items():
        if name in other and not math.isclose(limit, other[name], rel_tol=1e-6):
            changed.setdefault((limit, other[name]), []).append(name)
    if not changed:
        return None
    return ", ".join(
        f"{limit:.4g} N m at {names[0]}{f' and {len(names) - 1} more' if len(names) > 1 else ''} (of {robot.name} "
        f"{expected:.4g})"
        for (limit, expected), names in changed.items()
    )


def robot_of(contract: Contract, robot: str | None = None) -> Robot:
    """Return the robot of a contract, checked against it.

    It is the contract's own; for an older bundle the shipped one of its name. `robot` names another one to use instead:
    a path, or `package.module:NAME`, which runs that module. Raises `StictionError`: the robot is unknown, or its
    joints, torque limits or gains differ from the contract's.
    """
    if robot is None and contract.anatomy is not None:
        return contract.anatomy
    if robot is None and not contract.robot.partition("@")[0].isidentifier():
        raise RobotError(
            f"the bundle is for the robot {contract.robot!r}, which is not a shipped one; "
            "if you trust that module, name it with --robot"
        )
    spec = find_robot(robot or contract.robot)
    if spec.joint_names != contract.joint_names:
        raise RobotError(
            f"robot {spec.name!r} has other joints than the bundle, {', '.join(spec.joint_names)} and not "
            f"{', '.join(contract.joint_names)}; leave --robot out, or name the one that the policy is for"
        )
    for field, what in ALIKE.items():
        if not np.allclose(spec.joint_values(field), contract.array(field)):
            raise RobotError(f"robot {spec.name!r} has other {what} than the bundle; name the right one with --robot")
    return spec


def contract_of_others(
    robot: Robot, control_period: float, decimation: int, observation: ObservationLayout, **more: Any
) -> Contract:
    """Return the contract of an imported policy: joints, gains and pose are the robot's.

    robot: as the policy knows it; control_period: time between two actions [s]; decimation: physics steps in it;
    observation: input of the policy; more: further fields, among them `action_clip`, `revision` and `command`.
    """
    names = {"kp": "kp", "kd": "kd", "standing": "default_position", "torque_limit": "torque_limit"}
    names |= {name: name for name in ("lower", "upper", "armature", "damping")}
    of_joints: dict[str, Any] = {field: tuple(robot.joint_values(name).tolist()) for field, name in names.items()}
    scale = robot.joint_values("action_scale")
    return Contract(
        robot=robot.name,
        terrain=UNKNOWN,
        method=IMPORTED,
        seed=0,
        friction_law="coulomb",
        friction_level=0.0,
        friction_range=(0.0, 0.0),
        joint_names=robot.joint_names,
        control_period=control_period,
        decimation=decimation,
        physics_timestep=control_period / decimation,
        friction=(0.0,) * robot.num_joints,
        observation=observation,
        action_scale=float(scale[0]) if len(np.unique(scale)) == 1 else tuple(scale.tolist()),
        anatomy=robot,
        **of_joints,
        **more,
    )
