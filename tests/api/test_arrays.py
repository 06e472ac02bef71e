"""Logs that are in memory: arrays and data frames, and what is refused of them."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

import stiction

TIME = np.arange(500) / 500


def test_arrays_by_joint_become_a_log() -> None:
    """Signals and gains must come out under the joint that they went in with."""
    log = stiction.from_arrays(
        time=TIME + 7.0, position={"hip": TIME, "knee": -TIME}, torque={"knee": 2 * TIME}, kp={"hip": 3.0}, kd=0.5
    )
    assert log.time[0] == 0.0 and log.joints["knee"].torque == pytest.approx(2 * TIME)
    assert log.joints["hip"].torque is None
    assert (log.setup_of("hip").kp, log.setup_of("knee").kp, log.setup_of("knee").kd) == (3.0, None, 0.5)


class Frame:
    """Minimal stand-in for a pandas or polars table."""

    def __init__(self, **columns: np.ndarray) -> None:
        """Take the columns."""
        self._data = {name.replace("__", "."): values for name, values in columns.items()}

    @property
    def columns(self) -> list[str]:
        """Names, in order."""
        return list(self._data)

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a column."""
        return self._data[name]


def test_a_data_frame_is_read_by_its_columns() -> None:
    """Columns that are no signals, such as a temperature, are left out."""
    log = stiction.from_arrays(Frame(time=TIME, position__hip=TIME, torque__hip=TIME, temperature=TIME), kp=2.0)
    assert list(log.joints) == ["hip"] and log.setup.kp == 2.0


def with_nan() -> np.ndarray:
    """Return a signal with one sample missing."""
    return np.where(np.arange(500) == 9, np.nan, 1.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"position": TIME}, "no time"),
        ({"time": TIME}, "no signal"),
        ({"time": TIME, "position": TIME[:-1]}, r"shape \(499,\); expected \(500,\)"),
        ({"time": TIME, "position": np.zeros((500, 2, 2))}, r"shape \(500, 2, 2\); expected \(T,\)"),
        ({"time": TIME, "position": {"hip": with_nan()}}, "'hip' is nan at sample 9"),
        ({"time": TIME[::-1], "position": TIME}, "does not rise at sample 1"),
        ({"time": np.repeat(TIME[:250], 2), "position": TIME}, "does not rise at sample 1"),
        ({"time": TIME * 1000, "position": TIME}, "ms"),
        ({"time": TIME, "position": TIME * 16384}, "counts"),
        ({"time": TIME, "position": ["a"] * 500}, "not numbers"),
        ({"time": TIME, "positions": TIME}, "unknown name 'positions'"),
        ({"time": TIME, "position": TIME, "kp": "high"}, "kp is high"),
        ({"frame": 3}, "no table with named columns"),
    ],
)
def test_what_is_no_log_is_refused_in_a_line(arguments: dict[str, Any], message: str) -> None:
    """The message has to name the array and the sample, or a user looks for hours."""
    with pytest.raises(stiction.StictionError, match=message) as caught:
        stiction.from_arrays(**arguments)
    assert "\n" not in str(caught.value) and len(re.findall(r"the arrays", str(caught.value))) == 1


def test_an_option_that_there_is_not_is_named_with_the_nearest() -> None:
    """A flag misspelt as a keyword must not be ignored."""
    log = stiction.from_arrays(time=TIME, position=TIME, torque=TIME)
    with pytest.raises(stiction.StictionError, match="did you mean 'motor_strength'"):
        stiction.identify(log, motor_strenght=1.0)
    with pytest.raises(stiction.StictionError, match="torque_source"):
        stiction.identify(log, torque_source="sideways")  # type: ignore[arg-type]


def test_matrices_are_joints_by_name() -> None:
    """Matrices of shape (T, joints) give one joint per column, named by `names` or numbered."""
    both = np.column_stack([np.sin(TIME), np.cos(TIME)])
    log = stiction.from_arrays(time=TIME, position=both, torque=both, names=["hip", "knee"])
    assert list(log.joints) == ["hip", "knee"]
    np.testing.assert_array_equal(log.joints["knee"].torque, np.cos(TIME))
    assert list(stiction.from_arrays(time=TIME, position=both, target=both).joints) == ["joint_0", "joint_1"]
    with pytest.raises(stiction.StictionError, match=r"shape \(500, 2\) and names has 1"):
        stiction.from_arrays(time=TIME, position=both, names=["hip"])


def test_numbers_of_several_joints_come_in_the_order_of_their_names() -> None:
    """As vectors beside matrices; `joints` is another word for the names, and one column has a name too."""
    both = np.column_stack([np.sin(TIME), np.cos(TIME)])
    signals = {"time": TIME, "position": both, "target": both}
    log = stiction.from_arrays(**signals, joints=("hip", "knee"), kp=[20.0, 30.0], kd=np.array([1.0, 2.0]))
    assert [(log.setup_of(name).kp, log.setup_of(name).kd) for name in log.joints] == [(20.0, 1.0), (30.0, 2.0)]
    assert list(stiction.from_arrays(time=TIME, position=TIME, target=TIME, names=["hip"]).joints) == ["hip"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"position": np.ones((2, 500)), "names": ["a", "b"]}, r"position has the shape \(2, 500\) .* do: position\.T"),
        ({"position": np.ones((500, 2)), "target": TIME}, r"target has the shape \(500, 1\) and names has 2"),
        (
            {"position": np.ones((500, 2)), "names": ["a", "b"], "kp": [1.0] * 3},
            r"kp has the shape \(3,\); expected \(2,\)",
        ),
        ({"position": np.ones((500, 2, 1))}, r"shape \(500, 2, 1\)"),
    ],
)
def test_columns_that_belong_to_no_joint_are_refused(arguments: dict, message: str) -> None:
    """A target without its joint would be a joint more, of which nothing can be known."""
    with pytest.raises(stiction.StictionError, match=message):
        stiction.from_arrays(time=TIME, **arguments)
