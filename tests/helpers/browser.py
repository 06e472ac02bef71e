"""A real browser for tests: headless Chromium, driven by DevTools over the websockets that viser brings."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

FLAGS = (
    *("--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
    *("--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update"),
    *("--disable-sync", "--disable-dev-shm-usage", "--remote-debugging-port=0", "--window-size=900,560"),
    "--no-proxy-server",
)
"""WebGL on the processor, and nothing that asks the network."""

PATIENCE = 300.0
"""Longest that a browser may take for one answer, on a machine that does other work [s]."""


def find_chromium() -> str | None:
    """Return the browser's path; None where there is none."""
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    return next((path for name in names if (path := shutil.which(name))), None)


class Tab:
    """One page."""

    def __init__(self, address: str) -> None:
        """address: of its DevTools websocket."""
        from websockets.sync.client import connect

        self._socket = connect(address, max_size=None, open_timeout=PATIENCE, proxy=None)
        self._number = 0
        self.complaints: list[str] = []
        """Errors of its console, and exceptions that nobody caught."""
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._socket.recv(timeout=PATIENCE))
            self._listen(answer)
            if answer.get("id") == self._number:
                assert "error" not in answer, (method, answer["error"])
                return answer["result"]

    def _listen(self, event: dict[str, Any]) -> None:
        """Keep what the console says of errors."""
        params = event.get("params", {})
        if event.get("method") == "Runtime.exceptionThrown":
            details = params["exceptionDetails"]
            self.complaints.append(details.get("exception", {}).get("description", details["text"]))
        elif event.get("method") == "Runtime.consoleAPICalled" and params["type"] == "error":
            self.complaints.append(" ".join(str(word.get("value", word.get("description"))) for word in params["args"]))
        elif event.get("method") == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.complaints.append(f"{params['entry']['text']} ({params['entry'].get('url')})")

    def open(self, address: str) -> None:
        """Go to an address."""
        self.call("Page.navigate", url=address)

    def run(self, script: str) -> Any:
        """Return the value of an expression of JavaScript, a promise's once it is there."""
        answer = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, script: str) -> Any:
        """Return the value of an expression once it is true."""
        return wait(lambda: self.run(script), script)

    def press(self, key: str, code: str, shift: bool = False) -> None:
        """Press and release a key: `g`, `KeyG`."""
        word = {"key": key.upper() if shift else key, "code": code, "modifiers": 8 if shift else 0}
        word["windowsVirtualKeyCode"] = ord(key.upper()) if len(key) == 1 else {"ArrowRight": 39}[key]
        self.call("Input.dispatchKeyEvent", type="keyDown", **word)
        self.call("Input.dispatchKeyEvent", type="keyUp", **word)

    def screenshot(self) -> bytes:
        """Return the page as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])


class Browser:
    """A browser whose tabs know nothing of each other's user."""

    def __init__(self, port: int) -> None:
        """port: of its DevTools."""
        self._port = port

    def tab(self, address: str) -> Tab:
        """Open an address in a new tab."""
        request = urllib.request.Request(f"http://127.0.0.1:{self._port}/json/new?about:blank", method="PUT")
        with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(request, timeout=PATIENCE) as answer:
            tab = Tab(json.load(answer)["webSocketDebuggerUrl"])
        tab.open(address)
        return tab


@contextmanager
def chromium(folder: Path) -> Iterator[Browser]:
    """Start a browser with an empty profile in a folder; skip the test where there is none."""
    program = find_chromium()
    if program is None:
        pytest.skip("there is no Chromium here (Debian: apt install chromium)")
    command = [program, *FLAGS, f"--user-data-dir={folder}", "about:blank"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            port = folder / "DevToolsActivePort"
            yield Browser(int(wait(lambda: port.is_file() and port.read_text().split(), "DevTools")[0]))
        finally:
            process.terminate()
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()


def wait(condition: Callable[[], Any], what: str) -> Any:
    """Return what a condition returns once that is true."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        if value := condition():
            return value
        time.sleep(0.05)
    raise AssertionError(f"nothing within {PATIENCE:.0f} s: {what}")
