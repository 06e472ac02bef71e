"""The Actuator Net of walks: what it is fitted to, and when it is fitted anew."""

from dataclasses import replace
from pathlib import Path

import pytest

from bundles import make_bundle, make_contract, make_network
from stiction.core.errors import StictionError
from stiction.files.actuator import read_actuator
from stiction.files.bundle import read_bundle
from stiction.files.walk import read_walk
from stiction.joints.net import ActuatorCfg
from stiction.robots.catalog import find_robot

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")
pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to fit a net")

from stiction.task.config import TaskCfg
from stiction.task.friction import FrictionCfg
from stiction.virtual.cases import Case, parse_level
from stiction_experiments.paper import net as module
from stiction_experiments.paper.net import WalkedNet, make_net

SPEC = find_robot("saturn_lite")


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> WalkedNet:
    """A robot that stands for a second at a time, and a net that is fitted in one."""
    contract = make_contract()
    bundle = make_bundle(tmp_path_factory.mktemp("b") / "still", contract, make_network(contract, gain=1e-3))
    cfg = ActuatorCfg(epochs=1, hidden=(4,))
    return WalkedNet("mujoco", Case(0, "all", parse_level("0.2")), SPEC, read_bundle(bundle), "output_side", 1.0, cfg)


@pytest.mark.parametrize("side", ["output_side", "motor_side"])
def test_the_net_is_fitted_to_walks_backward(
    walked: WalkedNet, side: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Logs and net say on which side torque was measured, training can use it at once; a second time nothing walks."""
    walked = replace(walked, torque_source=side)  # type: ignore[arg-type]
    make_net(walked, tmp_path / "net", "test")
    logs = [read_walk(file) for file in sorted((tmp_path / "net/logs").glob("*.npz"))]
    assert len(logs) == 12 and {float(log.header.command[3:]) for log in logs} == {-0.2, -0.35, -0.5, -0.65}
    assert {log.header.torque_source for log in logs} == {side}
    assert {(log.header.period, len(log)) for log in logs} == {(0.005, 200)}
    net = read_actuator(tmp_path / "net")
    assert net.torque_source == side
    TaskCfg(friction=FrictionCfg(method="none")).check_net(net, SPEC)
    monkeypatch.setattr(module, "log_walk", lambda *rest: pytest.fail("walked again"))
    make_net(walked, tmp_path / "net", "test")
    with pytest.raises(pytest.fail.Exception):
        make_net(replace(walked, seconds=1.1), tmp_path / "net", "test")


def test_several_robots_share_the_walks_of_one(walked: WalkedNet, tmp_path: Path) -> None:
    """Three robots walk backward once at each of four speeds, with starts of their own."""
    others = tuple(replace(walked.case, seed=seed) for seed in (1, 2))
    make_net(replace(walked, others=others), tmp_path / "net", "test")
    logs = [read_walk(file) for file in sorted((tmp_path / "net/logs").glob("*.npz"))]
    assert len(logs) == 12 and {float(log.header.command[3:]) for log in logs} == {-0.2, -0.35, -0.5, -0.65}


def test_a_policy_that_falls_at_once_is_refused(
    walked: WalkedNet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A net of nothing would train a policy on noise; and what failed is not taken for done."""
    monkeypatch.setattr(module, "SHORTEST", 5.0)
    for _ in range(2):
        with pytest.raises(StictionError, match="0 of 12 logs, too few"):
            make_net(replace(walked, seconds=0.1), tmp_path / "net", "test")
