"""Robots of any engine behind the interface of the batched simulation: MuJoCo against itself, and what is refused."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.engines.batch import EngineBatch
from stiction.engines.catalog import missing_engine
from stiction.learning.arguments import parse
from stiction.robots.catalog import find_robot
from stiction.sim.fleet import Fleet
from stiction.task.config import RandomizationCfg

SPEC = find_robot("saturn_lite")
NUM = 4


def fleets(engine: str) -> tuple[Fleet, Fleet]:
    """Return robots in an engine, and the same in MuJoCo's batch, that differ from each other.

    Without kd: the batch takes it implicitly, engines take what was computed before the step. Half have a delay.
    """
    both = Fleet(SPEC, NUM, backend=partial(EngineBatch, engine, SPEC)), Fleet(SPEC, NUM)
    for fleet in both:
        fleet.set_gains(np.tile(fleet.nominal_kp, (NUM, 1)), np.zeros((NUM, SPEC.num_joints)))
        fleet.damping[:] = np.linspace(2.0, 4.0, NUM)[:, None]
        fleet.armature[:] *= np.linspace(0.8, 1.2, NUM)[:, None]
        fleet.base_mass[:] += np.linspace(-2.0, 3.0, NUM)
        fleet.base_com[:, 0] += np.linspace(-0.05, 0.05, NUM)
        fleet.friction[:] = np.linspace(0.0, 4.0, NUM)[:, None]
        fleet.delay[::2] = 0.01
        fleet.set_ground_friction(np.linspace(0.3, 1.5, NUM))
        fleet.set_const(np.arange(NUM))
        fleet.reset(np.arange(NUM), velocity=np.tile([0.3, 0.1, 0.0, 0.0, 0.0, 0.0], (NUM, 1)))
    return both


def drive(fleet: Fleet, begin: int, end: int) -> None:
    """Move the joints for some control periods."""
    for step in range(begin, end):
        wave = 0.2 * np.sin(0.3 * step + np.arange(SPEC.num_joints))
        fleet.set_targets(np.tile(fleet.standing + wave, (NUM, 1)))
        assert not len(fleet.step())


def assert_alike(one: Fleet, other: Fleet) -> None:
    """Compare what a task sees, but for accelerations: MuJoCo's are those before damping, which it takes implicitly."""
    for name in ("qpos", "qvel", "torque"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-9, err_msg=name)
    np.testing.assert_array_equal(one.foot_contact, other.foot_contact)


def test_mujoco_is_mujocos_batch() -> None:
    """Masses, rotors, friction, delays, ground, pushes and resets all arrive, and arrive in time."""
    one, other = fleets("mujoco")
    drive(one, 0, 10), drive(other, 0, 10)
    assert_alike(one, other)
    for fleet in (one, other):
        fleet.push(np.array([[0.4, -0.2]]), np.array([1]))
        fleet.reset(np.array([2]), joint_position=fleet.standing[None] + 0.1, heading=np.array([1.0]))
    np.testing.assert_allclose(one.qpos, other.qpos, atol=1e-9)
    drive(one, 10, 20), drive(other, 10, 20)
    assert_alike(one, other)


def test_a_robot_that_blew_up_is_reported_and_comes_back() -> None:
    """It is left out until its reset, and the others go on."""
    one, _ = fleets("mujoco")
    drive(one, 0, 2)
    one.friction[1] = np.nan
    one.set_targets(np.tile(one.standing, (NUM, 1)))
    assert one.step().tolist() == [1]
    one.friction[1] = 0.0
    drive(one, 2, 4)
    assert np.isfinite(one.qpos).all()


def test_a_field_without_effect_is_refused() -> None:
    """Terrain, soft contacts and gravity would silently be the nominal ones."""
    one, _ = fleets("mujoco")
    for name in ("geom_pos", "geom_solref", "opt.gravity"):
        with pytest.raises(StictionError, match=r"has no effect in the engine 'mujoco'"):
            one.simulation.expand(name)
    with pytest.raises(StictionError, match="no 'sensor_delay'"):
        one.simulation.bind("sensor_delay")
    one.disturb(torque=np.ones((NUM, SPEC.num_joints)))
    with pytest.raises(StictionError, match="no forces from outside"):
        one.step()
    with pytest.raises(StictionError, match="no joint sensors"):
        Fleet(SPEC, 1, backend=partial(EngineBatch, "mujoco", SPEC), joint_sensors=True)


@pytest.mark.parametrize("engine", ["physx", "ode", "ode-webots"])
def test_other_engines_hold_the_robot_up(engine: str) -> None:
    """It stands still under its own weight, on all feet, and its joints are held by friction."""
    if why := missing_engine(engine, SPEC):
        pytest.skip(why)
    fleet = Fleet(SPEC, 2, backend=partial(EngineBatch, engine, SPEC))
    fleet.friction[:] = 5.0
    fleet.reset(np.arange(2))
    for _ in range(50):
        fleet.set_targets(np.tile(fleet.standing, (2, 1)))
        fleet.step()
    assert fleet.foot_contact.all()
    np.testing.assert_allclose(fleet.base_position[:, 2], SPEC.standing_height, atol=0.03)
    np.testing.assert_allclose(fleet.joint_position, np.tile(fleet.standing, (2, 1)), atol=0.08)
    np.testing.assert_allclose(fleet.base_position[0], fleet.base_position[1], atol=1e-6)


@pytest.mark.parametrize(
    "words",
    [
        ["--device", "warp-cpu"],
        ["--physics", "plastic"],
        ["--terrain", "stairs"],
        ["--friction-law", "load", "--friction-level", "0.1"],
        ["--method", "hinf"],
        ["--task.randomization.contact-time", "0.01", "0.02"],
    ],
)
def test_what_an_engine_cannot_train_with_is_one_line(words: list[str]) -> None:
    """Before any folder is made, by its option's name."""
    with pytest.raises(StictionError, match="--engine physx cannot train with"):
        parse(["--engine", "physx", "--preset", "two-phase", *words])
    config = parse(["--engine", "physx"]).config
    assert config.engine == "physx"
    assert parse([]).config.task.randomization.contact_time == (0.01, 0.01)
    assert config.task.randomization.contact_time == RandomizationCfg().contact_time
