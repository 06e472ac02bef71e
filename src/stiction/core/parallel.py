"""Parallel work: independent tasks, each in whichever process is free."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from stiction.core import lifeline
from stiction.core.errors import StictionError
from stiction.core.gemm import gemm_path, open_fast_gemm
from stiction.core.isolation import hidden_main, isolate_workers
from stiction.core.memory import check_memory

Result = TypeVar("Result")

PROCESS = 150e6
"""Minimum memory of a worker: Python with numerical libraries and a simulator [B]."""


_replacement: Callable[..., Iterator[tuple[int, Any]]] | None = None
"""Function that replaces `spread` in this process, such as a cluster's."""


@contextmanager
def spread_by(workers: Callable[..., Iterator[tuple[int, Any]]]) -> Iterator[None]:
    """Send the tasks of `spread` to other workers while the context lasts; `workers`: called with its arguments."""
    global _replacement
    before, _replacement = _replacement, workers
    try:
        yield
    finally:
        _replacement = before


def spread(work: Callable[..., Result], tasks: Sequence[tuple[Any, ...]], jobs: int) -> Iterator[tuple[int, Result]]:
    """Call `work` with the arguments of each task, and yield a task's number and result as it ends.

    jobs: number of processes; with one, or a single task, this process does the work. Within `spread_by` other workers
    do it. Raises `StictionError` where a process was killed, and anything that `work` raises; tasks not begun by then
    are not done. The processes end with this one, and at once where this process is interrupted or wants no more
    results.

    A script, a notebook or a prompt may call this at module level: workers do not run the program's main module again,
    and no `if __name__ == "__main__"` is needed, unless `work` or an argument is defined there. A worker of another
    pool, which may not start processes, does the tasks itself. Workers use the same path of matrix products as this
    process, which results record.
    """
    if _replacement is not None and tasks:
        yield from _replacement(work, tasks, jobs)
        return
    if jobs == 1 or len(tasks) < 2 or multiprocessing.current_process().daemon:
        for number, task in enumerate(tasks):
            yield number, work(*task)
        return
    processes = min(jobs, len(tasks))
    check_memory(processes * PROCESS, f"work in {processes} processes", "ask for fewer --jobs, or STICTION_THREADS")
    isolate_workers()
    # Forked children would share the simulator's threads with this process.
    context = multiprocessing.get_context("spawn")
    reader, writer = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(processes, context, initializer=_begin, initargs=(reader, gemm_path()))
    try:
        # Each submission may start a process, here and now.
        parts = (work, *(part for task in tasks for part in task))
        needs_main = any(getattr(part, "__module__", None) == "__main__" for part in parts)
        with nullcontext() if needs_main else hidden_main():
            waiting = {pool.submit(work, *task): number for number, task in enumerate(tasks)}
        for future in as_completed(waiting):
            yield waiting.pop(future), future.result()
    except BrokenProcessPool as error:
        raise StictionError(
            "a worker process was killed, perhaps for lack of memory; finished results are kept: run the same command "
            "again with fewer --jobs"
        ) from error
    except Exception:
        # A task's own error: without this clause the next one would end the workers in the middle of theirs.
        raise
    except BaseException:
        # Interrupted, or no more results are wanted: do not wait for the running tasks.
        writer.close()
        raise
    finally:
        # It waits for what is in work; where the writer is closed, the workers have ended themselves.
        pool.shutdown(cancel_futures=True)
        reader.close()
        writer.close()


_PARENT_PIPES: list[Connection] = []
"""Open ends of the parent's pipe in a worker."""


def _begin(reader: Connection, products: str) -> None:
    """Make a worker follow its parent. Ctrl-C and a closed terminal reach all processes; the parent answers them.

    products: the parent's `gemm_path`. A worker unpickles its first task, and with it perhaps torch, after this.
    """
    if products == "fast":
        open_fast_gemm()
    _PARENT_PIPES.append(reader)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    lifeline.watch(reader.fileno())
