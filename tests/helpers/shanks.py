"""Motors with known friction beside those of the example: the paper's other shank, and ones of richer laws."""

from __future__ import annotations

from stiction.identification.example import Motor
from stiction.joints.friction import Asymmetric, Coulomb, Stribeck
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Gravity, Joint

GO1 = Motor("go1_shank", Joint(0.0121, 0.0342, Coulomb(0.0481), 0.01), PDGains(20.0, 0.5, 35.55))
"""Means of the paper's table; the offset is invented."""

ASYMMETRIC = Motor("asymmetric_shank", Joint(0.0145, 0.0, Asymmetric(0.5, 0.38, 0.06, 0.08)), PDGains(20.0, 0.5, 45.0))
"""Saturn Lite's shank, its friction not the same both ways."""

STRIBECK = Motor("stribeck_shank", Joint(0.0145, 0.0704, Stribeck(0.442, 0.65, 0.4), -0.05), PDGains(20.0, 0.5, 45.0))
"""Saturn Lite's shank with half as much friction again at rest."""

LOADED_LEG = Motor(
    "loaded_leg", Joint(0.06, 0.0704, Coulomb(0.35, 0.08), -0.05, Gravity(2.2, 0.4)), PDGains(20.0, 1.0, 45.0)
)
"""The leg of the example, its friction growing with what it carries."""
