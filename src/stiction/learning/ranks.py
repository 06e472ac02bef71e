"""Training in several processes at once: each walks a share of the robots, and all have the same networks.

`torchrun --nproc-per-node 2 -m stiction train ...` starts them and names each by its rank; they meet over gloo, on GPUs
over nccl. After every backward pass gradients are averaged, so that every process takes the same step; advantages, the
KL divergence, figures and decisions are those of all robots together. Rank 0, which leads, writes the run; the others
keep their own robots beside its checkpoints. All need the same file system.
"""

from __future__ import annotations

import atexit
import json
import os
import socket
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

import torch
from rsl_rl.utils import reduce_gradients_in_buckets
from torch import distributed

from stiction.core.errors import ConfigurationError, TrainingError

PATIENCE = timedelta(seconds=20)
"""Longest wait for the other processes, which take the same steps: a process that is left alone ends within 30 s,
imports included."""

CONNECTING = timedelta(seconds=5)
"""Longest wait for an answer of a leader that listens; torch tries three times, with pauses."""

BEGINNING = timedelta(minutes=30)
"""Longest wait until all have begun: a simulator on a GPU compiles for minutes."""

BUCKET = 25.0
"""Size of the buffers in which gradients travel [MB]."""

COUNTED = ("walk/blown_up",)
"""Figures that are counts, and add up."""

LOST = ("gloo", "monitoredbarrier")
"""Words of torch's errors, in small letters, where another process is gone."""


class PeerGone(TrainingError):
    """Another process of the training has ended, or does not answer."""


