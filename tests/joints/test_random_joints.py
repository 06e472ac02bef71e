"""Joints, laws, gains and targets drawn at random: exact means that a finer grid gives the same motion."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.joints.friction import Asymmetric, Coulomb, FrictionLaw, Stribeck
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Gravity, Joint, simulate

STEP, SAMPLES, FINER = 0.002, 300, 4


def draw(rng: np.random.Generator) -> tuple[Joint, PDGains, np.ndarray, np.ndarray, float]:
    """Return a joint, gains, target, load and start speed, each over orders of magnitude."""

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    laws: list[FrictionLaw] = [
        Coulomb(between(1e-3, 5)),
        Asymmetric(between(1e-3, 5), between(1e-3, 5), 0.1 * rng.normal(), 0.1 * rng.normal()),
        Stribeck(between(1e-3, 3), between(1e-3, 5), between(1e-3, 2)),
        Coulomb(between(1e-3, 2), between(1e-3, 1)),
    ]
    gravity = Gravity(2 * rng.normal(), 2 * rng.normal()) if rng.random() < 0.4 else None
    joint = Joint(between(1e-3, 1), 0.1 + 0.05 * rng.normal(), laws[rng.integers(4)], 0.3 * rng.normal(), gravity)
    gains = PDGains(between(2, 200), between(0.01, 5), strength=between(0.5, 2))
    time = STEP * np.arange(SAMPLES)
    target = rng.normal() * np.sin(between(1, 60) * time) + rng.normal() * (time > 0.3)
    target = np.round(target, int(rng.integers(1, 6)))
    load = rng.normal() * np.sin(between(1, 60) * time) * (rng.random() < 0.4)
    return joint, gains, target, load, rng.normal() * (rng.random() < 0.5)


@pytest.mark.parametrize("seed", range(60))
@pytest.mark.filterwarnings("error")
def test_a_finer_grid_gives_the_same_motion(seed: int) -> None:
    """Within 3 % of the range, over reversals, steps of the target and stick-slip; what cannot be computed is refused.

    The differences that remain are of gravity and load, which are straight between samples.
    """
    joint, gains, target, load, speed = draw(np.random.default_rng(seed))
    time = np.arange(SAMPLES)
    fine = np.arange(FINER * (SAMPLES - 1) + 1) / FINER
    try:
        made = simulate(joint, gains, STEP, target, target[0], speed, load)
    except StictionError as error:
        assert "settle" in str(error) or "runs away" in str(error)
        return
    finer = simulate(
        joint, gains, STEP / FINER, np.interp(fine, time, target), target[0], speed, np.interp(fine, time, load)
    )
    assert np.isfinite(made.position).all()
    gap = np.abs(finer.position[::FINER] - made.position).max()
    assert gap < 0.03 * max(float(np.ptp(made.position)), 1e-3)
