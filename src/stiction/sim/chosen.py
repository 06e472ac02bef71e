"""Some robots of a fleet, as a tensor: numbers (n,), with n rows of values, or a mask (N,), with N rows. torch only.

How many a mask has need not be known on the host: on a GPU nobody waits for it.
"""

from __future__ import annotations

import torch


def put(into: torch.Tensor, which: torch.Tensor, values: torch.Tensor | float) -> None:
    """Write `values`, broadcast to (len(which), ...), over the rows `which` of `into`, (N, ...)."""
    if isinstance(values, torch.Tensor):
        values = values.to(into.dtype)
    if which.dtype == torch.bool:
        into.copy_(torch.where(which.view(-1, *(1,) * (into.dim() - 1)), values, into))
    else:
        into[which] = values


def numbered(which: torch.Tensor, *values: torch.Tensor) -> tuple[torch.Tensor, ...]:
    """Return numbers and their rows of values of what is given either way; on a GPU this waits for it."""
    if which.dtype != torch.bool:
        return which, *values
    ids = which.nonzero().flatten()
    return ids, *(value[ids] for value in values)


def masked(which: torch.Tensor, num: int) -> torch.Tensor:
    """Return the mask, (num,) bool, of what is given either way."""
    if which.dtype == torch.bool:
        return which
    mask = torch.zeros(num, dtype=torch.bool, device=which.device)
    mask[which] = True
    return mask
