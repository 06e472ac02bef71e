"""MuJoCo's sysid toolbox as an estimator: least squares on a model of one joint under its position controller."""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from typing import Any

import mujoco
import numpy as np

from stiction.core.errors import StictionError
from stiction.identification.model import Model
from stiction.identification.reading import Reading
from stiction_experiments.peers.judge import Fitted, meant_joint
from stiction_experiments.peers.plain import GRAVITY, LATEST, NAMES
from stiction_experiments.peers.records import Problem

INSTALL = "pip install 'mujoco[sysid]'"
"""Command that installs the toolbox."""

FINEST = 1e-3
"""Longest step of MuJoCo's simulation [s]."""

STIFF_SOLREF, STIFF_SOLIMP = 2.0, (0.999, 0.9999, 0.001, 0.5, 2.0)
"""Time constant of the friction constraint in steps, and its impedance: MuJoCo's defaults let a stuck joint creep."""

HEAVY = 1000.0
"""Mass of a link with weight [kg]: its centre is so close to the axis that its weight brings no inertia."""

MOST_ITERATIONS = 60
"""Iterations of the toolbox's optimiser."""

LARGEST = 20.0
"""Largest multiple of its unit that inertia or friction may become; the inverse is the least inertia."""

SEARCH = {"x_scale": "jac", "diff_step": 1e-5, "ftol": 1e-6, "xtol": 1e-6, "gtol": None}
"""Settings of the toolbox's optimiser, which is SciPy's. Residuals of micrometres have small gradients everywhere."""

GRAVITY_PULL = 9.81
"""Acceleration of gravity in MuJoCo's default world [m/s²]."""


