"""Simulated logs of whole limbs with known truth, in MuJoCo, many at once; the tests and `tools/limbs.py` use it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from mujoco.batch import Batch
from scipy.signal import lfilter

from stiction.files.log import JointSignals, Log, LogSetup
from stiction.robots.catalog import find_robot
from stiction.robots.mechanism import Mechanism
from stiction.robots.mjcf import build
from stiction.robots.model import Link
from stiction.robots.physics import friction_row

HERE = Path(__file__).parent

STEP = 0.001
"""Step of simulation and control [s]."""

EVERY = 4
"""Control steps between samples of the log."""


@dataclass(frozen=True)
class Limb:
    """A robot whose base is held, and how it is driven."""

    name: str
    robot: str
    """Robot, as `--robot` takes it."""
    centre: tuple[float, ...]
    """Middle of the motion of each joint [rad]."""
    reach: tuple[float, ...]
    """Largest amplitude of each joint [rad]."""


ARM6 = Limb("arm6", str(HERE / "arm6.xml"), (0.0, -0.6, 0.9, 0.3, 0.4, 0.0), (0.7, 0.5, 0.5, 0.8, 0.8, 0.9))
ARM7 = Limb("arm7", str(HERE / "arm7.xml"), (0.0, -0.3, 0.0, -1.5, 0.2, 1.8, 0.3), (0.6, 0.5, 0.6, 0.5, 0.8, 0.7, 0.9))
GO2 = Limb("go2", "go2", (0.0, 0.9, -1.7) * 4, (0.4, 0.6, 0.5) * 4)
LIMBS = (GO2, ARM6, ARM7)


@dataclass(frozen=True)
class Truth:
    """True parameters of a log, J joints."""

    coulomb_friction: np.ndarray
    viscous_friction: np.ndarray
    armature: np.ndarray
    offset: np.ndarray
    torque_limit: np.ndarray


def pendulum() -> Mechanism:
    """Return 2 kg half a metre below a level axis, with 0.1 kg m² about its own centre."""
    link = Link(mass=2.0, com=(0.0, 0.0, -0.5), inertia=(0.1, 0.1, 0.1, 0, 0, 0), axis=(0.0, 1.0, 0.0))
    return Mechanism("pendulum", (link,), ("hinge",), (0.0,), (12.0,), (0.0,))


def compiled(limb: Limb) -> tuple[mujoco.MjModel, list[str], np.ndarray]:
    """Return a model with its base held, nothing to touch, the names of its hinges and their torque limits."""
    if limb.robot.endswith(".xml"):
        spec = mujoco.MjSpec.from_file(limb.robot)
        limits = {joint.name: float(joint.actfrcrange[1]) for joint in spec.joints}
        for joint in [one for one in spec.joints if one.type != mujoco.mjtJoint.mjJNT_HINGE]:
            spec.delete(joint)
    else:
        robot = find_robot(limb.robot)
        spec = build(robot)
        limits = {joint.name: joint.torque_limit for joint in robot.joints}
        for joint in [one for one in spec.joints if one.type == mujoco.mjtJoint.mjJNT_FREE]:
            spec.delete(joint)
        for key in list(spec.keys):
            spec.delete(key)
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    spec.option.timestep = STEP
    # Explicit, so that the torque which is recorded is the torque that acted.
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    off = mujoco.mjtDisableBit
    spec.option.disableflags |= int(off.mjDSBL_CONTACT | off.mjDSBL_LIMIT | off.mjDSBL_EULERDAMP)
    for joint in spec.joints:
        joint.frictionloss, joint.damping, joint.actfrclimited = 1.0, np.array([1.0, 0.0, 0.0]), 0
        joint.solref_friction, joint.solimp_friction = friction_row(STEP)
        actuator = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.gaintype, actuator.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    model = spec.compile()
    names = [model.joint(number).name for number in range(model.njnt)]
    return model, names, np.array([limits[name] for name in names])


def sines(limb: Limb, seconds: float, rng: np.random.Generator) -> np.ndarray:
    """Return targets at the control steps [rad], (steps, J): three sines a joint, none of a common frequency."""
    time = np.arange(round(seconds / STEP)) * STEP
    count = len(limb.centre)
    angles = np.empty((len(time), count))
    for joint in range(count):
        frequencies, phases = rng.uniform(0.15, 1.1, 3), rng.uniform(0, 2 * np.pi, 3)
        shares = rng.dirichlet([2.0, 2.0, 2.0]) * limb.reach[joint]
        angles[:, joint] = limb.centre[joint] + np.sin(2 * np.pi * np.outer(time, frequencies) + phases) @ shares
    return angles


def _correlated(rng: np.random.Generator, shape: tuple[int, ...], memory: float) -> np.ndarray:
    """Return stationary noise of size one whose correlation falls to 1/e in `memory` samples, along axis 0."""
    keep = float(np.exp(-1 / memory))
    start = rng.standard_normal(shape[1:])
    fresh = np.sqrt(1 - keep**2) * rng.standard_normal(shape)
    return lfilter([1.0], [1.0, -keep], fresh, axis=0, zi=keep * start[None])[0]


def draw_truth(model: mujoco.MjModel, limits: np.ndarray, rng: np.random.Generator) -> Truth:
    """Draw the joints of one robot: dry friction of 0.5 to 6 % of the limit."""
    count = len(limits)
    friction = limits * np.exp(rng.uniform(np.log(0.005), np.log(0.06), count))
    return Truth(
        coulomb_friction=friction,
        viscous_friction=friction * rng.uniform(0.1, 1.0, count),
        armature=model.dof_armature * rng.uniform(0.7, 1.3, count),
        offset=0.003 * limits * rng.standard_normal(count),
        torque_limit=limits,
    )


def gains(model: mujoco.MjModel, limb: Limb) -> tuple[np.ndarray, np.ndarray]:
    """Return kp [N m/rad] and kd [N m s/rad] that give each joint alone 6 Hz, damped at 0.8, (J,) each."""
    data = mujoco.MjData(model)
    data.qpos[:] = limb.centre
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    pole = 2 * np.pi * 6.0
    return pole**2 * np.diag(mass), 2 * 0.8 * pole * np.diag(mass)


def limb_logs(
    limb: Limb, seeds: Sequence[int], seconds: float = 12.0, masses: str = "right", noise: float = 1.0
) -> list[tuple[Log, Truth]]:
    """Simulate a log and its truth for each seed, all at once.

    masses: `right`, as the model says; `scattered`, each link 10 % lighter or heavier; `heavy`, all of them 10 %
    heavier than the model says. noise: factor on that of encoder and current sensor; the encoder's acts in the loop.
    """
    model, names, limits = compiled(limb)
    kp, kd = gains(model, limb)
    model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 1], model.actuator_biasprm[:, 2] = kp, -kp, -kd
    rngs = [np.random.default_rng([seed, len(names)]) for seed in seeds]
    truths = [draw_truth(model, limits, rng) for rng in rngs]
    targets = np.stack([sines(limb, seconds, rng) for rng in rngs])
    shape = targets.shape[1:]
    angle = noise * 1e-4 * np.stack([rng.standard_normal(shape) for rng in rngs])
    speed = noise * 0.005 * np.stack([_correlated(rng, shape, 5.0) for rng in rngs])
    batch = Batch(model, len(seeds), 1)
    batch.expand("dof_frictionloss")[:] = [truth.coulomb_friction for truth in truths]
    batch.expand("dof_damping").reshape(len(seeds), len(names), -1)[:, :, 0] = [
        truth.viscous_friction for truth in truths
    ]
    batch.expand("dof_armature")[:] = [truth.armature for truth in truths]
    mass, inertia = batch.expand("body_mass"), batch.expand("body_inertia")
    for row, rng in enumerate(rngs):
        signs = rng.choice([-1.0, 1.0], model.nbody) if masses == "scattered" else np.ones(model.nbody)
        factor = 1.0 if masses == "right" else 1 + 0.1 * signs
        mass[row] *= factor
        inertia[row] *= np.broadcast_to(factor, model.nbody)[:, None]
    batch.set_const()
    batch.reset()
    batch.bind("qpos")[:] = targets[:, 0]
    seen = targets - angle - kd / kp * speed
    made = batch.rollout(shape[0], seen, int(mujoco.mjtState.mjSTATE_CTRL), ("qpos", "actuator_force"))
    # What is recorded after a step is the angle after it and the torque during it.
    position = np.concatenate([targets[:, :1], made["qpos"][:, :-1]], axis=1) + angle
    resolution = 2 * np.pi / 2**16
    position = np.round(position / resolution) * resolution
    torque = made["actuator_force"]
    logs = []
    for row, (rng, truth) in enumerate(zip(rngs, truths)):
        sensed = torque[row] + truth.offset
        sensed += noise * 0.003 * limits * (rng.standard_normal(shape) + _correlated(rng, shape, 20.0))
        logs.append((_log(limb, names, targets[row], position[row], sensed, limits), truth))
    return logs


def _log(
    limb: Limb, names: list[str], target: np.ndarray, position: np.ndarray, torque: np.ndarray, limits: np.ndarray
) -> Log:
    """Return every fourth sample as a log."""
    time = np.arange(len(target))[::EVERY] * STEP
    joints = {
        name: JointSignals(position=position[::EVERY, j], target=target[::EVERY, j], torque=torque[::EVERY, j])
        for j, name in enumerate(names)
    }
    own = {name: LogSetup(torque_limit=float(limit)) for name, limit in zip(names, limits)}
    return Log(limb.name, time, joints, LogSetup(torque_source="motor_side", joints=own))
