"""A known payload on the joint tells how much of its command the motor gives, and with it newton metres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stiction.formats.log import Log
from stiction.identify.example import SATURN_LITE, example_log
from stiction.identify.pipeline import identify_joint
from stiction.identify.setup import Payload
from stiction.joints.simulate import Gravity

STRENGTH = 0.8
PAYLOAD = Payload(1.0, 0.2, 0.3)


def weak_log(seed: int, loaded: bool) -> Log:
    """Return a log, without torque, of a motor that gives 80 % of its command, with the payload or without."""
    joint = SATURN_LITE.joint
    if loaded:
        along, across = np.cos(PAYLOAD.angle), -np.sin(PAYLOAD.angle)
        weight = Gravity(PAYLOAD.weight * along, PAYLOAD.weight * across)
        joint = replace(joint, inertia=joint.inertia + PAYLOAD.inertia, gravity=weight)
    log = example_log(replace(SATURN_LITE, joint=joint, gains=replace(SATURN_LITE.gains, strength=STRENGTH)), seed=seed)
    setup = replace(log.setup, test_condition="bare_motor")
    if loaded:
        known = {"payload_mass": PAYLOAD.mass, "payload_distance": PAYLOAD.distance, "payload_angle": PAYLOAD.angle}
        setup = replace(setup, **known)
    return replace(log, joints={"shank": replace(log.joints["shank"], torque=None)}, setup=setup)


@pytest.mark.parametrize("together", [False, True], ids=["one_log", "with_and_without"])
def test_intervals_of_strength_and_friction_hold_the_truth(together: bool) -> None:
    """One log, by output error with k unknown; two, by regression, whose interval admits what its noise does to k."""
    joint = SATURN_LITE.joint
    truth = {"inertia": joint.inertia, "viscous_friction": joint.viscous, "coulomb_friction": joint.friction.level}
    inside = dict.fromkeys((*truth, "motor_strength"), 0)
    for seed in range(8):
        repeats = [weak_log(100 + seed, False)] if together else []
        record = identify_joint(weak_log(seed, True), repeats=repeats).record
        for name, true in (truth | {"motor_strength": STRENGTH}).items():
            estimate = getattr(record, name)
            inside[name] += estimate.interval95[0] <= true <= estimate.interval95[1]
            assert estimate.value == pytest.approx(true, rel=0.04), name
    assert min(inside.values()) >= 6 and sum(inside.values()) >= 28, inside
