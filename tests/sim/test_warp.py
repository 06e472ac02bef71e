"""The GPU backend on Warp's processor device, held against native MuJoCo: same fields, same physics, same manners."""

from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("mujoco_warp", reason="mujoco_warp, of the extra 'gpu', is not installed")
import warp

from stiction.core.errors import StictionError
from stiction.joints.friction import Law
from stiction.robots.catalog import find_robot
from stiction.robots.terrain import KINDS, SLABS, Terrain
from stiction.sim.fleet import Fleet, JointFriction
from stiction.sim.native import STATE, NativeSimulation
from stiction.sim.warp import WarpSimulation

pytestmark = pytest.mark.slow

warp.config.optimization_level = 0  # Compiling takes longer than all that is computed here.

GO1 = find_robot("go1")
NUM = 6


def build(backend: type, num: int = NUM) -> Fleet:
    """Robots on a slope each, half of them beside it on the plane. One model for all tests: kernels compile once."""
    kind = np.full(num, KINDS.index("slope"))
    fleet = Fleet(GO1, num, backend=backend, terrain=Terrain(kind), joint_sensors=True)
    fleet.place_terrain(np.arange(num), np.linspace(0.2, 0.6, num), np.zeros((num, SLABS, 4)))
    return fleet


def randomise(fleet: Fleet) -> None:
    """Draw every parameter that the task draws, over its whole range, the same for every fleet of this size."""
    rng, everyone = np.random.default_rng(0), np.arange(fleet.num_envs)
    num, joints = fleet.num_envs, GO1.num_joints

    def uniform(low: float, high: float, *shape: int) -> np.ndarray:
        return rng.uniform(low, high, shape)

    fleet.friction[:] = 0.2 * fleet.torque_limit * uniform(0.0, 1.2, num, joints)
    fleet.damping[:] = GO1.joint_values("damping") * uniform(0.8, 1.2, num, joints)
    fleet.armature[:] = GO1.joint_values("armature") * uniform(0.8, 1.2, num, joints)
    strength = uniform(0.8, 1.2, num, joints)
    fleet.set_gains(strength * fleet.nominal_kp * uniform(0.95, 1.05, num, joints), strength * fleet.nominal_kd)
    fleet.set_ground_friction(uniform(0.2, 2.0, num))
    fleet.set_contact_time(uniform(0.01, 0.03, num))
    fleet.base_mass[:] += uniform(-2.0, 3.0, num)
    fleet.base_com[:] = uniform(-0.1, 0.1, num, 3)
    fleet.delay[:] = fleet.timestep * rng.integers(0, 5, (num, 1))
    fleet.set_const(everyone)
    # The first half stands on the plane beside the slope; the others on the way up, on the landing, on the way down.
    half = everyone >= num // 2
    along = uniform(-0.3, 0.3, num) + np.where(half, 1.6 * (everyone % 3 - 1), 0.0)
    place = np.stack((along, np.where(half, 0.0, 4.0)), -1)
    fleet.reset(everyone, fleet.standing + uniform(-0.1, 0.1, num, joints), position=place)
    fleet.base_position[half, 2] += fleet.ground_around(np.zeros((1, 2)))[half, 0] + 0.05


def walk(fleet: Fleet, steps: int) -> None:
    """Swing all joints for some control periods."""
    for _ in range(steps):
        phase = 10.0 * fleet.simulation.bind("time")[:, None] + np.arange(GO1.num_joints)
        fleet.set_targets(fleet.standing + 0.2 * np.sin(phase))
        assert not len(fleet.step())


