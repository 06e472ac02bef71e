"""Commands as people type them."""

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.files.velocity import parse_command


@pytest.mark.parametrize(
    ("text", "label", "velocity"),
    [
        ("vx=0.5", "vx=0.5", (0.5, 0, 0)),
        ("vx=-.50", "vx=-0.5", (-0.5, 0, 0)),
        (" wz=0.2, vx=0.3", "vx=0.3,wz=0.2", (0.3, 0, 0.2)),
        ("vy=0.3,vx=0", "vy=0.3", (0, 0.3, 0)),
        ("stand", "stand", (0, 0, 0)),
        ("vx=0", "stand", (0, 0, 0)),
    ],
)
def test_labels_and_velocities(text: str, label: str, velocity: tuple) -> None:
    """Equal commands have equal labels in the results."""
    command = parse_command(text)
    assert (command.label, command.velocity) == (label, velocity)


@pytest.mark.parametrize("text", ["", "0.5", "vx", "vx=", "vx=nan", "vx=inf", "x=0.5", "vx=1,vx=2", "vx=0.5;vy=1"])
def test_what_is_not_understood_is_refused(text: str) -> None:
    """Rejects an unknown command."""
    with pytest.raises(StictionError, match="not understood"):
        parse_command(text)


def test_direction_and_speed() -> None:
    """Speed is measured along the command; a turn counts only where nothing else is commanded."""
    diagonal = parse_command("vx=0.3,vy=-0.4,wz=1")
    np.testing.assert_allclose(diagonal.direction, [0.6, -0.8, 0.0])
    assert diagonal.speed == pytest.approx(0.5)
    turn = parse_command("wz=-0.5")
    np.testing.assert_allclose(turn.direction, [0.0, 0.0, -1.0])
    assert turn.speed == 0.5
    assert parse_command("stand").direction is None
