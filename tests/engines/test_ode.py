"""ODE beyond the conformance suite: friction at the feet, stops and wide joints, what could end the process, memory."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.core.rotation import UPRIGHT, matrix
from stiction.engines.catalog import missing_engine
from stiction.engines.engine import BlownUp, Body, Motion
from stiction.engines.ground import Ground, flat
from stiction.engines.ode.engine import ACCURATE, WEBOTS, OdeEngine, OdeSettings
from stiction.robots.catalog import find_robot
from stiction.robots.model import GRAVITY
from stiction_experiments.engines.conformance.rig import HELD, record, still

STEP = 0.002
SPEC = find_robot("saturn_lite")
STANDING = SPEC.joint_values("default_position")
PLACE = np.array([0.0, 0.0, SPEC.standing_height])
NOTHING = np.zeros(SPEC.num_joints)

_missing = missing_engine("ode", SPEC)
pytestmark = pytest.mark.skipif(_missing is not None, reason=_missing or "")


def on_the_plane(settings: OdeSettings = ACCURATE, **changes: object) -> OdeEngine:
    """Return a robot that stands on the plane; changes: fields of `Body`."""
    engine = OdeEngine(replace(Body.nominal(SPEC), **changes), flat(), STEP, settings)
    engine.reset(STANDING, PLACE, UPRIGHT)
    return engine


def same(one: Motion, other: Motion) -> bool:
    """Say whether two motions are the same in every bit."""
    return all(np.array_equal(getattr(one, part.name), getattr(other, part.name)) for part in fields(Motion))


@pytest.mark.parametrize(("settings", "depth"), [(ACCURATE, 5.232e-7), (WEBOTS, 5.232e-4)])
def test_a_foot_sinks_as_far_as_the_settings_say(settings: OdeSettings, depth: float) -> None:
    """A sixth of 32 kg on each foot is 52.32 N, and erp · depth / dt = cfm · force; Webots' hinges add 2 to 3 %."""
    engine = on_the_plane(settings)
    motion = record(engine, 200, still(engine.body))
    assert PLACE[2] - motion.base_position[-1, 2] == pytest.approx(depth, rel=0.04)


def walk(engine: OdeEngine, steps: int, look: Callable[[], None]) -> None:
    """Let a robot walk without feedback of its base, and look after every step."""
    kp, kd, limit = (SPEC.joint_values(name) for name in ("kp", "kd", "torque_limit"))
    for number in range(steps):
        phase = 2 * np.pi * 1.25 * number * STEP + np.pi * SPEC.groups()
        target = STANDING.reshape(-1, 3).copy()
        target[:, 1] += 0.25 * np.sin(phase)
        target[:, 2] -= 0.45 * np.clip(np.cos(phase), 0.0, None)
        motion = engine.motion()
        torque = kp * (target.ravel() - motion.joint_position) - kd * motion.joint_velocity
        engine.step(np.clip(torque, -limit, limit), NOTHING)
        look()


def worst_friction(settings: OdeSettings) -> float:
    """Return the largest force along the ground over what it pushed with a step before, of a contact that lasts."""
    engine = on_the_plane(settings, ground_friction=0.5)
    pushed: dict[tuple[int, int], float] = {}
    worst = [0.0]

    def look() -> None:
        touching = engine._contacts._touching
        for touch in touching:
            before = pushed.get(touch.pair, 0.0)
            if before > 1.0:
                along = np.array(touch.feedback.force1[:3]) - touch.push() * np.array(touch.normal)
                worst[0] = max(worst[0], float(np.linalg.norm(along)) / before)
        pushed.clear()
        pushed.update({touch.pair: touch.push() for touch in touching})

    walk(engine, 300, look)
    return worst[0]


def test_friction_is_bounded_by_the_force_of_the_last_step() -> None:
    """Two directions, each up to 0.5 of it: 0.71 together. ODE's own way finds other forces, and more friction."""
    assert 0.5 < worst_friction(ACCURATE) <= 0.5 * 2**0.5 + 1e-9
    assert worst_friction(WEBOTS) > 0.75


def slide(settings: OdeSettings, angle: float, heading: float, friction: float) -> float:
    """Return the acceleration of a table down a slope [m/s²] whose way down is turned by a heading [rad]."""
    (c, s), (w, y) = ((np.cos(part / 2), np.sin(part / 2)) for part in (heading, -angle))
    turn = np.array([c * w, -s * y, c * y, s * w])
    normal = matrix(turn)[:, 2]
    ground = Ground(np.array([[3.0, 3.0, 0.5]]), np.array([2.0 * UPRIGHT[[1, 2, 0]] - 0.5 * normal]), turn[None])
    engine = OdeEngine(replace(Body.nominal(SPEC), ground_friction=friction), ground, STEP, settings)
    start = 2.0 * UPRIGHT[[1, 2, 0]] + PLACE[2] * normal
    engine.reset(STANDING, start, turn)
    motion = record(engine, 200, still(engine.body))
    middle, end = np.linalg.norm(motion.base_position[[100, 200]] - start, axis=-1)
    return float((end - middle) / (0.5 * (0.4**2 - 0.2**2)))


