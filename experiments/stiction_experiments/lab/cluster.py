"""Tasks on the nodes of a Ray cluster, in place of processes of this machine.

Whoever runs the cluster has started it (`ray start`), installed this package on every node, and mounted the folders of
the work at the same place everywhere. Nodes must have the very code that runs here: each is asked before the work
begins, and each task again. Ray repeats a task whose node is lost; tasks are made so that a second time does no harm.
Nodes trust each other: Ray unpickles what they send.
"""

from __future__ import annotations

import os
import signal
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar
from uuid import uuid4

from stiction.core.cache import key_of
from stiction.core.errors import StictionError
from stiction.core.extras import experiments_remedy
from stiction.core.parallel import spread_by
from stiction.core.provenance import THREADS_VARIABLE, limit_library_threads
from stiction_experiments import CODE

Result = TypeVar("Result")

REPEATS = 5
"""How often a task may lose its node."""

IN_FLIGHT = 3
"""Tasks that are handed to the cluster at once, a processor: their arguments lie in its memory."""

ANSWER = 120.0
"""How long a node has to start a process and answer [s]."""


KNOCK = 5.0
"""How long the head node has to take a connection [s]."""


class ClusterError(StictionError):
    """A cluster that cannot be reached, has other code, does not see the files, or has lost too many nodes."""


@dataclass(frozen=True)
class Cluster:
    """A cluster that this process is connected to."""

    processors: int
    """Tasks that it does at once."""
    code: str
    """Digest of both packages here."""

    @property
    def place(self) -> tuple[str, str]:
        """Return what a task needs of this process: its code, and the base folder of relative paths."""
        return self.code, str(Path.cwd())

    def spread(
        self, work: Callable[..., Result], tasks: Sequence[tuple[Any, ...]], jobs: int
    ) -> Iterator[tuple[int, Result]]:
        """Call `work` with the arguments of each task on some node; yield number and result as it ends.

        jobs: tasks at once. Raises whatever `work` raises, and `ClusterError` where nodes are lost again and again.
        """
        ray = _ray()
        waiting = list(enumerate(tasks))[::-1]
        running: dict[Any, int] = {}
        remote = _remote()
        try:
            while waiting or running:
                while waiting and len(running) < IN_FLIGHT * jobs:
                    number, task = waiting.pop()
                    running[remote.remote(*self.place, work, task)] = number
                (done,), _ = ray.wait(list(running), num_returns=1)
                yield running.pop(done), self.result(done)
        finally:
            for left in running:
                ray.cancel(left, force=True)

    def result(self, task: Any) -> Any:
        """Wait for a task; return its result. Raises as `spread`."""
        ray = _ray()
        try:
            return ray.get(task)
        except ray.exceptions.RayTaskError as error:
            raise error.cause or ClusterError(f"a task failed: {error}") from error
        except (ray.exceptions.RayError, ConnectionError) as error:
            raise ClusterError(
                f"the cluster lost a task {REPEATS + 1} times, or is gone itself ({type(error).__name__}); what is "
                "done is kept: run the same command again"
            ) from error


@contextmanager
def use_cluster(address: str | None, folder: Path) -> Iterator[Cluster | None]:
    """Send the work of this process to a cluster while the context lasts; with None do nothing.

    address: HOST:PORT of its head node, or `auto` on one of its nodes; folder: which exists, and which every node must
    see, as the results go there.

    Raises `StictionError` without the package ray, and where the cluster cannot be used.
    """
    if address is None:
        yield None
        return
    if find_spec("ray") is None:
        raise ClusterError(f"--cluster needs the package ray, which is not installed; {experiments_remedy('cluster')}")
    ray = _ray()
    ends = signal.getsignal(signal.SIGTERM)
    try:
        _knock(address)
        # Unless told otherwise Ray prints here what tasks on all nodes print.
        ray.init(address=address, log_to_driver=False, logging_level="ERROR", configure_logging=False)
    except (OSError, RuntimeError, ValueError, AssertionError) as error:
        cause = (str(error).strip() or type(error).__name__).splitlines()[0][:200]
        raise ClusterError(
            f"there is no Ray cluster at {address!r} ({cause}); start one with `ray start --head`, and name HOST:PORT"
        ) from error
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, ends)  # Ray's own would end this process without a word
    try:
        code = code_digest()
        nodes = [node for node in ray.nodes() if node["Alive"] and node["Resources"].get("CPU", 0) >= 1]
        nodes = _checked(nodes, code, folder)
        cluster = Cluster(int(sum(node["Resources"]["CPU"] for node in nodes)), code)
        with spread_by(cluster.spread):
            yield cluster
    finally:
        ray.shutdown()


