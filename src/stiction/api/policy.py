"""Policies: shipped ones by name, one's own from a bundle, always checked first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from stiction.api.options import public
from stiction.api.result import Result, html_table
from stiction.core.errors import PolicyError
from stiction.deploy.check import BundleCheck, check_bundle, read_allowed
from stiction.deploy.policy import Network, Policy
from stiction.deploy.policy import load_policy as open_policy
from stiction.deploy.robot_policy import RobotPolicy
from stiction.files.bundle import Bundle, find_bundle, shipped_bundles
from stiction.files.contract import Contract, robot_of
from stiction.files.plain import write_object


@dataclass(frozen=True, repr=False)
class LoadedPolicy(Result):
    """A policy bundle that passed every check, and can be run, evaluated, or driven step by step."""

    check: BundleCheck
    """The bundle, the replay's largest differences, and whose signature it has."""
    against: str | None = None
    """Name of the robot's model that it was compared with."""

    @property
    def bundle(self) -> Bundle:
        """The bundle, as it was read and hashed."""
        return self.check.bundle

    @property
    def contract(self) -> Contract:
        """Contract of the policy: joint_names, control_period [s], kp, kd, standing [rad], torque_limit [N m]."""
        return self.bundle.contract

    @property
    def name(self) -> str:
        """Name of the bundle."""
        return self.bundle.name

    @property
    def digest(self) -> str:
        """SHA-256 that names the whole bundle."""
        return self.bundle.digest

    def lines(self) -> Sequence[str]:
        """Return what it is, what was checked, and its digest."""
        contract, check = self.contract, self.check
        return (
            f"{self.name}: {contract.robot}, {contract.num_joints} joints, every {contract.control_period:g} s, "
            f"trained with {contract.method!r} at friction of {100 * contract.friction_level:g} % of the torque limit",
            f"every check passed; {check.steps} steps replayed, largest difference {check.target_error:.1e} rad",
            f"digest {self.digest}",
        )

    def to_dict(self) -> dict[str, Any]:
        """Return what `stiction verify --json` prints."""
        return self.check.summary() | ({} if self.against is None else {"against": self.against})

    def table(self) -> Markup:
        """Return a row a joint."""
        names = ("kp", "kd", "torque_limit", "standing")
        values = [self.contract.array(name) for name in names]
        rows = zip(self.contract.joint_names, *([f"{value:.4g}" for value in column] for column in values), strict=True)
        return html_table(("joint", "kp [N m/rad]", "kd [N m s/rad]", "torque limit [N m]", "standing [rad]"), rows)

    def write(self, folder: Path) -> None:
        """Write verified.json."""
        write_object(folder / "verified.json", self.to_dict())

    def batch(self, num: int) -> Policy:
        """Return the policy of `num` robots at once, for a simulator: `step(sensors, command)`, shapes (num, ...)."""
        return open_policy(self.contract, self.bundle.policy, (num,))

    def on_robot(self, joint_names: Sequence[str] | None = None) -> RobotPolicy:
        """Return the policy of one robot, which refuses readings that cannot be true; the one to use on a machine.

        joint_names: the order of the caller's vectors; None: the caller gives mappings from names.
        """
        return RobotPolicy(self.contract, open_policy(self.contract, self.bundle.policy), joint_names)

    def network(self, observation: np.ndarray) -> np.ndarray:
        """Return the network's actions, float32, shape (N, J), for observations of shape (N, size)."""
        size = self.contract.observation.size
        if np.ndim(observation) != 2 or np.shape(observation)[1] != size:
            raise PolicyError(f"an observation of shape {np.shape(observation)}; expected (N, {size})")
        network = Network(self.bundle.policy, size, self.contract.num_joints, self.contract.estimates_velocity)
        return network(np.ascontiguousarray(observation, dtype=np.float32))


def list_policies() -> list[str]:
    """Return the names of the policies that come with the package.

    >>> import stiction
    >>> "saturn_lite-flat-deception-0.2" in stiction.list_policies()
    True

    """
    return list(shipped_bundles())


@public
def verify(
    bundle: str | Path,
    *,
    against: str | Path | None = None,
    key: str | Path | None = None,
    expect_digest: str | None = None,
    allow: str | Path | None = None,
) -> LoadedPolicy:
    """Check a policy bundle: files, digests, contract, network, its first run, and a replay of recorded sensors.

    Args:
        bundle: its directory, or a name of `list_policies`.
        against: your own model of the robot, a MuJoCo or URDF file, which the policy's must match.
        key: public key of the maker, a PEM file, whose signature the bundle must have. Needs the extra `sign`.
        expect_digest: the digest that it must have, 64 hexadecimal digits.
        allow: text file of the digests that may run.

    Nothing in the bundle is executed before it was checked, and nothing is unpickled. Raises `BundleError`: the first
    thing that is wrong.

    >>> import stiction
    >>> stiction.verify("saturn_lite-flat-none-0.2").contract.control_period
    0.02

    """
    return verified(bundle, against, key, expect_digest, allow)


@public
def load_policy(
    bundle: str | Path,
    *,
    against: str | Path | None = None,
    key: str | Path | None = None,
    expect_digest: str | None = None,
    allow: str | Path | None = None,
) -> LoadedPolicy:
    """Return a policy, checked as `verify` does; arguments and errors are the same.

    >>> import stiction
    >>> policy = stiction.load_policy("saturn_lite-flat-none-0.2")
    >>> policy.contract.robot
    'saturn_lite'
    >>> stiction.load_policy("saturn_lite-flat-non")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    stiction.core.errors.BundleError: unknown policy 'saturn_lite-flat-non'; did you mean ...

    """
    return verified(bundle, against, key, expect_digest, allow)


def verified(
    bundle: str | Path,
    against: str | Path | None,
    key: str | Path | None,
    expect_digest: str | None,
    allow: str | Path | None,
) -> LoadedPolicy:
    """Check a bundle; see `verify`."""
    allowed = None if allow is None else read_allowed(Path(allow))
    check = check_bundle(find_bundle(Path(bundle)), expect_digest, None if key is None else Path(key), allowed)
    if against is None:
        return LoadedPolicy(check)
    from stiction.robots.compare import check_against

    check_against(robot_of(check.bundle.contract), Path(against))
    return LoadedPolicy(check, Path(against).name)


__all__ = ["LoadedPolicy", "list_policies", "load_policy", "verified", "verify"]
