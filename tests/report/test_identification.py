"""The page of an identification, from its files alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from stiction.files.joints import JointsFile, write_fit
from stiction.files.log import LogSetup
from stiction.identification.example import example_log
from stiction.identification.pipeline import identify_joint
from stiction.joints.friction import LAWS
from stiction.report.identification import write_identification_page
from stiction.report.joints import LABELS


def results(folder: Path, setup: LogSetup | None = None, name: str = "shank") -> JointsFile:
    """Identify an example and write what the page is drawn from."""
    log = example_log()
    result = identify_joint(log if setup is None else replace(log, setup=setup))
    joints = JointsFile({name: result.record})
    joints.write(folder / "joints.json")
    write_fit(folder / "fit.npz", {name: result.fit})
    return joints


def test_every_parameter_of_every_law_has_a_label() -> None:
    """Without one a joint of such a law ended `identify` before its page was written."""
    named = {name for law in LAWS.values() for name in law.parameters}
    assert named and named <= LABELS.keys()


def test_the_page_shows_numbers_pictures_and_verdict(tmp_path: Path) -> None:
    """A reader finds the estimates, their intervals, both methods, four figures, and what it means."""
    record = results(tmp_path).joints["shank"]
    page = write_identification_page(tmp_path).read_text(encoding="utf-8")
    for estimate in (record.inertia, record.coulomb_friction, record.dead_band):
        low, high = estimate.interval95
        assert f"<td>{estimate.value:.4g}</td>" in page and f"{low:.4g} to {high:.4g}" in page
    assert f"{record.diagnostics['output_error']['inertia']['value']:.4g}" in page
    assert page.count('class="drawing"') == 3
    assert "public joints measured" in page and "lower bound" in page
    assert '<ul class="warnings">' not in page


def test_what_is_not_known_is_said_and_warnings_are_shown(tmp_path: Path) -> None:
    """Without gains and limit: no second method, ratio not known, every warning on the page; names are escaped."""
    joints = results(tmp_path, LogSetup(), "<b>")
    page = write_identification_page(tmp_path).read_text(encoding="utf-8")
    assert "Only the torque regression was done" in page and page.count("<td>not known</td>") == 2
    assert page.partition("<nav")[0].count("<li>") == len(joints.warnings) >= 5
    assert "<b>" not in page and "&lt;b&gt;" in page


def test_the_page_names_its_command_the_units_of_what_was_given_and_the_file_to_train_with(tmp_path: Path) -> None:
    """The page states its command, units of the gains, and a training command with the right path."""
    folder = tmp_path / "my joint"
    folder.mkdir()
    record = results(folder).joints["shank"]
    page = write_identification_page(folder, "stiction identify log.csv --kp 20").read_text(encoding="utf-8")
    top = page.partition("<h2")[0]
    assert "<code>stiction identify log.csv --kp 20</code>" in top
    assert "stiction train --friction-from &#39;" in top and f"{folder}/training.json&#39;" in top
    assert f"kp {record.kp:g} N m/rad, kd {record.kd:g} N m s/rad, torque limit {record.torque_limit:g} N m." in page
    assert page.count("Dry (Coulomb) friction f [N m]") >= 3 and ">Dry (Coulomb) friction f<" not in page
