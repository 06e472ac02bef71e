"""All joints of a limb in one regression: friction and armature of each, and by how much the model of the links errs.

    τ_j = Σ_i (Y_ij + Σ_k ε_ik ∂Y_ij) − δ τ_j' + A_j θ_j'' + B_j θ_j' + f_j sign(θ_j') + c_j

for every joint j; Y_ij is what link i asks of it, ∂Y its change by error k of the link (`dynamics.MODES`), δ how late
the torque is logged. ε and δ are known beforehand to be zero within their standard deviations (Gaussian priors); A, B,
f and c are not known at all. Each joint's equations are weighted by the size of its residual and by how long that
remembers: n residuals that remember for κ samples tell as much against the prior as n/κ that do not.

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

OWN = ("armature", "viscous_friction", "coulomb_friction", "offset")
"""Parameters of each joint, `coulomb_friction.NAME` and so on in a fit; `mass.NAME` is the error of the link that the
joint moves."""

LATENESS = "lateness"
"""How late the torque is logged [s]."""

SCALE = "torque_scale"
"""Logged torque over what the links, as heavy as the model says, and the joints ask for, less 1 [1]."""

ROUNDS = 4
"""Weights follow from residuals and residuals from the fit: both settle in three."""


@dataclass(frozen=True)
class JointRows:
    """The equations of one joint, R rows of P parameters, at the samples of `run.rows`."""

    number: int
    """Number of the joint in the mechanism."""
    run: Run
    """The joint's own log."""
    torque: np.ndarray
    """Motor's torque less that of the links by the model [N m], (R,)."""
    regressor: np.ndarray
    """(R, P)."""
    link_inertia: float
    """Inertia of the links about the joint, by the model, the others held in mid-motion [kg m²]."""

    def residual(self, fit: PriorFit) -> np.ndarray:
        """Return what a fit leaves of the torque [N m], (R,)."""
        return self.torque - self.regressor @ fit.values

    def own(self, fit: PriorFit) -> dict[str, Estimate]:
        """Return the joint's own parameters; the armature's interval admits what noise of the acceleration takes off.

        Noise in a regressor draws its coefficient towards zero, so that the truth can only lie further up.
        """
        found = {name: fit.estimate(f"{name}.{self.run.joint}") for name in OWN}
        rotor = found["armature"]
        more = self.run.prepared.attenuation * (abs(rotor.value) + self.link_inertia)
        ends = (rotor.interval95[0], rotor.interval95[1] + more)
        return found | {"armature": Estimate(rotor.value, float(np.hypot(rotor.std, more / 2)), ends)}


@dataclass(frozen=True)
class LimbRows:
    """The equations of all joints that can be identified."""

    names: tuple[str, ...]
    """The P parameters: those of `OWN` of each joint, errors of links, `LATENESS`."""
    prior: np.ndarray
    """Standard deviation of each about zero beforehand, infinite where nothing is known, (P,)."""
    joints: tuple[JointRows, ...]
    """Joint by joint."""

    @property
    def of_links(self) -> np.ndarray:
        """Which parameters are errors of links, bool, (P,)."""
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
    own = [f"{name}.{run.joint}" for run in limb.runs.values() for name in OWN]
    errors = [f"{MODES[mode]}.{names[link]}" for link, mode in shown]
    step = limb.runs[moved[0]].prepared.step
    prior = np.array([np.inf] * len(own) + [setup.model_error] * len(errors) + [setup.timing_error * step])
    inertia = joint_inertia(limb.mechanism.links, np.median(limb.position, axis=0))
    joints = []
    for place, (number, run) in enumerate(limb.runs.items()):
        prepared, rows = run.prepared, run.rows
        place_of = np.searchsorted(used, prepared.used)
        regressor = np.zeros((len(rows), len(prior)))
        signals = (rows.acceleration, rows.velocity, rows.direction, np.ones(len(rows)))
        regressor[:, len(OWN) * place : len(OWN) * (place + 1)] = np.stack(signals, axis=1)
        for column, (link, mode) in enumerate(shown, len(own)):
            regressor[:, column] = links[link, mode, place_of, number]
        regressor[:, -1] = -np.gradient(prepared.torque - prepared.outside, prepared.step)[prepared.used]
        torque = prepared.torque[prepared.used] - nominal[place_of, number]
        joints.append(JointRows(number, run, torque, regressor, float(inertia[number])))
    return LimbRows((*own, *errors, LATENESS), prior, tuple(joints))


def fit_limb(rows: LimbRows) -> PriorFit:
    """Fit all joints at once. Raises `numpy.linalg.LinAlgError` where a joint's own parameters cannot be told apart."""
    joints = rows.joints
    floor = [SMALLEST_RESIDUAL * float(np.sqrt(np.mean(one.run.prepared.torque**2))) for one in joints]
    weight = np.ones(len(joints))
    # The first round has no residuals yet, and weighs all joints alike.
    for _ in range(ROUNDS):
        regressor = np.concatenate([factor * one.regressor for factor, one in zip(weight, joints)])
        torque = np.concatenate([factor * one.torque for factor, one in zip(weight, joints)])
        values = solve(regressor, torque, rows.prior)
        residuals = [one.torque - one.regressor @ values for one in joints]
        sizes = np.maximum([float(np.sqrt(np.mean(one**2))) for one in residuals], floor)
        weight = 1 / (sizes * np.sqrt([correlation_time(one) for one in residuals]))
    # Blocks are spans of time for all joints together, for their residuals have their causes in common.
    count = min(block_count(one) for one in residuals)
    span = max(float(one.run.prepared.time[-1]) for one in joints) + 1e-9
    block = np.concatenate([(one.run.rows.time / span * count).astype(int) for one in joints])
    return fit_blocks(rows.names, regressor, torque, block, rows.prior, size=1.0)


def fit_scale(rows: LimbRows) -> Estimate:
    """Return what the logged torques are over what the links' masses say, as they are known [1].

    All links heavier by one share and all torques larger by it are the same; a single link is only as well known as
    its prior has it. Raises `numpy.linalg.LinAlgError` where no joint bears any weight, as with upright axes.
    """
    scaled = []
    for one in rows.joints:
        # What the links ask for by the model is what was taken off the motor's torque.
        links = one.run.prepared.torque[one.run.prepared.used] - one.torque
        scaled.append(replace(one, regressor=np.column_stack([one.regressor, links])))
    found = fit_limb(LimbRows((*rows.names, SCALE), np.append(rows.prior, np.inf), tuple(scaled))).estimate(SCALE)
    return shifted(found, 1.0)
