"""The exported controller against a stand-in of Webots: the policy's own targets, torques, refusals, and a walk."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from bundles import make_bundle, make_contract
from stiction.core.errors import StictionError
from stiction.deploy.check import TOLERANCE, check_bundle
from stiction.files.bundle import Bundle, shipped_bundles
from stiction.files.golden import Golden
from stiction.joints.pd import PDGains, pd_torque
from webots_files import Read, read_world
from webots_stand_in import Playback, Robot

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to export to Webots")

from stiction.exchange.webots.export import WebotsCfg, export_webots

SHIPPED = "saturn_lite-flat-deception-0.2"


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project of a shipped bundle, whose golden vectors torch and MuJoCo recorded."""
    return export_webots(shipped_bundles()[SHIPPED], tmp_path_factory.mktemp("webots") / "project").path


@pytest.fixture(scope="module")
def program(project: Path) -> ModuleType:
    """Return the controller program of the project, as started by Webots' launcher."""
    path = project / "controllers/stiction_policy/stiction_policy.py"
    module = importlib.util.module_from_spec(spec := importlib.util.spec_from_file_location("exported", path))
    sys.modules["exported"] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def bundle(project: Path) -> Bundle:
    """The bundle within the project."""
    return check_bundle(project / "controllers/stiction_policy/bundle").bundle


def robot_in(project: Path, world: str = "flat") -> Read:
    """Return the robot of one of the project's worlds."""
    return next(node for node in read_world(project / f"worlds/{world}.wbt") if node.kind == "Robot")


def playback(bundle: Bundle, record: Golden) -> Playback:
    """Return physics that repeats recorded sensors."""
    contract = bundle.contract
    standing = contract.array("standing")
    return Playback(contract.joint_names, standing, contract.physics_timestep, contract.decimation, record)


def walked_steps(golden: Golden) -> int:
    """Return how many steps were walked; behind them are readings that no walk has."""
    return len(golden) if golden.walked is None else int(golden.walked.sum())


def walks(golden: Golden) -> list[tuple[int, Golden]]:
    """Cut golden vectors where the history starts anew: number of the first step, and the steps."""
    end = walked_steps(golden)
    starts = [*np.flatnonzero(golden.reset[:end]), end]
    names = [name for name, array in vars(golden).items() if name != "joint_names" and array is not None]
    return [
        (first, replace(golden, **{name: getattr(golden, name)[first:end] for name in names}))
        for first, end in pairwise(starts)
    ]


