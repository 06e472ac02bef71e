"""Export of a trained student as a policy bundle. Needs torch and onnx.

Golden vectors are recorded with the policy as training computes it, and replayed with NumPy and onnxruntime as in the
robot's runtime.
"""

from __future__ import annotations

import io
import logging
import shlex
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from stiction.core.effects import requirement
from stiction.core.errors import BundleError, ConfigurationError, FileError, StictionError, TrainingError
from stiction.core.files import digest_of, read_bounded
from stiction.deploy.check import BundleCheck, write_checked
from stiction.deploy.observation import Clock, Sensors, friction_of_robots
from stiction.deploy.policy import INPUT, OUTPUT, VELOCITY, PolicyStep
from stiction.deploy.vendor import VendorMap, write_maker_targets
from stiction.evaluation.golden import record_golden
from stiction.evaluation.policies import nominal_known
from stiction.files.bam import load_joints
from stiction.files.bundle import MAX_BYTES, WEAR
from stiction.files.contract import Contract, robot_of
from stiction.files.contract_rules import COMMAND_CORRECTION, TARGET_LIMITS
from stiction.files.contract_training import span_text
from stiction.files.joint_map import mapped, refuse_alone
from stiction.files.known_friction import TERM, bench_friction, known_friction_text
from stiction.files.method import Method, describe_method, known_method
from stiction.files.observation import FIRST_SIDE
from stiction.files.velocity import COMMANDS
from stiction.files.wear import WearModel, read_wear
from stiction.joints.compensation import BY_SPEED, compensated
from stiction.joints.friction import LAWS, has_coefficient, level_text
from stiction.learning.config import TrainCfg
from stiction.learning.identity import settings_of, settings_text
from stiction.learning.run import RunDirectory, identified_values
from stiction.learning.runner import load_student
from stiction.learning.stored import config_from
from stiction.robots.catalog import find_robot
from stiction.robots.named import check_named
from stiction.sim.fleet import Fleet
from stiction.task.config import TaskCfg
from stiction.task.env import to_tensor
from stiction.task.observations import FrameBuilder, History, SlowMeans, roll_pitch
from stiction.task.randomization import friction_angle, nominal_joints
from stiction.task.terrain import FASTEST_TURN

TEMPLATE = """\
# {robot}, {terrain}, {method}, {title}

A walking policy for the robot `{robot}` on {terrain} ground: {kind}, which sees joints,
attitude and its own last actions, and follows a commanded velocity.

| | |
|---|---|
| trained with | {meaning} |
| law of the dry friction | `{law}`: {law_meaning} |
| nominal dry friction | {nominal} |
| dry friction in training | {low:.3g} to {high:.3g}{unit}{more} |
| joints | {joints} ({joint_count}) |
| control period | {period:g} s |
| identification used | {identification} |
{told}| joint torque in training | {torque} |
| settings of the training | {settings} |
| seed | {seed} |
| code | {revision} |
| made by | `{command}` |

It was trained and evaluated in simulation. It has not run on a robot.

`stiction verify` checks the files and replays the recorded sensors of `golden.npz`. Checksums find accidents,
signatures find authors: `stiction verify --key` and `--expect-digest` say whose this is.
"""


def write_card(contract: Contract) -> str:
    """Return the text of card.md."""
    low, high = contract.friction_range
    used, level = contract.joints_file, level_text(contract.friction_law, contract.friction_level)
    coefficient = has_coefficient(contract.friction_law)
    net, method = contract.actuator, known_method(contract.method)
    side = f" of {contract.torque_source.replace('_', '-')} torque" if contract.torque_source else ""
    return TEMPLATE.format(
        robot=contract.robot,
        terrain=contract.terrain,
        method=contract.method,
        meaning=describe_method(contract.method),
        kind=Method.policy if method is None else method.policy,
        title=level if contract.friction_law == "coulomb" else f"{contract.friction_law} {level}",
        law=contract.friction_law,
        law_meaning=LAWS[contract.friction_law].meaning,
        nominal=level if coefficient else f"{level} of each joint's torque limit",
        unit="" if coefficient else " of the torque limit",
        low=low,
        high=high,
        more=_more_friction(contract),
        joints=", ".join(contract.joint_names),
        joint_count=contract.num_joints,
        period=contract.control_period,
        identification=_file_text(used) if used else "none",
        told=_known_friction_line(contract),
        torque=f"Actuator Net{side} {_file_text(net)}" if net else "PD law with the gains of the contract",
        settings=settings_text(contract.settings),
        seed=contract.seed,
        revision=contract.revision,
        command=contract.command,
    )


