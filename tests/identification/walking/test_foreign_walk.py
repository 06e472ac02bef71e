"""Walks in others' columns: of the truth what a robot on the lab's floor would log, and nothing more.

One trot of a Go2 and one walk of a hexapod at 1 kHz, whose friction is known, are sampled and read in many ways.
"""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import trots
from estimates import holds
from stiction.core.errors import ConfigurationError, LogError
from stiction.core.rotation import up_in_frames
from stiction.files.joints import JointsFile
from stiction.files.log import BodySignals, Log
from stiction.identification.setup import IdentifySetup
from stiction.identification.walking.foreign import foreign_walk, match_names
from stiction.identification.walking.imu import base_imu
from stiction.identification.walking.pipeline import identify_walk
from stiction.identification.walking.setup import RobotLogSetup, WalkSetup
from stiction.identification.walking.walk import Walk

GO2_FRICTION = np.tile([1.2, 0.8, 1.8], 4)
HEXAPOD_FRICTION = 0.05 * trots.limits(trots.HEXAPOD)
DECLARED = IdentifySetup(torque_source="motor_side", kp=trots.KP, kd=trots.KD)
PLACED = RobotLogSetup(imu_position=trots.IMU)
Raw = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def trot() -> trots.Walked:
    """A trot of a Go2 over 5 s."""
    return trots.trot(GO2_FRICTION, 5.0, seed=3)


@pytest.fixture(scope="module")
def raw(trot: trots.Walked) -> Raw:
    """Return the readings of a walk at 500 Hz."""
    return trots.sampled(trots.GO2, trot)


def read(raw: Raw, declared: IdentifySetup = DECLARED, **body: np.ndarray | None) -> Walk:
    """Read a log of the Go2; body: differences of its body columns."""
    return foreign_walk(trots.opened(trots.GO2, raw, **body), trots.GO2, declared, PLACED)


def identify(walk: Walk, **setup: str) -> JointsFile:
    """Identify it."""
    chosen = WalkSetup(**setup)  # type: ignore[arg-type]
    return identify_walk(replace(walk, setup=chosen)).joints


def test_friction_of_a_trot_is_within_its_intervals(raw: Raw) -> None:
    """A Go2's own columns are enough: no base position, no base velocity, no motion capture."""
    joints = identify(read(raw))
    inside, rates = [], []
    for name, friction in zip(trots.GO2.joint_names, GO2_FRICTION, strict=True):
        record = joints.record(name)
        inside.append(holds(record.coulomb_friction, friction))
        rates.append(holds(record.viscous_friction, trots.DAMPING))
        assert record.kp == trots.KP and record.torque_source == "motor_side"
    assert np.mean(inside) >= 0.9
    assert np.mean(rates) >= 0.8
    assert len([name for name in joints.joints if name in trots.GO2.joint_names]) >= 8
    loaded = identify_walk(replace(read(raw), setup=WalkSetup(mass_known=True))).load
    assert not loaded.laws and "torques as they were at its stamps" in loaded.refusal
    record = next(iter(joints.joints.values()))
    assert "as logged" in record.diagnostics["contact"]
    assert any("foot forces were taken in the robot's order" in text for text in record.warnings)


def test_friction_of_a_hexapod_is_within_its_intervals() -> None:
    """Six legs under a trained policy, sampled at the least rate that is admitted; the IMU's place is not known."""
    (walked,) = trots.hexapods(HEXAPOD_FRICTION[None], (0.5, 0.0, 0.0), 5.0)
    log = trots.opened(trots.HEXAPOD, trots.sampled(trots.HEXAPOD, walked, every=5))
    walk = foreign_walk(log, trots.HEXAPOD, IdentifySetup(torque_source="motor_side"))
    assert walk.unplaced > 0
    joints = identify_walk(walk).joints
    known = [
        holds(joints.record(name).coulomb_friction, friction)
        for name, friction in zip(trots.HEXAPOD.joint_names, HEXAPOD_FRICTION, strict=True)
        if joints.record(name).coulomb_friction is not None
    ]
    assert len(known) >= 12
    assert np.mean(known) >= 0.85
    assert all(record.viscous_friction is None for record in joints.joints.values())


@pytest.mark.parametrize(("every", "admitted"), [(5, True), (6, False), (20, False)])
def test_the_least_rate_is_that_at_which_intervals_still_hold(trot: trots.Walked, every: int, admitted: bool) -> None:
    """200 Hz tells dry friction alone; below, and at a policy's 50 Hz, the refusal says why, and no number comes."""
    raw = trots.sampled(trots.GO2, trot, every)
    if not admitted:
        with pytest.raises(LogError, match=r"came \d+ times a second; expected 200 or more: .* joint controllers"):
            read(raw)
        return
    joints = identify(read(raw))
    truths = zip(trots.GO2.joint_names, GO2_FRICTION, strict=True)
    assert np.mean([holds(joints.record(name).coulomb_friction, friction) for name, friction in truths]) >= 0.8
    for record in joints.joints.values():
        assert record.viscous_friction is None and record.inertia is None and "rotor_inertia" not in record.diagnostics
        assert any("inertia and viscous friction are not stated" in text for text in record.warnings)


