"""Observation of a policy as data: its terms, their scales and clips, and the stacking of frames.

It is written once and stored in the bundle's contract; training builds it in torch, the runtime and every evaluation in
NumPy (`deploy.observation`). The paper's policies have `proprioception`; imported policies have any terms of
`TERM_NAMES`, in their order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.core.decode import is_integer, is_number
from stiction.core.errors import BundleError, unknown_name
from stiction.files.contract_rules import TERM_RULES, expect, one_of
from stiction.files.known_friction import TERM

HISTORY_LENGTH = 11
"""History length. H = 10 in the paper, but its set runs from t-H to t: eleven frames, the current one included."""


@dataclass(frozen=True)
class Term:
    """Entry of a frame: value = clip((raw - offset) * scale)."""

    name: str
    """Name of the quantity: one of `TERM_NAMES`."""
    size: int
    """Number of entries."""
    scale: float | tuple[float, ...]
    """Multiplier of the raw quantity: one number, or one of each entry."""
    clip: float | tuple[float, ...]
    """Symmetric bound after scaling: one number, or one of each entry; `NO_CLIP` or more means no clip."""
    frame: str
    """`base` (x forward, y left, z up), `heading` (the same, but z up in the world), `joint`, `joint_size` (of joints,
    the same where an axis points the other way), `kind` (of joint), `side`, `command`, `clock` or `none`."""
    offset: str = "none"
    """Value subtracted before scaling: `none`, or `standing` for the standing pose."""
    history_length: int | None = None
    """Frames of this term, if the layout stacks term by term; None: the layout's number."""

    @property
    def scales(self) -> np.ndarray:
        """Scale of every entry, shape (size,)."""
        return np.broadcast_to(np.array(self.scale, dtype=np.float64), (self.size,))

    @property
    def clips(self) -> np.ndarray:
        """Bound of every entry, shape (size,)."""
        return np.broadcast_to(np.array(self.clip, dtype=np.float64), (self.size,))


NO_CLIP = 1e6
"""Bound that is never reached: no clip. Also that of the action, in multiples of its scale."""

TERM_NAMES = (
    *("angular_velocity", "roll_pitch", "placeholder_terrain", "command", "placeholder_gait", "joint_position"),
    *("joint_velocity", "last_action", "placeholder_contact", "known_friction", "first_side", "slow_error"),
    *("slow_speed", "slow_power", "projected_gravity", "base_linear_velocity", "command_linear", "command_turn"),
    *("phase", "phase_sin", "phase_cos", "height_scan"),
)
"""Names of terms: the paper's o_prio, {ω, (φ, ψ), 0, com, 0, θ, θ', a_{t-1}, 0}, in its order; placeholders are always
zero. Then terms of some policies: `known_friction`, identified f/τ_max of each kind of joint [-]; `first_side`, see
`FIRST_SIDE`; slow means, see `SLOW_TERMS`; and observations of imported policies: the direction of gravity in the
base's frame, (0, 0, -1) upright; the base's velocity in its frame [m/s], which no sensor of a robot measures; the
command in parts, forward and sideways [m/s] or turn [rad/s]; a gait clock, see `GaitClock`: `phase` is the sines of all
phases and then their cosines; and heights, see `HeightScan`. The last action is the one after clipping."""

FIRST_SIDE = "first_side"
"""Choice between two mirror images of a gait: 1 or -1, drawn for every episode in training, 1 on the robot. A symmetric
policy in a symmetric pose can begin with neither side; this input selects one."""

SLOW_TERMS = ("slow_error", "slow_speed", "slow_power")
"""Means over the last second or so of |e| [rad], |θ'| [rad/s] and e θ' [rad²/s] of each joint, where e is the distance
of its angle from the last target, standing + action_scale a_{t-1} − θ.

kp e θ' is the mean power dissipated by dry friction and damping, f |θ'| + (B + kd) θ'²; for a stuck joint, kp |e| is up
to f. So f follows from the three together, and from no single frame. Since the last reset frame i weighs

  mean_t = Σ k^(t-i) x_i / Σ k^(t-i),    k = `slow_kept`
"""

PLACEHOLDERS = frozenset(name for name in TERM_NAMES if name.startswith("placeholder"))

CLOCK_TERMS = ("phase", "phase_sin", "phase_cos")
"""Terms of a gait clock."""

FRAMES = {
    **dict.fromkeys(("angular_velocity", "roll_pitch", "projected_gravity", "base_linear_velocity"), "base"),
    **dict.fromkeys(("joint_position", "joint_velocity", "last_action"), "joint"),
    **dict.fromkeys(PLACEHOLDERS, "none"),
    **dict.fromkeys(SLOW_TERMS, "joint_size"),
    **dict.fromkeys(("command", "command_linear", "command_turn"), "command"),
    **dict.fromkeys(CLOCK_TERMS, "clock"),
    "height_scan": "heading",
    FIRST_SIDE: "side",
    TERM: "kind",
}
"""Term -> its frame."""

LONGEST_HISTORY, MOST_TERMS, MOST_ENTRIES, MOST_POINTS = 1000, 64, 2**16, 4096
"""Maximum frames of a history, terms of a frame, entries of an observation, and points of a height scan."""


