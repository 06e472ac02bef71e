"""Turns a trained student into a policy bundle. Needs torch and onnx.

`export` drives it with the policy as training computes it, so that a replay by the runtime compares the two.

Golden vectors are recorded with this one and replayed with the runtime's (NumPy and onnxruntime), so that a drift
between the two shows in every bundle.
"""

from __future__ import annotations

import hashlib
import io
import logging
import shlex
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from stiction.core.errors import BundleError, ConfigurationError, FileError, StictionError, TrainingError
from stiction.core.provenance import seed_streams
from stiction.deploy.check import BundleCheck, check_bundle
from stiction.deploy.observation import Sensors, friction_of_robots
from stiction.deploy.policy import INPUT, OUTPUT, PolicyStep
from stiction.evaluate.known_friction import nominal_known
from stiction.evaluate.rollout import Driver, Rollout, RolloutStep
from stiction.formats.bundle import Golden, write_bundle
from stiction.formats.contract import METHODS, Contract
from stiction.formats.joints import load_joints
from stiction.formats.known_friction import TERM, bench_friction, joint_kinds, told_text
from stiction.formats.wear import WearModel, read_wear
from stiction.joints.friction import LAWS, has_coefficient, level_text
from stiction.joints.pd import COMPENSATION_WIDTH, compensated
from stiction.locomotion.env import to_tensor
from stiction.locomotion.observations import FrameBuilder, History, SlowMeans, roll_pitch
from stiction.robots.catalog import find_robot
from stiction.robots.model import RobotSpec

if TYPE_CHECKING:
    from stiction.rma.config import TrainCfg
    from stiction.rma.run import RunDirectory


TEMPLATE = """\
# {robot}, {terrain}, {method}, {title}

A walking policy for the robot `{robot}` on {terrain} ground: the student of rapid motor adaptation, which sees joints,
attitude and its own last actions, and follows a commanded velocity.

| | |
|---|---|
| trained with | {meaning} |
| law of the dry friction | `{law}`: {law_meaning} |
| nominal dry friction | {nominal} |
| dry friction in training | {low:.3g} to {high:.3g}{unit} |
| joints | {joints} ({joint_count}) |
| control period | {period:g} s |
| identification used | {identification} |
{told}| joint torque in training | {torque} |
| seed | {seed} |
| code | {revision} |
| made by | `{command}` |

It was trained and evaluated in simulation. It has not run on a robot.

`stiction verify` checks the files and replays the recorded sensors of `golden.npz`. `SHA256SUMS` guards against
damage, it is not a signature: take bundles from where you trust.
"""


def write_card(contract: Contract) -> str:
    """Return the text of card.md."""
    low, high = contract.friction_range
    used, level = contract.joints_file, level_text(contract.friction_law, contract.friction_level)
    coefficient = has_coefficient(contract.friction_law)
    net = contract.actuator
    return TEMPLATE.format(
        robot=contract.robot,
        terrain=contract.terrain,
        method=contract.method,
        meaning=METHODS.get(contract.method, contract.method),
        title=level if contract.friction_law == "coulomb" else f"{contract.friction_law} {level}",
        law=contract.friction_law,
        law_meaning=LAWS[contract.friction_law].meaning,
        nominal=level if coefficient else f"{level} of each joint's torque limit",
        unit="" if coefficient else " of the torque limit",
        low=low,
        high=high,
        joints=", ".join(contract.joint_names),
        joint_count=contract.num_joints,
        period=contract.control_period,
        identification=f"{used['name']}, SHA-256 {used['sha256']}" if used else "none",
        told=_told(contract),
        torque=f"Actuator Net {net['name']}, SHA-256 {net['sha256']}"
        if net
        else "PD law with the gains of the contract",
        seed=contract.seed,
        revision=contract.revision,
        command=contract.command,
    )


def _told(contract: Contract) -> str:
    """Return the line on the friction that the policy is told; nothing for one that is told none."""
    told, file = contract.known_friction, contract.known_friction_file
    if told is None:
        return ""
    source = f"{file['name']}, SHA-256 {file['sha256']}" if file else "the nominal friction of training, of no robot"
    return f"| friction that it is told | {told_text(told)}, from {source} |\n"


STEPS = 600
"""Recorded steps: 12 s at 50 Hz."""

RESET_EVERY, COMMAND_EVERY = 200, 50
"""Steps between resets, and between new commands."""

