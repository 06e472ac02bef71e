"""Terminal output shared by the verbs: console for names from files, progress of named work, clean stop."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from types import FrameType
from typing import Annotated, Any, TextIO

from rich.console import Console
from rich.file_proxy import FileProxy
from rich.live import Live
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.text import Text

from stiction.core.errors import ConfigurationError, escaped
from stiction.core.flags import flag
from stiction.core.provenance import MOST_THREADS, num_threads


class StreamAboveDisplay(FileProxy):
    """Standard output or error during a live display: lines for a terminal appear above it, escaped."""

    def __init__(self, console: Console, stream: TextIO) -> None:
        """Write to the console in place of the stream, or through to the stream if that is no terminal."""
        self._stream = getattr(stream, "rich_proxied_file", stream)
        super().__init__(console, self._stream)

    def write(self, text: str) -> int:
        """Write a text."""
        return super().write(escaped(text)) if self._stream.isatty() else self._stream.write(escaped(text))


class Terminal(Console):
    """A console to which a name from a file is a name: no markup, no emoji, and nothing that steers the terminal."""

    def __init__(self, **settings: Any) -> None:
        """Take the settings of `rich`'s console."""
        super().__init__(markup=False, emoji=False, **settings)
        self._redirected = ExitStack()

    def set_live(self, live: Live) -> bool:
        """Redirect both streams for a live display that begins.

        `rich` leaves streams alone that are redirected already. Its own redirection obeys the control sequences of a
        printed text, and takes the output of a command whose errors alone are on a terminal.
        """
        topmost = super().set_live(live)
        if self.is_terminal:
            self._redirected.enter_context(redirect_stdout(StreamAboveDisplay(self, sys.stdout)))
            self._redirected.enter_context(redirect_stderr(StreamAboveDisplay(self, sys.stderr)))
        return topmost

    def clear_live(self) -> None:
        """Give both streams back after a live display."""
        self._redirected.close()
        super().clear_live()

    def render_str(self, text: str, **how: Any) -> Text:
        """Return a text as it is shown, in a cell too."""
        return super().render_str(escaped(text), **how)


@contextmanager
def work_progress() -> Iterator[Callable[[str, float], None]]:
    """Show a bar on standard error for each piece of work that reports its name and the share of it that is done.

    Where standard error is not a terminal, a finished piece is a line.
    """
    console = Terminal(stderr=True)
    columns = TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn()
    tasks: dict[str, TaskID] = {}
    with Progress(*columns, console=console, disable=not console.is_terminal) as bars:

        def report(name: str, share: float) -> None:
            if name not in tasks:
                tasks[name] = bars.add_task(escaped(name), total=1.0)
            bars.update(tasks[name], completed=share)
            if share >= 1.0 and not console.is_terminal:
                console.print(f"{name}: done", soft_wrap=True, highlight=False)

        yield report


def print_warnings(verb: str, warnings: Sequence[str]) -> None:
    """Print what a reader must know before the results, a line each, on standard error."""
    for warning in warnings:
        print(f"stiction {verb}: {warning}", file=sys.stderr)


class StopRequest:
    """Remembers the signal that asked to stop; a second one does not wait."""

    def __init__(self, say: Callable[[str], None], what: str) -> None:
        """`say`: prints the answer to the first signal; `what`: that which is still brought to its end."""
        self.say, self.what = say, what
        self.signal = 0

    def __call__(self) -> bool:
        """Return whether a stop was requested."""
        return self.signal != 0

    @property
    def status(self) -> int:
        """Exit status of a program that a signal ended: 130 for Ctrl-C, 143 for SIGTERM, 129 for SIGHUP.

        143 too where another process of the same work was asked.
        """
        return 128 + (self.signal or signal.SIGTERM)

    def receive(self, number: int, _: FrameType | None) -> None:
        """Take a signal. Raises `KeyboardInterrupt` at the second."""
        if self.signal:
            raise KeyboardInterrupt
        self.signal = number
        self.say(f"stopping after {self.what}; press Ctrl-C once more to stop at once")


@contextmanager
def stop_requests(say: Callable[[str], None], what: str) -> Iterator[StopRequest]:
    """Take Ctrl-C, SIGTERM and a closed terminal (SIGHUP) as a request while the work lasts."""
    request = StopRequest(say, what)
    asking = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    # nohup has SIGHUP ignored.
    numbers = [number for number in asking if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, request.receive) for number in numbers}
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def jobs_of(asked: int | None) -> int:
    """Return how many tasks are done at once; by default as many as there are cores (STICTION_THREADS).

    Raises `StictionError` where less than one is asked for, or more than can start.
    """
    if asked is not None and not 1 <= asked <= MOST_THREADS:
        raise ConfigurationError(f"--jobs {asked}: expected at least 1, and at most {MOST_THREADS}")
    return asked or num_threads()


RobotSeeds = Annotated[
    tuple[int, ...],
    flag(
        help="Seeds of the virtual robots. Those from 1000 on are kept for results; smaller ones are for making and "
        "tuning methods, and results on them are called exploratory."
    ),
]
"""Type of an option `robots`."""