@dataclass(frozen=True)
class GaitClock:
    """Phases that advance with time: φ_i(k) = offset_i + 2π k T/period in the k-th control step of period T."""

    period: float
    """Time of one turn of every phase [s]."""
    offsets: tuple[float, ...]
    """Phase of each foot, or pair of feet, at k = 0 [rad]."""
    first: int = 0
    """k of the first observation after a reset."""
    standing: float | None = None
    """Phase of all feet while the robot is told to stand [rad]; when it walks on, k restarts at 0. None: the clock
    always runs."""
    standing_below: float = 0.01
    """Bound of the commanded speed [m/s] and turn [rad/s] below which both mean standing."""

    def __post_init__(self) -> None:
        turns = isinstance(self.offsets, tuple) and 0 < len(self.offsets) <= 64
        right = is_number(self.period) and 0.01 <= self.period <= 100 and turns and self.first in (0, 1)
        angles = (*self.offsets, *(() if self.standing is None else (self.standing,))) if turns else ()
        small = is_number(self.standing_below) and 0 <= self.standing_below <= 10
        if not right or not small or not all(is_number(angle, 100.0) for angle in angles):
            raise BundleError(
                f"gait clock of period {self.period!r}, offsets {str(self.offsets)[:80]}, first {self.first!r}, "
                f"standing {self.standing!r} below {self.standing_below!r}: expected 0.01 to 100 s, 1 to 64 angles, "
                "0 or 1, an angle or null, and 0 to 10"
            )


@dataclass(frozen=True)
class HeightScan:
    """Heights of the base over the ground at points around it: z of the base - z of the ground - offset [m]."""

    points: tuple[tuple[float, float], ...]
    """Forward and left of the base [m], along its heading."""
    offset: float = 0.0
    """Value subtracted [m]."""

    def __post_init__(self) -> None:
        right = isinstance(self.points, tuple) and 0 < len(self.points) <= MOST_POINTS and is_number(self.offset, 1e3)
        right = right and all(isinstance(point, tuple) and len(point) == 2 for point in self.points)
        if not right or not all(is_number(part, 1e3) for point in self.points for part in point):
            raise BundleError(
                f"height scan of {str(self.points)[:80]}, offset {self.offset!r}: expected 1 to {MOST_POINTS} points, "
                "forward and left [m], and a height [m]"
            )