def _more_friction(contract: Contract) -> str:
    """Return the card's text on friction besides its range; empty without any."""
    texts = {
        "friction_spread": "; times {:g} to {:g} in each joint",
        "friction_load": "; beside it {:g} to {:g} of what the joint transmits",
    }
    ranges = {name: getattr(contract, name) for name in texts}
    more = "".join(texts[name].format(*span) for name, span in ranges.items() if span is not None)
    rise = span_text(contract.rise)
    return more if rise == "1" else f"; at rest {rise} times that{more}"


def _known_friction_line(contract: Contract) -> str:
    """Return the card's line on the friction that the policy observes; empty for a policy that observes none."""
    known, file = contract.known_friction, contract.known_friction_file
    if known is None:
        return ""
    source = _file_text(file) if file else "the nominal friction of training, of no robot"
    return f"| friction that it is told | {known_friction_text(known)}, from {source} |\n"


def _file_text(file: Mapping[str, str]) -> str:
    """Return a file's name and digest."""
    return f"{file['name']}, SHA-256 {file['sha256']}"


OPSET = 18
"""ONNX operator set, supported by every onnxruntime of the last years."""

EXAMPLE_BATCH = 2
"""Batch of the example input: with 1, the exporter would treat the batch as a constant."""


def export_run(
    run: Path,
    out: Path,
    wear: Path | None = None,
    joints: Path | None = None,
    joint_map: Sequence[str] = (),
    say: Callable[[str], None] = lambda note: None,
    robot: str | None = None,
    maker_targets: Path | None = None,
    corrected: bool = True,
) -> BundleCheck:
    """Export the student of a training run, write its bundle, and check what was written.

    wear: the wear.json of `stiction study adaptation`; joints: the joints.json of a robot, for a policy that observes
    its joints' friction; joint_map: RECORDED=JOINT pairs; say: called with each note on missing joints; robot: see
    `RunDirectory.adopt`; maker_targets: CSV of recorded targets in the maker's order; corrected: False to omit the
    correction of commands. Raises `StictionError` for an unfinished run, files of another student or robot, and an
    existing `out`.
    """
    refuse_alone(joint_map, joints)
    directory = RunDirectory(run)
    if robot is not None:
        directory.adopt(robot)
    header, cfg = directory.header(), directory.config()
    directory.check_finished("student")
    if not directory.finished:
        raise TrainingError(
            f"{run} is not finished, it has no summary.json; finish it with `stiction train --resume {run}`"
        )
    model = None if wear is None else _wear_of(directory, wear)
    contract = contract_of(cfg, header)
    if not corrected:
        contract = replace(contract, command_correction=None)
    if joints is not None:
        contract = with_bench(contract, joints, say, joint_map)
    if maker_targets is not None:
        VendorMap(contract)  # Raises for an unknown vendor, before anything is written.
    check = export_policy(load_student(directory), contract, out, model)
    if maker_targets is not None:
        write_maker_targets(check.bundle, maker_targets)
    return check


def with_bench(
    contract: Contract, path: Path, say: Callable[[str], None] = lambda note: None, joint_map: Sequence[str] = ()
) -> Contract:
    """Return a contract with the known friction of a bench's joints.json; arguments and errors as of `export_run`."""
    if not contract.observes_friction:
        raise ConfigurationError(requirement("--joints", "a policy trained with --task.known-friction"))
    file, limits = mapped(load_joints(path), joint_map, contract.joint_names), contract.array("torque_limit")
    nominal = nominal_known(contract, robot_of(contract))
    bench = bench_friction(file, contract.joint_names, contract.kinds, limits, nominal)
    if len(bench.missing) == contract.num_joints:
        raise FileError(
            f"{path} has joints {', '.join(file.joints)}, expected {', '.join(contract.joint_names[:3])} and so on; "
            "identify the joints of this robot"
        )
    for note in bench.notes:
        say(note)
    source = {"name": path.name, "sha256": digest_of(path)}
    return replace(contract, known_friction=bench.share, known_friction_file=source)


def _wear_of(run: RunDirectory, path: Path) -> WearModel:
    """Read a wear.json and check that it belongs to the student of a run."""
    expected = "the RUN-wear.json of `stiction study adaptation`"
    model = read_wear(read_bounded(path, expected, FileError, MAX_BYTES[WEAR]))
    if model.student != run.student_digest():
        raise FileError(f"{path} belongs to another student than {run.path}; make it with `stiction study adaptation`")
    return model


