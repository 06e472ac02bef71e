"""Colours of the robot and of what it climbs, wherever it is shown: red, green, blue, each 0 to 1."""

from __future__ import annotations

Color = tuple[float, float, float]

TRUNK: Color = (0.82, 0.84, 0.86)
THIGH: Color = (0.25, 0.3, 0.36)
SHANK: Color = (0.55, 0.6, 0.66)

FEET: tuple[Color, Color] = ((0.9, 0.45, 0.15), (0.15, 0.5, 0.85))
"""By contact group."""

STONES: tuple[Color, Color] = ((0.80, 0.81, 0.77), (0.72, 0.74, 0.70))
"""Of the boxes of a course, by turns."""
