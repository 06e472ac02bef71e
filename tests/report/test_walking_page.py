"""The page of a walking log, drawn from its files alone."""

from pathlib import Path

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.files.joints import FRICTION_REACHES_ZERO, Estimate, Finding, JointRecord, JointsFile, warning
from stiction.files.walk import WalkFit, read_walk_fit, write_walk_fit
from stiction.report.joints import lead_lines
from stiction.report.walking import grouped_warnings, write_walking_page

TIRED = warning("tired", "the robot was tired")
REFUSED = "the interval of the hips' load coefficient is too wide <to tell>"


def make_records() -> JointsFile:
    """Return a shank that tells about load, one that does not tell at all, and hips that do not tell about load."""
    loaded = {"refusal": "", "carried_torque": 12.0, "carried_friction": Estimate(3.0, 0.1, (2.8, 3.2)).to_dict()}
    shank = JointRecord(
        viscous_friction=Estimate(0.07, 0.01, (0.05, 0.09)),
        coulomb_friction=Estimate(1.25, 0.1, (1.05, 1.45)),
        offset=Estimate(0.0, 0.01, (-0.02, 0.02)),
        friction_ratio=Estimate(0.05, 0.002, (0.046, 0.054)),
        load_coefficient=Estimate(0.15, 0.01, (0.13, 0.17)),
        torque_limit=25.0,
        diagnostics={"swings": 30, "samples_used": 200, "load": loaded, "verdict": {"lines": ["Much.", "Run this."]}},
        findings=(TIRED,),
    )
    hip = JointRecord(diagnostics={"swings": 3, "load": {"refusal": REFUSED}}, findings=(TIRED,))
    return JointsFile({"FL_shank": shank, "hip": hip})


def make_fit() -> WalkFit:
    """Return clouds of forty samples."""
    speed = np.linspace(-4, 4, 40)
    return WalkFit(
        swing={"FL_shank": (speed, 1.25 * np.sign(speed))},
        gait_time=np.arange(10) * 0.1,
        gait={"FL_foot": np.arange(10) % 4 < 2, "FR_foot": np.arange(10) % 4 >= 2},
        load={"shank": (speed, 0.15 * speed)},
    )


def write(folder: Path, joints: JointsFile, fit: WalkFit) -> str:
    """Write the files and the page; return its text."""
    joints.write(folder / "joints.json")
    write_walk_fit(folder / "fit.npz", fit)
    return write_walking_page(folder).read_text()


def test_the_page_has_what_a_reader_needs(tmp_path: Path) -> None:
    """Numbers with intervals, clouds, gait, load, refusals and warnings, and nothing from the network."""
    text = write(tmp_path, make_records(), make_fit())
    for part in (
        "FL_shank has the most",
        ":<br>Much.<br>Run this.",
        "1.25 ± 0.20",
        "5.00 ± 0.40",
        "0.150 ± 0.020",
        ">3.00 ± 0.20<",
        ">12.00 ± 0.80<",
    ):
        assert part in text, part
    assert "the interval of the hips" in text and "&lt;to tell&gt;" in text
    assert text.count('class="drawing"') == 3
    assert "http" not in text.replace("http://www.w3.org", "")
    assert text.count("the robot was tired") == 1


def test_what_many_joints_have_against_them_is_one_line() -> None:
    """Groups equal findings of several joints into one line."""
    seen = {name: f"the interval of {name} reaches zero" for name in ("hip", "knee", "toe")}
    findings = {name: (Finding(FRICTION_REACHES_ZERO, text, "log for longer"), TIRED) for name, text in seen.items()}
    records = {name: JointRecord(findings=findings[name], diagnostics={"verdict": {"lines": []}}) for name in seen}
    joints = JointsFile(records)
    count, first = lead_lines(joints)
    assert count.endswith("3 of them not validly: no friction is stated for any.")
    assert first == f"all joints: do first: log for longer. hip, and the others alike: {seen['hip']}."
    assert grouped_warnings(joints) == ["all joints: the robot was tired"]
    other = JointsFile(records | {"toe": JointRecord(diagnostics={"verdict": {"lines": []}})})
    assert lead_lines(other)[1].startswith("hip, knee: do first: ")


def test_the_fit_survives_its_file(tmp_path: Path) -> None:
    """A fit reads back as it was written; a damaged file is refused in one line."""
    fit = make_fit()
    write_walk_fit(tmp_path / "fit.npz", fit)
    again = read_walk_fit(tmp_path / "fit.npz")
    np.testing.assert_allclose(again.swing["FL_shank"][1], fit.swing["FL_shank"][1])
    np.testing.assert_array_equal(again.gait["FR_foot"], fit.gait["FR_foot"])
    assert list(again.load) == ["shank"]
    with np.load(tmp_path / "fit.npz") as archive:
        arrays = dict(archive)
    np.savez(tmp_path / "fit.npz", **{name: a for name, a in arrays.items() if name != "swing.y.FL_shank"})
    with pytest.raises(StictionError, match=r"swing of 'FL_shank' is not complete"):
        read_walk_fit(tmp_path / "fit.npz")
    np.savez(tmp_path / "fit.npz", **(arrays | {"gait.FL_foot": np.zeros(3, bool)}))
    with pytest.raises(StictionError, match="differ in length"):
        read_walk_fit(tmp_path / "fit.npz")
    np.savez(tmp_path / "fit.npz", time=np.zeros(3))
    with pytest.raises(StictionError, match=r"no gait\.time"):
        read_walk_fit(tmp_path / "fit.npz")
