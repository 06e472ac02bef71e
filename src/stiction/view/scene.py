"""The scene: robots in their policies' colours on treadmills side by side, courses, labels, contact forces."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
import viser
from mjviser import ViserMujocoScene

from stiction.core.rotation import matrix
from stiction.robots.mjcf import STONES, build, foot_geometries
from stiction.robots.model import Robot
from stiction.view.simulation import Simulation, Walker

COLORS = ((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (120, 94, 240), (230, 159, 0))
"""Colours of the policies in turn, in scene, plots and legend; colour-blind people can tell them apart as well."""

SHADE = 0.4
"""Share of a geometry's own brightness in that of the policy's colour on it; feet keep their colours."""

GAP = 0.4
"""Distance between two robots or two courses, side by side [m]."""

SLACK = np.array([0.6, GAP / 2])
"""Largest distance at which a robot is drawn from the place that the camera follows, along x and y [m].

A robot that falls farther behind stays there, and its ground moves under it."""

BELT = 2.0 * (SLACK[0] + 1.0)
"""Length of a treadmill [m]."""

DEPTH = 0.02
"""Depth of the floor below the treadmills [m]; at one height a browser would draw the floor through them."""

ABOVE = 0.35
"""Height of a label above the base [m]."""

FIELD_OF_VIEW = np.radians(45.0)
"""Vertical field of view of the camera [rad]."""

DIRECTION = np.array([0.68, -0.62, 0.4]) / np.linalg.norm([0.68, -0.62, 0.4])
"""Direction from the robots to the camera."""

TARGET = np.array([0.0, 0.0, 0.2])
"""Point at which the camera looks [m]."""

RESHAPED = 0.03
"""Relative change of the camera's distance from which a picture of another shape gets it."""

FORCE_SCALE = 0.004
"""Length of an arrow per force [m/N]."""

FORCE_COLOR = (220, 20, 60)
"""Colour of contact forces."""