def contract_of(cfg: TrainCfg, header: dict[str, Any]) -> Contract:
    """Return the contract of a run; header: of its config.json, with or without `config`."""
    task = cfg.task
    spec, identified = find_robot(task.robot), header["identified"]
    check_named(spec)
    joints = nominal_joints(Fleet(spec, 1), task.friction, identified_values(header))
    level, law = task.friction.level, task.friction.joint_law
    if level is None:
        units = 1.0 if has_coefficient(law.name) else spec.joint_values("torque_limit")
        level = float((joints.frictionloss / units).mean())
    low, high = task.friction.last.range
    narrowest = float((spec.joint_values("upper") - spec.joint_values("lower")).min())
    angle, push = friction_angle(task.friction, joints, spec), BY_SPEED.push

    # Paths of this machine mean nothing elsewhere.
    words = [Path(word).name if Path(word).is_absolute() else word for word in shlex.split(str(header["command"]))]

    def of_joints(name: str) -> tuple[float, ...]:
        return tuple(spec.joint_values(name).tolist())

    contract = Contract(
        robot=spec.name,
        terrain=task.terrain.kind,
        method=task.friction.method,
        seed=cfg.seed,
        phases=2 if cfg.student.iterations else 1,
        friction_law=law.name,
        friction_level=level,
        friction_range=(low * level, high * level),
        friction_load=task.friction.load,
        friction_spread=task.friction.spread,
        stribeck=(law.static_ratio, law.stribeck_velocity) if law.numbers else None,
        joint_names=spec.joint_names,
        control_period=task.control_period,
        decimation=task.decimation,
        physics_timestep=task.timestep,
        kp=of_joints("kp"),
        kd=of_joints("kd"),
        standing=of_joints("default_position"),
        lower=of_joints("lower"),
        upper=of_joints("upper"),
        torque_limit=of_joints("torque_limit"),
        armature=tuple(joints.armature.tolist()),
        damping=tuple(joints.damping.tolist()),
        friction=tuple(joints.frictionloss.tolist()),
        observation=task.layout(spec),
        action_scale=spec.action_scale if isinstance(spec.action_scale, float) else tuple(spec.action_scale.tolist()),
        anatomy=spec,
        action_clip=task.action_clip,
        compensation=angle,
        compensation_width=push.width,
        compensation_speeds=None if angle is None else (push.slow, push.fade),
        target_limits=TARGET_LIMITS | {"margin": min(TARGET_LIMITS["margin"], 0.1 * narrowest)},
        command_correction=COMMAND_CORRECTION,
        command_range=_command_range(task),
        revision=str(header["revision"]),
        command=shlex.join(words),
        actuator=header.get("actuator"),
        torque_source=header.get("torque_source"),
        joints_file={"name": identified["file"], "sha256": identified["sha256"]} if identified else None,
        settings=_settings(cfg, header),
        **cfg.method.contract(cfg),
    )
    if not contract.observes_friction:
        return contract
    nominal = zip(spec.joint_kinds, nominal_known(contract, spec).tolist(), strict=True)
    return replace(contract, known_friction=dict(nominal))


