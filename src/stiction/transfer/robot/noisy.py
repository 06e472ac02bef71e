"""The training's sensor noise on a robot whose own sensors are perfect: what a policy reads is disturbed."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from stiction.deploy.observation import Sensors
from stiction.locomotion.config import NoiseCfg
from stiction.transfer.robot.port import JointCommand, Port, Reading
from stiction.transfer.rollout import disturbed, drawn_width


class Noisy:
    """A `Port` before another one. Each `read` draws anew, as each control step of the training does."""

    def __init__(self, port: Port, noise: NoiseCfg, generator: np.random.Generator) -> None:
        """Disturb what `port` reads."""
        self._port, self._noise, self._generator = port, noise, generator
        self.joint_names, self.period = port.joint_names, port.period

    def read(self) -> Reading:
        """Return what came last, with noise."""
        reading = self._port.read()
        drawn = self._generator.uniform(-1.0, 1.0, (1, drawn_width(len(self.joint_names))))
        true = Sensors(*(getattr(reading.sensors, part.name)[None] for part in fields(Sensors)))
        noisy = disturbed(true, self._noise, drawn)
        return replace(reading, sensors=Sensors(*(getattr(noisy, part.name)[0] for part in fields(Sensors))))

    def exchange(self, command: JointCommand) -> Reading:
        """Send a command; what comes back is not disturbed: joint controllers see it, no policy."""
        return self._port.exchange(command)
