"""Turns a trained student into a policy bundle. Needs torch and onnx."""

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

from stiction.deploy.check import BundleCheck, check_bundle
from stiction.deploy.policy import INPUT, OUTPUT
from stiction.formats.bundle import BundleError, write_bundle
from stiction.formats.contract import Contract
from stiction.formats.errors import StictionError
from stiction.formats.friction import has_coefficient
from stiction.formats.joints import load_joints
from stiction.formats.known_friction import bench_friction, joint_kinds
from stiction.formats.wear import WearModel, read_wear
from stiction.joints.pd import COMPENSATION_WIDTH
from stiction.robots.catalog import find_robot
from stiction.transfer.card import write_card
from stiction.transfer.golden import record_golden
from stiction.transfer.known_friction import nominal_known

if TYPE_CHECKING:
    import torch

    from stiction.rma.config import TrainCfg
    from stiction.rma.run import RunDirectory

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
        raise StictionError(
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
        raise StictionError(
            "this policy is not told its joints' friction, --joints would have no effect; leave it out, or train with "
            "--task.known-friction"
        )
    file, limits = load_joints(path), contract.array("torque_limit")
    nominal = nominal_known(contract, find_robot(contract.robot))
    found = bench_friction(file, contract.joint_names, limits, nominal)
    if len(found.missing) == contract.num_joints:
        raise StictionError(
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
        raise StictionError(f"cannot read {path}: {error.strerror or error}") from error
    if model.student != run.student_digest():
        raise StictionError(f"{path} is of another student than {run.path}; make it with `stiction study adaptation`")
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
        friction_law=law.name,
        friction_level=level,
        friction_range=(low * level, high * level),
        stribeck=(law.static_ratio, law.stribeck_velocity) if law.name == "stribeck" else None,
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
    from stiction.transfer.twin import TrainedPolicy

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
