"""The gait rewards as printed, by hand."""

from types import SimpleNamespace
from typing import Any

import torch

from stiction_experiments.paper.rewards import printed_trot, printed_unsync


def test_the_printed_gait_is_paid_while_standing_too() -> None:
    """Exactly one group on the ground pays 1, moving or standing; half of the largest r_unsync costs 0.5."""
    snapshot: Any = SimpleNamespace(
        one_group=torch.tensor([True, True, False]),
        unsync=torch.tensor([0.5, 0.5, 0.0]),
        moving=torch.tensor([True, False, False]),
    )
    assert printed_trot(snapshot).tolist() == [1.0, 1.0, 0.0]
    assert printed_unsync(snapshot).tolist() == [0.5, 0.5, 0.0]
