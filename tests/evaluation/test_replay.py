"""A film of a virtual robot shows its recorded motion."""

from pathlib import Path

import numpy as np
import pytest

from stiction.deploy.check import check_bundle
from stiction.files.velocity import parse_command

mujoco = pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")
pytest.importorskip("sapien", reason="the package sapien, of the extra 'engines', is needed for PhysX")

from functools import partial  # noqa: E402

from stiction.engines.catalog import make_engine  # noqa: E402
from stiction.engines.engine import Motion  # noqa: E402
from stiction.evaluation.clip import Lane, compiled, metres_of, posed, walked  # noqa: E402
from stiction.files.contract import robot_of  # noqa: E402
from stiction.virtual.cases import Case, Level  # noqa: E402
from stiction.virtual.trial import World, walk  # noqa: E402


def test_the_renderer_has_the_engine_s_pose_joint_by_joint(bundle: Path) -> None:
    """The renderer has the engine's joint angles and quaternion, in their order."""
    loaded, command, motions = check_bundle(bundle).bundle, parse_command("vx=0.5"), []
    spec = robot_of(loaded.contract)

    def steer(step: int, motion: Motion) -> np.ndarray:
        motions.append(motion)
        return np.array(command.velocity)

    walk(loaded, Case(3, "all", Level(0.1)), World(partial(make_engine, "physx")), steer, 5)
    states = [np.concatenate([m.base_position, m.base_quaternion, m.joint_position]) for m in motions]
    assert len(motions) == 5
    for motion, (data,) in zip(motions, posed(compiled(spec), [np.array(states)]), strict=True):
        np.testing.assert_allclose(data.body("base").xpos, motion.base_position)
        np.testing.assert_allclose(data.body("base").xquat, motion.base_quaternion, atol=1e-6)
        angles = [float(data.joint(name).qpos[0]) for name in spec.joint_names]
        np.testing.assert_allclose(angles, motion.joint_position)


def test_robots_side_by_side_start_together_in_lanes_of_their_own(bundle: Path) -> None:
    """A lane shifts a robot sideways and changes nothing in its walk; the marks reach beyond both ends of it."""
    loaded = check_bundle(bundle).bundle
    states = walked(loaded, 0.1, parse_command("vx=0.5"), 4 * loaded.contract.control_period)
    assert len(states) == 5 and states[0, :2].tolist() == [0.0, 0.0]
    lanes = [Lane("left", "#aa3300", 1.0), Lane("right", "#0033aa", -1.0)]
    for state, (left, right) in zip(
        states, posed(compiled(robot_of(loaded.contract)), [states] * 2, lanes), strict=True
    ):
        np.testing.assert_allclose(left.qpos[1] - right.qpos[1], 2.0)
        np.testing.assert_array_equal(left.qpos[2:], state[2:])
    assert metres_of([np.array([[0.0], [2.2]]), np.array([[-0.4], [0.1]])]) == range(-1, 4)
