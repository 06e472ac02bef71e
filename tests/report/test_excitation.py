"""The page of a designed log, from its files alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.files.design import (
    DesignSignals,
    ExcitationDesign,
    GainPoint,
    GainTrial,
    OneSine,
    Predicted,
    load_design,
    read_signals,
)
from stiction.files.tables import write_arrays
from stiction.report.excitation import write_excitation_page

DESIGN = ExcitationDesign(
    joint="<b>",
    setup={
        **{"kp": 20.0, "start": 0.0, "rate": 100.0, "spread": 2.0, "position_only": False, "resolution": 0.0},
        **{"noise_position": 1e-4, "noise_torque": 0.05, "gravity_sin": 0.0, "gravity_cos": 0.0},
    },
    gains={"kp": 7.0, "kd": 0.3},
    advice="Run at kp 7, kd 0.3.",
    pattern={},
    pattern_duration=5.0,
    repeats=2,
    duration=10.0,
    limits={"low": -0.6, "high": 0.6, "speed": 10.0, "torque": 45.0},
    reached={"low": -0.54, "high": 0.53, "speed": 8.75, "torque": 4.321},
    predicted=(
        Predicted("inertia", 0.0145, 1.45e-5, 1e-3, 2e-3),
        Predicted("viscous_friction", 0.07, 1.4e-4, 2e-3, 3e-3),
        Predicted("coulomb_friction", 0.44, 1.32e-3, 3e-3, 4e-3),
        Predicted("offset", 0.0, 1e-4, None, None),
    ),
    correlation=-0.71,
    d_criterion=-40.0,
    worst=4e-3,
    wanted={"relative": 0.02, "duration": 5.0},
    sines=(
        OneSine(0.5, 0.5, (0.01, 0.02, 0.003), 0.04, -0.9),
        OneSine(5.0, 0.3, (0.001, 0.02, 0.03), 0.08, -0.987),
    ),
    trials=(GainTrial(20.0, 0.5, 0.01, 0.97, True), GainTrial(3.0, 0.2, None, 0.0, False)),
    sweep=(GainPoint(7.0, 0.3, 1e-3, 9e-4, 0.9), GainPoint(1.0, 0.1, None, None, 0.1)),
    warnings=("mind the step",),
    command="stiction excite",
)


def results(folder: Path, record: ExcitationDesign = DESIGN) -> None:
    """Write what the page is drawn from."""
    time = np.arange(1001) / 100.0
    wave = 0.5 * np.sin(time)
    write_arrays(folder / "design.npz", DesignSignals(time, *[wave] * 10))
    (folder / "design.json").write_text(json.dumps(record.to_dict()))


def test_the_page_says_how_to_run_it_what_comes_out_and_why(tmp_path: Path) -> None:
    """Gains, limits and what is reached, each deviation, three figures, the comparison with one sine, the warning."""
    results(tmp_path)
    page = write_excitation_page(tmp_path).read_text(encoding="utf-8")
    assert page.count('class="drawing"') == 3
    for text in ("kp 7 and kd 0.3", "8.75", "4.321", "0.4 %", "-0.987", ">10<", "mind the step", "bare_motor"):
        assert text in page, text
    assert "stiction identify LOG.csv" in page and "<td>N m" not in page and "coulomb_friction [N m]" in page


def test_a_design_survives_its_file(tmp_path: Path) -> None:
    """A design reads back as it was written, rows included."""
    results(tmp_path)
    again = load_design(tmp_path / "design.json")
    assert json.dumps(again.to_dict()) == json.dumps(DESIGN.to_dict())
    assert again.predicted == DESIGN.predicted and again.trials == DESIGN.trials
    assert read_signals(tmp_path / "design.npz").target == pytest.approx(
        0.5 * np.sin(np.arange(1001) / 100.0), abs=1e-6
    )


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", '{"schema_version": 99}', '{"schema_version": 1, "predicted": 3}', "[" * 100_000],
)
def test_a_file_that_is_no_design_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    """Whatever is wrong with it."""
    (tmp_path / "design.json").write_text(text)
    with pytest.raises(StictionError, match=r"design\.json"):
        load_design(tmp_path / "design.json")
