"""The viewer's panel, by its callbacks: what a slider, a key, a choice or a browser's garbage does."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser", reason="the viewer needs the extra view")
pytest.importorskip("mjviser", reason="the viewer needs the extra view")

from stiction.core.errors import ConfigurationError, StictionError
from stiction.files.bundle import read_bundle, shipped_bundles
from stiction.files.contract import robot_of
from stiction.files.log import by_joint, read_setup, read_table
from stiction.view import viewer as module
from stiction.view.clip import ClipError, stage
from stiction.view.server import LOOPBACK, serve
from stiction.view.simulation import Simulation, ViewedPolicy, WorldCfg
from stiction.view.static import write_page
from stiction.view.viewer import Viewer


@pytest.fixture
def viewer(tmp_path: Path) -> Iterator[Viewer]:
    """A viewer of two robots that nobody looks at."""
    bundles = [read_bundle(shipped_bundles()[f"saturn_lite-flat-{method}-0.2"]) for method in ("none", "deception")]
    simulation = Simulation(
        [ViewedPolicy.of_bundle(bundle) for bundle in bundles], robot_of(bundles[0].contract), WorldCfg()
    )
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
    (command,) = [each for each in commands if each.label == label]
    for act in command._impl.trigger_cb:
        act(None)
    settle(viewer)


def test_sliders_reach_the_simulation_in_its_own_units(viewer: Viewer) -> None:
    """Sliders in per cent set fractions, and the slider of all joints moves every kind."""
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


def press(viewer: Viewer, group: Any, word: str) -> None:
    """Do what a browser's press of one button of a row does."""
    group._impl.value = word
    for act in group._impl.update_cb:
        act(SimpleNamespace(target=group, client=None))
    settle(viewer)


def test_presets_walk_and_stand_set_friction_and_command(viewer: Viewer) -> None:
    """A preset is in per cent of the torque limit, also where the slider stands there and a kind of joint does not."""
    panel, simulation = viewer.panel, viewer.simulation
    press(viewer, panel.presets, "15")
    assert set(simulation.levels.values()) == {0.15} and panel.all.value == 15.0
    panel.levels["hip"].value = 40.0
    settle(viewer)
    press(viewer, panel.presets, "15")
    assert set(simulation.levels.values()) == {0.15}
    press(viewer, panel.presets, "99")
    assert set(simulation.levels.values()) == {0.15}, "a word that is on no button"
    for word, speed in (("Stand", 0.0), ("Walk", 0.5)):
        press(viewer, panel.motion, word)
        assert simulation.velocity.tolist() == [speed, 0.0, 0.0]


