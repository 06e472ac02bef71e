"""Cheaper updates of the networks equal the plain ones."""

import pytest
import torch
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict
from torch import nn

from stiction.learning import quick
from stiction.learning.quick import QuickELU, gathered_batches


def storage() -> RolloutStorage:
    """A full storage of 6 robots and 4 steps, every number another."""
    obs = TensorDict({"a": torch.zeros(6, 3), "b": torch.zeros(6, 2)}, batch_size=[6])
    filled = RolloutStorage("rl", 6, 4, obs, [2])
    transition = RolloutStorage.Transition()
    for _ in range(4):
        transition.observations = TensorDict({"a": torch.randn(6, 3), "b": torch.randn(6, 2)}, batch_size=[6])
        transition.actions, transition.rewards = torch.randn(6, 2), torch.randn(6)
        transition.dones, transition.values = torch.zeros(6), torch.randn(6, 1)
        transition.actions_log_prob = torch.randn(6)
        transition.distribution_params = (torch.randn(6, 2), torch.rand(6, 2))
        filled.add_transition(transition)
    filled.returns, filled.advantages = torch.randn(4, 6, 1), torch.randn(4, 6, 1)
    return filled


def test_mini_batches_are_those_of_the_library_bit_for_bit() -> None:
    """Same shuffle, same numbers, in every epoch, though the algorithm changes what it is handed."""
    full, fields = storage(), ("actions", "values", "advantages", "returns", "old_actions_log_prob")
    torch.manual_seed(7)
    wanted = list(full.mini_batch_generator(3, 2))
    after = torch.rand(1)
    torch.manual_seed(7)
    batches = 0
    for ours, theirs in zip(gathered_batches(full, 3, 2), wanted, strict=True):
        assert all(torch.equal(getattr(ours, name), getattr(theirs, name)) for name in fields)
        assert all(torch.equal(ours.observations[name], theirs.observations[name]) for name in ("a", "b"))
        pairs = zip(ours.old_distribution_params, theirs.old_distribution_params, strict=True)
        assert all(torch.equal(first, second) for first, second in pairs)
        ours.advantages = (ours.advantages - ours.advantages.mean()) / ours.advantages.std()
        ours.observations = torch.cat([ours.observations, ours.observations])
        batches += 1
    assert batches == 6 and torch.equal(after, torch.rand(1))


def test_the_quick_elu_is_elu_with_its_gradient() -> None:
    """To the rounding of numbers near 1; far below zero, at zero and far above as well."""
    x = torch.cat((torch.linspace(-20, 20, 4001), torch.tensor([0.0, -1e-9, 1e-9, -200.0, 200.0])))
    x = x.double().float().requires_grad_()
    grown = torch.linspace(-1, 1, len(x))
    values, gradients = [], []
    for function in (QuickELU(), nn.ELU()):
        value = function(x)
        values.append(value)
        gradients.append(torch.autograd.grad(value, x, grown)[0])
    torch.testing.assert_close(values[0], values[1], rtol=0, atol=2e-7)
    torch.testing.assert_close(gradients[0], gradients[1], rtol=0, atol=2e-7)


@pytest.mark.parametrize(("path", "kind"), [("fast", QuickELU), ("default (off)", nn.ELU)])
def test_networks_change_only_on_the_fast_path(monkeypatch: pytest.MonkeyPatch, path: str, kind: type) -> None:
    """Elsewhere `exp` is no faster; and the parameters keep their names, or no checkpoint would load."""
    monkeypatch.setattr(quick, "gemm_path", lambda: path)

    class Algorithm:
        def __init__(self) -> None:
            self.actor = nn.Sequential(nn.Linear(2, 2), nn.Sequential(nn.Linear(2, 2), nn.ELU()))

    algorithm = Algorithm()
    names = list(algorithm.actor.state_dict())
    quick.quicken(algorithm)
    assert type(algorithm.actor[1][1]) is kind
    assert list(algorithm.actor.state_dict()) == names
