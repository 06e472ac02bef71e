"""The deployed observation, against numbers worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.deploy.observation import ObservationBuilder, Sensors
from stiction.files.observation import SLOW_TERMS, ObservationLayout, Term, proprioception

STANDING = np.array([0.5, -1.0])

LAYOUT = ObservationLayout(
    (
        Term("angular_velocity", 3, 0.25, 5.0, "base"),
        Term("roll_pitch", 2, 1.0, 3.2, "base"),
        Term("placeholder_terrain", 1, 1.0, 1.0, "none"),
        Term("command", 3, 2.0, 5.0, "command"),
        Term("joint_position", 2, 1.0, 5.0, "joint", "standing"),
        Term("joint_velocity", 2, 0.05, 5.0, "joint"),
        Term("last_action", 2, 1.0, 10.0, "joint"),
    ),
    history_length=3,
)


def sensors(position: float = 0.0) -> Sensors:
    """One robot rolled by 0.2 rad, both joints at `position`."""
    return Sensors(
        np.array([np.cos(0.1), np.sin(0.1), 0.0, 0.0]),
        np.array([1.0, 40.0, -2.0]),
        np.full(2, position),
        np.array([10.0, -1000.0]),
    )


def test_a_frame_by_hand() -> None:
    """clip((raw - offset) * scale), term by term."""
    builder = ObservationBuilder(LAYOUT, STANDING)
    frame = builder.frame(sensors(0.25), np.array([0.5, 0.0, -3.0]), np.array([0.1, 20.0]))
    expected = [0.25, 5.0, -0.5, 0.2, 0.0, 0.0, 1.0, 0.0, -5.0, -0.25, 1.25, 0.5, -5.0, 0.1, 10.0]
    np.testing.assert_allclose(frame, expected, atol=1e-12)


def test_history_is_oldest_first_and_starts_full() -> None:
    """After a reset all frames are the present one; then they move to the front."""
    builder = ObservationBuilder(LAYOUT, STANDING)
    joint = 9  # where joint_position starts in a frame
    seen = []
    for position in (1.0, 2.0, 3.0, 4.0):
        stacked = builder.step(sensors(position), np.zeros(3), np.zeros(2))
        seen.append((stacked.reshape(3, -1)[:, joint] + STANDING[0]).tolist())
    assert seen == [[1, 1, 1], [1, 1, 2], [1, 2, 3], [2, 3, 4]]
    builder.reset()
    stacked = builder.step(sensors(5.0), np.zeros(3), np.zeros(2))
    assert (stacked.reshape(3, -1)[:, joint] + STANDING[0]).tolist() == [5, 5, 5]


def test_a_batch_is_its_robots_one_by_one() -> None:
    """A batch gives each robot the observation that it has alone."""
    generator = np.random.default_rng(0)
    layout = proprioception(18)
    standing = generator.standard_normal(18)
    together = ObservationBuilder(layout, standing, (3,))
    alone = [ObservationBuilder(layout, standing) for _ in range(3)]
    for step in range(15):
        if step == 6:
            together.reset(np.array([False, True, False]))
            alone[1].reset()
        quaternion = generator.standard_normal((3, 4))
        quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
        readings = [quaternion, *(generator.standard_normal((3, size)) for size in (3, 18, 18, 3, 18))]
        batch = together.step(Sensors(*readings[:4]), *readings[4:])
        rows = [alone[i].step(Sensors(*(r[i] for r in readings[:4])), *(r[i] for r in readings[4:])) for i in range(3)]
        np.testing.assert_array_equal(batch, rows)
    assert batch.dtype == np.float32
    assert batch.shape == (3, 715)


def test_sensors_of_the_wrong_shape_are_refused() -> None:
    """Rejects a single value for all joints."""
    builder = ObservationBuilder(LAYOUT, STANDING)
    wrong = Sensors(sensors().quaternion, sensors().angular_velocity, np.zeros(1), np.zeros(2))
    with pytest.raises(ValueError, match="joint_position"):
        builder.step(wrong, np.zeros(3), np.zeros(2))


TOLD = ObservationLayout((*LAYOUT.terms, Term("known_friction", 2, 5.0, 5.0, "kind")), 3)


def test_known_friction_by_hand() -> None:
    """Five times f/τ_max in every frame, cut off at 100 % of the limit; the same for all robots, or each its own."""
    builder = ObservationBuilder(TOLD, STANDING, (), np.array([0.1, 1.5]))
    stacked = builder.step(sensors(), np.zeros(3), np.zeros(2)).reshape(3, -1)
    np.testing.assert_allclose(stacked[:, -2:], [[0.5, 5.0]] * 3)
    two = Sensors(*(np.stack([value] * 2) for value in sensors().arrays().values()))
    for known, expected in (([0.1, 0.2], [[0.5, 1.0]] * 2), ([[0.1, 0.2], [0.0, 0.4]], [[0.5, 1.0], [0.0, 2.0]])):
        frame = ObservationBuilder(TOLD, STANDING, (2,), np.array(known)).frame(two, np.zeros((2, 3)), np.zeros((2, 2)))
        np.testing.assert_allclose(frame[:, -2:], expected)


@pytest.mark.parametrize(
    ("layout", "known", "message"),
    [
        (TOLD, [0.1], r"shape \(1,\); expected \(2,\) or \(3, 2\)"),
        (TOLD, [[0.1, 0.1]], r"shape \(1, 2\)"),
        (TOLD, [0.1, -0.1], "from 0 on"),
        (TOLD, [0.1, np.nan], "from 0 on"),
        (LAYOUT, [0.1, 0.1], "observes none; leave it out"),
    ],
)
def test_known_friction_that_does_not_fit_is_refused(layout: ObservationLayout, known: list, message: str) -> None:
    """Rejects a single value for all kinds of joints."""
    with pytest.raises(StictionError, match=message):
        ObservationBuilder(layout, STANDING, (3,), np.array(known))


SLOW = replace(
    LAYOUT, terms=tuple(Term(name, 2, 1.0, 5.0, "joint_size") for name in SLOW_TERMS), slow_kept=0.5, history_length=1
)


def slowly(errors: list[float], velocity: float = 2.0) -> list[np.ndarray]:
    """Return |e|, |θ'| and e θ' of the first joint as they are observed, step by step; its errors are given [rad]."""
    builder, seen = ObservationBuilder(SLOW, STANDING, (), None, 0.25), []
    for error in errors:
        asked = np.full(2, 0.4)
        position = STANDING + 0.25 * asked - error
        reading = replace(sensors(), joint_position=position, joint_velocity=np.array([velocity, 0.0]))
        seen.append(builder.step(reading, np.zeros(3), asked)[::2])
    return seen


def test_slow_means_by_hand() -> None:
    """Errors of 0.4, −0.1, 0.3 rad at 2 rad/s, each of half the weight of the next; weights sum up to 1, 1.5, 1.75."""
    first, second, third = slowly([0.4, -0.1, 0.3])
    np.testing.assert_allclose(first, [0.4, 2.0, 0.8], rtol=1e-6)
    np.testing.assert_allclose(second, [(0.2 + 0.1) / 1.5, 2.0, (0.4 - 0.2) / 1.5], rtol=1e-6)
    np.testing.assert_allclose(third, [(0.1 + 0.05 + 0.3) / 1.75, 2.0, (0.2 - 0.1 + 0.6) / 1.75], rtol=1e-6)


def test_a_reset_forgets_slow_means_of_that_robot_alone() -> None:
    """The reset of a robot clears its slow means and no other robot's."""
    two = Sensors(*(np.stack([value] * 2) for value in sensors(0.3).arrays().values()))
    other = replace(two, joint_position=two.joint_position + 1.0)
    builder = ObservationBuilder(SLOW, STANDING, (2,), None, 0.25)
    builder.step(two, np.zeros((2, 3)), np.zeros((2, 2)))
    builder.reset(np.array([True, False]))
    fresh, going = builder.step(other, np.zeros((2, 3)), np.zeros((2, 2)))
    assert fresh[0] == pytest.approx(abs(STANDING[0] - 1.3)) and fresh[0] != pytest.approx(going[0])
    assert going[0] == pytest.approx((0.5 * abs(STANDING[0] - 0.3) + abs(STANDING[0] - 1.3)) / 1.5)
