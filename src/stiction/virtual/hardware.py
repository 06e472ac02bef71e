"""The drive train: from commanded to delivered motor torque, and through the gears to the joint.

Backlash: between a motor and its joint there is a gap, and while it is crossed neither moves the other.

An engine has one angle q per joint, and carries the rotor's inertia I as `Body.armature` of that angle. The rotor gets
an angle φ of its own here, in units of the joint, as encoders see it, and is in one of two states:

* **engaged** on side s = ±1: φ = q + s·gap/2, φ' = q'. The engine moves both, under the motor's torque τ. The teeth
  transmit c = τ − I φ''. They can push and not pull: where s·c < 0 they part.
* **in the gap**: I φ'' = τ, the rotor alone; it is integrated here, exactly for a constant torque. The link moves
  alone. The engine still adds I to its inertia, so it is given the torque I q'' that the rotor would have taken, with
  q'' of the step before. With M for the links' inertia at the joints that error decays in every step by I/(M + I),
  whose eigenvalues lie below one: the loop is stable whatever the link. A link that slows down is given no more than
  what brings it to rest, or the late torque would reverse it.

Where they meet again they stay together: teeth in grease do not bounce. The joint receives the momentum
I (φ' − q') in one step. As the engine's inertia at the joint includes I, that alone makes

    (M + I) q'_after = M q'_before + I φ'_before,

the plastic impact of the two bodies, in however many dimensions, and no property of the links has to be known.

All of the dry and viscous friction is on the link's side of the gap: with its teeth engaged a joint has the same
friction as one without backlash. The stiffness of the teeth is not modelled: it would need steps of some 0.1 ms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.core.rotation import tilted_once

LOWEST_VOLTAGE = 0.5
"""Minimum battery voltage over its nominal one [1]; the sag ends there."""

SMOOTHING = 0.01
"""Time constant of the capacitors between battery and motors [s]."""

LOSS_AT_LIMIT = 800.0
"""Electrical power that a motor turns into heat at its torque limit [W]; it grows with the torque's square."""


@dataclass(frozen=True)
class Motors:
    """J motors and their battery. Arrays have shape (J,)."""

    armature: np.ndarray
    """Rotor inertia over the nominal one [1]."""
    damping: np.ndarray
    """Viscous friction over the nominal one [1]."""
    strength: np.ndarray
    """Delivered over commanded torque, k: the true torque constant over the data sheet's, with which motors report [1].
    """
    no_load_speed: np.ndarray
    """Speed without remaining torque, at the battery's nominal voltage [rad/s]."""
    knee: float
    """Share of that speed up to which all of the torque is available [1]."""
    charge: float
    """Open-circuit voltage of the battery over its nominal one, constant over a run [1]."""
    resistance: float
    """Drop of that ratio per watt [1/W]."""

    @classmethod
    def perfect(cls, num_joints: int) -> Motors:
        """Return motors as in training, with only a torque limit."""
        ones = np.ones(num_joints)
        return cls(ones, ones, ones, np.full(num_joints, np.inf), 0.5, 1.0, 0.0)


def commanded_torque(
    kp: np.ndarray, kd: np.ndarray, target: np.ndarray, forward: np.ndarray, angle: np.ndarray, velocity: np.ndarray
) -> np.ndarray:
    """Return τ = τ_ff + kp (a − θ) − kd θ' [N m], from measured angle and velocity; shape (J,)."""
    return forward + kp * (target - angle) - kd * velocity


def within_limits(
    torque: np.ndarray, speed: np.ndarray, limit: np.ndarray, no_load_speed: np.ndarray, knee: float
) -> np.ndarray:
    """Return the reachable part of a commanded torque at a speed φ' [rad/s] [N m], shape (J,).

    Driving, the limit falls linearly to zero from `knee` of the no-load speed on; braking, it stays.
    """
    # In units of what is left above the knee: 1 at the knee, 0 at the no-load speed.
    share = np.minimum(np.maximum((1.0 - np.abs(speed) / no_load_speed) / (1.0 - knee), 0.0), 1.0)
    most = np.where(torque * speed > 0, share, 1.0) * limit
    return np.minimum(np.maximum(torque, -most), most)


