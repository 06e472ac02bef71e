"""Rows of a table: the unit of the stamps, the used part, empty cells, several files."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.core.errors import LogError
from stiction.files.log import JointSignals, Log
from stiction.identification.logs import join_logs
from stiction.identification.logs.rows import complete_rows, cut, seconds

STEPS = np.arange(50.0)


@pytest.mark.parametrize(
    ("stamps", "name", "step", "message"),
    [
        (0.002 * STEPS, "time", 0.002, ""),
        (0.08 * STEPS, "time", 0.08, ""),  # 12 Hz in seconds, never 12 kHz in milliseconds
        (2 * STEPS, "time", 0.002, "taken to be in ms"),
        (2000 * STEPS, "time", 0.002, "taken to be in µs"),
        (5e6 * STEPS, "time", 0.005, "taken to be in ns"),
        (1.7e12 + STEPS, "time", 0.001, "taken to be in ms"),
        (1.7e15 + 20 * STEPS, "t", 2e-5, "taken to be in µs"),
        (0.5 * STEPS, "time_ms", 0.0005, "as its column 'time_ms' says"),
        (5e6 * STEPS, "timestamp [ns]", 0.005, "as its column"),
        (0.5 * STEPS, "time", 0.5, ""),  # 2 Hz, or 2 kHz in milliseconds: nobody can tell
        (STEPS, "time", 1.0, ""),  # a counter of samples, perhaps
        (1e9 * STEPS, "time", 1e9, ""),
    ],
)
def test_the_unit_of_stamps_is_found_or_left(stamps: np.ndarray, name: str, step: float, message: str) -> None:
    """An ambiguous unit is left to the user."""
    time, _, notes = seconds(stamps, name, None)
    assert time[1] - time[0] == pytest.approx(step)
    assert (message in notes[0]) if message else not notes


def log(time: np.ndarray, source: str = "x", **signals: np.ndarray) -> Log:
    """Return a log of one joint."""
    return Log(source, time, {"a": JointSignals(**signals)})


def test_a_part_of_a_log() -> None:
    """From the first stamp, both ends included."""
    part = cut(log(10 + 0.5 * STEPS, position=STEPS), 1.0, 2.0)
    np.testing.assert_array_equal(part.joints["a"].position, [2, 3, 4])
    assert part.notes == ("3 of 50 samples are used, from 1 to 2 s",)
    with pytest.raises(LogError, match=r"nothing between 30 and inf s; the log goes from 0 to 24\.5 s"):
        cut(log(0.5 * STEPS, position=STEPS), 30.0, None)


def test_empty_cells() -> None:
    """A target is held from its row, a torque interpolated between its rows, a row without position left out."""
    gap = np.nan
    result = complete_rows(
        log(
            np.arange(6.0),
            position=np.array([gap, 1.0, 2.0, gap, 4.0, 5.0]),
            target=np.array([7.0, gap, gap, 8.0, gap, gap]),
            torque=np.array([0.0, gap, 20.0, 30.0, gap, gap]),
        )
    )
    signals = result.joints["a"]
    np.testing.assert_array_equal(result.time, [1, 2])
    np.testing.assert_array_equal(signals.target, [7, 7])
    np.testing.assert_array_equal(signals.torque, [10, 20])
    assert result.notes[0].startswith("4 of 6 rows have empty cells") and "target stands in other" in result.notes[0]
    with pytest.raises(LogError, match="0 of 2 rows have a time and the position of every joint"):
        complete_rows(log(np.arange(2.0), position=np.full(2, gap)))


def test_parts_of_one_log_go_on_where_the_last_ended() -> None:
    """By the clock of the files, which each reader may have counted from its own first stamp."""
    first = Log("0", np.arange(3.0), {"a": JointSignals(position=np.arange(3.0))}, start=100.0)
    second = Log("1", np.arange(3.0), {"a": JointSignals(position=np.arange(3.0, 6.0))}, start=103.0)
    whole = join_logs([first, second])
    np.testing.assert_array_equal(whole.time, np.arange(6.0))
    np.testing.assert_array_equal(whole.joints["a"].position, np.arange(6.0))
    with pytest.raises(LogError, match="several runs, not parts of one log"):
        join_logs([second, first])
    with pytest.raises(LogError, match="other joints"):
        join_logs([first, Log("1", np.arange(3.0), {"b": JointSignals(position=np.zeros(3))}, start=103.0)])
    with pytest.raises(LogError, match="torque of joint 'a' is in some"):
        both = JointSignals(position=np.zeros(3), torque=np.zeros(3))
        join_logs([first, Log("1", np.arange(3.0), {"a": both}, start=103.0)])
