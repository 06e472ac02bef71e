"""The contract of a policy: everything that a runtime must know to run it, as one validated record.

A runtime computes `target = standing + action_scale * clip(network(observation), ±action_clip)` once per control period
and holds it; the joint controller applies `kp (target - position) - kd velocity`, limited to the torque limit.

A frame is the concatenation of terms, o_prio of the paper; the policy's input is the last `history_length` frames,
o_H, flattened, oldest frame first. Right after a reset every frame of the history is the first one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields

import numpy as np

from stiction.core.errors import BundleError, unknown_name
from stiction.core.names import kinds_of
from stiction.formats.contract_rules import (
    PER_JOINT,
    RULES,
    SCHEMA_VERSION,
    SHARE,
    SPEED_RATIO,
    TERM_RULES,
    is_name,
    one_of,
)
from stiction.formats.known_friction import TERM
from stiction.formats.plain import build, is_integer, parse_object
from stiction.joints.friction import LAWS, Law, has_coefficient, simulated_laws
from stiction.robots.model import Robot
from stiction.robots.record import robot_from

HISTORY_LENGTH = 11
"""H = 10 in the paper, but its set runs from t-H to t: eleven frames, the current one included."""


@dataclass(frozen=True)
class Term:
    """One entry of a frame: value = clip((raw - offset) * scale)."""

    name: str
    """Which quantity: one of `TERM_NAMES`."""
    size: int
    """Number of entries."""
    scale: float
    """Multiplier of the raw quantity."""
    clip: float
    """Symmetric bound after scaling."""
    frame: str
    """`base` (x forward, y left, z up), `joint`, `joint_size` (of joints, the same where an axis points the other way),
    `kind` (of joint), `command` or `none`."""
    offset: str = "none"
    """What is subtracted before scaling: `none`, or `standing` for the standing pose."""


TERM_NAMES = (
    "angular_velocity",
    "roll_pitch",
    "placeholder_terrain",
    "command",
    "placeholder_gait",
    "joint_position",
    "joint_velocity",
    "last_action",
    "placeholder_contact",
    "known_friction",
    "slow_error",
    "slow_speed",
    "slow_power",
)
"""The paper's o_prio, {ω, (φ, ψ), 0, com, 0, θ, θ', a_{t-1}, 0}, in its order; placeholders are always zero. Behind it
what only some policies have: `known_friction`, f/τ_max of each kind of joint as somebody identified it [-]; and slow
means, see `SLOW_TERMS`."""

SLOW_TERMS = ("slow_error", "slow_speed", "slow_power")
"""Means over the last second or so of |e| [rad], |θ'| [rad/s] and e θ' [rad²/s] of each joint, where e is how far its
angle is from the last target, standing + action_scale a_{t-1} − θ.

kp e θ' is the power that dry friction and damping use up in the mean, f |θ'| + (B + kd) θ'²; of a joint that is stuck,
kp |e| is up to f. So f follows from the three together, and from no frame alone. Since the last reset frame i weighs

    mean_t = Σ k^(t-i) x_i / Σ k^(t-i),    k = `slow_kept`
