"""The exported project walks: in MuJoCo behind the stand-in of Webots, and in ODE set up as Webots does it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bundles import make_bundle, make_contract
from stiction.core.rotation import uprightness
from stiction.files.bundle import shipped_bundles
from webots_build import add_headers, load_plugin, needs_compiler
from webots_files import Read, read_world
from webots_ode import WebotsOde, ode_or_skip
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


@pytest.fixture(scope="module")
def in_ode(project: Exported) -> Callable[[list[Read]], WebotsOde]:
    """What makes a world of the project in ODE, with the project's own plugin."""
    library = ode_or_skip()
    plugin = load_plugin(add_headers(project.path / "plugins/physics/rotor_inertia"))
    return lambda nodes: WebotsOde(nodes, library, plugin)


def robot_of(nodes: list[Read]) -> Read:
    """Return the robot of a world."""
    return next(node for node in nodes if node.kind == "Robot")


def share_reached(project: Exported, nodes: list[Read], physics: Physics, cfg: ControllerCfg) -> float:
    """Return the speed that the controller says it reached, over the commanded one."""
    said = walk(Robot(robot_of(nodes), 5.0, physics), project.bundle, cfg)
    assert f"{cfg.command}: done after {cfg.seconds:.2f} s, " in said
    return float(said.removesuffix(" of it").rsplit(" ", 1)[1])


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
    """If this failed, a sign, an offset or a frame in the closed loop would be wrong, whatever the recordings say."""
    nodes = read_world(project.path / "worlds/flat.wbt")
    reached = share_reached(
        project, nodes, MujocoPhysics(project, robot_of(nodes)), ControllerCfg(command, seconds=3.0)
    )
    assert 0.5 < reached < 1.5


@needs_compiler
def test_the_whole_project_walks_in_ode_as_webots_sets_it_up(
    project: Exported, in_ode: Callable[[list[Read]], WebotsOde]
) -> None:
    """If this failed, robot, plugin and controller would each be right and not fit together.

    Robot, joints, contacts and friction come from the files alone.
    """
    physics = in_ode(nodes := read_world(project.path / "worlds/flat.wbt"))
    height = physics.trunk()[0][2]
    for _ in range(60):
        physics.step({})  # nobody sets a torque: the motors hold the pose
    sunk = height - physics.trunk()[0][2]
    assert 0 < sunk < 0.01
    assert max(abs(angle) for angle in physics.angles().values()) < 0.02
    assert 0.7 < share_reached(project, nodes, physics, ControllerCfg("vx=0.5", seconds=2.6)) < 1.4


@needs_compiler
@pytest.mark.parametrize("name", ["go2", "g1"])
def test_another_robot_stands_in_ode(name: str, tmp_path: Path) -> None:
    """If this failed, axes, inertias or soles of robots that are not made of boxes would be wrong."""
    done = export_webots(make_bundle(tmp_path / "toy", make_contract(name)), tmp_path / "project")
    library = ode_or_skip()
    plugin = load_plugin(add_headers(done.path / "plugins/physics/rotor_inertia"))
    physics = WebotsOde(read_world(done.path / "worlds/flat.wbt"), library, plugin)
    height = physics.trunk()[0][2]
    for _ in range(60):
        physics.step({})  # nobody sets a torque: the motors hold the pose
    place, quaternion, _ = physics.trunk()
    assert abs(place[2] - height) < 0.01
    assert uprightness(quaternion) > 0.99
    assert max(abs(angle) for angle in physics.angles().values()) < 0.05


@needs_compiler
@pytest.mark.parametrize(("torque", "rate"), [(8.9, 0.0), (12.0, 0.675)])
def test_a_joint_in_ode_has_the_friction_and_the_rotor_of_the_files(
    project: Exported, in_ode: Callable[[list[Read]], WebotsOde], torque: float, rate: float
) -> None:
    """If this failed, friction or inertia of the files would not reach the joints.

    A knee of a robot in free fall, friction 0.2 x 45 = 9 N m. 0.4 kg, 0.24 m long and 0.035 m wide, are 0.00772 kg m²
    about the knee, the rotor is 0.0145: 12 N m give (12 - 9) / 0.0222 = 135 rad/s², in a step of 5 ms 0.675 rad/s. The
    reaction on the thigh, 3 N m, is less than the 5 N m of its friction: trunk and leg turn back as one, by little.
    """
    nodes = read_world(project.path / "worlds/flat.wbt")
    robot_of(nodes).fields["translation"] = (0.0, 0.0, 5.0)
    physics = in_ode(nodes)
    still = dict.fromkeys(physics.limits, 0.0)
    physics.step(still | {"ML_shank": torque})
    angles = physics.angles()
    assert angles.pop("ML_shank") / physics.timestep == pytest.approx(rate, rel=0.05, abs=1e-3)
    assert max(map(abs, angles.values())) < 1e-5
