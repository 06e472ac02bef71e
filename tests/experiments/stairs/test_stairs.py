"""Stairs: what counts as climbed, with numbers worked out by hand, and one drive over low steps."""

from pathlib import Path

import numpy as np
import pytest

from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.evaluation.course import steps_passed
from stiction.files.walk import Recording
from stiction.robots.terrain import LANDING, REACH, STEPS, TREAD
from stiction_experiments.stairs.climb import Climb, _judge, highest_climbed
from stiction_experiments.stairs.config import ClimbCfg
from stiction_experiments.stairs.page import answers


def row(height: float, successes: int, trials: int = 100) -> Climb:
    """Return the row of one height."""
    return Climb("p", 0.2, height, trials, successes, 0, 6.0, None)


def test_a_height_counts_only_if_all_lower_ones_do() -> None:
    """A lucky height above one that most robots fail would be reported."""
    assert highest_climbed([row(0.08, 85), row(0.04, 99), row(0.06, 70)]).step_height == 0.04
    assert highest_climbed([row(0.02, 79)]) is None
    assert "climbs steps of 4 cm (80 of 100" in answers([row(0.04, 80), row(0.06, 10)])[0]
    assert "climbs none" in answers([row(0.04, 79)])[0]


def test_steps_passed_by_hand() -> None:
    """A tread counted from where the last one begins would be a step too many; one slid back down, a step climbed.

    Robot 0 goes over: the highest tread is level with the landing, so that the first step down is at 0.9 m. Robot 1
    comes to the second tread and falls back to the first. Robot 2 walks past the stairs, robot 3 rolls over them.
    """
    edge = LANDING + TREAD
    along = [-REACH - 0.1, -REACH + 0.1, -REACH + TREAD + 0.1, 0.0, edge - 0.1, edge + 0.1, REACH - 0.1, REACH + 0.1]
    position = np.zeros((len(along), 4, 2))
    position[:, (0, 2, 3), 0] = np.array(along)[:, None]
    position[:, 1, 0] = [-REACH - 0.1, -REACH + 0.1, -REACH + TREAD + 0.1, *[-REACH + 0.1] * 5]
    position[:, 2, 1] = REACH + 0.1
    upright = np.ones((len(along), 4), bool)
    upright[2:, 3] = False
    up, down = steps_passed(position, upright)
    assert up[:, 0].tolist() == [0, 1, 2, STEPS, STEPS, STEPS, STEPS, STEPS]
    assert down[:, 0].tolist() == [0, 0, 0, 0, 0, 1, STEPS - 1, STEPS]
    assert up[-1].tolist() == [STEPS, 2, 0, 1] and down[-1].tolist() == [STEPS, 0, 0, 0]


def test_a_trial_is_judged_by_where_it_stood_upright() -> None:
    """A robot that rolled over the last step would have climbed it, and one that walked past all of them."""
    steps, far = 4, REACH + 1.0
    position = np.zeros((steps, 4, 2))
    position[:, (0, 1, 3), 0] = np.array([-REACH - 0.1, 0.0, far, far])[:, None]
    position[:, 2, 0] = -REACH - 0.1  # never starts, number 0 arrives in step 3, number 1 falls before it arrives
    position[1, 3, 1] = REACH + 0.1  # is beside the stairs where the others are on the landing
    upright = np.array([[True] * 4, [True, True, False, False], [True] * 4, [True] * 4]).T
    empty = np.zeros((steps, 4))
    recording = Recording(0.02, np.zeros((steps, 4, 3)), position, np.zeros((steps, 4, 6), bool), empty, empty, upright)
    result = _judge("p", 0.0, 0.1, recording)
    assert (result.trials, result.successes, result.falls) == (4, 1, 1)
    assert result.seconds == pytest.approx(0.06)
    assert result.steps_climbed == pytest.approx((2 * STEPS + STEPS + 0 + 0) / 4)


@pytest.mark.parametrize(
    "changes",
    [{"step_heights": (0.5,)}, {"friction_levels": ()}, {"step_heights": (0.1, 0.1)}, {"trials": 0}, {"speed": 0.0}],
)
def test_what_nobody_can_climb_is_refused(changes: dict) -> None:
    """The mistake would show after minutes of simulation, or never."""
    with pytest.raises(StictionError):
        ClimbCfg(**changes)


@pytest.mark.usefixtures("undrawn")
def test_the_study_writes_its_page(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """The command of the result would not run. A step of 1 cm is climbed by the policy that knows flat ground alone."""
    out = tmp_path / "out"
    policy = "saturn_lite-flat-none-0.2"
    options = ["--step-heights", "0.01", "--friction-levels", "0", "--trials", "2", "--out", str(out)]
    assert main(["study", "stairs", policy, *options]) == 0
    assert "climbs steps of 1 cm (2 of 2" in capsys.readouterr().out
    assert {file.name for file in out.iterdir()} == {
        *("stairs.csv", "summary.json", "stairs.png", "settings.json", "report.html"),
    }
    assert (out / "stairs.csv").read_text().splitlines()[1].startswith(f"{policy},0,0.01,2,2,0,12,")
    assert main(["study", "stairs", policy, policy, "--out", str(tmp_path / "twice")]) == 1
    assert "two bundles" in capsys.readouterr().err and not (tmp_path / "twice").exists()
    with pytest.raises(SystemExit):
        main(["study", "magic"])
    assert "stairs" in capsys.readouterr().err
