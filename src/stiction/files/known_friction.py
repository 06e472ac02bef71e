"""Known friction, which some policies observe: f/τ_max of each kind of joint in motion, identified on a bench.

`FL_shank` and `RR_shank` are of one kind, and equal by design. There is one number per kind: the log of one leg gives
it, and a robot's joints differ from it as they do in training.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stiction.core.errors import FileError
from stiction.files.joints import JointRecord, JointsFile

TERM = "known_friction"


def kind_average(kinds: Sequence[str]) -> np.ndarray:
    """Return the matrix that averages over the joints of a kind, shape (joints, kinds): values @ matrix.

    kinds: of each joint; columns are in the order of their first joint.
    """
    member = np.array(
        [[kind_of_joint == kind for kind in dict.fromkeys(kinds)] for kind_of_joint in kinds], dtype=np.float64
    )
    return member / member.sum(axis=0)


@dataclass(frozen=True)
class BenchFriction:
    """Friction of each kind of joint, identified on a bench."""

    share: dict[str, float]
    """Kind of joint -> f/τ_max [-]."""
    missing: tuple[str, ...]
    """Joints whose friction was not identified."""
    notes: tuple[str, ...]
    """Substitutes used for them, in words."""
    joints: dict[str, float]
    """Joint -> f/τ_max: its own, else that of its kind [-]."""

    @property
    def array(self) -> np.ndarray:
        """`share` as an array [-], shape (kinds,), in the order of the joints."""
        return np.array(list(self.share.values()))


def bench_friction(
    file: JointsFile, joint_names: Sequence[str], kinds: Sequence[str], torque_limit: np.ndarray, nominal: np.ndarray
) -> BenchFriction:
    """Return the identified mean f/τ_max of each kind of joint; negative values become zero.

    A record is for the joint of its name, or for all of its kind. Where a joint has none, its friction is null, or its
    fit is not valid, the mean of that kind's other joints is used; without any of a kind, the nominal friction of
    training.

    file: the `joints.json`; joint_names: the robot's, in its order; kinds: of each joint; torque_limit: of each joint
    [N m], shape (joints,); nominal: f/τ_max of each kind in training, shape (kinds,). Raises `StictionError`: a joint
    was identified as a linear axis.
    """
    shares: dict[str, list[float]] = {kind: [] for kind in kinds}
    own: dict[str, float] = {}
    missing: dict[str, list[str]] = {kind: [] for kind in shares}
    keys = {name: file.key(name, kind) for name, kind in zip(joint_names, kinds, strict=True)}
    for name, kind, limit in zip(joint_names, kinds, torque_limit, strict=True):
        share = None if (key := keys[name]) is None else _share(name, file.joints[key], float(limit))
        if share is None:
            missing[kind].append(name)
        else:
            shares[kind].append(share)
            own[name] = share
    held = [name for name, key in keys.items() if key is not None and file.joints[key].holding_friction is not None]
    values, notes = {}, [f"{', '.join(held)}: friction in motion is taken, and more holds at rest"] if held else []
    for (kind, known), other in zip(shares.items(), nominal, strict=True):
        values[kind] = float(np.mean(known)) if known else float(other)
        if missing[kind]:
            instead = "the mean of the other joints of the kind" if known else "the nominal friction of training"
            names = ", ".join(missing[kind])
            notes.append(
                f"the friction of {names} was not identified: {instead} is taken, {100 * values[kind]:.3g} % of the "
                "torque limit"
            )
    joints = {name: own.get(name, values[kind]) for name, kind in zip(joint_names, kinds, strict=True)}
    return BenchFriction(values, tuple(name for names in missing.values() for name in names), tuple(notes), joints)


def _share(name: str, record: JointRecord, limit: float) -> float | None:
    """Return f/τ_max in motion of a joint with the torque limit `limit` [N m]; None if unknown or not valid."""
    if record.axis != "rotary":
        raise FileError(f"joint {name!r} was identified as a linear axis (kg, N); expected a rotary one")
    if record.objection_to("coulomb_friction") is not None:
        return None
    if record.coulomb_friction is not None:
        return max(0.0, record.coulomb_friction.value) / limit
    share = record.dynamic_ratio or record.friction_ratio
    return None if share is None else max(0.0, share.value)


def known_friction_text(shares: Mapping[str, float]) -> str:
    """Return known friction in words: `hip 1 %, thigh 2 % of the torque limit`."""
    return f"{', '.join(f'{kind} {100 * share:.3g} %' for kind, share in shares.items())} of the torque limit"