"""

PLACEHOLDERS = frozenset(name for name in TERM_NAMES if name.startswith("placeholder"))

FRAMES = {
    **dict.fromkeys(("angular_velocity", "roll_pitch"), "base"),
    **dict.fromkeys(("joint_position", "joint_velocity", "last_action"), "joint"),
    **dict.fromkeys(PLACEHOLDERS, "none"),
    **dict.fromkeys(SLOW_TERMS, "joint_size"),
    "command": "command",
    TERM: "kind",
}
"""Term -> the frame that it is in."""

LONGEST_HISTORY, MOST_TERMS, MOST_ENTRIES, MOST_JOINTS = 1000, 64, 2**16, 256
"""Frames of a history, terms of a frame, entries of an observation, and joints that a policy may have."""


@dataclass(frozen=True)
class ObservationLayout:
    """The terms of one frame, and how frames are stacked."""

    terms: tuple[Term, ...]
    history_length: int = HISTORY_LENGTH
    direction: str = "oldest_first"
    layout: str = "frame_major"
    slow_kept: float | None = None
    """Factor of the slow means' weights from one frame to the next, exp(−control period/time constant) [1]; None where
    there are no slow means."""

    def __post_init__(self) -> None:
        """Refuse terms that nobody can compute."""
        for term in self.terms:
            if term.name not in TERM_NAMES:
                raise BundleError(unknown_name("observation term", term.name, TERM_NAMES))
        counted = is_integer(self.history_length) and 1 <= self.history_length <= LONGEST_HISTORY
        if self.direction != "oldest_first" or self.layout != "frame_major" or not counted:
            raise BundleError(
                f"observation history {self.direction!r}, {self.layout!r}, length {self.history_length!r}: "
                f"expected 'oldest_first', 'frame_major' and a length from 1 to {LONGEST_HISTORY}"
            )
        slow, weight = [term.name for term in self.terms if term.name in SLOW_TERMS], self.slow_kept
        if slow and not (isinstance(weight, float) and 0 < weight < 1):
            raise BundleError(f"observation terms {', '.join(slow)} with slow_kept {weight!r}: expected one in (0, 1)")
        if not slow and weight is not None:
            raise BundleError(f"observation slow_kept {weight!r} without a slow term: expected none")

    def has(self, name: str) -> bool:
        """Say whether a frame has a term of this name."""
        return any(term.name == name for term in self.terms)

    @property
    def frame_size(self) -> int:
        """Entries of one frame."""
        return sum(term.size for term in self.terms)

    @property
    def size(self) -> int:
        """Entries of the policy's input."""
        return self.frame_size * self.history_length


def proprioception(
    num_joints: int, history_length: int = HISTORY_LENGTH, known_kinds: int = 0, slow_kept: float | None = None
) -> ObservationLayout:
    """Return the paper's layout for a robot with `num_joints` joints (65 entries a frame for 18 joints).

    Scales are those customary for legged robots: they bring each term near unit size, so that no running
    normalisation is needed, and the deployed observation is a fixed function of the sensors.

    Args:
        num_joints: of the robot.
        history_length: frames in o_H, the present one included.
        known_kinds: kinds of joints whose friction the policy observes; 0: none, as in the paper.
        slow_kept: see `ObservationLayout`; None: no slow means, as in the paper.

    """
    terms: tuple[Term, ...] = (
        Term("angular_velocity", 3, 0.25, 5.0, "base"),
        Term("roll_pitch", 2, 1.0, 3.2, "base"),
        Term("placeholder_terrain", 1, 1.0, 1.0, "none"),
        Term("command", 3, 1.0, 5.0, "command"),
        Term("placeholder_gait", 1, 1.0, 1.0, "none"),
        Term("joint_position", num_joints, 1.0, 5.0, "joint", "standing"),
        Term("joint_velocity", num_joints, 0.05, 5.0, "joint"),
        Term("last_action", num_joints, 1.0, 10.0, "joint"),
        Term("placeholder_contact", 1, 1.0, 1.0, "none"),
    )
    if known_kinds:
        terms += (Term(TERM, known_kinds, 5.0, 5.0, "kind"),)
    if slow_kept is not None:
        scales = zip(SLOW_TERMS, (4.0, 0.5, 2.0), strict=True)
        terms += tuple(Term(name, num_joints, scale, 5.0, "joint_size") for name, scale in scales)
    return ObservationLayout(terms, history_length, slow_kept=slow_kept)


LATER = {"compensation": 1, "compensation_width": 1} | dict.fromkeys(
    ("stribeck", "actuator", "known_friction", "known_friction_file", "phases", "anatomy", "command_range"), 2
)
"""Field that came later -> the last version in which it may be missing; it is then its default."""


