"""Training in torch and the runtime in NumPy compute the same numbers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bundles import make_contract
from stiction.deploy.observation import ObservationBuilder, Sensors
from stiction.deploy.plausibility import RULES
from stiction.deploy.policy import Network, load_policy
from stiction.files.contract import read_contract
from stiction.files.observation import proprioception
from stiction.learning.config import StudentCfg, TeacherCfg, TrainCfg
from stiction.task.config import CommandCfg, NoiseCfg, TaskCfg

torch = pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to train")
pytest.importorskip("rsl_rl", reason="the package rsl_rl, of the extra 'train', is needed to train")

SILENT = NoiseCfg(0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(("robot", "slow"), [("saturn_lite", None), ("go1", None), ("go1", 1.0)])
def test_the_runtime_builds_the_observation_of_training(robot: str, slow: float | None) -> None:
    """The observations are equal also in the environment's resets and commands, which golden vectors do not contain."""
    from stiction.task.env import LocomotionEnv

    env = LocomotionEnv(TaskCfg(robot=robot, noise=SILENT, episode=0.5, slow_means=slow), num_envs=4, seed=1)
    builder = ObservationBuilder(env.layout, env.fleet.standing, (4,), action_scale=env.spec.action_scale)
    generator = np.random.default_rng(0)
    resets = 0
    observation = env.get_observations()["history"].numpy()
    for _ in range(40):
        fleet = env.fleet
        sensors = Sensors(
            fleet.base_quaternion,
            fleet.base_angular_velocity,
            fleet.joint_position + env.randomizer.draws.encoder_offset.numpy(),
            fleet.joint_velocity,
        )
        built = builder.step(sensors, env.commands.value.numpy(), env.last_action.numpy())
        np.testing.assert_allclose(built, observation, atol=2e-6, rtol=2e-6)
        actions = torch.from_numpy(generator.uniform(-6.0, 6.0, (4, env.num_actions)).astype(np.float32))
        stepped, _, dones, _ = env.step(actions)
        observation = stepped["history"].numpy()
        builder.reset(dones.numpy())
        resets += int(dones.sum())
    assert resets >= 4


def test_a_run_trained_exported_and_checked(tmp_path: Path) -> None:
    """The whole way from a training run to a bundle, and the deployed network is the trained student."""
    from stiction.evaluation.export import export_run
    from stiction.learning.run import RunDirectory
    from stiction.learning.runner import load_student, train

    small = {"iterations": 1, "steps": 4}
    cfg = TrainCfg(task=TaskCfg(robot="go1"), teacher=TeacherCfg(**small), student=StudentCfg(**small), num_envs=8)
    run = RunDirectory.create(tmp_path / "run", cfg, "stiction train --robot go1", None)
    train(cfg, run)
    check = export_run(run.path, tmp_path / "bundle")
    contract = check.bundle.contract
    assert (contract.robot, contract.method, contract.command) == ("go1", "deception", "stiction train --robot go1")
    observation = np.random.default_rng(0).standard_normal((5, contract.observation.size)).astype(np.float32)
    expected = load_student(run)(torch.from_numpy(observation)).detach().numpy()
    network = Network(check.bundle.policy, contract.observation.size, contract.num_joints, estimates=True)
    np.testing.assert_allclose(network(observation), expected, atol=1e-5)


def test_robots_start_as_in_training() -> None:
    """The half-width of the initial angles is equal in both modules; one of them must not import torch."""
    from stiction.task.events import RESET_NOISE
    from stiction.virtual.drive import INITIAL_ANGLE

    assert RESET_NOISE[0] == INITIAL_ANGLE


def test_the_side_that_begins_is_one_on_the_robot() -> None:
    """The first side is 1 or -1 in training, and 1 in every frame of the deployed policy."""
    from stiction.evaluation.export import TrainedPolicy, export_network

    contract, still = make_contract(observation=proprioception(18, first_side=True)), np.zeros((2, 18))
    sensors = Sensors(np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)), np.zeros((2, 3)), still, still)
    module = torch.nn.Linear(contract.observation.size, contract.num_joints)
    model = export_network(module, contract.observation.size)
    for twin in TrainedPolicy(module, contract, 2), load_policy(contract, model, (2,)):
        observation = twin.step(sensors, np.zeros((2, 3))).observation
        assert (observation.reshape(2, 11, -1)[..., -1] == 1.0).all()


