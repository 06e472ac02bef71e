"""Every engine that is installed passes the conformance suite, and an engine that does something wrong does not."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from saturn_lite import BOXES

from stiction.core.errors import StictionError
from stiction.core.rotation import UPRIGHT, matrix
from stiction.engines.catalog import ENGINES, TIMESTEP, make_engine, missing_engine
from stiction.engines.engine import BlownUp, Body, Make, Motion
from stiction.engines.ground import Ground, flat
from stiction.engines.mujoco_engine import MujocoEngine
from stiction.robots.catalog import find_robot
from stiction.robots.model import Robot, foot_places
from stiction_experiments.engines.conformance.contact import _lifts, raised
from stiction_experiments.engines.conformance.rig import Figure
from stiction_experiments.engines.conformance.suite import CHECKS, check_timestep, conformance, steps_per_second

ROBOT = find_robot("saturn_lite")


@pytest.fixture(scope="module", params=ENGINES)
def make(request: pytest.FixtureRequest) -> Make:
    """Return the maker of an installed engine."""
    missing = missing_engine(request.param, ROBOT)
    if missing:
        pytest.skip(missing)
    return partial(make_engine, request.param)


def failed(figures: tuple[Figure, ...]) -> list[str]:
    """Return the figures that are out of tolerance, as text."""
    return [str(figure) for figure in figures if not figure.passed]


@pytest.mark.parametrize("check", CHECKS)
def test_an_engine_passes(make: Make, check: str) -> None:
    """Every installed engine passes every check."""
    figures = CHECKS[check](make, ROBOT, TIMESTEP)
    assert figures
    assert not failed(figures), "; ".join(failed(figures))


@pytest.mark.parametrize("check", CHECKS)
def test_the_suite_holds_for_a_quadruped_too(check: str) -> None:
    """A figure that only a hexapod can reach would fail every engine on any other robot."""
    figures = CHECKS[check](MujocoEngine, find_robot("go1"), TIMESTEP)
    assert figures
    assert not failed(figures), "; ".join(failed(figures))


def test_feet_are_lifted_so_that_the_others_carry_the_robot() -> None:
    """Tripods of the hexapod; of the quadruped one leg at a time, the weight over the middle of the other feet."""
    assert [lifted.tolist() for lifted, _ in _lifts(ROBOT)] == [(ROBOT.groups() != group).tolist() for group in (0, 1)]
    spec = find_robot("go1")
    lifted, (x, y, z) = _lifts(spec)[0]
    assert lifted.tolist() == [True, False, False, False]
    # The weight comes over the middle of the other feet, the trunk's share of it moved by so much more.
    other = foot_places(spec, raised(spec, lifted))[~lifted].mean(axis=0)
    assert x < 0 < spec.mass / spec.base.mass and z == 0.0 and other[0] < 0 and y * other[1] > 0


def test_a_robot_that_cannot_stand_on_all_feet_but_one_is_refused() -> None:
    """Three legs less one fall over in any engine, and every figure would say that the engine is wrong."""
    tripod = replace(BOXES, legs=BOXES.legs[:3]).robot()
    with pytest.raises(StictionError, match="3 feet; expected at least 4, or two with soles"):
        next(conformance(MujocoEngine, tripod))


def test_a_robot_that_blew_up_is_told_and_begins_anew(make: Make) -> None:
    """Numbers that are no motion would be counted as a walk, or stop an evaluation of hours."""
    spec = find_robot("saturn_lite")
    engine = make(Body.nominal(spec), flat(), TIMESTEP)
    place = np.array([0.0, 0.0, spec.standing_height])
    with pytest.raises(StictionError):
        engine.step(np.full(spec.num_joints, np.nan), np.zeros(spec.num_joints))
    engine.reset(spec.joint_values("default_position"), place, UPRIGHT)
    motion = engine.motion()
    np.testing.assert_allclose(motion.base_position, place, atol=1e-6)
    assert not motion.base_linear_velocity.any() and not motion.joint_velocity.any()
    assert not motion.joint_force.any() and not motion.foot_contact.any()


def test_the_suite_names_the_check_of_every_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    """A table of figures needs to say which engine did what, at which step."""
    seen = []

    def check(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
        seen.append(timestep)
        return Figure("one", 1.0, "m", 2.0), Figure("two", 2.0, "m", 2.0)

    monkeypatch.setattr("stiction_experiments.engines.conformance.suite.CHECKS", {"first": check, "second": check})
    figures = [(measured.check, measured.figure.name) for measured in conformance(MujocoEngine, ROBOT, 0.005)]
    assert figures == [("first", "one"), ("first", "two"), ("second", "one"), ("second", "two")]
    assert seen == [0.005, 0.005] and steps_per_second(MujocoEngine, ROBOT, seconds=0.02) > 0


def test_a_robot_that_blows_up_fails_the_check_and_the_suite_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """One broken check would hide what all the others say, or pass for want of a number."""

    def breaks(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
        raise BlownUp("gone")

    def holds(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
        return (Figure("one", 0.0, "m", 1.0),)

    monkeypatch.setattr("stiction_experiments.engines.conformance.suite.CHECKS", {"first": breaks, "second": holds})
    lost, kept = conformance(MujocoEngine, ROBOT)
    assert lost.check == "first" and np.isnan(lost.figure.value) and not lost.figure.passed
    assert kept.check == "second" and kept.figure.passed


@pytest.mark.parametrize("timestep", [0.0, -0.002, 0.003, 0.00015, 0.2, np.nan])
def test_steps_that_do_not_fit_the_suite_are_refused(timestep: float) -> None:
    """A figure would be taken between two samples of its reference, and fail for that."""
    check_timestep(0.0001)
    check_timestep(0.005)
    with pytest.raises(StictionError, match="whole number of steps"):
        next(conformance(MujocoEngine, ROBOT, timestep))


class Faulty(MujocoEngine):
    """MuJoCo that is told something else than was said, or says something else than is."""

    def __init__(self, body: Body, ground: Ground, timestep: float, told=None, says=None) -> None:
        """told: torque and bounds -> others; says: body and motion -> fields of the motion that are changed."""
        self._told = told or (lambda torque, friction: (torque, friction))
        self._says = says or (lambda body, motion: {})
        super().__init__(body, ground, timestep)

    def step(self, torque: np.ndarray, friction: np.ndarray) -> None:
        """Advance under something else."""
        super().step(*self._told(torque, friction))

    def motion(self, loads: bool = True) -> Motion:
        """Say something else."""
        motion = super().motion(loads)
        return replace(motion, **self._says(self.body, motion))


def creeping(body: Body, ground: Ground, timestep: float) -> MujocoEngine:
    """Return an engine whose friction is as soft as MuJoCo's default."""
    engine = MujocoEngine(body, ground, timestep)
    engine._model.dof_solimp[:, :2], engine._model.dof_solref[:, 0] = 0.9, 0.02
    return engine


