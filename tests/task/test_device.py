"""Where a run computes: the right simulator, one clear line where it is missing, and tensors where the networks are."""

import sys
from dataclasses import replace

import pytest
import torch

from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.learning.begin import why_task_on_host
from stiction.learning.config import TrainCfg
from stiction.sim.indexing import assign, to_ids, to_mask
from stiction.task.config import TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg
from stiction.task.task_fleet import Device, find_device
from stiction.task.terrain import TerrainCfg


def test_the_task_hands_everything_out_where_the_networks_are() -> None:
    """One tensor left on the host would stop the first update on a GPU; `meta` stands for it here."""
    cfg = replace(TaskCfg(robot="go1"), episode=0.5)
    env = LocomotionEnv(cfg, 2, seed=0, device=Device("meta"))
    observation, reward, dones, extras = env.step(torch.zeros(2, env.num_actions))
    handed_out = [*env.get_observations().values(), *observation.values(), reward, dones, extras["time_outs"]]
    assert {value.device.type for value in handed_out} == {"meta"}
    env.load_state(env.state() | {"observation": {"privileged": torch.ones(2, 3)}} | _tensors(env))
    assert env.get_observations()["privileged"].device.type == "meta"


def _tensors(env: LocomotionEnv) -> dict:
    """Return the arrays of a state as a checkpoint gives them back."""
    state = env.state()
    arrays = {name: torch.from_numpy(state[name]) for name in ("blown_up", "ground")}
    return arrays | {"simulation": {name: torch.from_numpy(value) for name, value in state["simulation"].items()}}


def test_a_missing_package_is_one_line(tmp_path, capsys: pytest.CaptureFixture, monkeypatch) -> None:
    """It names the extra, and no folder is left behind."""
    for name in ("warp", "worlds", "torch_fleet"):
        monkeypatch.delitem(sys.modules, f"stiction.sim.{name}", raising=False)
    monkeypatch.setitem(sys.modules, "mujoco_warp", None)
    assert main(["train", "--device", "warp-cpu", "--out", str(tmp_path / "run")]) == 1
    error = capsys.readouterr().err
    assert "[gpu]" in error and error.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_a_missing_gpu_is_one_line(tmp_path, capsys: pytest.CaptureFixture, monkeypatch) -> None:
    """Reports a GPU that Warp or torch does not find in one line."""
    warp = pytest.importorskip("warp", reason="warp, of the extra 'gpu', is not installed")
    monkeypatch.setattr(warp, "is_cuda_available", lambda: False)
    assert main(["train", "--device", "cuda", "--out", str(tmp_path / "run")]) == 1
    error = capsys.readouterr().err
    assert "no CUDA device" in error and "--device cpu" in error and error.count("\n") == 1
    assert not (tmp_path / "run").exists()
    monkeypatch.setattr(warp, "is_cuda_available", lambda: True)
    monkeypatch.setattr(warp, "get_cuda_device_count", lambda: 1)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(StictionError, match=f"torch {torch.__version__.partition('+')[0]}.*finds no CUDA device"):
        find_device("cuda", 1)
    with pytest.raises(StictionError, match="no GPU 1 here, only 1"):
        find_device("cuda", 1, gpu=1)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"terrain": TerrainCfg("stairs")}, "terrain 'stairs'"),
        ({"friction": FrictionCfg(law="stribeck", level=0.1)}, "law 'stribeck'"),
        ({"friction": FrictionCfg(load=(0.0, 0.1))}, "grows with load"),
    ],
)
def test_what_keeps_the_task_on_the_host_is_named(changes: dict, named: str) -> None:
    """A task that went to the device without its terrain or its law would train another one, without a word."""
    cfg = TrainCfg(task=replace(TaskCfg(), **changes), device="warp-cpu")
    assert named in (why_task_on_host(cfg) or "")
    assert why_task_on_host(TrainCfg(device="warp-cpu")) is None
    assert "Actuator Net" in (why_task_on_host(replace(TrainCfg(device="warp-cpu"), actuator="net")) or "")


def test_robots_are_chosen_by_number_or_by_mask() -> None:
    """A mask has a row of values for every robot, numbers have one for each of theirs: the same robots get the same."""
    values, mask = torch.arange(8.0).view(4, 2), torch.tensor([False, True, False, True])
    ids = mask.nonzero().flatten()
    one, other = torch.zeros(4, 2), torch.zeros(4, 2)
    assign(one, mask, values)
    assign(other, ids, values[ids])
    assert torch.equal(one, other) and one.tolist() == [[0, 0], [2, 3], [0, 0], [6, 7]]
    assert torch.equal(to_mask(ids, 4), mask) and to_mask(mask, 4) is mask
    assert [value.tolist() for value in to_ids(mask, values)] == [[1, 3], [[2, 3], [6, 7]]]
    assign(one, mask, 0)
    assert not one.any()
