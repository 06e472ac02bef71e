"""Mapping of columns to signals of joints."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.core.errors import LogError
from stiction.files.tables import Table
from stiction.identification.logs.naming import find_signals, parse_columns


def table(*names: str) -> Table:
    """Return columns whose values are their place."""
    return Table({name: np.full(3, float(place)) for place, name in enumerate(names)})


def test_a_mapping_is_parsed() -> None:
    """`torque=vir` says that the column vir is the torque; a name may hold an equals sign."""
    assert parse_columns(["time=t", "torque=a=b"]) == {"time": "t", "torque": "a=b"}
    assert parse_columns(["state=/s", "command=/c"]) == {"state": "/s", "command": "/c"}
    assert parse_columns(["disturbance=d"]) == {"disturbance": "d"}


@pytest.mark.parametrize("words", [["position"], ["position="], ["angle=q"], ["time=t", "time=u"]])
def test_a_bad_mapping_is_refused(words: list[str]) -> None:
    """The message repeats the word and lists the roles."""
    with pytest.raises(LogError, match=r"(expected ROLE=NAME|unknown role 'angle').*velocity"):
        parse_columns(words)


def test_one_joint_by_a_mapping() -> None:
    """Names of other programs; the time may keep its usual name."""
    signals = find_signals("x", table("t", "qm", "vir"), {"position": "qm", "torque": "vir"}, "knee")
    time, joints = signals.time, signals.joints
    assert time is not None and time[0] == 0
    assert joints["knee"].position[0] == 1 and joints["knee"].torque[0] == 2  # type: ignore[index]
    with pytest.raises(LogError, match=r"no column 'q'; the columns are t, qm, vir"):
        find_signals("x", table("t", "qm", "vir"), {"position": "q"}, None)
    with pytest.raises(LogError, match="unknown role 'angle'"):
        find_signals("x", table("t"), {"angle": "t"}, None)
    with pytest.raises(LogError, match="names no signal"):
        find_signals("x", table("t"), {"time": "t"}, None)


def test_patterns_for_numbers_and_for_names() -> None:
    """`q_{joint}` finds q_0 and q_1 and not q_des_0, which another pattern names; names work as well as numbers."""
    columns = {"position": "q_{joint}", "target": "q_des_{joint}"}
    signals = find_signals("x", table("t", "q_1", "q_0", "q_des_0", "q_des_1"), columns, None)
    joints = signals.joints
    assert list(joints) == ["joint_0", "joint_1"]
    assert joints["joint_0"].position[0] == 2 and joints["joint_0"].target[0] == 3  # type: ignore[index]
    signals = find_signals("x", table("t", "q_FL", "q_des_FL", "q_FR", "q_des_FR"), columns, None)
    joints = signals.joints
    assert list(joints) == ["FL", "FR"] and joints["FR"].target[0] == 4  # type: ignore[index]
    signals = find_signals("x", table("t", "FL.angle"), {"position": "{joint}.angle"}, None)
    joints = signals.joints
    assert list(joints) == ["FL"]


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"position": "p_{joint}"}, r"no column fits position=p_\{joint\}; the columns are t, q_0"),
        ({"position": "q_{joint}", "torque": "tau"}, "torque=tau names one column, the others patterns"),
        ({"position": "q_{joint}{joint}"}, "more than once"),
    ],
)
def test_a_bad_pattern_is_refused(columns: dict[str, str], message: str) -> None:
    """Rejects a pattern in one line, with its text and the known columns."""
    with pytest.raises(LogError, match=message):
        find_signals("x", table("t", "q_0", "tau"), columns, None)


def test_nothing_recognised_is_refused_with_a_way_out() -> None:
    """The message shows the nearest mapping that could be meant, or both kinds."""
    for names, message in (
        (("time", "spin"), r"position=NAME, or position=NAME_\{joint\}"),
        (("time", "angle", "tau"), "perhaps --columns position=angle torque=tau"),
        (("stamp", "q1", "q2", "effort1"), r"--columns time=stamp position=q\{joint\} torque=effort\{joint\}"),
        (("0", "1", "2"), r"--columns time=0 position=1 torque=2, or position=1,2,3"),
    ):
        with pytest.raises(LogError, match=message):
            find_signals("x", table(*names), None, None)
