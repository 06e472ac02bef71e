"""Work on a Ray cluster: two nodes on this machine, one of which is lost, and what is refused before any work."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

import cluster_tasks
from stiction.core.errors import StictionError
from stiction.core.parallel import spread
from stiction_experiments.lab import cluster as module
from stiction_experiments.lab.cluster import Cluster, ClusterError, use_cluster

pytestmark = [
    pytest.mark.slow,
    # Found, and not imported: every process that collects tests would pay for it, and one uses it.
    pytest.mark.skipif(find_spec("ray") is None, reason="the package ray is needed"),
]

TESTS = Path(__file__).parents[2] / "helpers"


@pytest.fixture(scope="module")
def nodes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Any, Cluster]]:
    """A head that does no work, one node that does, and the connection to them, which takes longest of all."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join((str(TESTS), str(TESTS.parents[1] / "src"))))
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        from ray.cluster_utils import Cluster as Started

        small = {"object_store_memory": 80 * 2**20, "include_dashboard": False}
        try:
            cluster = Started(initialize_head=True, head_node_args={"num_cpus": 0, **small})
        except Exception as error:  # whatever a machine forbids: ports, shared memory, processes
            pytest.skip(f"Ray cannot start a cluster here: {error}")
        folder = tmp_path_factory.mktemp("cluster")
        try:
            cluster.add_node(num_cpus=1, object_store_memory=80 * 2**20)
            with use_cluster(cluster.address, folder) as used:
                assert used is not None and used.processors == 1
                assert not list(folder.glob(".cluster-*"))
                yield cluster, used
        finally:
            cluster.shutdown()


def test_what_a_task_raises_comes_home(nodes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As it is, and not a second time; relative paths are those of who asked."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(StictionError, match="no walk of 3"):
        list(spread(cluster_tasks.refuse, [(3,)], 1))
    assert Path("refused-3").read_text() == "x"


def test_a_node_with_other_code_is_refused(nodes: Any, tmp_path: Path) -> None:
    """Its results would stand beside those of this one as if they were the same; one that comes later is found too."""
    started, used = nodes
    with pytest.raises(ClusterError, match="has other code"):
        list(replace(used, code="0" * 64).spread(cluster_tasks.square, [(1, str(tmp_path))], 1))
    (node,) = started.worker_nodes
    later = {"NodeID": node.node_id, "NodeManagerAddress": "a node"}
    with pytest.raises(ClusterError, match=r"has other code of stiction; install the same"):
        module._checked([later], "0" * 64, tmp_path)
    assert module._look("x", tmp_path / "nothing", str(tmp_path)) == (False, False)


def test_a_lost_node_costs_its_tasks_and_no_result(nodes: Any, tmp_path: Path) -> None:
    """Each task is done at least once and told once; what was on the lost node is done again elsewhere."""
    started, used = nodes
    lost = started.add_node(num_cpus=1, object_store_memory=80 * 2**20)
    results = []
    for number, result in spread(cluster_tasks.square, [(number, str(tmp_path)) for number in range(12)], 2):
        results.append((number, result))
        if len(results) == 3:
            started.remove_node(lost, allow_graceful=False)
    assert sorted(results) == [(number, number**2) for number in range(12)]
    begun = sorted(path.name.partition("-")[0] for path in tmp_path.glob("*-begun-*"))
    assert set(begun) == {str(number) for number in range(12)}
    # Who begins now finds the lost node among those that the head node still counts.
    gone = {"NodeID": lost.node_id, "NodeManagerAddress": "a node that was lost"}
    with pytest.raises(ClusterError, match="no node with a processor"):
        module._checked([gone], used.code, tmp_path)


def test_no_cluster_is_one_line(tmp_path: Path) -> None:
    """A wrong address is not waited for."""
    with (
        pytest.raises(ClusterError, match=r"no Ray cluster at '127.0.0.1:9'.*ray start --head"),
        use_cluster("127.0.0.1:9", tmp_path),
    ):
        pass
    with pytest.raises(ClusterError, match="no Ray cluster at 'nowhere'"), use_cluster("nowhere", tmp_path):
        pass
    with use_cluster(None, tmp_path) as nothing:
        assert nothing is None
