"""Legibility of a page: contrast and size of its text, sideways scrolling, content of the first screen.

Measured in a browser, at the sizes and in the colour schemes of `VIEWS`, over what is really drawn.
"""

from __future__ import annotations

from typing import Any

from browser import Tab

VIEWS = tuple((width, dark) for width in (1280, 390) for dark in (False, True))
"""Widths of the window [CSS px] in both colour schemes."""

HEIGHT = 800
"""Height of the window [CSS px]."""

CONTRAST = 4.5
"""Least contrast of text (WCAG 2.1, level AA)."""

SMALLEST = 12.0
"""Least size of text in a figure, as shown [CSS px]."""

AUDIT = """(root, contrast, smallest, answered) => {
  const faults = [], pen = Object.assign(document.createElement("canvas"), {width: 1, height: 1}).getContext("2d");
  // A transition that another width began would be measured on its way.
  document.getAnimations().forEach(one => { try { one.finish() } catch { one.cancel() } });
  const rgba = color => {
    pen.clearRect(0, 0, 1, 1); pen.fillStyle = "#000"; pen.fillStyle = color; pen.fillRect(0, 0, 1, 1);
    const [r, g, b, a] = pen.getImageData(0, 0, 1, 1).data; return [r, g, b, a / 255];
  };
  const over = (top, under) => [0, 1, 2].map(k => top[3] * top[k] + (1 - top[3]) * under[k]).concat(1);
  const light = color => color.slice(0, 3).map(v => v / 255)
    .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const line = node => node ? [node, ...line(node.parentElement)] : [];
  const canvas = matchMedia("(prefers-color-scheme: dark)").matches ? [18, 18, 18, 1] : [255, 255, 255, 1];
  const behind = element => line(element).map(one => rgba(getComputedStyle(one).backgroundColor))
    .reduceRight((under, color) => over(color, under), canvas);
  const walker = document.createTreeWalker(document.querySelector(root), NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const text = walker.currentNode.textContent.trim(), element = walker.currentNode.parentElement;
    if (!text || element.closest("script, style, noscript")) continue;
    if (!element.checkVisibility({opacityProperty: true, visibilityProperty: true})) continue;
    const look = getComputedStyle(element), drawn = element.closest("svg"), back = behind(element);
    const ink = rgba(drawn ? look.fill : look.color);
    ink[3] *= line(element).reduce((product, one) => product * getComputedStyle(one).opacity, 1);
    const [high, low] = [light(over(ink, back)), light(back)].sort((a, b) => b - a);
    const ratio = (high + 0.05) / (low + 0.05);
    if (ratio < contrast) faults.push(`contrast ${ratio.toFixed(2)}: ${text.slice(0, 40)}`);
    if (!element.closest("figure")) continue;
    const matrix = drawn ? element.getScreenCTM() : {a: 1, b: 0};
    const size = parseFloat(look.fontSize) * Math.hypot(matrix.a, matrix.b);
    if (size < smallest - 0.01) faults.push(`${size.toFixed(1)} px in a figure: ${text.slice(0, 40)}`);
  }
  const page = document.documentElement;
  if (page.scrollWidth > innerWidth) faults.push(`scrolls sideways: ${page.scrollWidth} px wide`);
  if (answered) {
    const answer = document.getElementById("answer"), figure = document.querySelector("figure");
    const first = answer && answer.getClientRects().length ? answer.getBoundingClientRect() : null;
    if (!first || first.top + 40 > innerHeight) faults.push(`no answer in the first screen: ${first && first.top}`);
    const bottom = figure && figure.firstElementChild.getBoundingClientRect().bottom;
    if (innerWidth > 1000 && bottom > innerHeight) faults.push(`the figure leaves the first screen: ${bottom}`);
  }
  return faults;
}"""
"""Returns what is wrong on a page, as texts."""


def show(tab: Tab, width: int, dark: bool) -> None:
    """Give a tab a window of a width [CSS px] and a colour scheme."""
    tab.call("Emulation.setDeviceMetricsOverride", width=width, height=HEIGHT, deviceScaleFactor=1, mobile=False)
    scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
    tab.call("Emulation.setEmulatedMedia", features=[scheme])


def page_faults(tab: Tab, root: str = "body", answered: bool = True) -> list[str]:
    """Return what cannot be read of the page of a tab, in every view, and what its console says.

    root: selector of what is measured; answered: whether its answer and its figure belong into the first screen.
    """
    tab.wait("location.href != 'about:blank' && document.readyState == 'complete'")
    faults: list[str] = []
    words: tuple[Any, ...] = (repr(root), CONTRAST, SMALLEST, str(answered).lower())
    for width, dark in VIEWS:
        show(tab, width, dark)
        seen = tab.run(f"({AUDIT})({', '.join(map(str, words))})")
        faults += [f"{width} px, {'dark' if dark else 'light'}: {text}" for text in dict.fromkeys(seen)]
    return faults + [f"console: {text}" for text in tab.complaints]