@dataclass(frozen=True)
class Ranks:
    """The processes of a training, as one of them sees them."""

    number: int = 0
    """Rank of this process."""
    size: int = 1
    """Number of processes."""
    local: int = 0
    """Rank among the processes of this machine, and number of its GPU."""

    @property
    def alone(self) -> bool:
        """True if no other process trains."""
        return self.size == 1

    @property
    def leads(self) -> bool:
        """True if this process writes the run and prints for all."""
        return self.number == 0

    @property
    def program(self) -> str:
        """The words by which such a training is started."""
        return "stiction" if self.alone else f"torchrun --nproc-per-node {self.size} -m stiction"

    def share(self, robots: int) -> int:
        """Return how many of a training's robots walk here. Raises `StictionError` where they cannot be shared."""
        if robots % self.size:
            raise ConfigurationError(
                f"{robots} robots in {self.size} processes: expected as many in each; use --num-envs "
                f"{max(1, round(robots / self.size)) * self.size}"
            )
        return robots // self.size

    def named(self, name: str) -> str:
        """Return the name of this process's own stream of random numbers."""
        return name if self.leads else f"{name} {self.number}"

    @contextmanager
    def together(self) -> Iterator[None]:
        """Turn the loss of another process into one line."""
        try:
            yield
        except (distributed.DistError, RuntimeError) as error:
            known = isinstance(error, distributed.DistError) or any(word in str(error).lower() for word in LOST)
            if self.alone or not known:
                raise
            raise self._gone() from error

    def _gone(self) -> PeerGone:
        """Return the one line for the loss of another process."""
        return PeerGone(
            f"another of the {self.size} processes of this training is gone, or has not answered for "
            f"{PATIENCE.seconds} s; go on from the last checkpoint with `{self.program} train --resume RUN`"
        )

    def join(self, device: str) -> None:
        """Meet the others, once, and part at the end of this process. Raises `PeerGone` where they do not come."""
        if self.alone or distributed.is_initialized():
            return
        if os.environ.get("MASTER_ADDR") in ("localhost", "127.0.0.1") and (names := _loopback()):
            os.environ.setdefault("GLOO_SOCKET_IFNAME", names)
        with self.together():
            if device == "cuda":
                torch.cuda.set_device(self.local)
            backend, store = "cpu:gloo,cuda:nccl" if device == "cuda" else "gloo", self._meeting()
            distributed.init_process_group(
                backend, store=store, rank=self.number, world_size=self.size, timeout=PATIENCE
            )
        # A process that ends with gloo's threads still running is aborted, one in three times, with its work done.
        atexit.register(distributed.destroy_process_group)

    def _meeting(self) -> distributed.Store:
        """Return the store over which processes meet, once its leader has opened it.

        Torch itself would search for longer.
        """
        place = os.environ["MASTER_ADDR"], int(os.environ["MASTER_PORT"])
        end = time.monotonic() + PATIENCE.total_seconds()
        while not self.leads:
            try:
                socket.create_connection(place, timeout=1.0).close()
                break
            except OSError as error:
                if time.monotonic() > end:
                    raise self._gone() from error
            time.sleep(0.1)
        timeout = PATIENCE if self.leads else CONNECTING
        store, _, _ = next(distributed.rendezvous("env://", self.number, self.size, timeout=timeout))
        # The time given to `rendezvous` is that of connecting alone, and shorter.
        store.set_timeout(PATIENCE)
        return store

    def begin(self) -> None:
        """Wait until all processes have come as far as this."""
        if not self.alone:
            with self.together():
                # Not `barrier`, whose patience is the group's: some processes may still be compiling their simulator.
                distributed.monitored_barrier(timeout=BEGINNING, wait_all_ranks=True)

    def wait(self) -> None:
        """Wait for the others."""
        if not self.alone:
            with self.together():
                distributed.barrier()

    def any(self, flag: bool) -> bool:
        """Return True if a flag is set in any process."""
        if self.alone:
            return flag
        return any(self._gathered(flag))

    def figures(self, figures: Mapping[str, float]) -> dict[str, float]:
        """Return the figures of all robots: means over the processes that have them, and sums of counts."""
        if self.alone:
            return dict(figures)
        every = self._gathered(dict(figures))
        names = dict.fromkeys(name for each in every for name in each)
        values = {name: [each[name] for each in every if name in each] for name in names}
        return {name: sum(each) / (1 if name in COUNTED else len(each)) for name, each in values.items()}

    def average(self, parameters: Iterable[torch.nn.Parameter]) -> None:
        """Put the mean of all processes' gradients in the place of this one's."""
        if not self.alone:
            with self.together():
                reduce_gradients_in_buckets(parameters, self.size, BUCKET)

    def standardized(self, values: torch.Tensor) -> torch.Tensor:
        """Return values less their mean, over their standard deviation, both of all processes; any shape."""
        count = values.numel() * self.size
        mean = self._sum(values.sum()) / count
        return (values - mean) / ((self._sum((values - mean).square().sum()) / (count - 1)).sqrt() + 1e-8)

    def _sum(self, value: torch.Tensor) -> torch.Tensor:
        """Return the sum of a scalar over all processes."""
        if not self.alone:
            with self.together():
                distributed.all_reduce(value)
        return value

    def _gathered(self, value: object) -> list[Any]:
        """Return a value of every process, in their order. It travels as JSON: nothing is unpickled."""
        text = torch.frombuffer(bytearray(json.dumps(value).encode()), dtype=torch.uint8)
        with self.together():
            # all_gather wants tensors of one size from every process: lengths first, then texts filled up to the
            # longest.
            sizes = [torch.zeros(1, dtype=torch.long) for _ in range(self.size)]
            distributed.all_gather(sizes, torch.tensor([len(text)]))
            room = torch.zeros(int(torch.stack(sizes).max()), dtype=torch.uint8)
            gathered = [room.clone() for _ in range(self.size)]
            room[: len(text)] = text
            distributed.all_gather(gathered, room)
        return [json.loads(bytes(each[: int(size)].tolist())) for each, size in zip(gathered, sizes, strict=True)]


ALONE = Ranks()


def _loopback() -> str | None:
    """Return the name of this machine's loopback interface; gloo would else listen where the host's name points to."""
    return next((name for _, name in socket.if_nameindex() if name in ("lo", "lo0")), None)


def named_ranks() -> Ranks:
    """Return the processes that torchrun has started, this one alone without it. Raises `StictionError`."""
    words = {name: os.environ.get(name, default) for name, default in (("RANK", "0"), ("WORLD_SIZE", "1"))}
    words["LOCAL_RANK"] = os.environ.get("LOCAL_RANK", words["RANK"])
    try:
        number, size, local = map(int, words.values())
    except ValueError:
        number, size, local = -1, 0, -1
    if not 0 <= number < size <= 4096 or local < 0:
        typed = ", ".join(f"{name}={value}" for name, value in words.items())
        raise ConfigurationError(f"{typed}: expected what torchrun sets, or none of them")
    host, port = os.environ.get("MASTER_ADDR", ""), os.environ.get("MASTER_PORT", "")
    if size > 1 and not (host and port.isdecimal()):
        raise ConfigurationError(
            f"MASTER_ADDR={host}, MASTER_PORT={port}: expected where {size} processes meet, as torchrun sets it"
        )
    return Ranks(number, size, local)