def _settings(cfg: TrainCfg, header: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of a run that differ from the defaults, including the names of user-defined reward terms."""
    if "config" in header:
        # The configuration of a run omits them, see `RunDirectory.config`: here only their names are used.
        terms = config_from(header["config"], "config.json").task.rewards.own
        cfg = replace(cfg, task=replace(cfg.task, rewards=replace(cfg.task.rewards, own=terms)))
    return settings_of(cfg)


def _command_range(task: TaskCfg) -> dict[str, tuple[float, float]]:
    """Return the range of velocity commands of a training: drawn commands, those on its courses, and standing."""
    spans = {name: [getattr(task.commands, name)] for name in COMMANDS}
    if task.terrain.kind != "flat":
        spans["forward"].append(task.terrain.speed)
        spans["turn"].append((-FASTEST_TURN, FASTEST_TURN))
    if task.commands.standing_share > 0:
        spans = {name: [*ends, (0.0, 0.0)] for name, ends in spans.items()}
    return {name: (min(low for low, _ in ends), max(high for _, high in ends)) for name, ends in spans.items()}


def export_policy(module: torch.nn.Module, contract: Contract, out: Path, wear: WearModel | None = None) -> BundleCheck:
    """Write the bundle of a network, (N, size) float32 -> actions (N, J), and check it against torch's results.

    Raises `StictionError` where `out` exists, the robot is unknown, or the bundle fails its own check.
    """
    if out.exists():
        raise BundleError(f"{out} exists already; choose another --out or remove it")
    model = export_network(module, contract.observation.size, contract.estimates_velocity)
    golden = record_golden(contract, TrainedPolicy(module, contract), robot_of(contract), contract.seed)
    return write_checked(out, contract, model, golden, write_card(contract), wear)


class WithVelocity(torch.nn.Module):
    """Policy with its estimate of the base's velocity: observations (N, size) -> actions (N, J), velocity (N, 2)."""

    def __init__(self, policy: Any) -> None:
        """Take a policy with a method `with_velocity`."""
        super().__init__()
        self.policy = policy

    def forward(self, observation: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return actions and velocity."""
        return self.policy.with_velocity(observation)


def export_network(module: torch.nn.Module, observation_size: int, estimates: bool = False) -> bytes:
    """Return a network as ONNX: one file, one input, any batch, no data of this machine.

    estimates: True for a second output, the velocity of the base.
    """
    import onnx

    example = torch.zeros(EXAMPLE_BATCH, observation_size)
    with _quiet(), torch.no_grad():
        program = torch.onnx.export(
            (WithVelocity(module) if estimates else module).eval(),
            (example,),
            dynamo=True,
            external_data=False,
            input_names=[INPUT],
            output_names=[OUTPUT, VELOCITY] if estimates else [OUTPUT],
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
    """Suppress the exporter's output, logs and warnings."""
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


class TrainedPolicy:
    """Policy by the modules of training: sensors and command in, joint targets out."""

    def __init__(
        self, module: torch.nn.Module, contract: Contract, num: int = 1, known_friction: np.ndarray | None = None
    ) -> None:
        """Start with an empty history.

        module: observations (num, size), float32 -> actions (num, J); known_friction: f/τ_max of each kind of joint
        [-], (kinds,) or (num, kinds), by default that of the contract. Raises `StictionError` where it does not fit.
        """
        self._contract, layout = contract, contract.observation
        self._module = (WithVelocity(module) if contract.estimates_velocity else module).eval()
        self._standing = to_tensor(contract.array("standing"))
        scale = contract.scale
        self._scale = scale if isinstance(scale, float) else to_tensor(scale)
        self._frames, self._history = FrameBuilder(layout, self._standing), History(num, layout)
        decay = layout.slow_kept
        self._slow = None if decay is None else SlowMeans(num, contract.num_joints, decay)
        self._last_action = torch.zeros(num, contract.num_joints)
        self._fresh = torch.ones(num, dtype=torch.bool)
        clock = layout.clock
        self._clock = None if clock is None else Clock(clock, contract.control_period, (num,))
        known = contract.known_friction_array if known_friction is None else known_friction
        self._known = {} if known is None else {TERM: to_tensor(friction_of_robots(layout, known, (num,)))}

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Clear the history and the last action of the robots in `mask` (bool, shape (num,)), by default of all."""
        chosen = torch.ones_like(self._fresh) if mask is None else torch.from_numpy(np.asarray(mask, dtype=bool))
        self._fresh = self._fresh | chosen
        self._last_action[chosen] = 0.0

    @torch.no_grad()
    def step(self, sensors: Sensors, command: np.ndarray) -> PolicyStep:
        """Advance by one control period; command: forward, sideways [m/s], turn [rad/s], shape (num, 3)."""
        raw = {
            "angular_velocity": to_tensor(sensors.angular_velocity),
            "roll_pitch": roll_pitch(to_tensor(sensors.quaternion)),
            "joint_position": to_tensor(sensors.joint_position),
            "joint_velocity": to_tensor(sensors.joint_velocity),
            "command": to_tensor(command),
            "last_action": self._last_action,
            FIRST_SIDE: torch.ones(len(self._fresh), 1),
            **self._known,
        }
        contract = self._contract
        if self._clock is not None:
            self._clock.step(command, self._fresh.numpy())
            raw["phase"] = to_tensor(self._clock.terms()["phase"])
        if self._slow is not None:
            position, velocity = (
                torch.from_numpy(getattr(sensors, f"joint_{name}")) for name in ("position", "velocity")
            )
            standing = torch.from_numpy(contract.array("standing"))
            # In double precision before the product, as the robot's runtime computes it.
            error = standing + torch.as_tensor(contract.scale) * self._last_action.double() - position
            raw |= self._slow.push(error, velocity, self._fresh)
        observation = self._history.push(self._frames(raw), self._fresh)
        self._fresh = torch.zeros_like(self._fresh)
        outputs = self._module(observation)
        unclipped, estimate = outputs if contract.estimates_velocity else (outputs, None)
        action = unclipped.clamp(-contract.action_clip, contract.action_clip)
        target = self._standing + self._scale * action
        if contract.compensation is not None:
            angle = to_tensor(contract.array("compensation"))
            target = compensated(target, raw["joint_position"], raw["joint_velocity"], angle, contract.push)
        # A copy: `reset` writes zeros into it, and the returned step shares the original's memory.
        self._last_action = action.clone()
        base_velocity = None if estimate is None else estimate.numpy()
        return PolicyStep(observation.numpy(), action.numpy(), target.double().numpy(), base_velocity)
