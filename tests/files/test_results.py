"""Results are read back as they were written, and bad files are named."""

from pathlib import Path

import pytest

from stiction.core.errors import StictionError
from stiction.files.results import COLUMNS, ResultRow, read_results, write_results


def row(**changes) -> ResultRow:
    """Return a row with some cells changed."""
    values = dict(zip(COLUMNS, ("p", "none", 0, "mujoco", "coulomb", 0.1, "flat", "vx=0.3,wz=0.2"), strict=False))
    values |= {"speed_ratio": 1 / 3, "tracking_error": 0.1, "fall_rate": 0.0, "distance": 2.0, "steps_climbed": None}
    values |= {"joint_jitter": 10.0, "flight_share": 0.0, "episodes": 8}
    values |= dict.fromkeys(("cost_of_transport", "tripod_share"))
    return ResultRow(**(values | changes))


def test_the_columns_are_those_of_the_contract() -> None:
    """Later stages and other people's scripts read them by name."""
    expected = (
        "policy,method,seed,engine,friction_law,friction_level,terrain,command,speed_ratio,tracking_error,fall_rate,"
        "distance,steps_climbed,cost_of_transport,joint_jitter,tripod_share,flight_share,episodes,slowest,fastest,slowest_walk,"
        "mean_vx,mean_vy,mean_wz,joint_chatter"
    )
    assert ",".join(COLUMNS) == expected


def test_what_each_robot_reached_is_written_where_robots_were_virtual(tmp_path: Path) -> None:
    """Files of before, and of the robot of the data sheet alone, have no such columns, and are read all the same."""
    path = tmp_path / "results.csv"
    write_results(path, [row()])
    assert path.read_text().splitlines()[0] == ",".join(COLUMNS[:-7]) and read_results(path) == [row()]
    rows = [row(), row(slowest=0.6, fastest=1.4)]
    write_results(path, rows)
    assert path.read_text().splitlines()[0] == ",".join(COLUMNS[:-5]) and read_results(path) == rows
    path.write_text(path.read_text().replace("slowest,fastest", "fastest,slowest"))
    with pytest.raises(StictionError, match="first line"):
        read_results(path)


def test_the_slowest_walk_is_written_where_it_is_known(tmp_path: Path) -> None:
    """Beside robots or without them; a cell without one, and a file of before, is None and no number."""
    path = tmp_path / "results.csv"
    for ends in ({}, {"slowest": 0.6, "fastest": 1.4}):
        rows = [row(slowest_walk=0.28, **ends), row(speed_ratio=None, command="stand")]
        write_results(path, rows)
        header, first, second = path.read_text().splitlines()
        assert header.endswith(f"episodes,{'slowest,fastest,' * bool(ends)}slowest_walk")
        assert first.endswith(",0.28") and second.endswith(",") and read_results(path) == rows


def test_rows_read_back_exactly(tmp_path: Path) -> None:
    """Empty stays empty, a comma in a command stays one cell, and every digit survives."""
    rows = [row(), row(speed_ratio=None, command="stand"), row(speed_ratio=-0.1, policy='a "quoted" name')]
    write_results(tmp_path / "results.csv", rows)
    assert read_results(tmp_path / "results.csv") == rows
    with pytest.raises(StictionError, match=r"nothing\.csv"):
        read_results(tmp_path / "nothing.csv")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("fall_rate", "falls", "first line"),
        (",0.1,", ",much,", "line 2"),
        (",8\n", ",8.5\n", "episodes"),
        (",8\n", "\n", "17 cells"),
        ("10.0", "inf", "finite"),
        ("10.0", "", "joint_jitter"),
    ],
)
def test_a_bad_cell_is_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    """A figure drawn from half a file would mislead."""
    path = tmp_path / "results.csv"
    write_results(path, [row()])
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(StictionError, match=message):
        read_results(path)
