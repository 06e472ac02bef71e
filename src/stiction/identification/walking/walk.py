"""Walking log with its robot: motion of every leg and the base, and the feet that bear load. Nothing is filtered.

A sample holds the state at its time and the torque over the period that follows, so rates are forward differences of
angle and angular velocity; the acceleration is the second difference of the angle. Filtering waits until the equations
are written down (`swing.py`, `stance.py`): the products of filtered signals are not the filtered products.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from stiction.core.errors import LogError
from stiction.core.rotation import crosses, up_in_frames
from stiction.files.walk import WalkLog
from stiction.identification.limb.dynamics import Motion, base_motion, link_motions, whole_effort
from stiction.identification.walking.setup import WalkSetup
from stiction.joints.pd import controller_torque
from stiction.robots.model import GRAVITY, Robot

SHORTEST = 1.0
"""Shortest walk that is used [s]."""

LONGEST_PERIOD = 0.005
"""Longest time between samples [s]. A swing of 0.15 s has 30 samples at 200 Hz, and seven at the policy's 50 Hz."""

RATE_SPAN = 0.005
"""Time over which a joint's rate is taken [s]: over a shorter one, encoder noise would pretend reversals."""

BEARING = 0.1
"""Share of the robot's weight above which a foot is taken to bear load, by the motors' torque [1]."""

SOURCES = {
    "logged": "foot contact or force, as logged",
    "torque": f"the motors' torque: what it leaves for the ground is over {BEARING:.0%} of the robot's weight",
    "height": "kinematics: feet clear of the lowest one are taken to swing, as on flat ground",
}
"""Source of contact -> its words."""


