"""A robot's file from a stranger: what would hang MuJoCo, or fill the memory, is refused before MuJoCo sees it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to read robots")

from stiction.core.errors import RobotError
from stiction.robots.source import read_source

INERTIA = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
ROBOT = (
    "<mujoco>{before}<worldbody>{world}<body name='base'>" + INERTIA + "<body name='leg'>" + INERTIA
    + "<joint name='knee' axis='0 1 0'/><geom name='foot' size='.02'/></body></body></worldbody></mujoco>"
)  # fmt: skip
BALL = "<geom size='.1'/>"

ATTACKS = {
    "a pipe": ("<include file='pipe'/>", "", "is a pipe"),
    "a device": ("<include file='/dev/zero'/>", "", "is a pipe or a device"),
    "a pipe, in another file": ("<include file='inner.xml'/>", "", "is a pipe"),
    "a field": ("<asset><hfield name='h' nrow='30000' ncol='30000' size='1 1 1 1'/></asset>", "", "hfield"),
    "a field from a pipe": ("<asset><hfield name='h' file='pipe' size='1 1 1 1'/></asset>", "", "hfield"),
    "another model": ("<asset><model name='m' file='pipe'/></asset>", "", "<model>"),
    "a skin": ("<asset><skin name='s' file='pipe'/></asset>", "", "<skin>"),
    "a sphere": ("<asset><mesh name='m' builtin='sphere' params='12'/></asset>", "", "mesh of the kind 'sphere'"),
    "a mesh from a pipe": (
        "<asset><mesh name='m' file='pipe.stl'/></asset>",
        f"<geom type='mesh' mesh='m'/>{BALL}",
        "the mesh 'pipe.stl' is not there",
    ),
    "copies": ("", f"<replicate count='100000000'>{BALL}</replicate>", "<replicate>"),
    "a jelly": ("", "<flexcomp type='grid' count='1000 1000 100' name='f'/>", "<flexcomp>"),
    "a chain": ("", "<composite type='cable' count='100000 1 1' prefix='a'/>", "<composite>"),
    "code": ("<extension><plugin plugin='mujoco.pid'/></extension>", "", "<extension>"),
    "depth": ("", "<body>" * 20_000 + "</body>" * 20_000, "in one another"),
    "many": ("", BALL * 60_000, "elements; a robot has"),
    "user data": ("<size nuser_geom='1000000000'/>", "", "nuser_geom"),
}
"""Attack -> XML before the world, XML in it, and the message."""


@pytest.mark.parametrize("name", ATTACKS)
def test_what_is_not_bounded_is_refused(name: str, tmp_path: Path) -> None:
    """Nothing ends MuJoCo once it has begun, not even SIGTERM; the test would not end."""
    before, world, message = ATTACKS[name]
    os.mkfifo(tmp_path / "pipe")
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "inner.xml").write_text("<mujoco><include file='pipe'/></mujoco>")
    file = tmp_path / "robot.xml"
    file.write_text(ROBOT.format(before=before, world=world))
    with pytest.raises(RobotError, match=message):
        read_source(file)


def test_pictures_and_memory_are_left_out(tmp_path: Path) -> None:
    """Many robots have textures; nobody needs them to walk, and one can be a gigabyte, or a pipe."""
    os.mkfifo(tmp_path / "pipe.png")
    looks = "<size memory='100G'/><asset><texture name='t' type='2d' file='pipe.png'/><material name='m' texture='t'/>"
    looks += "<texture name='u' type='2d' builtin='flat' width='30000' height='30000'/></asset>"
    file = tmp_path / "robot.xml"
    file.write_text(ROBOT.format(before=looks, world="<geom size='.1' material='m'/>"))
    assert read_source(file).model.ntex == 0


@pytest.mark.parametrize("encoding", ["utf-7", "big5", "rot13", "idna", "nonsense"])
@pytest.mark.parametrize("file", ["robot.xml", "robot.urdf"])
def test_an_encoding_that_is_not_read_is_one_line(file: str, encoding: str, tmp_path: Path) -> None:
    """Reports an encoding that Python does not decode for the parser in one line, with a remedy."""
    text = ROBOT.format(before="", world="") if file == "robot.xml" else "<robot name='x'><link name='base'/></robot>"
    (tmp_path / file).write_text(f"<?xml version='1.0' encoding='{encoding}'?>{text}")
    with pytest.raises(RobotError, match=r"its encoding is not read: .*; save it as UTF-8"):
        read_source(tmp_path / file)
