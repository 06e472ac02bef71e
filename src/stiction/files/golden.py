"""Golden vectors: a recorded rollout of one robot: measurements, and answers of policy and joint controllers.

They are recorded by `export` with the policy as training computes it, in torch; `verify` and robots replay them with
NumPy and onnxruntime. A walk reaches no clip of observation or action, so synthetic readings that do are appended;
`exercise_of` lists the limits that a recording reaches. They also hold the SHA-256 of the bundle's other files, so that
a contract or a card edited afterwards no longer matches.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from stiction.core.errors import BundleError, LogError
from stiction.files.contract import Contract
from stiction.files.observation import Term
from stiction.files.tables import parse_npz
from stiction.joints.pd import controller_torque

MIN_STEPS, MAX_STEPS = 500, 20_000
"""Minimum, ten seconds at 50 Hz, and maximum number of steps."""

MAX_BYTES = 64 * 2**20
"""Maximum size of the golden vectors unpacked [B]: a small archive must not fill the memory."""

LARGEST = {
    "command": 100.0,
    "angular_velocity": 1e3,
    "joint_position": 1e3,
    "joint_velocity": 1e4,
    "target": 1e3,
    "torque": 1e5,
    "base_linear_velocity": 1e3,
    "heights": 1e4,
}
"""Maximum of a number in its SI unit, beyond the range of robots."""

DIFFERENT = 0.9
"""Minimum share of rows that differ from all others: a repeated row proves nothing new."""

TIME_ERROR = 1e-6
"""Maximum difference of a recorded time from a whole number of control periods [s]."""

LIMIT_SLACK = 0.1
"""Distance beyond a joint's limit at which an angle still counts as at it [rad]: stops yield, and sensors have
noise."""

OUTSIDE = {"joint_position": 0.05, "target": 0.5}
"""Maximum share of a joint's recorded angles, and of its targets, beyond its limits: a stop holds the angle, while a
policy may request more to push."""

TORQUE_ERROR = 1e-6
"""Maximum difference of a recorded torque from that of the contract's gains, as a fraction of the torque limit."""

EXERCISED = 1e-3
"""Minimum root mean square of kp (target - position), and of kd velocity, as a fraction of the torque limit, for the
gains to show in the torque."""


@dataclass(frozen=True)
class Golden:
    """Recorded rollout of one robot, T steps. Angles [rad], velocities [rad/s]."""

    joint_names: np.ndarray
    """Names of the joints, text, shape (J,)."""
    time: np.ndarray
    """Time since the start of the recording [s], shape (T,)."""
    reset: np.ndarray
    """True where the history restarts before this step, bool, shape (T,)."""
    command: np.ndarray
    """Commanded velocity: forward, sideways [m/s], turn [rad/s], shape (T, 3)."""
    quaternion: np.ndarray
    """Measured orientation of the base, w x y z, shape (T, 4)."""
    angular_velocity: np.ndarray
    """Measured angular velocity in the base frame [rad/s], shape (T, 3)."""
    joint_position: np.ndarray
    """Measured joint angles [rad], shape (T, J)."""
    joint_velocity: np.ndarray
    """Measured joint velocities [rad/s], shape (T, J)."""
    observation: np.ndarray
    """Input of the network, float32, shape (T, observation size)."""
    action: np.ndarray
    """Output of the network after clipping, float32, shape (T, J)."""
    target: np.ndarray
    """Joint targets [rad], shape (T, J)."""
    torque: np.ndarray | None = None
    """Torques that the joint controllers request at these targets and measurements [N m], see `controller_torque`,
    computed with the robot's gains and limits, not the contract's, shape (T, J). None: an older recording."""
    base_linear_velocity: np.ndarray | None = None
    """Velocity of the base in its frame [m/s], shape (T, 3), if the policy observes it."""
    heights: np.ndarray | None = None
    """Heights of the base over the ground [m], shape (T, points), if the policy observes them."""

    walked: np.ndarray | None = None
    """False for synthetic readings that reach a limit, bool, shape (T,): their answers must not be sent to a robot.
    None: the whole recording was walked."""

    def __len__(self) -> int:
        return len(self.time)


SENSED = ("angular_velocity", "command", "joint_position", "joint_velocity")
"""Terms of the observation that a reading alone can drive to their clips, in addition to roll and pitch."""


@dataclass(frozen=True)
class Exercise:
    """Parts of a contract that a recording exercises: the replay cannot check a clip that no step reaches."""

    resets: int
    """Resets after the first step; each fills the history with the present frame."""
    rolls_over: bool
    """True if a frame entered the history and left it again."""
    reached: tuple[str, ...]
    """Limits reached by some step: `clip of joint_velocity`, ..., `clip of the action`, `torque limit`."""
    missed: tuple[str, ...]
    """Reachable limits that no step reaches."""


