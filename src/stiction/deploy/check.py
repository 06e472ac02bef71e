"""Checks of a policy bundle with onnxruntime and NumPy alone, as a robot's computer can run them."""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path

import numpy as np

from stiction.core.errors import BundleError, ConfigurationError, FileError, RobotError
from stiction.core.files import read_bounded
from stiction.deploy.control import ControlLoop
from stiction.deploy.first_run import first_run
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import Policy, PolicyStep, check_model, load_policy
from stiction.deploy.wear import WearMonitor
from stiction.files.bundle import GOLDEN, Bundle, read_bundle, write_bundle
from stiction.files.contract import ALIKE, Contract, robot_of
from stiction.files.contract_rules import IMPORTED, TARGET_LIMITS
from stiction.files.golden import Golden, exercise_of
from stiction.files.signature import check_signature
from stiction.files.wear import WearModel
from stiction.robots.catalog import is_shipped
from stiction.robots.model import Body
from stiction.robots.named import check_named


def check_robot(contract: Contract) -> None:
    """Reject a robot that no machine can be, or one with a shipped one's name and other numbers.

    A bundle without a robot means the shipped one of its name, and has its joints. Raises `StictionError`
    naming the first field that is wrong.
    """
    robot = contract.anatomy
    if robot is None:
        if not is_shipped(contract.robot):
            return
        names = {name: name for name in (*ALIKE, "lower", "upper")} | {"default_position": "standing"}
        names |= {} if contract.joints_file else {"armature": "armature", "damping": "damping"}
        values: dict[str, list[float]] = {name: contract.array(field).tolist() for name, field in names.items()}
        values["action_scale"] = np.broadcast_to(contract.scale, contract.num_joints).tolist()
        robot = robot_of(contract)
        joints = [
            replace(joint, **{name: value[number] for name, value in values.items()})  # type: ignore[arg-type]
            for number, joint in enumerate(robot.joints)
        ]
        robot = replace(robot, joints=tuple(joints))
    named: list[tuple[str, Body]] = [("base", robot.base), *((link.name, link) for link in robot.links)]
    for name, body in named:
        if not body.is_physical:
            raise RobotError(
                f"robot {robot.name!r}: {name} has the mass {body.mass:g} kg and the inertia {body.inertia} kg m²; "
                "expected those of a body; correct them in the file of the robot"
            )
    check_named(robot, elsewhere=contract.method == IMPORTED)


OF_CONTRACT = ("robot", "method", "friction_law", "friction_level", "known_friction")

DIGEST = re.compile("[0-9a-fA-F]{64}")

LARGEST_LIST = 2**20
"""Largest list of digests [B]: over ten thousand bundles."""

TOLERANCE = 1e-5
"""Largest difference between the recording and the replay, in units of observation and action and in rad; of values
over 1 as a share of the largest, for a network computes with seven digits."""

MOST_WORK = 10**10
"""Most multiplications of a replay: some 5 s of one core. Those of our bundles take 3e8."""


@dataclass(frozen=True)
class BundleCheck:
    """Result of checking a bundle that passed."""

    bundle: Bundle
    steps: int
    observation_error: float
    """Largest difference of the observation [-]."""
    action_error: float
    """Largest difference of the action [-]."""
    target_error: float
    """Largest difference of the joint target [rad]."""
    signer: str | None = None
    """Fingerprint of the named key whose signature the bundle has; None where no key was named."""

    def summary(self) -> dict:
        """Return plain data for `--json`; `wear`: estimates of the wear monitor, joints and `level`; `signed`: True if
        signed, `signer`: its key, where one was named; `exercised`: limits of the contract that the recording
        exercises.
        """
        contract, wear = self.bundle.contract, self.bundle.wear
        return {
            **{"ok": True, "bundle": self.bundle.name, "digest": self.bundle.digest, "size": self.bundle.size},
            **{name: getattr(contract, name) for name in OF_CONTRACT},
            "wear": [] if wear is None else [t for t, known in zip(wear.targets, wear.estimated, strict=True) if known],
            "signed": self.bundle.signature is not None,
            "signer": self.signer,
            "steps": self.steps,
            "exercised": asdict(exercise_of(self.bundle.golden, contract)),
            "tolerance": TOLERANCE,
            **{name: getattr(self, name) for name in ("observation_error", "action_error", "target_error")},
        }


def write_checked(
    path: Path, contract: Contract, policy: bytes, golden: Golden, card: str, wear: WearModel | None = None
) -> BundleCheck:
    """Write a bundle and check it; one that does not pass its own check is removed. Raises `BundleError`."""
    folder = write_bundle(path, contract, policy, golden, card, wear)
    try:
        return check_bundle(folder)
    except BaseException:
        shutil.rmtree(folder)
        raise


