"""All joints of a limb in one regression: friction and armature of each, and by how much the model of the links errs.

    τ_j = Σ_i (Y_ij + Σ_k ε_ik ∂Y_ij) − δ τ_j' + A_j θ_j'' + B_j θ_j' + f_j sign(θ_j') + c_j

for every joint j; Y_ij is what link i asks of it, ∂Y its change by error k of the link (`dynamics.MODES`), δ how late
the torque is logged. ε and δ are known beforehand to be zero within their standard deviations (Gaussian priors); A, B,
f and c are not known at all. Each joint's equations are weighted by the size of its residual and by how long that
remembers: n residuals that remember for κ samples tell as much against the prior as n/κ that do not.

The covariance admits both: the scatter of blocks of the log, by a delete-one-block jackknife, which is not too small
where parameters are as many as blocks, and the prior's own, of errors that are the same throughout the log.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.stats import t as student

from stiction.core.linear import check_condition
from stiction.files.joints import Estimate
from stiction.identification.combinations import shifted
from stiction.identification.intervals import (
    SMALLEST_RESIDUAL,
    block_count,
    correlation_time,
    jackknife_covariance,
    make_blocks,
)
from stiction.identification.limb.dynamics import MODES, link_torques
from stiction.identification.limb.setup import LimbSetup
from stiction.identification.limb.signals import JointRun, LimbRun

OWN = ("armature", "viscous_friction", "coulomb_friction", "offset")
"""Parameters of each joint."""

LATENESS = "lateness"
"""How late the torque is logged [s]."""

SCALE = "torque_scale"
"""Logged torque over what the links, as heavy as the model says, and the joints ask for, less 1 [1]."""

ROUNDS = 4
"""Weights follow from residuals and residuals from the fit: both settle in three."""


@dataclass(frozen=True)
class JointRows:
    """The equations of one joint, R rows of P parameters."""

    joint: JointRun
    torque: np.ndarray
    """Motor's torque less that of the links by the model [N m], (R,)."""
    regressor: np.ndarray
    """(R, P)."""
    time: np.ndarray
    """[s], (R,)."""
    link_inertia: float
    """Inertia of the links about the joint, by the model, the others held in mid-motion [kg m²]."""


@dataclass(frozen=True)
class LimbFit:
    """A fit of P parameters to the rows of all joints."""

    names: tuple[str, ...]
    """`coulomb_friction.NAME` and so on for the joints' own, `mass.LINK` for errors of links, `lateness`."""
    values: np.ndarray
    """(P,)."""
    covariance: np.ndarray
    """(P, P)."""
    reach: float
    """Half-width of a 95 % interval in standard deviations."""
    prior: np.ndarray
    """Standard deviation of each parameter about zero beforehand, infinite where nothing is known, (P,)."""
    rows: tuple[JointRows, ...]
    """What it was fitted to, joint by joint."""
    blocks: int
    """Blocks of the log behind the covariance."""

    @cached_property
    def index(self) -> dict[str, int]:
        """Number of each parameter."""
        return {name: number for number, name in enumerate(self.names)}

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of the errors of links, `mass.JOINT` of the link that the joint moves."""
        return tuple(name for name in self.names if name.partition(".")[0] in MODES)

    @property
    def of_links(self) -> np.ndarray:
        """Which parameters are errors of links, bool, (P,)."""
        return np.isin(self.names, self.link_names)

    def residual(self, rows: JointRows) -> np.ndarray:
        """Return what is left of one joint's torque [N m], (R,)."""
        return rows.torque - rows.regressor @ self.values

    def estimate(self, name: str) -> Estimate:
        """Return one parameter."""
        number = self.index[name]
        value, std = float(self.values[number]), float(np.sqrt(self.covariance[number, number]))
        return Estimate(value, std, (value - self.reach * std, value + self.reach * std))

    def own(self, rows: JointRows) -> dict[str, Estimate]:
        """Return a joint's own parameters; the armature's interval admits what noise of the acceleration takes off."""
        found = {name: self.estimate(f"{name}.{rows.joint.run.joint}") for name in OWN}
        rotor = found[OWN[0]]
        more = rows.joint.run.prepared.attenuation * (abs(rotor.value) + rows.link_inertia)
        low, high = rotor.interval95
        found[OWN[0]] = Estimate(rotor.value, float(np.hypot(rotor.std, more / 2)), (low, high + more))
        return found

    def inflation(self, rows: JointRows) -> dict[str, float]:
        """Return the norm of each of a joint's own columns over that of its part orthogonal to its other own ones.

        Errors of the links, which a prior bounds, cannot hide a parameter: its interval admits them.
        """
        own = [self.index[f"{name}.{rows.joint.run.joint}"] for name in OWN]
        scaled = rows.regressor[:, own] / np.linalg.norm(rows.regressor[:, own], axis=0).clip(1e-300)
        _, sizes, directions = np.linalg.svd(np.linalg.qr(scaled, mode="r"))
        lengths = np.linalg.norm(directions / sizes.clip(1e-12)[:, None], axis=0)
        return dict(zip(OWN, lengths.tolist()))


