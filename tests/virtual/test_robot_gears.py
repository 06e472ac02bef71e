"""Backlash against two bodies on a line, whose motion is known exactly."""

from dataclasses import replace

import numpy as np
import pytest

from hinges import Hinges
from stiction.engines.engine import Body
from stiction.robots.catalog import find_robot
from stiction.virtual.motor import Gears

ROTOR, LINK, GAP = 0.02, 0.01, 0.01
"""Inertias [kg m²], and the width of the gap [rad]."""

SPEC = find_robot("go1")


def pair(timestep: float, gap: float = GAP, weight: float = 0.0, link: float = LINK) -> tuple[Gears, Hinges]:
    """Return twelve motors behind gaps and their links, without viscous friction."""
    joints = np.ones(SPEC.num_joints)
    engine = Hinges(Body(SPEC, ROTOR * joints, 0 * joints), None, timestep, link, weight)
    return Gears(gap * joints, ROTOR * joints, timestep), engine


def advance(gears: Gears, engine: Hinges, torque: float, friction: float = 0.0) -> None:
    """Take one step, all joints alike."""
    full = np.full(SPEC.num_joints, torque)
    engine.step(gears.transmit(full), np.full(SPEC.num_joints, friction))
    motion = engine.motion()
    gears.follow(full, motion.joint_position, motion.joint_velocity)


def state(gears: Gears, engine: Hinges) -> tuple[float, float, float, float]:
    """Return φ, φ', q, q' of the first joint."""
    motion = engine.motion()
    return gears.angle[0], gears.velocity[0], motion.joint_position[0], motion.joint_velocity[0]


def throw(gears: Gears, engine: Hinges, speed: float) -> None:
    """Let links move at a speed, their rotors at rest, both in the middle of their gaps."""
    joints = SPEC.num_joints
    engine._motion = replace(engine.motion(), joint_velocity=np.full(joints, speed))
    for _ in range(2):  # the second time there is no acceleration
        gears.follow(np.zeros(joints), np.zeros(joints), np.full(joints, speed))


def test_a_motor_crosses_half_the_gap_alone_hits_and_takes_the_link_along() -> None:
    """The heart of backlash: t = √(gap I/τ), φ' = τt/I, then I φ'/(I + M) together, then τ/(I + M)."""
    torque, step = 0.5, 2e-5
    gears, engine = pair(step)
    crossing = (GAP * ROTOR / torque) ** 0.5
    arrival = torque * crossing / ROTOR
    for _ in range(round(0.9 * crossing / step)):
        advance(gears, engine, torque)
    angle, speed, link_angle, link_speed = state(gears, engine)
    assert (link_angle, link_speed) == (0.0, 0.0) and gears.side[0] == 0
    assert speed == pytest.approx(0.9 * arrival, rel=1e-3) and angle == pytest.approx(0.81 * GAP / 2, rel=1e-3)
    for _ in range(round(0.1 * crossing / step) + 3):
        advance(gears, engine, torque)
    angle, speed, link_angle, link_speed = state(gears, engine)
    assert gears.side[0] == 1
    assert speed == link_speed == pytest.approx(ROTOR * arrival / (ROTOR + LINK), rel=4e-3)
    for _ in range(round(0.05 / step)):
        advance(gears, engine, torque)
    later = state(gears, engine)
    assert later[3] - link_speed == pytest.approx(0.05 * torque / (ROTOR + LINK), rel=1e-6)
    assert later[0] - later[2] == pytest.approx(GAP / 2, abs=1e-12)


@pytest.mark.parametrize(("step", "tolerance"), [(0.001, 0.15), (0.0001, 0.015)])
def test_the_impact_is_right_to_the_first_order_of_the_step(step: float, tolerance: float) -> None:
    """At 1 ms, where virtual robots run, the speed after the impact is as good as one step allows."""
    gears, engine = pair(step)
    while gears.side[0] == 0:
        advance(gears, engine, 0.5)
    advance(gears, engine, 0.0)
    exact = ROTOR / (ROTOR + LINK) * (0.5 * GAP / ROTOR) ** 0.5
    assert state(gears, engine)[3] == pytest.approx(exact, rel=tolerance)


@pytest.mark.parametrize("link", [0.01, 0.2])
def test_a_link_in_its_gap_swings_without_the_rotor(link: float) -> None:
    """Though the engine's joint has the rotor's inertia, whether it is heavier or lighter than the link."""
    step, weight = 1e-3, 20 * link
    gears, engine = pair(step, gap=1.0, weight=weight, link=link)
    start = np.full(SPEC.num_joints, 0.1)
    engine.reset(start, np.zeros(3), np.array([1.0, 0, 0, 0]))
    gears.reset(start)
    period = 2 * np.pi * (link / weight) ** 0.5
    path = []
    for _ in range(round(period / step)):
        advance(gears, engine, 0.0)
        path.append(state(gears, engine)[2])
    exact = 0.1 * np.cos(2 * np.pi * np.arange(1, len(path) + 1) * step / period)
    np.testing.assert_allclose(path, exact, atol=0.1 * 0.05)