@dataclass(frozen=True)
class Contract:
    """What a policy expects of the robot and of the runtime. Sequences over joints have the order of `joint_names`."""

    robot: str
    """Name of the robot: `saturn_lite`."""
    terrain: str
    """Terrain trained on: `flat`."""
    method: str
    """Training method with friction: `none`, `direct`, `deception`, ..."""
    seed: int
    """Seed of the training run."""
    friction_law: str
    """Law of the joint friction in training: `coulomb`, see `stiction.joints.friction`."""
    friction_level: float
    """Nominal dry friction as a fraction of each joint's torque limit [-], a mean over joints where it was measured; of
    the laws `load` and `effort`, their coefficient [-]."""
    friction_range: tuple[float, float]
    """Range of the dry friction that training drew from, in the unit of `friction_level`."""
    joint_names: tuple[str, ...]
    """Names of the joints, in the order of every vector over joints."""
    control_period: float
    """Time between two actions [s]."""
    decimation: int
    """Physics steps per action."""
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
    """Largest torques of the motors [N m]."""
    armature: tuple[float, ...]
    """Nominal inertias of the rotors, at the joint, that training varied [kg m²]."""
    damping: tuple[float, ...]
    """Nominal viscous friction that training varied [N m s/rad]."""
    friction: tuple[float, ...]
    """Nominal dry friction that training varied [N m]; `friction_level` is its mean share of `torque_limit`. Of the
    laws `load` and `effort` the coefficient of each joint [-]; `friction_level` is their mean."""
    observation: ObservationLayout
    """Terms, scales, clips and history of the network's input."""
    action_scale: float | tuple[float, ...]
    """Joint angle per unit of action [rad]: one number, or one of each joint."""
    action_clip: float
    """Symmetric bound of the network's output [-]."""
    revision: str
    """Revision of the code that trained the policy."""
    command: str
    """Command that made the policy."""
    joints_file: Mapping[str, str] | None = None
    """`name` and `sha256` of the joints.json that set the nominal joints, or None."""
    actuator: Mapping[str, str] | None = None
    """`name` and `sha256` of the Actuator Net that gave the torque in training in place of kp and kd, or None."""
    action_offset: str = "standing"
    """What the scaled action is added to; only `standing` is known."""
    quaternion_order: str = "wxyz"
    """Order of the entries of the orientation; only `wxyz` is known."""
    compensation: tuple[float, ...] | None = None
    """How far the runtime moves each target on in the direction of motion, f/kp [rad], or None. The target is then
    a + compensation * clip((a - position) / compensation_width, -1, 1), from the measured position."""
    stribeck: tuple[float, float] | None = None
    """Of a law with these numbers, `stribeck`: friction at rest over friction in motion [1], and the speed v_s [rad/s];
    else None."""
    known_friction: Mapping[str, float] | None = None
    """Of a policy that observes its joints' friction (the term `known_friction`): the default, kind of joint -> dry
    friction as a fraction of the torque limit [-]. None of any other policy, and of one that must be given it before
    its first step."""
    known_friction_file: Mapping[str, str] | None = None
    """`name` and `sha256` of the joints.json that `known_friction` is from; None: the nominal friction of training."""
    phases: int | None = None
    """Phases of the training: 1, what walked in training is what is deployed; 2, a teacher and its student. None: the
    bundle is older than this field."""
    anatomy: Robot | None = None
    """The whole robot: links, masses, limits, and of each joint its place and axis in the base's frame (x forward, y
    left, z up) where all angles are zero; an angle grows by the right-hand rule about the axis. With it the joints that
    are held, and the maker's order, signs and offsets where somebody said them. None: the bundle is older than this
    field, and the shipped robot of the name is meant."""
    command_range: Mapping[str, tuple[float, float]] | None = None
    """Velocity commands that training drew from, lower and upper end of `forward`, `sideways` [m/s] and
    `turn` [rad/s]. None: the bundle is older than this field."""
    compensation_width: float = 0.05
    """Distance of the target at which all of it is added [rad]."""
    schema_version: int = SCHEMA_VERSION
    """Version of this record."""

    def __post_init__(self) -> None:
        """Refuse what no runtime could obey."""
        for name, rule in RULES.items():
            _expect(rule.allowed(getattr(self, name)), name, getattr(self, name), rule.expected)
        period = self.decimation * self.physics_timestep
        right = math.isclose(period, self.control_period, rel_tol=1e-9)
        _expect(right, "control_period", self.control_period, f"{period}, 'decimation' times 'physics_timestep'")
        _check_joints(self)
        _check_friction(self)
        _check_observation(self.observation, self.num_joints, len(set(self.kinds)))
        _check_known_friction(self)

    @property
    def law(self) -> Law:
        """Law of the joint friction in training."""
        return Law(self.friction_law) if self.stribeck is None else Law(self.friction_law, *self.stribeck)

    @property
    def observes_friction(self) -> bool:
        """Whether the policy observes the friction of its joints."""
        return self.observation.has(TERM)

    @property
    def known_friction_array(self) -> np.ndarray | None:
        """`known_friction` as an array [-], shape (kinds,), in the order of the joints; None where that is None."""
        given = self.known_friction
        return None if given is None else np.array([given[kind] for kind in dict.fromkeys(self.kinds)])

    @property
    def kinds(self) -> tuple[str, ...]:
        """What each joint is; of an older bundle, as its name tells."""
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

    Raises:
        BundleError: not JSON, a field missing, unknown, of the wrong type or size, or not finite.

    """
    data = parse_object(text, "contract.json", "the contract of a policy; export the bundle again", BundleError)
    version = data.get("schema_version")
    later = {name for name, last in LATER.items() if is_integer(version) and version in range(1, last + 1)}
    if is_integer(version) and version == 1:
        data["schema_version"] = SCHEMA_VERSION
    if data.get("anatomy") is not None:
        data["anatomy"] = robot_from(data["anatomy"], "contract.json: anatomy")
    return build(Contract, data, "contract.json", BundleError, {field.name for field in fields(Contract)} - later)


def _expect(condition: bool, field: str, value: object, expected: str) -> None:
    """Raise `BundleError` naming the field unless the condition holds."""
    if not condition:
        raise BundleError(f"contract field {field!r} is {repr(value)[:200]}; expected {expected}")


def _check_joints(contract: Contract) -> None:
    """Check names, sizes and ranges of the fields with one entry per joint."""
    names = contract.joint_names
    valid = isinstance(names, tuple) and 0 < len(names) <= MOST_JOINTS and all(map(is_name, names))
    _expect(valid and len(set(names)) == len(names), "joint_names", names, f"1 to {MOST_JOINTS} different names")
    single = () if isinstance(contract.action_scale, tuple) else ("action_scale",)
    absent = () if contract.compensation is not None else ("compensation",)
    for field, (allowed, expected, _) in PER_JOINT.items():
        values = getattr(contract, field)
        if field in single:
            _expect(allowed(values), field, values, f"{expected}, or one for each of the {len(names)} joints")
        elif field not in absent:
            right = isinstance(values, tuple) and len(values) == len(names) and all(map(allowed, values))
            _expect(right, field, values, f"{expected} for each of the {len(names)} joints")
    for name, lower, standing, upper in zip(names, contract.lower, contract.standing, contract.upper, strict=True):
        _expect(lower < standing < upper, "standing", f"{standing} at {name}", f"an angle within ({lower}, {upper})")
    _check_anatomy(contract)


OF_ROBOT = ("torque_limit", "lower", "upper", "kp", "kd", "action_scale")
"""Fields that contract and robot have under one name, and must have alike."""


def _check_anatomy(contract: Contract) -> None:
    """Check that the robot is the one whose joints, limits, gains, pose and scale of the action the contract has."""
    robot = contract.anatomy
    if robot is None:
        return
    names = robot.joint_names
    _expect(names == contract.joint_names, "anatomy", names, f"the joints {contract.joint_names}")
    for field, own in {**{name: name for name in OF_ROBOT}, "default_position": "standing"}.items():
        given = np.broadcast_to(getattr(contract, own), (len(names),))
        same = np.allclose(robot.joint_values(field), given, rtol=1e-6, atol=1e-9)
        _expect(same, f"anatomy.{field}", robot.joint_values(field).tolist(), f"{getattr(contract, own)}, as {own!r}")


def _check_friction(contract: Contract) -> None:
    """Check that the law has its numbers, and that the level is the mean of what the joints have.

    Of torques it is the mean share of the limit, of coefficients their mean.
    """
    law, shape = contract.friction_law, contract.stribeck
    # Laws can be registered later than this module is imported.
    _expect(law in simulated_laws(), "friction_law", law, " or ".join(map(repr, simulated_laws())))
    shaped = bool(LAWS[law].numbers)
    pair = isinstance(shape, tuple) and len(shape) == 2 and all(r.allowed(v) for r, v in zip(SPEED_RATIO, shape))
    expected = "a ratio in [1, 10] and a positive speed" if shaped else "null"
    _expect(pair if shaped else shape is None, "stribeck", shape, expected)
    coefficients = has_coefficient(law)
    units = [1.0] * contract.num_joints if coefficients else contract.torque_limit
    mean = sum(value / unit for value, unit in zip(contract.friction, units, strict=True)) / len(units)
    agrees = math.isclose(mean, contract.friction_level, rel_tol=1e-6, abs_tol=1e-9)
    what = "the mean of 'friction'" if coefficients else "the mean of 'friction' over 'torque_limit'"
    _expect(agrees, "friction_level", contract.friction_level, f"{mean:g}, {what}")


def _check_observation(layout: ObservationLayout, num_joints: int, num_kinds: int) -> None:
    """Check that every term has the size and the numbers that a runtime can build."""
    of_joints = ("joint_position", "joint_velocity", "last_action", *SLOW_TERMS)
    sizes = {"angular_velocity": 3, "roll_pitch": 2, "command": 3, TERM: num_kinds}
    sizes |= dict.fromkeys(of_joints, num_joints)
    names = [term.name for term in layout.terms]
    different = len(set(names)) == len(names) and 0 < len(names) <= MOST_TERMS
    _expect(different, "observation.terms", names, "different terms, at least one")
    for term in layout.terms:
        where, size = f"observation.{term.name}", sizes.get(term.name, term.size)
        right = is_integer(term.size) and 1 <= term.size <= MOST_ENTRIES and term.size == size
        _expect(right, f"{where}.size", term.size, f"{size}")
        words = {"frame": one_of(FRAMES[term.name])}
        words["offset"] = one_of("none", "standing") if term.name == "joint_position" else one_of("none")
        for field, (allowed, expected, _) in (TERM_RULES | words).items():
            _expect(allowed(getattr(term, field)), f"{where}.{field}", getattr(term, field), expected)
    _expect(layout.size <= MOST_ENTRIES, "observation", layout.size, f"at most {MOST_ENTRIES} entries")


def _check_known_friction(contract: Contract) -> None:
    """Check that known friction is that of the kinds of joints, and there only where the policy observes it."""
    given, kinds = contract.known_friction, tuple(dict.fromkeys(contract.kinds))
    if not contract.observes_friction or given is None:
        _expect(given is None, "known_friction", given, f"null: the observation has no term {TERM!r}")
        file = contract.known_friction_file
        _expect(file is None, "known_friction_file", file, "null, as 'known_friction' is")
        return
    allowed, expected, _ = SHARE
    right = isinstance(given, Mapping) and set(given) == set(kinds) and all(map(allowed, given.values()))
    _expect(right, "known_friction", given, f"an object with {expected} for each of {', '.join(kinds)}, or null")