COMMAND_BOUND = (0.6, 0.3, 0.6)
"""Half-widths of the random commands: forward, sideways [m/s], turn [rad/s]."""


def record_golden(contract: Contract, policy: Driver, spec: RobotSpec, seed: int = 0) -> Golden:
    """Drive one robot with the contract's nominal joints and return what it measured and what the policy made of it.

    Args:
        contract: what the policy expects.
        policy: what drives it, a batch of one, `TrainedPolicy` for a bundle to be shipped.
        spec: the robot.
        seed: seed of noise, initial states and commands.

    """
    streams = seed_streams(seed, ["golden noise", "golden commands"])
    noise = [streams["golden noise"]]
    rollout = Rollout(contract, policy, spec, contract.array("friction")[None], noise, law=contract.law)
    bound = np.array(COMMAND_BOUND)
    steps: list[RolloutStep] = []
    resets, commands = np.zeros(STEPS, dtype=bool), np.zeros((STEPS, 3))
    needs_reset = False
    for t in range(STEPS):
        resets[t] = t % RESET_EVERY == 0 or needs_reset
        if resets[t]:
            rollout.reset(np.array([0]))
        fresh = t % COMMAND_EVERY == 0
        commands[t] = streams["golden commands"].uniform(-bound, bound) if fresh else commands[t - 1]
        steps.append(rollout.step(commands[t : t + 1]))
        needs_reset = bool(rollout.fleet.fallen()[0]) or len(steps[-1].blown_up) > 0
    return Golden(
        joint_names=np.array(contract.joint_names),
        time=np.arange(STEPS) * contract.control_period,
        reset=resets,
        command=commands,
        quaternion=np.concatenate([step.sensors.quaternion for step in steps]),
        angular_velocity=np.concatenate([step.sensors.angular_velocity for step in steps]),
        joint_position=np.concatenate([step.sensors.joint_position for step in steps]),
        joint_velocity=np.concatenate([step.sensors.joint_velocity for step in steps]),
        observation=np.concatenate([step.policy.observation for step in steps]),
        action=np.concatenate([step.policy.action for step in steps]),
        target=np.concatenate([step.policy.target for step in steps]),
    )


OPSET = 18
"""ONNX operator set: old enough for every onnxruntime of the last years."""

EXAMPLE_BATCH = 2
"""Batch of the example input: with one, the exporter would take the batch for a constant."""


def export_run(
    run: Path,
    out: Path,
    wear: Path | None = None,
    joints: Path | None = None,
    say: Callable[[str], None] = lambda note: None,
) -> BundleCheck:
    """Export the student of a training run, write its bundle, and check what was written.

    Args:
        run: directory of the run.
        out: directory to make.
        wear: the wear.json that `stiction study adaptation` made for the run, to go into the bundle.
        joints: the joints.json of a robot, for a policy that is told its joints' friction.
        say: called with what the joints.json does not tell, and what stands in its place.

    Raises:
        StictionError: not a run, a run that is not finished, a wear.json of another student, a joints.json of another
            robot or for a policy that is told nothing, or `out` exists already.

    """
    from stiction.rma.run import RunDirectory
    from stiction.rma.runner import load_student

    directory = RunDirectory(run)
    header, cfg = directory.header(), directory.config()
    directory.check_finished("student")
    if not directory.finished:
        raise TrainingError(
            f"{run} is not finished, it has no summary.json; finish it with `stiction train --resume {run}`"
        )
    model = None if wear is None else _wear_of(directory, wear)
    contract = contract_of(cfg, header)
    if joints is not None:
        contract = with_bench(contract, joints, say)
    return export_policy(load_student(directory), contract, out, model)


