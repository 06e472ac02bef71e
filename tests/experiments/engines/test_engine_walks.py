"""The same bundle in the training's simulator and in an engine: the same robot, the same measure."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.evaluation.metrics import speed_ratio
from stiction.files.velocity import parse_command
from stiction.files.walk import Recording
from stiction.joints.friction import Law
from stiction.robots.catalog import find_robot

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

from stiction.deploy.check import check_bundle
from stiction.engines.engine import Motion
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.virtual.cases import DataSheet
from stiction.virtual.hidden import Hidden
from stiction_experiments.engines import walks as engine_walks
from stiction_experiments.engines.walks import (
    COARSE,
    FINE_TRAINING,
    MUJOCO,
    STIFF,
    TRAINING,
    check_walks,
    find_simulators,
    walk_bundles,
)


def test_a_fall_counts_to_the_end_of_the_walk() -> None:
    """Two steps at 1 m/s, the second one a fall, then nothing for two more: a quarter of the commanded speed."""
    recording = Recording(
        0.02,
        velocity=np.tile([1.0, 0.0, 0.0], (2, 1, 1)),
        position=np.zeros((2, 1, 2)),
        contact=np.ones((2, 1, 6), bool),
        power=np.zeros((2, 1)),
        square_acceleration=np.zeros((2, 1)),
        upright=np.array([[True], [False]]),
        friction=np.array([[1.0], [2.0]]),
    )
    longer = recording.extended(4)
    assert longer.upright.ravel().tolist() == [True, False, False, False]
    assert longer.contact.shape == (4, 1, 6) and longer.friction is not None and longer.friction[-1, 0] == 2.0
    assert speed_ratio(longer, parse_command("vx=1")) == pytest.approx(0.25)


def test_friction_is_the_level_in_every_joint() -> None:
    """A virtual robot's own friction differs from joint to joint; engines would be compared on another robot."""
    spec = find_robot("saturn_lite")
    hidden = Hidden.perfect(spec.num_joints)
    friction = DataSheet(0, Law(), 0.2).friction(hidden, spec, 0.002)
    still = Motion(**{part.name: np.zeros(spec.num_joints) for part in fields(Motion)})
    loaded = np.full(spec.num_joints, 50.0)
    for speed in (0.0, 3.0):
        motion = replace(still, joint_velocity=np.full(spec.num_joints, speed), joint_force=loaded)
        bound = friction.bound(motion, loaded)
        np.testing.assert_allclose(bound, 0.2 * spec.joint_values("torque_limit"))


def test_every_cell_has_every_simulator_in_order_and_walks_once(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows would be compared with those of another level or command; an interrupted study would begin anew."""
    cfg = EvaluationCfg((0.0, 0.2), ("vx=0.5",), episodes=2, seconds=1.0, settle=0.0)
    done: list[tuple[str, float]] = []
    folder = tmp_path / "walks"
    folder.mkdir()

    def run(cfg: EvaluationCfg = cfg) -> tuple[list, list]:
        engines = find_simulators([MUJOCO])
        return walk_bundles([check_bundle(bundle).bundle], engines, cfg, folder, 1, lambda *text: done.append(text))

    rows, episodes = run()
    steps = {TRAINING: 0.005, FINE_TRAINING: 0.001, COARSE: 0.005, MUJOCO: 0.002, STIFF: 0.002}
    cells = [(level, name) for level in (0.0, 0.2) for name in steps]
    assert [(row.friction_level, row.simulator) for row in rows] == cells
    assert [(one.friction_level, one.simulator) for one in episodes] == [cell for cell in cells for _ in range(2)]
    assert done == [("walks", pytest.approx(number / 10)) for number in range(1, 11)]
    for row, walks in zip(rows, zip(episodes[::2], episodes[1::2], strict=True), strict=True):
        assert row.episodes == 2 and row.timestep == steps[row.simulator]
        assert row.speed_ratio == pytest.approx(np.mean([one.speed_ratio for one in walks]))
        assert (row.to_training is None) == (row.simulator == TRAINING)
        assert row.speed_low is not None and row.speed_low < row.speed_ratio < row.speed_high
        if row.to_training is not None:
            trained = next(one for one in rows if one.friction_level == row.friction_level)
            assert row.to_training == pytest.approx(row.speed_ratio / trained.speed_ratio)
    monkeypatch.setattr(engine_walks, "_episodes", lambda *arguments: pytest.fail("walked again"))
    assert run() == (rows, episodes) and len(list(folder.iterdir())) == 10
    with pytest.raises(pytest.fail.Exception):
        run(replace(cfg, seed=1))


def test_a_command_to_stand_has_no_speed_to_compare() -> None:
    """It would be a speed of zero over zero."""
    with pytest.raises(StictionError, match="asks for motion"):
        check_walks(EvaluationCfg(commands=("vx=0.5", "stand")))
