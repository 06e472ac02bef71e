"""Processes at work: they give the same as one, and none outlives the one that started it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from processes import is_alive, python, wait_until
from stiction.core.errors import StictionError
from stiction.core.parallel import spread
from stiction.core.scratch import scratch


def square(number: int) -> int:
    """A task."""
    if number < 0:
        raise StictionError(f"{number} is negative")
    return number * number


def last(folder: Path) -> None:
    """A task that says who does it, and then that it was done, after a minute."""
    (folder / str(os.getpid())).write_text("")
    time.sleep(60)
    (folder / "0").write_text("")


def grandchild(folder: Path) -> None:
    """A task whose own tasks do not end."""
    list(spread(last, [(folder,)] * 2, 2))


def killed() -> None:
    """A task whose process is killed."""
    os.kill(os.getpid(), signal.SIGKILL)


def test_what_a_task_raises_comes_back() -> None:
    """As the error that it is, and a process that was killed as one line."""
    with pytest.raises(StictionError, match="-1 is negative"):
        list(spread(square, [(-1,), (2,)], 2))
    with pytest.raises(StictionError, match="a worker process was killed"):
        list(spread(killed, [(), ()], 2))


SCRIPT = """
import sys
sys.path[:0] = [sys.argv[1], str(sys.argv[1]) + "/../helpers"]
print("begun", flush=True)
import test_parallel
from stiction.core.parallel import spread
print(sorted(dict(spread(test_parallel.square, [(1,), (2,), (3,)], 2)).values()), flush=True)
"""


@pytest.mark.parametrize("typed", [False, True])
def test_a_script_without_a_guard_may_work_in_processes(typed: bool, tmp_path: Path) -> None:
    """Workers that ran the script again would each begin it anew; what is typed at a prompt has no file at all."""
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    words = [sys.executable, "-" if typed else str(script), str(Path(__file__).parent)]
    done = subprocess.run(words, input=SCRIPT if typed else None, capture_output=True, text=True, timeout=120)
    assert done.stdout.split("\n")[:2] == ["begun", "[1, 4, 9]"], done.stderr
    assert done.stdout.count("begun") == 1


def nested(count: int) -> list[int]:
    """A task with tasks of its own."""
    return sorted(dict(spread(square, [(number,) for number in range(count)], 2)).values())


def test_a_worker_of_another_pool_does_the_tasks_itself() -> None:
    """Python forbids it processes of its own: identifying within somebody's `multiprocessing.Pool` failed."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply(nested, (3,)) == [0, 1, 4]


PARENT = """
import sys
from pathlib import Path
sys.path[:0] = [sys.argv[1], str(Path(sys.argv[1]).parent / "helpers")]
import test_parallel
from stiction.core.parallel import spread
if __name__ == "__main__":
    print("begun", flush=True)
    list(spread(getattr(test_parallel, sys.argv[3]), [(Path(sys.argv[2]),)] * 2, 2))
"""


@pytest.mark.parametrize("task", ["last", "grandchild"])
def test_workers_end_with_a_killed_parent(task: str, tmp_path: Path) -> None:
    """After kill -9 they would go on computing for nobody, and hold a core each until the next reboot."""
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    (tmp_path / "pids").mkdir()
    words = [sys.executable, str(script), str(Path(__file__).parent), str(tmp_path / "pids"), task]
    parent = subprocess.Popen(words)
    count = {"last": 2, "grandchild": 4}[task]
    wait_until(lambda: len(list((tmp_path / "pids").iterdir())) == count, "the workers did not begin", 60.0)
    workers = [int(path.name) for path in (tmp_path / "pids").iterdir()]
    parent.kill()
    parent.wait()
    wait_until(lambda: not any(map(is_alive, workers)), "workers go on without their parent")


def test_who_wants_no_more_results_waits_for_nobody(tmp_path: Path) -> None:
    """A full disk, or Ctrl-C, in the middle: what is in work ends at once."""
    tasks = spread(sleeps_but_for_one, [(number, tmp_path) for number in range(3)], 3)
    assert next(tasks)[0] == 1
    wait_until(lambda: len(list(tmp_path.iterdir())) == 2, "the other tasks did not begin", 30.0)
    tasks.close()
    assert not (tmp_path / "0").exists()
    assert not any(is_alive(int(path.name)) for path in tmp_path.iterdir())


def sleeps_but_for_one(number: int, folder: Path) -> None:
    """A task that ends at once, and others that do not."""
    if number != 1:
        last(folder)


def test_nothing_is_left_of_a_temporary_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After the work, and after kill -9 in the middle of it."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    with scratch() as folder:
        (folder / "deep").mkdir()
        (folder / "deep" / "file").write_text("1")
        assert list(tmp_path.iterdir()) == [folder]
    assert not list(tmp_path.iterdir())
    hold = (
        "from stiction.core.scratch import scratch\nimport time\nwith scratch() as f:\n    (f / 'a b').write_text('')\n"
    )
    other = python(hold + "    print('held', flush=True); time.sleep(60)")
    assert other.stdout is not None and other.stdout.readline() == "held\n" and list(tmp_path.iterdir())
    other.kill()
    other.communicate()
    wait_until(lambda: not list(tmp_path.iterdir()), "the folder stays")
