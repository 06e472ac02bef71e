"""Bundles as others deploy them: read back by our own import they are the same policies."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bundles import make_bundle, make_contract, make_network
from foreign import ROBOT
from stiction.core.errors import StictionError
from stiction.deploy.check import replay
from stiction.deploy.policy import load_policy
from stiction.exchange.policies.description import contract_of
from stiction.exchange.policies.exporter import export_to
from stiction.exchange.policies.importer import describe_policy, read_network
from stiction.files.bundle import read_bundle
from stiction.files.contract import Contract
from stiction.files.observation import FRAMES, ObservationLayout, Term, proprioception
from stiction.robots.catalog import find_robot
from stiction.robots.record import Derived


def term(name: str, size: int, scale: float | tuple[float, ...] = 1.0, clip: float = 100.0, **more) -> Term:
    """Return a term as most others have them."""
    return Term(name, size, scale, clip, FRAMES[name], "standing" if name == "joint_position" else "none", **more)


COMMON = (
    term("angular_velocity", 3, 0.25),
    term("projected_gravity", 3),
    term("command", 3, (2.0, 2.0, 0.25)),
    term("joint_position", 12),
    term("joint_velocity", 12, 0.05),
    term("last_action", 12),
)


def contract(layout: ObservationLayout | None = None, **changes) -> Contract:
    """Return a contract of a Go2 that others could have; without a layout, that of our own training."""
    robot = find_robot(ROBOT)
    common = {} if layout is None else {"observation": layout}
    return make_contract(ROBOT, anatomy=robot, **common, **changes)


def read_back(folder: Path, made: Contract) -> tuple[Contract, bytes]:
    """Return contract and network of an exported policy, by our own import."""
    settings = sorted(folder.rglob("*.yaml"))
    if not settings:
        (folder / "own.yaml").write_text(f"control_period: {made.control_period}\naction_clip: none\n")
        settings = [folder / "own.yaml"]
    path = next(folder.rglob("*.onnx"))
    data, network = read_network(path)
    robot = made.anatomy
    assert robot is not None
    return contract_of(
        describe_policy(network, path.name, settings, Derived(robot)), robot, (path.name, data), "r", "c"
    ), network.write()


NATIVE = {
    "one frame": ObservationLayout(COMMON, 1),
    "term by term": ObservationLayout(COMMON, 3, layout="term_major"),
    "whole frames": ObservationLayout(COMMON, 3, fill="zero"),
}


@pytest.mark.parametrize("to", ["deploy.yaml", "rl_sar", "mjlab"])
@pytest.mark.parametrize("layout", NATIVE.values(), ids=NATIVE)
def test_a_policy_comes_back_as_it_went(to: str, layout: ObservationLayout, tmp_path: Path) -> None:
    """Actions on the golden vectors agree to 1e-6: scales, order, gains and histories are in the files."""
    made = contract(replace(layout, fill="zero" if to == "rl_sar" else "first"), action_clip=0.5)
    bundle = read_bundle(make_bundle(tmp_path / "bundle", made, make_network(made, gain=0.05)))
    done = export_to(tmp_path / "bundle", tmp_path / "out", to)
    assert "README.md" in done.files
    back, model = read_back(tmp_path / "out", made)
    assert (back.joint_names, back.standing, back.control_period) == (made.joint_names, made.standing, 0.02)
    np.testing.assert_allclose(back.kp, made.kp)
    np.testing.assert_allclose(back.scale, made.scale)
    again = replay(load_policy(back, model), bundle.golden)
    np.testing.assert_allclose(again.action, bundle.golden.action, atol=1e-6)
    np.testing.assert_allclose(again.target, bundle.golden.target, atol=1e-6)


@pytest.mark.parametrize("to", ["deploy.yaml", "mjlab"])
def test_our_own_policies_go_out_with_an_adapter(to: str, tmp_path: Path) -> None:
    """Roll and pitch, placeholders, the side that begins and eleven whole frames are made in the network."""
    made = contract(proprioception(12, first_side=True))
    bundle = read_bundle(make_bundle(tmp_path / "bundle", made))
    done = export_to(tmp_path / "bundle", tmp_path / "out", to)
    assert any("cannot say the term roll_pitch" in note for note in done.notes)
    back, model = read_back(tmp_path / "out", made)
    assert back.observation.layout == "term_major" and back.observation.depth == 11
    again = replay(load_policy(back, model), bundle.golden)
    np.testing.assert_allclose(again.action, bundle.golden.action, atol=5e-6)


@pytest.mark.parametrize(
    ("made", "to", "message"),
    [
        (lambda: contract(compensation=(0.01,) * 12), "rl_sar", "adds friction to its targets"),
        (lambda: make_contract("saturn_lite"), "deploy.yaml", "the maker's order of the joints"),
    ],
)
def test_what_a_target_cannot_hold_is_refused(made, to: str, message: str, tmp_path: Path) -> None:
    """Rejects a policy that the target format cannot hold completely."""
    make_bundle(tmp_path / "bundle", made())
    with pytest.raises(StictionError, match=message):
        export_to(tmp_path / "bundle", tmp_path / "out", to)
    assert not (tmp_path / "out").exists()
