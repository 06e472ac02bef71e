"""Every engine that is installed passes the conformance suite, and an engine that does something wrong does not."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from stiction.formats.errors import StictionError
from stiction.robots.catalog import find_robot
from stiction.transfer.engines.catalog import ENGINES, make_engine, what_is_missing
from stiction.transfer.engines.checks.rig import UPRIGHT, Figure, Make
from stiction.transfer.engines.conformance import CHECKS, TIMESTEP
from stiction.transfer.engines.engine import Body, Motion
from stiction.transfer.engines.ground import Ground, flat
from stiction.transfer.engines.mujoco_engine import MujocoEngine
from stiction.transfer.engines.rotation import matrix


@pytest.fixture(scope="module", params=ENGINES)
def make(request: pytest.FixtureRequest) -> Make:
    """What makes an engine, of those that are installed."""
    missing = what_is_missing(request.param, find_robot("saturn_lite"))
    if missing:
        pytest.skip(missing)
    return partial(make_engine, request.param)


def failed(figures: tuple[Figure, ...]) -> list[str]:
    """Return the figures that are out of tolerance, as text."""
    return [str(figure) for figure in figures if not figure.passed]


@pytest.mark.parametrize("check", CHECKS)
def test_an_engine_passes(make: Make, check: str) -> None:
    """If this failed, a difference between engines could be a fault of ours and not of the policy."""
    figures = CHECKS[check](make, TIMESTEP)
    assert figures
    assert not failed(figures), "; ".join(failed(figures))


@pytest.mark.parametrize("name", ["go1", "saturn_lite"])
def test_every_robot_can_be_built_and_stands(make: Make, name: str) -> None:
    """The suite knows one robot; a quadruped's legs, masses and gains must be built from its own description."""
    spec = find_robot(name)
    body, standing = Body.nominal(spec), spec.joint_values("standing")
    engine = make(body, flat(), TIMESTEP)
    engine.reset(standing, np.array([1.0, -2.0, spec.standing_height]), UPRIGHT)
    for _ in range(200):
        engine.step(np.zeros(spec.num_joints), np.full(spec.num_joints, 1e4))
    motion = engine.motion()
    np.testing.assert_allclose(motion.base_position, [1.0, -2.0, spec.standing_height], atol=3e-3)
    np.testing.assert_allclose(motion.joint_position, standing, atol=3e-3)
    assert motion.foot_contact.shape == (len(spec.legs),) and motion.foot_contact.all()


def test_a_robot_that_blew_up_is_told_and_begins_anew(make: Make) -> None:
    """Numbers that are no motion would be counted as a walk, or stop an evaluation of hours."""
    spec = find_robot("saturn_lite")
    engine = make(Body.nominal(spec), flat(), TIMESTEP)
    place = np.array([0.0, 0.0, spec.standing_height])
    with pytest.raises(StictionError):
        engine.step(np.full(spec.num_joints, np.nan), np.zeros(spec.num_joints))
    engine.reset(spec.joint_values("standing"), place, UPRIGHT)
    motion = engine.motion()
    np.testing.assert_allclose(motion.base_position, place, atol=1e-6)
    assert not motion.base_linear_velocity.any() and not motion.joint_velocity.any()
    assert not motion.joint_force.any() and not motion.foot_contact.any()


class Oiled(MujocoEngine):
    """Friction is a tenth too low."""

    def step(self, torque: np.ndarray, friction: np.ndarray) -> None:
        super().step(torque, 0.9 * friction)


class Soft(MujocoEngine):
    """Friction that creeps, as MuJoCo's default does."""

    def __init__(self, body: Body, ground: Ground, timestep: float) -> None:
        super().__init__(body, ground, timestep)
        self._model.dof_solimp[:, :2] = 0.9
        self._model.dof_solref[:, 0] = 0.02


class Bare(MujocoEngine):
    """No rotors."""

    def __init__(self, body: Body, ground: Ground, timestep: float) -> None:
        super().__init__(replace(body, armature=np.zeros_like(body.armature)), ground, timestep)


