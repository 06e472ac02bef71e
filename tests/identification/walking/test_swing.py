"""Friction of legs in swing against simulated robots whose friction is known."""

from dataclasses import replace

import numpy as np
import pytest

import walks
from stiction.files.walk import WalkLog
from stiction.identification.limb.fit import PriorFit
from stiction.identification.walking.setup import WalkSetup
from stiction.identification.walking.swing import PARAMETERS, SwingFit, fit_swing, swing_rows
from stiction.identification.walking.walk import Walk

MIXED = np.tile([0.03, 0.08, 0.15], 6) * walks.LIMITS
"""Friction that differs by kind: 3, 8 and 15 % of the limit [N m]."""

NOISE_ALONE = WalkSetup(link_mass_error=0.0, specific_force_error=0.05)
"""Masses are as stated here, and the accelerometer's error as simulated: intervals of the nominal width."""


def fits(log: WalkLog, setup: WalkSetup) -> list[SwingFit]:
    """Return the fit of each joint."""
    rows = swing_rows(Walk(log, walks.SPEC, setup))
    return [fit_swing([joint], limit, 0.005, setup) for joint, limit in zip(rows, walks.LIMITS, strict=True)]


def test_without_noise_the_truth_is_found_exactly() -> None:
    """Every term of the equation is right: legs, base, timing, and the motor's torque."""
    log = walks.walk(MIXED[None], [walks.CURVE], walks.NO_NOISE)[0]
    fitted = [(fit, level) for fit, level in zip(fits(log, NOISE_ALONE), MIXED, strict=True) if fit.fit is not None]
    assert len(fitted) >= 12
    for fit, level in fitted:
        assert fit.fit is not None
        np.testing.assert_allclose(fit.fit.values[:3], [walks.ARMATURE, walks.DAMPING, level], rtol=2e-3, atol=2e-4)


@pytest.fixture(scope="module")
def sample() -> list[tuple[np.ndarray, WalkLog]]:
    """Friction and log of robots at 0, 5, 10, 20 %, by kind, and drawn for each joint; each in three directions."""
    drawn = np.random.default_rng(5).uniform(0.0, 0.2, 18) * walks.LIMITS
    levels = [share * walks.LIMITS for share in (0.0, 0.05, 0.1, 0.2)] + [MIXED, drawn]
    commands = [walks.FORWARD, walks.CURVE, walks.BACKWARD]
    friction = np.repeat(levels, len(commands), axis=0)
    logs = walks.walk(friction, commands * len(levels), seed=20)
    assert len(logs) == len(friction)
    return list(zip(friction, logs, strict=True))


def test_intervals_hold_the_truth_at_about_the_nominal_rate(sample: list) -> None:
    """18 logs x 18 joints, sensor noise as on a robot: 95 % intervals, estimates without bias, few joints untold."""
    inside: dict[str, list[bool]] = {name: [] for name in PARAMETERS}
    offset: dict[str, list[float]] = {name: [] for name in PARAMETERS}
    untold = 0
    for friction, log in sample:
        for fit, level in zip(fits(log, NOISE_ALONE), friction, strict=True):
            if fit.fit is None:
                untold += 1
                continue
            for index, truth in enumerate((walks.ARMATURE, walks.DAMPING, level)):
                estimate = fit.fit.estimate(PARAMETERS[index])
                low, high = estimate.interval95
                inside[PARAMETERS[index]].append(low <= truth <= high)
                offset[PARAMETERS[index]].append((estimate.value - truth) / (high - low))
    assert untold < 0.3 * 18 * len(sample)
    for name in PARAMETERS[:3]:
        assert np.mean(inside[name]) >= 0.9, name
        assert abs(np.mean(offset[name])) < 0.04, name


@pytest.fixture(scope="module")
def fast() -> tuple[np.ndarray, list]:
    """Friction and motion of robots whose controllers run at 1 kHz."""
    friction = np.repeat([0.0, 0.1, 0.2], 2)[:, None] * walks.LIMITS
    return friction, walks.fast_motion(friction, [walks.FORWARD, walks.CURVE] * 3)


