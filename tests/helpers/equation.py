"""Rows made straight from the torque equation, by none of the code under test: the truth is known."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stiction.identification.prepare import Rows
from stiction.identification.setup import Payload


def equation_rows(
    values: Mapping[str, float],
    *,
    strength: float = 1.0,
    payload: Payload | None = None,
    load: float = 0.0,
    middle: float = 0.0,
    noise: np.ndarray | float = 0.0,
    grows: float = 0.0,
    rate: float = 100.0,
) -> Rows:
    """Return 20 s of a joint that moves as two sines, with the torque that its parameters ask for.

    values: by the names of `stiction.identification.model`, those that are not there being zero; strength: k; payload:
    what hangs on it; load: amplitude of a known sine of torque from outside [N m]; middle: θ_m [rad]; noise: comes on
    top of the torque [N m]; grows: change of all friction from start to end, over its mean [1]; rate: rows per second
    [Hz].
    """
    of = {name: float(value) for name, value in values.items()}
    time = np.arange(round(20 * rate)) / rate
    parts = [(0.5, 2 * np.pi * 0.45), (0.3, 2 * np.pi * 1.7)]
    position = 0.2 + np.asarray(sum(size * np.sin(speed * time) for size, speed in parts))
    velocity = np.asarray(sum(size * speed * np.cos(speed * time) for size, speed in parts))
    acceleration = -np.asarray(sum(size * speed**2 * np.sin(speed * time) for size, speed in parts))
    outside = load * np.sin(3.0 * time)
    gravity = of.get("gravity_sin", 0.0) * np.sin(position) + of.get("gravity_cos", 0.0) * np.cos(position)
    weight, asked = np.zeros_like(time), np.zeros_like(time)
    if payload is not None:
        weight = payload.mass * 9.81 * payload.distance * np.sin(position - payload.angle)
        asked = weight + payload.mass * payload.distance**2 * acceleration
    forward = velocity > 0
    dry = of.get("coulomb_friction", 0.0) + of.get("load_coefficient", 0.0) * np.abs(gravity + weight - outside)
    if "static_friction" in of:
        rise = np.exp(-((velocity / of["stribeck_velocity"]) ** 2))
        dry = dry + (of["static_friction"] - of["coulomb_friction"]) * rise
    if "position_slope" in of:
        away = position - middle
        dry = dry + of["position_slope"] * away + of["position_curvature"] * away**2
    viscous = np.full(len(time), of.get("viscous_friction", 0.0))
    if "coulomb_friction_forward" in of:
        dry = np.where(forward, of["coulomb_friction_forward"], of["coulomb_friction_backward"])
        viscous = np.where(forward, of["viscous_friction_forward"], of["viscous_friction_backward"])
    friction = (viscous * velocity + dry * np.sign(velocity)) * (1 + grows * (time / time[-1] - 0.5))
    needed = of["inertia"] * acceleration + friction + of.get("offset", 0.0) + gravity + asked
    return Rows(
        position=position,
        velocity=velocity,
        acceleration=acceleration,
        direction=np.sign(velocity),
        torque=(needed - outside) / strength + noise,
        load=weight - outside,
        payload=asked - outside,
        time=time,
        run=np.zeros(len(time), int),
        slowest=0.0,
    )


def autoregressive(rng: np.random.Generator, count: int, keep: float, size: float = 1.0) -> np.ndarray:
    """Return noise of standard deviation `size` that remembers `keep` of its last value, shape (count,)."""
    fresh = size * np.sqrt(1 - keep**2) * rng.standard_normal(count)
    values = np.empty(count)
    values[0] = size * rng.standard_normal()
    for index in range(1, count):
        values[index] = keep * values[index - 1] + fresh[index]
    return values