class Dry(MujocoEngine):
    """No viscous friction."""

    def __init__(self, body: Body, ground: Ground, timestep: float) -> None:
        super().__init__(replace(body, damping=np.zeros_like(body.damping)), ground, timestep)


class Shuffled(MujocoEngine):
    """Joints in the order of PhysX: all hips, all thighs, all shanks."""

    def step(self, torque: np.ndarray, friction: np.ndarray) -> None:
        super().step(torque.reshape(-1, 3).T.ravel(), friction.reshape(-1, 3).T.ravel())


class Changed(MujocoEngine):
    """Something is read wrong: `change` says what."""

    def motion(self) -> Motion:
        motion = super().motion()
        return replace(motion, **self.change(motion))

    def change(self, motion: Motion) -> dict[str, np.ndarray]:
        raise NotImplementedError


class OfTheCentre(Changed):
    """The velocity is that of the centre of mass."""

    def change(self, motion: Motion) -> dict[str, np.ndarray]:
        more = np.cross(motion.base_angular_velocity, self.body.base_com)
        return {"base_linear_velocity": motion.base_linear_velocity + more}


class InTheWorld(Changed):
    """The velocity of the base is seen from the world."""

    def change(self, motion: Motion) -> dict[str, np.ndarray]:
        return {"base_linear_velocity": matrix(motion.base_quaternion) @ motion.base_linear_velocity}


class Mirrored(Changed):
    """Left feet are taken for right ones."""

    def change(self, motion: Motion) -> dict[str, np.ndarray]:
        return {"foot_contact": motion.foot_contact.reshape(-1, 2)[:, ::-1].ravel()}


class WeightForgotten(Changed):
    """What a joint transmits is a tenth too low."""

    def change(self, motion: Motion) -> dict[str, np.ndarray]:
        return {"joint_force": 0.9 * motion.joint_force}


class OnTape(MujocoEngine):
    """Feet that never slip."""

    def __init__(self, body: Body, ground: Ground, timestep: float) -> None:
        super().__init__(replace(body, ground_friction=1.0), ground, timestep)


class OnThePlane(MujocoEngine):
    """Boxes and height fields are not there."""

    def __init__(self, body: Body, ground: Ground, timestep: float) -> None:
        super().__init__(body, flat(), timestep)


class Shifted(MujocoEngine):
    """Height fields begin half a cell too far."""

    def __init__(self, body: Body, ground: Ground, timestep: float) -> None:
        field = ground.field
        if field is not None:
            corner = field.corner[0] + field.cell / 2, field.corner[1]
            ground = replace(ground, field=replace(field, corner=corner))
        super().__init__(body, ground, timestep)


class Shaken(MujocoEngine):
    """Never the same twice."""

    generator = np.random.default_rng(0)

    def step(self, torque: np.ndarray, friction: np.ndarray) -> None:
        super().step(torque + 1e-12 * self.generator.standard_normal(len(torque)), friction)


FAULTS = [
    (Oiled, "friction of one joint"),
    (Oiled, "friction under control"),
    (Soft, "friction of one joint"),
    (Soft, "standing"),
    (Bare, "joint order"),
    (Bare, "free flight"),
    (Dry, "friction of one joint"),
    (Shuffled, "joint order"),
    (OfTheCentre, "base velocity"),
    (InTheWorld, "base velocity"),
    (Mirrored, "foot contact"),
    (WeightForgotten, "hanging legs"),
    (OnTape, "foot friction"),
    (OnThePlane, "terrain"),
    (OnThePlane, "shank contact"),
    (Shifted, "terrain"),
    (Shaken, "determinism"),
]


@pytest.mark.parametrize(("fault", "check"), FAULTS, ids=[f"{fault.__name__}, {check}" for fault, check in FAULTS])
def test_a_fault_is_found(fault: type[MujocoEngine], check: str) -> None:
    """A suite that nothing fails would say nothing."""
    assert failed(CHECKS[check](fault, TIMESTEP))