@pytest.mark.parametrize("every", [2, 5])
def test_a_real_robots_controller_is_faster_than_its_log(fast: tuple[np.ndarray, list], every: int) -> None:
    """Physics and controller at 1 kHz, logged at 500 and 200 Hz: torque is late by part of a period, and kp times that
    would pass for viscous friction and shift the dry one.
    """
    friction, motion = fast
    inside = []
    for level, log in zip(friction, walks.sampled(motion, every), strict=True):
        rows = swing_rows(Walk(log, walks.SPEC, NOISE_ALONE))
        for joint, limit, truth in zip(rows, walks.LIMITS, level, strict=True):
            fit = fit_swing([joint], limit, log.header.period, NOISE_ALONE).fit
            if fit is not None:
                inside.append([low <= t <= high for low, t, high in _compared(fit, truth)])
    armature, viscous, coulomb = np.mean(inside, axis=0)
    assert len(inside) > 70
    assert coulomb >= 0.88
    if every == 2:
        assert min(armature, viscous) >= 0.85


def _compared(fit: PriorFit, level: float) -> list[tuple[float, float, float]]:
    """Return lower end, truth and upper end of armature, viscous and Coulomb friction."""
    ends = [fit.estimate(name).interval95 for name in PARAMETERS[:3]]
    return [(low, truth, high) for (low, high), truth in zip(ends, (walks.ARMATURE, walks.DAMPING, level), strict=True)]


def test_heavier_links_stay_within_the_interval(sample: list) -> None:
    """Identified with links 5 % heavier than the robot's, the estimates move, and the interval knows how far."""
    friction, log = sample[7]
    heavier = [
        replace(link, mass=1.05 * link.mass, inertia=tuple(1.05 * moment for moment in link.inertia))
        for link in walks.SPEC.links
    ]
    spec = replace(walks.SPEC, links=tuple(heavier))
    rows = swing_rows(Walk(log, spec, WalkSetup()))
    inside, moved = [], []
    for joint, limit, level, right in zip(rows, walks.LIMITS, friction, fits(log, WalkSetup()), strict=True):
        wrong = fit_swing([joint], limit, 0.005, WalkSetup())
        if wrong.fit is None or right.fit is None:
            continue
        low, high = wrong.fit.estimate("coulomb_friction").interval95
        inside.append(low <= level <= high)
        moved.append(wrong.fit.values[2] - right.fit.values[2] + right.fit.shifts[0, 2])
    assert np.mean(inside) >= 0.9
    assert np.abs(moved).max() < 0.02


def test_alike_joints_together_tell_more() -> None:
    """Six legs' swings halve the interval of one, and give one where single legs have too few."""
    log = walks.walk(MIXED[None], [walks.FORWARD], seconds=10.0, seed=3)[0]
    rows = swing_rows(Walk(log, walks.SPEC, WalkSetup()))
    alone = fit_swing([rows[2]], walks.LIMITS[2], 0.005, NOISE_ALONE).fit
    together = fit_swing(rows[2::3], walks.LIMITS[2], 0.005, NOISE_ALONE).fit
    assert alone is not None and together is not None
    low, high = together.estimate("coulomb_friction").interval95
    assert low <= MIXED[2] <= high
    assert high - low < 0.7 * np.diff(alone.estimate("coulomb_friction").interval95)[0]


def test_swings_that_are_all_alike_are_refused() -> None:
    """At one speed and no acceleration, viscous and dry friction cannot be told apart."""
    log = walks.walk(np.zeros((1, 18)), [walks.FORWARD], seconds=5.0)[0]
    rows = swing_rows(Walk(log, walks.SPEC, WalkSetup()))[1]
    same = replace(rows, regressor=rows.regressor * [1.0, 0.0, 0.0, 1.0] + [0.0, -2.0, -1.0, 0.0])
    assert fit_swing([same], 25.0, 0.005, WalkSetup()).fit is None