def test_the_targets_are_the_golden_vectors(
    project: Path, program: ModuleType, bundle: Bundle, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The controller computes the targets of the golden vectors, at their rates."""
    golden, contract = bundle.golden, bundle.contract
    walked = slice(0, walked_steps(golden))
    targets, torques = np.full_like(golden.target, np.nan), np.full_like(golden.target, np.nan)
    original = program.PolicyLoop.torque
    for first, record in walks(golden):

        def torque(self, sensors, command, first=first):
            """Set the recorded command and last action, as `stiction verify` does; store the result."""
            due, now = self.due, first + self.steps // contract.decimation
            result = original(self, sensors, golden.command[now])
            if due:
                targets[now], torques[now] = self.target, result
                self.policy.take_over(golden.action[now])
            return result

        monkeypatch.setattr(program.PolicyLoop, "torque", torque)
        robot = Robot(robot_in(project), 5.0, playback(bundle, record))
        seconds = len(record) * contract.control_period + 1
        assert program.walk(robot, bundle, program.ControllerCfg(seconds=seconds)).startswith(
            "vx=0.5: stopped by Webots"
        )
    assert walked_steps(golden) >= 500
    assert np.abs(targets - golden.target)[walked].max() <= TOLERANCE
    for j, (kp, kd, limit) in enumerate(zip(contract.kp, contract.kd, contract.torque_limit, strict=True)):
        wanted = pd_torque(
            PDGains(kp, kd, limit), targets[:, j], golden.joint_position[:, j], golden.joint_velocity[:, j]
        )
        np.testing.assert_allclose(torques[walked, j], wanted[walked], atol=1e-9)
    assert (np.abs(torques[walked]) == contract.array("torque_limit")).any()  # the clip is among what was compared


def test_the_policy_acts_once_a_period_and_the_joint_controller_at_every_step(
    project: Path, program: ModuleType, bundle: Bundle
) -> None:
    """The policy acts once per control period, the joint controller at every physics step."""
    (_, record), *_ = walks(bundle.golden)
    loop = program.PolicyLoop(bundle.contract, program.load_policy(bundle.contract, bundle.policy))
    robot = Robot(robot_in(project), 5.0, playback(bundle, record))
    devices, targets, torques = program.Devices(robot, bundle.contract), [], []
    for _ in range(1 + 2 * bundle.contract.decimation):
        robot.step(5)
        torques.append(loop.torque(devices.sense(), np.zeros(3)))
        targets.append(loop.target)
    assert [np.array_equal(a, b) for a, b in pairwise(targets)] == [*[True] * 3, False] * 2
    assert not any(np.array_equal(a, b) for a, b in pairwise(torques))


def test_a_toy_robot_with_other_gains_is_driven_by_its_contract(
    program: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A toy robot with other gains is driven with its contract's gains."""
    contract = make_contract("go2@kp=0.25", control_period=0.01, decimation=2)  # kp 10 and, by the root of it, kd 0.5
    done = export_webots(make_bundle(tmp_path / "toy", contract), tmp_path / "project", WebotsCfg(0.1))
    assert "to 3.1 |" in (done.path / "README.md").read_text()
    (_, record), *_ = walks(done.bundle.golden)
    seen = []
    original = program.PolicyLoop.torque

    def spy(self, sensors, command):
        """Set the recorded command; store the result."""
        due, torque = self.due, original(self, sensors, record.command[0])
        seen.append((due, torque, self.target))
        return torque

    monkeypatch.setattr(program.PolicyLoop, "torque", spy)
    physics = playback(done.bundle, record)
    exact = program.ControllerCfg(seconds=0.2)
    program.walk(Robot(robot_in(done.path), 5.0, physics), done.bundle, exact)
    targets = [target for due, _, target in seen if due]
    assert len(targets) == 20
    np.testing.assert_allclose(targets, record.target[:20], atol=TOLERANCE)
    wanted = np.clip(10 * (record.target[0] - record.joint_position[0]) - 0.5 * record.joint_velocity[0], -23.7, 23.7)
    np.testing.assert_allclose(seen[0][1][0], wanted[0], atol=1e-9)


def spied(program: ModuleType, monkeypatch: pytest.MonkeyPatch, note: Callable) -> list[np.ndarray]:
    """Return the list that receives a note on sensors and command of every step."""
    seen, original = [], program.PolicyLoop.torque
    monkeypatch.setattr(
        program.PolicyLoop,
        "torque",
        lambda self, sensors, command: seen.append(note(sensors, command)) or original(self, sensors, command),
    )
    return seen


def test_a_fall_ends_the_walk_and_is_said(project: Path, program: ModuleType, bundle: Bundle) -> None:
    """A fall ends the walk with a message."""
    (_, record), *_ = walks(bundle.golden)
    angle = np.where(np.arange(len(record)) < 10, np.radians(59), np.radians(61))
    rolled = np.stack([np.cos(angle / 2), np.sin(angle / 2), *np.zeros((2, len(record)))], -1)
    physics = playback(bundle, replace(record, quaternion=rolled))
    message = program.walk(Robot(robot_in(project), 5.0, physics), bundle, program.ControllerCfg("stand", seconds=3.0))
    # 0.185 s: between the ninth and the tenth control step, 37 of 5 ms.
    assert message.startswith("stand: fell after 0.18")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda robot: setattr(robot, "timestep", 4.0), "basicTimeStep is 4 ms"),
        (lambda robot: robot.devices.pop("ML_thigh"), "no device 'ML_thigh'"),
        (lambda robot: robot.devices.pop("gyro"), "no device 'gyro'"),
        (lambda robot: setattr(robot.devices["FL_shank"], "_limit", 40.0), "FL_shank has a maxTorque of 40"),
        (lambda robot: setattr(robot, "plugin", False), "rotor_inertia says nothing"),
        (lambda robot: robot.physics.record.joint_position.__setitem__((3, 5), np.nan), "not finite"),
        (lambda robot: robot.physics.record.angular_velocity.__setitem__((3, 1), np.nan), "not finite"),
    ],
)
def test_what_does_not_fit_is_refused(project: Path, program: ModuleType, bundle: Bundle, change, message: str) -> None:
    """Rejects a robot without rotor inertia, and another robot."""
    (_, record), *_ = walks(bundle.golden)
    copy = replace(record, **{name: getattr(record, name).copy() for name in ("joint_position", "angular_velocity")})
    robot = Robot(robot_in(project), 5.0, playback(bundle, copy))
    change(robot)
    with pytest.raises(StictionError, match=message):
        program.walk(robot, bundle, program.ControllerCfg(seconds=1.0))


def test_the_program_runs_without_torch_and_without_a_simulator(project: Path, tmp_path: Path) -> None:
    """The whole program runs without torch and MuJoCo, as it is started."""
    (tmp_path / "controller.py").write_text(FAKE.format(project=str(project)))
    argv = [str(project / "controllers/stiction_policy/stiction_policy.py"), "--seconds", "3", "--command", "vx=0.3"]
    path = [str(tmp_path), str(Path(__file__).parents[2] / "helpers"), *sys.path]
    code = START.format(path=path, blocked=BLOCKED, argv=argv)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "vx=0.3: done after 3.00 s, 0.000 along the command, 0.00 of it\n"


START = """
import runpy, sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {blocked}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.path[:] = {path}
sys.meta_path.insert(0, Refuse())
sys.argv = {argv}
runpy.run_path(sys.argv[0], run_name="__main__")
"""
"""Starts the program as Webots' launcher does, where importing some packages fails."""

BLOCKED = ["torch", "mujoco", "onnx", "rsl_rl", "tensordict"]
"""Packages that cannot be imported where the program runs."""

FAKE = """
from pathlib import Path
from stiction.files.bundle import read_bundle
from webots_files import read_world
from webots_stand_in import Playback, Robot as StandIn

def Robot():
    project = Path({project!r})
    bundle = read_bundle(project / "controllers/stiction_policy/bundle")
    contract = bundle.contract
    robot = next(node for node in read_world(project / "worlds/flat.wbt") if node.kind == "Robot")
    physics = Playback(contract.joint_names, contract.array("standing"), 0.005, 4, bundle.golden)
    return StandIn(robot, 5.0, physics)
"""
"""The module `controller` that Webots' launcher would put on the path."""