def with_bench(contract: Contract, path: Path, say: Callable[[str], None] = lambda note: None) -> Contract:
    """Return a contract that tells the policy the friction that a bench identified; arguments as of `export_run`.

    Raises:
        StictionError: the policy is told nothing, the file cannot be read, or tells no friction of this robot's joints.

    """
    if not contract.knows_friction:
        raise ConfigurationError(
            "this policy is not told its joints' friction, --joints would have no effect; leave it out, or train with "
            "--task.known-friction"
        )
    file, limits = load_joints(path), contract.array("torque_limit")
    nominal = nominal_known(contract, find_robot(contract.robot))
    found = bench_friction(file, contract.joint_names, limits, nominal)
    if len(found.missing) == contract.num_joints:
        raise FileError(
            f"{path} has {', '.join(file.joints)}, and no friction of {', '.join(contract.joint_names[:3])} and so on; "
            "identify joints of this robot"
        )
    for note in found.notes:
        say(note)
    source = {"name": path.name, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
    return replace(contract, known_friction=found.share, known_friction_file=source)


def _wear_of(run: RunDirectory, path: Path) -> WearModel:
    """Read a wear.json and check that it belongs to the student of a run."""
    try:
        model = read_wear(path.read_bytes())
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}") from error
    if model.student != run.student_digest():
        raise FileError(f"{path} is of another student than {run.path}; make it with `stiction study adaptation`")
    return model


def contract_of(cfg: TrainCfg, header: dict[str, Any]) -> Contract:
    """Return the contract of a run.

    Args:
        cfg: configuration of the run.
        header: `command`, `revision`, `identified` and, where there is one, `actuator` of the run, as in its
            config.json.

    """
    from stiction.locomotion.randomization import friction_angle, nominal_joints
    from stiction.rma.run import identified_values
    from stiction.sim.fleet import Fleet

    task = cfg.task
    spec, identified = find_robot(task.robot), header["identified"]
    joints = nominal_joints(Fleet(spec, 1), task.friction, identified_values(header))
    level, law = task.friction.level, task.friction.joint_law
    if level is None:
        units = 1.0 if has_coefficient(law.name) else spec.joint_values("torque_limit")
        level = float((joints.frictionloss / units).mean())
    low, high = task.friction.last.range
    contract = Contract(
        robot=task.robot,
        terrain=task.terrain.kind,
        method=task.friction.method,
        seed=cfg.seed,
        phases=2 if cfg.student.iterations else 1,
        friction_law=law.name,
        friction_level=level,
        friction_range=(low * level, high * level),
        stribeck=(law.static_ratio, law.stribeck_velocity) if law.numbers else None,
        joint_names=spec.joint_names,
        control_period=task.control_period,
        decimation=task.decimation,
        physics_timestep=task.timestep,
        kp=tuple(spec.joint_values("stiffness").tolist()),
        kd=tuple(spec.joint_values("derivative").tolist()),
        standing=tuple(spec.joint_values("standing").tolist()),
        lower=tuple(spec.joint_values("lower").tolist()),
        upper=tuple(spec.joint_values("upper").tolist()),
        torque_limit=tuple(spec.joint_values("torque_limit").tolist()),
        armature=tuple(joints.armature.tolist()),
        damping=tuple(joints.damping.tolist()),
        friction=tuple(joints.frictionloss.tolist()),
        observation=task.layout(spec),
        action_scale=spec.action_scale,
        action_clip=task.action_clip,
        compensation=friction_angle(task.friction, joints, spec),
        compensation_width=COMPENSATION_WIDTH,
        revision=str(header["revision"]),
        command=_without_folders(str(header["command"])),
        actuator=header.get("actuator"),
        joints_file={"name": identified["file"], "sha256": identified["sha256"]} if identified else None,
    )
    if not contract.knows_friction:
        return contract
    nominal = zip(joint_kinds(spec.joint_names), nominal_known(contract, spec).tolist(), strict=True)
    return replace(contract, known_friction=dict(nominal))


def export_policy(module: torch.nn.Module, contract: Contract, out: Path, wear: WearModel | None = None) -> BundleCheck:
    """Write the bundle of a network and check it: what onnxruntime and NumPy compute against what torch computed.

    Args:
        module: observations (N, size), float32 -> actions (N, J).
        contract: what the policy expects of robot and runtime.
        out: directory to make.
        wear: map of the wear monitor, or None.

    Raises:
        StictionError: `out` exists already, the robot is unknown, or what was written does not pass its own check.

    """
    if out.exists():
        raise BundleError(f"{out} exists already; choose another --out or remove it")
    model = export_network(module, contract.observation.size)
    golden = record_golden(contract, TrainedPolicy(module, contract), find_robot(contract.robot), contract.seed)
    return check_bundle(write_bundle(out, contract, model, golden, write_card(contract), wear))


