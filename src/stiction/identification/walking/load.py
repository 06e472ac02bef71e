"""Load-dependent friction of a walking robot: swing and stance together, or the reason why not.

Friction is b + c |τ| here. Swing settles b where the torque is small, stance adds the torques of a robot's weight. Each
family of equations is weighted by the size of its residuals. A block is half a second of the walk.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from stiction.files.joints import Estimate
from stiction.identification.limb.fit import PriorFit, fit_blocks
from stiction.identification.walking.stance import BODY, FRICTION, StanceRows, stance_rows
from stiction.identification.walking.swing import BLOCK, FEWEST_SWINGS, SwingRows
from stiction.identification.walking.walk import Walk
from stiction.robots.model import Robot

FEWEST_ROWS = 300
"""Fewest equations of the base: an even walk gives some 50 to 200 a second."""

WIDEST = 0.05
"""Half-width of a load coefficient's interval above which no value is stated [1]."""

WIDE_PRIOR = (1.0, 10.0, 1000.0, 2.0)
"""Sizes of A, B, b and c beyond any joint's: for a kind that never moves, whose columns are empty."""

MAX_BOUND_RATIO = 1.5
"""Largest error of mass, centre of mass or specific force over its declared bound."""

LAW_ERROR = 0.05
"""Share of the coefficient by which its interval is widened: friction is not exactly linear in the motor's torque [1].
A choice."""


@dataclass(frozen=True)
class LoadFit:
    """Friction of each kind of joint with and without load; or a refusal."""

    refusal: str = ""
    """Reason for a refusal; empty if there is a fit."""
    laws: dict[str, dict[str, Estimate]] = field(default_factory=dict)
    """Kind -> A, B, b and c by the names of `FRICTION`; kinds whose c is not told are missing."""
    refused: dict[str, str] = field(default_factory=dict)
    """Kind -> reason why its c is not told."""
    under_load: dict[str, tuple[float, Estimate]] = field(default_factory=dict)
    """Kind -> mean |τ| of legs on the ground [N m], and dry friction b + c |τ| at it [N m]."""
    body: dict[str, Estimate] = field(default_factory=dict)
    """Estimated errors of the body, by the names of `BODY`."""
    rows: int = 0
    """Number of equations of the base."""
    partial: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    """Kind -> load and friction in stance with everything else taken off, as forces on the body [N], each shape (R,):
    slope c. For the page."""


def fit_load(walk: Walk, swing: list[SwingRows]) -> LoadFit:
    """Fit the friction that load adds, or refuse with the reason."""
    if refusal := _missing(walk):
        return LoadFit(refusal)
    stance = stance_rows(walk)
    regressor, target, sample, systematic, size = _stack(stance, swing, walk)
    blocks = walk.blocks(BLOCK)[sample]
    if len(stance.target) < FEWEST_ROWS or len(np.unique(blocks)) < FEWEST_SWINGS:
        return LoadFit(
            f"{len(stance.target)} equations of the base in {len(np.unique(blocks))} half seconds; expected at least "
            f"{FEWEST_ROWS} and {FEWEST_SWINGS}: log for longer"
        )
    setup, kinds = walk.setup, walk.spec.joint_kinds
    bounds = [setup.mass_error, *[setup.centre_error] * 3, *[setup.specific_force_error] * 3]
    known = [setup.torque_zero_error * walk.limits, [setup.timing_error * walk.period], bounds]
    names = [f"{name}.{kind}" for kind in kinds for name in FRICTION]
    names += [f"offset.{joint}" for joint in walk.spec.joint_names] + ["lateness", *BODY]
    # Declared bounds hold with 95 %: two deviations.
    prior = np.concatenate([np.tile(WIDE_PRIOR, len(kinds)), *known]) / 2
    try:
        fit = fit_blocks(tuple(names), regressor, target, blocks, prior, systematic)
    except np.linalg.LinAlgError:
        return LoadFit("its steps are all alike: walk at different speeds")
    body = {name: fit.estimate(name) for name in BODY}
    beyond = [
        f"{name} by {estimate.value:.3g} (declared within {bound:g})"
        for (name, estimate), bound in zip(body.items(), bounds, strict=True)
        if abs(estimate.value) > MAX_BOUND_RATIO * bound
    ]
    if beyond:
        refusal = (
            "the walk does not fit the declared masses and centre of mass: it is off in "
            f"{', '.join(beyond)}: weigh the robot, and state --payload and --centre-of-mass; or the torque's unit is "
            "wrong"
        )
        return LoadFit(refusal, body=body, rows=len(stance.target))
    laws, refused = _laws(fit, walk)
    under_load = {kind: _friction_under_load(kind, walk, fit) for kind in laws}
    # Stance's equations stand behind all of swing's.
    resting, left = regressor[-len(stance.target) :], fit.residual[-len(stance.target) :]
    partial = {}
    for kind in laws:
        column = _first(kind, walk.spec) + FRICTION.index("load_coefficient")
        rest = np.delete(resting, column, axis=1)
        load = resting[:, column] - rest @ np.linalg.lstsq(rest, resting[:, column], rcond=1e-8)[0]
        partial[kind] = (size * load, size * (fit.values[column] * load + left))
    return LoadFit("", laws, refused, under_load, body, len(stance.target), partial)


