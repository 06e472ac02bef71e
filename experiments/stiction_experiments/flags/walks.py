"""Mistakes with the log of a walk: `identify walk LOG --robot FILE`, and logs of our own form.

A Go2 trots in simulation and is logged as strangers do (`trot`); a hexapod walks under a shipped policy and is logged
as `evaluate --log` does. Joints of one kind have the same friction, so that what is said of a kind is right or wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from stiction.files.joints import JointRecord
from stiction.files.walk import WalkLog
from stiction.identification.setup import IdentifySetup
from stiction.identification.walking.foreign import foreign_walk
from stiction.identification.walking.pipeline import identify_walk
from stiction.identification.walking.setup import RobotLogSetup
from stiction.identification.walking.walk import Walk
from stiction.robots.catalog import find_robot
from stiction.robots.model import Robot
from stiction_experiments.flags import RIGHT
from stiction_experiments.flags.cases import DEGREES, Case, all_right, cases
from stiction_experiments.flags.trot import ARMATURE, DAMPING, IMU, KD, KP, ROBOT, limits, opened, sampled, trot

SHARES = (0.04, 0.035, 0.04)
"""Dry friction of the Go2's hips, thighs and calves over their torque limits [1]."""

SECONDS, SEED = 6.0, 3
"""Length of a walk [s], and its seed."""

POLICY, LEVEL, COMMAND = "saturn_lite-flat-deception-0.2", 0.1, "vx=0.3,vy=0.2,wz=0.3"
"""The hexapod's policy, the dry friction of its joints over their torque limits [1], and what it is told."""

BY_TARGETS = "motors are taken to give what they are asked for to a fifth, and an error of the gains adds to it"
"""Why small errors of gains need not show where no torque was logged."""

BY_WEIGHT = "the robot's weight tells the scale of all torques together, and not that of each joint's"
"""Why a single joint's torque in another unit need not show."""

Raw = dict[str, np.ndarray]
"""Signal -> samples, as `trot.sampled` returns them."""


@dataclass(frozen=True)
class GivenTrot:
    """A log with columns of its own, and the robot and flags that somebody gives with it."""

    raw: Raw
    """The signals, and `time`; a signal that was not logged is missing."""
    spec: Robot
    declared: IdentifySetup = field(default_factory=lambda: IdentifySetup(torque_source="motor_side", kp=KP, kd=KD))

    @property
    def level(self) -> float:
        """Friction of the first joint [N m]."""
        return float(friction_of_trot()[0])

    def identified(self) -> list[tuple[str, float, JointRecord]]:
        """Return name, right friction and record of each joint or kind that the walk tells something about.

        Raises `StictionError` where all of it is refused.
        """
        known = find_robot(ROBOT)
        log = opened(known, self.raw)
        walk = foreign_walk(log, self.spec, self.declared, RobotLogSetup(imu_position=IMU))
        return _beside_truth(identify_walk(walk).joints.joints, known, friction_of_trot())

    def changed(self, **signals: np.ndarray) -> GivenTrot:
        """Return the same with other signals."""
        return replace(self, raw=self.raw | signals)

    def without(self, *signals: str) -> GivenTrot:
        """Return the same without some signals."""
        return replace(self, raw={name: values for name, values in self.raw.items() if name not in signals})


@dataclass(frozen=True)
class GivenLog:
    """A walking log of our own form."""

    log: WalkLog
    spec: Robot
    friction: np.ndarray
    """[N m], shape (J,)."""

    @property
    def level(self) -> float:
        """Friction of the first joint [N m]."""
        return float(self.friction[0])

    def identified(self) -> list[tuple[str, float, JointRecord]]:
        """Return what `GivenTrot.identified` does."""
        return _beside_truth(identify_walk(Walk(self.log, self.spec)).joints.joints, self.spec, self.friction)

    def changed(self, **signals: Any) -> GivenLog:
        """Return the same with other signals."""
        return replace(self, log=replace(self.log, **signals))


