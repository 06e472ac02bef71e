"""The driver of walks: when commands are asked for, when it stops, and what is recorded."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.virtual.drive import Recorder, Truth, drive, record

PERIOD = 0.02


class Counter:
    """Two robots without physics; the second falls in the third step."""

    def __init__(self, steps_are_seen: bool = False) -> None:
        """Begin at rest."""
        self.commands: list[np.ndarray] = []
        self.steps_are_seen = steps_are_seen

    def step(self, command: np.ndarray) -> int:
        """Count a step."""
        self.commands.append(np.array(command))
        return len(self.commands)

    def truth(self) -> Truth:
        """Return a truth that the number of steps tells; the second robot lies for one step only."""
        done, one = len(self.commands), np.ones((2, 1))
        return Truth(
            velocity=done * np.ones((2, 3)),
            position=np.array([[done, 0.0], [0.0, done]]),
            contact=np.array([[True, False], [False, done % 2 == 0]]),
            torque=np.array([[1.0, -2.0], [0.5, 0.5]]),
            joint_velocity=done * np.array([[0.1, 0.3], [0.0, 0.0]]),
            friction=np.array([[1.0, 3.0], [2.0, 2.0]]) * one,
            fallen=np.array([False, done == 3]),
            chatter=done**2 * np.array([1.0, 0.0]) if self.steps_are_seen else None,
        )


def test_a_command_is_asked_for_just_before_its_step() -> None:
    """Requests a command after the last step, and lets a caller look between two steps."""
    walker, seen, shares = Counter(), [], []

    def command(number: int) -> np.ndarray:
        seen.append((number, len(walker.commands)))
        return np.array([number, 0.0, 0.0])

    for count, step in enumerate(drive(walker, command, 3, shares.append), 1):
        assert step == count == len(seen)
    assert seen == [(0, 0), (1, 1), (2, 2)]
    assert [asked[0] for asked in walker.commands] == [0, 1, 2]
    assert shares == pytest.approx([1 / 3, 2 / 3, 1.0])


def test_a_recording_has_the_columns_of_the_truth() -> None:
    """Power, acceleration and friction are those of the joints; who fell once does not get up again."""
    recording = record(Counter(), np.zeros((2, 3)), PERIOD, 4)
    assert recording.velocity.shape == (4, 2, 3) and recording.velocity.dtype == np.float32
    assert recording.velocity[:, 0, 0].tolist() == [1.0, 2.0, 3.0, 4.0]
    assert recording.position[2].tolist() == [[3.0, 0.0], [0.0, 3.0]]
    assert recording.contact[:, 1, 1].tolist() == [False, True, False, True]
    np.testing.assert_allclose(recording.power[:, 0], 0.7 * np.arange(1, 5), rtol=1e-6)
    np.testing.assert_allclose(recording.square_acceleration[:, 0], (0.1**2 + 0.3**2) / 2 / PERIOD**2, rtol=1e-5)
    assert recording.friction is not None and recording.friction[0].tolist() == [2.0, 2.0]
    assert recording.upright.tolist() == [[True, True], [True, True], [True, False], [True, False]]


def test_a_recording_has_the_chatter_between_control_steps_where_it_is_seen() -> None:
    """Integrals of 1, 4 and 9 rad²/s³ are 1, 3 and 5 in each period, over its length; a batch has none."""
    assert record(Counter(), np.zeros((2, 3)), PERIOD, 3).square_chatter is None
    chatter = record(Counter(steps_are_seen=True), np.zeros((2, 3)), PERIOD, 3).square_chatter
    np.testing.assert_allclose(chatter, [[1 / PERIOD, 0.0], [3 / PERIOD, 0.0], [5 / PERIOD, 0.0]], rtol=1e-6)


@pytest.mark.parametrize("before", [0, 2])
def test_robots_whose_simulation_gave_up_fell_where_they_were_last(before: int) -> None:
    """A step that was never finished is recorded as a fall, even the first."""
    walker = Counter()
    recorder = Recorder(walker, PERIOD, 10, float)
    for _ in drive(walker, np.zeros(3), before):
        recorder.record()
    recorder.record_fall()
    recording = recorder.recording()
    assert recording.upright[:, 0].tolist() == [True] * before + [False]
    assert recording.position[-1, 0].tolist() == [before, 0.0] and recording.velocity.dtype == np.float64
    assert not recorder.upright.any()
