"""Friction under load: found where it can be, refused where it cannot."""

from dataclasses import replace

import numpy as np
import pytest

import walks
from stiction.files.walk import WalkLog
from stiction.identification.walking.load import LoadFit, fit_load
from stiction.identification.walking.setup import WalkSetup
from stiction.identification.walking.swing import swing_rows
from stiction.identification.walking.walk import Walk

BASE = np.tile([0.5, 0.5, 1.0], 6)
"""Friction without load by kind [N m]."""

LOAD = {"hip": 0.05, "thigh": 0.1, "shank": 0.15}
"""Friction per torque by kind [1]."""

COMMANDS = [walks.FORWARD, walks.CURVE, walks.BACKWARD, walks.SIDEWAYS]


def known(**changes) -> WalkSetup:
    """Return the settings of a robot whose masses were declared."""
    return WalkSetup(**{"mass_known": True, "centre_of_mass": walks.centre_of_mass()} | changes)


def load_of(log: WalkLog, setup: WalkSetup) -> LoadFit:
    """Return what a log says about load."""
    walk = Walk(log, walks.SPEC, setup)
    return fit_load(walk, swing_rows(walk))


@pytest.fixture(scope="module")
def logs() -> list[WalkLog]:
    """A walk for each command with friction that grows with load."""
    friction = np.tile(BASE, (len(COMMANDS), 1))
    return walks.walk(friction, COMMANDS, load=np.tile(list(LOAD.values()), 6), seed=40)


def test_without_noise_the_truth_is_found_exactly() -> None:
    """The body's equations are right: Jacobians, contact points, wrenches, elimination of joints at rest."""
    friction, load = BASE[None], np.tile(list(LOAD.values()), 6)
    log = walks.walk(friction, [walks.CURVE], walks.NO_NOISE, load)[0]
    fit = load_of(log, known())
    assert fit.refusal == ""
    for kind, truth in LOAD.items():
        law = fit.laws[kind]
        assert law["load_coefficient"].value == pytest.approx(truth, rel=2e-3)
        assert law["coulomb_friction"].value == pytest.approx(BASE[walks.SPEC.joint_kinds.index(kind)], rel=5e-3)
    off = np.abs([estimate.value for estimate in fit.body.values()])
    assert (off < [0.005, *[0.001] * 3, *[0.05] * 3]).all()


def test_coefficients_are_within_their_intervals(logs: list[WalkLog]) -> None:
    """Four walks, three kinds: c, and friction at the torque of standing legs; unknown coefficients are rejected."""
    inside, told = [], 0
    for log in logs:
        load = load_of(log, known())
        assert load.refusal == ""
        assert set(load.laws) | set(load.refused) == set(walks.SPEC.joint_kinds)
        assert "shank" in load.laws
        for kind, law in load.laws.items():
            told += 1
            low, high = law["load_coefficient"].interval95
            assert high - low < 0.11
            inside.append(low <= LOAD[kind] <= high)
            torque, friction = load.under_load[kind]
            truth = BASE[walks.SPEC.joint_kinds.index(kind)] + LOAD[kind] * torque
            inside.append(friction.interval95[0] <= truth <= friction.interval95[1])
    assert told >= 9
    assert np.mean(inside) >= 0.9


def test_friction_that_does_not_grow_with_load_is_not_said_to() -> None:
    """The intervals hold zero, and are narrow enough to mean it."""
    inside = []
    friction = np.tile(BASE, (len(COMMANDS), 1))
    for log in walks.walk(friction, COMMANDS, seed=40):
        for law in load_of(log, known()).laws.values():
            low, high = law["load_coefficient"].interval95
            inside.append(low <= 0.0 <= high)
    assert len(inside) >= 9
    assert np.mean(inside) >= 0.85


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mass_known": False}, "declare it with --mass-known"),
        ({"payload": 3.0}, "does not fit the declared masses"),
        ({"payload": -1.6}, "does not fit the declared masses"),
        ({"shift": (0.03, 0.0, 0.0)}, "centre_x"),
        ({"shift": (0.0, 0.0, 0.2)}, "does not fit the declared masses"),
    ],
)
def test_unknown_and_wrong_masses_are_refused(logs: list[WalkLog], changes: dict, message: str) -> None:
    """Three kilograms on a robot of 32 kg are rejected, not read as friction."""
    shift = np.array(changes.pop("shift", (0.0, 0.0, 0.0)))
    setup = known(**changes)
    setup = replace(setup, centre_of_mass=tuple(np.array(setup.centre_of_mass) + shift))
    for log in logs[:2]:
        load = load_of(log, setup)
        assert load.laws == {}
        assert message in load.refusal


def test_logs_without_torque_or_accelerometer_are_refused(logs: list[WalkLog]) -> None:
    """Neither the load nor the body's balance is known then."""
    assert "torque was not logged" in load_of(replace(logs[0], joint_torque=None), known()).refusal
    assert "accelerometer" in load_of(replace(logs[0], specific_force=None), known()).refusal
