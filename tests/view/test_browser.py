"""The viewer in a real browser: the page, two people at once, a key that slows a robot, a clean end."""

from __future__ import annotations

import io
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("viser", reason="the viewer needs the extra view")
pytest.importorskip("mjviser", reason="the viewer needs the extra view")

from browser import Browser, Tab, chromium, wait

POLICY = "saturn_lite-flat-none-0.2"


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    """A browser."""
    with chromium(tmp_path / "profile") as started:
        yield started


@contextmanager
def view(*words: object) -> Iterator[subprocess.Popen]:
    """Run the program; it does not outlive the test, which would else wait for it where Ctrl-C is ignored."""
    command = [sys.executable, "-m", "stiction", "view", *map(str, words)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def speed(tab: Tab) -> float | None:
    """Return the speed of the robot that the panel shows [m/s]."""
    match = re.search(r"none (-?\d+\.\d+) m/s", tab.run("document.body?.innerText") or "")
    return float(match[1]) if match else None


def colours(tab: Tab) -> int:
    """Return how many different colours the scene has, from the page as it is painted."""
    from PIL import Image

    picture = np.asarray(Image.open(io.BytesIO(tab.screenshot())).convert("RGB"))
    middle = picture[picture.shape[0] // 4 :, picture.shape[1] * 3 // 10 : picture.shape[1] * 2 // 3]
    return len(np.unique(middle.reshape(-1, 3) // 8, axis=0))


def serious(tab: Tab) -> list[str]:
    """Return what the console complains of, but for late data of plots that were made anew, which viser drops."""
    return [text for text in tab.complaints if not text.startswith("Tried to update non-existent component")]


@pytest.mark.slow
def test_a_key_slows_the_robot_and_two_browsers_see_it(browser: Browser, tmp_path: Path) -> None:
    """A key changes the friction in both browsers, and nonsense from strangers changes nothing."""
    with view(POLICY, "--command", "vx=0.5", "--out", tmp_path) as process:
        try:
            assert process.stdout is not None and process.stderr is not None
            address = process.stdout.readline().split()[1]
            first = browser.tab(address)
            wait(lambda: (speed(first) or 0.0) > 0.4, "the robot walks")
            wait(lambda: colours(first) > 15, "a canvas that is not blank")
            # A stranger who talks nonsense, twice: no protocol at all, and then a wrong one.
            host, port = address.removeprefix("http://").split(":")
            for nonsense in (b"\x00\xff" * 500, b"GET / HTTP/1.1\r\nUpgrade: websocket\r\n\r\n\x81\x7f"):
                with socket.create_connection((host, int(port)), timeout=10) as stranger:
                    stranger.sendall(nonsense)
            second = browser.tab(address)
            wait(lambda: (speed(second) or 0.0) > 0.3, "the second browser sees the same robot")
            second.run("document.activeElement.blur()")
            for _ in range(8):
                second.press("g", "KeyG")
            values = "[...document.querySelectorAll('input')].map(one => one.value).join(' ')"
            wait(lambda: "40" in second.run(values).split(), "the key moves the slider")
            wait(lambda: abs(speed(second) or 1.0) < 0.25, "the robot is slowed by friction")
            # A page behind another one is not painted.
            first.call("Page.bringToFront")
            wait(lambda: "40" in first.run(values).split(), "the first browser sees the slider of the second")
            assert serious(first) == [] and serious(second) == []
        finally:
            process.send_signal(signal.SIGINT)
            _, printed = process.communicate(timeout=30)
        assert (process.returncode, printed) == (0, "")


PAD = """
window.axes = [0, 0, 0, 0];
navigator.getGamepads = () => [null, {connected: true, get axes() { return window.axes; }}];
"""
"""A gamepad that scripts move."""

BOX = "[...document.querySelectorAll('label')].find((each) => each.textContent.trim() === 'Gamepad steers')"

EDGES = """(() => {
  const canvas = [...document.querySelectorAll('canvas')].map((each) => each.getBoundingClientRect());
  const sheet = [...document.querySelectorAll('.mantine-Paper-root')].map((each) => each.getBoundingClientRect())
    .find((each) => Math.abs(each.bottom - innerHeight) < 2);
  return sheet && [Math.max(...canvas.map((each) => each.bottom)), sheet.top, sheet.width];
})()"""
"""Lower edge of the scene, upper edge and width of the controls [pixels]."""


@pytest.mark.slow
def test_a_page_of_390_pixels_shows_the_robot_above_the_controls_and_a_gamepad_steers(
    browser: Browser, tmp_path: Path
) -> None:
    """The controls take the whole width below the scene and cover none of it; a stick moves the command."""
    with view(POLICY, "--out", tmp_path) as process:
        assert process.stdout is not None
        address = process.stdout.readline().split()[1]
        tab = browser.tab("about:blank")
        tab.call("Emulation.setDeviceMetricsOverride", width=390, height=800, deviceScaleFactor=1, mobile=False)
        tab.call("Page.addScriptToEvaluateOnNewDocument", source=PAD)
        tab.open(address)
        bottom, top, width = wait(lambda: tab.run(EDGES), "the controls")
        wait(lambda: abs((speed(tab) or 0.0) - 0.5) < 0.15, "the robot walks at once")
        bottom, top, width = tab.run(EDGES)
        assert bottom <= top + 2 and top > 400 and width == 390
        tab.run("window.axes = [0, 0.5, 0, 0]")
        wait(lambda: tab.run(f"!!({BOX})"), "the box shows when there is a gamepad")
        tab.run(f"document.getElementById(({BOX}).htmlFor).click()")
        tab.run("window.axes = [0, -1, 0, 0]")
        wait(lambda: "commanded 0.90" in tab.run("document.body.innerText"), "the stick moves the command")
        assert serious(tab) == []


@pytest.mark.slow
def test_the_page_without_a_server_plays(browser: Browser, tmp_path: Path) -> None:
    """The static page plays without the program, and has its plots."""
    page = tmp_path / "page.html"
    with view(POLICY, "--command", "vx=0.5", "--static", page, "--seconds", "0.4") as process:
        printed, wrong = process.communicate(timeout=120)
    assert process.returncode == 0, wrong
    assert printed.startswith(f"page: {page}")
    tab = browser.tab(page.as_uri())
    wait(lambda: tab.run("document.querySelectorAll('canvas').length") and colours(tab) > 15, "a robot on the page")
    assert tab.run("[...document.querySelectorAll('#stiction-plots svg')].every((each) => each.clientHeight > 100)")
    assert tab.complaints == []


@pytest.mark.parametrize(
    ("words", "status", "line"),
    [
        (("nowhere",), 1, "unknown policy 'nowhere'"),
        (("--follow",), 1, "--follow: got no training run"),
        ((POLICY, "--command", "vx=3"), 1, "friction': command vx=3: the policy was trained for vx -0.9 to 0.9"),
        ((POLICY, "--port", "99999"), 1, "port 99999; expected 1 to 65535"),
        ((POLICY, "--friction-level", "2"), 1, "--friction-level: got 2, expected 0 to 0.9"),
        ((POLICY, "--friction-law", "glue"), 2, "glue"),
        ((POLICY, "--terrain", "sand=1"), 1, "unknown terrain 'sand'"),
    ],
)
def test_what_cannot_be_shown_is_said_in_one_line(
    words: tuple[str, ...], status: int, line: str, capsys: pytest.CaptureFixture
) -> None:
    """Names what cannot be shown in one line, without a traceback."""
    from stiction.cli.main import main

    try:
        done = main(["view", *words])
    except SystemExit as stop:
        done = int(stop.code or 0)
    printed = capsys.readouterr().err
    assert done == status and line in printed and "Traceback" not in printed
    if status == 1:
        assert printed.count("\n") == 1


def test_a_signal_ends_it_in_order() -> None:
    """SIGTERM ends it with status 0 and without a word."""
    with view(POLICY) as process:
        assert process.stdout is not None and "http://127.0.0.1:" in process.stdout.readline()
        process.send_signal(signal.SIGTERM)
        _, printed = process.communicate(timeout=30)
    assert (process.returncode, printed) == (0, "")
