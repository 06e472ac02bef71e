"""A simulated servo: a motor behind a bridge, driven by voltage, with and without a known pendulum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.files.log import JointSignals, Log, LogSetup
from stiction.identification.example import Excitation
from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Gravity, Joint, simulate
from stiction.robots.model import GRAVITY

SWING = Excitation(amplitudes=(0.9, 0.4), frequencies=(0.4, 1.1), duration=15.0, rate=200.0)
"""Far enough that a pendulum's weight is no line."""

HANGS = 0.3
"""Angle at which the pendulum hangs straight down [rad]."""


@dataclass(frozen=True)
class Servo:
    """The truth. At 12 V it holds 4.5 N m and brakes itself by kt ke/R = 0.5625 N m s/rad."""

    inertia: float = 0.012
    viscous: float = 0.12
    coulomb: float = 0.15
    kt: float = 1.5
    ke: float = 1.5
    resistance: float = 4.0
    supply: float = 12.0

    @property
    def brake(self) -> float:
        """Kt ke/R [N m s/rad]."""
        return self.kt * self.ke / self.resistance

    def log(
        self, column: str = "duty", mass: float = 0.0, length: float = 0.2, seed: int = 0, noise: float = 1.0, **setup
    ) -> Log:
        """Return a log whose torque column holds what `column` says, a mass [kg] hanging at a length [m].

        noise: 1 for an encoder of 14 bits, 1 % of noise on what was logged and none in the loop, 0 for none.
        """
        weight = mass * GRAVITY * length
        # The torque weight sin(θ - HANGS), in its parts of sin θ and cos θ.
        gravity = Gravity(weight * np.cos(HANGS), -weight * np.sin(HANGS)) if mass else None
        joint = Joint(self.inertia + mass * length**2, self.viscous, Coulomb(self.coulomb), 0.02, gravity)
        time, target = SWING.target()
        target = (1.0 + 0.05 * seed) * target
        motion = simulate(joint, PDGains(12.0, 0.6, 1e3), time[1] - time[0], target)
        current = motion.torque / self.kt
        volts = self.resistance * current + self.ke * motion.velocity
        values = {"torque": motion.torque, "current": current, "voltage": volts, "duty": volts / self.supply}[column]
        rng = np.random.default_rng(seed)
        values = values + noise * 0.01 * np.std(values) * rng.standard_normal(len(time))
        step = noise * 2 * np.pi / 2**14
        position = np.round(motion.position / step) * step if step else motion.position
        base = {"torque_source": "motor_side", "test_condition": "loaded" if mass else "bare_motor"}
        return Log(
            f"{column}_{mass:g}_{seed}", time, {"knee": JointSignals(position, torque=values)}, LogSetup(**base | setup)
        )


SERVO = Servo()
