"""A joint under a PD controller as a computer runs it: torque computed once a period and held, from a late velocity.

Between two samples the torque is constant, so the motion is known in closed form, and a stop inside the period too. The
torque is on average half a period late, and the velocity may come later still, through a filter or from a bus.

The paper's section V: with τ = k (kp (a − θ) − kd θ'), I θ'' + B θ' = τ + f is

    I θ'' + (B + k kd) θ' + k kp (θ − a) = f,

in which B and kd appear in their sum alone. A *swap* moves damping from one to the other and keeps the sum. It changes
the motion where kd θ' is not what acts on the joint: a torque limit cuts it, a sampled controller holds it, a filter
delays it, friction may grow with the drive torque, and a net has learned it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import expm1, log1p

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Joint, Trajectory

SMALL = 1e-3
"""Time constants under which the answer to a constant torque is taken from its series, which is then exact."""


@dataclass(frozen=True)
class Sampling:
    """How the controller samples."""

    period: float
    """Time between two torques [s]."""
    late: int = 0
    """Periods by which the velocity that the controller uses is late [1]."""
    cutoff: float = float("inf")
    """First-order low-pass on the velocity, its cut-off frequency [Hz]; infinite for none."""

    def __post_init__(self) -> None:
        """Refuse a controller that no computer runs."""
        if not (0 < self.period < np.inf and self.late >= 0 and self.cutoff > 0):
            raise ConfigurationError(
                f"controller with period {self.period} s, velocity {self.late} periods late, cut-off {self.cutoff} Hz: "
                "expected a positive period, no negative lateness and a positive cut-off"
            )

    @property
    def pass_share(self) -> float:
        """Share of the newest velocity in the filtered one, 1 − exp(−2π cutoff period)."""
        return -expm1(-2.0 * np.pi * self.cutoff * self.period)


def slide(joint: Joint, force: float, position: float, velocity: float, span: float) -> tuple[float, float]:
    """Return θ and θ' after `span` seconds of I θ'' = force − B θ', force constant [N m]."""
    x = joint.viscous * span / joint.inertia
    first = -expm1(-x) / x if x > SMALL else 1.0 - x / 2.0 + x**2 / 6.0 - x**3 / 24.0
    second = (1.0 - first) / x if x > SMALL else 0.5 - x / 6.0 + x**2 / 24.0
    push = force / joint.inertia
    moved = span * (velocity * first + push * span * second)
    return position + moved, velocity * (1.0 - x * first) + push * span * first


def hold(joint: Joint, torque: float, coulomb: float, state: tuple[float, float], span: float) -> tuple[float, float]:
    """Return θ and θ' after `span` seconds under a constant torque; coulomb: friction, also at rest [N m]."""
    position, velocity = state
    if velocity != 0.0:
        force = torque - np.sign(velocity) * coulomb
        if force * velocity < 0:
            # The joint stops after I/B ln(1 - B θ'/force), without B after -I θ'/force.
            x = -velocity * joint.viscous / force
            stop = -joint.inertia * velocity / force * (log1p(x) / x if x > 1e-12 else 1.0)
            if stop < span:
                position, velocity, span = slide(joint, force, position, velocity, stop)[0], 0.0, span - stop
    if velocity == 0.0:
        if abs(torque) <= coulomb:
            return position, 0.0
        force = torque - np.sign(torque) * coulomb
    return slide(joint, force, position, velocity, span)


def simulate_sampled(
    joint: Joint, gains: PDGains, sampling: Sampling, target: np.ndarray, effort: float = 0.0
) -> Trajectory:
    """Simulate from rest at θ = 0; the result is at the controller's samples.

    target: a at each period [rad], shape (num_samples,); effort: friction per drive torque, c of the law
    b_c + c |τ| [1]. Raises `StictionError` for another law of friction than Coulomb's, a weight, or negative B.
    """
    if not isinstance(joint.friction, Coulomb) or joint.gravity is not None or joint.viscous < 0:
        raise ConfigurationError("the sampled controller is simulated with B ≥ 0 and Coulomb friction, without gravity")
    samples = np.empty((3, len(target)))
    state, filtered, share = (0.0, 0.0), 0.0, sampling.pass_share
    past = [0.0] * (sampling.late + 1)
    for index, goal in enumerate(np.asarray(target, float).tolist()):
        past = [*past[1:], state[1]]
        filtered += share * (past[0] - filtered)
        commanded = gains.strength * (gains.kp * (goal - state[0]) - gains.kd * filtered)
        torque = min(max(commanded, -gains.torque_limit), gains.torque_limit)
        samples[:, index] = *state, torque
        state = hold(joint, torque, joint.friction.level + effort * abs(torque), state, sampling.period)
    return Trajectory(*samples)


