"""Actuator Nets as files: read as written, or refused in one line; and refused where they do not belong."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from actuators import pd_net
from stiction.core.errors import FileError
from stiction.files.actuator import FILE, read_actuator, write_actuator
from stiction.robots.catalog import find_robot

SPEC = find_robot("saturn_lite")
LIMITS = SPEC.joint_values("torque_limit")


def test_what_is_written_is_read(tmp_path: Path) -> None:
    """A weight that changed on the way would be another motor; a folder stands for its file."""
    net = pd_net(inputs="paper", torque_source="output_side")
    write_actuator(tmp_path / "net" / FILE, net)
    for path in (tmp_path / "net", tmp_path / "net" / FILE):
        again = read_actuator(path)
        assert replace(again, layers=net.layers) == net
        for ours, theirs in zip(again.layers, net.layers, strict=True):
            for (weight, bias), (weight2, bias2) in zip(ours, theirs, strict=True):
                np.testing.assert_array_equal(weight, weight2)
                np.testing.assert_array_equal(bias, bias2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"period": 0.01}, "period of 0.01 s, the simulation steps by 0.005 s; use --set task.timestep=0.01"),
        ({"joint_names": SPEC.joint_names[::-1]}, "for the joints of 'saturn_lite', RR_shank"),
        ({"torque_limit": tuple(2 * LIMITS)}, "torque limits of 50 to 90 N m"),
    ],
)
def test_a_net_is_refused_where_it_does_not_belong(change: dict, message: str) -> None:
    """The field's much-copied net was logged at 50 Hz and run at 200 Hz, and nothing said so."""
    net = pd_net(**change)
    with pytest.raises(FileError, match=message):
        net.check_use("saturn_lite", SPEC.joint_names, LIMITS, 0.005)


WRONG = np.zeros((1, 7), np.float32)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"period": float("nan")}, "period"),
        ({"groups": (SPEC.joint_names[:-1],)}, "every joint in one group"),
        ({"torque_limit": (1.0,)}, "18 positive numbers"),
        ({"layers": (((WRONG, np.zeros(1, np.float32)),),) * 3}, r"\(outputs, 8\)"),
        ({"layers": (((np.full((1, 8), np.nan, np.float32), np.zeros(1, np.float32)),),) * 3}, "finite"),
        ({"training": {"a": 1}}, "SHA-256"),
        ({"loss": {"training": -1.0}}, "at least 0"),
    ],
)
def test_nets_that_no_simulation_could_use_are_refused(change: dict, message: str) -> None:
    """One line that names the field, instead of a shape error in the middle of training."""
    with pytest.raises(FileError, match=message):
        pd_net(**change)


def rewritten(path: Path, header: object, arrays: dict) -> Path:
    """Return a net on disk with another header or other arrays; None takes an array out."""
    write_actuator(path, pd_net())
    with np.load(path) as archive:
        content = {name: archive[name] for name in archive.files} | arrays
    if header is not None:
        whole = json.loads(str(content["header"]))
        content["header"] = np.array(header if isinstance(header, str) else json.dumps(whole | header))
    np.savez(path, **{name: array for name, array in content.items() if array is not None})
    return path


@pytest.mark.parametrize(
    ("header", "arrays", "message"),
    [
        ("{", {}, "not JSON"),
        ({"schema_version": 9}, {}, "version 9; this program reads version 1"),
        (None, {"header": None}, "no header"),
        (None, {"bias.1.0": None}, "no array 'bias.1.0'"),
        (None, {"weight.0.0": None, "bias.0.0": None}, "layers of group 0"),
    ],
)
def test_files_that_are_no_net_are_refused(tmp_path: Path, header: object, arrays: dict, message: str) -> None:
    """A damaged file must not become a damaged motor."""
    path = rewritten(tmp_path / FILE, header, arrays)
    with pytest.raises(FileError, match=message):
        read_actuator(path)


def test_a_missing_net_is_named(tmp_path: Path) -> None:
    """The user mistyped a folder."""
    with pytest.raises(FileError, match="no Actuator Net at"):
        read_actuator(tmp_path)