def exercise_of(golden: Golden, contract: Contract) -> Exercise:
    """Return the parts of the contract that a recording exercises."""
    # In single precision a number at its clip may lie just below it.
    layout, rounding = contract.observation, 1 - 1e-6
    newest = np.abs(golden.observation[:, layout.newest()])
    at, start = {}, 0
    for term in layout.terms:
        if clips(contract, term):
            at[f"clip of {term.name}"] = bool((newest[:, start : start + term.size] >= rounding * term.clips).any())
        start += term.size
    at["clip of the action"] = bool((np.abs(golden.action) >= rounding * contract.action_clip).any())
    torque = golden.torque
    full = contract.array("torque_limit") * rounding
    at["torque limit"] = False if torque is None else bool((np.abs(torque) >= full).any())
    starts = np.append(np.flatnonzero(golden.reset), len(golden))
    return Exercise(
        resets=int(golden.reset[1:].sum()),
        rolls_over=bool(np.diff(starts).max() > layout.depth),
        reached=tuple(name for name, reached in at.items() if reached),
        missed=tuple(name for name, reached in at.items() if not reached),
    )


def clips(contract: Contract, term: Term) -> bool:
    """Return whether a recording can show the clip of a term: some reading, or the last action, reaches it."""
    if term.name in SENSED:
        return bool((BEYOND * term.clips / term.scales <= LARGEST[term.name]).all())
    if term.name == "roll_pitch":
        return bool((BEYOND * term.clips / term.scales < np.pi).all())
    return term.name == "last_action" and bool((term.clips / term.scales <= contract.action_clip).all())


BEYOND = 1.2
"""Factor by which a recording drives a term beyond its clip."""

BOUND = "sha256:"
"""Prefix of the arrays that hold the SHA-256 of the bundle's other files."""


def write_golden(golden: Golden, digests: Mapping[str, str]) -> bytes:
    """Return the bytes of golden.npz; `digests` maps the bundle's other files to their SHA-256 in hexadecimal."""
    arrays = {name: array for name, array in vars(golden).items() if array is not None}
    arrays |= {BOUND + name: np.array(digest) for name, digest in digests.items()}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def read_golden(data: bytes, contract: Contract) -> tuple[Golden, dict[str, str]]:
    """Parse golden.npz and check it against the contract; return it and the digests that it binds.

    Raises `BundleError`: not an NPZ, too large unpacked, an array missing, unknown, of the wrong shape or type, not
    finite or out of range; too few or too many steps; fewer than two resets, or none at the first step; times off the
    control period; repeated rows; angles beyond the contract's limits; torques of other gains.
    """
    try:
        arrays = parse_npz("golden.npz", data, MAX_BYTES)
    except LogError as error:
        raise BundleError(f"{error}; export the bundle again") from error
    digests = {name.removeprefix(BOUND): str(arrays.pop(name)) for name in list(arrays) if name.startswith(BOUND)}
    unseen = {name for name in NOT_MEASURED if name not in not_measured(contract)}
    expected = {field.name for field in fields(Golden)} - unseen
    if odd := sorted((arrays.keys() ^ expected) - ({"torque", "walked"} - arrays.keys())):
        raise BundleError(f"golden.npz: the array {odd[0]!r} is missing or unknown; export the bundle again")
    golden = Golden(**arrays)
    _check_arrays(golden, contract)
    _check_recording(golden, contract)
    _check_torque(golden, contract)
    return golden, digests


NOT_MEASURED = {"base_linear_velocity": "base_linear_velocity", "heights": "height_scan"}
"""Array of a quantity that no sensor of a robot measures -> the term that observes it."""


def not_measured(contract: Contract) -> dict[str, int]:
    """Return the arrays of `NOT_MEASURED` that a policy's recording has, and their widths."""
    terms = {term.name: term.size for term in contract.observation.terms}
    return {name: terms[term] for name, term in NOT_MEASURED.items() if term in terms}


