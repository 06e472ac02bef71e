"""The paper's gait rewards, worked out by hand for six feet in the order FL FR ML MR RL RR."""

import torch

from stiction.task.env import UnsyncWindow, exactly_one_group

GROUP = torch.tensor([0, 1, 1, 0, 0, 1])
TRIPOD_0 = [1, 0, 0, 1, 1, 0]
TRIPOD_1 = [0, 1, 1, 0, 0, 1]


def contacts(*rows: list[int]) -> torch.Tensor:
    """Rows of contacts as bool."""
    return torch.tensor(rows).bool()


def test_trot_pays_for_either_tripod_and_for_nothing_else() -> None:
    """Set equality is literal: a missing foot, an extra foot, all feet and no feet pay nothing."""
    rows = contacts(TRIPOD_0, TRIPOD_1, [1, 0, 0, 1, 0, 0], [1, 1, 0, 1, 1, 0], [1] * 6, [0] * 6)
    assert exactly_one_group(rows, GROUP).tolist() == [True, True, False, False, False, False]


def test_unsync_cancels_over_a_tripod_gait_and_grows_over_a_hop() -> None:
    """Equal use of both groups gives 0; three-legged hopping on one group gives the whole range."""
    window = UnsyncWindow(2, legs=6, horizon=4)
    for step in range(4):
        walking, hopping = (3.0 if step % 2 else -3.0), 3.0
        value = window.push(torch.tensor([walking, hopping]))
    assert value.tolist() == [0.0, 1.0]
    window.reset(torch.tensor([1]))
    assert window.push(torch.tensor([0.0, 0.0]))[1] == 0.0
