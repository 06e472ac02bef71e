"""One joint under a sampled controller, integrated in small steps by none of the code under test."""

from __future__ import annotations

from functools import cache

import numpy as np

from stiction.files.log import JointSignals, Log, LogSetup

INERTIA, VISCOUS, KP, KD, STEP, EACH = 0.05, 0.05, 20.0, 0.8, 2e-4, 5
"""Joint and controller; steps of 0.2 ms, and the controller's period in steps."""


def held_log(rest: float, motion: float, seed: int, seconds: float = 30.0) -> Log:
    """Return a log at 500 Hz of a joint that holds `rest` and brakes with `motion` [N m]; limit 12 N m, bare motor."""
    return sampled_log(rest, motion, seed, seconds)


def sampled_log(
    rest: float,
    motion: float,
    seed: int = 1,
    seconds: float = 30.0,
    *,
    rate: int = 500,
    held: bool = False,
    lag: float = 0.0,
    delay: float = 0.0,
    effort: float = 0.0,
    torque: bool = True,
) -> Log:
    """Return a log of a joint that holds `rest` and brakes with `motion` [N m]; limit 12 N m, bare motor.

    rate: of the log [Hz]; held: the target changes with the log's samples alone; lag: lateness of the logged torque
    [s]; delay: lateness of the controller [s]; effort: friction per torque of the motor [1]; torque: it is logged.
    """
    time, target, angle, driven = _simulate(rest, motion, seconds, rate if held else 0, delay, effort)
    driven = np.interp(time - lag, time, driven)
    rng, every = np.random.default_rng(seed), slice(None, None, round(1 / (rate * STEP)))
    noisy = driven[every] + 0.01 * rng.standard_normal(len(driven[every]))
    position = np.round(angle[every] / 1e-4) * 1e-4
    signals = JointSignals(position=position, target=target[every], torque=noisy if torque else None)
    setup = LogSetup(
        kp=KP,
        kd=KD,
        torque_limit=12.0,
        torque_source="motor_side" if torque else None,
        test_condition="bare_motor",
        motor_strength=None if torque else 1.0,
    )
    return Log("held", time[every], {"shank": signals}, setup)


@cache
def _simulate(
    rest: float, motion: float, seconds: float, hold: int, delay: float, effort: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return time, target, position and torque at every step; hold: rate of the target [Hz], 0 for a smooth one."""
    time = np.arange(round(seconds / STEP)) * STEP
    asked = np.floor(time * hold + 1e-9) / hold if hold else time
    target = 0.5 * np.sin(2 * np.pi * 0.3 * asked) + 0.2 * np.sin(2 * np.pi * 0.9 * asked + 1.0)
    late, position, velocity, torque = round(delay / STEP), 0.0, 0.0, 0.0
    rows = np.zeros((len(time), 3))
    for index in range(len(time)):
        if index % EACH == 0:
            then = max(index - late, 0)
            angle, speed = (rows[then, 0], rows[then, 1]) if late else (position, velocity)
            torque = KP * (target[then] - angle) - KD * speed
        rows[index] = position, velocity, torque
        free, loss = torque - VISCOUS * velocity, effort * abs(torque)
        if velocity == 0.0 and abs(free) <= rest + loss:
            continue
        side = np.sign(velocity) or np.sign(free)
        moved = velocity + STEP * (free - (motion + loss) * side) / INERTIA
        # Friction stops a joint and does not turn it round.
        velocity = 0.0 if moved * velocity < 0 and abs(free) <= rest + loss else float(moved)
        position += STEP * velocity
    return time, target, rows[:, 0], rows[:, 2]
