"""What the browser draws: the robots, the floor with a mark every metre, the courses, a label over each robot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import viser
from mjviser import ViserMujocoScene

from stiction.core.files import publish
from stiction.core.rotation import matrix
from stiction.robots.mjcf import STONES, build
from stiction.robots.model import Robot
from stiction.view.simulation import Simulation, Walker

COLORS = ((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (120, 94, 240), (230, 159, 0))
"""Of the robots' lanes and lines, in turn: told apart by colour-blind people as well."""

GAP = 0.4
"""Between two robots or two courses, side by side [m]."""

MARKS = 5
"""Metres marked before and behind the robots."""

LANE = range(-12, 60)
"""Metres over which a robot's lane is drawn."""

ABOVE = 0.35
"""Height of a label above the base [m]."""


FRAME = 0.04
"""Time between two frames [s]."""

AMBIENT = 2.0
"""Light from everywhere, as bright as the viewer's."""


class RobotBody:
    """Poses of a robot's bodies by MuJoCo's kinematics, for drawing alone."""

    def __init__(self, spec: Robot) -> None:
        """Compile the robot without its floor."""
        built = build(spec)
        built.delete(built.geom("floor"))
        self.model = built.compile()
        self._data = mujoco.MjData(self.model)
        standing = np.array([0.0, 0.0, spec.standing_height])
        places, _ = self.poses(standing, np.array([1.0, 0, 0, 0]), spec.joint_values("default_position"))
        self.width = 2.0 * float(np.abs(places[:, 1]).max())
        """Width of the standing robot, between the middles of its links [m]."""

    def poses(self, position: np.ndarray, quaternion: np.ndarray, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return place [m] and rotation of every body, shapes (bodies, 3) and (bodies, 3, 3); the first is the world.

        position, quaternion: of the base, shapes (3,), (4,); joints: angles [rad], shape (J,).
        """
        self._data.qpos[:] = np.concatenate((position, quaternion, joints))
        mujoco.mj_kinematics(self.model, self._data)
        return self._data.xpos.copy(), self._data.xmat.reshape(-1, 3, 3).copy()


def lanes(simulation: Simulation, width: float) -> np.ndarray:
    """Return where each robot's own world is drawn, to the left of the middle [m], shape (N,).

    width: of a robot [m].
    """
    ground, number = simulation.ground, len(simulation.walkers)
    for half, place, turn in zip(ground.half_sizes, ground.positions, ground.quaternions, strict=True):
        # Half of what a turned box takes up along each axis of the world.
        reach = np.abs(matrix(turn)) @ half
        width = max(width, 2.0 * (abs(place[1]) + reach[1]))
    return (width + GAP) * ((number - 1) / 2 - np.arange(number))


class Scene:
    """The drawing of one simulation."""

    def __init__(self, server: viser.ViserServer, simulation: Simulation, dark: bool = False) -> None:
        """Draw the robots where they stand."""
        self._server, self._simulation = server, simulation
        self._body = RobotBody(simulation.spec)
        self.dark = dark
        self.followed = tuple(range(len(simulation.walkers)))
        """Numbers of the robots whose median is the middle of the picture; none: the floor stands still."""
        self._middle = np.zeros(2)
        server.scene.world_axes.visible = False
        self._robots = ViserMujocoScene(server, self._body.model, len(simulation.walkers))
        # The world is moved under the camera instead, see `draw`.
        self._robots.camera_tracking_enabled = False
        self._labels: list[viser.LabelHandle] = []
        self._ground: list[viser.SceneNodeHandle] = []
        self._marks: list[viser.LabelHandle] = []
        self._floor = server.scene.add_frame("/floor", show_axes=False)
        self.rebuild()

    def rebuild(self) -> None:
        """Draw the ground of another world, or in another colour scheme, and the names anew."""
        scene, walkers = self._server.scene, self._simulation.walkers
        for old in (*self._ground, *self._marks, *self._labels):
            old.remove()
        self._lanes = lanes(self._simulation, self._body.width)
        self._ground = [self._grid(), self._start_line()]
        for number, (lane, color) in enumerate(zip(self._lanes, colors(len(walkers)), strict=True)):
            self._ground.append(
                scene.add_line_segments(
                    f"/floor/lane{number}",
                    np.array([[[metre, lane, 0.003], [metre + 1, lane, 0.003]] for metre in LANE]),
                    color,
                    thickness=0.03,
                )
            )
            self._ground += self._course(number, lane)
        self._labels = [
            scene.add_label(f"/name{number}", "", anchor="bottom-center", font_screen_scale=1.1)
            for number in range(len(walkers))
        ]
        side = float(self._lanes.min()) - self._body.width / 2 - GAP
        self._marks = [
            scene.add_label(f"/floor/mark{number}", "", position=(0.0, side, 0.0), anchor="center-center")
            for number in range(2 * MARKS + 1)
        ]
        self._side = side
        self._marked: int | None = None
        self._camera()
        self.draw()

    def draw(self) -> None:
        """Draw the robots where they are now."""
        poses = [self._poses(walker) for walker in self._simulation.walkers]
        positions = np.stack([places for places, _ in poses])
        positions[..., 1] += self._lanes[:, None]
        if self.followed:
            # The median: one robot that is stuck does not hold the picture back.
            self._middle = np.median(positions[list(self.followed), 1, :2], axis=0)
        shift = np.array([*-self._middle, 0.0])
        # All robots and the floor in one picture, and none a frame ahead of the others.
        with self._server.atomic():
            self._floor.position = shift
            self._mark()
            for label, walker, place in zip(self._labels, self._simulation.walkers, positions, strict=True):
                label.position = place[1] + shift + np.array([0.0, 0.0, ABOVE])
                text = label_text(walker)
                if label.text != text:
                    label.text = text
            self._robots.update_from_arrays(positions + shift, np.stack([turns for _, turns in poses]))

    def _poses(self, walker: Walker) -> tuple[np.ndarray, np.ndarray]:
        motion = walker.seen.motion
        return self._body.poses(motion.base_position, motion.base_quaternion, motion.joint_position)

    def _mark(self) -> None:
        """Number the metres around the robots."""
        start = self._simulation.walkers[0].start
        middle = round(float(self._middle[0]) - start)
        if middle == self._marked:
            return
        self._marked = middle
        for metre, label in enumerate(self._marks, middle - MARKS):
            label.position = (start + metre, self._side, 0.0)
            label.text = f"{metre} m"

    def _grid(self) -> viser.SceneNodeHandle:
        cell, section, plane = ((70,) * 3, (110,) * 3, (38,) * 3) if self.dark else ((226,) * 3, (190,) * 3, (247,) * 3)
        return self._server.scene.add_grid(
            "/floor/grid",
            width=80.0,
            height=80.0,
            cell_size=0.5,
            cell_color=cell,
            section_size=1.0,
            section_color=section,
            plane_color=plane,
            plane_opacity=1.0,
            fade_distance=40.0,
            shadow_opacity=0.3,
            infinite_grid=True,
        )

    def _start_line(self) -> viser.SceneNodeHandle:
        start = self._simulation.walkers[0].start
        half = self._body.width / 2 + GAP
        ends = [[start, self._lanes.min() - half, 0.004], [start, self._lanes.max() + half, 0.004]]
        color = (235, 235, 235) if self.dark else (40, 40, 40)
        return self._server.scene.add_line_segments("/floor/start", np.array([ends]), color, thickness=0.05)

    def _course(self, number: int, lane: float) -> list[viser.SceneNodeHandle]:
        """Add the boxes of one robot's course."""
        ground, boxes = self._simulation.ground, []
        parts = zip(ground.half_sizes, ground.positions, ground.quaternions, strict=True)
        for box, (half, place, turn) in enumerate(parts):
            boxes.append(
                self._server.scene.add_box(
                    f"/floor/course{number}/box{box}",
                    color=tuple(round(255 * part) for part in STONES[box % 2]),
                    dimensions=tuple(2.0 * half),
                    position=place + np.array([0.0, lane, 0.0]),
                    wxyz=turn,
                )
            )
        return boxes

    def _camera(self) -> None:
        """Look at all robots from ahead and from the right."""
        away = 2.0 + 0.7 * float(np.ptp(self._lanes))
        self._server.initial_camera.position = (0.9 * away, -0.9 * away, 0.6 * away)
        self._server.initial_camera.look_at = (0.0, 0.0, 0.2)


def label_text(walker: Walker) -> str:
    """Return what stands over a robot."""
    return f"{walker.policy.name} (fell)" if walker.lies else walker.policy.name


def colors(number: int) -> list[tuple[int, int, int]]:
    """Return the colours of so many robots."""
    return [COLORS[index % len(COLORS)] for index in range(number)]


def write_page(
    server: viser.ViserServer,
    simulation: Simulation,
    path: Path,
    seconds: float,
    dark: bool = False,
    progress: Callable[[float], None] = lambda share: None,
) -> None:
    """Let a simulation go on for some seconds and write what is to be seen as one HTML file.

    server: makes the scene; nobody needs to look at it.
    """
    scene = Scene(server, simulation, dark)
    # The player loads an environment map anew whenever it begins again, and the picture is blank meanwhile.
    server.scene.configure_environment_map(None)
    server.scene.add_light_ambient("/light", intensity=AMBIENT)
    # It has the scene as it is now, and records what changes from here on.
    recorded = server.get_scene_serializer()
    every = max(1, round(FRAME / simulation.period))
    steps = round(seconds / simulation.period)
    for number in range(steps):
        simulation.step()
        if number % every == 0:
            scene.draw()
            recorded.insert_sleep(every * simulation.period)
            progress((number + 1) / steps)
    with publish(path) as partial:
        partial.write_text(recorded.as_html(dark_mode=dark), encoding="utf-8")