def export_network(module: torch.nn.Module, observation_size: int) -> bytes:
    """Return a network as ONNX: one file, one input and one output, any batch, nothing of this machine in it."""
    import onnx
    import torch

    example = torch.zeros(EXAMPLE_BATCH, observation_size)
    with _quiet(), torch.no_grad():
        program = torch.onnx.export(
            module.eval(),
            (example,),
            dynamo=True,
            external_data=False,
            input_names=[INPUT],
            output_names=[OUTPUT],
            dynamic_shapes=({0: torch.export.Dim("batch")},),
            opset_version=OPSET,
            verbose=False,
        )
    if program is None:
        raise StictionError("torch returned no ONNX program; torch 2.9 or newer is needed")
    model = program.model_proto
    _strip(model)
    onnx.checker.check_model(model)
    return model.SerializeToString()


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep back what the exporter prints, logs and warns of: none of it is for the user."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)
            yield
    finally:
        logger.setLevel(level)


def _strip(model: Any) -> None:
    """Remove the exporter's notes: stack traces with this machine's paths, several times the size of the graph."""
    graph = model.graph
    for part in (model, graph, *graph.node, *graph.input, *graph.output, *graph.value_info, *graph.initializer):
        part.ClearField("metadata_props")
        part.ClearField("doc_string")
    graph.ClearField("value_info")


def _without_folders(command: str) -> str:
    """Return a command line without its program's folder: where it lay says nothing to others."""
    words = shlex.split(command)
    return shlex.join([Path(words[0]).name, *words[1:]]) if words else command


class TrainedPolicy:
    """Sensors and command in, joint targets out, by the modules of training."""

    def __init__(
        self, module: torch.nn.Module, contract: Contract, num: int = 1, known_friction: np.ndarray | None = None
    ) -> None:
        """Start with an empty history.

        Args:
            module: observations (num, size), float32 -> actions (num, J).
            contract: layout, standing pose, scale and clip of the action.
            num: robots side by side.
            known_friction: f/τ_max of each kind of joint [-], shape (kinds,) or (num, kinds), for a policy that is told
                it; by default what the contract says.

        Raises:
            StictionError: the friction does not fit the policy.

        """
        self._module = module.eval()
        self._standing = to_tensor(contract.array("standing"))
        self._scale, self._clip = contract.action_scale, contract.action_clip
        extra = contract.compensation
        self._compensation = None if extra is None else to_tensor(np.array(extra))
        self._width = contract.compensation_width
        self._frames = FrameBuilder(contract.observation, self._standing)
        self._history = History(num, contract.observation)
        kept = contract.observation.slow_kept
        self._slow = None if kept is None else SlowMeans(num, contract.num_joints, kept)
        self._last_action = torch.zeros(num, contract.num_joints)
        self._fresh = torch.ones(num, dtype=torch.bool)
        known = contract.told_friction if known_friction is None else known_friction
        self._known = (
            {} if known is None else {TERM: to_tensor(friction_of_robots(contract.observation, known, (num,)))}
        )

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget the history and the last action of the robots in `mask` (bool, shape (num,)), of all without."""
        chosen = torch.ones_like(self._fresh) if mask is None else torch.from_numpy(np.asarray(mask, dtype=bool))
        self._fresh = self._fresh | chosen
        self._last_action[chosen] = 0.0

    @torch.no_grad()
    def step(self, sensors: Sensors, command: np.ndarray) -> PolicyStep:
        """Advance by one control period; `command`: forward, sideways [m/s], turn [rad/s], shape (num, 3)."""
        raw = {
            "angular_velocity": to_tensor(sensors.angular_velocity),
            "roll_pitch": roll_pitch(to_tensor(sensors.quaternion)),
            "joint_position": to_tensor(sensors.joint_position),
            "joint_velocity": to_tensor(sensors.joint_velocity),
            "command": to_tensor(command),
            "last_action": self._last_action,
            **self._known,
        }
        if self._slow is not None:
            error = self._standing + self._scale * self._last_action - raw["joint_position"]
            raw |= self._slow.push(error, raw["joint_velocity"], self._fresh)
        observation = self._history.push(self._frames(raw), self._fresh)
        self._fresh = torch.zeros_like(self._fresh)
        action = self._module(observation).clamp(-self._clip, self._clip)
        target = self._standing + self._scale * action
        if self._compensation is not None:
            target = compensated(target, raw["joint_position"], self._compensation, self._width)
        self._last_action = action.clone()
        return PolicyStep(observation.numpy(), action.numpy(), target.double().numpy())
