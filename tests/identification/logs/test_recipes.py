"""Foreign files: each form of the recipes is read, and other files are rejected with the nearest recipe."""

from __future__ import annotations

import csv
import importlib.util
import shlex
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from stiction.cli.identify import IdentifyConfig
from stiction.cli.main import main
from stiction.core.options import read_options
from stiction.identification.logs import join_logs, open_log, parse_columns
from stiction.identification.runs import in_si
from stiction.identification.setup import IdentifySetup

ROOT = Path(__file__).parents[3]
RESULTS = ROOT / "results" / "identification"


def load(name: str) -> ModuleType:
    """Import a script."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


strangers = load("strangers")


SERVOS = [stranger for stranger in strangers.STRANGERS if stranger.write.__name__.startswith("servo")]
"""Servos, whose column is no torque: their conversion is judged by the identified friction."""

OTHERS = [stranger for stranger in strangers.STRANGERS if stranger not in SERVOS]


@pytest.mark.parametrize("stranger", SERVOS, ids=lambda stranger: stranger.write.__name__)
def test_a_servo_s_recipe_finds_its_friction(tmp_path: Path, stranger: object) -> None:
    """The recipe finds the simulated friction within 5 %, by the commands as they are typed."""
    assert strangers.outcome(tmp_path, stranger)["within 5 %"] == "yes"


@pytest.mark.parametrize("stranger", OTHERS, ids=lambda stranger: stranger.write.__name__)
def test_a_recipe_reads_what_was_simulated(tmp_path: Path, stranger: object) -> None:
    """Position, target and torque of the right joint, at the right time, in SI units, by the command as it is typed."""
    stranger.write(tmp_path)  # type: ignore[attr-defined]
    *_, command = stranger.commands  # type: ignore[attr-defined]
    if len(stranger.commands) == 2:  # type: ignore[attr-defined]
        assert strangers.run(tmp_path, stranger.commands[0])[0] == 0  # type: ignore[attr-defined]
    config = read_options(IdentifyConfig, shlex.split(command), "stiction identify", "")
    joint = config.joint[0] if config.joint else None
    logs = [
        open_log(
            *(tmp_path / path, parse_columns(config.columns), joint, config.names, config.rate, config.sidecar),
            *(config.time_scale, config.begin, config.end),
        )
        for path in config.log
    ]
    log = join_logs(logs) if config.join else logs[0]
    assert tuple(log.joints) == stranger.joints  # type: ignore[attr-defined]
    shift = 0.0 if config.begin is None else config.begin
    time = log.time - log.time[0]
    rows = np.rint(500 * (time + (shift - 2.0 if shift else 0.0))).astype(int)
    inside = (rows >= 0) & (rows < 6000)
    assert inside.sum() >= 5999 and np.abs(np.diff(time) - 0.002).max() < 1e-6
    for name, signals in log.joints.items():
        scaled = in_si(signals, IdentifySetup(position_scale=config.position_scale))
        scale = log.setup_of(name).torque_scale or 1.0
        for role, factor, tolerance in (("position", 1.0, 1e-6), ("target", 1.0, 1e-6), ("torque", scale, 1e-6)):
            values = getattr(scaled, role)
            if values is not None:
                truth = strangers.DATA[f"{role}.{name}"]
                np.testing.assert_allclose(factor * values[inside], truth[rows[inside]], atol=tolerance, rtol=1e-5)
    measured = stranger.unit == "N m"  # type: ignore[attr-defined]
    assert all((signals.torque is not None) == measured for signals in log.joints.values())


@pytest.mark.parametrize("case", strangers.REFUSED, ids=lambda case: case[0])
def test_what_is_not_read_is_told_the_nearest_way_in(tmp_path: Path, case: tuple) -> None:
    """One line, status 1, and a thing to do."""
    _, write, command = case
    write(tmp_path)
    status, output = strangers.run(tmp_path, command)
    ways = ("rostopic", "numpy.savez", "save it as CSV", "give the log", ".parquet file", "--time-scale")
    ways += ("--torque-scale", "position=NAME")
    assert status == 1 and any(way in output for way in ways), output


def test_the_table_is_of_these_commands() -> None:
    """The page that people copy from is the one whose commands are tested; none takes more than two."""
    with (RESULTS / "strangers.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    typed = [" && ".join(f"stiction identify {line}" for line in one.commands) for one in strangers.STRANGERS]
    assert [row["commands"] for row in rows] == typed and len(rows) >= 30
    assert all(row["within 5 %"] == "yes" and int(row["count"]) <= 2 for row in rows)
    page = (RESULTS / "strangers.md").read_text(encoding="utf-8")
    for one in strangers.STRANGERS:
        assert all(f"`stiction identify {line.replace(strangers.FLAGS, 'FLAGS')}`" in page for line in one.commands)


@pytest.mark.usefixtures("undrawn")
def test_the_command_line_takes_a_stranger_s_runs(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Several runs in one fit, from files to joints.json; the same file twice is no second run."""
    strangers.several_runs(tmp_path)
    runs = [str(tmp_path / f"run{number}.csv") for number in range(3)]
    flags = [*shlex.split(strangers.FLAGS), "--joint", "hip", "--json", "--out", str(tmp_path / "out")]
    assert main(["identify", *runs, *flags]) == 0
    text = capsys.readouterr().out
    assert "3 runs were fitted together" in text and '"sources"' in text
    flags += ["--overwrite"]
    assert main(["identify", runs[0], runs[1], runs[0], *flags]) == 1
    assert "is the same log as run0.csv" in capsys.readouterr().err
    assert main(["identify", *runs, "--join", *flags]) == 1
    assert "several runs, not parts of one log" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["identify", *flags])
    assert "no log" in capsys.readouterr().err
