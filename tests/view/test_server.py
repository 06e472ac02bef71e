"""The viewer's server: pages of its own address are answered, pages of all other sites are not."""

from __future__ import annotations

import socket

import pytest

pytest.importorskip("viser", reason="the viewer needs the extra view")

import viser
import websockets.asyncio.server

from stiction.core.errors import StictionError
from stiction.view import server as module
from stiction.view.page import PAD_HEADER, PAD_PATH
from stiction.view.server import LOOPBACK, serve

UPGRADE = (
    "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    f"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Protocol: viser-v{viser.__version__}\r\n"
)
"""Headers of a browser that opens a WebSocket."""

FOREIGN_ORIGINS = (
    "http://evil.example",
    "https://evil.example:{port}",
    "http://evil.example:{port}",
    "http://localhost:3000",
    "http://localhost",
    "https://localhost:{port}",
    "http://127.0.0.1:{port}.evil.example",
    "http://evil.example/http://localhost:{port}",
    "http://127.0.0.2:{port}",
    "http://user@localhost:{port}",
    "file://",
    "null",
    "",
    "http://localhost:{port}\r\nOrigin: http://evil.example",
)
"""Origins of pages that are not the viewer's; the last one is two headers."""

FOREIGN_HOSTS = (
    "evil.example",
    "evil.example:{port}",
    "localhost.evil.example:{port}",
    "localhost",
    "localhost:1",
    "127.0.0.1.nip.example:{port}",
    "127.0.0.2:{port}",
    "2130706433:{port}",
    "[::ffff:127.0.0.1]:{port}",
    "localhost:{port}:{port}",
    "user@localhost:{port}",
    "",
    "localhost:{port}\r\nHost: evil.example",
)
"""Hosts that no browser with the viewer's own address sends: names of others that point here (DNS rebinding)."""


def ask(port: int, host: str | None, origin: str | None, upgrade: bool, address: str = LOOPBACK) -> int:
    """Return the status with which a server answers one request."""
    with socket.create_connection((address, port), timeout=10) as connection:
        lines = "GET / HTTP/1.1\r\n"
        lines += "" if host is None else f"Host: {host.format(port=port)}\r\n"
        lines += "" if origin is None else f"Origin: {origin.format(port=port)}\r\n"
        connection.sendall(f"{lines}{UPGRADE if upgrade else ''}\r\n".encode())
        return int(connection.makefile("rb").readline().split()[1])


@pytest.mark.parametrize("upgrade", [False, True], ids=["http", "websocket"])
def test_foreign_pages_are_refused_and_the_viewer_s_own_are_answered(upgrade: bool) -> None:
    """A site that a user visits cannot read or steer the viewer, be it by its own name or by one that points here."""
    with serve() as server:
        port, good = server.get_port(), 101 if upgrade else 200
        for host in ("localhost:{port}", "127.0.0.1:{port}", "LocalHost:{port}", "[::1]:{port}"):
            for origin in (None, f"http://{host}", "http://localhost:{port}"):
                assert ask(port, host, origin, upgrade) == good, (host, origin)
        for origin in FOREIGN_ORIGINS:
            assert ask(port, "localhost:{port}", origin, upgrade) == 403, origin
        for host in (None, *FOREIGN_HOSTS):
            assert ask(port, host, None, upgrade) == 403, host
            assert ask(port, host, "http://localhost:{port}", upgrade) == 403, host
        assert ask(port, "evil.example:{port}", "http://evil.example:{port}", upgrade) == 403
        assert ask(port, "localhost:{port}", None, upgrade) == good


def test_a_gamepad_steers_from_the_viewer_s_own_page_only() -> None:
    """Axes with the page's header arrive clipped; other sites, and requests without the header, do not arrive."""
    with serve() as server:
        port, arrived = server.get_port(), []
        server.pads.append(arrived.append)

        def send(axes: str, *headers: str, host: str = "localhost") -> int:
            with socket.create_connection((LOOPBACK, port), timeout=10) as connection:
                lines = (f"GET {PAD_PATH}?axes={axes} HTTP/1.1", f"Host: {host}:{port}", *headers, "", "")
                connection.sendall("\r\n".join(lines).encode())
                return int(connection.makefile("rb").readline().split()[1])

        header = f"{PAD_HEADER}: 1"
        assert send("0.5,-0.25,7", header) == 204 and send("", header) == 204
        assert arrived == [(0.5, -0.25, 1.0), ()]
        assert send("0.1,0,0", header, "Origin: http://evil.example") == 403
        assert send("0.1,0,0", header, host="evil.example") == 403
        for axes in ("0.1,0,0", "nan,0,0", "1,2", "1,2,3,4", "x", "1" * 300):
            assert send(axes, *([] if axes == "0.1,0,0" else [header])) != 204, axes
        assert len(arrived) == 2


def test_all_addresses_are_answered_each_under_its_own() -> None:
    """`--host 0.0.0.0` answers the address at which a request arrives, not any address and not any name."""
    with serve(host="0.0.0.0") as server:
        port = server.get_port()
        for host in ("127.0.0.3:{port}", "0.0.0.0:{port}", "localhost:{port}"):
            assert ask(port, host, f"http://{host}", True, "127.0.0.3") == 101, host
        for host in ("127.0.0.4:{port}", "lab-pc:{port}", "evil.example:{port}"):
            assert ask(port, host, None, True, "127.0.0.3") == 403, host
            assert ask(port, "localhost:{port}", f"http://{host}", True, "127.0.0.3") == 403, host


def test_a_viser_that_listens_in_another_way_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """The check rests on viser's call of websockets' `serve`; without that call the viewer does not start."""
    opened = websockets.asyncio.server.serve
    with serve():
        assert websockets.asyncio.server.serve is opened

    class Other:
        def __init__(self, port: int, **_: object) -> None:
            self.get_port, self.stop = lambda: port, lambda: stopped.append(port)

    stopped: list[int] = []
    monkeypatch.setattr(module, "LocalServer", Other)
    with pytest.raises(StictionError, match="without a check of Origin and Host"), serve():
        pass
    assert len(stopped) == 1
