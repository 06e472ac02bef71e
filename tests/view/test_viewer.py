"""The viewer's panel, by its callbacks: what a slider, a key, a choice or a browser's garbage does."""

from __future__ import annotations

import json
import re
import socket
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("viser", reason="the viewer needs the extra view")
pytest.importorskip("mjviser", reason="the viewer needs the extra view")

from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.files.bundle import read_bundle, shipped_bundles
from stiction.files.contract import robot_of
from stiction.files.log import by_joint, read_setup, read_table
from stiction.view.plots import top_of
from stiction.view.scene import MARKS, RobotBody, lanes
from stiction.view.server import LOOPBACK, resolve, serve
from stiction.view.simulation import Simulation, ViewedPolicy, WorldCfg
from stiction.view.viewer import MOST_ASKED, Viewer


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


def test_keys_move_the_sliders_within_their_ends(viewer: Viewer) -> None:
    """If this failed, a key would steer past what the policies were trained for, or the slider would not show it."""
    simulation = viewer.simulation
    for _ in range(20):
        trigger(viewer, "Faster")
    assert simulation.velocity[0] == viewer.panel.command[0].value == simulation.range[1, 0]
    trigger(viewer, "Stand")
    assert not simulation.velocity.any()
    trigger(viewer, "More friction")
    trigger(viewer, "More friction")
    trigger(viewer, "Less friction")
    assert set(simulation.levels.values()) == {0.05} and viewer.panel.levels["hip"].value == 5.0
    trigger(viewer, "More wear")
    assert simulation.wear == pytest.approx(1.1)


def test_a_push_moves_all_robots_to_their_left(viewer: Viewer) -> None:
    """If this failed, the push would not push, or push one robot alone."""
    trigger(viewer, "Push to the left")
    for walker in viewer.simulation.walkers:
        assert walker.seen.motion.base_linear_velocity[1] > 0.2


def test_pause_stops_time_and_not_the_panel(viewer: Viewer) -> None:
    """If this failed, a paused viewer could never be told to go on."""
    trigger(viewer, "Pause")
    time = viewer.simulation.time
    viewer.panel.levels["hip"].value = 10.0
    settle(viewer)
    assert viewer.simulation.time == time and viewer.simulation.levels["hip"] == 0.1
    trigger(viewer, "Pause")
    assert viewer.simulation.time > time


def test_a_ground_is_drawn_for_each_robot_in_its_own_lane(viewer: Viewer) -> None:
    """If this failed, robots side by side would walk through each other's stairs."""
    viewer.panel.terrain.value = "stairs=0.1"
    settle(viewer)
    simulation = viewer.simulation
    assert simulation.cfg.course.label == "stairs=0.1"
    first, second = lanes(simulation, RobotBody(simulation.spec).width)
    width = 2 * (np.abs(simulation.ground.positions[:, 1]) + simulation.ground.half_sizes[:, 1]).max()
    assert first - second > width
    viewer.panel.terrain.value = "flat"
    settle(viewer)
    assert simulation.cfg.course.is_flat and len(viewer.scene._marks) == 2 * MARKS + 1


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


def test_the_axis_of_friction_holds_all_that_is_told() -> None:
    """If this failed, what is not told yet would leave the plot empty, or a belief would be off its upper end."""
    nothing = np.full(3, np.nan)
    assert top_of((np.zeros(3), nothing)) == 10.0
    assert top_of((np.array([20.0, 20.0, 20.0]), np.array([np.nan, 23.0, 24.0]))) == 50.0
    assert top_of((np.array([95.0]), np.array([np.nan]))) == 100.0 and top_of((nothing,)) == 10.0


def test_a_flood_of_requests_is_dropped_and_not_kept(viewer: Viewer) -> None:
    """If this failed, a browser that asks without end would fill the memory."""
    done = []
    for number in range(MOST_ASKED + 50):
        viewer.submit(lambda number=number: done.append(number))
    viewer.turn()
    assert len(done) == MOST_ASKED


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


def test_a_fall_ends_the_recording_with_what_there_is(viewer: Viewer, tmp_path: Path) -> None:
    """If this failed, a log would jump from where a robot fell to the start, and look like one motion."""
    trigger(viewer, "Record")
    viewer.simulation.walkers[0]._fall()
    viewer.turn()
    assert (tmp_path / "logs/walk-1.npz").is_file() and viewer._recorder is None


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


@pytest.mark.parametrize(
    ("host", "said"),
    [
        ("bogus.example", "host 'bogus.example' cannot be found: .*; expected a name or an address of this machine"),
        ("a..b", "host 'a..b' cannot be found: it is no name"),
        ("192.0.2.1", "host '192.0.2.1' is not here: 192.0.2.1 is another machine's; expected a name or an address"),
    ],
)
def test_a_host_that_is_none_of_this_machine_is_said_at_once(
    host: str, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """If this failed, a misspelt name would be looked up a hundred times, and the ports would be blamed."""
    asked: list[str] = []

    def look_up(name: str, *rest: object, **more: object) -> object:
        asked.append(name)
        if name == "bogus.example":
            raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")
        return found(name, *rest, **more)

    found = socket.getaddrinfo
    monkeypatch.setattr(socket, "getaddrinfo", look_up)
    monkeypatch.setattr("stiction.cli.view.policies_of", lambda cfg: pytest.fail("the robots were made ready"))
    assert main(["view", "--host", host]) == 1
    printed = capsys.readouterr().err
    assert re.search(said, printed) and printed.count("\n") == 1 and asked == [host]


def test_a_name_of_this_machine_is_its_address() -> None:
    """If this failed, `--host localhost` would be refused, or called an address that others reach."""
    assert resolve("localhost") in (LOOPBACK, "::1") and resolve("0.0.0.0") == "0.0.0.0"