def limb_rows(run: LimbRun, setup: LimbSetup) -> tuple[tuple[str, ...], np.ndarray, tuple[JointRows, ...]]:
    """Return names of the parameters, their priors, (P,), and the equations of each joint."""
    # The links' torques depend on all joints, so they are computed once, at every sample that any joint uses.
    used = np.unique(np.concatenate([joint.run.prepared.used for joint in run.joints]))
    links = link_torques(run.mechanism, run.position[used], run.velocity[used], run.acceleration[used])
    moved = sorted({joint.number for joint in run.joints})
    relevant = [
        (number, mode)
        for number in range(run.mechanism.num_joints)
        for mode in range(len(MODES))
        if np.any(links.modes[number, mode][:, moved])
    ]
    errors = [f"{MODES[mode]}.{run.mechanism.joint_names[number]}" for number, mode in relevant]
    own = [f"{name}.{joint.run.joint}" for joint in run.joints for name in OWN]
    step = run.joints[0].run.prepared.step
    prior = np.array([np.inf] * len(own) + [setup.model_error] * len(errors) + [setup.timing_error * step])
    rows, inertia = [], _link_inertia(run)
    for place, joint in enumerate(run.joints):
        prepared, mine = joint.run.prepared, joint.run.prepared.used
        place_of = np.searchsorted(used, mine)
        regressor = np.zeros((len(mine), len(prior)))
        signals = (prepared.acceleration, prepared.velocity, prepared.direction, np.ones_like(prepared.torque))
        for column, signal in enumerate(signals):
            regressor[:, len(OWN) * place + column] = signal[mine]
        for column, (number, mode) in enumerate(relevant, len(own)):
            regressor[:, column] = links.modes[number, mode][place_of, joint.number]
        regressor[:, -1] = -np.gradient(prepared.torque - prepared.outside, prepared.step)[mine]
        torque = prepared.torque[mine] - links.nominal[place_of, joint.number]
        rows.append(JointRows(joint, torque, regressor, prepared.time[mine], float(inertia[joint.number])))
    return (*own, *errors, LATENESS), prior, tuple(rows)


def fit_scale(names: tuple[str, ...], prior: np.ndarray, rows: tuple[JointRows, ...]) -> Estimate:
    """Return what the logged torques are over what the links' masses say, as they are known [1].

    All links heavier by one share and all torques larger by it are the same; a single link is only as well known as
    `prior` has it. Raises `numpy.linalg.LinAlgError` as `fit_limb`.
    """
    scaled = []
    for one in rows:
        prepared = one.joint.run.prepared
        # What the links ask for by the model is what was taken off the motor's torque.
        links = prepared.torque[prepared.used] - one.torque
        scaled.append(replace(one, regressor=np.hstack([one.regressor, links[:, None]])))
    found = fit_limb((*names, SCALE), np.append(prior, np.inf), tuple(scaled)).estimate(SCALE)
    return shifted(found, 1.0)


def _link_inertia(run: LimbRun) -> np.ndarray:
    """Return the inertia of the links about each joint in the middle of the motion [kg m²], shape (J,)."""
    each = np.eye(run.mechanism.num_joints)
    middle = np.tile(np.median(run.position, axis=0), (len(each), 1))
    # Each joint in turn is accelerated by 1 rad/s², and none: weight is in both, and drops out.
    moved, held = (link_torques(run.mechanism, middle, 0 * each, one).nominal for one in (each, 0 * each))
    return (moved - held).diagonal()


def fit_limb(names: tuple[str, ...], prior: np.ndarray, rows: tuple[JointRows, ...]) -> LimbFit:
    """Fit all joints at once. Raises `numpy.linalg.LinAlgError` where a joint's own parameters cannot be told apart."""
    knowledge = np.where(np.isfinite(prior), 1 / prior**2, 0.0)
    floor = [SMALLEST_RESIDUAL * float(np.sqrt(np.mean(one.joint.run.prepared.torque**2))) for one in rows]
    weight = np.ones(len(rows))
    values, residuals = np.zeros(len(prior)), [one.torque for one in rows]
    for number in range(ROUNDS):
        # The first round has no residuals yet, and weighs all joints alike.
        if number:
            sizes = np.maximum([float(np.sqrt(np.mean(one**2))) for one in residuals], floor)
            weight = 1 / (sizes * np.sqrt([correlation_time(one) for one in residuals]))
        scaled = np.concatenate([factor * one.regressor for factor, one in zip(weight, rows)])
        target = np.concatenate([factor * one.torque for factor, one in zip(weight, rows)])
        # Columns of unit length: accelerations and signs differ by orders of magnitude, which normal equations square.
        length = np.linalg.norm(scaled, axis=0).clip(1e-300)
        gram = (scaled / length).T @ (scaled / length) + np.diag(knowledge / length**2)
        check_condition(gram)
        values = np.linalg.solve(gram, (scaled / length).T @ target) / length
        residuals = [one.torque - one.regressor @ values for one in rows]
    count = min(block_count(one) for one in residuals)
    # Blocks are spans of time for all joints together, for their residuals have their causes in common.
    span = max(float(one.joint.run.prepared.time[-1]) for one in rows) + 1e-9
    block = np.concatenate([(one.time / span * count).astype(int) for one in rows])
    blocks = make_blocks(scaled / length, target - scaled @ values, block)
    covariance = jackknife_covariance(blocks, knowledge / length**2) / np.outer(length, length)
    return LimbFit(
        names=names,
        values=values,
        covariance=covariance,
        reach=float(student.ppf(0.975, blocks.count - 1)),
        prior=prior,
        rows=rows,
        blocks=blocks.count,
    )
