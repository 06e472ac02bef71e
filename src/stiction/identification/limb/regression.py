"""Regression of all joints of a limb at once: friction and armature of each, and errors of the links' model.

    τ_j = Σ_i (Y_ij + Σ_k ε_ik ∂Y_ij) − δ τ_j' + A_j θ_j'' + B_j θ_j' + f_j sign(θ_j') + c_j

for every joint j; Y_ij is its torque for link i, ∂Y its change by error k of the link (`dynamics.MODES`), δ how late
the torque is logged. ε and δ are known beforehand to be zero within their standard deviations (Gaussian priors); A, B,
f and c are not known at all. Each joint's equations are weighted by the size of its residual and by the length of its
memory: n residuals that remember for κ samples tell as much against the prior as n/κ that do not.

The covariance (`fit`) admits both: the scatter of blocks of the log, which is not too small where parameters are as
many as blocks, and the prior's own, of errors that are the same throughout the log.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stiction.files.joints import Estimate
from stiction.identification.combinations import shifted
from stiction.identification.intervals import SMALLEST_RESIDUAL, block_count, correlation_time
from stiction.identification.limb.dynamics import MODES, joint_inertia, link_torques
from stiction.identification.limb.fit import PriorFit, fit_blocks, solve
from stiction.identification.limb.signals import LimbRun
from stiction.identification.runs import Run
from stiction.identification.setup import LimbSetup

JOINT_PARAMETERS = ("armature", "viscous_friction", "coulomb_friction", "offset")
"""Parameters of each joint, `coulomb_friction.NAME` and so on in a fit; `mass.NAME` is the error of the link that the
joint moves."""

LATENESS = "lateness"
"""Lateness of the logged torque [s]."""

SCALE = "torque_scale"
"""Logged torque over that of the joints and of links as heavy as the model says, less 1 [1]."""

ROUNDS = 4
"""Rounds of weighting: weights follow from residuals and residuals from the fit; both settle in three."""


@dataclass(frozen=True)
class JointRows:
    """Equations of one joint, R rows of P parameters, at the samples of `run.rows`."""

    number: int
    """Number of the joint in the mechanism."""
    run: Run
    """Log of the joint."""
    torque: np.ndarray
    """Motor's torque less that of the links by the model [N m], (R,)."""
    regressor: np.ndarray
    """Regressor, (R, P)."""
    link_inertia: float
    """Inertia of the links about the joint, by the model, the others held in mid-motion [kg m²]."""

    def residual(self, fit: PriorFit) -> np.ndarray:
        """Return the residual torque of a fit [N m], (R,)."""
        return self.torque - self.regressor @ fit.values

    def estimates(self, fit: PriorFit) -> dict[str, Estimate]:
        """Return the joint's parameters; the armature's interval admits its bias by noise of the acceleration.

        Noise in a regressor draws its coefficient towards zero, so that the truth can only lie further up.
        """
        parameters = {name: fit.estimate(f"{name}.{self.run.joint}") for name in JOINT_PARAMETERS}
        rotor = parameters["armature"]
        more = self.run.prepared.attenuation * (abs(rotor.value) + self.link_inertia)
        ends = (rotor.interval95[0], rotor.interval95[1] + more)
        return parameters | {"armature": Estimate(rotor.value, float(np.hypot(rotor.std, more / 2)), ends)}


@dataclass(frozen=True)
class LimbRows:
    """Equations of all joints that can be identified."""

    names: tuple[str, ...]
    """Names of the P parameters: those of `JOINT_PARAMETERS` of each joint, errors of links, `LATENESS`."""
    prior: np.ndarray
    """Standard deviation of each prior about zero, infinite where nothing is known, (P,)."""
    joints: tuple[JointRows, ...]
    """Equations of each joint."""

    @property
    def of_links(self) -> np.ndarray:
        """Mask of the parameters that are errors of links, bool, (P,)."""
        return np.isin([name.partition(".")[0] for name in self.names], MODES)


