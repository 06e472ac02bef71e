"""A viser server that listens where it was told to, on the port that it was told, and nowhere else."""

from __future__ import annotations

import contextlib
import errno
import io
import logging
import os
import socket
from collections.abc import Iterator

import viser

from stiction.core.errors import ConfigurationError

LOOPBACK = "127.0.0.1"
"""Where it listens unless another address is named."""

FIRST, TRIED = 8080, 100
"""First port that is tried where none is named, and how many."""


class LocalServer(viser.ViserServer):
    """A viser server without a tunnel to the outside."""

    def request_share_url(self, verbose: bool = True) -> None:
        """Share nothing: viser would open a tunnel to a server on the internet when a browser asks for it."""


@contextlib.contextmanager
def serve(port: int | None = None, host: str = LOOPBACK) -> Iterator[viser.ViserServer]:
    """Serve on a port, by default the first free one from `FIRST` on.

    Raises `StictionError`: the port is taken or may not be used, or there is no such address here.
    """
    check_port(port)
    host = resolve(host)
    chosen = _free(host) if port is None else port
    if (why := _taken(host, chosen)) is not None:
        raise ConfigurationError(
            f"port {chosen} on {host} cannot be listened on: {why}; choose another --port, or leave it out"
        )
    # viser would listen elsewhere without a word.
    os.environ.pop("_VISER_PORT_OVERRIDE", None)
    # What a stranger sends to the port is no error of this program; without this its traceback is on our terminal.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    with _silence():
        server = LocalServer(host=host, port=chosen, label="stiction view", verbose=False)
    try:
        if server.get_port() != chosen:
            raise ConfigurationError(f"port {chosen} on {host} was taken just now; choose another --port")
        yield server
    finally:
        with _silence():
            server.stop()


def check_port(port: int | None) -> None:
    """Raise `ConfigurationError` for a number that no port has."""
    if port is not None and not 0 < port < 65536:
        raise ConfigurationError(f"port {port}; expected 1 to 65535")


def resolve(host: str) -> str:
    """Return the address that a name or an address says, of several the first of IPv4.

    Raises `ConfigurationError`: nothing is called that, or it is no address of this machine.
    """
    what = f"expected a name or an address of this machine, such as {LOOPBACK}, or 0.0.0.0 for all that it has"
    try:
        found = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)
    # Python's codec of names raises the other one: too long a name, or an empty part in it.
    except (socket.gaierror, UnicodeError) as error:
        said = getattr(error, "strerror", None) or "it is no name"
        raise ConfigurationError(f"host {host!r} cannot be found: {said}; {what}") from error
    # As most programs: `localhost` is 127.0.0.1 where it is ::1 too.
    family, kind, _, _, place = min(found, key=lambda one: one[0] != socket.AF_INET)
    with socket.socket(family, kind) as tried:
        try:
            tried.bind(place)
        except OSError as error:
            if error.errno == errno.EADDRNOTAVAIL:
                raise ConfigurationError(
                    f"host {host!r} is not here: {place[0]} is another machine's; {what}"
                ) from error
    return str(place[0])


def _silence() -> contextlib.redirect_stdout[io.StringIO]:
    """Keep what viser says of itself from standard output, which is for results."""
    return contextlib.redirect_stdout(io.StringIO())


def _free(host: str) -> int:
    """Return the first free port."""
    for port in range(FIRST, FIRST + TRIED):
        if _taken(host, port) is None:
            return port
    raise ConfigurationError(f"no port from {FIRST} to {FIRST + TRIED - 1} is free on {host}; choose one with --port")


def _taken(host: str, port: int) -> str | None:
    """Return why a port cannot be listened on; None where it can."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as tried:
        # As the server will: a port that was just left is free to it.
        tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            tried.bind((host, port))
        except OSError as error:
            return error.strerror or str(error)
    return None