@dataclass(frozen=True)
class ObservationLayout:
    """Terms of one frame, and the stacking of frames."""

    terms: tuple[Term, ...]
    history_length: int = HISTORY_LENGTH
    direction: str = "oldest_first"
    """`oldest_first` or `newest_first`."""
    layout: str = "frame_major"
    """`frame_major`: whole frames, one after the other; `term_major`: all frames of each term."""
    slow_kept: float | None = None
    """Factor of the slow means' weights from one frame to the next, exp(−control period/time constant) [1]; None
    without slow means."""
    fill: str = "first"
    """History after a reset: `first`, copies of the first frame, or `zero`."""
    clock: GaitClock | None = None
    """Gait clock, if a term observes one."""
    heights: HeightScan | None = None
    """Points of `height_scan`, if that is a term."""

    def __post_init__(self) -> None:
        for term in self.terms:
            if term.name not in TERM_NAMES:
                raise BundleError(unknown_name("observation term", str(term.name)[:80], TERM_NAMES))
        counts = [self.history_length, *(term.history_length for term in self.terms if term.history_length is not None)]
        counted = all(is_integer(count) and 1 <= count <= LONGEST_HISTORY for count in counts)
        known = self.direction in ("oldest_first", "newest_first") and self.fill in ("first", "zero")
        if not known or self.layout not in ("frame_major", "term_major") or not counted:
            raise BundleError(
                f"observation history {self.direction!r}, {self.layout!r}, {self.fill!r}, lengths {counts!r}: expected "
                "'oldest_first' or 'newest_first', 'frame_major' or 'term_major', 'first' or 'zero', and lengths from "
                f"1 to {LONGEST_HISTORY}"
            )
        if self.layout == "frame_major" and set(counts) != {self.history_length}:
            raise BundleError(f"observation history 'frame_major' of lengths {counts}: expected the same of every term")
        slow, weight = [term.name for term in self.terms if term.name in SLOW_TERMS], self.slow_kept
        if slow and not (isinstance(weight, float) and 0 < weight < 1):
            raise BundleError(f"observation terms {', '.join(slow)} with slow_kept {weight!r}: expected one in (0, 1)")
        if not slow and weight is not None:
            raise BundleError(f"observation slow_kept {weight!r} without a slow term: expected none")
        for needs, value, what in (
            (any(map(self.has, CLOCK_TERMS)), self.clock, "clock"),
            (self.has("height_scan"), self.heights, "heights"),
        ):
            if needs != (value is not None):
                raise BundleError(f"observation {what} {value!r}: expected it with a term that observes it, else none")

    def has(self, name: str) -> bool:
        """Return whether a frame has a term of this name."""
        return any(term.name == name for term in self.terms)

    def history_of(self, term: Term) -> int:
        """Return the number of frames of a term in the input."""
        return self.history_length if term.history_length is None else term.history_length

    @property
    def depth(self) -> int:
        """Number of frames to store."""
        return max(map(self.history_of, self.terms), default=1)

    @property
    def frame_size(self) -> int:
        """Entries of one frame."""
        return sum(term.size for term in self.terms)

    @property
    def size(self) -> int:
        """Entries of the policy's input."""
        return sum(term.size * self.history_of(term) for term in self.terms)

    def order(self) -> np.ndarray:
        """Return the index, into the stored frames, oldest first and flattened, of each entry of the input, (size,)."""
        frame, depth, starts = self.frame_size, self.depth, np.cumsum([0, *(term.size for term in self.terms)])
        # Of each term, frame by frame, the places of its entries among the kept frames; its own history may be shorter.
        blocks = [
            frame * np.arange(depth - self.history_of(term), depth)[:, None] + start + np.arange(term.size)
            for term, start in zip(self.terms, starts, strict=False)
        ]
        if self.direction == "newest_first":
            blocks = [block[::-1] for block in blocks]
        if self.layout == "frame_major":
            return np.concatenate(blocks, axis=1).ravel()
        return np.concatenate([block.ravel() for block in blocks])

    def newest(self) -> np.ndarray:
        """Return the positions in the input of the newest frame's entries, in the frame's order, shape
        (frame_size,).
        """
        order = self.order()
        places = np.flatnonzero(order >= self.frame_size * (self.depth - 1))
        return places[np.argsort(order[places])]

    def check(self, num_joints: int, num_kinds: int) -> None:
        """Check that every term has a size and numbers that a runtime can build; raise `BundleError` otherwise.

        num_joints, num_kinds: joints of the robot, and kinds of them.
        """
        sizes = {"angular_velocity": 3, "roll_pitch": 2, "command": 3, "projected_gravity": 3, TERM: num_kinds}
        sizes |= {"base_linear_velocity": 3, "command_linear": 2, "command_turn": 1, FIRST_SIDE: 1}
        sizes |= dict.fromkeys(("joint_position", "joint_velocity", "last_action", *SLOW_TERMS), num_joints)
        if self.clock is not None:
            phases = len(self.clock.offsets)
            sizes |= {"phase": 2 * phases, "phase_sin": phases, "phase_cos": phases}
        if self.heights is not None:
            sizes["height_scan"] = len(self.heights.points)
        names = [term.name for term in self.terms]
        different = len(set(names)) == len(names) and 0 < len(names) <= MOST_TERMS
        expect(different, "observation.terms", names, "different terms, at least one")
        for term in self.terms:
            where, size = f"observation.{term.name}", sizes.get(term.name, term.size)
            right = is_integer(term.size) and 1 <= term.size <= MOST_ENTRIES and term.size == size
            expect(right, f"{where}.size", term.size, f"{size}")
            words = {"frame": one_of(FRAMES[term.name])}
            words["offset"] = one_of("none", "standing") if term.name == "joint_position" else one_of("none")
            for field, rule in words.items():
                expect(rule.allowed(getattr(term, field)), f"{where}.{field}", getattr(term, field), rule.expected)
            for field, (allowed, expected) in TERM_RULES.items():
                value = getattr(term, field)
                each = value if isinstance(value, tuple) else (value,)
                right = len(each) == (term.size if isinstance(value, tuple) else 1) and all(map(allowed, each))
                expect(right, f"{where}.{field}", value, f"{expected}, or one for each of {term.size} entries")
                expect(term.name not in PLACEHOLDERS or value == 1, f"{where}.{field}", value, "1: it is always zero")
        expect(self.size <= MOST_ENTRIES, "observation", self.size, f"at most {MOST_ENTRIES} entries")


def proprioception(
    num_joints: int,
    history_length: int = HISTORY_LENGTH,
    known_kinds: int = 0,
    slow_kept: float | None = None,
    first_side: bool = False,
    clock: GaitClock | None = None,
) -> ObservationLayout:
    """Return the paper's layout for a robot with `num_joints` joints (65 entries a frame for 18 joints).

    Scales are those customary for legged robots: they bring each term near unit size, so that no running normalisation
    is needed, and the deployed observation is a fixed function of the sensors.

    num_joints: of the robot; history_length: frames in o_H, the present one included; known_kinds: kinds of joints
    whose friction the policy observes; slow_kept: see `ObservationLayout`; first_side: True to observe the first side,
    see `FIRST_SIDE`; clock: observed gait clock. By default none of these, as in the paper.
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
    if first_side:
        terms += (Term(FIRST_SIDE, 1, 1.0, 1.0, "side"),)
    if clock is not None:
        terms += (Term("phase", 2 * len(clock.offsets), 1.0, 1.0, "clock"),)
    if slow_kept is not None:
        scales = zip(SLOW_TERMS, (4.0, 0.5, 2.0), strict=True)
        terms += tuple(Term(name, num_joints, scale, 5.0, "joint_size") for name, scale in scales)
    return ObservationLayout(terms, history_length, slow_kept=slow_kept, clock=clock)
