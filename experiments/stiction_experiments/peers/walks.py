"""Replay of a public walk: a simulated robot follows the targets of a real one, with and without identified friction.

The log is a folder with `state_history.csv` (stamp [ns], twelve angles [rad], rates [rad/s] and estimated torques
[N m]) and `command_history.csv` (stamp [ns], twelve target angles [rad], ...), without header, joints in Unitree's
order, as in github.com/Optimal-Robotics-Lab/unitree-go2. Nothing is fitted to it: friction is that of another robot of
its kind, identified with its legs in the air. Only the robot's start is the log's; the base is simulated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np

from stiction.core.errors import FileError
from stiction.core.files import digest_of
from stiction.core.records import column
from stiction.files.joints import JointRecord
from stiction.robots.mjcf import build_model
from stiction.robots.model import Robot
from stiction_experiments.peers.mujoco_sysid import STIFF_SOLIMP, STIFF_SOLREF

UNITREE = tuple(f"{leg}_{kind}" for leg in ("FR", "FL", "RR", "RL") for kind in ("hip", "thigh", "calf"))
"""Order of the joints in the log."""

LARGEST = 64_000_000
"""Largest file that is opened [B]."""

KP, KD = 35.0, 0.5
"""Gains of the walk [N m/rad, N m s/rad]: the estimated torques are those of 33.6 to 36.0 and 0.37 to 0.48."""

DELAY = 0.004
"""Lateness of the estimated torque against the targets [s]: 4 to 6 ms by the log's stamps."""

STEP, BEFORE, WALKED = 0.001, 1.0, 3.5
"""Step of the simulation, time for which the robot stands before its targets move, and time that is judged [s]."""


@dataclass(frozen=True)
class History:
    """Angles and targets of a walk, in the order of the robot's joints."""

    name: str
    """Name of the folder."""
    digest: str
    """SHA-256 of the file of states."""
    time: np.ndarray
    """Stamps of the angles, from the instant in which the targets begin to move [s], shape (T,)."""
    position: np.ndarray
    """Angles [rad], shape (T, J)."""
    target_time: np.ndarray
    """Stamps of the targets, from the same instant [s], shape (C,)."""
    target: np.ndarray
    """Targets [rad], each held until the next, shape (C, J)."""


@dataclass(frozen=True)
class Friction:
    """Friction of the joints of a robot, in the order of its joints."""

    name: str
    dry: np.ndarray
    """[N m], shape (J,)."""
    viscous: np.ndarray
    """[N m s/rad], shape (J,)."""


@dataclass(frozen=True)
class WalkRow:
    """Error of the joint angles of a replayed walk."""

    log: str = field(metadata=column("log"))
    friction: str = field(metadata=column("friction"))
    error: float = field(metadata=column("all joints", "rad", ".3f"))
    """Root mean square over `WALKED` of the walk [rad]."""
    hip: float = field(metadata=column("hips", "rad", ".3f"))
    thigh: float = field(metadata=column("thighs", "rad", ".3f"))
    calf: float = field(metadata=column("calves", "rad", ".3f"))
    digest: str = field(metadata=column("SHA-256 of the states"))


def read_history(folder: Path, robot: Robot) -> History:
    """Return the walk in a folder. Raises `FileError` where it is none."""
    state_time, states = _read(folder / "state_history.csv", 1 + 3 * len(UNITREE))
    target_time, commands = _read(folder / "command_history.csv", 1 + len(UNITREE))
    order = [UNITREE.index(name.removesuffix("_joint")) for name in robot.joint_names]
    target = commands[:, order]
    moves = np.flatnonzero(np.any(np.diff(target, axis=0) != 0, axis=1))
    if not len(moves):
        raise FileError(f"{folder}: got targets that never move, expected a walk")
    begin = target_time[moves[0] + 1]
    seconds = [1e-9 * (stamps - begin).astype(float) for stamps in (state_time, target_time)]
    if seconds[0][0] > -BEFORE or seconds[0][-1] < WALKED:
        raise FileError(
            f"{folder}: got {seconds[0][0]:.3g} to {seconds[0][-1]:.3g} s, expected {-BEFORE:g} to {WALKED:g} s"
        )
    digest = digest_of(folder / "state_history.csv")
    return History(folder.name, digest, seconds[0], states[:, order], seconds[1], target)


