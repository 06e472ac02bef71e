"""Joint with more dry friction at rest than in motion, integrated in small steps by none of the code under test."""

from __future__ import annotations

import numpy as np

from stiction.files.log import JointSignals, Log, LogSetup

INERTIA, VISCOUS, KP, KD, STEP, EACH = 0.05, 0.05, 20.0, 0.8, 2e-4, 5


def held_log(rest: float, motion: float, seed: int, seconds: float = 30.0) -> Log:
    """Return a log at 500 Hz of a joint that holds `rest` and brakes with `motion` [N m]; limit 12 N m, bare motor."""
    time = np.arange(round(seconds / STEP)) * STEP
    target = 0.5 * np.sin(2 * np.pi * 0.3 * time) + 0.2 * np.sin(2 * np.pi * 0.9 * time + 1.0)
    position, velocity, torque, rows = 0.0, 0.0, 0.0, []
    for index, goal in enumerate(target.tolist()):
        if index % EACH == 0:
            torque = KP * (goal - position) - KD * velocity
            rows.append((position, torque))
        free = torque - VISCOUS * velocity
        if velocity == 0.0 and abs(free) <= rest:
            continue
        side = np.sign(velocity) or np.sign(free)
        moved = velocity + STEP * (free - motion * side) / INERTIA
        # Friction stops a joint and does not turn it round.
        velocity = 0.0 if moved * velocity < 0 and abs(free) <= rest else float(moved)
        position += STEP * velocity
    rng, (angle, driven) = np.random.default_rng(seed), np.array(rows[::2]).T
    signals = JointSignals(
        position=np.round(angle / 1e-4) * 1e-4,
        target=target[:: 2 * EACH],
        torque=driven + 0.01 * rng.standard_normal(len(driven)),
    )
    setup = LogSetup(kp=KP, kd=KD, torque_limit=12.0, torque_source="motor_side", test_condition="bare_motor")
    return Log("held", time[:: 2 * EACH], {"shank": signals}, setup)