def _knock(address: str) -> None:
    """Raise `OSError` or `ValueError` where nobody listens at HOST:PORT: Ray itself would try for minutes."""
    if address == "auto":
        return
    host, _, port = address.rpartition(":")
    socket.create_connection((host.strip("[]"), int(port)), KNOCK).close()


def code_digest() -> str:
    """Return the digest of all modules, by which nodes are compared."""
    return key_of([], *CODE)


def _ray() -> Any:
    """Return the package ray, with its usage reports switched off."""
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    import ray

    return ray


def _remote() -> Any:
    """Return `_work` as Ray runs it: on one processor, again where its node is lost, not where it raises."""
    ray = _ray()
    return ray.remote(num_cpus=1, max_retries=REPEATS)(_work)


def _work(code: str, folder: str, work: Callable[..., Any], task: tuple[Any, ...]) -> Any:
    """Do a task on a node, on one thread. Raises `ClusterError` where the node has other code."""
    os.environ[THREADS_VARIABLE] = "1"
    limit_library_threads()
    # Where Ray was started in the background of a script, SIGINT is ignored, and to cancel a task would do nothing.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if (own := code_digest()) != code:
        raise ClusterError(f"the node {os.uname().nodename} has other code ({own[:12]}, here {code[:12]})")
    os.chdir(folder)
    return work(*task)


def _look(code: str, token: Path, folder: str) -> tuple[bool, bool]:
    """Return whether a node has the code, and sees a file and a folder."""
    return code_digest() == code, token.is_file() and Path(folder).is_dir()


def _checked(nodes: Sequence[dict[str, Any]], code: str, folder: Path) -> list[dict[str, Any]]:
    """Return the nodes that are there. Raises `ClusterError` where there is none, or one that cannot do the work."""
    ray = _ray()
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    # A file of this moment: a folder of the same name on the node's own disk does not have it.
    token = folder.resolve() / f".cluster-{uuid4().hex}"
    token.touch()
    reached = []
    try:
        looks = []
        for node in nodes:
            on_node = NodeAffinitySchedulingStrategy(node["NodeID"], soft=False)
            # Without a processor of its own, so that a node that is busy answers too.
            remote = ray.remote(num_cpus=0, max_retries=0, scheduling_strategy=on_node)(_look)
            looks.append(remote.remote(code, token, str(Path.cwd())))
        for node, look in zip(nodes, looks):
            name = node["NodeManagerAddress"]
            try:
                same, seen = ray.get(look, timeout=ANSWER)
            except (ray.exceptions.NodeDiedError, ray.exceptions.TaskUnschedulableError):
                continue  # lost a moment ago: the head node counts it as alive for some seconds more
            except ray.exceptions.RayError as error:
                if not _alive(node):
                    continue
                cause = str(getattr(error, "cause", None) or type(error).__name__).splitlines()[0][:200]
                raise ClusterError(
                    f"the node {name} cannot run stiction ({cause}); install the same version there"
                ) from error
            if not same:
                raise ClusterError(f"the node {name} has other code of stiction; install the same version there")
            if not seen:
                raise ClusterError(
                    f"the node {name} does not see {folder.resolve()}, or not {Path.cwd()}; mount them there at the "
                    "same place"
                )
            reached.append(node)
    finally:
        token.unlink(missing_ok=True)
    if not reached:
        raise ClusterError("the cluster has no node with a processor; start one with `ray start --address HOST:PORT`")
    return reached


def _alive(node: dict[str, Any]) -> bool:
    return any(other["NodeID"] == node["NodeID"] and other["Alive"] for other in _ray().nodes())
