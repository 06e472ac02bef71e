"""Backlash against two bodies on a line, whose motion is known exactly."""

import numpy as np
import pytest

from hinges import Hinges
from stiction.engines.engine import Body
from stiction.robots.catalog import find_robot
from stiction.virtual.hardware import Gears

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
