"""Exported project: its folders, rejections, the verb, and its note that it was never run."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bundles import make_contract
from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.deploy.check import check_bundle
from stiction.files.bundle import shipped_bundles
from webots_files import read_proto, read_world

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to export to Webots")

from stiction.exchange.webots.export import WebotsCfg, check_fit, export_webots
from stiction.robots.catalog import find_robot

SHIPPED = "saturn_lite-flat-none-0.2"

BUNDLE = "controllers/stiction_policy/bundle"

FILES = [
    "README.md",
    *(f"{BUNDLE}/{name}" for name in ("SHA256SUMS", "card.md", "contract.json", "golden.npz", "policy.onnx")),
    "controllers/stiction_policy/stiction_policy.py",
    "plugins/physics/rotor_inertia/Makefile",
    "plugins/physics/rotor_inertia/joints.h",
    "plugins/physics/rotor_inertia/rotor_inertia.c",
    "protos/SaturnLite.proto",
    "worlds/flat.wbt",
    "worlds/stairs.wbt",
]


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project of a shipped bundle."""
    return export_webots(shipped_bundles()[SHIPPED], tmp_path_factory.mktemp("webots") / "project", WebotsCfg(0.1)).path


def test_the_folder_is_a_project_of_webots_with_the_bundle_within(project: Path) -> None:
    """Each part lies in the folder where Webots looks for it."""
    assert sorted(path.relative_to(project).as_posix() for path in project.rglob("*") if path.is_file()) == FILES
    copy, source = (check_bundle(path).bundle for path in (project / BUNDLE, shipped_bundles()[SHIPPED]))
    assert copy.digest == source.digest
    plugin = next(node["physics"] for node in read_world(project / "worlds/flat.wbt") if node.kind == "WorldInfo")
    assert (project / f"plugins/physics/{plugin}/{plugin}.c").is_file()
    assert read_proto(project / "protos/SaturnLite.proto").interface["controller"][1] == "<extern>"


def test_the_readme_has_the_torques_of_the_robot_and_no_gaps(project: Path) -> None:
    """The table of friction torques in the readme is complete and right."""
    text = (project / "README.md").read_text()
    assert "| `shankFriction` | 45 | 4.5 | 4.5 | 9 | 13.5 |" in text
    assert "{" not in text.replace("`{", "")


def test_a_project_is_written_whole_or_not_at_all(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A failed export leaves no folder, so that the next one works."""
    (tmp_path / "there").mkdir()
    with pytest.raises(StictionError, match="exists already"):
        export_webots(bundle, tmp_path / "there")

    def full(*arguments) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr("shutil.copytree", full)
    with pytest.raises(StictionError, match="no space left"):
        export_webots(bundle, tmp_path / "project")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["there", "toy"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"physics_timestep": 0.0025, "decimation": 8}, "2.5 ms; a controller in Webots steps in whole milliseconds"),
        ({"standing": (0.1,) * 18, "lower": (-1.0,) * 18, "upper": (1.0,) * 18}, "another standing angle"),
        ({"lower": (-3.0,) * 18}, "another lower angle"),
    ],
)
def test_what_webots_or_the_robot_cannot_take_is_refused(changes: dict, message: str) -> None:
    """Rejects angles and steps that controller and world cannot share."""
    spec = find_robot("saturn_lite")
    check_fit(spec, make_contract())
    with pytest.raises(StictionError, match=message):
        check_fit(spec, make_contract(**changes))


def test_the_verb_exports_a_shipped_bundle_by_its_name(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """The verb exports a shipped bundle by its name; standard output is JSON alone."""
    out = tmp_path / "project"
    options = ["--out", str(out), "--friction-level", "0.2", "--step-height", "0.12", "--json"]
    assert main(["export", SHIPPED, "--to", "webots", *options]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["files"] == FILES
    assert (summary["robot"], summary["friction_level"], summary["step_height"]) == ("saturn_lite", 0.2, 0.12)
    assert "not run" in summary["state"]
    robot = next(node for node in read_world(out / "worlds/stairs.wbt") if node.kind == "Robot")
    assert robot.every("HingeJointParameters")[0]["staticFriction"] == pytest.approx(5.0)


def test_a_run_is_exported_through_its_bundle(bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """A run is exported through its bundle."""
    run = tmp_path / "run"
    run.mkdir()
    (run / "config.json").write_text("{}")
    arguments = ["export", str(run), "--to", "webots", "--out", str(tmp_path / "project"), "--json"]
    assert main(arguments) == 1
    assert f"do: stiction export {run}" in capsys.readouterr().err
    bundle.rename(run / "bundle")
    assert main(arguments) == 0
