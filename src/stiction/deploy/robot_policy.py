"""Policy on a machine: asks for times and joints by name, rejects implausible readings, returns copies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stiction.core.errors import PolicyError, RobotError, unknown_name
from stiction.deploy.check import check_bundle
from stiction.deploy.control import ControlLoop
from stiction.deploy.observation import Sensors
from stiction.deploy.plausibility import ImplausibleError, ReadingGuard, Violation
from stiction.deploy.policy import Policy, PolicyStep, load_policy
from stiction.files.bundle import Bundle
from stiction.files.contract import Contract

Joints = Mapping[str, float] | Sequence[float] | np.ndarray
"""Numbers for each joint: by name, or in the order that was given at the start."""

STEPS_OF_RATE = 10
"""Steps over which the rate of the loop is averaged."""


@dataclass(frozen=True)
class RobotStep:
    """Joint targets for one control period. Writing into it changes nothing in the policy."""

    joint_names: tuple[str, ...]
    """Order of `target`: the caller's if given, else the contract's."""
    target: np.ndarray
    """Joint targets [rad]; for joints that the policy does not move, the angle at which they are held."""
    policy: PolicyStep

    def targets(self) -> dict[str, float]:
        """Return the targets by joint [rad]."""
        return dict(zip(self.joint_names, self.target.tolist(), strict=True))


class JointOrder:
    """Order of a caller's joints against the contract's."""

    def __init__(self, contract: Contract, joint_names: Sequence[str] | None = None) -> None:
        """Compare the names; raise `RobotError` where a joint is missing, unknown, or doubled.

        joint_names: order of the caller's vectors: every joint of the contract, and joints that its robot holds rigid
        if the caller has them too; None: the caller gives mappings from names.
        """
        held = {} if contract.anatomy is None else {joint.name: joint.position for joint in contract.anatomy.held}
        self.names = contract.joint_names if joint_names is None else tuple(joint_names)
        self.contract_names = contract.joint_names
        self._known = {*self.contract_names, *held}
        self.ordered = joint_names is not None
        self._check(self.names)
        place = {name: number for number, name in enumerate(self.names)}
        self._from = np.array([place[name] for name in self.contract_names])
        self._rest = np.array([held.get(name, 0.0) for name in self.names])

    def _check(self, names: Sequence[str]) -> None:
        for name in names:
            if name not in self._known:
                raise RobotError(unknown_name("joint", name, self.contract_names))
        if missing := [name for name in self.contract_names if name not in names]:
            raise RobotError(f"the joint {missing[0]!r} is missing; the policy moves {', '.join(self.contract_names)}")
        if len(set(names)) < len(names):
            twice = next(name for name in names if list(names).count(name) > 1)
            raise RobotError(f"joints: got {twice!r} twice, expected each once")

    def to_contract(self, values: Joints, what: str) -> np.ndarray:
        """Return the caller's numbers in the contract's order, shape (J,); what: their name, for messages.

        Raises `RobotError` for names that are not the joints', and `PolicyError` for numbers without names.
        """
        if isinstance(values, Mapping):
            # This runs in the control loop: names are compared one by one only where something is wrong with them.
            if not self._known.issuperset(values) or len(values) < len(self.contract_names):
                self._check(tuple(values))
            try:
                return np.array([values[name] for name in self.contract_names], dtype=np.float64)
            except KeyError:
                self._check(tuple(values))
                raise
        if not self.ordered:
            raise PolicyError(
                f"{what} without names of joints; give a mapping from names, or the order once, as joint_names"
            )
        array = np.asarray(values, dtype=np.float64)
        if array.shape != (len(self.names),):
            raise PolicyError(f"{what} has the shape {array.shape}; expected one number for each of {self.names}")
        return array[self._from]

    def from_contract(self, values: np.ndarray) -> np.ndarray:
        """Return an array of the contract's order, (J,), as a new one in the caller's; held joints at their angle."""
        array = self._rest.copy()
        array[self._from] = values
        return array


class RobotPolicy:
    """One policy on one robot: `step` either returns targets for a plausible reading, or raises."""

    def __init__(
        self,
        contract: Contract,
        policy: Policy,
        joint_names: Sequence[str] | None = None,
        limits: Mapping[str, float] | None = None,
    ) -> None:
        """Start before the first reading.

        policy: for one robot, as from `load_policy`; joint_names: order of the caller's vectors over joints, see
        `JointOrder`; None: mappings from names; limits: rule of `plausibility.RULES` -> its limit; infinity switches it
        off. Raises `StictionError`: joints that are not the contract's, a limit of no rule, or a policy that observes
        the friction of its joints, which is not known.
        """
        self.contract, self.order = contract, JointOrder(contract, joint_names)
        self.guard = ReadingGuard(contract, limits)
        if contract.observes_friction and contract.known_friction is None:
            raise PolicyError(
                "this policy observes the friction of its joints, which its contract does not have: export its "
                "bundle again, with --joints for what a bench identified"
            )
        self._loop = ControlLoop(policy, contract)
        self.reset()

    def reset(self) -> None:
        """Reset to a standing robot: earlier readings and commands no longer count."""
        self._loop.reset()
        self.guard.reset()
        self._time: float | None = None
        self._mean = self.contract.control_period

    @property
    def note(self) -> str | None:
        """Assumption about a value that the bundle does not have; None without one."""
        if not self.guard.assumed_range:
            return None
        return (
            "the bundle is older than trained ranges of commands: up to 0.8 m/s forward, 0.3 m/s sideways and 0.6 "
            "rad/s are assumed, what training draws where nobody says otherwise"
        )

    def step(
        self,
        time: float,
        *,
        quaternion: np.ndarray,
        angular_velocity: np.ndarray,
        joint_position: Joints,
        joint_velocity: Joints,
        command: np.ndarray,
        now: float | None = None,
    ) -> RobotStep:
        """Return the joint targets of one control period.

        A refused step leaves the policy as it was; the caller has to decide what the robot does then.

        time: time of the measurement [s], on a clock that only advances; quaternion: of the base, of length 1, w x y z;
        angular_velocity: in its own frame [rad/s], shape (3,); joint_position, joint_velocity: [rad, rad/s], by name or
        in the caller's order; command: forward, sideways [m/s], turn [rad/s], shape (3,); now: the present on the same
        clock [s]; without it the age of the reading is not judged. Raises `ImplausibleError`: a rule is broken, see
        `plausibility.RULES`; `StictionError`: joints that are not the robot's, shapes that are not those above, a
        network that fails.
        """
        sensors = Sensors(
            np.asarray(quaternion, dtype=np.float64),
            np.asarray(angular_velocity, dtype=np.float64),
            self.order.to_contract(joint_position, "joint_position"),
            self.order.to_contract(joint_velocity, "joint_velocity"),
        )
        velocity = np.asarray(command, dtype=np.float64)
        if velocity.shape != (3,):
            raise PolicyError(f"a command of shape {velocity.shape}; expected forward, sideways, turn: (3,)")
        if (broken := self.guard.check(time, sensors, velocity, now) or self._keep_time(time)) is not None:
            raise ImplausibleError(broken)
        step = self._loop.act(sensors, velocity)
        return RobotStep(self.order.names, self.order.from_contract(step.target), step)

    def _keep_time(self, time: float) -> Violation | None:
        """Judge the rate of the steps; remember the time of one that is taken."""
        if self._time is not None:
            period, factor = self.contract.control_period, self.guard.limits["control period"]
            mean = self._mean + (time - self._time - self._mean) / STEPS_OF_RATE
            if not period <= mean * factor or not mean <= factor * period:
                limit = period * factor if mean > period else period / factor
                return Violation("control period", None, mean, limit, "s")
            self._mean = mean
        self._time = time
        return None


def load_robot_policy(
    bundle: Path | str | Bundle,
    joint_names: Sequence[str] | None = None,
    *,
    limits: Mapping[str, float] | None = None,
    digest: str | None = None,
    key: Path | None = None,
    allowed: frozenset[str] | None = None,
) -> RobotPolicy:
    """Check a bundle and return its policy for one robot.

    bundle: its directory, which is checked as `verify` does, or a checked bundle; joint_names, limits: see
    `RobotPolicy`; digest, key, allowed: for a directory alone, see `check_bundle`. Raises `StictionError` as both.
    """
    if not isinstance(bundle, Bundle):
        bundle = check_bundle(bundle, digest, key, allowed).bundle
    policy = load_policy(bundle.contract, bundle.policy)
    return RobotPolicy(bundle.contract, policy, joint_names, limits)