def test_sources_of_contact_agree_and_are_named(raw: Raw) -> None:
    """Force, torque and height tell of the same swings, and the record says which one was asked."""
    walk = read(raw)
    down = {
        source: replace(walk, setup=WalkSetup(contact=source)).down  # type: ignore[arg-type]
        for source in ("logged", "torque", "height")
    }
    # A foot in swing by one source bears no load by another; what is called stance by mistake costs data alone.
    for source in ("torque", "height"):
        assert np.mean(~down[source] & down["logged"]) < 0.06
    assert np.mean(down["torque"] == down["logged"]) > 0.85
    for source, word in (("torque", "the motors' torque"), ("height", "kinematics")):
        joints = identify(walk, contact=source)
        assert word in next(iter(joints.joints.values())).diagnostics["contact"]
        levels = {"hip": 1.2, "thigh": 0.8, "calf": 1.8}
        inside = [
            holds(record.coulomb_friction, levels[record.diagnostics["kind"]])
            for record in joints.joints.values()
            if record.coulomb_friction is not None
        ]
        assert len(inside) >= 6 and np.mean(inside) >= 0.8
    with pytest.raises(LogError, match="--contact logged: the log has no foot contact"):
        identify(read(raw, foot_force=None), contact="logged")


def test_another_robot_is_refused_by_its_joints(raw: Raw) -> None:
    """Rejects the masses and lengths of another robot."""
    log = trots.opened(trots.GO2, raw)
    with pytest.raises(LogError, match=r"robot 'saturn_lite': unknown joint 'FR_calf'; known: FL_hip, .* --robot"):
        foreign_walk(log, trots.HEXAPOD, DECLARED)
    numbered = replace(log, joints={f"joint_{n}": signals for n, signals in enumerate(log.joints.values())})
    with pytest.raises(LogError, match="the log only numbers its joints: name them in its order, --names"):
        match_names(numbered, trots.GO2)
    for pair, hint in {"FR_hop=FR_hip": "did you mean 'FR_hip'?", "FR_hip=FR_thihg": "did you mean 'FR_thigh"}.items():
        with pytest.raises(LogError, match=f"--joint-map {pair}: unknown joint .*{re.escape(hint)}"):
            match_names(log, trots.GO2, (pair,))
    with pytest.raises(ConfigurationError, match=r"unknown contact 'hight'; did you mean 'height'\?"):
        WalkSetup(contact="hight")  # type: ignore[arg-type]
    fewer = replace(log, joints={name: signals for name, signals in log.joints.items() if name != "RL_calf"})
    with pytest.raises(LogError, match="has the joint 'RL_calf_joint', the log has not"):
        match_names(fewer, trots.GO2)
    other = replace(log, joints={name.replace("calf", "knee"): signals for name, signals in log.joints.items()})
    pairs = tuple(f"{leg}_knee={leg}_calf" for leg in ("FR", "FL", "RR", "RL"))
    assert match_names(other, trots.GO2, pairs)[2] == "FR_knee"


