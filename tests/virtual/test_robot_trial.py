"""A bundle walks on a virtual robot: what is recorded, and what stays the same."""

from pathlib import Path

import numpy as np
import pytest

from bundles import make_bundle, make_contract, make_network
from stiction.engines.engine import BlownUp, Motion
from stiction.evaluation.metrics import measure
from stiction.files.bundle import read_bundle
from stiction.files.velocity import parse_command
from stiction.files.walk import read_walk, write_walk
from stiction.robots.catalog import find_robot
from stiction.virtual.bench import walk_log
from stiction.virtual.cases import Case, parse_level
from stiction.virtual.trial import World, walk

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

from stiction.engines.mujoco_engine import MujocoEngine

SPEC, STEPS = find_robot("saturn_lite"), 25
FORWARD = np.array([0.5, 0.0, 0.0])


def forward(step: int, motion: Motion) -> np.ndarray:
    """Command a walk."""
    return FORWARD


@pytest.fixture(scope="module")
def standing(tmp_path_factory: pytest.TempPathFactory):
    """A bundle whose network hardly moves: the robot stands."""
    contract = make_contract()
    return read_bundle(make_bundle(tmp_path_factory.mktemp("b") / "still", contract, make_network(contract, gain=1e-3)))


def trial(bundle, cell: str, level: str, steps: int = STEPS, **options):
    """Walk for half a second."""
    return walk(bundle, Case(4, cell, parse_level(level)), World(MujocoEngine), forward, steps, **options)


def test_a_robot_stands_in_every_cell_and_is_judged_like_any_other(standing) -> None:
    """The recording has the shapes that the metrics take, and says what the robot really did."""
    for cell, level in (("nominal", "0"), ("all", "bench+0.02")):
        recording = trial(standing, cell, level, steps=100).recording
        assert recording.velocity.shape == (100, 1, 3) and recording.contact.shape == (100, 1, 6)
        assert recording.upright.all() and recording.contact[-1].sum() >= 3
        metrics = measure(recording, parse_command("vx=0.5"), SPEC.groups(), 1.0)
        # It is put down in a pose that is not quite the standing one, and moves by 4 cm in the first half second.
        assert metrics.fall_rate == 0.0 and abs(metrics.speed_ratio) < 0.1
    assert trial(standing, "nominal", "0").recording.friction.max() == 0.0


class Failing(MujocoEngine):
    """Lets go of its joints after a tenth of a second, or breaks down."""

    breaks_down = False

    def reset(self, *pose):
        """Begin to count."""
        self.steps = 0
        super().reset(*pose)

    def step(self, torque, friction):
        """Fail after a hundred steps."""
        self.steps += 1
        if self.steps > 100 and self.breaks_down:
            raise BlownUp("the robot has blown up")
        super().step(0 * torque if self.steps > 100 else torque, friction)


class Breaking(Failing):
    """Breaks down."""

    breaks_down = True


def test_a_fall_or_a_breakdown_ends_a_trial_as_a_fall(standing) -> None:
    """Ends a trial at a fall or a failure of the simulation, as a fall."""
    for engine, steps in ((Failing, None), (Breaking, 6)):
        ended = walk(standing, Case(4, "nominal", parse_level("0")), World(engine), forward, 100)
        recording = ended.recording
        assert len(recording.upright) < 100 and steps in (None, len(recording.upright))
        assert recording.upright[:-1].all() and not recording.upright[-1]
        assert measure(recording, parse_command("vx=0.5"), SPEC.groups(), 1.0).fall_rate == 1.0


def test_a_walk_is_logged_as_on_any_robot(standing, tmp_path: Path) -> None:
    """A row has the target that held and the torque that acted from it on; the header has nothing of the truth."""
    done = trial(standing, "all", "0.1")
    log = walk_log(done.steps, standing, SPEC, "mujoco", "vx=0.5")
    write_walk(tmp_path / "walk.npz", log)
    read = read_walk(tmp_path / "walk.npz")
    assert len(read) == 10 * STEPS and read.header.period == pytest.approx(0.002)
    assert (read.header.kp, read.header.torque_limit) == (standing.contract.kp, standing.contract.torque_limit)
    assert (read.header.recorded_in, read.header.torque_source) == ("mujoco", "motor_side")
    turn = done.steps[3]
    np.testing.assert_allclose(read.joint_position[30], turn.before.sensors.joint_position, atol=1e-6)
    np.testing.assert_allclose(read.joint_target[30:40], np.tile(turn.policy.target, (10, 1)), atol=1e-6)
    np.testing.assert_allclose(read.joint_torque[30], turn.readings[0].joint_torque, rtol=1e-6)
    np.testing.assert_allclose(read.velocity_command[7], FORWARD)