def limb_rows(limb: LimbRun, setup: LimbSetup) -> LimbRows:
    """Return the equations of a limb."""
    names, moved = limb.mechanism.joint_names, list(limb.runs)
    # The links' torques depend on all joints, so they are computed once, at every sample that any joint uses.
    used = np.unique(np.concatenate([run.prepared.used for run in limb.runs.values()]))
    motion = (signal[used] for signal in (limb.position, limb.velocity, limb.acceleration))
    links = np.stack(list(link_torques(limb.mechanism, *motion)))
    nominal = links[:, 0].sum(axis=0)
    shown = np.argwhere(links[..., moved].any(axis=(2, 3))).tolist()
    of_joints = [f"{name}.{run.joint}" for run in limb.runs.values() for name in JOINT_PARAMETERS]
    errors = [f"{MODES[mode]}.{names[link]}" for link, mode in shown]
    step = limb.runs[moved[0]].prepared.step
    prior = np.array([np.inf] * len(of_joints) + [setup.model_error] * len(errors) + [setup.timing_error * step])
    inertia = joint_inertia(limb.mechanism.links, np.median(limb.position, axis=0))
    joints = []
    for place, (number, run) in enumerate(limb.runs.items()):
        prepared, rows = run.prepared, run.rows
        place_of = np.searchsorted(used, prepared.used)
        regressor = np.zeros((len(rows), len(prior)))
        signals = (rows.acceleration, rows.velocity, rows.direction, np.ones(len(rows)))
        regressor[:, len(JOINT_PARAMETERS) * place : len(JOINT_PARAMETERS) * (place + 1)] = np.stack(signals, axis=1)
        for column, (link, mode) in enumerate(shown, len(of_joints)):
            regressor[:, column] = links[link, mode, place_of, number]
        regressor[:, -1] = -np.gradient(prepared.torque - prepared.outside, prepared.step)[prepared.used]
        torque = prepared.torque[prepared.used] - nominal[place_of, number]
        joints.append(JointRows(number, run, torque, regressor, float(inertia[number])))
    return LimbRows((*of_joints, *errors, LATENESS), prior, tuple(joints))


def fit_limb(rows: LimbRows) -> PriorFit:
    """Fit all joints at once. Raises `numpy.linalg.LinAlgError` where a joint's own parameters cannot be told apart."""
    joints = rows.joints
    floor = [SMALLEST_RESIDUAL * float(np.sqrt(np.mean(joint.run.prepared.torque**2))) for joint in joints]
    weight = np.ones(len(joints))
    # The first round has no residuals yet, and weighs all joints alike.
    for _ in range(ROUNDS):
        regressor = np.concatenate([factor * joint.regressor for factor, joint in zip(weight, joints)])
        torque = np.concatenate([factor * joint.torque for factor, joint in zip(weight, joints)])
        values = solve(regressor, torque, rows.prior)
        residuals = [joint.torque - joint.regressor @ values for joint in joints]
        sizes = np.maximum([float(np.sqrt(np.mean(residual**2))) for residual in residuals], floor)
        weight = 1 / (sizes * np.sqrt([correlation_time(residual) for residual in residuals]))
    # Blocks are spans of time for all joints together, for their residuals have their causes in common.
    count = min(block_count(residual) for residual in residuals)
    span = max(float(joint.run.prepared.time[-1]) for joint in joints) + 1e-9
    block = np.concatenate([(joint.run.rows.time / span * count).astype(int) for joint in joints])
    return fit_blocks(rows.names, regressor, torque, block, rows.prior, size=1.0)


def fit_scale(rows: LimbRows) -> Estimate:
    """Return the logged torques over those that the links' masses require, as far as these are known [1].

    All links heavier by one share and all torques larger by it are the same; a single link is only as well known as
    its prior has it. Raises `numpy.linalg.LinAlgError` where no joint bears any weight, as with upright axes.
    """
    scaled = []
    for joint in rows.joints:
        # What the links ask for by the model is what was taken off the motor's torque.
        links = joint.run.prepared.torque[joint.run.prepared.used] - joint.torque
        scaled.append(replace(joint, regressor=np.column_stack([joint.regressor, links])))
    scale = fit_limb(LimbRows((*rows.names, SCALE), np.append(rows.prior, np.inf), tuple(scaled))).estimate(SCALE)
    return shifted(scale, 1.0)
