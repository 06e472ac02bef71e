"""Signals of an IMU, checked against each other, and brought to the base's origin.

A log with its own columns seldom says in which order a quaternion is, in which unit an accelerometer, or whether it
has gravity in it. Physics says so: the quaternion's rate is the gyroscope's, and over seconds of a walk the mean
specific force is gravity's, upward. An unambiguous difference is converted and noted; an ambiguous one is refused.

Of the base nothing else is needed. Legs in swing feel its angular velocity and its specific force alone, which an IMU
measures: no position, no velocity, no motion capture.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stiction.core.errors import LogError
from stiction.core.rotation import cross, crosses, small_turns, up_in_frames
from stiction.files.log import BodySignals
from stiction.identification.walking.walk import hann_weights, smooth
from stiction.robots.model import GRAVITY

TURN_SPAN = 0.05
"""Time over which the quaternion's turns are compared with the gyroscope's [s]: the noise of both is small by then."""

LEAST_TURNING = 0.02
"""Root mean square of the gyroscope below which it cannot tell one order of the quaternion from another [rad/s]."""

AGREEING, REFUTED = 0.5, 0.7
"""Unexplained share of the turns below which an order of the quaternion fits, and above which it does not [1]."""

UNIT_ERROR = 0.2
"""Largest error of a unit: no two units are as near [1]."""

UPRIGHT = 0.8
"""Mean of the up direction's z below which the IMU's z is not the base's [1]."""

SETTLING = 1.0
"""Time constant with which the up direction follows the accelerometer where no orientation was logged [s]."""

RIGHT = "w x y z"
"""Expected order of a quaternion."""

ORDERS = {RIGHT: (0, 1, 2, 3), "x y z w": (3, 0, 1, 2)}
"""Order of the four numbers -> places of w, x, y and z in it."""

FRAMES = {"": (1.0, 1.0, 1.0, 1.0), " of the world in the base": (1.0, -1.0, -1.0, -1.0)}
"""Frame of a quaternion, empty for the base in the world -> signs of its numbers, as some drivers have them."""


def base_imu(
    source: str, body: BodySignals, step: float, place: tuple[float, float, float] | None
) -> tuple[BodySignals, tuple[str, ...]]:
    """Check and convert the signals of an IMU, even in time, `step` [s] apart; return them with notes.

    Signals come out as of an IMU at the base's origin: quaternion, of no meaning in its heading where none was logged,
    gyroscope [rad/s], and accelerometer [m/s²] where there was one. place: of the IMU in the base's frame [m], None if
    it is unknown. Raises `LogError` for signals that are missing or refuted.
    """
    quaternion, gyroscope, force = body.quaternion, body.gyroscope, body.accelerometer
    if gyroscope is None or (quaternion is None and force is None):
        missing = [name for name in ("quaternion", "gyroscope", "accelerometer") if getattr(body, name) is None]
        raise LogError(
            f"{source}: no {', no '.join(missing)}: how the base turns and which way is up is not known, so that the "
            "torque of the moving links cannot be told from friction, and of no joint can anything be said: log the "
            "IMU, at least gyroscope and orientation or accelerometer (other names: --columns gyroscope=NAME), or let "
            "the legs move in the air with the base held, identify --robot"
        )
    notes: list[str] = []
    if quaternion is not None:
        length = np.linalg.norm(quaternion, axis=1)
        if not np.all(np.abs(length - 1) < 0.1):
            raise LogError(
                f"{source}: the quaternion's length is {length.min():.3g} to {length.max():.3g}; expected 1: w x y z "
                "of an orientation, no angles"
            )
        quaternion = quaternion / length[:, None]
        gyroscope = _check_turns(source, quaternion, gyroscope, step, notes) * gyroscope
    if force is not None:
        force = _check_force(source, force, quaternion, notes) * force
    if quaternion is None:
        assert force is not None
        quaternion = _level(force, gyroscope, step)
        notes.append(
            "no orientation was logged: which way is up follows from gyroscope and accelerometer; the gyroscope's unit "
            "was taken to be rad/s"
        )
    lean = float(up_in_frames(quaternion)[:, 2].mean())
    if lean < UPRIGHT:
        raise LogError(
            f"{source}: by the IMU the base's z axis points {_degrees(lean):.0f}° away from up, on average; expected "
            "the IMU's axes along the base's, x forward, z up, and a robot on its feet: turn its columns into the "
            "base's axes"
        )
    notes.append("the IMU's axes were taken to be the base's, x forward, y left")
    if force is not None and place is not None:
        force = force - at_place(gyroscope, step, np.array(place))
    elif force is not None:
        notes.append("the IMU was taken to sit within centimetres of the base's origin; say where: --imu-position")
    return replace(body, quaternion=quaternion, gyroscope=gyroscope, accelerometer=force), tuple(notes)


def at_place(rate: np.ndarray, step: float, place: np.ndarray) -> np.ndarray:
    """Return the specific force that the base's turns add at `place` r [m]: ω' × r + ω × (ω × r) [m/s²], (T, 3).

    rate: ω [rad/s], shape (T, 3). ω' is a central difference, smoothed over 10 ms.
    """
    turning = smooth(np.gradient(rate, step, axis=0), hann_weights(0.01, step))
    arm = np.broadcast_to(place, rate.shape)
    return crosses(turning, arm) + crosses(rate, crosses(rate, arm))


