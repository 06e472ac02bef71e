"""`wear.json`: a map from one policy's observations to the dry friction of its joints, with intervals."""

from __future__ import annotations

import json
import re
from dataclasses import asdict, dataclass, fields

from stiction.core.decode import from_plain, is_integer, is_number, is_text
from stiction.core.errors import BundleError
from stiction.files.plain import parse_object, take_version

SCHEMA_VERSION = 3

LARGEST, LONGEST_WINDOW = 1e9, 10**5
"""Maximum of a number in a map, and of a window: half an hour at 50 Hz."""

LEVEL = "level"
"""Name of the last target: the mean of f/τ_max over the joints."""


@dataclass(frozen=True)
class WearCalibration:
    """Errors of a map on virtual robots, which have imperfections that its simulator lacks: backlash, delays, load,
    Stribeck.

    Per target of the map. Robots are the sample: the largest errors of each over its windows count.
    """

    shift: tuple[float, ...]
    """Correction of an estimate [-]: the median over robots of truth minus estimate."""
    lower: tuple[float, ...]
    """Lower end of the 95 % interval minus the estimate [-]."""
    upper: tuple[float, ...]
    """Upper end minus the estimate [-]; both by split conformal prediction over the calibration robots."""
    held: tuple[float, ...]
    """Share of the test robots' windows with the truth in the interval [-]."""
    held_before: tuple[float, ...]
    """The same for the map's intervals before calibration [-]."""
    robots: tuple[int, ...]
    """Seeds of the calibration robots."""
    tested: tuple[int, ...]
    """Seeds of the test robots, disjoint from the calibration robots."""
    engine: str
    """Engine and imperfections of the robots: `physx+all`."""

    def __post_init__(self) -> None:
        columns = (self.shift, self.lower, self.upper, self.held, self.held_before)
        rows = list(zip(*columns, strict=False))
        numbers = all(is_number(number, LARGEST) for row in rows for number in row)
        if any(len(column) != len(self.shift) for column in columns) or not numbers:
            raise BundleError("wear.json: 'calibration' has lists of several lengths, or numbers that are none")
        if not all(low <= shift <= high and 0 <= new <= 1 and 0 <= old <= 1 for shift, low, high, new, old in rows):
            raise BundleError("wear.json: 'calibration' has an interval without its estimate, or a share above 1")
        seeds = (*self.robots, *self.tested)
        if not (self.robots and self.tested and all(map(is_integer, seeds)) and len({*seeds}) == len(seeds)):
            raise BundleError("wear.json: 'calibration' needs robots, and others to test it on, each once")
        if not is_text(self.engine):
            raise BundleError("wear.json: 'calibration' has no engine")


@dataclass(frozen=True)
class WearModel:
    """Linear map from the mean features of a window (see `deploy.wear`) to f/τ_max of each joint and of the robot.

    Per target: the joints in the contract's order, then `LEVEL`. Fitted and tested in simulation only.
    """

    joint_names: tuple[str, ...]
    window: int
    """Control steps over which features are averaged for an estimate."""
    center: tuple[float, ...]
    """Median of each feature over the robots it was fitted on."""
    scale: tuple[float, ...]
    limit: float
    """Bound of standardised features, (feature - center) / scale, which are clipped at plus and minus this."""
    weights: tuple[tuple[float, ...], ...]
    """One row per feature, one entry per target [-]."""
    intercept: tuple[float, ...]
    """Estimate where every feature is at its center [-]."""
    reach: tuple[float, ...]
    """Half-width of each target's 95 % interval [-], which 95 % of the calibration robots' errors do not exceed."""
    estimated: tuple[bool, ...]
    """True for each target that is estimated: the lower end of its R² on unseen robots is above `threshold`."""
    determination: tuple[float, ...]
    """R² of each target on unseen robots [-]."""
    coverage: tuple[float, ...]
    """Share of unseen robots' windows with the truth in the interval [-], each target."""
    threshold: float
    """Minimum of that R², see `estimated` [-]."""
    highest: float
    """Maximum friction of the robots it was fitted on, from 0 [-]; beyond, it extrapolates."""
    unusual: float
    """Mean square of the standardised features below which 99 % of the calibration windows are [-]: a window above it
    is unlike those that the map was fitted on."""
    student: str
    """SHA-256 of the student's checkpoint: the map is for this policy only."""
    calibration: WearCalibration | None = None
    """Calibration on virtual robots; None: its intervals are those of the simulator that it was fitted in."""

    def __post_init__(self) -> None:
        targets, features = len(self.joint_names) + 1, len(self.center)
        per_target = ("intercept", "reach", "estimated", "determination", "coverage")
        sizes = [(name, len(getattr(self, name)), targets) for name in per_target]
        sizes += [(name, len(getattr(self, name)), features) for name in ("scale", "weights")]
        sizes += [("weights' rows", len(row), targets) for row in self.weights]
        for name, got, expected in sizes:
            if got != expected:
                raise BundleError(f"wear.json: {name!r} has {got} entries; expected {expected}; export again")
        if self.calibration is not None and len(self.calibration.shift) != targets:
            raise BundleError(f"wear.json: 'calibration' is of {len(self.calibration.shift)} targets, not {targets}")
        lists = (self.center, self.scale, self.intercept, self.reach, self.determination, self.coverage, *self.weights)
        single = (self.threshold, self.highest, self.unusual, self.limit)
        if not all(is_number(number, LARGEST) for row in (*lists, single) for number in row):
            raise BundleError(f"wear.json: a number is missing, not finite, or over {LARGEST:g}; export again")
        counted = is_integer(self.window) and 1 <= self.window <= LONGEST_WINDOW
        if not (counted and min(self.scale) > 0 and min(self.reach) > 0 and min(single[1:]) > 0):
            raise BundleError(
                f"wear.json: the window {self.window!r}, a scale, a reach or a bound is out of range; expected a "
                f"window of 1 to {LONGEST_WINDOW} steps, and positive numbers"
            )
        known = all(isinstance(value, bool) for value in self.estimated) and max(self.determination) <= 1.0
        digest = isinstance(self.student, str) and re.fullmatch("[0-9a-f]{64}", self.student) is not None
        if not (known and digest and all(0.0 <= value <= 1.0 for value in self.coverage)):
            raise BundleError(
                "wear.json: 'estimated' is not boolean, a share is above 1, or 'student' is not a SHA-256; export again"
            )

    @property
    def targets(self) -> tuple[str, ...]:
        """Names of the targets: the joints, then `LEVEL`."""
        return (*self.joint_names, LEVEL)

    def to_json(self) -> str:
        """Return the text of wear.json."""
        return json.dumps({"schema_version": SCHEMA_VERSION} | asdict(self), allow_nan=False) + "\n"


def read_wear(text: bytes) -> WearModel:
    """Parse the bytes of a wear.json.

    Raises `StictionError`: not JSON, another version, or a field missing, unknown, or of the wrong kind or size.
    """
    data = parse_object(text, "wear.json", "a map of the wear monitor", BundleError)
    data = take_version(data, SCHEMA_VERSION, "wear.json", BundleError)
    required = [field.name for field in fields(WearModel)]
    return from_plain(WearModel, data, "wear.json", BundleError, required)
