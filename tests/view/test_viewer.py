"""The viewer's panel, by its callbacks: what a slider, a key, a choice or a browser's garbage does."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("viser", reason="the viewer needs the extra view")
pytest.importorskip("mjviser", reason="the viewer needs the extra view")

from stiction.core.errors import StictionError
from stiction.files.bundle import read_bundle, shipped_bundles
from stiction.files.contract import robot_of
from stiction.files.log import by_joint, read_setup, read_table
from stiction.view.server import LOOPBACK, serve
from stiction.view.simulation import Simulation, ViewedPolicy, WorldCfg
from stiction.view.viewer import Viewer


@pytest.fixture
def viewer(tmp_path: Path) -> Iterator[Viewer]:
    """A viewer of two robots that nobody looks at."""
    bundles = [read_bundle(shipped_bundles()[f"saturn_lite-flat-{method}-0.2"]) for method in ("none", "deception")]
    simulation = Simulation([ViewedPolicy.of_bundle(one) for one in bundles], robot_of(bundles[0].contract), WorldCfg())
    with serve() as server:
        yield Viewer(server, simulation, tmp_path / "logs")


def settle(viewer: Viewer) -> None:
    """Take steps until what was asked for, and what came of that, is done."""
    viewer.server._thread_executor.submit(lambda: None).result()
    for _ in range(3):
        viewer.turn()


def trigger(viewer: Viewer, label: str) -> None:
    """Do what a browser's key does."""
    commands = viewer.server.gui._command_handle_from_uuid.values()
    (command,) = [one for one in commands if one.label == label]
    for act in command._impl.trigger_cb:
        act(None)
    settle(viewer)


def test_sliders_reach_the_simulation_in_its_own_units(viewer: Viewer) -> None:
    """If this failed, a slider in per cent would set a friction a hundred times too large, or none."""
    panel, simulation = viewer.panel, viewer.simulation
    panel.command[0].value = 0.4
    panel.levels["shank"].value = 15.0
    panel.wear.value = 2.0
    settle(viewer)
    assert simulation.velocity.tolist() == [0.4, 0.0, 0.0]
    assert simulation.levels == {"hip": 0.0, "thigh": 0.0, "shank": 0.15} and simulation.wear == 2.0
    panel.all.value = 20.0
    settle(viewer)
    assert set(simulation.levels.values()) == {0.2}


def test_pause_stops_time_and_not_the_panel(viewer: Viewer) -> None:
    """If this failed, a paused viewer could never be told to go on."""
    trigger(viewer, "Pause")
    time = viewer.simulation.time
    viewer.panel.levels["hip"].value = 10.0
    settle(viewer)
    assert viewer.simulation.time == time and viewer.simulation.levels["hip"] == 0.1
    trigger(viewer, "Pause")
    assert viewer.simulation.time > time


def test_a_world_that_cannot_be_is_taken_back(viewer: Viewer) -> None:
    """If this failed, the panel would show an engine in which nothing walks, or the viewer would end."""
    for choice, word in ((viewer.panel.engine, "bullet"), (viewer.panel.terrain, "stairs=9")):
        choice.value = word
        settle(viewer)
    assert (viewer.panel.engine.value, viewer.panel.terrain.value) == ("mujoco", "flat")
    assert viewer.simulation.cfg == WorldCfg()


@pytest.mark.parametrize("garbage", [float("nan"), float("inf"), -1e300])
def test_garbage_from_a_browser_hurts_nobody(viewer: Viewer, garbage: float) -> None:
    """If this failed, one browser could put NaN into the robots of all, or stop them."""
    panel = viewer.panel
    for slider in (*panel.command, *panel.levels.values(), panel.all, panel.wear, panel.strength):
        slider.value = garbage
    panel.recorded.value = panel.camera.value = viewer.joint.value = "../../nobody"
    for key in ("Push to the left", "Record", "Faster", "More friction", "More wear"):
        trigger(viewer, key)
    viewer.show(0.0)
    for walker in viewer.simulation.walkers:
        assert np.isfinite(walker.seen.motion.base_position).all()
    assert all(0 <= level <= 0.9 for level in viewer.simulation.levels.values())


def test_a_recording_is_a_canonical_log_of_the_chosen_robot(viewer: Viewer, tmp_path: Path) -> None:
    """If this failed, `stiction identify` could not read what the viewer recorded."""
    contract = viewer.simulation.walkers[0].policy.contract
    viewer.panel.command[0].value = 0.5
    settle(viewer)
    trigger(viewer, "Record")
    for _ in range(20):
        viewer.turn()
    angle = viewer.simulation.walkers[0].seen.step.readings[-1].sensors.joint_position
    trigger(viewer, "Record")
    path = tmp_path / "logs/walk-1.npz"
    table = read_table(path)
    columns = table[0] if isinstance(table, tuple) else table.columns
    time, joints = columns["time"], by_joint(columns, None)
    assert tuple(joints) == contract.joint_names
    np.testing.assert_allclose(np.diff(time), 0.002, atol=1e-9)
    assert time[0] == 0.0 and 0.4 < time[-1] < 0.6
    shank = joints["FL_shank"]
    assert angle[contract.joint_names.index("FL_shank")] in shank.position
    assert np.ptp(shank.target) > 0.05 and np.abs(shank.torque).max() <= 45.0
    setup = read_setup(path)
    assert setup.torque_source == "motor_side" and setup.of_joint("FL_shank").kp == contract.kp[2]
    assert json.loads(path.with_suffix(".json").read_text())["joints"]["FL_hip"]["torque_limit"] == 25.0


def test_a_recording_that_cannot_be_had_ends_nothing(viewer: Viewer, tmp_path: Path) -> None:
    """If this failed, a robot that lies, or a folder that cannot be written, would take the viewer from everybody."""
    viewer.simulation.walkers[0]._fall()
    trigger(viewer, "Record")
    assert viewer._recorder is None
    (tmp_path / "logs").write_text("in the folder's place")
    viewer.panel.recorded.value = viewer.panel.names[1]
    for _ in range(2):
        trigger(viewer, "Record")
    assert viewer._recorder is None
    trigger(viewer, "Record")
    viewer.simulation.walkers[1]._fall()
    viewer.turn()
    assert viewer._recorder is None
    time = viewer.simulation.time
    viewer.turn()
    assert viewer.simulation.time > time


def test_it_listens_on_loopback_and_nowhere_else() -> None:
    """If this failed, whoever is in the same network could look and steer without being let in."""
    with serve() as server:
        assert server.get_host() == LOOPBACK
        with socket.create_connection((LOOPBACK, server.get_port()), timeout=5):
            pass
        with pytest.raises(OSError), socket.create_connection(("127.0.0.2", server.get_port()), timeout=5):
            pass
        assert server.request_share_url() is None


def test_a_port_that_is_taken_is_refused_and_a_free_one_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """If this failed, a viewer would listen on another port than it was told to, without a word."""
    monkeypatch.setenv("_VISER_PORT_OVERRIDE", "1")
    with serve() as server, pytest.raises(StictionError, match=r"port \d+ on 127\.0\.0\.1 cannot be listened on"):
        with serve() as other:
            assert other.get_port() != server.get_port()
        with serve(server.get_port()):
            pass
