"""Symmetry of the task: what is mirrored twice is itself; physics, observations and rewards commute with the mirror.

The reflection of the simulator's state is written apart (`mirrored`); a wrong map of the joints must fail every check.
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import torch

from actuators import pd_net
from mirrored import mirrored_qpos, mirrored_qvel, mirrored_state
from stiction.core.errors import StictionError
from stiction.files.observation import ObservationLayout, Term
from stiction.robots.catalog import find_robot
from stiction.robots.mirror import RobotMirror, robot_mirror
from stiction.robots.physics import PhysicsCfg
from stiction.robots.terrain import REACH
from stiction.task import randomization as privileged
from stiction.task import symmetry
from stiction.task.config import NoiseCfg, RandomizationCfg, TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg
from stiction.task.symmetry import task_mirror
from stiction.task.terrain import TerrainCfg

TWIN = "robot_files:TWIN"
"""Hips that change their sign in the mirror, and masses that are symmetric to the last digit."""

ROBOTS = ["saturn_lite", TWIN]

SIDED = "robot_files:SIDED"
"""The same with kinds of joints that know their side."""

NUM = 8


def make(robot: str, terrain: str = "flat", law: str = "coulomb", **changes: object) -> LocomotionEnv:
    """Eight robots whose joints differ in everything that can be drawn, friction joint by joint; nothing is noisy."""
    cfg = TaskCfg(
        robot=robot,
        noise=NoiseCfg(0.0, 0.0, 0.0, 0.0),
        friction=FrictionCfg("deception", level=0.1, law=law, per="joint"),
        terrain=TerrainCfg(kind=terrain, elevation_noise=0.0, first_level=5),
        randomization=replace(RandomizationCfg(), push_interval=0.0),
    )
    return LocomotionEnv(replace(cfg, **changes), NUM, seed=1)


def wrong_sign(mirror: RobotMirror) -> RobotMirror:
    """The map with the sign of one angle turned round."""
    sign = mirror.sign.copy()
    sign[1] *= -1.0
    return replace(mirror, sign=sign)


def wrong_legs(mirror: RobotMirror) -> RobotMirror:
    """The map with the images of the first and the third leg exchanged."""
    joints, feet = mirror.joints.copy(), mirror.feet.copy()
    joints[:3], joints[6:9] = mirror.joints[6:9], mirror.joints[:3]
    feet[0], feet[2] = mirror.feet[2], mirror.feet[0]
    return replace(mirror, joints=joints, feet=feet)


def walked(env: LocomotionEnv) -> torch.Tensor:
    """Let the robots stumble for a second, on terrain in the midst of it; return the last actions."""
    generator, actions = torch.Generator().manual_seed(0), torch.zeros(NUM, env.num_actions)
    fleet = env.fleet
    if env.course:
        fleet.base_position[:, 0] = -REACH + np.linspace(-0.1, 0.6, NUM)
        around = np.stack(np.meshgrid([-0.4, 0.0, 0.4], [-0.2, 0.0, 0.2]), -1).reshape(-1, 2)
        fleet.base_position[:, 2] += fleet.ground_around(around).max(axis=1)
    for _ in range(50):
        actions = 0.8 * actions + 0.25 * torch.randn(actions.shape, generator=generator)
        env.step(actions)
    if env.course:
        assert contacts_with_boxes(env) > 0
    env.episode_length_buf[:] = 1  # no episode ends, no command changes while two tasks are compared
    return actions


def check_involution(env: LocomotionEnv, mirror: RobotMirror) -> None:
    """Mirrored twice, every group and the action are what they were."""
    task = task_mirror(env)
    generator = torch.Generator().manual_seed(0)
    random = env.get_observations().apply(lambda value: torch.randn(value.shape, generator=generator))
    twice = task(task(random))
    for name, value in random.items():
        torch.testing.assert_close(twice[name], value, atol=1e-6, rtol=0, msg=name)
        assert not torch.allclose(task.group(name)(value), value), name
    actions = torch.randn(5, env.num_actions, generator=generator)
    torch.testing.assert_close(task.action(task.action(actions)), actions)


def check_canonical_state(env: LocomotionEnv, mirror: RobotMirror) -> None:
    """A nominal robot that stands on its springs, told to go straight ahead, up stairs if any, is its own mirror."""
    draws = env.randomizer.draws
    for name in vars(draws):
        getattr(draws, name)[:] = float(name in ("armature", "damping", "stiffness", "motor_strength"))
    draws.ground_friction[:] = 1.0
    draws.friction[:] = 0.1
    everyone = np.arange(NUM)
    env.randomizer.apply(torch.from_numpy(everyone))
    start = np.tile([-REACH - 0.5, 0.0], (NUM, 1))
    env.fleet.reset(everyone, position=start)
    if env.course:
        env.course.heading[:] = 0.0
    env.commands.value = torch.tensor([0.5, 0.0, 0.0]).repeat(NUM, 1)
    env.last_action[:], env.bench_error[:] = 0.0, 1.0
    if env.slow is not None:
        env.slow.sums[:], env.slow.weight[:] = 0.0, 0.0
    for _ in range(30):
        obs = env.step(torch.zeros(NUM, env.num_actions))[0]
    frame = obs["proprioception"][:, 10:-1]
    assert (frame[:, : env.num_actions].abs() > 1e-4).all()  # no joint is where a sign would not show
    for name, value in task_mirror(env)(obs).items():
        torch.testing.assert_close(value, obs[name], atol=1e-6, rtol=0, msg=name)


def check_commuting(env: LocomotionEnv, mirror: RobotMirror, steps: int = 1) -> None:
    """The mirrored robots, given mirrored actions, do what the mirror shows, and are paid the same."""
    actions = walked(env)
    other = LocomotionEnv(env.cfg, NUM, seed=1, actuator=None if env.motors is None else env.motors.net)
    other.load_state(mirrored_state(env, mirror))
    task = task_mirror(env)
    generator = torch.Generator().manual_seed(1)
    going = torch.ones(NUM, dtype=torch.bool)
    for _ in range(steps):
        actions = 0.8 * actions + 0.25 * torch.randn(actions.shape, generator=generator)
        obs, reward, dones, _ = env.step(actions)
        seen, paid, ended, _ = other.step(task.action(actions))
        going &= ~dones
        assert torch.equal(dones & going, ended & going)
    assert going.sum() >= NUM // 2
    rows = going.numpy()
    # Not all of it is within 1e-6 of zero: the reflection has something to do.
    assert np.abs(env.fleet.qvel[rows]).max() > 0.1
    np.testing.assert_allclose(other.fleet.qpos[rows], mirrored_qpos(env.fleet.qpos, mirror)[rows], atol=1e-6)
    np.testing.assert_allclose(other.fleet.qvel[rows], mirrored_qvel(env.fleet.qvel, mirror)[rows], atol=1e-6)
    for name, value in task(obs).items():
        torch.testing.assert_close(seen[name][going], value[going], atol=1e-6, rtol=0, msg=name)
    torch.testing.assert_close(paid[going], reward[going], atol=1e-6, rtol=0)


def contacts_with_boxes(env: LocomotionEnv) -> int:
    """Count the contacts between robots and the boxes of their courses."""
    count = 0
    for robot in range(NUM):
        model, data = env.fleet.data(robot)
        mujoco.mj_forward(model, data)
        boxes = [geom for geom in range(model.ngeom) if model.geom(geom).name.startswith("obstacle")]
        count += int(np.isin(data.contact.geom, boxes).any(axis=1).sum())
    return count


CHECKS = [check_involution, check_canonical_state, check_commuting]


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("terrain", ["flat", "stairs"])
@pytest.mark.parametrize("check", CHECKS)
def test_symmetry(check, terrain: str, robot: str) -> None:
    """Involution, a state that is its own mirror, and physics that commutes, on the plane and on stairs."""
    env = make(robot, terrain)
    check(env, robot_mirror(env.spec))


@pytest.mark.parametrize("check", CHECKS)
def test_what_is_known_of_a_kind_of_one_side_becomes_that_of_the_other(check) -> None:
    """`L_hip` is told as `R_hip` in the mirror, in every frame and in what the policy estimates."""
    env = make(SIDED, known_friction=True, estimated_friction=True)
    seen, image = env.get_observations(), task_mirror(env)(env.get_observations())
    kinds = env.spec.joint_kinds
    assert kinds == ("R_hip", "R_thigh", "R_calf", "L_hip", "L_thigh", "L_calf")
    for group in ("proprioception", "explicit"):
        right, left = seen[group][:, -6:-3], seen[group][:, -3:]
        assert not torch.isclose(left, right).any()
        torch.testing.assert_close(image[group][:, -6:], torch.cat([left, right], -1))
    check(env, robot_mirror(env.spec))


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("check", CHECKS)
def test_slow_means_are_exchanged_without_a_sign(check, robot: str) -> None:
    """|e|, |θ'| and e θ' of a left hip become those of the right one, whatever the sign of its angle becomes."""
    env = make(robot, slow_means=0.5)
    check(env, robot_mirror(env.spec))


@pytest.mark.parametrize("check", [check_involution, check_commuting])
def test_the_other_side_begins_in_the_mirror(check) -> None:
    """+1 becomes -1."""
    env = make("saturn_lite", first_side=True)
    seen = env.get_observations()
    torch.testing.assert_close(task_mirror(env)(seen)["proprioception"][:, -1], -seen["proprioception"][:, -1])
    check(env, robot_mirror(env.spec))


@pytest.mark.parametrize("check", [check_involution, check_commuting])
def test_the_gait_clock_of_the_other_side_runs_in_the_mirror(check, monkeypatch: pytest.MonkeyPatch) -> None:
    """The phase of a left foot is that of the right one where the other side begins."""
    spec = replace(find_robot(TWIN), gait_period=0.8)
    monkeypatch.setattr("stiction.task.env.find_robot", lambda name: spec)
    env = make(TWIN, first_side=True)
    assert env.layout.terms[-1].name == "phase"
    check(env, robot_mirror(env.spec))


@pytest.mark.parametrize("wrong", [wrong_sign, wrong_legs])
@pytest.mark.parametrize("check", CHECKS)
def test_a_wrong_map_fails_every_check(check, wrong, monkeypatch: pytest.MonkeyPatch) -> None:
    """A check that a wrong map passes would say nothing about the right one."""
    env = make("saturn_lite")
    mirror = wrong(robot_mirror(env.spec))
    monkeypatch.setattr(symmetry, "robot_mirror", lambda robot: mirror)
    with pytest.raises(AssertionError):
        check(env, mirror)


@pytest.mark.parametrize("wrong", [wrong_sign, wrong_legs])
def test_rewards_tell_a_wrong_map(wrong) -> None:
    """Gives a mirrored transition the same reward, and another one under a wrong map."""
    env, other = make("saturn_lite"), make("saturn_lite")
    walked(env)
    other.load_state(mirrored_state(env, wrong(robot_mirror(env.spec))))
    still = torch.zeros(NUM, env.num_actions)
    assert (env.step(still)[1] - other.step(still)[1]).abs().max() > 1e-4


@pytest.mark.parametrize(
    ("terrain", "law"),
    [("slopes", "coulomb"), ("rough", "coulomb"), ("flat", "stribeck"), ("flat", "effort"), ("flat", "load")],
)
def test_every_ground_and_every_law_of_friction_commutes(terrain: str, law: str) -> None:
    """Slabs and ridges are mirrored with the robot, and a law that acts on left joints acts on right ones."""
    env = make(TWIN, terrain, law)
    check_commuting(env, robot_mirror(env.spec))


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("terrain", ["flat", "stairs"])
def test_sliders_commute_where_their_solver_is_done(terrain: str, robot: str) -> None:
    """Newton solves the contacts of robots on yielding springs, and the springs know no left and right."""
    env = make(robot, terrain, physics=PhysicsCfg("plastic", solver="newton"))
    assert env.fleet.model.nplastic == env.num_actions
    check_commuting(env, robot_mirror(env.spec))


@pytest.mark.parametrize("robot", ROBOTS)
def test_compensation_commutes(robot: str) -> None:
    """The mirrored robot's targets are the mirror's, with friction in them by the angles and speeds it has measured."""
    env = make(robot, friction=FrictionCfg("compensation", level=0.1, per="joint"))
    mirror = robot_mirror(env.spec)
    actions = walked(env)
    other = LocomotionEnv(env.cfg, NUM, seed=1)
    other.load_state(mirrored_state(env, mirror))
    env.step(actions)
    other.step(task_mirror(env).action(actions))
    moved = env.fleet.targets - (env.standing + env.action_scale * actions).numpy()
    assert (np.abs(moved).max(0) > 0.5 * env.compensation.numpy()).all()
    images = env.fleet.targets[:, mirror.joints] * mirror.sign
    np.testing.assert_allclose(other.fleet.targets, images, atol=1e-6)
    check_commuting(env, mirror)


def test_an_actuator_net_that_knows_left_from_right_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A net for each joint, and one for joints whose angle changes its sign: nothing says that it is odd."""
    net = pd_net()
    layer = {name: layers for group, layers in zip(net.groups, net.layers, strict=True) for name in group}
    names = net.joint_names
    lopsided = pd_net(groups=tuple((name,) for name in names), layers=tuple(layer[name] for name in names))
    env = LocomotionEnv(make("saturn_lite").cfg, NUM, seed=1, actuator=lopsided)
    with pytest.raises(StictionError, match="treats joint 'FL_hip' and its mirror image 'FR_hip' differently"):
        task_mirror(env)
    with pytest.raises(StictionError, match="treats joint 'FR_hip_joint'"):
        task_mirror(LocomotionEnv(make(TWIN).cfg, NUM, seed=1, actuator=pd_net(TWIN)))
    env = LocomotionEnv(make("saturn_lite").cfg, NUM, seed=1, actuator=net)
    monkeypatch.setattr(symmetry, "robot_mirror", lambda robot: wrong_sign(robot_mirror(robot)))
    with pytest.raises(StictionError, match="treats joint 'FL_thigh'"):
        task_mirror(env)


