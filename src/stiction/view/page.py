"""The page around the scene: style for narrow pages, and the gamepad's script."""

from __future__ import annotations

from html import escape
from urllib.parse import parse_qs

import numpy as np

NARROW = """\
<style>
@media (max-width: 36em) {
  /* viser's sheet covers the right of the scene; here the scene ends where the sheet begins. */
  .mantine-Paper-root[style*="position: fixed"][style*="bottom: 0"] {
    width: 100% !important; max-height: 42% !important; }
  .mantine-Paper-root[style*="position: fixed"][style*="bottom: 0"] > div,
  .mantine-Paper-root[style*="position: fixed"][style*="bottom: 0"] [style*="width: 20em"] { width: 100% !important; }
  div:has(> canvas), div:has(> div > canvas) { max-height: 58vh !important; }
}
</style>"""
"""Style of pages up to 36 em (576 pixels) wide."""

PAD_PATH = "/gamepad"
"""Path to which browsers send the axes of a gamepad."""

PAD_HEADER = "X-Stiction-Gamepad"
"""Header of such requests: a page of another site cannot set it without asking first, which is refused."""

AXES = 3
"""Number of axes that a gamepad sends: forward, left, turn to the left, each from -1 to 1."""

PAD_SCRIPT = f"""\
if (!window.stictionGamepad) {{
  window.stictionGamepad = true;
  let sent = null;
  setInterval(() => {{
    const pad = [...(navigator.getGamepads?.() ?? [])].find((each) => each && each.connected && each.axes.length > 2);
    const axis = (number) => Math.abs(pad.axes[number]) < 0.15 ? 0 : -pad.axes[number];
    const axes = pad ? [axis(1), axis(0), axis(2)].map((value) => value.toFixed(2)).join(",") : "";
    if (axes === (sent ?? "")) return;
    sent = axes;
    fetch("{PAD_PATH}?axes=" + axes, {{headers: {{"{PAD_HEADER}": "1"}}}}).catch(() => {{ sent = null; }});
  }}, 100);
}}"""
"""Script that sends the axes of the first gamepad when they change, at most ten times a second; none: nothing."""


def page_parts() -> str:
    """Return the HTML that a page gets: the style, and the script in the one place where HTML set later runs it."""
    return f'{NARROW}<img src="data:," alt="" hidden onerror="{escape(PAD_SCRIPT)}">'


def gamepad_axes(path: str) -> tuple[float, ...] | None:
    """Return the axes in a request's path, clipped to -1 to 1; empty: no gamepad; None: not a gamepad's request."""
    name, _, query = path.partition("?")
    if name != PAD_PATH or len(query) > 100:
        return None
    words = parse_qs(query, keep_blank_values=True).get("axes", ["?"])[0].split(",")
    if words == [""]:
        return ()
    try:
        values = [float(word) for word in words]
    except ValueError:
        return None
    if len(values) != AXES or not np.isfinite(values).all():
        return None
    return tuple(float(np.clip(value, -1.0, 1.0)) for value in values)
