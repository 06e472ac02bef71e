"""Torques of links: against formulas on paper, against MuJoCo, and what an error of a link does to them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from limb_logs import pendulum

from stiction.identification.limb.dynamics import (
    MODES,
    gyration,
    joint_inertia,
    link_torques,
    model_torques,
)
from stiction.robots.catalog import find_mechanism
from stiction.robots.load import load_mechanism
from stiction.robots.mechanism import Mechanism
from stiction.robots.model import Link

HERE = Path(__file__).parent


def motion(joints: int, seed: int = 0, samples: int = 50) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return angles, speeds and accelerations that have nothing to do with each other."""
    position, velocity, acceleration = np.random.default_rng(seed).normal(size=(3, samples, joints))
    return position, velocity, 3 * acceleration


def test_a_pendulum_is_the_formula_on_paper() -> None:
    """(I + m r²) θ'' + m g r sin θ = 0.6 θ'' + 9.81 sin θ, whatever the speed."""
    position, velocity, acceleration = motion(1)
    torques = model_torques(pendulum(), position, velocity, acceleration)
    np.testing.assert_allclose(torques, 0.6 * acceleration + 9.81 * np.sin(position), atol=1e-12)
    np.testing.assert_allclose(joint_inertia(pendulum().links, np.array([0.3])), [0.6], atol=1e-12)


def test_turning_the_base_turns_gravity() -> None:
    """With up along x the pendulum hangs at a quarter turn; a direction of no length is refused."""
    still = np.zeros((1, 1))
    torques = model_torques(pendulum().with_up((2.0, 0.0, 0.0)), still, still, still)
    assert abs(abs(torques[0, 0]) - 9.81) < 1e-12


def test_two_links_in_a_plane_are_the_textbook() -> None:
    """Points m1 = 1.5 at the end of l1 = 0.4, m2 = 0.8 at the end of l2 = 0.3, level: no gravity about the axes."""
    (m1, l1), (m2, l2) = (1.5, 0.4), (0.8, 0.3)
    upper = Link(mass=m1, com=(l1, 0, 0), inertia=(0,) * 6, axis=(0, 0, 1))
    lower = Link(mass=m2, com=(l2, 0, 0), inertia=(0,) * 6, axis=(0, 0, 1), parent=0, origin=(l1, 0, 0))
    arm = Mechanism("planar", (upper, lower), ("a", "b"), (0.0,) * 2, (None,) * 2, (0.0,) * 2)
    q, v, a = motion(2)
    cos, sin = np.cos(q[:, 1]), np.sin(q[:, 1])
    h = m2 * l1 * l2 * sin
    m12 = m2 * (l2**2 + l1 * l2 * cos)
    m11 = m1 * l1**2 + m2 * (l1**2 + l2**2 + 2 * l1 * l2 * cos)
    first = m11 * a[:, 0] + m12 * a[:, 1] - h * (2 * v[:, 0] * v[:, 1] + v[:, 1] ** 2)
    second = m12 * a[:, 0] + m2 * l2**2 * a[:, 1] + h * v[:, 0] ** 2
    np.testing.assert_allclose(model_torques(arm, q, v, a), np.stack([first, second], 1), atol=1e-12)


@pytest.mark.parametrize("name", ["arm6.xml", "arm7.xml"])
def test_arms_are_as_mujoco_has_them(name: str) -> None:
    """Frames, products of inertia, nested turns and a pedestal agree with MuJoCo, signs included."""
    model = mujoco.MjModel.from_xml_path(str(HERE / name))
    hinges = np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE))
    data, (q, v, a) = mujoco.MjData(model), motion(len(hinges))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    expected = []
    for sample in range(len(q)):
        data.qpos[hinges], data.qvel[hinges], data.qacc[hinges] = q[sample], v[sample], a[sample]
        mujoco.mj_inverse(model, data)
        expected.append(data.qfrc_inverse[hinges] - model.dof_armature[hinges] * a[sample])
    torques = model_torques(load_mechanism(HERE / name), q, v, a)
    np.testing.assert_allclose(torques, expected, atol=1e-10)


def test_errors_of_a_link_are_what_a_wrong_link_does() -> None:
    """Mass and inertia exactly, a centre of mass to first order, for a link that others hang on."""
    arm = find_mechanism(str(HERE / "arm6.xml"))
    state, number, size = motion(6), 2, 1e-5
    link = arm.links[number]
    x, y, z = link.com
    wrong = {
        "mass": link.scaled(1.2),
        "inertia": replace(link, inertia=tuple(1.2 * value for value in link.inertia)),
        "centre_y": replace(link, com=(x, y + size * gyration(link), z)),
    }
    right, modes = model_torques(arm, *state), list(link_torques(arm, *state))
    for mode, other in wrong.items():
        links = (*arm.links[:number], other, *arm.links[number + 1 :])
        changed = model_torques(replace(arm, links=links), *state) - right
        share = size if mode.startswith("centre") else 0.2
        np.testing.assert_allclose(changed / share, modes[number][MODES.index(mode)], atol=1e-4)
    errors = np.zeros((6, len(MODES)))
    errors[number, :2] = 0.2, -0.1
    expected = right + 0.2 * modes[number][0] - 0.1 * modes[number][1]
    np.testing.assert_allclose(model_torques(arm, *state, errors=errors), expected, atol=1e-10)