def test_a_worn_left_joint_becomes_a_worn_right_one() -> None:
    """The mirror assumes no symmetry of the robot: 0.3 of the limit in one calf is seen as 0.3 in the other one."""
    env = make(TWIN)
    names = env.spec.joint_names
    friction = torch.zeros(1, 12)
    friction[0, names.index("FL_calf_joint")] = 0.3
    seen = task_mirror(env).group("privileged")(privileged.nominal_privileged(friction.numpy()))
    expected = friction[:, [names.index(name) for name in names]].clone()
    expected[0, names.index("FL_calf_joint")], expected[0, names.index("FR_calf_joint")] = 0.0, 0.3
    torch.testing.assert_close(seen, privileged.nominal_privileged(expected.numpy()))


def test_multipliers_of_unlike_nominal_joints_are_converted() -> None:
    """FL_hip identified with twice the rotor of FR_hip: 1.2 of the left one is 2.4 of the right one, the same rotor."""
    armature = np.full(12, 0.01)
    armature[0] = 0.02
    unlike = LocomotionEnv(make(TWIN).cfg, NUM, seed=1, identified={"armature": armature})
    rows = unlike.randomizer.draws
    absolute = rows.armature.numpy() * armature
    mirror = robot_mirror(unlike.spec)
    image = task_mirror(unlike).group("privileged")(unlike.randomizer.privileged())[:, 2:14]
    seen = (1.0 + privileged.MULTIPLIER_UNIT * image.numpy()) * armature
    np.testing.assert_allclose(seen, absolute[:, mirror.joints], rtol=1e-5)
    check_involution(unlike, mirror)