def test_time_goes_at_the_chosen_speed_and_by_single_steps(viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> None:
    """At ¼ × eight control steps take 32 periods of real time; a single step pauses after one period."""
    now = [0.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(module.time, "sleep", lambda seconds: now.__setitem__(0, now[0] + seconds))
    press(viewer, viewer.panel.pace, "¼ ×")
    begin, period = viewer.simulation.time, viewer.simulation.period
    end = begin + 7.5 * period
    viewer.run(lambda: viewer.simulation.time > end, always=True)
    assert now[0] == pytest.approx(8 * 4 * period)
    viewer.set_pace(float("inf"))
    assert viewer.pace == 0.25
    press(viewer, viewer.panel.time, "Step")
    time = viewer.simulation.time
    settle(viewer)
    assert viewer.paused and viewer.simulation.time == time
    trigger(viewer, "Single step")
    assert viewer.simulation.time == pytest.approx(time + period)


def test_a_gamepad_steers_when_its_box_is_ticked(viewer: Viewer) -> None:
    """The box shows while a gamepad is there; full left stick forward is the fastest command of the training."""
    panel, simulation = viewer.panel, viewer.simulation
    (send,) = viewer.server.pads
    assert not panel.gamepad.visible
    send((1.0, -0.5, 0.0))
    settle(viewer)
    assert panel.gamepad.visible and simulation.velocity.tolist() == [0.5, 0.0, 0.0]
    panel.gamepad.value = True
    send((0.0, 0.0, 0.0))
    send((1.0, -0.5, 0.0))
    settle(viewer)
    low, high = simulation.range
    np.testing.assert_allclose(simulation.velocity, [high[0], 0.5 * low[1], 0.0])
    send(())
    settle(viewer)
    assert not panel.gamepad.visible


def test_a_clip_holds_the_last_seconds_of_all_robots(viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames at 10 Hz end at the last step; without OpenGL the reason is shown, and the robots walk on."""
    for _ in range(100):
        viewer.turn()
    shot = viewer._clips.shot(1.0, 0.5)
    assert shot.states.shape[:2] == (10, 2) and shot.names == ("none", "deception")
    speed = np.diff(shot.states[:, :, 0], axis=0) / 0.1
    assert 0.3 < speed.mean() < 0.7
    assert stage(viewer.simulation.spec, shot).nbody == viewer.simulation.spec.num_joints + 2
    printed: list[str] = []
    monkeypatch.setattr(viewer.panel, "say", lambda title, text: printed.append(text))

    def fail(*_: object) -> bytes:
        raise ClipError("no clip: OpenGL is not available here")

    monkeypatch.setattr(module, "render_shot", fail)
    viewer.make_clip(1.0)
    viewer._drawing.join(60)
    settle(viewer)
    assert printed == ["drawing the last 1.0 s", "no clip: OpenGL is not available here"]
    viewer.restart()
    viewer._attempt(lambda: viewer.make_clip(1.0))
    assert "let the robots walk" in printed[-1]


def test_a_checkpoint_is_chosen_and_one_that_fails_is_taken_back(viewer: Viewer, tmp_path: Path) -> None:
    """The drop-down lists what the run has; a choice that cannot be read leaves the policy and the choice."""

    class Run:
        chosen, checkpoints, meter = "newest", ("newest", "teacher_000002"), None
        contract = viewer.simulation.walkers[0].policy.contract
        load = staticmethod(viewer.simulation.walkers[0].policy.load)

        def choose(self, name: str) -> None:
            if name not in self.checkpoints:
                raise ConfigurationError(f"no {name}")
            self.chosen = name

        @property
        def name(self) -> str:
            return f"run: {self.chosen}"

    with serve() as server:
        other = Viewer(server, viewer.simulation, tmp_path, runs={0: Run()})
        choice = other.panel.checkpoints[0]
        for name in ("teacher_000002", "teacher_000009"):
            choice.value = name
            settle(other)
            assert other.simulation.walkers[0].policy.name == "run: teacher_000002"
        assert choice.value == "teacher_000002"


def test_contact_forces_are_drawn_when_asked_for(viewer: Viewer) -> None:
    """Arrows start at the feet on the ground, 4 mm long per newton, and go when they are not wanted."""
    for _ in range(50):
        viewer.turn()
    viewer.panel.forces.value = True
    settle(viewer)
    viewer.scene.draw()
    forces = [force for walker in viewer.simulation.walkers for _, force in walker.contact_forces()]
    arrows = viewer.scene._forces.points
    assert viewer.scene._forces.visible and len(arrows) == len(forces) >= 4
    np.testing.assert_allclose(arrows[:, 1] - arrows[:, 0], 0.004 * np.array(forces), atol=1e-6)
    viewer.panel.forces.value = False
    settle(viewer)
    viewer.scene.draw()
    assert not viewer.scene._forces.visible


def test_the_static_page_has_plots_of_the_walk(tmp_path: Path) -> None:
    """Speed, torque and friction are in the page as SVG over the whole walk, names of robots escaped."""
    bundle = read_bundle(shipped_bundles()["saturn_lite-flat-none-0.2"])
    policy = ViewedPolicy.of_bundle(bundle, "<i>a</i>: trained")
    with serve() as server:
        write_page(server, Simulation([policy], robot_of(bundle.contract)), tmp_path / "page.html", 0.4)
    page = (tmp_path / "page.html").read_text()
    strip = page[page.rindex('id="stiction-plots"') :]
    assert strip.count("<svg") == 3 and "Motor torque of RR_shank" in strip and "% of limit" in strip
    assert "<i>a" not in strip and "&lt;i&gt;a&lt;/i&gt;" in strip
    assert page.rindex("</body>") > page.rindex("</svg>")


def test_pause_stops_time_and_not_the_panel(viewer: Viewer) -> None:
    """A paused viewer takes no step, applies what the panel says, and goes on when told to."""
    trigger(viewer, "Pause")
    time = viewer.simulation.time
    viewer.panel.levels["hip"].value = 10.0
    settle(viewer)
    assert viewer.simulation.time == time and viewer.simulation.levels["hip"] == 0.1
    trigger(viewer, "Pause")
    assert viewer.simulation.time > time


def test_a_world_that_cannot_be_is_taken_back(viewer: Viewer) -> None:
    """Shows the old engine and ground again after a choice that fails."""
    for choice, word in ((viewer.panel.engine, "bullet"), (viewer.panel.terrain, "stairs=9")):
        choice.value = word
        settle(viewer)
    assert (viewer.panel.engine.value, viewer.panel.terrain.value) == ("mujoco", "flat")
    assert viewer.simulation.cfg == WorldCfg()


@pytest.mark.parametrize("garbage", [float("nan"), float("inf"), -1e300])
def test_garbage_from_a_browser_hurts_nobody(viewer: Viewer, garbage: float) -> None:
    """Leaves the physics finite and friction in range whatever a browser sends."""
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
    """Writes a log that `stiction identify` reads, with the chosen robot's signals and setup."""
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
    """Goes on when the robot lies, or the folder cannot be written."""
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
    """Listens on loopback alone, and shares nothing through viser's tunnel."""
    with serve() as server:
        assert server.get_host() == LOOPBACK
        with socket.create_connection((LOOPBACK, server.get_port()), timeout=5):
            pass
        with pytest.raises(OSError), socket.create_connection(("127.0.0.2", server.get_port()), timeout=5):
            pass
        assert server.request_share_url() is None


def test_a_port_that_is_taken_is_refused_and_a_free_one_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Refuses a port that is taken, and takes the next free one where none is named."""
    monkeypatch.setenv("_VISER_PORT_OVERRIDE", "1")
    with serve() as server, pytest.raises(StictionError, match=r"port \d+ on 127\.0\.0\.1 cannot be listened on"):
        with serve() as other:
            assert other.get_port() != server.get_port()
        with serve(server.get_port()):
            pass