def test_momentum_survives_every_impact_and_energy_never_grows() -> None:
    """Without torque and friction the pair keeps I φ' + M q' through all hits; each hit may only take energy away."""
    gears, engine = pair(1e-3)
    gears.velocity[:] = 1.0
    energies = []
    for _ in range(50):
        advance(gears, engine, 0.0)
        _, speed, _, link_speed = state(gears, engine)
        energies.append(ROTOR * speed**2 + LINK * link_speed**2)
    assert ROTOR * speed + LINK * link_speed == pytest.approx(ROTOR * 1.0, rel=1e-9)
    assert max(np.diff(energies)) <= 1e-12 and energies[-1] == pytest.approx(ROTOR**2 / (ROTOR + LINK), rel=1e-9)


def test_teeth_part_when_the_motor_brakes_and_meet_on_the_other_side() -> None:
    """A gear pushes and cannot pull: a link whose motor brakes runs on until the other flank holds it.

    The teeth part one step late, and the link's own acceleration is known one step later.
    """
    gears, engine = pair(1e-4)
    while gears.side[0] != 1:
        advance(gears, engine, 0.5)
    for _ in range(200):
        advance(gears, engine, 0.5)
    pushed = state(gears, engine)
    sides = []
    while not sides or gears.side[0] != -1:
        advance(gears, engine, -0.5)
        sides.append(int(gears.side[0]))
        if gears.side[0] == 0 and len(sides) > 2:
            assert state(gears, engine)[3] == pytest.approx(pushed[3], rel=0.01)
    # Relative to the link the rotor falls back by the whole gap at τ/I.
    assert len(sides) * 1e-4 == pytest.approx((2 * GAP * ROTOR / 0.5) ** 0.5, rel=0.02)


def test_a_slowly_driven_joint_has_a_hysteresis_as_wide_as_the_gap() -> None:
    """With friction on the link, as in every real joint: what a dial gauge on the output would show."""
    gears, engine = pair(1e-3)
    ends = {}
    for way in (1.0, -1.0):
        for target in np.concatenate([np.linspace(-0.2 * way, 0.05 * way, 2000), np.full(300, 0.05 * way)]):
            error = target - gears.angle[0]
            advance(gears, engine, 20.0 * error - 0.6 * gears.velocity[0], friction=0.05)
        ends[way] = state(gears, engine)
    for way, (angle, speed, link_angle, link_speed) in ends.items():
        assert link_speed == pytest.approx(0.0, abs=1e-6) and abs(speed) < 0.01
        assert angle - link_angle == pytest.approx(way * GAP / 2, abs=1e-4)


@pytest.mark.parametrize("link", [0.002, 0.01])
def test_a_link_in_its_gap_brakes_without_the_rotor_and_is_not_turned_round(link: float) -> None:
    """It slides v²M/(2f), as it does alone, a lag of I/M steps apart; the rotor's inertia never pushes it back."""
    step, speed, friction = 1e-4, 0.5, 0.1
    gears, engine = pair(step, gap=10.0, link=link)
    throw(gears, engine, speed)
    speeds = []
    for _ in range(round(2 * speed * link / friction / step) + 50):
        advance(gears, engine, 0.0, friction)
        speeds.append(state(gears, engine)[3])
    assert min(speeds) == speeds[-1] == 0.0
    lag = step * ROTOR / link
    assert state(gears, engine)[2] == pytest.approx(speed**2 * link / (2 * friction) + speed * lag, rel=0.03)


def test_without_a_gap_nothing_is_different() -> None:
    """A joint with perfect gears is the engine's joint, bit for bit."""
    gears, engine = pair(1e-3, gap=0.0, weight=0.3)
    alone = pair(1e-3, weight=0.3)[1]
    generator = np.random.default_rng(0)
    for torque in generator.normal(size=200):
        advance(gears, engine, torque, friction=0.1)
        alone.step(np.full(SPEC.num_joints, torque), np.full(SPEC.num_joints, 0.1))
        np.testing.assert_array_equal(engine.motion().joint_position, alone.motion().joint_position)
        np.testing.assert_array_equal(gears.angle, engine.motion().joint_position)
        np.testing.assert_array_equal(gears.velocity, engine.motion().joint_velocity)
