"""Create and validate a training run: friction, robot and nominal joints are checked before a folder is made."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.decode import from_plain
from stiction.core.errors import ConfigurationError, EngineError
from stiction.core.extras import require
from stiction.core.files import digest_of
from stiction.engines.batch import EngineBatch
from stiction.engines.catalog import missing_engine
from stiction.files.bam import load_joints
from stiction.files.joint_map import mapped, refuse_alone
from stiction.joints.friction import has_coefficient
from stiction.learning.config import TrainCfg
from stiction.learning.ranks import ALONE, Ranks
from stiction.learning.run import RunDirectory
from stiction.robots.catalog import find_robot
from stiction.robots.mirror import RobotMirror, mirrored_kinds, robot_mirror
from stiction.robots.model import Robot
from stiction.robots.named import check_named
from stiction.robots.physics import EXACT
from stiction.robots.sliders import weak_friction
from stiction.sim.fleet import Fleet
from stiction.task.friction import FrictionCfg
from stiction.task.load_law import load_warnings, take_coefficients
from stiction.task.randomization import identified_joints
from stiction.task.task_fleet import Device, find_device, host_reason


def why_task_on_host(cfg: TrainCfg) -> str | None:
    """Return the reason why the task of a training stays on the host, see `host_reason`; None on the device."""
    return host_reason(cfg.task, cfg.actuator is not None)


def find_simulator(cfg: TrainCfg, gpu: int = 0) -> Device:
    """Return the simulator of a training; `gpu`: number of the one to use, if any.

    Raises `StictionError` without such a device or engine, `ModuleNotFoundError` without its extra.
    """
    if cfg.engine == "mujoco":
        return find_device(cfg.device, cfg.contacts, gpu, on_host=why_task_on_host(cfg) is not None)
    robot = find_robot(cfg.task.robot)
    if why := missing_engine(cfg.engine, robot):
        raise EngineError(why)
    return Device("cpu", partial(EngineBatch, cfg.engine, robot))


Say = Callable[[str], None]

BIPED = (
    "note: a biped that meets friction from the first iteration on may not begin to walk; a G1 did with --set "
    "task.friction.begin=0.4, and --teacher.iterations 1500 in place of 440"
)
"""Line for who trains a biped with friction from the first iteration on."""


def begin_run(
    out: Path,
    cfg: TrainCfg,
    command: str,
    joint_map: tuple[str, ...] = (),
    say: Say = lambda line: None,
    ranks: Ranks = ALONE,
) -> tuple[RunDirectory, TrainCfg]:
    """Make the folder of a new run; return it with the configuration that it trains.

    joint_map: RECORDED=JOINT pairs for `cfg.joints`. Raises `StictionError`, before, for what cannot be trained.
    """
    if cfg.logger != "tensorboard":
        require(cfg.logger)
    _check_friction(cfg.task.friction)
    cfg = held_at_rest(cfg, say)
    robot = find_robot(cfg.task.robot)
    check_named(robot)
    cfg.task.randomization.check_robot(robot)
    cfg.check_memory(robot)
    cfg = replace(cfg, task=replace(cfg.task, rewards=cfg.task.rewards.for_robot(robot)))
    cfg.task.rewards.terms_for(robot)  # rejects unknown terms
    find_simulator(cfg, ranks.local)
    if cfg.device != "cpu" and (why := why_task_on_host(cfg)):
        say(f"the task of this training stays on the host, only physics and networks are on {cfg.device}: {why}")
    ranks.share(cfg.num_envs)
    if not ranks.alone and cfg.method.algorithm is not None:
        raise ConfigurationError(f"--method {cfg.task.friction.method} trains in one process; leave torchrun out")
    mirror = None if cfg.symmetry == "none" else robot_mirror(robot)
    if mirror is not None and (cfg.task.known_friction or cfg.task.estimated_friction):
        mirrored_kinds(robot, mirror)
    for note in cfg.method.notes(cfg):
        say(note)
    if len(robot.feet) == 2 and cfg.task.friction.schedule[0].range[1] > 0:
        say(BIPED)
    refuse_alone(joint_map, cfg.joints)
    identified = nominal_of(cfg.joints, cfg.task.robot, joint_map, cfg.task.friction, say)
    _check_own_friction(cfg, robot, identified)
    if identified is not None and mirror is not None:
        share_damping(identified["values"], robot, mirror, say)
    if line := weak_friction(robot, cfg.task.physics, cfg.task.timestep, _lightest_rotors(cfg, robot, identified)):
        say(f"warning: {line}")
    return RunDirectory.create(out, cfg, command, identified, ranks.size), cfg


def held_at_rest(cfg: TrainCfg, say: Say) -> TrainCfg:
    """Return a configuration whose joints are held by rows where sliders would not hold them at rest.

    A slider swings when its torque changes, and a joint that swings has its friction in motion.
    """
    friction, physics = cfg.task.friction, cfg.task.physics.friction
    if not cfg.task.physics.plastic or not friction.joint_law.numbers or not friction.draws_law:
        return cfg
    say(f"--physics rows, not {physics}: sliders let a joint go at its friction in motion, whatever holds it at rest")
    return replace(cfg, task=replace(cfg.task, physics=EXACT))


def _lightest_rotors(cfg: TrainCfg, robot: Robot, identified: dict[str, Any] | None) -> np.ndarray:
    """Return the smallest rotor inertia that training draws of each joint [kg m²], (joints,)."""
    nominal = robot.joint_values("armature")
    # A joint that was not identified is None, and has the robot's value.
    estimates = nominal if identified is None else np.array(identified["values"]["armature"], float)
    return cfg.task.randomization.armature[0] * np.where(np.isnan(estimates), nominal, estimates)


def _check_friction(friction: FrictionCfg) -> None:
    """Reject a training with friction whose level or range is zero."""
    if friction.has_friction or not friction.requests_friction:
        return
    if friction.level == 0.0:
        raise ConfigurationError(
            f"--method {friction.method} at --friction-level 0 trains without friction; "
            "use --method none, or a level above 0"
        )
    raise ConfigurationError(
        f"--method {friction.method} with a range, mixture or spread that ends at 0 trains without friction; "
        "use --method none, or an upper end above 0"
    )


def _check_own_friction(cfg: TrainCfg, robot: Robot, identified: dict[str, Any] | None) -> None:
    """Reject multiples of the joints' nominal friction where that is not known."""
    friction = cfg.task.friction
    if friction.level is not None or not friction.draws_law or has_coefficient(friction.law):
        return
    estimates = () if identified is None else identified["values"]["frictionloss"]
    if not robot.joint_values("frictionloss").any() and not any(estimates):
        raise ConfigurationError(
            f"--method {friction.method} draws multiples of the joints' nominal friction, and that of {robot.name} is "
            "not known; add --friction-level 0.2 or --joints, or use --method none"
        )