def _check_arrays(golden: Golden, contract: Contract) -> None:
    names, recorded = contract.joint_names, golden.joint_names
    if recorded.dtype.kind != "U" or recorded.shape != (len(names),) or tuple(recorded.tolist()) != names:
        raise BundleError(f"golden.npz is for the joints {str(recorded.tolist())[:200]}, the contract has {names}")
    steps, joints = golden.time.shape[0] if golden.time.ndim else 0, len(names)
    widths = {"command": 3, "quaternion": 4, "angular_velocity": 3, "observation": contract.observation.size}
    widths |= dict.fromkeys(("joint_position", "joint_velocity", "action", "target"), joints)
    widths |= not_measured(contract) | ({} if golden.torque is None else {"torque": joints})
    shapes = {"time": (steps,), "reset": (steps,), **{name: (steps, width) for name, width in widths.items()}}
    shapes |= {} if golden.walked is None else {"walked": (steps,)}
    for name, shape in shapes.items():
        array = getattr(golden, name)
        kinds = "b" if name in ("reset", "walked") else "f"
        if array.shape != shape or array.dtype.kind not in kinds:
            raise BundleError(f"golden.npz: {name!r} is {array.dtype} {array.shape}; expected {shape}, kind {kinds!r}")
        if not np.isfinite(array).all():
            raise BundleError(f"golden.npz: {name!r} contains numbers that are not finite")
        if steps and np.abs(array).max() > LARGEST.get(name, np.inf):
            raise BundleError(f"golden.npz: {name!r} is up to {np.abs(array).max():.3g}; no robot has over "
                              f"{LARGEST[name]:g}")  # fmt: skip
    if not MIN_STEPS <= steps <= MAX_STEPS:
        raise BundleError(f"golden.npz has {steps} steps; at least {MIN_STEPS} and at most {MAX_STEPS} are expected")


def _check_recording(golden: Golden, contract: Contract) -> None:
    """Check that the recording fits this period and these limits, and that no row is repeated."""
    if not golden.reset[0] or golden.reset.sum() < 2:
        raise BundleError("golden.npz must start with a reset and contain at least one more")
    if golden.walked is not None and golden.walked.mean() < DIFFERENT:
        raise BundleError(
            f"golden.npz: only {golden.walked.mean():.0%} of its steps were walked; expected {DIFFERENT:.0%}"
        )
    late = np.abs(golden.time - contract.control_period * np.arange(len(golden))).max()
    if late > TIME_ERROR:
        raise BundleError(
            f"golden.npz: the recorded times are up to {late:.3g} s off the contract's period of "
            f"{contract.control_period:g} s; they do not belong together"
        )
    if np.abs(np.linalg.norm(golden.quaternion, axis=1) - 1.0).max() > 1e-3:
        raise BundleError("golden.npz: a 'quaternion' is not of unit length")
    for name in ("observation", "joint_position", "joint_velocity"):
        rows = getattr(golden, name)
        different = len(np.unique(rows, axis=0)) / len(rows)
        if different < DIFFERENT:
            raise BundleError(
                f"golden.npz: only {different:.0%} of the rows of {name!r} differ; at least {DIFFERENT:.0%} are "
                "expected of a robot that moves"
            )
        if name != "observation" and (still := np.ptp(rows, axis=0) == 0.0).any():
            joint = contract.joint_names[int(np.argmax(still))]
            raise BundleError(f"golden.npz: {name!r} of {joint!r} never changes; expected a recording of a robot")
    low, high = contract.array("lower") - LIMIT_SLACK, contract.array("upper") + LIMIT_SLACK
    for name, most in OUTSIDE.items():
        angles = getattr(golden, name)
        outside = ((angles < low) | (angles > high)).mean(axis=0)
        if outside.max() > most:
            worst = int(np.argmax(outside))
            raise BundleError(
                f"golden.npz: {outside[worst]:.1%} of {name!r} of {contract.joint_names[worst]!r} are beyond the "
                f"contract's limits, {contract.lower[worst]:g} to {contract.upper[worst]:g} rad; at most "
                f"{most:.0%} may be"
            )


def _check_torque(golden: Golden, contract: Contract) -> None:
    """Check that the contract's gains and limits give the recorded torques, which must show other gains."""
    if golden.torque is None:
        return
    kp, kd, limit = (contract.array(name) for name in ("kp", "kd", "torque_limit"))
    expected = controller_torque(golden.target, golden.joint_position, golden.joint_velocity, kp, kd, limit)
    error = np.abs(golden.torque - expected).max(axis=0) / limit
    if error.max() > TORQUE_ERROR:
        worst = int(np.argmax(error))
        raise BundleError(
            f"golden.npz: the torques of {contract.joint_names[worst]!r} are not those of the contract's kp "
            f"{kp[worst]:g}, kd {kd[worst]:g} and limit {limit[worst]:g} N m; they do not belong together"
        )
    for name, part, gain in (
        ("kp", kp * (golden.target - golden.joint_position), kp),
        ("kd", kd * golden.joint_velocity, kd),
    ):
        silent = (np.sqrt((part**2).mean(axis=0)) < EXERCISED * limit) & (gain > 0)
        if silent.any():
            joint = contract.joint_names[int(np.argmax(silent))]
            raise BundleError(f"golden.npz: the torques of {joint!r} show nothing of its {name}; expected a walk")
