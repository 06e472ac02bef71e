"""A recording of an arm of hobby servos tells the dead bands of its joints: the example and the page that uses it."""

from __future__ import annotations

import json
import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from code_blocks import blocks_of
from stiction.cli.main import main
from stiction.identification.logs import open_log
from stiction.identification.logs.naming import LEROBOT

pytest.importorskip("pyarrow", reason="the package pyarrow, of the extra 'logs', is needed to read Parquet")

CHECKOUT = Path(__file__).parents[2]
EXAMPLE, PAGE = CHECKOUT / "examples/06_arm_dataset.py", CHECKOUT / "docs/arm.md"


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_the_page_says_what_its_commands_print(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """30 Hz, degrees, no torque and no gains: six dead bands in degrees, as in the page's table, and near what was put
    in; with the gains one friction in N m, which `convert` takes.
    """
    monkeypatch.chdir(tmp_path)
    made = runpy.run_path(str(EXAMPLE))
    identify, known, into = (words[1:] for block in blocks_of(PAGE) for words in block.commands if block.how == "parse")
    capsys.readouterr()
    assert main(identify) == 0
    told = capsys.readouterr()
    printed = dict(re.findall(r"^(\w+) +[\d.]+ ± [\d.]+ +[\d.]+ % +([\d.]+)°", told.out, re.MULTILINE))
    rows = re.findall(r"^\| (\w+) \| (\d\.\d+) \| ([\d.]+)° \|$", PAGE.read_text(), re.MULTILINE)
    assert [row[0] for row in rows] == [*made["NAMES"]]
    assert {row[0]: row[2] for row in rows} == printed
    np.testing.assert_allclose([float(row[1]) for row in rows], np.degrees(made["FRICTION"] / made["KP"]), atol=0.006)
    joints = json.loads((tmp_path / "arm/joints.json").read_text())["joints"]
    for name, friction in zip(made["NAMES"], made["FRICTION"], strict=True):
        low, high = joints[name]["dead_band"]["interval95"]
        assert low < friction / made["KP"] < high < 1.024 * low, name
    assert "stiction convert" not in told.out and "--set motor_strength=1" in told.out
    assert LEROBOT in open_log(Path("arm.parquet")).notes
    assert main(known) == 0
    assert "stiction convert wrist/joints.json --to mujoco" in capsys.readouterr().out
    assert main(into) == 0
    (friction,) = re.findall(r'frictionloss="([\d.]+)"', capsys.readouterr().out)
    assert float(friction) == pytest.approx(made["FRICTION"][3], rel=0.01)