def with_friction(cfg: TrainCfg, training: Mapping[str, Any], where: str) -> TrainCfg:
    """Return the configuration with the friction that a `training.json` proposes; `where`: its name, for messages."""
    friction = from_plain(FrictionCfg, training["friction"], f"{where}: friction")
    return replace(cfg, task=replace(cfg.task, friction=friction))


def nominal_of(
    file: str | None, robot: str, pairs: tuple[str, ...], friction: FrictionCfg, say: Say
) -> dict[str, Any] | None:
    """Return the nominal joints in a `joints.json`, with its name and hash; name values unused with `friction`."""
    if file is None:
        return None
    path, spec = Path(file), find_robot(robot)
    limits = spec.joint_values("torque_limit")
    records = mapped(load_joints(path), pairs, spec.joint_names)
    joints = identified_joints(records, spec.joint_names, Fleet(spec, 1).link_inertia(), limits)
    values = {name: list(getattr(joints, name)) for name in ("armature", "damping", "frictionloss")}
    header = {"file": path.name, "sha256": digest_of(path), "values": values}
    if friction.level is None and friction.has_friction and has_coefficient(friction.law):
        values["load_coefficient"], header["load_coefficient"] = take_coefficients(records, spec, friction.law)
        for line in header["load_coefficient"]:
            say(line)
        # With the coefficients taken over, those of `load_warnings` do not hold.
        warnings = joints.warnings
    else:
        warnings = (*joints.warnings, *load_warnings(records, spec, friction))
    say(_sources(values, spec, path.name))
    for warning in warnings:
        say(f"warning: {warning}")
    return header


def share_damping(values: dict[str, list[Any]], robot: Robot, mirror: RobotMirror, say: Say) -> None:
    """Give a joint and its mirror image their mean viscous friction where one has none, in place.

    An estimate below zero counts as none, and a symmetric training draws multiples. values: as of `nominal_of`.
    """
    known = np.array(values["damping"], float)
    damping = np.where(np.isnan(known), robot.joint_values("damping"), known)
    image = damping[mirror.joints]
    for joint in np.flatnonzero((damping == 0.0) & (image != 0.0)).tolist():
        other, mean = int(mirror.joints[joint]), float(image[joint]) / 2.0
        values["damping"][joint] = values["damping"][other] = mean
        say(
            f"warning: viscous friction was found in {robot.joint_names[other]} and none in its mirror image "
            f"{robot.joint_names[joint]}: both have the mean, {mean:.3g} N m s/rad; with their own: --symmetry none"
        )


def _sources(values: Mapping[str, list[Any]], robot: Robot, file: str) -> str:
    """Return, in words, the values that joints took from a file; values: field -> of each joint, None: not known."""
    taken = [
        tuple(name for name, known in values.items() if known[number] is not None) for number in range(robot.num_joints)
    ]
    of_kind: dict[str, set[tuple[str, ...]]] = {}
    for joint, fields in zip(robot.joints, taken, strict=True):
        of_kind.setdefault(joint.kind, set()).add(fields)
    groups: dict[tuple[str, ...], dict[str, None]] = {}
    for joint, fields in zip(robot.joints, taken, strict=True):
        groups.setdefault(fields, {})[joint.kind if len(of_kind[joint.kind]) == 1 else joint.name] = None
    parts = [
        f"{', '.join(names)}: {', '.join(fields) if fields else 'nothing'} from {file}"
        for fields, names in sorted(groups.items(), reverse=True)
    ]
    return f"{'; '.join(parts)}; all else as in the robot {robot.name}"