def turned(spin: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function that turns a quaternion's heading by an angle [rad]."""
    first = np.array([np.cos(spin / 2), 0.0, 0.0, np.sin(spin / 2)])

    def turn(quaternion: np.ndarray) -> np.ndarray:
        w, x, y, z = quaternion.T
        a, d = first[0], first[3]
        return np.stack([a * w - d * z, a * x - d * y, a * y + d * x, a * z + d * w], axis=1)

    return turn


@pytest.mark.parametrize("heading", [0.0, 1.0, 2.5])
def test_a_quaternion_in_another_order_is_refused(raw: Raw, heading: float) -> None:
    """Rejects a quaternion in x y z w, which reads as upright at heading zero."""
    right = turned(heading)(raw["quaternion"])
    walk = read(raw, quaternion=right)
    np.testing.assert_allclose(np.linalg.norm(walk.log.quaternion, axis=1), 1.0)
    with pytest.raises(LogError, match=r"only if it is x y z w; .*--columns quaternion=W,X,Y,Z"):
        read(raw, quaternion=right[:, [1, 2, 3, 0]])
    with pytest.raises(LogError, match="of the world in the base"):
        read(raw, quaternion=right * [1, -1, -1, -1])


def test_units_that_physics_settles_are_converted_and_said(raw: Raw) -> None:
    """An accelerometer in g and a gyroscope in degrees per second cannot be anything else."""
    plain = read(raw).log
    walk = read(raw, accelerometer=raw["accelerometer"] / 9.81)
    assert plain.specific_force is not None and walk.log.specific_force is not None
    np.testing.assert_allclose(walk.log.specific_force, plain.specific_force, atol=1e-9)
    assert any("the accelerometer is in g" in note for note in walk.notes)
    walk = read(raw, gyroscope=np.degrees(raw["gyroscope"]))
    np.testing.assert_allclose(walk.log.angular_velocity, plain.angular_velocity, atol=1e-9)
    assert any("the gyroscope is in degrees per second" in note for note in walk.notes)


def test_what_an_imu_cannot_mean_is_refused(raw: Raw) -> None:
    """Rejects impossible IMU readings."""
    force, up = raw["accelerometer"], 9.81 * up_in_frames(raw["quaternion"])
    with pytest.raises(LogError, match="gravity was taken off"):
        read(raw, accelerometer=force - up)
    with pytest.raises(LogError, match="it has the sign of gravity"):
        read(raw, accelerometer=-force)
    with pytest.raises(LogError, match=r"accelerometer points [89]\d° away from up"):
        read(raw, accelerometer=force[:, [2, 0, 1]])
    with pytest.raises(LogError, match="do not tell of the same motion"):
        read(raw, gyroscope=raw["gyroscope"][::-1].copy())
    with pytest.raises(LogError, match=r"length is .*; expected 1"):
        read(raw, quaternion=3 * raw["quaternion"])
    with pytest.raises(LogError, match="is not finite"):
        read(raw, gyroscope=np.where(np.arange(len(force))[:, None] == 7, np.nan, raw["gyroscope"]))


def test_an_imu_that_is_not_there_is_one_line(raw: Raw) -> None:
    """A log without an IMU is rejected in one line that names the signals to log."""
    with pytest.raises(LogError, match=r"no quaternion, no gyroscope, no accelerometer: .* of no joint .* log the IMU"):
        read(raw, quaternion=None, gyroscope=None, accelerometer=None)
    with pytest.raises(LogError, match="no gyroscope: how the base turns"):
        read(raw, gyroscope=None)
    with pytest.raises(LogError, match="no quaternion, no accelerometer: how the base turns and which way is up"):
        read(raw, quaternion=None, accelerometer=None)


def test_the_imu_s_lever_is_taken_off() -> None:
    """A base that spins at 2 rad/s about z: at 0.5 m along x the accelerometer feels -ω² r = -2 m/s² along x."""
    samples, step = 400, 0.005
    rate = np.tile([0.0, 0.0, 2.0], (samples, 1))
    felt = np.tile([-2.0, 0.0, 9.81], (samples, 1))
    half = np.arange(samples) * step  # the angle over two
    body = BodySignals(np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1), rate, felt)
    imu, _ = base_imu("log", body, step, (0.5, 0.0, 0.0))
    assert imu.accelerometer is not None
    np.testing.assert_allclose(imu.accelerometer, [[0, 0, 9.81]] * samples)


def test_feet_in_another_order_are_refused(raw: Raw) -> None:
    """A force that is large while its foot is up belongs to another leg."""
    with pytest.raises(LogError, match="not large where that foot is low"):
        read(raw, foot_force=raw["foot_force"][:, [1, 0, 3, 2]])
    with pytest.raises(LogError, match="never changes"):
        read(raw, foot_force=np.ones_like(raw["foot_force"]))
    with pytest.raises(LogError, match="foot force of 3 feet"):
        read(raw, foot_force=raw["foot_force"][:, :3])


def test_torque_is_needed_or_targets_with_gains(raw: Raw) -> None:
    """Rejects a log with neither torque nor targets and gains; torque beyond the motor's limit is in another unit."""
    log = trots.opened(trots.GO2, raw)
    silent = replace(log, joints={name: replace(one, torque=None) for name, one in log.joints.items()})
    with pytest.raises(LogError, match="without targets and the gains --kp and --kd"):
        foreign_walk(silent, trots.GO2, IdentifySetup())
    walk = foreign_walk(silent, trots.GO2, DECLARED, PLACED)
    record = identify(walk).record("FR_calf_joint")
    assert record.coulomb_friction is None
    assert holds(record.combinations["f/k"], GO2_FRICTION[2])
    with pytest.raises(LogError, match=r"reaches \S+ times its limit"):
        read(raw, replace(DECLARED, torque_scale=1000.0))


def test_stamps_that_jitter_and_a_gap_are_brought_onto_a_grid(raw: Raw) -> None:
    """Loggers are late now and then, and lose half a second; the friction stays."""
    generator = np.random.default_rng(0)
    late = {name: values.copy() for name, values in raw.items()}
    kept = (raw["time"] < 1.0) | (raw["time"] > 1.4)
    late = {name: values[kept] for name, values in late.items()}
    late["quaternion"][::2] *= -1.0  # both signs are the same orientation
    shift = 2e-4 * generator.standard_normal(len(late["time"]))
    late["time"] = late["time"] + shift
    walk = read(late)
    assert any("the longest part without a gap is used" in note for note in walk.notes)
    assert 3.4 < walk.log.time[-1] < 3.7
    np.testing.assert_allclose(np.linalg.norm(walk.log.quaternion, axis=1), 1.0)


def test_too_little_is_refused(raw: Raw) -> None:
    """Half a second is no walk."""
    with pytest.raises(LogError, match="expected at least 1 s"):
        read({name: values[:250] for name, values in raw.items()})
    with pytest.raises(LogError, match="40 samples; expected at least 1 s of a walk"):
        read({name: values[:40] for name, values in raw.items()})
    assert isinstance(trots.opened(trots.GO2, raw), Log)