def _missing(walk: Walk) -> str:
    """Return the reason where something necessary is missing, else nothing."""
    if walk.sampled:
        return (
            "the log has torques as they were at its stamps; what they did in between, with every new target, is small "
            "beside a leg's links but not beside the balance of the body, and no interval was found that holds: "
            "log the mean torque of each period, in the form of evaluate --log"
        )
    if not walk.setup.mass_known:
        return (
            "in stance the forces on the feet, which nobody measured, absorb the joints' friction, and what the body's "
            "six equations leave needs known masses and centre of mass: weigh the robot as it walked and declare it "
            "with --mass-known (--payload, --centre-of-mass)"
        )
    if not walk.measured_torque:
        return "the motors' torque was not logged, and what load does to friction is judged by it: log the torque"
    if not walk.measured_acceleration:
        return "there was no accelerometer, and the body's equations need its acceleration: log the specific force"
    return ""


def _stack(
    stance: StanceRows, swing: list[SwingRows], walk: Walk
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
    """Return regressor, target, sample and systematic change of all equations, and the size of stance's residual [N].

    Each family of equations is over the size of its residual. Columns: A, B, b, c of each kind, every motor's torque
    zero, the torque's lateness, the body's errors. One swing equation in half a window is taken: neighbours share
    samples.
    """
    offsets = len(walk.spec.joint_kinds) * len(FRICTION)
    thin = slice(None, None, max(1, len(walk.weights) // 2))
    blocks = []
    for number, rows in enumerate(swing):
        part = np.zeros((len(rows.torque), stance.regressor.shape[1]))
        first = _first(walk.spec.joints[number].kind, walk.spec)
        part[:, first : first + len(FRICTION)] = np.column_stack([rows.regressor[:, :3], rows.load])
        part[:, offsets + number] = 1.0
        part[:, offsets + len(swing)] = rows.regressor[:, 3]
        blocks.append((part[thin], rows.torque[thin], rows.systematic[0, thin], rows.sample[thin]))
    families = (
        [np.concatenate(parts) for parts in zip(*blocks, strict=True)],
        (stance.regressor, stance.target, stance.links, stance.sample),
    )
    sizes = [_residual_size(regressor, target) for regressor, target, _, _ in families]
    regressor, target, systematic = (
        np.concatenate([family[part] / size for family, size in zip(families, sizes, strict=True)]) for part in range(3)
    )
    return regressor, target, np.concatenate([family[3] for family in families]), systematic[None], sizes[1]


def _residual_size(regressor: np.ndarray, target: np.ndarray) -> float:
    """Return the standard deviation of the residual of a family of equations that is fitted alone."""
    if not len(target):
        return 1.0
    return max(1e-9, float(np.std(target - regressor @ np.linalg.lstsq(regressor, target, rcond=1e-8)[0])))


def _first(kind: str, spec: Robot) -> int:
    """Return the number of a kind's first column in the regressor: A, then B, b and c."""
    return len(FRICTION) * spec.joint_kinds.index(kind)


def _laws(fit: PriorFit, walk: Walk) -> tuple[dict[str, dict[str, Estimate]], dict[str, str]]:
    """Return the laws of the kinds that the walk tells, and the reasons against the other kinds."""
    laws, refused = {}, {}
    for kind in walk.spec.joint_kinds:
        law = {name: fit.estimate(f"{name}.{kind}") for name in FRICTION}
        load = _widened(law["load_coefficient"], LAW_ERROR * law["load_coefficient"].value)
        half = load.interval95[1] - load.value
        if not walk.carriers[:, walk.spec.joints_of(kind)].any():
            refused[kind] = f"no foot hangs on the {kind} joints, so that the ground never loads them"
        elif half > WIDEST:
            refused[kind] = (
                f"the interval of the load coefficient of {kind} joints, ±{half:.2g}, is too wide to tell anything: "
                "log for longer, walk so that these joints move while they carry load"
            )
        else:
            laws[kind] = law | {"load_coefficient": load}
    return laws, refused


def _widened(estimate: Estimate, error: float) -> Estimate:
    """Return an estimate with an independent error at its 95 % bound in its interval."""
    low, high = estimate.interval95
    half, std = np.hypot((high - low) / 2, error), np.hypot(estimate.std, error / 2)
    return Estimate(estimate.value, float(std), (float(estimate.value - half), float(estimate.value + half)))


def _friction_under_load(kind: str, walk: Walk, fit: PriorFit) -> tuple[float, Estimate]:
    """Return the mean |τ| of a kind's joints while their feet are down [N m], and the dry friction at it [N m]."""
    joints = walk.spec.joints_of(kind)
    torque = float(np.abs(walk.torque[:, joints])[(walk.down @ walk.carriers)[:, joints]].mean())
    dry, load = f"coulomb_friction.{kind}", f"load_coefficient.{kind}"
    return torque, _widened(fit.combination({dry: 1.0, load: torque}), LAW_ERROR * fit.value(load) * torque)