def test_disturbances_act_as_in_native_mujoco() -> None:
    """A force on the base and torques on the joints, for one control period and no longer."""
    fleets = [build(backend) for backend in (NativeSimulation, WarpSimulation)]
    rng = np.random.default_rng(1)
    force, torque = rng.uniform(-40.0, 40.0, (NUM, 3)), rng.uniform(-3.0, 3.0, (NUM, GO1.num_joints))
    for fleet in fleets:
        randomise(fleet)
        fleet.disturb(force, torque)
        walk(fleet, 1)
        assert not fleet.simulation.bind("xfrc_applied").any() and not fleet.simulation.bind("qfrc_applied").any()
        walk(fleet, 1)
    undisturbed = build(NativeSimulation)
    randomise(undisturbed)
    walk(undisturbed, 2)
    native, warp = fleets
    assert np.abs(native.joint_position - undisturbed.joint_position).max() > 1e-2
    np.testing.assert_allclose(warp.joint_position, native.joint_position, atol=1e-5)
    np.testing.assert_allclose(warp.base_position, native.base_position, atol=1e-5)


def test_every_randomised_field_acts_as_in_native_mujoco() -> None:
    """A field that Warp ignored, or a constant left stale, would move the joints apart within a step or two."""
    fleets = [build(backend) for backend in (NativeSimulation, WarpSimulation)]
    for fleet in fleets:
        randomise(fleet)
    worst = 0.0
    for _ in range(38):
        for fleet in fleets:
            walk(fleet, 1)
        worst = max(worst, float(np.abs(fleets[0].joint_position - fleets[1].joint_position).max()))
    assert worst < 1e-5
    native, warp = fleets
    np.testing.assert_allclose(warp.base_position, native.base_position, atol=1e-5)
    np.testing.assert_allclose(warp.torque, native.torque, atol=1e-2)
    np.testing.assert_allclose(*(fleet.simulation.bind("sensordata") for fleet in fleets), rtol=1e-2, atol=0.1)
    assert (native.base_position[NUM // 2 :, 2] > 0.3).all() and (native.foot_force > 1.0).any()


def test_reset_puts_the_chosen_robots_where_native_puts_them() -> None:
    """Robots that end an episode start anew, delay lines included; the others must not notice."""
    fleets = [build(backend) for backend in (NativeSimulation, WarpSimulation)]
    for fleet in fleets:
        randomise(fleet)
        walk(fleet, 3)
    before = fleets[1].simulation.state()
    for fleet in fleets:
        fleet.reset(np.array([1, 4]))
    native, warp = (fleet.simulation.state() for fleet in fleets)
    others = [0, 2, 3, 5]
    for name in set(STATE) & set(native):
        np.testing.assert_allclose(warp[name][[1, 4]], native[name][[1, 4]], atol=1e-6, err_msg=name)
        assert np.array_equal(warp[name][others], before[name][others]), name
    late = fleets[1].simulation.bind("actuator_length")
    np.testing.assert_allclose(late[[1, 4]], [fleets[1].standing] * 2, atol=1e-6)
    assert np.abs(late[0] - fleets[1].standing).max() > 0.05
    np.testing.assert_allclose(fleets[1].torque[[1, 4]], 0.0, atol=1e-6)
    walk(fleets[1], 2)
    assert np.abs(late[1] - fleets[1].standing).max() > 0.01
    with pytest.raises(ValueError, match="read-only"):
        late[0] = 0.0


def test_contacts_without_room_are_an_error() -> None:
    """Warp drops what does not fit and goes on: robots would sink through the ground without a word."""
    fleet = build(lambda model, num, threads: WarpSimulation(model, num, threads, contacts=1))
    with pytest.raises(StictionError, match=r"room for 1 contacts a robot.*--set contacts"):
        walk(fleet, 2)


def test_a_blown_up_robot_is_named_and_touches_no_other() -> None:
    """NaN must neither pass unnoticed, nor reach the robots whose contacts lie in the same arrays."""
    fleet, calm = build(WarpSimulation), build(WarpSimulation)
    fleet.joint_velocity[2, 0] = np.nan
    fleet.qpos[3, 2] = np.inf
    calm.step()
    assert list(fleet.simulation.step(fleet.decimation)) == [2, 3]
    others = [0, 1, 4, 5]
    assert np.array_equal(fleet.qpos[others], calm.qpos[others])
    assert list(fleet.step()) == [2, 3]
    assert np.isfinite(fleet.qpos).all() and len(fleet.step()) == 0


def test_state_restores_bit_by_bit_and_the_clock_never_grows() -> None:
    """A resumed run goes on as it was. At 16 s a float32 clock is coarser than what tells a delay's samples apart."""
    fleet = build(WarpSimulation)
    randomise(fleet)
    walk(fleet, 3)
    saved = fleet.simulation.state()
    walk(fleet, 4)
    first = fleet.qpos.copy()
    fleet.reset(np.arange(NUM))
    fleet.simulation.load_state(saved)
    walk(fleet, 4)
    assert np.array_equal(fleet.qpos, first)
    np.testing.assert_allclose(fleet.simulation.bind("time"), 7 * fleet.control_period)
    stamps = fleet.simulation.bind("history").reshape(NUM, GO1.num_joints, -1)[:, :, 2:10]
    expected = np.broadcast_to(-fleet.timestep * np.arange(8, 0, -1), stamps.shape)
    np.testing.assert_allclose(np.sort(stamps), expected, atol=1e-7)
    model, data = fleet.simulation.materialize(2)
    np.testing.assert_allclose(data.history[2:10].max(), 7 * fleet.control_period - fleet.timestep, atol=1e-7)
    assert np.array_equal(data.qpos, fleet.qpos[2]) and model.body_mass[1] == fleet.base_mass[2]


WRITES = {
    "an entry": ("dof_damping", lambda fleet: fleet.damping.__setitem__((2, 3), 0.7)),
    "a sum in place": ("qvel", lambda fleet: fleet.push(np.full((1, 2), 0.2), np.array([4]))),
    "a view of a view": ("qpos", lambda fleet: np.add(fleet.base_position[1], 0.1, out=fleet.base_position[1])),
    "a copy": ("dof_armature", lambda fleet: np.copyto(fleet.armature, 0.02)),
    "a sum at places": ("qvel", lambda fleet: np.add.at(fleet.qvel, (np.array([1, 1]), 7), 0.1)),
    "a filling": ("ctrl", lambda fleet: fleet.targets.fill(0.4)),
    "a clip": ("ctrl", lambda fleet: np.clip(fleet.targets, -0.2, 0.2, out=fleet.targets)),
    "a law of friction": ("dof_frictionloss", lambda fleet: JointFriction(fleet, Law("coulomb")).set_level(0.5)),
}
"""Kind of write -> the field, and the write."""


@pytest.mark.parametrize(("field", "write"), WRITES.values(), ids=WRITES)
def test_what_is_written_goes_up_and_nothing_else(field: str, write: Callable[[Fleet], object]) -> None:
    """A write that is missed does nothing, without a word; what goes up though nobody wrote it costs every step."""
    fleet = build(WarpSimulation)
    simulation = fleet.simulation
    mirrors = simulation._state | simulation._fields
    fleet.step()
    assert not any(mirror.written for mirror in mirrors.values())
    # Reading is not writing, nor is computing with what was read.
    float(fleet.base_position.sum() + (2.0 * fleet.damping + fleet.targets).max() + np.concatenate(fleet.qvel).max())
    fleet.fallen()
    assert not any(mirror.written for mirror in mirrors.values())
    write(fleet)
    assert [other for other, mirror in mirrors.items() if mirror.written] == [field]
    wanted = mirrors[field].values.copy()
    simulation._upload()
    np.testing.assert_array_equal(mirrors[field].device.numpy().reshape(wanted.shape), wanted.astype(np.float32))
    assert not mirrors[field].written


def test_a_field_that_was_never_seen_to_act_is_refused() -> None:
    """Randomisation that does nothing without a word is the recurring fault of batched simulators."""
    with pytest.raises(StictionError, match="'geom_size'"):
        build(WarpSimulation).simulation.expand("geom_size")