@dataclass(frozen=True)
class Walk:
    """A walk, T samples, of a robot with J joints and L feet. Vectors are in the base's frame, at its origin.

    Raises `LogError` where the log is not of this robot, too short or too slow, its torque has the joint friction in
    it, or it lacks the contact that was asked for.
    """

    log: WalkLog
    """Recorded log."""
    spec: Robot
    """Robot that walked."""
    setup: WalkSetup = field(default_factory=WalkSetup)
    """Choices and declarations."""
    notes: tuple[str, ...] = ()
    """Notes on the reading of the log for readers of the results, one sentence each."""
    sampled: bool = False
    """True if the torque is that at the stamp, as a robot says it; else it is the mean over the period that follows."""
    unplaced: float = 0.0
    """Largest distance of the accelerometer from the base's origin along each axis [m]; 95 % bound."""

    def __post_init__(self) -> None:
        """Reject a walk that cannot be used."""
        header, spec, period = self.log.header, self.spec, self.period
        if self.setup.contact == "logged" and self.log.foot_contact is None:
            raise LogError("--contact logged: the log has no foot contact and no foot force; expected --contact height")
        if header.joint_names != spec.joint_names:
            raise LogError(
                f"the log has the joints {', '.join(header.joint_names[:4])}, ..., robot {spec.name!r} "
                f"{', '.join(spec.joint_names[:4])}, ...; name the robot that walked with --robot"
            )
        if self.log.foot_contact is not None and header.foot_names != spec.foot_names:
            raise LogError(
                f"the log has the feet {', '.join(header.foot_names)}, robot {spec.name!r} "
                f"{', '.join(spec.foot_names)}; order the columns of foot_contact and their names as the robot's"
            )
        if header.torque_source == "output_side":
            raise LogError(
                "torque source output_side: a sensor behind the gear does not see the joint's friction; "
                "log the motor's current or command (motor_side)"
            )
        if len(self) * period < SHORTEST or period > 1.001 * LONGEST_PERIOD:
            raise LogError(
                f"the log has {len(self)} samples {period:g} s apart; expected at least {SHORTEST:g} s, sampled at "
                f"{1 / LONGEST_PERIOD:.0f} Hz or more, for the acceleration of a leg in swing: log for longer, or "
                "faster"
            )

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.log)

    @property
    def period(self) -> float:
        """Time between samples [s]."""
        return self.log.header.period

    @property
    def limits(self) -> np.ndarray:
        """Torque limits of the motors [N m], shape (J,)."""
        return np.array(self.log.header.torque_limit)

    @property
    def measured_torque(self) -> bool:
        """True if the torque was logged; else it is that of the PD law with the log's gains."""
        return self.log.joint_torque is not None

    @property
    def measured_acceleration(self) -> bool:
        """True if there was an accelerometer; else gravity is all of the specific force."""
        return self.log.specific_force is not None

    @cached_property
    def torque(self) -> np.ndarray:
        """Torque of the motors [N m], shape (T, J)."""
        return commanded_torque(self.log) if self.log.joint_torque is None else self.log.joint_torque

    @cached_property
    def slope(self) -> np.ndarray:
        """Rate of the torque [N m/s], shape (T, J)."""
        return np.gradient(self.torque, self.period, axis=0)

    @property
    def jumps(self) -> np.ndarray:
        """Change of a sampled torque by the target's, kp times its rate [N m/s], shape (T, J); zero for a mean.

        A torque that jumps with every target is not known between two samples.
        """
        return np.array(self.log.header.kp) * forward_difference(self.log.joint_target, self.period) * self.sampled

    @cached_property
    def rate(self) -> np.ndarray:
        """Joint velocity in the middle of the period after each sample, as friction sees it [rad/s], shape (T, J)."""
        return joint_rate(self.log.joint_position, self.period)

    @cached_property
    def acceleration(self) -> np.ndarray:
        """θ'' of the joints [rad/s²], shape (T, J)."""
        return second_difference(self.log.joint_position, self.period)

    @cached_property
    def upward(self) -> np.ndarray:
        """Direction up, unit vectors, shape (T, 3)."""
        return up_in_frames(self.log.quaternion)

    @cached_property
    def base(self) -> Motion:
        """Motion of the base."""
        spin, force = self.log.angular_velocity, self.log.specific_force
        return base_motion(
            GRAVITY * self.upward if force is None else force, spin, forward_difference(spin, self.period)
        )

    @cached_property
    def links(self) -> list[Motion]:
        """Motion of the links."""
        log = self.log
        return link_motions(self.spec.links, self.base, log.joint_position, log.joint_velocity, self.acceleration)

    @cached_property
    def effort(self) -> tuple[np.ndarray, np.ndarray]:
        """Effort of the links, feet in the air: joint torques [N m], (T, J), and the base's wrench on them, (T, 6)."""
        return whole_effort(self.spec.links, self.links)

    @cached_property
    def weights(self) -> np.ndarray:
        """Weights of the smoothing window."""
        return hann_weights(self.setup.smoothing, self.period)

    @cached_property
    def carriers(self) -> np.ndarray:
        """True where a foot hangs on a joint, shape (L, J); `down @ carriers`: where a joint bears load, (T, J)."""
        chains = [self.spec.chain(foot.link) for foot in self.spec.feet]
        return np.array([[joint in chain for joint in range(self.spec.num_joints)] for chain in chains])

    @cached_property
    def resting(self) -> np.ndarray:
        """True where a joint hardly moves or turns round, margin included, shape (T, J)."""
        slow = np.abs(self.rate) < self.setup.slow
        slow[1:] |= np.diff(np.sign(self.rate), axis=0) != 0
        margin = round(self.setup.stop_margin / self.period)
        return np.stack([grow(column, margin) for column in slow.T], axis=1)

    @cached_property
    def upward_map(self) -> np.ndarray:
        """Ground's upward force on each foot per torque about each joint [1/m], shape (T, L, J)."""
        forces = np.zeros((len(self), len(self.spec.feet), self.spec.num_joints))
        for feet, joints in legs(self.spec):
            stacked = np.concatenate(
                [foot_jacobian(self.spec, self.links, foot, joints)[:, :3] for foot in feet], axis=1
            )
            # A stretched leg hardly feels some direction: the force along it is taken as none, instead of as huge.
            inverse = np.linalg.pinv(np.swapaxes(stacked, 1, 2), rcond=1e-3).reshape(len(self), len(feet), 3, -1)
            forces[np.ix_(range(len(self)), feet, joints)] = np.einsum("tlij,ti->tlj", inverse, self.upward)
        return forces

    @property
    def contact(self) -> str:
        """Source of contact, a key of `SOURCES`."""
        if self.setup.contact == "auto":
            return "height" if self.log.foot_contact is None else "logged"
        return self.setup.contact

    @cached_property
    def down(self) -> np.ndarray:
        """True where a foot may bear load: as logged, by the motors' torque, or by its height; shape (T, L)."""
        if self.contact == "logged":
            assert self.log.foot_contact is not None
            return self.log.foot_contact
        if self.contact == "torque":
            # Jᵀ F = τ_links - τ; rotors and joint friction are left out, which is what limits it.
            force = np.einsum("tlj,tj->tl", self.upward_map, self.effort[0] - self.torque)
            return smooth(force, self.weights) > BEARING * self.spec.weight
        height = np.einsum("tli,ti->tl", foot_positions(self.spec, self.links), self.upward)
        height -= [foot.radius for foot in self.spec.feet]
        return height - height.min(axis=1, keepdims=True) < self.setup.clearance

    def blocks(self, length: float) -> np.ndarray:
        """Return the number of the block of `length` [s] that each sample is in, shape (T,)."""
        return np.arange(len(self)) // round(length / self.period)