def _read(path: Path, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Return stamps [ns], shape (T,), and the numbers behind them, shape (T, N); columns: the fewest."""
    try:
        if path.stat().st_size > LARGEST:
            raise FileError(f"{path}: got {path.stat().st_size} B, expected at most {LARGEST} B")
        table = np.loadtxt(path, delimiter=",", dtype=str, ndmin=2)
        stamps, values = table[:, 0].astype(np.int64), table[:, 1:columns].astype(float)
    except (OSError, ValueError) as error:
        raise FileError(f"{path}: {error}; expected numbers without a header, stamps in nanoseconds first") from error
    if values.shape[1] != columns - 1 or not np.isfinite(values).all() or (np.diff(stamps) < 0).any():
        raise FileError(f"{path}: expected {columns} columns of finite numbers, in the order of time")
    return stamps, values


def identified_friction(records: Mapping[str, JointRecord], robot: Robot) -> Friction:
    """Return the friction that was identified with the legs in the air, over the motor's strength."""
    dry, viscous = [], []
    for name in robot.joint_names:
        record = records[name.removesuffix("_joint")]
        dry.append(record.combinations["f/k"].value)
        viscous.append(record.combinations["(B + k·kd)/k"].value - float(record.kd or 0.0))
    return Friction("identified, dry and viscous", np.array(dry), np.array(viscous))


def replay(history: History, robot: Robot, friction: Friction) -> np.ndarray:
    """Return the angles of a simulated robot under the targets of a walk [rad], a row a step from −`BEFORE` on."""
    model = build_model(robot)
    model.opt.timestep, model.opt.iterations, model.opt.ls_iterations = STEP, 100, 50
    model.dof_frictionloss[6:], model.dof_damping[6:] = friction.dry, friction.viscous
    model.dof_solref[6:], model.dof_solimp[6:] = (STIFF_SOLREF * STEP, 1.0), STIFF_SOLIMP
    # The controller is below, late as a whole; the model's own is taken out.
    model.actuator_gainprm[:], model.actuator_biasprm[:] = 0.0, 0.0
    data = mujoco.MjData(model)
    begin = np.array([np.interp(-BEFORE, history.time, angle) for angle in history.position.T])
    data.qpos[7:] = begin
    mujoco.mj_forward(model, data)
    feet = [model.geom(name).id for name in robot.foot_names]
    data.qpos[2] -= min(data.geom_xpos[foot][2] - model.geom_size[foot][0] for foot in feet)
    times = np.arange(-BEFORE, WALKED, STEP)
    rows = np.searchsorted(history.target_time, times - DELAY, "right") - 1
    limit, angles = robot.joint_values("torque_limit"), []
    for row in rows.clip(0):
        asked = KP * (history.target[row] - data.qpos[7:]) - KD * data.qvel[6:]
        data.qfrc_applied[6:] = np.clip(asked, -limit, limit)
        mujoco.mj_step(model, data)
        angles.append(data.qpos[7:].copy())
    return np.array(angles)


def error_row(history: History, robot: Robot, friction: Friction) -> WalkRow:
    """Replay a walk and return how far its angles are from the measured ones."""
    times = np.arange(-BEFORE, WALKED, STEP) + STEP
    measured = np.stack([np.interp(times, history.time, angle) for angle in history.position.T], axis=1)
    error = (replay(history, robot, friction) - measured)[times > 0]
    kinds = [error, *(error[:, robot.joints_of(kind)] for kind in ("hip", "thigh", "calf"))]
    every, hip, thigh, calf = (float(np.sqrt(np.mean(part**2))) for part in kinds)
    return WalkRow(history.name, friction.name, every, hip, thigh, calf, history.digest)


def replayed(folder: Path, robot: Robot, friction: Friction) -> list[WalkRow]:
    """Return a walk's errors without friction, with parts of what was identified, and with half and twice of it."""
    history, none = read_history(folder, robot), np.zeros(len(friction.dry))
    tried = (
        Friction("none", none, none),
        Friction("identified, dry", friction.dry, none),
        friction,
        replace(friction, name="half of it", dry=0.5 * friction.dry, viscous=0.5 * friction.viscous),
        replace(friction, name="twice of it", dry=2 * friction.dry, viscous=2 * friction.viscous),
    )
    return [error_row(history, robot, one) for one in tried]
