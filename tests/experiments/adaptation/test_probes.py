"""Probes and monitor: a latent that encodes friction is found, one that does not is not, and intervals cover."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_experiments.adaptation.monitor import fit_monitor
from stiction_experiments.adaptation.probes import (
    HISTORIES,
    FrictionWalk,
    held_out,
    histories,
    probe,
    probe_walk,
    windows,
)

STEPS, ROBOTS, JOINTS = 120, 200, 3


def make_walk(seed: int, per: str = "joint", noise: float = 0.2) -> FrictionWalk:
    """Frames, latents: latent = rotated friction plus noise at every step; the estimate says nothing."""
    generator = np.random.default_rng(seed)
    friction = generator.uniform(0.0, 0.24, (ROBOTS, JOINTS if per == "joint" else 1)) * np.ones(JOINTS)
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((4, 4)))[0][:JOINTS]
    steps = generator.standard_normal((STEPS, ROBOTS, 4))
    return FrictionWalk(
        frames=np.concatenate([steps[..., :1], friction + 0.15 * steps[..., 1:]], -1).astype(np.float32),
        latent=(friction @ turn + noise * steps).astype(np.float32),
        explicit=generator.standard_normal((STEPS, ROBOTS, 2)).astype(np.float32),
        teacher=(friction @ turn).astype(np.float32),
        friction=friction,
        fallen=0,
    )


def test_a_latent_that_encodes_friction_is_found_and_shuffled_labels_are_not() -> None:
    """Averaged over the walk the noise is 0.02 of a spread of 0.07: R² near 1; at one step 1/9; by chance, near 0."""
    scores = {
        (one["input"], one["row"], one["shuffled"]): one
        for one in probe_walk(make_walk(1), lambda before, now: before * now, "joint")
    }
    assert scores["latent", "walk", False]["mean"] == pytest.approx(0.93, abs=0.04)
    assert scores["latent", "walk", False]["interval95"][0] > 0.85
    assert 0.02 < scores["latent", "step", False]["mean"] < 0.25
    assert scores["teacher", "walk", False]["mean"] > 0.99
    assert abs(scores["latent", "walk", True]["mean"]) < 0.15
    assert scores["latent", "walk", True]["interval95"][0] < 0 < scores["latent", "walk", True]["interval95"][1] + 0.1
    assert scores["explicit", "walk", False]["mean"] < 0.1
    short, long = (scores[f"history {length}", "step", False]["mean"] for length in (11, 51))
    assert 0.2 < short < long


def test_no_test_robot_is_fitted_on() -> None:
    """A probe whose test robots have labels of their own kind must fail on them: they share no row with the others."""
    generator = np.random.default_rng(0)
    features = generator.standard_normal((1, 80, 2))
    targets = features[0, :, :1] * np.where(held_out(80), -1.0, 1.0)[:, None]
    assert probe(features, targets)["mean"] == pytest.approx(-3.0, abs=0.1)
    assert np.flatnonzero(held_out(9)).tolist() == [3, 7]


def test_windows_and_histories_by_hand() -> None:
    """Steps 0..4 in windows of 2: means 0.5 and 2.5, the last step left over; a history ends at its own step."""
    signal = np.arange(5.0)[:, None, None]
    assert windows(signal, 2).ravel().tolist() == [0.5, 2.5]
    frames = np.stack([np.arange(60.0), 100 + np.arange(60.0)], -1)[:, None]
    eleven = histories(frames, 11)
    assert eleven.shape == (1, 1, 22)
    assert eleven[0, 0, -2:].tolist() == [max(HISTORIES) - 1, 100 + max(HISTORIES) - 1]
    assert eleven[0, 0, 0] == max(HISTORIES) - 11


def test_the_monitors_intervals_hold_on_robots_it_never_met() -> None:
    """Fitted on two walks, asked about two others: 95 % of the intervals hold the friction, of joints and of robots."""
    walks = {per: make_walk(seed, per) for seed, per in enumerate(("joint", "robot"))}
    model = fit_monitor(walks, lambda before, now: now, ("a", "b", "c"), 0.24, "0" * 64, window=50)
    assert model.estimated == (True,) * 4
    assert min(model.coverage) > 0.85
    held, errors = [], []
    for seed in (5, 6):
        other = make_walk(seed, "joint")
        means = windows(other.frames[1:], 50)
        estimates = (means - np.array(model.center)) / np.array(model.scale) @ np.array(model.weights)
        error = np.abs(estimates[..., :JOINTS] + np.array(model.intercept)[:JOINTS] - other.friction)
        held.append(error <= np.array(model.reach)[:JOINTS])
        errors.append(error)
    assert np.mean(held) == pytest.approx(0.95, abs=0.03)
    assert np.mean(errors) < 0.05


def test_nothing_is_told_where_nothing_can_be() -> None:
    """Features without friction: no target passes, so no monitor is built."""
    walks = {per: make_walk(seed, per) for seed, per in enumerate(("joint", "robot"))}
    blind = fit_monitor(walks, lambda before, now: now[..., :1], ("a", "b", "c"), 0.24, "0" * 64, window=50)
    assert not any(blind.estimated)