def legs(spec: Robot) -> tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]:
    """Return the numbers of the feet and of the joints of each leg, joints ascending: no two have one in common."""
    groups: list[tuple[tuple[int, ...], set[int]]] = []
    for number, foot in enumerate(spec.feet):
        feet: tuple[int, ...] = (number,)
        joints = set(spec.chain(foot.link))
        for leg in [leg for leg in groups if leg[1] & joints]:
            groups.remove(leg)
            feet, joints = leg[0] + feet, leg[1] | joints
        groups.append((feet, joints))
    return tuple((feet, tuple(sorted(joints))) for feet, joints in groups)


def foot_positions(spec: Robot, links: Sequence[Motion]) -> np.ndarray:
    """Return the middles of the feet in the base's frame [m], shape (T, L, 3)."""
    return np.stack(
        [links[foot.link].origin + links[foot.link].rotation @ np.array(foot.position) for foot in spec.feet], axis=1
    )


def foot_jacobian(spec: Robot, links: Sequence[Motion], number: int, joints: Sequence[int]) -> np.ndarray:
    """Return J of the middle of a foot by some joints, v = J θ', shape (T, 6, joints).

    Rows: velocity x y z [m/s], rate of turn x y z [rad/s], in the base's frame.
    """
    foot = spec.feet[number]
    place = links[foot.link].origin + links[foot.link].rotation @ np.array(foot.position)
    jacobian = np.zeros((len(place), 6, len(joints)))
    for column, joint in enumerate(joints):
        if joint in spec.chain(foot.link):
            jacobian[:, :3, column] = crosses(links[joint].axis, place - links[joint].origin)
            jacobian[:, 3:, column] = links[joint].axis
    return jacobian


def forward_difference(values: np.ndarray, period: float) -> np.ndarray:
    """Return the mean rate over the period after each sample, shape of `values`, (T, ...); the last one twice."""
    rate = np.diff(values, axis=0) / period
    return np.concatenate([rate, rate[-1:]])


def joint_rate(position: np.ndarray, period: float) -> np.ndarray:
    """Return the velocity in the middle of the period after each sample, over at least `RATE_SPAN`, shape (T, J)."""
    reach = max(0, round((RATE_SPAN / period - 1) / 2))
    index = np.arange(len(position))
    # As far to either side of the middle of the period that follows the sample.
    after, before = np.minimum(index + 1 + reach, len(position) - 1), np.maximum(index - reach, 0)
    return (position[after] - position[before]) / (np.maximum(after - before, 1) * period)[:, None]


def second_difference(values: np.ndarray, period: float) -> np.ndarray:
    """Return the acceleration at each sample, shape of `values`, (T, ...); zero at both ends."""
    acceleration = np.zeros_like(values)
    acceleration[1:-1] = (values[2:] - 2 * values[1:-1] + values[:-2]) / period**2
    return acceleration


def commanded_torque(log: WalkLog) -> np.ndarray:
    """Return kp (target - θ) - kd θ' within the limit [N m], shape (T, J): the command to the motors.

    The mean over the period that follows each sample: of the law at both ends, under the target of its start.
    """
    header = log.header
    gains = [np.array(values) for values in (header.kp, header.kd, header.torque_limit)]
    now = controller_torque(log.joint_target, log.joint_position, log.joint_velocity, *gains)
    position, velocity = (
        np.concatenate([signal[1:], signal[-1:]]) for signal in (log.joint_position, log.joint_velocity)
    )
    return (now + controller_torque(log.joint_target, position, velocity, *gains)) / 2


def hann_weights(length: float, period: float) -> np.ndarray:
    """Return the weights of a Hann window of `length` [s] without its zeros, an odd number of them that add up to 1."""
    half = max(1, round(length / period / 2))
    weights = np.hanning(2 * half + 1)[1:-1]
    return weights / weights.sum()


def smooth(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the weighted mean of neighbours along axis 0, shape of `values`; half a window at each end is unusable."""
    flat = values.reshape(len(values), -1)
    columns = [np.convolve(column, weights, "same") for column in flat.T]
    return np.stack(columns, axis=1).reshape(values.shape)


def grow(mask: np.ndarray, samples: int) -> np.ndarray:
    """Return a mask, shape (T,), widened by `samples` on each side of every sample set; the ends count as set."""
    if samples == 0:
        return mask.copy()
    grown = np.convolve(mask, np.ones(2 * samples + 1), "same") > 0.5
    grown[:samples] = grown[-samples:] = True
    return grown


def swings(down: np.ndarray, margin: int) -> np.ndarray:
    """Return the number of the swing that each sample of one foot belongs to, 0 where it is in none, shape (T,).

    down: bool, shape (T,). `margin` samples are left out at both ends of each swing, and the log's ends are no swing.
    """
    air = ~grow(down, margin + 1)
    return np.where(air, np.cumsum(np.diff(air, prepend=False) & air), 0)