def _beside_truth(
    records: dict[str, JointRecord], spec: Robot, friction: np.ndarray
) -> list[tuple[str, float, JointRecord]]:
    """Return name, right friction [N m] and record where there is one."""
    right = dict(zip(spec.joint_names, friction.tolist(), strict=True))
    right |= {kind: float(friction[spec.joints_of(kind)[0]]) for kind in spec.joint_kinds}
    return [
        (name, right[name], record)
        for name, record in records.items()
        if record.coulomb_friction is not None or "f/k" in record.combinations
    ]


def friction_of_trot() -> np.ndarray:
    """Return the Go2's dry friction [N m], shape (12,)."""
    spec = find_robot(ROBOT)
    return limits(spec) * np.tile(SHARES, spec.num_joints // len(SHARES))


@cache
def trotting() -> GivenTrot:
    """Return the trot with all that is logged of it, and the right flags."""
    spec = find_robot(ROBOT)
    return GivenTrot(sampled(spec, trot(friction_of_trot(), SECONDS, SEED)), spec)


def without_feet() -> GivenTrot:
    """Return the trot without forces of its feet: contact follows from how high they are."""
    return trotting().without("foot_force")


def by_targets() -> GivenTrot:
    """Return the trot without torque: what the gains make of the targets stands in."""
    return trotting().without("torque")


def without_orientation() -> GivenTrot:
    """Return the trot of a robot whose IMU gives no orientation."""
    return trotting().without("quaternion")


@cache
def hexapod() -> GivenLog:
    """Return the walk of a hexapod as `evaluate --log` writes it."""
    from stiction.evaluation.evaluate import EvaluationCfg
    from stiction.evaluation.walk_logs import RecordCfg, record_walks
    from stiction.files.bundle import find_bundle, read_bundle

    bundle = read_bundle(find_bundle(Path(POLICY)))
    evaluation = EvaluationCfg(friction_levels=(LEVEL,), commands=(COMMAND,))
    (walk,) = record_walks(bundle, evaluation, RecordCfg(robots=1, seconds=10.0))
    assert walk.log is not None
    return GivenLog(walk.log, find_robot(bundle.contract.robot), LEVEL * bundle.contract.array("torque_limit"))


# Mistakes with a trot


def scaled(name: str, factor: float, joints: slice = slice(None)) -> Callable[[GivenTrot], GivenTrot]:
    """Return the mistake of a signal in other units, or of another sign, of some joints."""

    def mistaken(entry: GivenTrot) -> GivenTrot:
        values = entry.raw[name].copy()
        values[:, joints] *= factor
        return entry.changed(**{name: values})

    return mistaken


def angles(factor: float, joints: slice = slice(None)) -> Callable[[GivenTrot], GivenTrot]:
    """Return the mistake of angles, velocities and targets in other units."""
    position, velocity, target = (scaled(name, factor, joints) for name in ("position", "velocity", "target"))
    return lambda entry: target(velocity(position(entry)))


def turned(entry: GivenTrot) -> GivenTrot:
    """Log a thigh, angle and torque, the other way round than the model has it."""
    return scaled("torque", -1.0, slice(1, 2))(angles(-1.0, slice(1, 2))(entry))


def moved_zero(entry: GivenTrot) -> GivenTrot:
    """Take the calves' zero half a radian off."""
    shift = np.tile([0.0, 0.0, 0.5], 4)
    return entry.changed(**{name: entry.raw[name] + shift for name in ("position", "target")})


def ordered(order: list[int], *names: str) -> Callable[[GivenTrot], GivenTrot]:
    """Return the mistake of joints in another order, of all their signals or of those named."""
    signals = names or ("position", "velocity", "target", "torque")
    return lambda entry: entry.changed(**{name: entry.raw[name][:, order] for name in signals})


def legs(*order: int) -> list[int]:
    """Return the order of joints in which legs come in another order."""
    return [3 * leg + joint for leg in order for joint in range(3)]


def clipped(entry: GivenTrot) -> GivenTrot:
    """Log no more than half of each joint's largest torque."""
    most = np.abs(entry.raw["torque"]).max(axis=0) / 2
    return entry.changed(torque=np.clip(entry.raw["torque"], -most, most))


def stamps(factor: float) -> Callable[[GivenTrot], GivenTrot]:
    """Return the mistake of stamps, or of --rate, that make the log `factor` times as long."""
    return lambda entry: entry.changed(time=factor * entry.raw["time"])


def late(name: str, seconds: float) -> Callable[[GivenTrot], GivenTrot]:
    """Return the mistake of a signal that is logged so much later [s]."""

    def mistaken(entry: GivenTrot) -> GivenTrot:
        samples = round(seconds / (entry.raw["time"][1] - entry.raw["time"][0]))
        return entry.changed(**{name: np.roll(entry.raw[name], samples, axis=0)})

    return mistaken


def heavier(factor: float) -> Callable[[GivenTrot], GivenTrot]:
    """Return the mistake of a model that weighs so many times what the robot does."""

    def mistaken(entry: GivenTrot) -> GivenTrot:
        links = tuple(link.scaled(factor) for link in entry.spec.links)
        return replace(entry, spec=replace(entry.spec, base=entry.spec.base.scaled(factor), links=links))

    return mistaken


def gains(factor: float) -> Callable[[GivenTrot], GivenTrot]:
    """Return the mistake of gains that are so many times the true ones."""
    return lambda entry: replace(entry, declared=replace(entry.declared, kp=factor * KP, kd=factor * KD))


def imu_turned(entry: GivenTrot) -> GivenTrot:
    """Mount the IMU with its x axis backward, and say nothing."""
    # k q k⁻¹, a half turn about z on both sides: its world turns with the IMU, which changes the heading alone.
    half, round_z = np.array([1.0, -1.0, -1.0, 1.0]), np.array([-1.0, -1.0, 1.0])
    raw = entry.raw
    return entry.changed(
        quaternion=raw["quaternion"] * half,
        gyroscope=raw["gyroscope"] * round_z,
        accelerometer=raw["accelerometer"] * round_z,
    )


def on_output_side(entry: GivenTrot) -> GivenTrot:
    """Log torque behind the gear, without the joints' friction, as if it were the motors'."""
    rate = np.gradient(entry.raw["position"], entry.raw["time"], axis=0)
    own = DAMPING * rate + ARMATURE * np.gradient(rate, entry.raw["time"], axis=0)
    return entry.changed(torque=entry.raw["torque"] - own - friction_of_trot() * np.sign(rate))


EXCHANGED = [joint for leg in range(4) for joint in (3 * leg, 3 * leg + 2, 3 * leg + 1)]
"""Joints with thighs and calves exchanged."""

OTHER_SIDE = legs(1, 0, 3, 2)
"""Joints with left and right exchanged."""


def walk_cases() -> list[Case]:
    """Return the right flags of walks, all simulated, and mistakes about robot, torques, gains, time and contact."""
    records: dict[str, Callable[[], Any]] = {
        "trot": trotting,
        "trot, no feet": without_feet,
        "trot by targets": by_targets,
        "trot, no orientation": without_orientation,
        "hexapod": hexapod,
    }
    add = partial(cases, records)
    return [*add(RIGHT, "; ".join(records), all_right), *_model_cases(add), *_torque_cases(add), *_time_cases(add)]


Add = Callable[..., list[Case]]
"""`cases` of these records."""


def _model_cases(add: Add) -> list[Case]:
    """Return mistakes about the robot, its masses, and the order and signs of its joints."""
    both, other = "trot; trot, no feet", find_robot("go1")
    return [
        *add("masses twice as large in the model", "trot", heavier(2.0)),
        *add("masses half as large in the model", "trot", heavier(0.5)),
        *add("masses a third larger in the model", "trot", heavier(4 / 3)),
        *add("masses a fifth smaller in the model", "trot", heavier(0.8)),
        *add("a Go1 for a Go2", both, lambda entry: replace(entry, spec=other)),
        *add("degrees", both, angles(DEGREES)),
        *add("target in degrees", "trot by targets", scaled("target", DEGREES)),
        *add("one joint the other way round", both, turned),
        *add("zero of the calves off by half a radian", both, moved_zero),
        *add("thigh and calf exchanged", both, ordered(EXCHANGED)),
        *add("left and right exchanged", both, ordered(OTHER_SIDE)),
        *add("front and rear exchanged", "trot, no feet", ordered(legs(2, 3, 0, 1))),
        *add("IMU turned round", both, imu_turned),
    ]


def _torque_cases(add: Add) -> list[Case]:
    single = BY_WEIGHT, "--torque-scale"
    return [
        *(one for scale, factor in FACTORS.items() for one in add(f"torque {scale}", "trot", scaled("torque", factor))),
        *add("sign of the torque", "trot", scaled("torque", -1.0)),
        *add("sign of one torque", "trot", scaled("torque", -1.0, slice(1, 2))),
        *add("torque of one hip half as large again", "trot", scaled("torque", 1.5, slice(0, 1)), *single),
        *add("torque of one calf half as large", "trot", scaled("torque", 0.5, slice(2, 3)), *single),
        *add("torque of the hips twice as large", "trot", scaled("torque", 2.0, slice(0, None, 3)), *single),
        *add("torque of the calves twice as large", "trot", scaled("torque", 2.0, slice(2, None, 3))),
        *add("torque of the other side", "trot; trot, no feet", ordered(OTHER_SIDE, "torque")),
        *add("torque of thigh for calf", "trot", ordered(EXCHANGED, "torque")),
        *add("torque cut off at half", "trot", clipped),
        *add("torque behind the gear", "trot", on_output_side),
        *add("torque 20 ms late", "trot", late("torque", 0.02)),
        *add("torque 6 ms late", "trot", late("torque", 0.006)),
        *add("target 20 ms late", "trot; trot by targets", late("target", 0.02)),
        *add("kp and kd twice as large", "trot; trot by targets", gains(2.0)),
        *add("kp and kd half as large", "trot by targets", gains(0.5)),
        *add("kp and kd a third too large", "trot by targets", gains(4 / 3), BY_TARGETS, "--kp"),
    ]


FACTORS = {
    "twice as large": 2.0,
    "half as large": 0.5,
    "a third too large": 4 / 3,
    "a fifth too large": 1.2,
    "a fifth too small": 0.8,
}
"""Mistake of the torque's scale -> its factor."""


def _time_cases(add: Add) -> list[Case]:
    """Return mistakes about time, the IMU's units, and contact."""

    def contacts(change: Callable[[Any], np.ndarray]) -> Callable[[GivenLog], GivenLog]:
        return lambda entry: entry.changed(foot_contact=change(entry.log.foot_contact))

    return [
        *add("half the rate", "trot", stamps(2.0)),
        *add("twice the rate", "trot", stamps(0.5)),
        *add("half the rate", "trot, no orientation", stamps(2.0)),
        *add("twice the rate", "trot, no orientation", stamps(0.5)),
        *add("gyroscope in degrees", "trot; trot, no orientation", scaled("gyroscope", DEGREES)),
        *add("gyroscope half as large", "trot, no orientation", scaled("gyroscope", 0.5)),
        *add("no accelerometer", "trot", lambda entry: entry.without("accelerometer")),
        *add("no IMU", "trot", lambda entry: entry.without("quaternion", "gyroscope", "accelerometer")),
        *add(
            *("feet in another order", "trot"),
            lambda entry: entry.changed(foot_force=entry.raw["foot_force"][:, ::-1]),
        ),
        *add("contact 60 ms late", "trot", late("foot_force", 0.06)),
        *add("contact 30 ms late", "trot", late("foot_force", 0.03)),
        *add("contact never", "hexapod", contacts(np.zeros_like)),
        *add("contact where there is none", "hexapod", contacts(np.logical_not)),
        *add("feet in another order", "hexapod", contacts(lambda down: down[:, ::-1])),
        *add("contact 60 ms late", "hexapod", contacts(lambda down: np.roll(down, 12, axis=0))),
        *add("contact not logged", "hexapod", lambda entry: entry.changed(foot_contact=None)),
    ]
