"""Digests identify the inputs of results."""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

from stiction.files.bundle import SUMS, read_bundle, shipped_bundles
from stiction.files.inputs import changes, digests_of, with_sidecars


def written(path: Path, text: str) -> Path:
    """Write a file and return it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_is_known_by_its_sha256_and_what_cannot_be_read_by_nothing(tmp_path: Path) -> None:
    """Identifies a file by its SHA-256, and leaves out unreadable ones."""
    log = written(tmp_path / "log.csv", "time\n")
    assert digests_of({"log": [log]}) == {"log": {str(log): hashlib.sha256(b"time\n").hexdigest()}}
    missing = {"log": [log, tmp_path / "none.csv"], "sidecar": None, "repeat": ()}
    missing |= {"robot": "go2", "bundles": tmp_path, "policies": ("x",)}
    assert digests_of(missing) == {}


def test_a_sidecar_belongs_to_its_log(tmp_path: Path) -> None:
    """Counts the sidecar as a part of its log."""
    log = written(tmp_path / "log.csv", "1")
    before = digests_of({"log": with_sidecars([log])})
    assert with_sidecars([Path()]) == [Path()]  # Whoever reads it says that it is a folder.
    sidecar = written(tmp_path / "log.json", "{}")
    now = digests_of({"log": with_sidecars([log])})
    assert changes(before, now) == {"log": f"{sidecar} added"}
    sidecar.write_text('{"kp": 3}', encoding="utf-8")
    assert changes(now, digests_of({"log": with_sidecars([log])})) == {"log": f"{sidecar} had another content"}


def test_a_bundle_is_known_by_its_digest_and_its_name(tmp_path: Path) -> None:
    """Distinguishes two trainings of a policy under one name."""
    name, path = next(iter(shipped_bundles().items()))
    shipped = digests_of({"bundles": (Path(name),)})
    assert shipped["bundles"][name].split() == [read_bundle(path).digest, name]
    copy, other = tmp_path / "copy" / name, tmp_path / "another"
    for folder in (copy, other):
        shutil.copytree(path, folder)
    assert changes(shipped, digests_of({"bundles": (copy,)})) == {"bundles": ""}
    # Rows of results have the name.
    assert changes(shipped, digests_of({"bundles": (other,)})) == {"bundles": f"{name}, now {other}"}
    with (copy / SUMS).open("a", encoding="utf-8") as file:
        file.write("more\n")
    assert changes(shipped, digests_of({"bundles": (copy,)})) == {"bundles": f"{name}, now {copy}"}


def test_a_robot_is_known_by_its_model_too(tmp_path: Path) -> None:
    """Notices an edited model behind an unchanged robot.yaml."""
    model, robot = written(tmp_path / "dog.xml", "<mujoco/>"), written(tmp_path / "robot.yaml", "model: dog.xml\n")
    before = digests_of({"robot": str(robot)})
    model.write_text("<mujoco></mujoco>", encoding="utf-8")
    assert changes(before, digests_of({"robot": str(robot)})) == {"robot": f"{model} had another content"}


def test_the_log_of_a_run_is_known_by_its_files_and_another_folder_by_its_path(tmp_path: Path) -> None:
    """Identifies the log of a run by its files, and any other folder by its path."""
    written(tmp_path / "run/log/log.json", "{}")
    part, known = written(tmp_path / "run/log/part", "1"), [tmp_path / "run", tmp_path / "run/log"]
    before = [digests_of({"log": path}) for path in known]
    assert all(before)
    part.write_text("2", encoding="utf-8")
    for path, digests in zip(known, before, strict=True):
        assert changes(digests, digests_of({"log": path})) == {"log": f"{path} had another content"}
    assert digests_of({"policies": tmp_path}) == {}