def joint_spec(problem: Problem) -> mujoco.MjSpec:
    """Return a model of the joint under its controller, at 1 kg m² without friction."""
    spec = mujoco.MjSpec()
    step = problem.step / max(1, int(np.ceil(problem.step / FINEST - 1e-9)))
    spec.option.timestep, spec.option.integrator = step, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.iterations, spec.option.ls_iterations, spec.option.tolerance = 100, 50, 1e-12
    body = spec.worldbody.add_body(name="link", mass=HEAVY, inertia=[1.0] * 3, explicitinertial=True)
    kind = mujoco.mjtJoint.mjJNT_HINGE if problem.gravity else mujoco.mjtJoint.mjJNT_SLIDE
    # A hinge about y: gravity acts along −z. A slide along x, where it does not.
    axis = [0.0, 1.0, 0.0] if problem.gravity else [1.0, 0.0, 0.0]
    joint = body.add_joint(name="joint", type=kind, axis=axis)
    joint.solref_friction, joint.solimp_friction = (STIFF_SOLREF * step, 1.0), STIFF_SOLIMP
    actuator = spec.add_actuator(name="target", target="joint", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.gaintype, actuator.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    actuator.gainprm[0], actuator.biasprm[:3] = problem.kp, (0.0, -problem.kp, -problem.kd)
    if np.isfinite(problem.limit):
        actuator.forcelimited, actuator.forcerange = 1, (-problem.limit, problem.limit)
    spec.add_sensor(
        name="angle", type=mujoco.mjtSensor.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname="joint"
    )
    return spec


def build(spec: mujoco.MjSpec, values: dict[str, float]) -> mujoco.MjModel:
    """Return the model with the parameters of a joint.

    Its inertia is the body's and no armature, by which MuJoCo does not scale the constraint of friction. The weight's
    torque about y is m g (x cos θ + z sin θ) with its centre at (x, 0, z), and the motor holds against it.
    """
    joint, body = spec.joint("joint"), spec.body("link")
    inertia, joint.damping[0], joint.frictionloss = (values[name] for name in NAMES[:3])
    body.inertia = [inertia] * 3
    spec.actuator("target").biasprm[0] = -values["offset"]
    if GRAVITY[0] in values:
        along, across = (-values[name] / (HEAVY * GRAVITY_PULL) for name in GRAVITY)
        body.ipos = (across, 0.0, along)
    else:
        body.mass = inertia
    return spec.compile()


def units(problem: Problem, start: dict[str, float]) -> dict[str, float]:
    """Return a unit of each parameter in which its search begins near one."""
    torque = max(start["coulomb_friction"], 1e-3 * problem.kp * float(np.ptp(problem.position)))
    small = 1e-3 * start["inertia"]
    rotor, viscous = start["inertia"], max(start["viscous_friction"], small)
    names = (*NAMES, *GRAVITY) if problem.gravity else NAMES
    return {name: {"inertia": rotor, "viscous_friction": viscous}.get(name, torque) for name in names}


def fit_sysid(problem: Problem, textbook: Fitted) -> Fitted:
    """Return viscous and Coulomb friction and the lateness of the target, by the toolbox's own optimiser.

    textbook: the regression, where the search begins. Raises `StictionError` where the toolbox is not installed.
    """
    from mujoco import sysid

    if not hasattr(sysid, "optimize"):
        raise StictionError(f"MuJoCo's sysid is not installed; {INSTALL}")
    assert textbook.values is not None
    start = dict(textbook.values) | {"inertia": abs(textbook.values["inertia"])}
    scale, spec = units(problem, start), joint_spec(problem)
    tick = spec.option.timestep

    def physical(params: Any) -> dict[str, float]:
        return {name: scale[name] * float(params[name].value[0]) for name in scale}

    params = sysid.ParameterDict()
    for name in scale:
        begin = start[name] / scale[name]
        low, high = begin - LARGEST, begin + LARGEST
        if name in NAMES[:3]:
            low, high = (1 / LARGEST if name == "inertia" else 0.0), LARGEST
        params.add(sysid.Parameter(name, min(max(begin, low + 1e-3), high), low, high))
    params.add(sysid.Parameter("delay", 0.0, -2 * tick, LATEST * problem.step))
    params.move_off_bounds()
    transform = sysid.SignalTransform()
    transform.delay("angle", params["delay"])
    model = build(spec, physical(params))
    measured = sysid.TimeSeries.from_names(problem.time, problem.position[:, None], model)
    state = sysid.create_initial_state(model, problem.position[:1], np.array([problem.speed]))
    control = sysid.TimeSeries(problem.time, problem.target[:, None])
    residual = sysid.build_residual_fn(
        models_sequences=[sysid.ModelSequences("joint", spec, "first part", state, control, measured)],
        build_model=lambda params, spec: build(spec, physical(params)),
        modify_residual=transform.apply,
        n_threads=1,
    )
    # The optimiser cannot be told to be quiet.
    with redirect_stdout(io.StringIO()):
        best, _ = sysid.optimize(params, residual, "scipy", verbose=False, max_iters=MOST_ITERATIONS, **SEARCH)
    # The toolbox stamps what a sensor said before a step with the time after it.
    values, delay = physical(best), float(best["delay"].value[0]) + tick

    def predict(other: Problem) -> np.ndarray:
        return follow(other, values, delay)

    meant = meant_joint(values, problem, delay)
    return Fitted("coulomb", meant, Model("coulomb", problem.gravity), Reading(delay=delay), predict)


def follow(problem: Problem, values: dict[str, float], delay: float) -> np.ndarray:
    """Return the position of a joint in MuJoCo as the toolbox sees it, late by a delay [rad, or m], shape (T,)."""
    from mujoco import rollout, sysid

    model = build(joint_spec(problem), values)
    times = np.arange(round(problem.time[-1] / model.opt.timestep)) * model.opt.timestep
    state = sysid.create_initial_state(model, problem.position[:1], np.array([problem.speed]))
    states, _ = rollout.rollout(model, mujoco.MjData(model), state, problem.targets(times)[:, None])
    position = np.concatenate([problem.position[:1], states[0, :, 1]])
    moments = np.arange(len(position)) * model.opt.timestep
    return np.interp(problem.time - delay, moments, position)