def unlimited(body: Body, ground: Ground, timestep: float) -> MujocoEngine:
    """Return an engine whose joints turn without end."""
    engine = MujocoEngine(body, ground, timestep)
    engine._model.jnt_limited[:] = 0
    return engine


class Deaf(MujocoEngine):
    """MuJoCo that hears of a bound of friction only once."""

    def step(self, torque: np.ndarray, friction: np.ndarray) -> None:
        """Advance under the bounds of the first step."""
        self._first = getattr(self, "_first", friction.copy())
        super().step(torque, self._first)


def shuffled(values: np.ndarray) -> np.ndarray:
    """Return joints in the order of PhysX: all hips, all thighs, all shanks."""
    return values.reshape(-1, 3).T.ravel()


NOISE = np.random.default_rng(0)

FAULTS: dict[str, tuple[Make, tuple[str, ...]]] = {
    "friction a tenth too low": (
        partial(Faulty, told=lambda torque, friction: (torque, 0.9 * friction)),
        ("friction of one joint", "friction under control"),
    ),
    "friction that creeps": (creeping, ("friction of one joint", "standing")),
    "bounds that never change": (Deaf, ("changing friction",)),
    "a fall with drag": (
        partial(
            Faulty, says=lambda body, motion: {"base_linear_velocity": np.maximum(motion.base_linear_velocity, -10.0)}
        ),
        ("long fall",),
    ),
    "joints without limits": (unlimited, ("joint limit",)),
    "no viscous friction": (
        lambda body, *rest: MujocoEngine(replace(body, damping=0.0 * body.damping), *rest),
        ("friction of one joint",),
    ),
    "no rotors": (
        lambda body, *rest: MujocoEngine(replace(body, armature=0.0 * body.armature), *rest),
        ("joint order", "free flight"),
    ),
    "joints in another order": (
        partial(Faulty, told=lambda torque, friction: (shuffled(torque), shuffled(friction))),
        ("joint order",),
    ),
    "velocity of the centre of mass": (
        partial(
            Faulty,
            says=lambda body, motion: {
                "base_linear_velocity": motion.base_linear_velocity
                + np.cross(motion.base_angular_velocity, body.base_com)
            },
        ),
        ("base velocity",),
    ),
    "velocity seen from the world": (
        partial(
            Faulty,
            says=lambda body, motion: {
                "base_linear_velocity": matrix(motion.base_quaternion) @ motion.base_linear_velocity
            },
        ),
        ("base velocity",),
    ),
    "left feet for right ones": (
        partial(
            Faulty,
            says=lambda body, motion: {"foot_contact": motion.foot_contact.reshape(-1, 2)[:, ::-1].ravel()},
        ),
        ("foot contact",),
    ),
    "a tenth of the load forgotten": (
        partial(Faulty, says=lambda body, motion: {"joint_force": 0.9 * motion.joint_force}),
        ("hanging legs", "standing"),
    ),
    "feet that do not slip": (
        lambda body, *rest: MujocoEngine(replace(body, ground_friction=1.0), *rest),
        ("foot friction",),
    ),
    "nothing on the plane": (
        lambda body, ground, timestep: MujocoEngine(body, flat(), timestep),
        ("terrain", "shank contact"),
    ),
    "never the same twice": (
        partial(Faulty, told=lambda torque, friction: (torque + 1e-12 * NOISE.standard_normal(18), friction)),
        ("determinism",),
    ),
}
"""Fault -> an engine that has it, and the checks that must find it."""


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_found(fault: str) -> None:
    """A suite that nothing fails would say nothing."""
    make, checks = FAULTS[fault]
    for check in checks:
        assert failed(CHECKS[check](make, ROBOT, TIMESTEP)), check
