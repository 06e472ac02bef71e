"""A viser server on one address and port that answers the pages of its own address alone."""

from __future__ import annotations

import contextlib
import errno
import io
import logging
import os
import socket
from collections.abc import Callable, Iterator
from typing import Any

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request

from stiction.core.errors import ConfigurationError
from stiction.view.page import PAD_HEADER, gamepad_axes

LOOPBACK = "127.0.0.1"
"""Default address to listen on."""

LOOPBACK_NAMES = ("localhost", LOOPBACK, "[::1]")
"""Names of this machine in a browser's address line, that no name server of somebody else can give."""

WILDCARDS = ("0.0.0.0", "::")
"""Addresses that stand for all addresses of this machine."""

HTTP_PORT = 80
"""Port that browsers leave out."""

FIRST, TRIED = 8080, 100
"""First port that is tried where none is named, and how many."""


class LocalServer(viser.ViserServer):
    """A viser server without a tunnel to the outside, and with gamepads."""

    pads: list[Callable[[tuple[float, ...]], None]]
    """Functions called with the axes of browsers' gamepads, in the server's thread; see `page.gamepad_axes`."""

    def request_share_url(self, verbose: bool = True) -> None:
        """Share nothing: viser would open a tunnel to a server on the internet when a browser asks for it."""


@contextlib.contextmanager
def serve(port: int | None = None, host: str = LOOPBACK) -> Iterator[LocalServer]:
    """Serve on a port, by default the first free one from `FIRST` on.

    host: name or address of this machine; browsers may use it, the names of loopback, and for a wildcard the address
    at which their request arrives. Raises `StictionError`: the port is taken or may not be used, the address is not
    here, or viser does not listen in the way that can be guarded.
    """
    check_port(port)
    name, host = host, resolve(host)
    chosen = _free(host) if port is None else port
    if (why := _taken(host, chosen)) is not None:
        raise ConfigurationError(
            f"port {chosen} on {host} cannot be listened on: {why}; choose another --port, or leave it out"
        )
    # viser would listen elsewhere without a word.
    os.environ.pop("_VISER_PORT_OVERRIDE", None)
    # What a stranger sends to the port is no error of this program; without this its traceback is on our terminal.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    pads = list[Callable[[tuple[float, ...]], None]]()
    with _silence(), _guarded(frozenset(map(_authority, (name, host))), chosen, pads) as guards:
        server = LocalServer(host=host, port=chosen, label="stiction view", verbose=False)
    server.pads = pads
    try:
        if not guards:
            raise ConfigurationError(
                f"viser {viser.__version__} listens without a check of Origin and Host; install viser 1.1"
            )
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
        addresses = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)
    # Python's codec of names raises the other one: too long a name, or an empty part in it.
    except (socket.gaierror, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no name"
        raise ConfigurationError(f"host {host!r} cannot be found: {reason}; {what}") from error
    # As most programs: `localhost` is 127.0.0.1 where it is ::1 too.
    family, kind, _, _, place = min(addresses, key=lambda address: address[0] != socket.AF_INET)
    with socket.socket(family, kind) as tried:
        try:
            tried.bind(place)
        except OSError as error:
            if error.errno == errno.EADDRNOTAVAIL:
                raise ConfigurationError(
                    f"host {host!r} is not here: {place[0]} is another machine's; {what}"
                ) from error
    return str(place[0])


@contextlib.contextmanager
def _guarded(names: frozenset[str], port: int, pads: list[Callable[[tuple[float, ...]], None]]) -> Iterator[list[int]]:
    """Let the server that viser opens within refuse foreign requests, HTTP and WebSocket alike; yield its ports.

    pads: called with the axes of gamepads that its own pages send.

    viser has no hook for requests, but it opens its server by websockets' public `serve`, which takes one: that
    function is wrapped while viser starts. The list stays empty where a viser opens its server in another way.
    """
    original, guards = websockets.asyncio.server.serve, list[int]()

    def serve(handler: Any, host: str, tried: int, *, process_request: Any = None, **options: Any) -> Any:
        def check(connection: ServerConnection, request: Request) -> Any:
            here = {_authority(connection.local_address[0])} if host in WILDCARDS else set()
            if (why := refusal(request.headers, names | here, port)) is not None:
                return connection.respond(403, f"{why}\n")
            if PAD_HEADER in request.headers and (axes := gamepad_axes(request.path)) is not None:
                for use in pads:
                    use(axes)
                return connection.respond(204, "")
            return None if process_request is None else process_request(connection, request)

        guards.append(tried)
        return original(handler, host, tried, process_request=check, **options)

    websockets.asyncio.server.serve = serve  # type: ignore[assignment, misc]
    try:
        yield guards
    finally:
        websockets.asyncio.server.serve = original  # type: ignore[misc]


def refusal(headers: Headers, names: frozenset[str], port: int) -> str | None:
    """Return why a request is refused, None where it comes from a page of this server or from no page.

    A page of another site that reaches this port is known by its `Origin`; one whose name was pointed at this machine
    (DNS rebinding) by its `Host`, which is still its own name. names: accepted beside those of loopback.
    """
    places = {f"{name}:{port}" for name in (*LOOPBACK_NAMES, *names)}
    if port == HTTP_PORT:
        places |= {*LOOPBACK_NAMES, *names}
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    if len(hosts) != 1 or hosts[0].lower() not in places:
        return f"Host is not this viewer; open http://localhost:{port}, or name it by --host"
    if len(origins) > 1 or any(origin.lower() not in {f"http://{place}" for place in places} for origin in origins):
        return "Origin is another site"
    return None


def _authority(host: str) -> str:
    """Return a name or an address as it stands in a URL."""
    return f"[{host.lower()}]" if ":" in host else host.lower()


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
