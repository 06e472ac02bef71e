"""The exported project walks, in MuJoCo behind the stand-in of Webots."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.files.bundle import shipped_bundles
from webots_files import Read, read_world
from webots_stand_in import Physics, Robot

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to export to Webots")

from stiction.exchange.policies.exporter import Exported
from stiction.exchange.webots.controller import ControllerCfg, walk
from stiction.exchange.webots.export import WebotsCfg, export_webots
from stiction.robots.catalog import find_robot
from stiction.sim.fleet import Fleet


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Exported:
    """A shipped policy in a world whose joints have 20 % of their torque limits as dry friction."""
    bundle = shipped_bundles()["saturn_lite-flat-deception-0.2"]
    return export_webots(bundle, tmp_path_factory.mktemp("webots") / "project", WebotsCfg(friction_level=0.2))


def robot_of(nodes: list[Read]) -> Read:
    """Return the robot of a world."""
    return next(node for node in nodes if node.kind == "Robot")


def share_reached(project: Exported, nodes: list[Read], physics: Physics, cfg: ControllerCfg) -> float:
    """Return the speed that the controller says it reached, over the commanded one."""
    message = walk(Robot(robot_of(nodes), 5.0, physics), project.bundle, cfg)
    assert f"{cfg.command}: done after {cfg.seconds:.2f} s, " in message
    return float(message.removesuffix(" of it").rsplit(" ", 1)[1])


class MujocoPhysics:
    """The robot in MuJoCo, moved by torques; friction as the world says."""

    def __init__(self, project: Exported, robot: Read) -> None:
        """Stand it up."""
        contract, spec = project.bundle.contract, find_robot(project.robot)
        self.names, self.fleet = spec.joint_names, Fleet(spec, 1, contract.physics_timestep, 1)
        self.fleet.friction[:] = [node["staticFriction"] for node in robot.every("HingeJointParameters")]
        self.fleet.damping[:], self.fleet.armature[:] = contract.array("damping"), contract.array("armature")
        self.fleet.set_const(np.arange(1))
        self.command = self.fleet.drive_by_torque()
        self.fleet.reset(np.arange(1))

    def step(self, torque: dict[str, float]) -> bool:
        """Take a physics step; without torques yet the joints are held, as Webots holds them."""
        fleet = self.fleet
        hold = 100 * (fleet.standing - fleet.joint_position[0]) - 2.5 * fleet.joint_velocity[0]
        self.command[0] = [torque[name] for name in self.names] if torque else hold
        fleet.substep()
        return True

    def angles(self) -> dict[str, float]:
        """Return the angles from the standing pose."""
        return dict(zip(self.names, (self.fleet.joint_position[0] - self.fleet.standing).tolist(), strict=True))

    def trunk(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return place, orientation and angular velocity."""
        fleet = self.fleet
        return fleet.base_position[0].copy(), fleet.base_quaternion[0].copy(), fleet.base_angular_velocity[0].copy()


@pytest.mark.parametrize("command", ["vx=-0.5", "wz=0.5"])
def test_the_controller_walks_and_turns_in_mujoco(project: Exported, command: str) -> None:
    """The controller walks and turns in MuJoCo's closed loop."""
    nodes = read_world(project.path / "worlds/flat.wbt")
    reached = share_reached(
        project, nodes, MujocoPhysics(project, robot_of(nodes)), ControllerCfg(command, seconds=3.0)
    )
    assert 0.5 < reached < 1.5
