"""Policies of mjlab, trained a little and written by mjlab's own exporter: our import, in our environment, reads them.

mjlab and our simulator need two environments. This one trains; the project's own interpreter, `.venv/bin/python` or the
one that STICTION_PYTHON names, imports and evaluates.
"""

from __future__ import annotations

import csv
import os
import subprocess
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("mjlab", reason="the package mjlab is not installed here; `make test-mjlab` makes its environment")

import numpy as np
import torch
from mjlab.envs import ManagerBasedRlEnv
from mjlab.rl import RslRlVecEnvWrapper
from mjlab.tasks.registry import load_env_cfg, load_rl_cfg, load_runner_cls

from stiction.deploy.observation import ObservationBuilder, Sensors
from stiction.files.bundle import read_bundle
from stiction.files.contract import Contract

ROOT = Path(__file__).parents[3]
OURS = Path(os.environ.get("STICTION_PYTHON", ROOT / ".venv/bin/python"))
ROBOTS = 4

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not OURS.exists(),
        reason="the project's own environment is not here, which has MuJoCo 4: `make test` makes it in .venv, or name "
        "its interpreter in STICTION_PYTHON",
    ),
]


def trained(maker: str, folder: Path) -> tuple[Any, Path]:
    """Return the environment of the flat Go1 task after one iteration of its PPO, and the network that it wrote."""
    import_module("stiction.exchange.mjlab.tasks")
    task = f"{maker}-Velocity-Flat-Unitree-Go1"
    cfg, agent = load_env_cfg(task, play=True), load_rl_cfg(task)
    cfg.scene.num_envs = ROBOTS
    # What the actor observes is then what the robot has.
    del cfg.events["encoder_bias"]
    env = ManagerBasedRlEnv(cfg, device="cpu")
    settings = asdict(agent) | {"logger": "tensorboard", "upload_model": False}
    wrapped = RslRlVecEnvWrapper(env, clip_actions=agent.clip_actions)
    runner = load_runner_cls(task)(wrapped, settings, str(folder), "cpu")
    runner.learn(num_learning_iterations=1)
    return env, folder / f"{folder.name}.onnx"


def ours(*arguments: object) -> str:
    """Run a program in this interpreter and return its output."""
    # Neither mjlab's packages nor its path reach the other interpreter; the code is this checkout's.
    environment = {key: value for key, value in os.environ.items() if key != "VIRTUAL_ENV"}
    environment["PYTHONPATH"] = str(ROOT / "src")
    command = [str(OURS), "-m", "stiction", *map(str, arguments)]
    ended = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=300, check=False)
    assert ended.returncode == 0, ended.stderr
    return ended.stderr


def observed(env: Any, contract: Contract, builder: ObservationBuilder, action: torch.Tensor) -> np.ndarray:
    """Return our observation of mjlab's robots, from their readings."""
    data = env.scene["robot"].data
    sensors = Sensors(
        quaternion=data.root_link_quat_w.numpy().astype(float),
        angular_velocity=data.root_link_ang_vel_b.numpy().astype(float),
        joint_position=data.joint_pos.numpy().astype(float),
        joint_velocity=data.joint_vel.numpy().astype(float),
        base_linear_velocity=data.root_link_lin_vel_b.numpy().astype(float),
    )
    command = env.command_manager.get_command("twist").numpy().astype(float)
    return builder.step(sensors, command, np.clip(action.numpy(), -contract.action_clip, contract.action_clip))


@pytest.mark.filterwarnings("ignore")
def test_a_policy_without_friction_is_imported_as_it_was_trained(tmp_path: Path) -> None:
    """Observation and targets by the imported contract are those of mjlab, over ten steps of four robots.

    The linear velocity alone differs: mjlab measures it at the site of the IMU, r from the base's origin, v + ω × r.
    """
    env, network = trained("Mjlab", tmp_path / "plain")
    told = ours("import", network, "--robot", "go1", "--preset", "mjlab", "--out", tmp_path / "bundle")
    assumed = [line.split(" assumes ")[1].split()[0] for line in told.splitlines() if " assumes " in line]
    contract = read_bundle(tmp_path / "bundle").contract
    assert assumed == ["control_period", "physics_timestep", "action_clip"]
    assert contract.imported is not None and contract.imported["assumed"] == ", ".join(assumed)
    assert contract.control_period == pytest.approx(env.step_dt)
    assert contract.decimation == env.cfg.decimation
    robot, rng = env.scene["robot"], torch.Generator().manual_seed(0)
    builder = ObservationBuilder(contract.observation, contract.array("standing"), (ROBOTS,))
    env.reset()
    lever = np.array([-0.01592, -0.06659, -0.00617])
    for _ in range(10):
        action = 0.5 * torch.randn(ROBOTS, 12, generator=rng)
        theirs = env.step(action)[0]["actor"].numpy()
        mine = observed(env, contract, builder, action)
        np.testing.assert_allclose(mine[:, 3:], theirs[:, 3:], atol=2e-4)
        turned = np.cross(robot.data.root_link_ang_vel_b.numpy(), lever)
        np.testing.assert_allclose(mine[:, :3] + turned, theirs[:, :3], atol=2e-4)
        # Their metadata have three decimals of the scale.
        targets = contract.array("standing") + contract.scale * action.numpy()
        np.testing.assert_allclose(targets, robot.data.joint_pos_target.numpy(), atol=1.5e-3)
    env.close()


@pytest.mark.filterwarnings("ignore")
def test_a_policy_with_friction_is_evaluated_at_two_levels(tmp_path: Path) -> None:
    """The whole way, from dry friction drawn in mjlab to a table of ours; after one iteration it does not walk."""
    env, network = trained("Stiction", tmp_path / "friction")
    env.close()
    ours("import", network, "--robot", "go1", "--preset", "mjlab", "--out", tmp_path / "bundle")
    walks = ("--friction-levels", 0, 0.2, "--commands", "vx=0.5", "--episodes", 1, "--seconds", 4, "--jobs", 1)
    ours("evaluate", tmp_path / "bundle", *walks, "--out", tmp_path / "results")
    with (tmp_path / "results/results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["friction_level"]) for row in rows] == [0.0, 0.2]
