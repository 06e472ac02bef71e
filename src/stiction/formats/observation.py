"""The observation layout: written once, as data. The task builds it batched in torch, the runtime in NumPy.

A frame is the concatenation of terms, o_prio of the paper; the policy's input is the last `history_length` frames,
o_H, flattened, oldest frame first. Right after a reset every frame of the history is the first one.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

from stiction.formats.errors import StictionError

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
kp |e| is up to f. So the three together tell f, and no frame alone does. Since the last reset frame i weighs

    mean_t = Σ k^(t-i) x_i / Σ k^(t-i),    k = `slow_kept`
"""

PLACEHOLDERS = frozenset(name for name in TERM_NAMES if name.startswith("placeholder"))


@dataclass(frozen=True)
class ObservationLayout:
    """The terms of one frame, and how frames are stacked."""

    terms: tuple[Term, ...]
    history_length: int = HISTORY_LENGTH
    direction: str = "oldest_first"
    layout: str = "frame_major"
    slow_kept: float | None = None
    """What slow means keep of their weights from one frame to the next, exp(−control period/time constant) [1]; None
    where there are none."""

    def __post_init__(self) -> None:
        """Refuse terms that nobody can compute."""
        for term in self.terms:
            if term.name not in TERM_NAMES:
                raise StictionError(f"observation term {term.name!r} is unknown; known: {', '.join(TERM_NAMES)}")
        if self.direction != "oldest_first" or self.layout != "frame_major" or self.history_length < 1:
            raise StictionError(
                f"observation history {self.direction!r}, {self.layout!r}, length {self.history_length}: "
                "expected 'oldest_first', 'frame_major' and a length of at least 1"
            )

        slow, kept = [term.name for term in self.terms if term.name in SLOW_TERMS], self.slow_kept
        if slow and not (isinstance(kept, float) and 0 < kept < 1):
            raise StictionError(f"observation terms {', '.join(slow)} with slow_kept {kept!r}: expected one in (0, 1)")
        if not slow and kept is not None:
            raise StictionError(f"observation slow_kept {kept!r} without a slow term: expected none")

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

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> ObservationLayout:
        """Build from plain data; raise `StictionError` where a field is missing or unknown."""
        try:
            rest = dict(data)
            terms = tuple(Term(**term) for term in rest.pop("terms"))
            return cls(terms=terms, **rest)
        except (KeyError, TypeError) as error:
            raise StictionError(f"the observation layout in the contract is malformed: {error}") from error


def proprioception(
    num_joints: int,
    history_length: int = HISTORY_LENGTH,
    known_kinds: int = 0,
    slow_kept: float | None = None,
) -> ObservationLayout:
    """Return the paper's layout for a robot with `num_joints` joints (65 entries a frame for 18 joints).

    Scales are those customary for legged robots: they bring each term near unit size, so that no running
    normalisation is needed, and the deployed observation is a fixed function of the sensors.

    Args:
        num_joints: of the robot.
        history_length: frames in o_H, the present one included.
        known_kinds: kinds of joints whose friction the policy is told; 0: it is told nothing, as in the paper.
        slow_kept: see `ObservationLayout`; None: no slow means, as in the paper.

    """
    layout = ObservationLayout(
        (
            Term("angular_velocity", 3, 0.25, 5.0, "base"),
            Term("roll_pitch", 2, 1.0, 3.2, "base"),
            Term("placeholder_terrain", 1, 1.0, 1.0, "none"),
            Term("command", 3, 1.0, 5.0, "command"),
            Term("placeholder_gait", 1, 1.0, 1.0, "none"),
            Term("joint_position", num_joints, 1.0, 5.0, "joint", "standing"),
            Term("joint_velocity", num_joints, 0.05, 5.0, "joint"),
            Term("last_action", num_joints, 1.0, 10.0, "joint"),
            Term("placeholder_contact", 1, 1.0, 1.0, "none"),
        ),
        history_length,
    )
    terms = layout.terms
    if known_kinds:
        terms += (Term("known_friction", known_kinds, 5.0, 5.0, "kind"),)
    if slow_kept is not None:
        terms += tuple(
            Term(name, num_joints, scale, 5.0, "joint_size")
            for name, scale in zip(SLOW_TERMS, (4.0, 0.5, 2.0), strict=True)
        )
    return replace(layout, terms=terms, slow_kept=slow_kept)
