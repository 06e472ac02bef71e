"""How a command ends: one line for whatever goes wrong, quietly where nobody reads on, and with nothing left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from processes import is_alive, stiction, wait_until
from stiction.cli.main import main
from stiction.report.terminal import Terminal, work_progress

POLICY = "saturn_lite-flat-deception-0.2"
"""A shipped policy."""


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (KeyError("gains"), "unforeseen KeyError: 'gains'; this is a fault of stiction: please report it"),
        (RecursionError("maximum depth"), "unforeseen RecursionError"),
        (RuntimeError("\x1b[2J\nx\ud800"), "unforeseen RuntimeError: \\u001b[2J x\\ud800;"),
        (OSError(28, "No space left on device", "a/b.csv"), "a/b.csv: No space left on device"),
        (MemoryError(), "there is not enough memory"),
        (
            RuntimeError("invalid value for environment variable MUJOCO_GL: nonsense"),
            "MUJOCO_GL: nonsense; expected egl, osmesa, glfw or disable, or nothing: unset it",
        ),
        (
            ModuleNotFoundError("No module named 'torch'", name="torch"),
            "needs the extra 'train'; install it with: pip install",
        ),
        (ModuleNotFoundError("No module named 'x'", name="x"), "unforeseen ModuleNotFoundError"),
    ],
)
@pytest.mark.parametrize("debug", [False, True])
def test_what_nobody_foresaw_is_one_line(
    error: Exception, message: str, debug: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """With where to report it; the traceback is for those who ask, with any verb."""

    def fails(arguments: list[str]) -> int:
        assert arguments == ["list"]
        raise error

    monkeypatch.setattr("stiction.cli.robot.main", fails)
    assert main(["robot", "list", *(["--debug"] if debug else [])]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert message in lines[-1] and (len(lines) == 1) != debug and any("Traceback" in line for line in lines) == debug


def run(words: tuple[str, ...], shell: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the program within a line of the shell, in which it is called "$@"; its status is printed last."""
    line = ["bash", "-c", shell, "bash", *stiction(*words)]
    return subprocess.run(line, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("words", "shell", "status", "message"),
    [
        (("--help",), '"$@" | true; echo ${PIPESTATUS[0]} >&2', 0, ""),
        (("robot", "list"), '"$@" | true; echo ${PIPESTATUS[0]} >&2', 0, ""),
        (("verify", "--help"), '"$@" | true; echo ${PIPESTATUS[0]} >&2', 0, ""),
        (("verify", POLICY, "--json"), '"$@" | true; echo ${PIPESTATUS[0]} >&2', 0, ""),
        (("--version",), '"$@" >&-; echo $? >&2', 0, ""),
        (("verify", POLICY), '"$@" <&- >&- ; echo $? >&2', 0, ""),
        (("robot", "list"), '"$@" >/dev/full; echo $? >&2', 1, "standard output cannot be written: No space left"),
        (("verify", "a" * 300), '"$@"; echo $? >&2', 1, "aaaa"),
        (("verify", "\udcff"), '"$@"; echo $? >&2', 1, "\\udcff"),
        (("verify", "\x1b[2J"), '"$@"; echo $? >&2', 1, "[2J"),
    ],
)
def test_streams_that_end_early_and_names_that_are_none(
    words: tuple[str, ...], shell: str, status: int, message: str, tmp_path: Path
) -> None:
    """`| head` is no error, a full disk is one line, and no name is written as it is where that would do something."""
    done = run(words, shell, tmp_path)
    *lines, last = done.stderr.splitlines()
    assert int(last) == status, done.stderr
    assert len(lines) == bool(message) and message in "".join(lines) and "\x1b" not in done.stderr


def test_a_name_is_no_markup(capsys: pytest.CaptureFixture) -> None:
    """`[red]` in a robot's name would vanish, `[/x]` raise, and an escape sequence clear the screen."""
    from rich.table import Table

    table = Table("robot [b]", title="[/x] \x1b[2J")
    table.add_row("[red]go1[/red] :smile: \x9b1m")
    Terminal(width=100).print(table)
    Terminal(width=100).print("[/nothing] \u202e")
    with work_progress() as progress:
        progress("[/bar] \x1b]0;title\x07", 1.0)
    captured = capsys.readouterr()
    for shown in ("[/x] \\u001b[2J", "[red]go1[/red] :smile: \\u009b1m", "robot [b]", "[/nothing] \\u202e"):
        assert shown in captured.out
    assert "[/bar] \\u001b]0;title\\u0007: done" in captured.err


WAIT = """
import sys
from pathlib import Path
from stiction.cli import main, process
import stiction.cli.robot as verb

def wait(arguments):
    from stiction.core.lock import output_folder
    from stiction.core.parallel import spread
    from stiction.core.scratch import scratch
    with output_folder(Path(arguments[0])), scratch():
        list(spread(__import__("test_parallel").last, [(Path(arguments[0]) / "pids",)] * 2, 2))

if __name__ == "__main__":
    verb.main = wait
    main.entry()
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGKILL, signal.SIGINT])
def test_nothing_outlives_a_command_that_is_ended(number: signal.Signals, tmp_path: Path) -> None:
    """However it is ended: no process, no lock, nothing in the temporary folder; and one line, where it can say it."""
    script, out, temporary = tmp_path / "parent.py", tmp_path / "out", tmp_path / "temporary"
    script.write_text(WAIT)
    for folder in (out / "pids", temporary):
        folder.mkdir(parents=True)
    path = os.pathsep.join(
        [str(Path(__file__).parents[1] / "core"), str(Path(__file__).parents[1] / "helpers"), *sys.path]
    )
    environment = os.environ | {"TMPDIR": str(temporary), "PYTHONPATH": path}
    words = [sys.executable, str(script), "robot", str(out)]
    command = subprocess.Popen(words, env=environment, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: len(list((out / "pids").iterdir())) == 2, "the workers did not begin", 120.0)
    workers = [int(path.name) for path in (out / "pids").iterdir()]
    command.send_signal(number)
    errors = command.communicate()[1].splitlines()
    wait_until(lambda: not any(map(is_alive, workers)), "workers go on")
    wait_until(lambda: not list(temporary.iterdir()), "a temporary folder stays")
    if number != signal.SIGKILL:
        what = "interrupted" if number == signal.SIGINT else f"ended by {number.name}"
        assert command.returncode == 128 + number and errors == [f"stiction robot: {what}"]
        assert not (out / ".lock").exists()
