"""An Actuator Net as others load it: TorchScript that gives the same torque, and the words of its configuration."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import torch

from actuators import pd_net
from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.files.actuator import write_actuator
from stiction.joints.net import ActuatorNet, perceptron
from stiction.learning.actuator_script import actuator_files


def random_layers(width: int) -> tuple:
    """Return a net of two hidden layers."""
    rng = np.random.default_rng(0)
    sizes = [(4, width), (3, 4), (1, 3)]
    return tuple(
        (rng.normal(size=size).astype(np.float32), rng.normal(size=size[0]).astype(np.float32)) for size in sizes
    )


def net(**changes) -> ActuatorNet:
    """Return a net of three kinds of joints."""
    plain = pd_net()
    return pd_net(layers=tuple(random_layers(8) for _ in plain.groups), **changes)


def configured(files: dict[str, bytes], folder: Path, module: str, name: str) -> dict:
    """Return what the text defines, on a stand-in for the trainer's class."""
    for file, content in files.items():
        (folder / file).write_bytes(content)
    stand_in = ModuleType(module)
    setattr(stand_in, name, SimpleNamespace)
    before = {key: sys.modules.get(key) for key in (module.split(".")[0], module)}
    sys.modules |= {module.split(".")[0]: ModuleType("made"), module: stand_in}
    try:
        space: dict = {"__file__": str(folder / "actuators.py")}
        exec(compile(files["actuators.py"], "actuators.py", "exec"), space)
    finally:
        for key, kept in before.items():
            if kept is None:
                del sys.modules[key]
            else:
                sys.modules[key] = kept
    return space


def test_the_script_gives_the_torque_of_the_net() -> None:
    """Within float32; a history of another length is refused."""
    made = net()
    script = torch.jit.load(io.BytesIO(actuator_files(made, "mjlab")["net_0.pt"]))
    rows = np.random.default_rng(1).normal(size=(50, 8)).astype(np.float32)
    np.testing.assert_allclose(
        script(torch.from_numpy(rows)).detach().numpy()[:, 0], perceptron(made.layers[0], rows.T), atol=1e-6
    )
    with pytest.raises(Exception, match="history has another length"):
        script(torch.zeros(1, 6))


@pytest.mark.parametrize(
    ("to", "module", "name", "samples", "joints"),
    [
        ("mjlab", "mjlab.actuator", "LearnedMlpActuatorCfg", ("history_length", 4), "target_names_expr"),
        ("isaaclab", "isaaclab.actuators", "ActuatorNetMLPCfg", ("input_idx", [0, 1, 2, 3]), "joint_names_expr"),
    ],
)
def test_every_group_has_its_configuration(
    tmp_path: Path, to: str, module: str, name: str, samples: tuple, joints: str
) -> None:
    """Each joint in one group of one limit; SI units, so that the scales are one, and the limit scales the output."""
    made = net(torque_source="output_side")
    space = configured(actuator_files(made, to), tmp_path, module, name)
    groups = space["actuators"](0.005)
    names = [joint for cfg in groups.values() for joint in getattr(cfg, joints)]
    assert sorted(names) == sorted(made.joint_names)
    for cfg in groups.values():
        assert Path(cfg.network_file).is_file() and (cfg.pos_scale, cfg.vel_scale, cfg.input_order) == (1, 1, "pos_vel")
        assert getattr(cfg, samples[0]) == samples[1]
        limit = made.torque_limit[made.joint_names.index(getattr(cfg, joints)[0])]
        assert cfg.torque_scale == cfg.effort_limit == limit
        # The torque has the joint's friction in it already.
        assert getattr(cfg, "frictionloss" if to == "mjlab" else "dynamic_friction") == 0.0
    with pytest.raises(ValueError, match=r"got a physics step of 0.002 s, expected 0.005 s"):
        space["actuators"](0.002)
    configurations = configured(actuator_files(net(), to), tmp_path, module, name)["actuators"](0.005)
    assert not any(hasattr(cfg, "frictionloss") or hasattr(cfg, "friction") for cfg in configurations.values())


def test_a_net_without_the_target_is_refused() -> None:
    """The paper's inputs are positions; the trainers give errors."""
    with pytest.raises(StictionError, match=r"got the inputs 'paper', expected 'default'"):
        actuator_files(net(inputs="paper"), "mjlab")


def test_a_user_converts_a_net(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Into a folder; an option that would be ignored, or another target, is refused in one line."""
    write_actuator(tmp_path / "actuator.npz", net())
    out = tmp_path / "nets"
    assert main(["convert", str(tmp_path), "--to", "mjlab", "--out", str(out)]) == 0
    assert (out / "actuators.py").is_file() and (out / "net_0.pt").is_file()
    assert main(["convert", str(tmp_path), "--to", "mjlab", "--out", str(out)]) == 1
    assert main(["convert", str(tmp_path / "actuator.npz"), "--to", "urdf"]) == 1
    assert main(["convert", str(tmp_path), "--to", "mjlab", "--out", str(out), "--joint-map", "a=b"]) == 1
    *_, existing, target, ignored = capsys.readouterr().err.splitlines()
    assert (
        "exists already" in existing and "expected one Actuator Net, --to mjlab" in target and "--joint-map" in ignored
    )
