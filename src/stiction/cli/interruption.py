"""Ctrl-C and SIGTERM as a request: the work comes to a good place and stops there."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


class StopRequest:
    """Remembers the signal that asked to stop; a second one does not wait."""

    def __init__(self, say: Callable[[str], None], what: str) -> None:
        """`say`: prints the answer to the first signal; `what`: that which is still brought to its end."""
        self.say, self.what = say, what
        self.signal = 0

    def __call__(self) -> bool:
        """Say whether somebody asked to stop."""
        return self.signal != 0

    @property
    def status(self) -> int:
        """Exit status of a program that a signal ended: 130 for Ctrl-C, 143 for SIGTERM."""
        return 128 + self.signal

    def receive(self, number: int, _: FrameType | None) -> None:
        """Take a signal. Raises `KeyboardInterrupt` at the second."""
        if self.signal:
            raise KeyboardInterrupt
        self.signal = number
        self.say(f"stopping after {self.what}; press Ctrl-C once more to stop at once")


@contextmanager
def stop_requests(say: Callable[[str], None], what: str) -> Iterator[StopRequest]:
    """Take Ctrl-C and SIGTERM as a request while the work lasts."""
    request = StopRequest(say, what)
    before = {number: signal.signal(number, request.receive) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