def test_compensation_that_differs_from_left_to_right_is_refused() -> None:
    """It is added to the command and observed by nobody: the mirrored action would do something else."""
    cfg = replace(make(TWIN).cfg, friction=FrictionCfg("compensation"))
    friction = np.full(12, 0.1)
    task_mirror(LocomotionEnv(cfg, NUM, seed=1, identified={"frictionloss": friction}))
    friction[4] = 0.5
    env = LocomotionEnv(cfg, NUM, seed=1, identified={"frictionloss": friction})
    with pytest.raises(StictionError, match=r"compensation adds 0.001875 rad to joint 'FR_thigh_joint' and 0.009375"):
        task_mirror(env)


def test_a_term_without_a_rule_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same for an entry of a frame, and for one of the privileged state."""
    env = make(TWIN)
    env.layout = ObservationLayout((*env.layout.terms, replace(env.layout.terms[0], name="roll_pitch")))
    with pytest.raises(StictionError, match="group 'proprioception' has 47 entries and its mirror rule 49"):
        task_mirror(env)
    env = make(TWIN)
    monkeypatch.setattr(symmetry, "PRIVILEGED_TERMS", privileged.PRIVILEGED_TERMS[:-1])
    with pytest.raises(StictionError, match="group 'privileged' has 38 entries and its mirror rule 26"):
        task_mirror(env)
    monkeypatch.setattr("stiction.files.observation.TERM_NAMES", ("height",))
    env.layout = ObservationLayout((Term("height", 1, 1.0, 1.0, "base"),))
    with pytest.raises(StictionError, match="term 'height' has no mirror rule"):
        task_mirror(env)