@pytest.mark.parametrize("known", [None, np.array([0.1, 0.0, 0.3]), np.array([[0.1, 0.0, 0.3], [0.2, 0.4, 1.2]])])
def test_both_twins_are_told_the_same_friction(known: np.ndarray | None) -> None:
    """Both observe the contract's friction, one value for all robots, or one per robot, in every frame."""
    from stiction.evaluation.export import TrainedPolicy, export_network

    told = {"hip": 0.05, "thigh": 0.1, "shank": 0.2}
    contract = make_contract(observation=proprioception(18, known_kinds=3), known_friction=told)
    module = torch.nn.Linear(contract.observation.size, contract.num_joints)
    model = export_network(module, contract.observation.size)
    twins = TrainedPolicy(module, contract, 2, known), load_policy(contract, model, (2,), known_friction=known)
    still = np.zeros((2, 18))
    sensors = Sensors(np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)), np.zeros((2, 3)), still, still)
    trained, deployed = (twin.step(sensors, np.zeros((2, 3))) for twin in twins)
    np.testing.assert_allclose(trained.observation, deployed.observation, atol=1e-6)
    np.testing.assert_allclose(trained.target, deployed.target, atol=1e-5)
    expected = np.array([0.05, 0.1, 0.2]) if known is None else known
    frames = deployed.observation.reshape(2, 11, -1)[..., -3:]
    np.testing.assert_allclose(frames, np.broadcast_to(5 * np.atleast_2d(expected)[:, None], (2, 11, 3)).clip(0, 5))


def test_friction_is_compensated_alike_in_training_and_on_the_robot(tmp_path: Path) -> None:
    """The task's step, the modules of training, the deployed network and the policy on a machine compute one target."""
    from stiction.deploy.robot_policy import RobotPolicy
    from stiction.evaluation.export import TrainedPolicy, contract_of, export_policy
    from stiction.task.env import LocomotionEnv
    from stiction.task.friction import FrictionCfg

    still = replace(CommandCfg(), standing_share=1.0)
    task = TaskCfg(robot="go1", noise=SILENT, commands=still, friction=FrictionCfg("compensation", level=0.2))
    contract = contract_of(TrainCfg(task=task), {"identified": None, "revision": "r", "command": "c"})
    contract = replace(contract, command_correction=None)
    torch.manual_seed(0)
    module = torch.nn.Linear(contract.observation.size, contract.num_joints)
    bundle = export_policy(module, contract, tmp_path / "bundle").bundle
    read = read_contract(bundle.contract.to_json().encode())
    deployed = load_policy(read, bundle.policy)
    on_robot = RobotPolicy(read, load_policy(read, bundle.policy), read.joint_names, dict.fromkeys(RULES, np.inf))
    trained, env, moved = TrainedPolicy(module, contract), LocomotionEnv(task, 1, 3), []
    for step in range(20):
        fleet, command = env.fleet, env.commands.value.double().numpy()
        offset = env.randomizer.draws.encoder_offset.double().numpy()
        measured = fleet.joint_position + offset, fleet.joint_velocity.copy()
        sensors = Sensors(fleet.base_quaternion.copy(), fleet.base_angular_velocity.copy(), *measured)
        with torch.no_grad():
            action = module(env.get_observations()["history"])
        target_of_training = trained.step(sensors, command).target
        alone = Sensors(*(value[0] for value in sensors.arrays().values()))
        ran = deployed.step(alone, command[0]).target
        sent = on_robot.step(read.control_period * step, **alone.arrays(), command=command[0]).target
        _, _, dones, _ = env.step(action)
        assert not dones.any()
        for target in (target_of_training[0], ran, sent):
            np.testing.assert_allclose(target, (env.fleet.targets + offset)[0], atol=1e-6)
        plain = read.array("standing") + read.scale * action.clamp(-5.0, 5.0).double().numpy()[0]
        moved.append((sent - plain) / read.array("compensation"))
    # Some joints are stuck, some move, and not all towards their targets.
    assert np.abs(moved).max() == pytest.approx(1.0, abs=1e-4) and np.abs(moved).min() < 0.5


@pytest.mark.parametrize("slow", [None, 0.98])
@pytest.mark.parametrize("speeds", [None, (0.2, 0.3)])
@pytest.mark.parametrize("compensation", [None, tuple(np.linspace(0.0, 0.3, 18).tolist())])
def test_the_twin_forgets_a_robot_that_is_reset(
    compensation: tuple[float, ...] | None, speeds: tuple[float, float] | None, slow: float | None
) -> None:
    """Over resets of one robot of two, history, last action, slow means and targets agree with the runtime's."""
    from stiction.evaluation.export import TrainedPolicy, export_network

    changes = {"compensation": compensation, "compensation_speeds": speeds}
    contract = make_contract(observation=proprioception(18, slow_kept=slow), **changes)
    module = torch.nn.Linear(contract.observation.size, contract.num_joints)
    model = export_network(module, contract.observation.size)
    twins = TrainedPolicy(module, contract, 2), load_policy(contract, model, (2,))
    generator = np.random.default_rng(0)
    for step in range(30):
        quaternion = np.array([1.0, 0.0, 0.0, 0.0]) + 0.2 * generator.standard_normal((2, 4))
        quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
        rates, joints = generator.standard_normal((2, 3)), generator.standard_normal((2, 2, contract.num_joints))
        sensors = Sensors(quaternion, rates, joints[0], joints[1])
        command = generator.uniform(-0.5, 0.5, (2, 3))
        trained, deployed = (twin.step(sensors, command) for twin in twins)
        for name in ("observation", "action", "target"):
            np.testing.assert_allclose(getattr(trained, name), getattr(deployed, name), atol=1e-5)
        if step % 7 == 6:
            for twin in twins:
                twin.reset(np.array([False, True]))
