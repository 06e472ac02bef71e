"""Load of the hinges of a standing robot, against statics by hand and against MuJoCo's sensors."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from stiction.robots.catalog import find_robot
from stiction.robots.mjcf import build_model
from stiction.robots.model import Link
from stiction.robots.statics import hinge_loads

ROD = Link(mass=2.0, com=(0.3, 0.0, 0.0), inertia=(0.0,) * 6, axis=(0.0, 1.0, 0.0))
"""A rod that points forward at an angle of zero, 2 kg at 0.3 m."""

TIP = np.array([0.5, 0.0, 0.0])


@pytest.mark.parametrize("angle", [0.0, 0.5, -1.2])
def test_a_pendulum_hangs_on_its_weight_alone(angle: float) -> None:
    """In the air |F| is m g at every angle, the moment about its centre none, and the motor holds m g l cos θ."""
    load = hinge_loads([ROD], np.array([angle]), 0, TIP, np.zeros((1, 3)))[0]
    assert load.force[0] == pytest.approx(2 * 9.81)
    assert load.moment[0] == pytest.approx(0.0, abs=1e-12)
    assert load.axis_torque[0] == pytest.approx(2 * 9.81 * 0.3 * np.cos(angle))


def test_a_pendulum_that_stands_on_its_tip() -> None:
    """100 N up at 0.5 m: 80.38 N in the hinge, 100 * 0.2 N m about the centre, 50 - 5.886 N m about the axis."""
    load = hinge_loads([ROD], np.zeros(1), 0, TIP, np.array([[0.0, 0.0, 100.0]]))[0]
    assert (load.force[0], load.moment[0], load.axis_torque[0]) == pytest.approx((80.38, 20.0, 44.114))
    assert load.size[0] == pytest.approx(100.38)


def test_the_hinges_of_a_go2_as_mujoco_measures_them() -> None:
    """A leg that is pushed at its foot: force and moment of the law `load`, and torque about the axis, to 1e-9."""
    robot = find_robot("go2")
    foot, force = robot.feet[0], np.array([8.0, -5.0, 60.0])
    angles = robot.joint_values("default_position") + 0.1
    model = build_model(robot, joint_sensors=True)
    data = mujoco.MjData(model)
    data.qpos[:7], data.qpos[7:] = (0, 0, 5, 1, 0, 0, 0), angles
    mujoco.mj_forward(model, data)
    body = model.body(robot.links[foot.link].name).id
    place = data.xpos[body] + data.xmat[body].reshape(3, 3) @ np.array(foot.position)
    data.xfrc_applied[body] = [*force, *np.cross(place - data.xipos[body], force)]
    data.qvel[:], data.qacc[:] = 0.0, 0.0
    mujoco.mj_inverse(model, data)
    measured = data.sensordata[len(robot.feet) :].reshape(-1, 2, 3)
    loads = hinge_loads(robot.links, angles, foot.link, np.array(foot.position), force[None])
    jacobian = np.zeros((3, model.nv))
    mujoco.mj_jac(model, data, jacobian, None, place, body)
    torque = (data.qfrc_inverse - force @ jacobian)[6:]
    assert list(loads) == list(robot.chain(foot.link))
    for number, load in loads.items():
        assert load.force[0] == pytest.approx(np.linalg.norm(measured[number, 0]), rel=1e-9)
        assert load.moment[0] == pytest.approx(np.linalg.norm(measured[number, 1]), rel=1e-6, abs=1e-9)
        assert load.axis_torque[0] == pytest.approx(abs(torque[number]), rel=1e-6)