def growth(joint: Joint, gains: PDGains, sampling: Sampling) -> float:
    """Return the factor by which a disturbance grows a period, without friction and limit; unstable above 1 [1].

    The spectral radius of the loop with the state θ, θ', the late velocities and the filter's.
    """
    late, share = sampling.late, sampling.pass_share
    zero = np.array([slide(joint, 0.0, *start, sampling.period) for start in ((1.0, 0.0), (0.0, 1.0))]).T
    push = np.array(slide(joint, 1.0, 0.0, 0.0, sampling.period))
    size = 3 + late
    # Columns: θ, θ', then θ' of 1 to `late` periods ago, last what the filter gave one period ago.
    used = np.zeros(size)
    used[1 + late], used[-1] = share, 1.0 - share
    torque = -gains.strength * (gains.kp * np.eye(size)[0] + gains.kd * used)
    loop = np.zeros((size, size))
    loop[:2, :2] = zero
    loop[:2] += np.outer(push, torque)
    for age in range(late):
        loop[2 + age, 1 + age] = 1.0
    loop[-1] = used
    return float(np.abs(np.linalg.eigvals(loop)).max())


def total_damping(joint: Joint, gains: PDGains) -> float:
    """Return B + k kd [N m s/rad]."""
    return joint.viscous + gains.strength * gains.kd


def swapped(joint: Joint, gains: PDGains, moved: float) -> tuple[Joint, PDGains]:
    """Return joint and gains with `moved` [N m s/rad] of damping taken from k kd and given to B; negative: back.

    Raises `StictionError` where B or kd would become negative.
    """
    viscous, derivative = joint.viscous + moved, gains.kd - moved / gains.strength
    if viscous < 0.0 or derivative < 0.0:
        raise ConfigurationError(
            f"{moved:.4g} N m s/rad moved from k kd to B leaves kd {derivative:.4g} and B {viscous:.4g}: expected at "
            f"least {-joint.viscous:.4g} and at most {gains.strength * gains.kd:.4g}"
        )
    return replace(joint, viscous=viscous), replace(gains, kd=derivative)


@dataclass(frozen=True)
class Difference:
    """How far two motions of a joint are apart, at the sample where they are furthest."""

    position: float
    velocity: float
    torque: float
    """Torque of the motor [N m]; a swap always changes it, by `moved` times the speed."""


def largest_difference(first: Trajectory, second: Trajectory) -> Difference:
    """Return how far two trajectories of the same samples are apart."""
    pairs = ((getattr(first, name), getattr(second, name)) for name in ("position", "velocity", "torque"))
    return Difference(*(float(np.abs(one - other).max()) for one, other in pairs))


@dataclass(frozen=True)
class LinearNet:
    """The smallest Actuator Net: torque = stiffness · (a − θ) − damping · θ'."""

    stiffness: float
    """[N m/rad]."""
    damping: float
    """[N m s/rad]."""

    def as_gains(self) -> PDGains:
        """Return the controller that it is, without limit."""
        return PDGains(self.stiffness, self.damping)


def fit_net(error: np.ndarray, velocity: np.ndarray, torque: np.ndarray) -> LinearNet:
    """Fit a net by least squares; a − θ [rad], θ' [rad/s] and logged torque [N m], shape (num_samples,) each."""
    weights, *_ = np.linalg.lstsq(np.column_stack([error, -velocity]), torque, rcond=None)
    return LinearNet(float(weights[0]), float(weights[1]))


def output_torque(joint: Joint, trajectory: Trajectory) -> np.ndarray:
    """Return the joint's output, motor torque less B θ' and dry friction [N m], 0 at rest, shape (num_samples,).

    Raises `StictionError` for a law other than plain Coulomb friction in both directions.
    """
    pieces = [joint.friction.pieces(direction) for direction in (1, -1)]
    if any(len(chain) != 1 or chain[0].slope for chain in pieces) or joint.friction.depends_on_angle:
        raise ConfigurationError(f"{type(joint.friction).__name__} friction: expected Coulomb friction")
    level = np.where(trajectory.velocity > 0, pieces[0][0].level, pieces[1][0].level)
    sliding = trajectory.torque - joint.viscous * trajectory.velocity - np.sign(trajectory.velocity) * level
    return np.where(trajectory.velocity == 0.0, 0.0, sliding)
