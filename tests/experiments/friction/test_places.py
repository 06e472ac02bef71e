"""Where a run stands, and whose folder it is."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import pytest

from actuators import pd_net
from stiction.core.errors import StictionError
from stiction.files.actuator import FILE, write_actuator
from synthetic import place, write_run


def test_states(tmp_path: Path) -> None:
    """A run is missing, interrupted, or finished by its files."""
    at = place(tmp_path)
    assert (at.state(), at.done()) == ("missing", 0)
    write_run(at, "summary.json")
    assert (at.state(), at.done(), at.iterations) == ("interrupted", 2, 2)
    write_run(at)
    assert at.state() == "finished"
    (at.path / "checkpoints/student_000001.json").unlink()
    assert at.state() == "interrupted"


def test_a_configuration_from_before_a_field_existed_is_the_same(tmp_path: Path) -> None:
    """A missing field of an older configuration equals its default."""
    at = place(tmp_path)
    write_run(at)
    header = json.loads((at.path / "config.json").read_text())
    del header["config"]["task"]["friction"]["mixture"], header["config"]["task"]["friction"]["stages"]
    (at.path / "config.json").write_text(json.dumps(header))
    assert at.state() == "finished"


def test_a_folder_of_another_run_is_refused_by_name(tmp_path: Path) -> None:
    """Rejects a folder with a run of another configuration."""
    write_run(place(tmp_path, "toy", 0, "--friction-level", "0.2"))
    with pytest.raises(StictionError, match=r"toy-s0 holds another run .*task\.friction\.level is 0\.2, expected 0\.1"):
        place(tmp_path, "toy", 0, "--friction-level", "0.1").state()


def test_joints_are_known_by_what_is_in_the_file(tmp_path: Path) -> None:
    """A moved joints file with the same content is the same; rejects another content."""
    first, moved = tmp_path / "joints.json", tmp_path / "moved.json"
    for file in (first, moved):
        file.write_text("what was identified")
    at = place(tmp_path, "toy", 0, "--joints", str(first))
    write_run(at)
    header = json.loads((at.path / "config.json").read_text())
    digest = hashlib.sha256(b"what was identified").hexdigest()
    (at.path / "config.json").write_text(json.dumps(header | {"identified": {"sha256": digest}}))
    assert at.state() == "finished"
    elsewhere = place(tmp_path, "toy", 0, "--joints", str(moved))
    assert elsewhere.state() == "finished"
    moved.write_text("what was identified later")
    with pytest.raises(StictionError, match=rf"SHA-256 of joints is {digest}, expected "):
        elsewhere.state()
    moved.unlink()
    with pytest.raises(StictionError, match="cannot be read"):
        elsewhere.state()
    with pytest.raises(StictionError, match=rf"SHA-256 of joints is {digest}, expected None"):
        place(tmp_path, "toy", 0).state()


def test_a_net_is_known_by_what_it_does(tmp_path: Path) -> None:
    """A net of another revision with the same function is the same; rejects another function."""
    net, nets = pd_net(), [tmp_path / name for name in ("first", "same", "other")]
    for folder, one in zip(nets, (net, replace(net, revision="1111111"), pd_net(kp=2.0)), strict=True):
        folder.mkdir()
        write_actuator(folder / FILE, one)
    places = [place(tmp_path, "toy", 0, "--method", "none", "--actuator", str(folder)) for folder in nets]
    write_run(places[0])
    content = (nets[0] / FILE).read_bytes()
    (places[0].path / FILE).write_bytes(content)
    recorded = {"actuator": {"name": "first", "sha256": hashlib.sha256(content).hexdigest()}}
    header = json.loads((places[0].path / "config.json").read_text())
    (places[0].path / "config.json").write_text(json.dumps(header | recorded))
    assert [at.state() for at in places[:2]] == ["finished", "finished"]
    for at in (places[2], place(tmp_path, "toy", 0, "--method", "none")):
        with pytest.raises(StictionError, match="actuator is another net than"):
            at.state()
