"""What is filmed of a virtual robot is what it did."""

from pathlib import Path

import numpy as np
import pytest

from stiction.deploy.check import check_bundle
from stiction.files.velocity import parse_command

mujoco = pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")
pytest.importorskip("sapien", reason="the package sapien, of the extra 'engines', is needed for PhysX")

from stiction.deploy.check import robot_of  # noqa: E402
from stiction.evaluation.clip import replay, walked  # noqa: E402
from stiction.sim.fleet import Fleet  # noqa: E402


def test_the_renderer_has_the_engine_s_pose_joint_by_joint(bundle: Path) -> None:
    """A swapped joint or another order of the quaternion would show a walk that never was."""
    loaded = check_bundle(bundle).bundle
    spec = robot_of(loaded.contract)
    motions = walked(loaded, 3, 0.1, parse_command("vx=0.5"), 5)
    fleet = Fleet(spec, 1)
    advance = replay(fleet, motions)
    for motion in motions:
        advance()
        _, data = fleet.data(0)
        np.testing.assert_allclose(data.body("base").xpos, motion.base_position)
        np.testing.assert_allclose(data.body("base").xquat, motion.base_quaternion, atol=1e-6)
        angles = [float(data.joint(name).qpos[0]) for name in spec.joint_names]
        np.testing.assert_allclose(angles, motion.joint_position)
    advance()
    np.testing.assert_allclose(fleet.base_position[0], motions[-1].base_position)
