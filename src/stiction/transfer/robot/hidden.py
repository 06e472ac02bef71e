"""What a virtual robot really is, group by group: nobody who trains, identifies or drives may read it.

Those know the robot as one knows a real one: by its data sheet (`RobotSpec`), by the logs of its bench, and by what its
sensors say through a `Port`. Only this folder and who referees an evaluation hold a `Hidden`.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from stiction.formats.errors import StictionError
from stiction.robots.spec import RobotSpec
from stiction.transfer.engines.engine import Body
from stiction.transfer.robot.friction import FrictionShape
from stiction.transfer.robot.motor import Motors
from stiction.transfer.robot.sensors import SensorErrors


@dataclass(frozen=True)
class Masses:
    """How the links differ from the drawing. The same link weighs the same in every leg."""

    base: float = 1.0
    """Mass of the trunk over the drawing's [1]; inertia follows."""
    hip_link: float = 1.0
    """Of the hip's link [1]."""
    thigh_link: float = 1.0
    """Of the thigh [1]."""
    shank_link: float = 1.0
    """Of the shank [1]."""
    base_com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Centre of mass of the trunk, in its frame [m]."""


@dataclass(frozen=True)
class Delays:
    """How late signals arrive. The joint controllers sit at the motors: their own loop knows neither delay."""

    command: float = 0.0
    """From the computer to the motor controllers [s]."""
    sensors: float = 0.0
    """From encoders and IMU to the computer [s]."""


@dataclass(frozen=True)
class Hidden:
    """One robot. Each field is a group that an experiment can have real or perfect."""

    friction: FrictionShape
    """How dry friction differs from joint to joint; how much there is, is the level's business."""
    motors: Motors
    """Motors, rotors and battery."""
    delays: Delays
    """Of commands and sensors."""
    gears: np.ndarray
    """Backlash of each joint: the whole width of its gap [rad], shape (J,)."""
    sensors: SensorErrors
    """Errors of encoders, current sensors and IMU."""
    masses: Masses
    """Of the links."""

    @classmethod
    def perfect(cls, num_joints: int) -> Hidden:
        """Return the robot of the data sheet."""
        return cls(
            friction=FrictionShape.perfect(num_joints),
            motors=Motors.perfect(num_joints),
            delays=Delays(),
            gears=np.zeros(num_joints),
            sensors=SensorErrors.perfect(num_joints),
            masses=Masses(),
        )

    def only(self, groups: Collection[str]) -> Hidden:
        """Return the robot with these groups as they are and all others perfect.

        Raises:
            StictionError: there is no such group.

        """
        if unknown := sorted(set(groups) - set(GROUPS)):
            raise StictionError(f"group {unknown[0]!r} of a virtual robot: expected some of {', '.join(GROUPS)}")
        perfect = Hidden.perfect(len(self.gears))
        return replace(perfect, **{name: getattr(self, name) for name in groups})

    def body(self, spec: RobotSpec, fixed: bool = False) -> Body:
        """Return the robot as an engine must build it; `spec`: by the data sheet, `fixed`: bolted to a bench."""
        masses = {name: getattr(self.masses, name) for name in ("base", "hip_link", "thigh_link", "shank_link")}
        links = {name: replace(link := getattr(spec, name), mass=link.mass * by) for name, by in masses.items()}
        return Body(
            spec=replace(spec, **links),
            armature=spec.joint_values("armature") * self.motors.armature,
            damping=spec.joint_values("damping") * self.motors.damping,
            base_com=self.masses.base_com,
            fixed=fixed,
        )


GROUPS = ("friction", "motors", "delays", "gears", "sensors", "masses")
"""Names of the groups: the fields of `Hidden`."""
