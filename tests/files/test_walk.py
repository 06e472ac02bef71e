"""Walking logs: written and read whole, or refused in one line."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stiction.core.errors import LogError, StictionError
from stiction.files.walk import SCHEMA, SCHEMA_VERSION, WalkHeader, WalkLog, is_walk, read_walk, write_walk

HEADER = WalkHeader(
    robot="saturn_lite",
    joint_names=("FL_hip", "FL_thigh", "FL_shank"),
    foot_names=("FL_foot",),
    period=0.005,
    kp=(100.0, 100.0, 100.0),
    kd=(2.5, 2.5, 2.5),
    torque_limit=(25.0, 25.0, 45.0),
    torque_source="motor_side",
    noise={"encoder_resolution": 1e-4},
)


def make_log(samples: int = 6, **changes) -> WalkLog:
    """Return a small log of everything."""
    generator = np.random.default_rng(0)
    signals = {
        "time": np.arange(samples) * 0.005,
        "joint_position": generator.normal(size=(samples, 3)),
        "joint_velocity": generator.normal(size=(samples, 3)),
        "joint_target": generator.normal(size=(samples, 3)),
        "joint_torque": generator.normal(size=(samples, 3)),
        "angular_velocity": generator.normal(size=(samples, 3)),
        "quaternion": np.tile([1.0, 0.0, 0.0, 0.0], (samples, 1)),
        "specific_force": np.tile([0.0, 0.0, 9.81], (samples, 1)),
        "foot_contact": np.arange(samples)[:, None] % 2 == 0,
    }
    return WalkLog(**{"header": HEADER} | signals | changes)


def test_what_is_written_is_read(tmp_path: Path) -> None:
    """Header exactly, signals to single precision; what was not measured stays absent."""
    log = make_log()
    write_walk(tmp_path / "a" / "walk.npz", log)
    again = read_walk(tmp_path / "a" / "walk.npz")
    assert again.header == HEADER
    np.testing.assert_allclose(again.joint_torque, log.joint_torque, rtol=1e-6)
    np.testing.assert_array_equal(again.foot_contact, log.foot_contact)
    np.testing.assert_array_equal(again.time, log.time)
    assert again.joint_position.dtype == np.float64
    assert again.linear_velocity is None
    assert len(again) == 6


def test_a_walking_log_is_told_from_another_archive(tmp_path: Path) -> None:
    """`identify` decides by this which path a file takes."""
    write_walk(tmp_path / "walk.npz", make_log())
    np.savez(tmp_path / "bench.npz", time=np.zeros(3))
    (tmp_path / "text.npz").write_text("time,position")
    assert is_walk(tmp_path / "walk.npz")
    assert not any(is_walk(tmp_path / name) for name in ("bench.npz", "text.npz", "absent.npz"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"joint_torque": np.zeros((6, 2))}, "joint_torque.*expected float"),
        ({"joint_position": np.full((6, 3), np.nan)}, "joint_position.*finite"),
        ({"joint_position": None}, "joint_position"),
        ({"foot_contact": np.zeros((6, 1))}, "foot_contact.*bool"),
        ({"quaternion": np.zeros((6, 4))}, "unit quaternions"),
        ({"time": np.arange(6) * 0.01}, "period"),
        ({"time": np.zeros((6, 1))}, "two samples"),
    ],
)
def test_signals_that_no_log_has_are_refused(change: dict, message: str) -> None:
    """A wrong shape would otherwise broadcast into a wrong friction."""
    with pytest.raises(LogError, match=message):
        make_log(**change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"joint_names": ("a", "a", "b")}, "different names"),
        ({"kp": (1.0,)}, "one per joint"),
        ({"torque_limit": (0.0, 1.0, 1.0)}, "torque_limit"),
        ({"period": float("nan")}, "period"),
        ({"torque_source": "somewhere"}, "motor_side or output_side"),
    ],
)
def test_headers_that_no_log_has_are_refused(change: dict, message: str) -> None:
    """Gains for the wrong joints would go unnoticed."""
    with pytest.raises(LogError, match=message):
        replace(HEADER, **change)


def rewritten(path: Path, header: object = None, arrays: dict | None = None) -> Path:
    """Return a log on disk with another header or other arrays; None takes an array out."""
    write_walk(path, make_log())
    with np.load(path) as archive:
        content = {name: archive[name] for name in archive.files} | (arrays or {})
    if header is not None:
        content["header"] = np.array(header if isinstance(header, str) else json.dumps(header))
    np.savez(path, **{name: array for name, array in content.items() if array is not None})
    return path


WHOLE = {"schema": SCHEMA, "schema_version": SCHEMA_VERSION} | asdict(HEADER)


@pytest.mark.parametrize(
    ("header", "arrays", "message"),
    [
        ("{", {}, "not JSON"),
        (WHOLE | {"schema": "other"}, {}, SCHEMA),
        (WHOLE | {"schema_version": 2}, {}, "version 2; this program reads version 1"),
        ({key: value for key, value in WHOLE.items() if key != "kd"}, {}, "'kd' is missing"),
        (None, {"header": None}, "no header"),
        (None, {"quaternion": None}, "no array 'quaternion'"),
        (None, {"joint_torque": np.zeros((6, 3), int)}, "joint_torque"),
    ],
)
def test_files_that_are_not_such_logs_are_refused(tmp_path: Path, header, arrays: dict, message: str) -> None:
    """One line that names file and field."""
    with pytest.raises(StictionError, match=message) as caught:
        read_walk(rewritten(tmp_path / "walk.npz", header, arrays))
    assert "walk.npz" in str(caught.value)
    assert "\n" not in str(caught.value)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), min_size=1, max_size=8), st.floats(0, 1)
)
def test_a_damaged_file_is_refused_or_read_whole(tmp_path: Path, changes: list, cut: float) -> None:
    """Flipped bytes and a cut end: the one error, never a traceback, never a part of the file."""
    path = tmp_path / "walk.npz"
    write_walk(path, make_log())
    data = bytearray(path.read_bytes())
    for place, value in changes:
        data[int(place * len(data))] = value
    path.write_bytes(bytes(data[: int(cut * len(data))] if cut < 0.5 else data))
    try:
        again = read_walk(path)
    except StictionError as error:
        assert "\n" not in str(error)
    else:
        np.testing.assert_allclose(again.joint_position, make_log().joint_position, rtol=1e-6)
