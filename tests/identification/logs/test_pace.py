"""PACE's files: tensors without torch, and nothing executed."""

from __future__ import annotations

import os
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

import logfiles
from stiction.core.errors import LogError
from stiction.identification.logs import open_log
from stiction.identification.logs.pace import read_pace


def saved(folder: Path, content: object) -> Path:
    """Write anything as torch does."""
    torch.save(content, folder / "x.pt")
    return folder / "x.pt"


def with_index(folder: Path, index: bytes, storage: bytes = bytes(96)) -> Path:
    """Write an archive with an index and one storage."""
    with zipfile.ZipFile(folder / "x.pt", "w") as archive:
        archive.writestr("x/data.pkl", index)
        archive.writestr("x/data/0", storage)
    return folder / "x.pt"


def test_tensors_become_joints(tmp_path: Path) -> None:
    """Joints are numbered as the file has no names for them."""
    log = open_log(logfiles.pace(tmp_path))
    assert list(log.joints) == ["joint_0", "joint_1"]
    np.testing.assert_allclose(log.time, logfiles.TIME, rtol=1e-6)
    np.testing.assert_array_equal(log.joints["joint_1"].position, logfiles.POSITION[:, 1].astype(np.float32))
    assert log.joints["joint_1"].torque is None


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32, torch.float16, torch.int64, torch.int32, torch.int16])
def test_views_of_every_kind_of_number(tmp_path: Path, dtype: torch.dtype) -> None:
    """A transposed slice shares its storage: strides and offsets must be followed."""
    whole = torch.arange(60).reshape(3, 20).to(dtype)
    columns = read_pace(saved(tmp_path, {"time": torch.arange(20.0), "dof_pos": whole[1:].T})).columns
    np.testing.assert_array_equal(columns["dof_pos_1"], np.arange(40, 60))
    assert sorted(columns) == ["dof_pos_0", "dof_pos_1", "time"]


class Attack:
    """Whoever unpickles this has its command run."""

    def __reduce__(self) -> tuple:
        """Name the call."""
        return os.mkdir, ("executed",)


@pytest.mark.parametrize("place", ["index", "value"])
def test_nothing_is_executed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    """A foreign log runs no code, unlike torch and pickle."""
    monkeypatch.chdir(tmp_path)
    if place == "index":
        path = with_index(tmp_path, pickle.dumps({"time": Attack()}, 2))
    else:
        path = saved(tmp_path, {"time": torch.zeros(3), "dof_pos": Attack()})
    with pytest.raises(LogError, match=r"a call of .*mkdir.*nothing was executed"):
        open_log(path)
    assert not (tmp_path / "executed").exists()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([torch.zeros(3)], "instruction EMPTY_LIST"),
        ({"time": np.zeros(3)}, "a call of .*only a dictionary of tensors"),
        ({"time": torch.zeros(3, dtype=torch.bfloat16)}, "BFloat16Storage"),
        ({"a": 1}, "no arrays of samples"),
        ({"time": torch.zeros(0)}, "no arrays of samples"),
        ({"time": torch.zeros(1).expand(10**6)}, "does not fit its storage of 1 numbers"),
        ({"time": torch.zeros(9), "q": torch.zeros(9, 2)}, "no column position"),
    ],
)
def test_other_contents_are_refused(tmp_path: Path, content: object, message: str) -> None:
    """The message names the content in place of tensors."""
    with pytest.raises(LogError, match=message):
        open_log(saved(tmp_path, content))


def test_other_files_are_refused(tmp_path: Path) -> None:
    """Old torch files are bare pickles; archives of something else have no index."""
    torch.save({"time": torch.zeros(3)}, tmp_path / "old.pt", _use_new_zipfile_serialization=False)
    with pytest.raises(LogError, match=r"not an archive of torch.save"):
        open_log(tmp_path / "old.pt")
    with pytest.raises(LogError, match="0 index files"):
        np.savez(tmp_path / "x.npz", time=np.zeros(3))
        open_log((tmp_path / "x.npz").rename(tmp_path / "npz.pt"))


def test_a_storage_that_is_too_small_is_refused(tmp_path: Path) -> None:
    """The index promises 24 numbers; the archive has 23."""
    index = zipfile.ZipFile(saved(tmp_path, {"time": torch.zeros(24)})).read("x/data.pkl")
    with pytest.raises(LogError, match="'0' has 92 bytes; 24 numbers of float32 were promised"):
        open_log(with_index(tmp_path, index, bytes(92)))
