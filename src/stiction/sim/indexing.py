"""Selection of robots of a fleet, as a tensor: ids (n,), with n rows of values, or a mask (N,), with N rows. torch
only.

The number of selected robots of a mask need not be known on the host, so a GPU need not be waited for.
"""

from __future__ import annotations

import torch


def assign(into: torch.Tensor, which: torch.Tensor, values: torch.Tensor | float) -> None:
    """Assign `values`, broadcast to (len(which), ...), to the rows `which` of `into`, (N, ...)."""
    if isinstance(values, torch.Tensor):
        values = values.to(into.dtype)
    if which.dtype == torch.bool:
        into.copy_(torch.where(which.view(-1, *(1,) * (into.dim() - 1)), values, into))
    else:
        into[which] = values


def to_ids(which: torch.Tensor, *values: torch.Tensor) -> tuple[torch.Tensor, ...]:
    """Return ids and their rows of values from ids or a mask; on a GPU this synchronises."""
    if which.dtype != torch.bool:
        return which, *values
    ids = which.nonzero().flatten()
    return ids, *(value[ids] for value in values)


def to_mask(which: torch.Tensor, num: int) -> torch.Tensor:
    """Return the mask, (num,) bool, from ids or a mask."""
    if which.dtype == torch.bool:
        return which
    mask = torch.zeros(num, dtype=torch.bool, device=which.device)
    mask[which] = True
    return mask
