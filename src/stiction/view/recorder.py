"""Recordings of one viewed robot as canonical logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stiction.core.errors import LogError
from stiction.deploy.control import ControlStep, Reading
from stiction.files.contract import Contract
from stiction.files.log import JointSignals, Log, LogSetup, write_log

LONGEST = 300.0
"""Largest length of a recording [s]; it ends there by itself."""


class Recorder:
    """A recording in progress."""

    def __init__(self, contract: Contract) -> None:
        """Start; contract: of the policy on the robot."""
        self._contract = contract
        self._readings: list[Reading] = []
        self._targets: list[np.ndarray] = []

    @property
    def seconds(self) -> float:
        """Recorded time [s]."""
        return self._readings[-1].time - self._readings[0].time if self._readings else 0.0

    @property
    def full(self) -> bool:
        """True if it has its largest length."""
        return self.seconds >= LONGEST

    def add(self, step: ControlStep) -> None:
        """Add the readings of a control step."""
        self._readings.extend(step.readings)
        self._targets.extend([step.policy.target] * len(step.readings))

    def log(self) -> Log:
        """Return the log. Raises `LogError` if nothing was recorded."""
        if not self._readings:
            raise LogError("recording: got no reading, expected some; let the robot walk before the recording ends")
        contract, readings = self._contract, self._readings
        signals = {
            "position": np.array([reading.sensors.joint_position for reading in readings]),
            "velocity": np.array([reading.sensors.joint_velocity for reading in readings]),
            "target": np.array(self._targets),
            "torque": np.array([reading.joint_torque for reading in readings]),
        }
        time = np.array([reading.time for reading in readings])
        joints = {
            name: JointSignals(**{signal: values[:, number] for signal, values in signals.items()})
            for number, name in enumerate(contract.joint_names)
        }
        setups = {
            name: LogSetup(kp=kp, kd=kd, torque_limit=limit)
            for name, kp, kd, limit in zip(
                contract.joint_names, contract.kp, contract.kd, contract.torque_limit, strict=True
            )
        }
        setup = LogSetup(torque_source="motor_side", test_condition="loaded", joints=setups)
        return Log("the viewer", time - time[0], joints, setup)


def write_recording(folder: Path, log: Log) -> Path:
    """Write a log as NPZ, and its sidecar, under the first free name in a folder; return its path."""
    number = 1
    while (path := folder / f"walk-{number}.npz").exists() or path.with_suffix(".json").exists():
        number += 1
    write_log(path, log)
    return path