def test_feet_slide_as_well_askew() -> None:
    """By g (sin 0.3 - 0.2 cos 0.3) at any heading; Webots' axes are fixed: askew, friction is the root of two more."""
    wanted = GRAVITY * (np.sin(0.3) - 0.2 * np.cos(0.3))
    assert slide(ACCURATE, 0.3, np.pi / 4, 0.2) == pytest.approx(wanted, rel=0.03)
    more = GRAVITY * (np.sin(0.3) - 0.2 * 2**0.5 * np.cos(0.3))
    assert slide(WEBOTS, 0.3, np.pi / 4, 0.2) == pytest.approx(more, rel=0.1)


def test_an_angle_beyond_half_a_turn_is_read_back() -> None:
    """Go1's thighs reach 4.5 rad; ODE's own angle would come back as -1.9."""
    spec = find_robot("go1")
    engine = OdeEngine(Body.nominal(spec, fixed=True), flat(), STEP)
    angles = spec.joint_values("default_position")
    angles[1] = 4.4
    engine.reset(angles, np.array([0.0, 0.0, 2.0]), UPRIGHT)
    record(engine, 50, still(engine.body))
    np.testing.assert_allclose(engine.motion().joint_position, angles, atol=1e-6)


def test_friction_holds_at_a_stop_and_no_more() -> None:
    """At its limit a shank with 2 N m of friction is held against 1 N m away from it, and comes off under 3."""
    engine = OdeEngine(Body.nominal(SPEC, fixed=True), flat(), STEP)
    engine.reset(STANDING, np.array([0.0, 0.0, 2.0]), UPRIGHT)
    torque, bound = NOTHING.copy(), np.full(SPEC.num_joints, HELD)
    bound[-1] = 2.0
    reached = []
    for level in (8.0, -1.0, -3.0):
        torque[-1] = level
        record(engine, 300, lambda number, motion: (torque, bound))
        reached.append(engine.motion().joint_position[-1] - SPEC.kind("shank").upper)
    assert reached[0] == pytest.approx(0.0, abs=1e-3) and reached[1] == pytest.approx(reached[0], abs=1e-3)
    assert reached[2] < -0.5


def _kick(number: int) -> tuple[np.ndarray, np.ndarray]:
    """Return torques that make a robot jump and fall, and some friction."""
    return np.full(SPEC.num_joints, 20.0 * np.sin(0.1 * number)), np.full(SPEC.num_joints, 0.5)


def _jump(engine: OdeEngine) -> Motion:
    """Return the motion after a hundred steps of kicks."""
    for number in range(100):
        engine.step(*_kick(number))
    return engine.motion()


def test_a_robot_that_blew_up_walks_again_as_if_new() -> None:
    """Something of the explosion, left in a body or a motor, would spoil the next episode."""
    engine = on_the_plane()
    with pytest.raises(BlownUp, match="'ode'"):
        for _ in range(10):
            engine.step(np.full(SPEC.num_joints, 1e9), NOTHING)
    with pytest.raises(BlownUp, match="reset it first"):
        engine.step(NOTHING, NOTHING)
    engine.reset(STANDING, PLACE, UPRIGHT)
    assert same(_jump(engine), _jump(on_the_plane()))


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda: on_the_plane().step(np.full(18, np.nan), NOTHING), "torque of joint 0 is nan"),
        (lambda: on_the_plane().step(NOTHING, np.full(18, np.inf)), "friction of joint 0 is inf"),
        (lambda: on_the_plane().step(NOTHING, np.full(18, -1.0)), "none under zero"),
        (lambda: on_the_plane().reset(STANDING, PLACE, np.zeros(4)), "length 1"),
        (lambda: on_the_plane(armature=NOTHING, damping=NOTHING), "sum of armature and damping of 0; .* above 0"),
        (lambda: on_the_plane(ground_friction=-1.0), "friction"),
        (
            lambda: on_the_plane(spec=replace(SPEC, links=tuple(link.scaled(0.0) for link in SPEC.links))),
            "mass .* of 0",
        ),
        (
            lambda: on_the_plane(spec=replace(SPEC, joints=tuple(replace(joint, upper=6.0) for joint in SPEC.joints))),
            "range of a joint .* of 6.8; .* below 6.283",
        ),
    ],
)
def test_what_would_end_the_process_is_an_error(act: Callable[[], object], message: str) -> None:
    """ODE's failed assertions call abort(): hours of evaluation would be gone without a word."""
    with pytest.raises(StictionError, match=message) as caught:
        act()
    assert "\n" not in str(caught.value)


def test_a_process_ends_well_with_robots_alive() -> None:
    """Destroyed in the wrong order, or after the library, they would crash the interpreter on its way out."""
    code = (
        "import numpy as np\n"
        "from stiction.robots.catalog import find_robot\n"
        "from stiction.engines.engine import Body\n"
        "from stiction.engines.ground import course, flat\n"
        "from stiction.engines.ode.engine import OdeEngine\n"
        "body = Body.nominal(find_robot('go1'))\n"
        "rough = course('rough', 0.1)\n"
        "engines = [OdeEngine(body, g, 0.002) for g in (rough, flat())]\n"
        "for engine in engines: engine.me = engine; engine.step(np.zeros(12), np.zeros(12))\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
