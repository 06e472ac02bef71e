"""Work on all cores: tasks that know nothing of each other, each in whichever process is free."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from stiction.core.errors import StictionError
from stiction.core.isolation import isolate_workers

Result = TypeVar("Result")


def spread(work: Callable[..., Result], tasks: Sequence[tuple[Any, ...]], jobs: int) -> Iterator[tuple[int, Result]]:
    """Call `work` with the arguments of each task, and yield a task's number and result as it ends.

    jobs: processes at once; with one, or a single task, this process does it. Raises `StictionError` where a process
    was killed, and whatever `work` raises; what was not begun by then is not done.
    """
    if jobs == 1 or len(tasks) < 2:
        for number, task in enumerate(tasks):
            yield number, work(*task)
        return
    isolate_workers()
    # Forked children would share the simulator's threads with this process.
    pool = ProcessPoolExecutor(min(jobs, len(tasks)), mp_context=multiprocessing.get_context("spawn"))
    try:
        waiting = {pool.submit(work, *task): number for number, task in enumerate(tasks)}
        for future in as_completed(waiting):
            yield waiting.pop(future), future.result()
    except BrokenProcessPool as error:
        raise StictionError(
            "a process at work was killed, perhaps for want of memory; what is done is kept: run the same command "
            "again, with fewer --jobs"
        ) from error
    finally:
        pool.shutdown(cancel_futures=True)
