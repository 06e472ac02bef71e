"""Process of the logger: takes rows from the supervisor and writes them, half a second at a time.

Each half second is a file of its own that is whole or not there, so that a log stays readable up to the last second
whatever is killed; a minute of them becomes one file, and beyond `keep` minutes the oldest go. Started as a module:

    python -m stiction.deploy.runtime.recorder FOLDER SOCKET KEEP FEET BUNDLE DIGEST
"""

from __future__ import annotations

import socket
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

from stiction.core.errors import StictionError
from stiction.core.lifeline import follow_parent
from stiction.deploy.runtime.channel import Channel, row_layout, targets_layout
from stiction.deploy.transports.messages import HEAD, Layout
from stiction.files.bundle import reread_bundle
from stiction.files.run_log import READINGS, RUN, STEPS, part_name, parts_of, read_part, read_run_header
from stiction.files.tables import Columns, publish_npz

PART_SECONDS = 0.5
"""Length of a part [s]."""

MERGED = 120
"""Number of parts that become one file: a minute."""

AT_ONCE = 10

END = b"end"


class Parts:
    """Table of a log that is being written: rows come in, parts go out."""

    def __init__(self, folder: Path, table: str, layout: Layout, keep: int, run: str = "") -> None:
        """Start an empty table; keep: most parts to keep, the newest; run: name of the run in its header."""
        self._folder, self._table, self._layout, self._keep, self._run = folder, table, layout, keep, run
        self._rows: list[tuple[float, np.ndarray]] = []
        self._number = 0

    def add(self, time: float, values: np.ndarray) -> None:
        """Take one row; time: on the supervisor's clock [s]."""
        self._rows.append((time, values))

    def flush(self) -> None:
        """Write the new rows as one part; merge and drop older ones. An empty half second has no file."""
        number, self._number = self._number, self._number + 1
        if self._rows:
            values = np.array([row for _, row in self._rows])
            arrays = {name: _plain(name, values[:, place]) for name, place in self._layout.places.items()}
            arrays["time"] = np.array([time for time, _ in self._rows])
            self._rows = []
            self._publish(number, number, arrays)
        if self._number % MERGED == 0:
            self._merge(self._number - MERGED, number)
        if self._number % MERGED == 0 or self._number > self._keep:
            self._drop(self._number - self._keep)

    def _merge(self, first: int, last: int) -> None:
        names = [n for a, b, n in self._parts() if first <= a and b <= last]
        if len(names) < 2:
            return
        arrays = [read_part(self._folder / name, self._run) for name in names]
        self._publish(first, last, {name: np.concatenate([part[name] for part in arrays]) for name in arrays[0]})
        # Behind the whole minute: if this is cut short, parts lie beside it, and readers pass over what it covers.
        for name in names:
            (self._folder / name).unlink(missing_ok=True)

    def _publish(self, first: int, last: int, arrays: Columns) -> None:
        arrays |= {RUN: np.array(self._run)} if self._run else {}
        publish_npz(self._folder / part_name(self._table, first, last), arrays, compressed=True)

    def _drop(self, before: int) -> None:
        for _, last, name in self._parts():
            if last < before:
                (self._folder / name).unlink(missing_ok=True)

    def _parts(self) -> list[tuple[int, int, str]]:
        return parts_of((path.name for path in self._folder.iterdir()), self._table)


def _plain(name: str, values: np.ndarray) -> np.ndarray:
    """Return a column as it is stored: times in double precision, one number a row without a second axis."""
    values = values[:, 0] if values.shape[1] == 1 else values
    return values if name == "robot_time" else values.astype(np.float32)


class Rows:
    """Supervisor's end of the channel: gathers rows of readings, sends steps at once, and never waits."""

    def __init__(self, channel: Channel, readings: Layout) -> None:
        self._channel, self._readings = channel, readings
        self._waiting: list[bytes] = []
        self._number = 0
        self.alive = True
        """True while the logger takes the rows."""

    @property
    def lost(self) -> int:
        """Number of datagrams that the logger had no room for."""
        return self._channel.lost

    def reading(self, time: float, vectors: dict[str, object]) -> None:
        """Log one reading."""
        self._number += 1
        self._waiting.append(self._readings.pack(self._number, time, vectors))
        if len(self._waiting) == AT_ONCE:
            self.flush()

    def flush(self) -> None:
        """Send the waiting rows."""
        if self._waiting:
            self.send(b"".join(self._waiting))
            self._waiting = []

    def end(self) -> None:
        """Send the waiting rows, and the mark of the end."""
        self.flush()
        self.send(END)

    def send(self, data: bytes) -> None:
        """Send bytes, such as an answer of the policy as it came; do nothing where the logger has ended."""
        self.alive = self.alive and self._channel.send_raw(data)


def record(folder: Path, end: socket.socket, readings: Layout, steps: Layout, keep: int) -> None:
    """Write incoming rows until the sender ends the log or is gone.

    Raises `StictionError` or `OSError` where it cannot be written: the log then ends with what was written before.
    """
    run = read_run_header(folder).run
    parts = {name: Parts(folder, name, layout, keep, run) for name, layout in ((READINGS, readings), (STEPS, steps))}
    end.settimeout(PART_SECONDS / 5)
    due = time.monotonic() + PART_SECONDS
    # As long as the longest datagram: a longer one would be cut, and its rows lost without a word.
    longest = max(AT_ONCE * readings.bytes, steps.bytes)
    going = True
    while going:
        with suppress(TimeoutError):
            data = end.recv(longest)
            going = data not in (b"", END)
            _take(data, parts, readings, steps)
        if time.monotonic() >= due or not going:
            # From the deadline and not from now, so that parts stay of one length.
            due += PART_SECONDS
            for part in parts.values():
                part.flush()


def _take(data: bytes, parts: dict[str, Parts], readings: Layout, steps: Layout) -> None:
    if (message := steps.unpack(data)) is not None:
        parts[STEPS].add(message.time, message.values)
        return
    for begin in range(0, len(data) - HEAD.size, readings.bytes):
        if (message := readings.unpack(data[begin : begin + readings.bytes])) is not None:
            parts[READINGS].add(message.time, message.values)


def main(folder: str, number: str, keep: str, feet: str, bundle: str, digest: str) -> int:
    """Record until the sender ends the log; return the exit status."""
    follow_parent()
    try:
        contract = reread_bundle(bundle, digest).contract
        readings, steps = row_layout(contract.num_joints, int(feet)), targets_layout(contract)
        record(Path(folder), socket.socket(fileno=int(number)), readings, steps, int(keep))
    except (StictionError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:7]))
