"""An Actuator Net as TorchScript, with the configuration that mjlab 1.6 and Isaac Lab load it by.

Both give a net the position errors now, one sample ago, ..., then the velocities likewise, in SI units here, and take
its output times `torque_scale`; what a group of joints shares is the net, and the torque limit.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from io import BytesIO

import torch

from stiction.core.errors import FileError
from stiction.joints.net import ActuatorNet, Layers

NO_CURVE = 1e4
"""Speed of a torque-speed curve that limits nothing [rad/s]: the net has the motor's own."""


class Perceptron(torch.nn.Module):
    """A net of one group of joints; rows of another width than it was trained with are refused."""

    def __init__(self, layers: Layers) -> None:
        super().__init__()
        self.width: int = layers[0][0].shape[1]
        parts: list[torch.nn.Module] = []
        for weight, bias in layers:
            linear = torch.nn.Linear(weight.shape[1], weight.shape[0])
            with torch.no_grad():
                linear.weight.copy_(torch.tensor(weight))
                linear.bias.copy_(torch.tensor(bias))
            parts += [linear, torch.nn.Softsign()]
        self.net = torch.nn.Sequential(*parts[:-1])

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return torque over torque limit, shape (rows, 1); rows: shape (rows, 2 (H + 1)) [rad, rad/s]."""
        if rows.shape[1] != self.width:
            raise RuntimeError("Actuator Net: the history has another length than it was trained with")
        return self.net(rows)


def actuator_files(net: ActuatorNet, to: str) -> dict[str, bytes]:
    """Return name -> contents: `net_G.pt` for each group of joints and torque limit, and `actuators.py`.

    to: `mjlab` or `isaaclab`. Raises `FileError` for a net whose inputs they do not have.
    """
    if net.inputs != "default":
        raise FileError(
            f"the Actuator Net: got the inputs {net.inputs!r}, expected 'default', position errors and velocities, as "
            f"{to} has them; train it with --inputs default"
        )
    limit = dict(zip(net.joint_names, net.torque_limit, strict=True))
    blocks: list[str] = []
    files: dict[str, bytes] = {}
    for layers, group in zip(net.layers, net.groups, strict=True):
        for most in dict.fromkeys(limit[name] for name in group):
            names, file = [name for name in group if limit[name] == most], f"net_{len(blocks)}.pt"
            files[file] = _scripted(layers)
            blocks.append(_CONFIGURATIONS[to].format(**_fields(net, names, most, file)))
    text = _TEXT.format(
        module="mjlab.actuator" if to == "mjlab" else "isaaclab.actuators",
        name="LearnedMlpActuatorCfg" if to == "mjlab" else "ActuatorNetMLPCfg",
        period=repr(net.period),
        blocks="".join(blocks),
    )
    return files | {"actuators.py": text.encode()}


def _scripted(layers: Layers) -> bytes:
    """Return a net as a file of TorchScript."""
    buffer = BytesIO()
    with warnings.catch_warnings():
        # Deprecated in torch, and the format that both trainers read.
        warnings.filterwarnings("ignore", "`torch.jit", Warning)
        torch.jit.save(torch.jit.script(Perceptron(layers).eval()), buffer)
    return buffer.getvalue()


def _fields(net: ActuatorNet, names: Sequence[str], most: float, file: str) -> dict[str, str]:
    """Return the words of one configuration; most: the torque limit of its joints [N m]."""
    # Torque measured behind the joint's friction has that in it.
    friction = {"mjlab": "frictionloss=0.0, viscous_damping=0.0", "isaaclab": "friction=0.0, dynamic_friction=0.0"}
    inside = net.torque_source == "output_side"
    return {
        "key": repr(file.removesuffix(".pt")),
        "names": ", ".join(repr(re.escape(name)) for name in names),
        "file": repr(file),
        "limit": repr(most),
        "saturation": repr(2 * most),
        "curve": repr(NO_CURVE),
        "samples": str(net.history + 1),
        "mjlab_friction": f"            {friction['mjlab']},\n" if inside else "",
        "isaaclab_friction": f"            {friction['isaaclab']}, viscous_friction=0.0,\n" if inside else "",
    }


_TEXT = '''\
"""Actuator Nets of stiction, a group of joints each."""

import math
from pathlib import Path

from {module} import {name}

PERIOD = {period}
"""Physics step that the nets were trained with [s]."""


def actuators(timestep):
    """Return the configurations; timestep: the simulation's physics step [s]."""
    if not math.isclose(timestep, PERIOD, rel_tol=1e-6):
        raise ValueError(f"Actuator Net: got a physics step of {{timestep}} s, expected {{PERIOD}} s; set that")
    here = Path(__file__).parent
    return {{
{blocks}    }}
'''

_SHARED = """\
            network_file=str(here / {file}),
            pos_scale=1.0,
            vel_scale=1.0,
            torque_scale={limit},
            input_order="pos_vel",
"""

_CONFIGURATIONS = {
    "mjlab": """\
        {key}: LearnedMlpActuatorCfg(
            target_names_expr=({names},),
"""
    + _SHARED
    + """\
            history_length={samples},
            effort_limit={limit},
            # A curve that limits nothing: the net has the motor's own.
            saturation_effort={saturation},
            velocity_limit={curve},
{mjlab_friction}        ),
""",
    "isaaclab": """\
        {key}: ActuatorNetMLPCfg(
            joint_names_expr=[{names}],
"""
    + _SHARED
    + """\
            input_idx=list(range({samples})),
            effort_limit={limit},
            # A curve that limits nothing: the net has the motor's own.
            saturation_effort={saturation},
            velocity_limit={curve},
{isaaclab_friction}        ),
""",
}