def check_bundle(
    path: Path | str, digest: str | None = None, key: Path | None = None, allowed: Collection[str] | None = None
) -> BundleCheck:
    """Read a bundle, load its network and replay its golden vectors; return the result of all checks.

    digest: required `Bundle.digest`, 64 hexadecimal digits, as its maker published it; key: public key of the
    maker, a PEM file, whose signature the bundle has to have; allowed: digests of which it has to have one, as from
    `read_allowed`; None: any. Raises `StictionError` for the first fault: files, checksums, digest or
    signature, before anything is interpreted; then contract, network, or the replay.
    """
    signers: list[str] = []

    def vouch(sums: bytes, signature: bytes | None) -> None:
        actual = hashlib.sha256(sums).hexdigest()
        if digest is not None and DIGEST.fullmatch(digest) is None:
            raise ConfigurationError(f"digest: got {digest[:80]!r}, expected 64 hexadecimal digits, as verify prints")
        if digest is not None and actual != digest.lower():
            raise BundleError(
                f"{path}: its digest is {actual}, not {digest.lower()}: it is another bundle; do not use it"
            )
        if allowed is not None and actual not in allowed:
            raise BundleError(f"{path}: its digest {actual} is not among the {len(allowed)} that are allowed; do not "
                              "run it, or add it to the list")  # fmt: skip
        if key is not None:
            signers.append(check_signature(sums, signature, key))

    bundle = read_bundle(path, vouch)
    policy = _first_load(path, bundle, bundle.golden.observation)
    replayed = replay(policy, bundle.golden)
    errors = {
        name: float(np.abs(getattr(replayed, name).astype(np.float64) - getattr(bundle.golden, name)).max())
        for name in ("observation", "action", "target")
    }
    for name, error in errors.items():
        largest = TOLERANCE * max(1.0, float(np.abs(getattr(bundle.golden, name)).max()))
        if not error <= largest:  # also catches NaN
            raise BundleError(
                f"{path}: the replay differs from golden.npz by {error:.3g} in the {name}, more than {largest:.3g}: "
                "policy, contract and golden vectors do not belong together; get the bundle again"
            )
    return BundleCheck(
        bundle, len(bundle.golden), **{f"{name}_error": error for name, error in errors.items()},
        signer=signers[0] if signers else None,
    )  # fmt: skip


def _first_load(path: Path | str, bundle: Bundle, observations: np.ndarray) -> Policy:
    """Check robot, network and wear map, run the network on observations, shape (T, size), and return the policy."""
    contract = bundle.contract
    check_robot(contract)
    work = check_model(bundle.policy, contract.observation.size, contract.num_joints, contract.estimates_velocity)
    if work * len(observations) > MOST_WORK:
        raise BundleError(
            f"{path}: {len(observations)} golden steps of {work:.3g} operations each; at most {MOST_WORK:.3g} are "
            "replayed"
        )
    first_run(bundle.policy, observations)
    policy = load_policy(contract, bundle.policy)
    if bundle.wear is not None:
        # Made for its checks: it rejects a map of other joints or of another layout.
        WearMonitor(contract, bundle.wear)
    return policy


def check_for_simulation(path: Path | str, key: Path | None = None) -> Bundle:
    """Check a bundle, or a policy record, whose policy shall walk in simulation; return it.

    key: public key of the maker, a PEM file, whose signature it has to have; None: any. A bundle is
    checked as `check_bundle` does. A record is checked without the replay: its network is run on zeros.
    Report `record_notes` to the user. Raises `StictionError`: see `check_bundle`.
    """
    if (Path(path) / GOLDEN).exists():
        return check_bundle(path, key=key).bundle

    def vouch(sums: bytes, signature: bytes | None) -> None:
        if key is not None:
            check_signature(sums, signature, key)

    bundle = read_bundle(path, vouch, allow_record=True)
    _first_load(path, bundle, np.zeros((1, bundle.contract.observation.size), np.float32))
    return bundle


def target_limits_text(contract: Contract) -> str:
    """Return the limits that every control step applies to joint targets, in words."""
    limits = contract.target_limits or TARGET_LIMITS
    text = f"{limits['slew']:g} rad/s, {limits['margin']:g} rad within the joints' limits"
    return text if contract.target_limits else f"none in evaluation; {text} on a robot"


def record_notes(bundles: Iterable[Bundle]) -> list[str]:
    """Return one sentence on the policy records among bundles, or none."""
    names = [bundle.name for bundle in bundles if bundle.vectors is None]
    told = "without golden vectors: nothing proves that the network computes as recorded"
    return [f"policy records {told}: {', '.join(names)}"] if names else []


def read_allowed(path: Path) -> frozenset[str]:
    """Return the digests of allowed bundles from a list: a text file, one of them a line, `#` before comments.

    Raises `FileError`: it cannot be read, is too large, or a line is not a digest.
    """
    content = read_bounded(path, "a list of digests", FileError, LARGEST_LIST)
    digests = set()
    for number, line in enumerate(content.decode("utf-8", "replace").splitlines(), start=1):
        if digest := line.partition("#")[0].strip():
            if DIGEST.fullmatch(digest) is None:
                raise FileError(
                    f"{path}, line {number}: got {digest[:80]!r}, expected 64 hexadecimal digits, as verify "
                    "prints, and comments behind #"
                )
            digests.add(digest.lower())
    return frozenset(digests)


def replay(policy: Policy, golden: Golden) -> PolicyStep:
    """Run the control step over the recorded sensors, step by step; return every step's outputs, shapes (T, ...).

    The last action that enters each observation is the recorded one, like every other input: two runtimes that round
    differently would otherwise drift apart over the steps, and the tolerance would have to allow for it.
    """
    loop, steps = ControlLoop(policy, policy.contract), []
    recorded = Sensors(**{part.name: getattr(golden, part.name) for part in fields(Sensors)})
    for t in range(len(golden)):
        if golden.reset[t]:
            loop.reset()
        steps.append(loop.act(recorded.each(partial(np.take, indices=t, axis=0)), golden.command[t]))
        policy.take_over(golden.action[t])
    return PolicyStep(*(np.stack([getattr(s, name) for s in steps]) for name in ("observation", "action", "target")))