def _degrees(cosine: float) -> float:
    """Return the angle of a cosine in degrees."""
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _check_turns(source: str, quaternion: np.ndarray, gyroscope: np.ndarray, step: float, notes: list[str]) -> float:
    """Return the gyroscope's unit [rad/s], and note it; reject a quaternion that turns otherwise."""
    if np.sqrt(np.mean(np.sum(gyroscope**2, axis=1))) < LEAST_TURNING:
        notes.append("the base hardly turns: the order of the quaternion, taken as w x y z, could not be checked")
        return 1.0
    span = max(1, round(TURN_SPAN / step))
    # The mean over the very samples between which the quaternion's turn is taken.
    mean = np.stack([np.convolve(column[:-1], np.ones(span) / span, "valid") for column in gyroscope.T], axis=1)
    left: dict[str, tuple[float, float]] = {}
    for order, places in ORDERS.items():
        for frame, signs in FRAMES.items():
            read = quaternion[:, places] * signs
            first, second = read[:-span], read[span:]
            sign = np.where(np.sum(first * second, axis=1) < 0, -1.0, 1.0)
            turns = small_turns(first, second * sign[:, None]) / (span * step)
            slope = float(np.sum(turns * mean) / np.sum(mean**2))
            left[order + frame] = (float(np.linalg.norm(turns - slope * mean) / np.linalg.norm(turns)), slope)
    rest, slope = left[RIGHT]
    best = min((order for order in left if left[order][1] > 0), key=lambda order: left[order][0], default=RIGHT)
    agrees = rest <= AGREEING and slope > 0
    if not agrees and best != RIGHT and left[best][0] < AGREEING:
        raise LogError(
            f"{source}: the quaternion turns as the gyroscope says only if it is {best}; expected w x y z of the "
            "base in the world: map its columns in that order, --columns quaternion=W,X,Y,Z"
            + (", with the signs of x, y and z turned round" if "world" in best else "")
        )
    if not agrees and (rest > REFUTED or slope <= 0):
        raise LogError(
            f"{source}: quaternion and gyroscope do not tell of the same motion ({rest:.0%} of the turns are left "
            "over): are they of one IMU, in the axes of the base, and in the same order in time?"
        )
    if abs(slope - 1) < UNIT_ERROR:
        return 1.0
    if abs(np.degrees(slope) - 1) < UNIT_ERROR:
        notes.append("the gyroscope is in degrees per second, by the quaternion's turns: converted")
        return float(np.radians(1))
    raise LogError(
        f"{source}: the quaternion turns {slope:.3g} times as fast as the gyroscope says; expected rad/s: convert it"
    )


def _check_force(source: str, force: np.ndarray, quaternion: np.ndarray | None, notes: list[str]) -> float:
    """Return the accelerometer's unit [m/s²], and note it; reject one whose mean is not gravity's, upward."""
    mean = force.mean(axis=0)
    size, scale = float(np.linalg.norm(mean)), 1.0
    up = np.array([0.0, 0.0, 1.0]) if quaternion is None else up_in_frames(quaternion).mean(axis=0)
    along = float(mean @ up / max(size * np.linalg.norm(up), 1e-12))
    if abs(size / GRAVITY - 1) > UNIT_ERROR / 2:
        if abs(size - 1) > UNIT_ERROR / 2:
            raise LogError(
                f"{source}: the accelerometer's mean over the walk is {size:.3g}; expected {GRAVITY} m/s², upward"
                + (": gravity was taken off; log the raw specific force, or leave it out" if size < 0.5 else "")
            )
        scale = GRAVITY
        notes.append("the accelerometer is in g, by its mean over the walk: converted to m/s²")
    if along < UPRIGHT:
        raise LogError(
            f"{source}: over the walk the accelerometer points {_degrees(along):.0f}° away from up"
            + (
                f": it has the sign of gravity; expected acceleration minus gravity, +{GRAVITY} along z at rest"
                if along < -UPRIGHT
                else "; expected the axes of the base and of the quaternion, x forward, z up"
            )
        )
    return scale


def _level(force: np.ndarray, rate: np.ndarray, step: float) -> np.ndarray:
    """Return orientations without a heading from specific force and angular velocity, shape (T, 4).

    The up direction u turns with the base, u' = -ω × u, and is drawn to f / |f| with `SETTLING`.
    """
    drawn = force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-9)
    ups, gain = np.empty_like(drawn), min(1.0, step / SETTLING)
    up = drawn[: max(1, round(SETTLING / step))].mean(axis=0)
    for sample, (pull, turn) in enumerate(zip(drawn, rate, strict=True)):
        ups[sample] = up = up / np.linalg.norm(up)
        up = up - step * cross(turn, up) + gain * (pull - up)
    # In the base frame up is (−sin pitch, cos pitch sin roll, cos pitch cos roll); quaternions have half the angles.
    roll, pitch = np.arctan2(ups[:, 1], ups[:, 2]) / 2, -np.arcsin(np.clip(ups[:, 0], -1, 1)) / 2
    both = np.cos(roll) * np.cos(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.sin(pitch)
    return np.stack([*both, -np.sin(roll) * np.sin(pitch)], axis=1)
