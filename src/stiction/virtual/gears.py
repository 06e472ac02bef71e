"""Backlash: between a motor and its joint there is a gap, and while it is crossed neither moves the other.

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

import numpy as np


class Gears:
    """The rotors of J joints. Arrays have shape (J,)."""

    def __init__(self, gap: np.ndarray, inertia: np.ndarray, timestep: float) -> None:
        """Make the rotors.

        gap: whole width, in angles of the joint [rad]; where it is zero rotor and joint are one. inertia: I, the
        engine's armature [kg m²]; timestep: of the physics [s].
        """
        self._half, self._inertia, self._timestep = 0.5 * gap, inertia, timestep
        self._rigid = not gap.any()
        self.reset(np.zeros_like(gap))

    def reset(self, position: np.ndarray) -> None:
        """Begin at rest at joint angles [rad], the teeth in the middle of their gaps."""
        self.angle, self.velocity = position.copy(), np.zeros_like(position)
        """Of the rotors, φ [rad] and φ' [rad/s]."""
        self.side = np.where(self._half > 0, 0, 1)
        """Which teeth touch: -1 or 1; 0 in the gap."""
        self._link_velocity, self._link_acceleration = np.zeros_like(position), np.zeros_like(position)

    @property
    def engaged(self) -> np.ndarray:
        """Whether motor and link turn together, bool."""
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
        """Move the rotors through the step that the engine has taken under the motors' torques [N m].

        position, velocity: of the engine's joints after it [rad], [rad/s].
        """
        if self._rigid:
            self.angle, self.velocity = position.copy(), velocity.copy()
            return
        step, engaged = self._timestep, self.engaged
        acceleration = torque / self._inertia
        free_angle = self.angle + self.velocity * step + 0.5 * acceleration * step**2
        free_velocity = self.velocity + acceleration * step
        transmitted = torque - self._inertia * (velocity - self.velocity) / step
        away = free_angle - position
        # Teeth that have just parted are still at the edge of the gap; only those that move outward meet.
        closing = away * (free_velocity - velocity) >= 0
        hit = ~engaged & (np.abs(away) >= self._half) & closing
        parted = engaged & (self._half > 0) & (self.side * transmitted < 0)
        # Teeth that part begin where they were; teeth that meet keep the rotor's velocity until the next step.
        side = np.where(hit, np.where(away >= 0, 1, -1), self.side)
        self.angle = np.where(engaged | hit, position + side * self._half, free_angle)
        self.angle = np.where(self._half > 0, self.angle, position)
        self.velocity = np.where(engaged, velocity, free_velocity)
        self.side = np.where(parted, 0, side)
        self._link_acceleration = (velocity - self._link_velocity) / step
        self._link_velocity = velocity.copy()