def drawn_power(torque: np.ndarray, speed: np.ndarray, limit: np.ndarray) -> float:
    """Return the power from the battery [W]: work and heat of all motors, at least zero."""
    heat = LOSS_AT_LIMIT * np.square(torque / limit)
    return max(0.0, float((torque * speed + heat).sum()))


class Drive:
    """The motors of one robot on one battery."""

    def __init__(self, motors: Motors, limit: np.ndarray, timestep: float) -> None:
        """Make the motors; limit: torque limits of the data sheet [N m], shape (J,); timestep: of the physics [s]."""
        self._motors, self._limit, self._timestep = motors, limit, timestep
        self.reset()

    def reset(self) -> None:
        """Reset to an unloaded battery."""
        self.voltage = self._motors.charge
        """Voltage of the battery, over its nominal one [1]."""

    def torque(self, commanded: np.ndarray, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return delivered and reported torques of one step [N m], (J,), at rotor speeds φ' [rad/s].

        The voltage of the battery drops.
        """
        motors = self._motors
        reported = within_limits(commanded, speed, self._limit, motors.no_load_speed * self.voltage, motors.knee)
        delivered = motors.strength * reported
        sagged = motors.charge - motors.resistance * drawn_power(delivered, speed, self._limit)
        # No more than the whole way, for steps longer than the time constant.
        self.voltage += min(1.0, self._timestep / SMOOTHING) * (max(sagged, LOWEST_VOLTAGE) - self.voltage)
        return delivered, reported


class Gears:
    """Rotors of J joints. Arrays have shape (J,)."""

    def __init__(self, gap: np.ndarray, inertia: np.ndarray, timestep: float) -> None:
        """Make the rotors: `gap`: full width at the joint [rad], 0 for a rigid one; inertia: I [kg m²]."""
        self._half, self._inertia, self._timestep = 0.5 * gap, inertia, timestep
        self._rigid, self._gapped = not gap.any(), gap > 0
        self.reset(np.zeros_like(gap))

    def reset(self, position: np.ndarray) -> None:
        """Reset to rest at joint angles [rad], the teeth in the middle of their gaps."""
        self.angle, self.velocity = position.copy(), np.zeros_like(position)
        """Angle and velocity of the rotors, φ [rad] and φ' [rad/s]."""
        self.side = np.where(self._gapped, 0, 1)
        """Side of the touching teeth: -1 or 1; 0 in the gap."""
        self._link_velocity, self._link_acceleration = np.zeros_like(position), np.zeros_like(position)

    @property
    def engaged(self) -> np.ndarray:
        """True where motor and link turn together, bool."""
        return self.side != 0

    def transmit(self, torque: np.ndarray) -> np.ndarray:
        """Return the torques on the engine's joints in the coming step [N m], under the motors' torques [N m]."""
        if self._rigid:
            return torque
        impact = self._inertia * (self.velocity - self._link_velocity) / self._timestep
        # What would bring the link to rest within the step.
        stopping = -self._link_velocity / self._timestep
        slowing = self._link_acceleration * self._link_velocity <= 0
        coasting = np.where(
            slowing & (np.abs(self._link_acceleration) > np.abs(stopping)), stopping, self._link_acceleration
        )
        return np.where(self.engaged, torque + impact, self._inertia * coasting)

    def follow(self, torque: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> None:
        """Move the rotors through the engine's last step, under the motors' torques [N m]."""
        if self._rigid:
            self.angle, self.velocity = position.copy(), velocity.copy()
            return
        step, engaged = self._timestep, self.engaged
        acceleration = torque / self._inertia
        free_angle = self.angle + self.velocity * step + 0.5 * acceleration * step**2
        free_velocity = self.velocity + acceleration * step
        transmitted = torque - self._inertia * (velocity - self.velocity) / step
        lead = free_angle - position
        # Teeth that have just parted are still at the edge of the gap; only those that move outward meet.
        closing = lead * (free_velocity - velocity) >= 0
        hit = ~engaged & (np.abs(lead) >= self._half) & closing
        parted = engaged & self._gapped & (self.side * transmitted < 0)
        # Teeth that part begin where they were; teeth that meet keep the rotor's velocity until the next step.
        side = np.where(hit, np.where(lead >= 0, 1, -1), self.side)
        self.angle = np.where(engaged | hit, position + side * self._half, free_angle)
        self.angle = np.where(self._gapped, self.angle, position)
        self.velocity = np.where(engaged, velocity, free_velocity)
        self.side = np.where(parted, 0, side)
        self._link_acceleration = (velocity - self._link_velocity) / step
        self._link_velocity = velocity.copy()


WANDERING = 1.0
"""Correlation time of the orientation filter's error [s]."""


@dataclass(frozen=True)
class SensorErrors:
    """Errors of the sensors of one robot. White noise has a standard deviation, per reading."""

    encoder_step: float
    """Step of the measured rotor angle, at the joint [rad]; 0 for none."""
    encoder_offset: np.ndarray
    """Measured minus true rotor angle [rad], shape (J,): the zero was set by hand."""
    velocity_filter: float
    """Time constant with which the motor controller smooths differences of the angle [s]; 0: it measures φ' exactly."""
    torque_noise: float
    """White noise of the reported torque over the motor's limit [1]."""
    torque_zero: np.ndarray
    """Constant error of the reported torque over the limit [1], shape (J,)."""
    gyroscope_noise: float
    """White noise [rad/s]."""
    gyroscope_bias: np.ndarray
    """Constant error, base frame [rad/s], shape (3,)."""
    tilt_bias: np.ndarray
    """Constant error of the estimated roll and pitch [rad], shape (2,): mounting of the IMU."""
    tilt_wander: float
    """Standard deviation of the orientation filter's error, correlated over `WANDERING` [rad]."""

    @classmethod
    def perfect(cls, num_joints: int) -> SensorErrors:
        """Return sensors without errors."""
        zero = np.zeros(num_joints)
        return cls(0.0, zero, 0.0, 0.0, zero, 0.0, np.zeros(3), np.zeros(2), 0.0)


class Encoders:
    """Rotor angles and velocities as the motor controllers measure them, at every physics step. Shapes (J,)."""

    def __init__(self, errors: SensorErrors, timestep: float) -> None:
        """Prepare the encoders; timestep: of the physics, at which the controllers run [s]."""
        self._errors, self._timestep = errors, timestep
        time = errors.velocity_filter
        self._fresh = 1.0 - np.exp(-timestep / time) if time else None

    def reset(self, angle: np.ndarray) -> None:
        """Reset to rotors at rest at an angle [rad]."""
        self.angle, self.velocity = self._measured(angle), np.zeros_like(angle)
        """Measured angle and velocity, [rad] and [rad/s]."""

    def follow(self, angle: np.ndarray, velocity: np.ndarray) -> None:
        """Measure the rotors after a step: true angles φ [rad], velocities φ' [rad/s]."""
        before, self.angle = self.angle, self._measured(angle)
        if self._fresh is not None:
            # Of counted angles: the steps of the encoder are in the velocity, as on a motor controller.
            self.velocity = self.velocity + self._fresh * ((self.angle - before) / self._timestep - self.velocity)
        else:
            self.velocity = velocity.copy()

    def _measured(self, angle: np.ndarray) -> np.ndarray:
        """Return angles as the encoder counts them [rad]."""
        shifted = angle + self._errors.encoder_offset
        step = self._errors.encoder_step
        return np.round(shifted / step) * step if step else shifted


class Imu:
    """Gyroscope and orientation filter."""

    def __init__(self, errors: SensorErrors, period: float, generator: np.random.Generator) -> None:
        """Prepare the IMU; period: between two readings [s]; generator: of the noise."""
        self._errors, self._generator = errors, generator
        self._decay = float(np.exp(-period / WANDERING))
        # So that the error's variance stays that of the start, whatever the period.
        self._fresh = errors.tilt_wander * np.sqrt(1.0 - self._decay**2)
        self.reset()

    def reset(self) -> None:
        """Reset to the stationary distribution of the filter's error."""
        self._wander = self._errors.tilt_wander * self._generator.standard_normal(2)

    def read(self, quaternion: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return measured orientation and angular velocity, from the true ones; shapes (4,) and (3,) [rad/s]."""
        errors, draw = self._errors, self._generator.standard_normal
        self._wander = self._decay * self._wander + self._fresh * draw(2)
        half = 0.5 * (errors.tilt_bias + self._wander)
        return tilted_once(quaternion, *half.tolist()), rate + errors.gyroscope_bias + errors.gyroscope_noise * draw(3)