class RobotBodies:
    """Poses of all robots' bodies by the kinematics of one MuJoCo model, for drawing only."""

    def __init__(self, spec: Robot, colors: Sequence[tuple[int, int, int]]) -> None:
        """Compile one robot per colour, without the floor."""
        feet = frozenset(foot_geometries(spec))
        built = painted(spec, colors[0], feet)
        built.delete(built.geom("floor"))
        for number, color in enumerate(colors[1:], 1):
            built.worldbody.add_frame().attach_body(painted(spec, color, feet).body("base"), f"{number}/", "")
        self.model = built.compile()
        self._data = mujoco.MjData(self.model)
        joints = spec.joint_values("default_position")
        standing = np.concatenate(([0.0, 0.0, spec.standing_height, 1.0, 0.0, 0.0, 0.0], joints))
        places, _ = self.poses(np.tile(standing, (len(colors), 1)))
        self.width = 2.0 * float(np.abs(places[:, 1]).max())
        """Width of a standing robot, between the middles of its links [m]."""

    def poses(self, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return position [m] and rotation of every body, shapes (bodies, 3) and (bodies, 3, 3); first the world.

        states: position, quaternion and joint angles of each robot, shape (N, 7 + J).
        """
        self._data.qpos[:] = states.ravel()
        mujoco.mj_kinematics(self.model, self._data)
        return self._data.xpos.copy(), self._data.xmat.reshape(-1, 3, 3).copy()


def painted(spec: Robot, color: tuple[int, int, int], feet: frozenset[str]) -> mujoco.MjSpec:
    """Return MuJoCo's description of a robot whose geometries, except its feet, have a policy's colour."""
    built = build(spec)
    for geom in built.geoms:
        if geom.name not in feet:
            geom.rgba[:3] = np.array(color) / 255 * (1.0 - SHADE + SHADE * geom.rgba[:3].mean())
    return built


def lanes(simulation: Simulation, width: float) -> np.ndarray:
    """Return the y coordinate at which each robot's world is drawn [m], shape (N,), the first robot leftmost.

    width: of a robot [m].
    """
    ground, number = simulation.ground, len(simulation.walkers)
    for half, place, turn in zip(ground.half_sizes, ground.positions, ground.quaternions, strict=True):
        # Half of what a turned box takes up along each axis of the world.
        reach = np.abs(matrix(turn)) @ half
        width = max(width, 2.0 * (abs(place[1]) + reach[1]))
    return (width + GAP) * ((number - 1) / 2 - np.arange(number))


def treadmill(places: np.ndarray, lead: np.ndarray) -> np.ndarray:
    """Return where robots are drawn relative to the place that the camera follows [m], shape (N, 2).

    Differences up to `SLACK` are drawn as they are, larger ones at that distance. places: of the robots, shape (N, 2);
    lead: the place that the camera follows, shape (2,).
    """
    return np.clip(places - lead, -SLACK, SLACK)


def camera_distance(half: np.ndarray, aspect: float) -> float:
    """Return the distance at which a camera in `DIRECTION` sees a box about `TARGET` completely [m].

    half: half sizes of the box [m], shape (3,); aspect: width of the picture over its height.
    """
    right = np.cross([0.0, 0.0, 1.0], DIRECTION)
    right /= np.linalg.norm(right)
    up = np.cross(DIRECTION, right)
    corners = half * np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    tangent = np.tan(FIELD_OF_VIEW / 2)
    needed = np.maximum(np.abs(corners @ up) / tangent, np.abs(corners @ right) / (tangent * aspect))
    return float((corners @ DIRECTION + needed).max())


class Scene:
    """The drawing of one simulation."""

    def __init__(self, server: viser.ViserServer, simulation: Simulation, dark: bool = False) -> None:
        """Draw the robots where they stand."""
        self._server, self._simulation = server, simulation
        self.colors = colors(len(simulation.walkers))
        self._bodies = RobotBodies(simulation.spec, self.colors)
        self.dark = dark
        self.followed: tuple[int, ...] = tuple(range(len(simulation.walkers)))
        """Numbers of the robots whose median place the camera follows; empty: the camera stands still."""
        self.shows_forces = False
        """True if contact forces are drawn."""
        self._lead = np.zeros(2)
        server.scene.world_axes.visible = False
        self._robots = ViserMujocoScene(server, self._bodies.model, 1)
        # The worlds are moved under the camera instead, see `draw`.
        self._robots.camera_tracking_enabled = False
        self._drawn: list[viser.SceneNodeHandle] = []
        self._labels: list[viser.LabelHandle] = []
        self._worlds: list[viser.FrameHandle] = []
        self._ticks: list[viser.LineSegmentsHandle] = []
        self._belts: list[viser.BoxHandle] = []
        self._forces = server.scene.add_arrows(
            "/forces",
            np.zeros((1, 2, 3)),
            FORCE_COLOR,
            shaft_radius=0.008,
            head_radius=0.02,
            head_length=0.04,
            visible=False,
        )
        server.initial_camera.fov = float(FIELD_OF_VIEW)
        server.on_client_connect(self._fit)
        self.rebuild()

    @property
    def width(self) -> float:
        """Width of a robot [m]."""
        return self._bodies.width

    def rebuild(self) -> None:
        """Draw ground, courses and names anew, for another world or colour scheme."""
        scene, walkers = self._server.scene, self._simulation.walkers
        for old in self._drawn:
            old.remove()
        self._lanes, width = lanes(self._simulation, self._bodies.width), self._bodies.width + GAP / 2
        self._labels = [scene.add_label(f"/name{n}", "", anchor="bottom-center") for n in range(len(walkers))]
        self._worlds = [scene.add_frame(f"/world{n}", show_axes=False) for n in range(len(walkers))]
        floor = np.array((38.0,) * 3 if self.dark else (247.0,) * 3)
        self._belts, self._ticks, self._drawn = [], [], [self._grid(), *self._labels, *self._worlds]
        across = np.array([[0.0, -width / 2, 0.005], [0.0, width / 2, 0.005]])
        metres = np.arange(-BELT // 2 + 1, BELT // 2)
        for number, color in enumerate(self.colors):
            shade = tuple(round(value) for value in 0.85 * floor + 0.15 * np.array(color))
            size = (BELT, width, DEPTH)
            self._belts.append(scene.add_box(f"/belt{number}", color=shade, dimensions=size, cast_shadow=False))
            points = np.array([np.add(across, (metre, 0.0, 0.0)) for metre in metres])
            self._ticks.append(scene.add_line_segments(f"/ticks{number}", points, color, thickness=0.02))
            start = np.add(across, (walkers[0].start, 0.0, 0.002))
            ink = (235, 235, 235) if self.dark else (40, 40, 40)
            self._drawn.append(scene.add_line_segments(f"/world{number}/start", start[None], ink, thickness=0.05))
            self._drawn += self._course(number)
        self._drawn += [*self._belts, *self._ticks]
        distance = self._distance(1.6)
        self._server.initial_camera.position = TARGET + distance * DIRECTION
        self._server.initial_camera.look_at = TARGET
        self.draw()

    def draw(self) -> None:
        """Draw the robots at their present poses."""
        walkers = self._simulation.walkers
        states = np.stack([state_of(walker) for walker in walkers])
        places = states[:, :2].copy()
        if self.followed:
            # The median: one robot that is stuck does not hold the picture back.
            self._lead = np.median(places[list(self.followed)], axis=0)
            shown = treadmill(places, self._lead)
        else:
            shown = places - self._lead
        shifts = np.column_stack((shown - places, np.zeros(len(places))))
        shifts[:, 1] += self._lanes
        states[:, :3] += shifts
        # All robots and the floor in one picture, and none a frame ahead of the others.
        with self._server.atomic():
            for number, (walker, shift, state) in enumerate(zip(walkers, shifts, states, strict=True)):
                lane = float(self._lanes[number] + (shown[number, 1] if self.followed else 0.0))
                self._worlds[number].position = shift
                self._belts[number].position = (0.0, lane, -DEPTH / 2)
                self._ticks[number].position = (float((shift[0] - walker.start) % 1.0), lane, 0.0)
                label, text = self._labels[number], label_text(walker)
                label.position = np.add(state[:3], (0.0, 0.0, ABOVE))
                if label.text != text:
                    label.text = text
            self._draw_forces(shifts)
            positions, turns = self._bodies.poses(states)
            self._robots.update_from_arrays(positions[None], turns[None])

    def _draw_forces(self, shifts: np.ndarray) -> None:
        """Draw the forces of the last physics step; shifts: from each robot's world to the scene [m], (N, 3)."""
        arrows = []
        if self.shows_forces:
            for walker, shift in zip(self._simulation.walkers, shifts, strict=True):
                for point, force in walker.contact_forces():
                    arrows.append((point + shift, point + shift + FORCE_SCALE * force))
        if arrows:
            self._forces.points = np.array(arrows)
        if self._forces.visible != bool(arrows):
            self._forces.visible = bool(arrows)

    def _grid(self) -> viser.SceneNodeHandle:
        cell, section, plane = ((48,) * 3, (60,) * 3, (38,) * 3) if self.dark else ((238,) * 3, (225,) * 3, (247,) * 3)
        return self._server.scene.add_grid(
            "/grid",
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
            position=(0.0, 0.0, -DEPTH),
        )

    def _course(self, number: int) -> list[viser.SceneNodeHandle]:
        """Add the boxes of one robot's course."""
        ground = self._simulation.ground
        parts = zip(ground.half_sizes, ground.positions, ground.quaternions, strict=True)
        return [
            self._server.scene.add_box(
                f"/world{number}/box{box}",
                color=tuple(round(255 * part) for part in STONES[box % 2]),
                dimensions=tuple(2.0 * half),
                position=place,
                wxyz=turn,
            )
            for box, (half, place, turn) in enumerate(parts)
        ]

    def _distance(self, aspect: float) -> float:
        """Return the distance from which the camera sees all robots wherever they are drawn [m]; aspect: untrusted."""
        aspect = min(max(aspect, 0.2), 5.0) if np.isfinite(aspect) else 1.0
        side = float(np.ptp(self._lanes)) / 2 + self._bodies.width / 2
        return camera_distance(np.array([SLACK[0] + 0.4, side, 0.3]), aspect)

    def _fit(self, client: viser.ClientHandle) -> None:
        """Put a browser's camera where it sees all robots, and keep them in the picture when its shape changes."""
        camera = client.camera
        fitted = self._distance(camera.image_width / max(camera.image_height, 1))
        camera.position, camera.look_at = TARGET + fitted * DIRECTION, TARGET

        def refit(_: object) -> None:
            nonlocal fitted
            distance = self._distance(camera.image_width / max(camera.image_height, 1))
            if abs(distance / fitted - 1.0) > RESHAPED:
                # In the direction that the user chose; the browser's position may be older than the one set here.
                away = camera.position - camera.look_at
                camera.position = camera.look_at + away * distance / max(float(np.linalg.norm(away)), 1e-6)
                fitted = distance

        camera.on_update(refit)


def state_of(walker: Walker) -> np.ndarray:
    """Return position [m], quaternion and joint angles [rad] of a robot, shape (7 + J,)."""
    motion = walker.seen.motion
    return np.concatenate((motion.base_position, motion.base_quaternion, motion.joint_position))


def label_text(walker: Walker) -> str:
    """Return the label of a robot: its policy, and how far it came [m]."""
    distance = round(walker.seen.motion.base_position[0] - walker.start, 1) + 0.0
    return f"{walker.policy.short}: fell" if walker.lies else f"{walker.policy.short} {distance:.1f} m"


def colors(number: int) -> list[tuple[int, int, int]]:
    """Return the colours of so many policies."""
    return [COLORS[index % len(COLORS)] for index in range(number)]
