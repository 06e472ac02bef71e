"""Log of one of mjlab's robots, in the form that `stiction identify` reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from mjlab.managers.recorder_manager import RecorderTerm

from stiction.core.errors import ConfigurationError, LogError
from stiction.exchange.mjlab.motors import motors_of
from stiction.files.log import JointSignals, Log, LogSetup, TestCondition, write_log

SUFFIXES = (".csv", ".npz", ".parquet")


class StictionLog(RecorderTerm):
    """Recorder: joints of one robot, a row a physics step, as a canonical log with its sidecar of gains and limits.

    The log begins at a reset and ends at the next one, after `seconds`, or when the environment closes; later episodes
    are not written. A row has angle and speed at its time, and target and torque from that time on, before the joint's
    dry friction: `motor_side`. The target is the one that its actuator has got: where mjlab delays commands by a
    constant lag, that of so many rows before; angle and speed are never delayed there.

    Parameters: `path`, a .csv, .npz or .parquet; `entity`, name of the robot; `world`, number of its environment;
    `seconds`, longest log [s]; `test_condition`, as in a sidecar, by default `in_air` on a fixed base.
    """

    def __init__(self, cfg: Any, env: Any) -> None:
        super().__init__(cfg, env)
        path, entity, self.world, self.seconds, condition = _parameters(**cfg.params)
        self.path = path
        self.asset = env.scene[entity]
        self.motors = motors_of(env, self.asset)
        if not 0 <= self.world < env.num_envs:
            raise ConfigurationError(f"StictionLog: got world {self.world}, expected 0 to {env.num_envs - 1}")
        if late := [name for name, motor in self.motors.items() if motor.lag is None]:
            raise ConfigurationError(
                f"StictionLog: joint {late[0]!r}: got a command delay that varies, expected a constant one: set "
                "delay_min_lag to delay_max_lag"
            )
        self.condition = condition or ("in_air" if self.asset.is_fixed_base else None)
        self.joints = [motor.joint for motor in self.motors.values()]
        self.rows: list[np.ndarray] = []
        self.state: np.ndarray | None = None
        self.written = False
        # Recorders are called once a control step, when the torques within it are gone; this is called at each physics
        # step, when the forces are still those of its beginning.
        self._update = env.scene.update
        env.scene.update = self._after_physics_step

    def _after_physics_step(self, dt: float) -> None:
        """Add a row: angle and speed of before the step, target and torque of the step."""
        self._update(dt)
        if self.written or self.state is None:
            return
        data = self.asset.data
        self.rows.append(np.concatenate([self.state, self._now(data.joint_pos_target, data.qfrc_actuator)]))
        self.state = self._now(data.joint_pos, data.joint_vel)
        if len(self.rows) * self._env.physics_dt >= self.seconds:
            self._write()

    def _now(self, *tensors: Any) -> np.ndarray:
        """Return signals of the robot's driven joints, one after the other, shape (signals × joints,)."""
        return np.concatenate([tensor[self.world, self.joints].double().cpu().numpy() for tensor in tensors])

    def record_post_reset(self, env_ids: Any) -> None:
        """Begin the log at a reset, after writing an unfinished one."""
        if self.world in env_ids.tolist():
            self._write()
            self.state = self._now(self.asset.data.joint_pos, self.asset.data.joint_vel)

    def record_pre_reset(self, env_ids: Any) -> None:
        """End the log where the robot is about to be reset."""
        if self.world in env_ids.tolist():
            self._write()

    def close(self) -> None:
        """Write the rest of the log."""
        self._write()
        self._env.scene.update = self._update

    def _write(self) -> None:
        """Write log and sidecar, once; a single row is not a log, and the next episode is written instead."""
        if self.written or len(self.rows) < 2:
            self.rows.clear()
            return
        self.written = True
        position, velocity, target, torque = np.split(np.array(self.rows), 4, axis=1)
        for i, motor in enumerate(self.motors.values()):
            if motor.lag:
                target[:, i] = np.concatenate([np.full(motor.lag, target[0, i]), target[:, i]])[: len(target)]
        signals = {
            name: JointSignals(position[:, i], velocity[:, i], target[:, i], torque[:, i])
            for i, name in enumerate(self.motors)
        }
        setups = {
            name: LogSetup(kp=motor.kp, kd=motor.kd, torque_limit=motor.limit, axis=motor.axis)
            for name, motor in motors_of(self._env, self.asset, self.world).items()
        }
        setup = LogSetup(torque_source="motor_side", test_condition=self.condition, joints=setups)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_log(self.path, Log(self.path.name, np.arange(len(self.rows)) * self._env.physics_dt, signals, setup))


def _parameters(
    path: str | Path,
    entity: str = "robot",
    world: int = 0,
    seconds: float = 60.0,
    test_condition: TestCondition | None = None,
) -> tuple[Path, str, int, float, TestCondition | None]:
    """Return the parameters of a `StictionLog`, with their defaults; raise `StictionError` for invalid values."""
    if Path(path).suffix.lower() not in SUFFIXES:
        raise LogError(f"StictionLog: got {Path(path).name}, expected a file that ends in {', '.join(SUFFIXES)}")
    if not seconds > 0:
        raise ConfigurationError(f"StictionLog: got {seconds} seconds, expected a positive number")
    return Path(path), entity, world, seconds, test_condition
